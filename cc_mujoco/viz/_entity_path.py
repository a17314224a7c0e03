"""A part of a Rerun recording, so that one can hold several episodes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import rerun as rr


@dataclass(frozen=True)
class Branch:
    """Place in a recording at which an episode is logged."""

    rec: rr.RecordingStream
    root: str = ""
    """Path under which all of it lies, escaped; empty for the recording's own root."""

    def log(self, path: str, what: Any, *, static: bool = False) -> None:
        self.rec.log(self._full_path(path), what, static=static)

    def send_columns(
        self, path: str, index: Iterable[Any], columns: Sequence[Any]
    ) -> None:
        """Log a whole series at a path below the root, and wait until it is encoded.

        Else all series of a long episode would queue up in memory.
        """
        self.rec.send_columns(self._full_path(path), index, columns)
        self.rec.flush()

    def _full_path(self, path: str) -> str:
        return f"{self.root}/{path.removeprefix('/')}"
