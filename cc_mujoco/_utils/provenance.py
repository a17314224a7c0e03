"""Provenance of a run's numbers besides its settings: the code that computed them.

    then = code_provenance("law:make")  # plain JSON, stored with the numbers
    provenance_differences(then, code_provenance("law:make"))  # ["law.py"] if edited

It comprises the library's sources and scenes, the versions of its dependencies, and the
user's files: the scene and description of a device, the module of a controller, metric,
trajectory or task, the modules that it imports from outside the standard library and
the installed packages, a policy's file, a table of a motion or a torque, and the files
that such a module declares:

    CC_MUJOCO_FILES = ("gains.toml",)  # in law.py; relative to its folder

Not found are files that a module reads but does not declare, and modules imported under
a computed name (`importlib.import_module`), unless declared.
"""

import ast
import contextlib
import hashlib
import importlib
import importlib.util
import json
import os
import platform
import shlex
import site
import sys
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from cc_mujoco._utils.atomic_io import (
    MANIFEST,
    METADATA_KEY,
    checksum_line,
    replacing,
)
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._utils.tables import is_table, split_selection
from cc_mujoco.assets import policy_file
from cc_mujoco.errors import CableError

POLICY_ENDING = ".safetensors"  # ending of a policy's file
RECORD = "made by: "  # begins the line of a manifest on the run that wrote it
DECLARED = "CC_MUJOCO_FILES"  # in a user's module: paths of the files that it reads


def versions() -> dict[str, str]:
    packages = ("cc_mujoco", "mujoco", "gymnasium", "numpy", "scipy")
    return {name: importlib.import_module(name).__version__ for name in packages}


def source_files() -> dict[str, Path]:
    """Return the library's files that determine its numbers, by relative path."""
    found: dict[str, Path] = {}
    for package in ("cc_mujoco", "cc_mujoco.envs", "cc_mujoco.assets"):
        root = Path(str(importlib.import_module(package).__file__)).parent
        for path in root.rglob("*"):
            place = Path(*package.split("."), path.relative_to(root))
            result = path.suffix == ".csv" and "benchmark" in place.parts
            kinds = ".py", ".c", ".h", ".xml", ".csv", ".toml"
            if path.suffix in kinds and not result:
                found[place.as_posix()] = path
    return found


@cache
def sources() -> str:
    digest = hashlib.sha256()
    for name, path in sorted(source_files().items()):
        content = path.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:24]


def code_provenance(
    *names: str, files: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return the provenance of numbers from this process, as plain JSON.

    `names` are `MODULE:NAME` of controllers, metrics, trajectories and tasks that were
    made before, and paths of policies and tables; `files` are digests of further files,
    see `file_digests`.
    """
    files = dict(files or {})
    for name in names:
        if is_table(name):
            files[name] = _digest(os.path.abspath(split_selection(name)[0]))
        elif is_user_controller(name):
            files |= _user_file_digests(name)
    return {"versions": versions(), "sources": sources(), "files": files}


def file_digests(files: Iterable[Path], folder: Path) -> dict[str, str]:
    return {
        Path(os.path.relpath(path, folder)).as_posix(): _digest(str(path))
        for path in files
    }


def provenance_differences(then: Any, now: Mapping[str, Any]) -> list[str]:
    """Return the names of what differs between two results of `code_provenance`.

    `then` is read from a file, so it may be anything.
    """
    if then == now:
        return []
    if not (isinstance(then, Mapping) and set(then) == set(now)):
        return ["an earlier version of cc_mujoco"]
    found = [] if then["sources"] == now["sources"] else ["the sources of cc_mujoco"]
    for kind in ("versions", "files"):
        for name in {**then[kind], **now[kind]}:
            one, other = then[kind].get(name), now[kind].get(name)
            if one != other:
                versions_text = f" ({one}, now {other})" if kind == "versions" else ""
                found.append(name + versions_text)
    return found


def command_line() -> str:
    """Return the command of this process; one of the package by its short name."""
    program = Path(sys.argv[0])
    own = program.stem in ("cc-mujoco", "__main__")
    return shlex.join(["cc-mujoco" if own else program.name, *sys.argv[1:]])


def write_manifest(folder: Path, names: Iterable[str]) -> None:
    """Write how a folder's files `names` are made, and their checksums (`MANIFEST`)."""
    made = {"command": command_line(), "python": platform.python_version()}
    lines = [RECORD + json.dumps({**made, "versions": versions()})]
    there = [folder / name for name in names if (folder / name).is_file()]
    lines += map(checksum_line, there)
    with replacing(folder / MANIFEST) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")


def with_provenance(table: Any, about: Mapping[str, Any]) -> Any:
    return table.replace_schema_metadata({METADATA_KEY: json.dumps(about).encode()})


def read_provenance(table: Any) -> Any:
    with contextlib.suppress(ValueError):
        return parse_json((table.schema.metadata or {}).get(METADATA_KEY, b"null"))
    return None


def earlier_results_message(
    kept: int, number: int, kind: str, changed: Sequence[str] = ()
) -> str:
    """Return a message on results of an earlier run; "" if there are none.

    Of `number` results, called `kind`, `kept` are reused; others differ in `changed`.
    """
    parts = [f"{kept} of {number} {kind} kept; --again runs them anew."] if kept else []
    if changed:
        differing = ", ".join(dict.fromkeys(changed))
        parts.append(f"Earlier {kind} are replaced: they differ in {differing}.")
    return " ".join(parts)


def is_user_controller(controller: str) -> bool:
    """Return whether a controller's name stands for a user's code or policy file."""
    return ":" in controller or controller.endswith(POLICY_ENDING)


@cache
def _library_folders() -> tuple[str, ...]:
    """Return the folders of Python and installed packages, not of users' files."""
    places = [sysconfig.get_path(n) for n in ("stdlib", "platstdlib", "purelib",
              "platlib")]  # fmt: skip
    places += [*site.getsitepackages(), site.getusersitepackages()]
    for package in ("cc_mujoco", "cc_mujoco.envs", "cc_mujoco.assets"):
        spec = importlib.util.find_spec(package)
        places.append(str(Path(str(spec and spec.origin)).parent))
    places += ["/proc", "/sys", "/dev", "/etc"]
    return tuple(os.path.join(place, "") for place in places)


def _user_file_digests(controller: str) -> dict[str, str]:
    if controller.endswith(POLICY_ENDING):
        first = os.path.abspath(policy_file(controller))
        base = os.path.dirname(first)
    else:
        name = controller.partition(":")[0]
        first = _source_path(sys.modules.get(name)) or ""
        base = os.getcwd()
        if first:  # the folder that holds the outermost package of the module
            levels = name.count(".") + int(first.endswith("__init__.py"))
            base = str([*Path(first).parents, Path.cwd()][levels])
    found = [first] if first else []
    for path in found:  # which grows
        if path.endswith(".py"):
            more = {*_imported(path), *_declared(path)}
            found += sorted(more.difference(found))
    named = {}
    for path in found:
        near = next((b for b in (base, os.getcwd()) if _is_inside(path, b)), None)
        name = os.path.relpath(path, near) if near else path
        named[name.replace(os.sep, "/")] = _digest(path)
    return named


def _module(path: str) -> ModuleType | None:
    return next(
        (m for m in list(sys.modules.values()) if _source_path(m) == path), None
    )


def _declared(path: str) -> list[str]:
    files = getattr(_module(path), DECLARED, ())
    if isinstance(files, str | os.PathLike) or not all(
        isinstance(each, str | os.PathLike) for each in files
    ):
        raise CableError(
            f"{path}: {DECLARED} is {files!r}; it must be a tuple of paths."
        )
    found = [os.path.join(os.path.dirname(path), each) for each in files]
    for place in found:
        if not os.access(place, os.R_OK):
            raise CableError(f"{path}: {DECLARED} names {place}, which cannot be read.")
    return [os.path.normpath(place) for place in found]


def _imported(path: str) -> set[str]:
    """Return the loaded modules of the user that a user's source file imports."""
    module = _module(path)
    try:
        tree = ast.parse(_source_code(path) or b"")
    except (SyntaxError, ValueError):
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = "." * node.level + (node.module or "")
            with contextlib.suppress(ImportError, ValueError):
                start = importlib.util.resolve_name(
                    start, getattr(module, "__package__", None)
                )
                names |= {start, *(f"{start}.{alias.name}" for alias in node.names)}
    # A package runs before what lies in it.
    names |= {n[:i] for n in names for i, c in enumerate(n) if c == "."}
    found = {_source_path(sys.modules.get(name)) or "" for name in names}
    return {
        source
        for source in found
        if os.path.isabs(source) and not source.startswith(_library_folders())
    }


def _source_path(module: ModuleType | None) -> str | None:
    path = getattr(module, "__file__", None)
    return path if isinstance(path, str) and path.endswith(".py") else None


def _is_inside(path: str, folder: str) -> bool:
    """Return whether a file is below a folder, not below a hidden one in it."""
    inner = path.removeprefix(os.path.join(folder, ""))
    return inner != path and f"{os.sep}." not in os.sep + inner


def _content(path: str) -> bytes | None:
    try:
        return Path(path).read_bytes()
    except OSError:
        return None


_source_code = cache(_content)
"""Content of a module as first read: a process goes on with what it imported."""


def _digest(path: str) -> str:
    """Return a file's SHA-256; "" if it cannot be read."""
    content = _source_code(path) if path.endswith(".py") else _content(path)
    return "" if content is None else hashlib.sha256(content).hexdigest()[:24]
