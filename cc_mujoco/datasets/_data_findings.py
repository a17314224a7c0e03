"""Findings about the data: one sentence each."""

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
