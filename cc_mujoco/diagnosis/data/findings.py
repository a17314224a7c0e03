"""What is noticed about the data: one sentence each."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """Something about the data that its owner should know.

    Attributes:
        severity: `fix` where nothing may be concluded before it is put right, `note`
            where the program has dealt with it or can live with it.
        statement: one sentence with file and column, and what would be right.
        trial: name of the trial, empty if the finding is about all of them.
        channel: name of the channel (see `channels`), empty if it is about several.
    """

    severity: Literal["fix", "note"]
    statement: str
    trial: str = ""
    channel: str = ""


def fix(statement: str, trial: str = "", channel: str = "") -> Finding:
    """A finding that must be put right first."""
    return Finding("fix", statement, trial, channel)


def note(statement: str, trial: str = "", channel: str = "") -> Finding:
    """A finding to know of."""
    return Finding("note", statement, trial, channel)


def to_fix(findings: list[Finding]) -> list[Finding]:
    """Those that must be put right first."""
    return [finding for finding in findings if finding.severity == "fix"]
