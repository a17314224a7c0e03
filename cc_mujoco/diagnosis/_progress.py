"""Reports of progress: the share done, and what is being done."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]


def no_progress(share: float, doing: str) -> None:
    """Report nothing."""


def part_of(progress: Progress, start: float, length: float) -> Progress:
    """Return a report of progress that covers a part of another one.

    Args:
        progress: the whole.
        start: share of the whole at which the part begins.
        length: share of the whole that the part takes.
    """
    return lambda share, doing: progress(start + length * share, doing)
