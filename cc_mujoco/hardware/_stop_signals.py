"""Ways for a person to stop a run: a signal, or the return key."""

from __future__ import annotations

import contextlib
import select
import signal
import sys
from collections.abc import Iterator
from types import FrameType

from cc_mujoco.hardware._loop import Ending

SIGNALS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
)


class Stops:
    """Stop signals, checked in every cycle; remembers the first that came."""

    def __init__(self, keyboard: bool) -> None:
        """Begin with none; with `keyboard` the return key counts, too."""
        self._keyboard = keyboard
        self._found: Ending | None = None

    def __call__(self) -> Ending | None:
        """Return why to end, if a person requested it."""
        if self._found is None and self._keyboard and self._return_pressed():
            self._found = Ending("stopped by the return key.")
        return self._found

    def handle_signal(self, number: int, _: FrameType | None = None) -> None:
        """Take a signal; the first one counts."""
        if self._found is None:
            name = signal.Signals(number).name
            self._found = Ending(f"stopped by {name}.", 128 + number)

    @staticmethod
    def _return_pressed() -> bool:
        ready, _, _ = select.select([sys.stdin], [], [], 0.0)
        # The end of a terminal is a reason to stop, too.
        return bool(ready) and sys.stdin.readline() is not None


@contextlib.contextmanager
def watch_for_stop() -> Iterator[Stops]:
    """Take signals, and the return key where there is a terminal to press it on."""
    # Windows selects sockets only.
    keyboard = sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty()
    stops = Stops(keyboard)
    before = {number: signal.signal(number, stops.handle_signal) for number in SIGNALS}
    try:
        yield stops
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
