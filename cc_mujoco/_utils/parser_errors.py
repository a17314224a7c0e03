"""Errors of the parsers of binary files, as one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cc_mujoco.errors import CableError


@contextmanager
def one_sentence(path: Path, advice: str = "") -> Iterator[None]:
    """Turn whatever a parser raises for a file into one sentence that names the file.

    It has the system's reason where there is one, and else the `advice`, a part of a
    sentence on what would be right.
    """
    try:
        yield
    except CableError:
        raise
    except Exception as error:
        reason = getattr(error, "strerror", None)
        if reason:
            raise CableError(f"cannot read {path}: {reason}.") from None
        text = " ".join(str(error).split())[:160].rstrip(".") or type(error).__name__
        more = f"; {advice}" if advice else ""
        raise CableError(
            f"{path} is not a whole {path.suffix[1:]} file: {text}{more}."
        ) from None
