"""The stamp by which Numba knows whether what it keeps compiled is still right.

    stamp_compiled_code()        # once, before the first function is compiled

Numba keeps compiled code with a stamp of its source file. What that file's functions
call lies in other files and is compiled into them, so that here the stamp is a digest
of the file and of all files of this package that it imports, directly or not.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import _SourceFileBackedLocatorMixin

_ROOT = Path(__file__).parent
_IMPORT = re.compile(
    rf"^\s*from ({_ROOT.name}(?:\.\w+)*) import (\([^)]*\)|.*)$", re.MULTILINE
)
"""The package's files import each other absolutely and with `from`."""


def stamp_compiled_code() -> None:
    """Have Numba stamp this package's functions with `digest`; other code as ever."""
    locator: Any = _SourceFileBackedLocatorMixin
    usual = locator.get_source_stamp

    def get_source_stamp(self: Any) -> Any:
        file = Path(self._py_file)
        ours = _ROOT in file.parents and file.is_file()
        return digest(file) if ours else usual(self)

    locator.get_source_stamp = get_source_stamp


@cache
def digest(file: Path) -> str:
    """Return a digest of a source file of this package and of all that it imports."""
    found, left = {file}, [file]
    while left:
        new = _imported(left.pop()) - found
        found |= new
        left += new
    total = hashlib.sha256()
    for path in sorted(found):
        content = path.read_bytes()
        name = path.relative_to(_ROOT).as_posix()
        total.update(f"{name}\0{len(content)}\0".encode() + content)
    return total.hexdigest()


@cache
def _imported(file: Path) -> set[Path]:
    """Return the files of this package that a source file imports."""
    found = set()
    for module, names in _IMPORT.findall(file.read_text(encoding="utf-8")):
        place = _ROOT.joinpath(*module.split(".")[1:])
        places = [place]
        if place.is_dir():  # its names may be modules
            places += [place / name for name in re.findall(r"\w+", names)]
        for path in places:
            for source in (path.with_suffix(".py"), path / "__init__.py"):
                if path != _ROOT and source.is_file():
                    found.add(source)
    return found
