"""Import of users' objects named `MODULE:NAME` or `FILE.py:NAME`, and their errors.

    make = named_object("controller", "my_module:my_function", "function")
    with user_errors("controller 'my_module:my_function'"):
        make(drive)

An exception inside becomes a `CableError` with file and line, and is its cause.

Names given in a call are imported. A name read from a file goes through
`named_in_file`, and is imported only if a call has allowed it:

    allow("my_module:my_function")             # also by `--allow` or `allow=`
    named_in_file(text, "study.json", "task")
"""

import importlib
import importlib.util
import os
import re
import sys
import sysconfig
import traceback
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from cc_mujoco.errors import CableError

_CODE = re.compile(r":[^\W\d]\w*(?!\w|\s*=)")
"""End of `MODULE:NAME`; a parameter, as in `sine:frequency=2`, is no such end."""
_allowed_names: set[str] = set()  # by calls of this process, in files
_REFUSED = re.compile(r" \{refused: (.*?)\}", re.DOTALL)
"""Mark of a name that no call has allowed; no such name can be imported."""


def allow(names: str | Iterable[str]) -> None:
    """Allow this process to import the `MODULE:NAME` in texts when a file names it."""
    for name in [names] if isinstance(names, str) else names:
        _allowed_names.update((name, *_parts(name)))


def allowed() -> tuple[str, ...]:
    """Return all names allowed so far, to allow them in another process."""
    return tuple(sorted(_allowed_names))


def named_in_file(
    text: str,
    where: str | Path,
    key: str,
    *,
    free: Container[str] = (),
    deferred: bool = False,
) -> str:
    """Return a text from a file after checking that the code it names is allowed.

    The text is a name with or without code: `sine`, `MODULE:NAME`, `hip=MODULE:NAME`.
    `where` and `key` tell its place in the error; `free` are names of the package,
    which may be followed by a colon. If `deferred`, a refused text is not an error but
    returned with a mark, and `named_object` raises the error if it is used.
    """
    refused = [
        part
        for part in _parts(text)
        if _CODE.search(part)
        and part not in _allowed_names
        and part.partition(":")[0] not in free
    ]
    if not refused or text in _allowed_names:
        return text
    sentence = (
        f"{where}, {key} names code, {refused[0]!r}, which runs only if the call names "
        f"it as well: give --allow {refused[0]}, in Python allow={refused[0]!r}, if "
        "you trust it."
    )
    if deferred:
        return _CODE.sub(lambda found: f"{found[0]} {{refused: {sentence}}}", text)
    raise CableError(sentence)


def without_mark(text: str) -> str:
    return _REFUSED.sub("", text)


def _parts(text: str) -> list[str]:
    parts = [part.strip() for part in text.split(",")]
    return [re.sub(r"^[\w-]+=", "", part) for part in parts]


def named_object(kind: str, name: str, form: str) -> Any:
    """Return the object `MODULE:NAME`, or `FILE.py:NAME` with the path of a file.

    Modules are found as by `import` from the current folder. `kind` is the object's
    role in an error ("controller"), `form` its Python type ("function").
    """
    if refused := _REFUSED.search(name):
        raise CableError(refused[1])
    place, _, inside = name.rpartition(":")
    is_file = place.endswith(".py")
    if not is_file:
        place, _, inside = name.partition(":")
    if not _CODE.fullmatch(f":{inside}"):
        raise CableError(f"{kind} {name!r} must be MODULE:NAME or FILE.py:NAME.")
    find = _module_of_file if is_file else _module
    module, called = find(kind, name, place), "file" if is_file else "module"
    try:
        return getattr(module, inside)
    except AttributeError:
        raise CableError(
            f"{kind} {name!r}: {called} {place!r} has no {form} {inside!r}."
        ) from None


def _module_of_file(kind: str, name: str, place: str) -> ModuleType:
    path = Path(place)
    if not path.is_file():
        raise CableError(f"{kind} {name!r}: there is no file {place!r}.")
    called = f"cc_mujoco_user_{path.stem}"
    spec = importlib.util.spec_from_file_location(called, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[called] = module  # dataclasses look their module up
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    try:
        with user_errors(f"{kind} {name!r}"):
            spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return module


def _module(kind: str, name: str, place: str) -> ModuleType:
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        with user_errors(f"{kind} {name!r}"):
            return importlib.import_module(place)
    except CableError as error:
        missing = getattr(error.__cause__, "name", None)
        absent = isinstance(error.__cause__, ModuleNotFoundError)
        if place and not (absent and missing and f"{place}.".startswith(f"{missing}.")):
            raise
        raise CableError(
            f"{kind} {name!r}: there is no module {place!r}; it must be importable "
            f"or lie in {here}."
        ) from None
    finally:
        sys.path.remove(here)


@contextmanager
def user_errors(what: str, *kinds: type[BaseException]) -> Iterator[None]:
    """Turn an exception in the block into a `CableError` that tells its place.

    The sentence names `what`, file and line, or only `what` if no code of the user was
    running, as for a wrong signature. By default all errors are turned, also
    `SystemExit`, as user code must not end the computation.
    """
    kinds = kinds or (Exception, SystemExit)
    try:
        yield
    except CableError:
        raise
    except kinds as error:
        where, message = "", str(error)
        if isinstance(error, SyntaxError):
            where, message = f" in {error.filename}, line {error.lineno}", error.msg
        elif own := _own_frames(traceback.extract_tb(error.__traceback__)):
            where = f" in {own[-1].filename}, line {own[-1].lineno}"
        notes = getattr(error, "__notes__", [])
        message = " ".join("; ".join([message, *notes]).split())
        raise CableError(
            f"{what} raised {type(error).__name__}{where}: {message}"
        ) from error


def _own_frames(frames: traceback.StackSummary) -> list[traceback.FrameSummary]:
    foreign = [str(Path(__file__).resolve().parents[1]), "<"]
    foreign += [sysconfig.get_paths()[key] for key in ("stdlib", "purelib", "platlib")]
    return [one for one in frames if not one.filename.startswith(tuple(foreign))]
