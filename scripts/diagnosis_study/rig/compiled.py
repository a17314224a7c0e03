"""The decorator of compiled functions, and the guard of what it stored on disk.

Numba keeps compiled code until the file of that function changes, and does not look
at the functions it calls. So code older than any source here is thrown away.
"""

from __future__ import annotations

from pathlib import Path

from numba import njit

_HERE = Path(__file__).parent


def _drop_stale_code() -> None:
    newest = max(source.stat().st_mtime for source in _HERE.rglob("*.py"))
    for index in _HERE.rglob("__pycache__/*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink(missing_ok=True)


_drop_stale_code()

compiled = njit(cache=True, nogil=True, error_model="numpy")
