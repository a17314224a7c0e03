"""Compiled code is kept exactly as long as the sources that it was made of."""

from __future__ import annotations

import inspect
import pickle
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

import cc_mujoco.control
import cc_mujoco.plugin
from cc_mujoco._utils import code_stamp

PACKAGE = Path(cc_mujoco.control.__file__).parents[1]
SOURCES = {
    "face/__init__.py": "",
    "face/__init__.pyi": "from ._inner.part import third as third\n",
    "face/_inner/part.py": "third = 1.0 / 3.0\n",
    "law.py": "from cc_mujoco.face import third\n"
    "from cc_mujoco.room import (\n    gain,\n    other,\n)\n",
    "room/__init__.py": "",
    "room/gain.py": "def late():\n    from cc_mujoco.deep import half\n",
    "room/other.py": "from cc_mujoco.law import turn\n",
    "deep.py": "half = 0.5\n",
    "idle.py": "from cc_mujoco.law import turn\n",
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    root = tmp_path / "cc_mujoco"
    for name, text in SOURCES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def stamp(file: Path) -> str:
    code_stamp.digest.cache_clear()
    code_stamp._imported_files.cache_clear()
    try:
        return code_stamp.digest(file, file.parent)
    finally:
        code_stamp.digest.cache_clear()
        code_stamp._imported_files.cache_clear()


@pytest.mark.parametrize("name", SOURCES)
def test_a_stamp_changes_with_what_is_imported_and_with_nothing_else(
    package: Path, name: str
) -> None:
    before = stamp(package / "law.py")
    (package / name).write_text(SOURCES[name] + "more = 1\n")
    assert (stamp(package / "law.py") == before) == (name == "idle.py")
    (package / name).write_text(SOURCES[name])
    assert stamp(package / "law.py") == before


@pytest.mark.parametrize("text", ["import mujoco\n", "from mujoco import MjData\n"])
def test_a_stamp_changes_with_the_release_of_mujoco_that_is_imported(
    package: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (package / "deep.py").write_text(text)
    law, face = package / "law.py", package / "face" / "_inner" / "part.py"
    stamps = []
    for release in ("3.17.0", "4.0.0"):
        monkeypatch.setattr(code_stamp, "version", {"mujoco": release}.get)
        stamps.append((stamp(law), stamp(face)))
    assert stamps[0][0] != stamps[1][0]
    assert stamps[0][1] == stamps[1][1]


def compiled_functions() -> dict[str, Any]:
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("cc_mujoco."):
            for key, value in vars(module).items():
                if isinstance(value, Dispatcher):
                    found[f"{name}.{key}"] = value
    return found


def test_every_compiled_function_that_another_calls_is_in_its_stamp() -> None:
    functions = compiled_functions()
    assert len(functions) > 100
    for name, function in functions.items():
        file = Path(inspect.getfile(function.py_func))
        callees = [
            value
            for value in inspect.getclosurevars(function.py_func).globals.values()
            if isinstance(value, Dispatcher)
        ]
        known, left = {file}, [file]
        while left:
            new = code_stamp._imported_files(left.pop(), PACKAGE) - known
            known |= new
            left += new
        for callee in callees:
            assert Path(inspect.getfile(callee.py_func)) in known, name


def test_numba_uses_the_stamp_here_and_its_own_elsewhere(tmp_path: Path) -> None:
    from cc_mujoco.control import _guard as guard

    ours: Any = FunctionCache(guard.release_state.py_func)  # type: ignore[attr-defined]
    stamped = code_stamp.digest(Path(guard.__file__), PACKAGE)
    assert ours._impl.locator.get_source_stamp() == stamped
    other: Any = FunctionCache(stamp)
    assert other._impl.locator.get_source_stamp() != stamped


@pytest.mark.parametrize("place", ["cc_mujoco.control._guard", "cc_mujoco.gone"])
def test_an_index_that_names_what_is_no_more_is_outdated(
    tmp_path: Path, place: str
) -> None:
    lost = f"c{place}\nGone\n.".encode()  # a pickle of a name
    index: Any = IndexDataCacheFile(str(tmp_path), "turn", "a digest")
    Path(index._index_path).write_bytes(pickle.dumps(index._version) + lost)
    assert index._load_index() == {}
    other: Any = IndexDataCacheFile(str(tmp_path), "turn", (0.0, 1))
    with pytest.raises((AttributeError, ImportError)):
        other._load_index()
