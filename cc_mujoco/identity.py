"""Origin of the numbers of a run besides its settings: the code that made them.

    then = made_by("law:make")  # plain JSON, kept beside the numbers
    differences(then, made_by("law:make"))  # ["law.py"] once it is edited

It is the library's own sources and scenes, the versions of what it computes with, and
the user's files: the module of a controller, whatever it imports from outside the
standard library and the installed packages, a policy's file, and files that lie below
the working directory or beside such a module and were opened while the controller was
made. What compiled code opens, or a controller reads only later, is not seen.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import importlib
import importlib.util
import json
import os
import site
import sys
import sysconfig
import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

from cc_mujoco.files import KEY

POLICY = ".safetensors"
"""Ending of a policy's file."""

VERSIONED = ("cc_mujoco", "mujoco", "gymnasium", "numpy", "numba", "scipy")
"""Packages that decide the numbers."""

_opened: dict[str, set[str]] = {}
"""Files that code opened, by the path of its source or the name of a controller."""
_digests: dict[str, str] = {}
"""Digests of files as they were when they were last read."""
_loading = threading.local()


def versions() -> dict[str, str]:
    """Versions of the packages that decide the numbers."""
    return {n: importlib.import_module(n).__version__ for n in VERSIONED}


@cache
def sources() -> str:
    """Digest of the library's sources, scenes and tables, installed or not."""
    found: dict[str, bytes] = {}
    for package in ("cc_mujoco", "cc_mujoco.envs", "cc_mujoco.assets"):
        root = Path(str(importlib.import_module(package).__file__)).parent
        for path in root.rglob("*"):
            if path.suffix in (".py", ".xml", ".csv"):
                place = Path(*package.split("."), path.relative_to(root))
                found[place.as_posix()] = path.read_bytes()
    digest = hashlib.sha256()
    for name, content in sorted(found.items()):
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:24]


def made_by(*controllers: str, trajectory: str = "") -> dict[str, Any]:
    """Return what makes numbers in this process, as plain JSON.

    Args:
        controllers: names of those that were made before, in `watched`.
        trajectory: name, or path of a CSV file.
    """
    files = {}
    if trajectory.lower().endswith(".csv"):
        place = os.path.abspath(trajectory)
        _digests.pop(place, None)
        files[trajectory] = _digest(place)
    for controller in filter(is_outside, controllers):
        files |= _files(controller)
    return {"versions": versions(), "sources": sources(), "files": files}


def differences(then: Any, now: Mapping[str, Any]) -> list[str]:
    """Return how two results of `made_by` differ, for a reader; empty if they do not.

    Args:
        then: one that was kept; may be anything that was found in its place.
        now: the other.
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
                told = f" ({one}, now {other})" if kind == "versions" else ""
                found.append(name + told)
    return found


def sealed(table: Any, about: Mapping[str, Any]) -> Any:
    """Return a table of pyarrow with what made it in its metadata."""
    return table.replace_schema_metadata({KEY: json.dumps(about).encode()})


def seal(table: Any) -> Any:
    """Return what `sealed` put into a table; None if nothing is there."""
    with contextlib.suppress(ValueError):
        return json.loads((table.schema.metadata or {}).get(KEY, b"null"))
    return None


def told(kept: int, number: int, kind: str, changed: Sequence[str] = ()) -> str:
    """Return a run's message on earlier results; empty if there are none.

    Args:
        kept: how many are there already.
        number: of all.
        kind: of what, a plural.
        changed: how others differ, that are there and are replaced.
    """
    parts = [f"{kept} of {number} {kind} kept; --again runs them anew."] if kept else []
    if changed:
        differing = ", ".join(dict.fromkeys(changed))
        parts.append(f"Earlier {kind} are replaced: they differ in {differing}.")
    return " ".join(parts)


def is_outside(controller: str) -> bool:
    """Return whether a controller of this name comes from a file of the user."""
    return ":" in controller or controller.endswith(POLICY)


@contextlib.contextmanager
def watched(controller: str) -> Iterator[None]:
    """Note what is opened while a controller from outside is made."""
    _listen()
    before = getattr(_loading, "controller", None)
    _loading.controller = controller
    try:
        yield
    finally:
        _loading.controller = before


@cache
def _listen() -> None:
    """Watch which files are opened; the hook stays for the life of the process."""
    _foreign()  # which opens files itself
    sys.addaudithook(_hear)


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    controller = getattr(_loading, "controller", None)
    if controller is None or event != "open" or not isinstance(arguments[0], str):
        return
    path, mode, flags = arguments
    writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT
    if set(mode) & set("wax+") if mode else flags & writes:
        return
    path = os.path.abspath(path)
    if os.path.basename(os.path.dirname(path)) == "__pycache__":
        try:
            path = importlib.util.source_from_cache(path)
        except ValueError:
            return
    if not _own(path):
        return
    if not path.endswith(".py"):
        # Read anew each time, where a module stays as it was imported first.
        _digests.pop(path, None)
    _opened.setdefault(controller, set()).add(path)
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        owner = frame.f_code.co_filename
        if _own(owner):
            _opened.setdefault(owner, set()).add(path)
        frame = frame.f_back


@cache
def _own(path: str) -> bool:
    """Return whether a path is a user's file: not of Python, nor of a package."""
    return os.path.isabs(path) and not path.startswith(_foreign())


@cache
def _foreign() -> tuple[str, ...]:
    places = [sysconfig.get_path(n) for n in ("stdlib", "platstdlib", "purelib",
              "platlib")]  # fmt: skip
    places += [*site.getsitepackages(), site.getusersitepackages()]
    for package in ("cc_mujoco", "cc_mujoco.envs", "cc_mujoco.assets"):
        spec = importlib.util.find_spec(package)
        places.append(str(Path(str(spec and spec.origin)).parent))
    places += ["/proc", "/sys", "/dev", "/etc"]
    return tuple(os.path.join(place, "") for place in places)


def _files(controller: str) -> dict[str, str]:
    """Digests of the user's files behind a controller, by names that can be moved."""
    if controller.endswith(POLICY):
        first = os.path.abspath(controller)
        base = os.path.dirname(first)
    else:
        name = controller.partition(":")[0]
        first = _source(sys.modules.get(name)) or ""
        up = name.count(".") + first.endswith("__init__.py")
        base = str([*Path(first).parents, Path.cwd()][up]) if first else os.getcwd()
    left, found = [controller, first], {first} - {""}
    while left:
        here = left.pop()
        more = _opened.get(here, set()) | (
            _imported(here) if here.endswith(".py") else set()
        )
        for path in more - found:
            if path.endswith(".py") or _below(path, base) or _below(path, os.getcwd()):
                found.add(path)
                left.append(path)
    named = {}
    for path in sorted(found):
        near = next((b for b in (base, os.getcwd()) if _below(path, b)), None)
        name = os.path.relpath(path, near) if near else path
        named[name.replace(os.sep, "/")] = _digest(path)
    return named


def _imported(path: str) -> set[str]:
    """Return the user's modules that a source of theirs imports, if they are loaded."""
    module = next((m for m in list(sys.modules.values()) if _source(m) == path), None)
    try:
        tree = ast.parse(Path(path).read_bytes())
    except (OSError, SyntaxError, ValueError):
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
    found = {_source(sys.modules.get(name)) for name in names}
    return {source for source in found if source and _own(source)}


def _source(module: ModuleType | None) -> str | None:
    """Path of the source of a module, if it has one."""
    path = getattr(module, "__file__", None)
    return path if isinstance(path, str) and path.endswith(".py") else None


def _below(path: str, folder: str) -> bool:
    """Return whether a file lies in a folder, in none that is hidden inside."""
    inner = path.removeprefix(os.path.join(folder, ""))
    return inner != path and f"{os.sep}." not in os.sep + inner


def _digest(path: str) -> str:
    """Return a file's digest, as it was when last read; empty if it cannot be read."""
    if path not in _digests:
        try:
            content = Path(path).read_bytes()
        except OSError:
            return ""
        _digests[path] = hashlib.sha256(content).hexdigest()[:24]
    return _digests[path]
