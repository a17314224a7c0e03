"""Findings about the data: one sentence each."""

import re
from collections.abc import Iterable
from functools import partial
from typing import Literal, NamedTuple

Severity = Literal["error", "warning", "doubt"]
"""`error` where nothing may be concluded before it is put right, `warning` where the
program has dealt with it or can live with it, `doubt` where it can, too, but the owner
should settle it before anything else."""


class DataFinding(NamedTuple):
    """A problem or remark on the data, in one sentence, with its severity."""

    severity: Severity
    statement: str  # one sentence with file and column, and what would be right
    trial: str = ""  # name of the trial, empty if the finding is about all of them
    # name of the channel (see `channels`), empty if it is about several
    channel: str = ""


error = partial(DataFinding, "error")
warning = partial(DataFinding, "warning")
doubt = partial(DataFinding, "doubt")


def errors(findings: list[DataFinding]) -> list[DataFinding]:
    """Return the findings that must be corrected before a diagnosis."""
    return [finding for finding in findings if finding.severity == "error"]


def statements(findings: Iterable[DataFinding]) -> tuple[str, ...]:
    """Return the statements; one for all trials that differ only in their name."""
    groups: dict[str, list[DataFinding]] = {}
    for each in findings:
        key = each.statement.replace(each.trial, "") if each.trial else each.statement
        groups.setdefault(key, []).append(each)
    found = []
    for group in groups.values():
        first, rest = group[0], len(group) - 1
        file = rf"({re.escape(first.trial)}\.\w+)"
        joined, files = re.subn(file, rf"\1 and {rest} more", first.statement, count=1)
        found += [joined] if rest and files else [each.statement for each in group]
    return tuple(found)
