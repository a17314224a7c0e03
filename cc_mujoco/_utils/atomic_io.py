"""Writing of files: complete or not at all, and never over a file of the user.

A folder may be written to if it holds the mark of an earlier run (a file whose content
names its writer, defined by each subpackage), or if it is empty.
"""

import hashlib
import os
import re
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from cc_mujoco.errors import CableError

METADATA_KEY = b"cc_mujoco"  # key of the metadata that mark a Parquet file as ours
MANIFEST = ".written"  # checksums of a folder's files, see `provenance.write_manifest`


def require_ours(folder: str | os.PathLike[str], ours: Callable[[Path], bool]) -> None:
    """Raise `CableError`, before long work, if results must not go into a folder.

    It need not exist. `ours` returns whether it has the mark of an earlier run; without
    the mark it may hold only hidden files and empty folders.
    """
    require_writable(folder)
    place = Path(folder)
    if not place.exists():
        return
    held = sorted(path for path in place.iterdir() if path.name[:1] != ".")
    theirs = [
        path.name
        for path in held
        if path.is_symlink() or not path.is_dir() or any(path.iterdir())
    ]
    if theirs and not ours(place):
        more = f" and {len(theirs) - 3} more" if len(theirs) > 3 else ""
        raise CableError(
            f"{folder} holds {', '.join(theirs[:3])}{more}, which no such run wrote; "
            "name another folder to write to."
        )


def require_own_file(path: Path, ours: Callable[[Path], bool]) -> None:
    """Raise `CableError`, before long work, if a file that is not `ours` is there."""
    if os.path.lexists(path) and not ours(path):
        raise CableError(
            f"{path} is there, and no such run wrote it; name another file to write."
        )
    require_writable(path.parent)


def checksum_line(path: Path) -> str:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
    return f"{path.name} as written: {digest.hexdigest()}"


def require_unmodified(
    folder: str | os.PathLike[str], names: Iterable[str], record: str | None = None
) -> None:
    """Raise `CableError` if one of these files was changed after a run wrote it.

    `record` is text with the lines of `checksum_line`, by default the folder's
    `MANIFEST`. Nothing is checked without it, as after an interrupted run.
    """
    if record is None:
        try:
            record = Path(folder, MANIFEST).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return
    for name in names:
        path = Path(folder, name)
        if record and path.is_file() and checksum_line(path) not in record:
            raise CableError(
                f"{path} is not as an earlier run wrote it, and would be replaced or "
                "deleted; name another folder to write to."
            )


def is_marked(path: Path) -> bool:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return METADATA_KEY in (pq.read_schema(path).metadata or {})
    except (OSError, pa.ArrowException):
        return False


def require_writable(folder: str | os.PathLike[str]) -> None:
    if not isinstance(folder, str | os.PathLike):
        raise CableError(f"the folder to write to must be a path, not {folder!r}.")
    if not os.fspath(folder):
        raise CableError("the folder to write to is empty; '.' is the current one.")
    there = Path(folder).absolute()
    if there.exists() and not there.is_dir():
        raise CableError(f"{folder} is a file; it must be a folder or be free.")
    while not os.path.lexists(there):
        there = there.parent
    if not there.is_dir():
        kind = "a link to nothing" if there.is_symlink() else "a file"
        raise CableError(f"cannot write {folder}: {there} is {kind}, and no folder.")
    try:
        os.listdir(there)
        with tempfile.TemporaryDirectory(prefix=".cc-mujoco-", dir=there):
            pass
    except OSError as error:
        raise CableError(
            f"cannot write {folder}: {there}: {error.strerror}; choose another folder."
        ) from None


@contextmanager
def replacing(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path beside `target`, which it replaces if the block succeeds."""
    target = Path(target)
    partial = _sibling_path(target)
    with _name_failures(target):
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
    block raises, the sibling and the folders made for it are deleted and `target` is
    untouched.
    """
    target = Path(target).absolute()
    partial = _sibling_path(target)
    made = [folder for folder in target.parents if not folder.exists()]
    with _name_failures(target):
        target.parent.mkdir(parents=True, exist_ok=True)
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
            with suppress(OSError):  # they hold something by now
                for folder in made:
                    folder.rmdir()


def _sibling_path(target: Path) -> Path:
    """Return a temporary path beside `target`; remove those of dead processes."""
    begin = f".{target.name}.{_host()}-"
    with suppress(OSError):  # there is no folder yet, or it cannot be read
        for name in os.listdir(target.parent):
            process = name.removeprefix(begin).removesuffix(".partial")
            if name == f"{begin}{process}.partial" and _is_dead(process):
                old = target.with_name(name)
                if old.is_dir() and not old.is_symlink():
                    shutil.rmtree(old, ignore_errors=True)
                else:
                    old.unlink(missing_ok=True)
    return target.with_name(f"{begin}{os.getpid()}.partial")


@cache
def _host() -> str:
    """Return a digest of this machine's name, as machines may share the disk."""
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]


def _is_dead(process: str) -> bool:
    if not process.isdecimal() or sys.platform == "win32":  # where a signal 0 kills
        return False
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):  # it is another user's
        return False
    return False


@contextmanager
def _name_failures(target: Path) -> Iterator[None]:
    """Turn an `OSError` into a `CableError` that names the file, as of a full disk."""
    try:
        yield
    except OSError as error:
        parts = (re.sub(r"^\.(.+)\.\w+-\d+\.partial$", r"\1", p) for p in target.parts)
        reason = error.strerror or str(error)
        raise CableError(
            f"cannot write {Path(*parts)}: {reason.rstrip('.')}."
        ) from error
