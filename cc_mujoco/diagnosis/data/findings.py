"""Findings about the data: one sentence each."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """Something about the data that its owner should know.

    Attributes:
        severity: `error` where nothing may be concluded before it is put right,
            `warning` where the program has dealt with it or can live with it, `doubt`
            where it can, too, but the owner should settle it before anything else.
        statement: one sentence with file and column, and what would be right.
        trial: name of the trial, empty if the finding is about all of them.
        channel: name of the channel (see `channels`), empty if it is about several.
    """

    severity: Literal["error", "warning", "doubt"]
    statement: str
    trial: str = ""
    channel: str = ""


def error(statement: str, trial: str = "", channel: str = "") -> Finding:
    """A finding that must be put right first."""
    return Finding("error", statement, trial, channel)


def warning(statement: str, trial: str = "", channel: str = "") -> Finding:
    """A finding to know of."""
    return Finding("warning", statement, trial, channel)


def doubt(statement: str, trial: str = "", channel: str = "") -> Finding:
    """A finding that comes before what the data seem to say."""
    return Finding("doubt", statement, trial, channel)


def errors(findings: list[Finding]) -> list[Finding]:
    """Return those that must be put right first."""
    return [finding for finding in findings if finding.severity == "error"]
