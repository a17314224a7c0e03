"""Writing files so that a reader sees the old one or the new one, never half of one."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cc_mujoco.errors import CableError


def require_writable(folder: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a folder can be written or made.

    Raises:
        CableError: If it cannot.
    """
    there = Path(folder).absolute()
    while not there.exists():
        there = there.parent
    try:
        with tempfile.TemporaryDirectory(prefix=".cc-mujoco-", dir=there):
            pass
    except OSError as error:
        raise CableError(
            f"cannot write {folder}: {there}: {error.strerror}; choose another folder."
        ) from None


@contextmanager
def replacing(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a sibling path to write to; it becomes `target` when the block succeeds.

    The sibling lies in the same folder, so that the last step is one rename. If the
    block raises, the sibling is deleted and `target` is untouched.
    """
    target = Path(target)
    partial = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def replacing_folder(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield an empty sibling folder whose files move into `target` on success.

    A new `target` appears whole, by one rename. In an existing one only files of the
    same names are replaced, each by one rename, after all of them are complete. If the
    block raises, the sibling is deleted and `target` is untouched.
    """
    target = Path(target).absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.{os.getpid()}.partial")
    partial.mkdir()
    try:
        yield partial
        if target.exists():
            for file in sorted(partial.iterdir()):
                os.replace(file, target / file.name)
        else:
            os.rename(partial, target)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
