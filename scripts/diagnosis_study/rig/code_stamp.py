"""Stamp by which Numba decides whether the compiled code that it keeps is still right.

    stamp_compiled_code(folder_of_the_package)  # before the first is compiled

Numba keeps compiled code with a stamp of its source file. What that file's functions
call lies in other files and is compiled into them, so that here the stamp is a digest
of the file and of all files of its package that it imports, directly or not. Where one
of these imports MuJoCo, whose structures differ from release to release, the release is
part of the digest.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

_IMPORTS_MUJOCO = re.compile(rb"^\s*(?:import|from) mujoco\b", re.MULTILINE)
_packages: set[Path] = set()
"""Folders of the packages whose functions have such a stamp."""


def stamp_compiled_code(package: Path) -> None:
    """Have Numba stamp a package's functions with `digest`; other code as ever.

    Args:
        package: folder; its files import each other absolutely and with `from`.
    """
    _packages.add(package)
    _replace_stamp()


@cache
def _replace_stamp() -> None:
    """Replace Numba's stamp, and how it reads what it kept.

    An index of an earlier version may name a class that has another name or place now.
    Numba reads the index before it compares the stamps; here it counts as outdated.
    """
    from numba.core import caching

    locator: Any = caching._SourceFileBackedLocatorMixin
    usual = locator.get_source_stamp

    def get_source_stamp(self: Any) -> Any:
        file = Path(self._py_file)
        package = next((each for each in _packages if each in file.parents), None)
        ours = package is not None and file.is_file()
        return digest(file, package) if ours else usual(self)

    locator.get_source_stamp = get_source_stamp
    index: Any = caching.IndexDataCacheFile
    usual_index = index._load_index

    def load_index(self: Any) -> Any:
        try:
            return usual_index(self)
        except (AttributeError, ImportError):
            if not isinstance(self._source_stamp, str):  # not of such a package
                raise
            return {}

    index._load_index = load_index


@cache
def digest(file: Path, package: Path) -> str:
    """Return a digest of a source file of a package and of all that it imports."""
    uses_mujoco = False
    found, left = {file}, [file]
    while left:
        new = _imported_files(left.pop(), package) - found
        found |= new
        left += new
    total = hashlib.sha256()
    for path in sorted(found):
        content = path.read_bytes()
        name = path.relative_to(package).as_posix()
        total.update(f"{name}\0{len(content)}\0".encode() + content)
        uses_mujoco = uses_mujoco or _IMPORTS_MUJOCO.search(content) is not None
    if uses_mujoco:
        total.update(version("mujoco").encode())
    return total.hexdigest()


@cache
def _imported_files(file: Path, package: Path) -> set[Path]:
    """Return the files of its package that a source file imports."""
    imports = re.compile(
        rf"^\s*from ({package.name}(?:\.\w+)*) import (\([^)]*\)|.*)$", re.MULTILINE
    )
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".pyi":  # the public names of a package, imported when first used
        here = ".".join((package.name, *file.parent.relative_to(package).parts))
        text = re.sub(r"^from \.(?=\w)", f"from {here}.", text, flags=re.MULTILINE)
    found = set()
    for module, names in imports.findall(text):
        place = package.joinpath(*module.split(".")[1:])
        places = [place]
        if place.is_dir():  # its names may be modules
            places += [place / name for name in re.findall(r"\w+", names)]
        for path in places:
            faces = path / "__init__.py", path / "__init__.pyi"
            for source in (path.with_suffix(".py"), *faces):
                if path != package and source.is_file():
                    found.add(source)
    return found
