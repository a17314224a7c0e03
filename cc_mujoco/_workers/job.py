"""Jobs, which can be pickled, and their pieces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

Tick = Callable[[float], None]
"""Takes the share of a piece that is done, 0 to 1; may raise to stop."""

Progress = Callable[[float], None]
"""Takes how much is done, in units of `Job.size`, a fraction for what is under way."""


class Job(Protocol):
    """Work in pieces; all of it is plain data that can be pickled."""

    def rehearse(self) -> None:
        """Make all that the pieces need, and do nothing."""

    def made_by(self) -> dict[str, Any]:
        """Return the provenance of the results, after a rehearsal."""

    def size(self, piece: Any) -> int:
        """Return how much a piece adds to the progress."""

    def do(self, piece: Any, tick: Tick) -> Any:
        """Do a piece."""
