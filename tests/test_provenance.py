"""Provenance of results: code, files and versions, for every way of loading them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pytest

import cc_mujoco
from cc_mujoco._utils.provenance import (
    code_provenance,
    earlier_results_message,
    provenance_differences,
    read_provenance,
    source_files,
    with_provenance,
)
from cc_mujoco.control import controller
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(cc_mujoco.__file__).parents[1])}
DRIVE = Drive(5.0, -1.0, 1.0, 1e-3)
FILES = {
    "law.py": "from deep import late\n"
    "from pack.helper import GAIN\n"
    "CC_MUJOCO_FILES = ('gains.toml', 'data/../plug.py')\n"
    "def make(drive):\n    return lambda seen: GAIN\n"
    "def other(drive):\n    return lambda seen: 0.0\n",
    "gains.toml": "gain = 1.0\n",
    "pack/__init__.py": "",
    "pack/helper.py": "from . import deeper\nGAIN = deeper.GAIN\n",
    "pack/deeper.py": "import importlib\nGAIN = importlib.import_module('plug').GAIN\n",
    "plug.py": "GAIN = 0.1\n",
    "deep.py": "from pathlib import Path\nclass late:\n    PATH = 'data/rows.csv'\n"
    "CC_MUJOCO_FILES = [Path(late.PATH)]\n",
    "data/rows.csv": "1,2\n",
    "idle.py": "GAIN = 2.0\n",
    "idle.toml": "gain = 2.0\n",
}


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield a folder with a controller that imports from many files."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    before = set(sys.modules)
    yield tmp_path
    _forget(before)


def _forget(before: set[str]) -> None:
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("law", "pack", "plug", "deep"):
            del sys.modules[name]


def test_the_files_of_a_controller_are_imported_or_declared(project: Path) -> None:
    controller("law:make", DRIVE)
    files = code_provenance("law:make")["files"]
    assert set(files) == {name for name in FILES if "idle" not in name}


def test_a_second_controller_of_a_module_stands_on_the_same_files(
    project: Path,
) -> None:
    controller("law:make", DRIVE)
    controller("law:other", DRIVE)
    assert set(code_provenance("law:other")["files"]) >= {
        "law.py",
        "gains.toml",
        "plug.py",
    }


def test_modules_that_were_imported_before_count_too(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(project))
    __import__("law")
    controller("law:make", DRIVE)
    assert set(code_provenance("law:make")["files"]) >= {
        "law.py", "deep.py", "pack/helper.py", "pack/deeper.py", "data/rows.csv",
    }  # fmt: skip


NEXT = f"""
import json
from math import inf
from cc_mujoco.device._drive import Drive
from cc_mujoco.control import controller
from cc_mujoco._utils.provenance import code_provenance
controller("law:make", {DRIVE!r})
print(json.dumps(code_provenance("law:make")))
"""


def test_changed_files_are_named_by_the_next_process(project: Path) -> None:
    controller("law:make", DRIVE)
    then = code_provenance("law:make")
    assert provenance_differences(then, then) == []
    changed = sorted(name for name in FILES if FILES[name])[::2]
    for name in changed:
        (project / name).write_text(FILES[name] + "\n")
    done = subprocess.run(
        [sys.executable, "-c", NEXT], capture_output=True, check=True, env=ENVIRONMENT
    )
    told = provenance_differences(then, json.loads(done.stdout))
    # By a whole path: files of another test, read in this process by the same name.
    here = sorted(name for name in told if not os.path.isabs(name))
    assert here == [name for name in changed if "idle" not in name] != changed


def test_what_a_process_imported_stays_what_it_was(project: Path) -> None:
    controller("law:make", DRIVE)
    then = code_provenance("law:make")
    (project / "law.py").write_text("broken")
    controller("law:make", DRIVE)
    assert provenance_differences(then, code_provenance("law:make")) == []


@pytest.mark.parametrize(
    ("declared", "why"),
    [
        ("('gain.toml',)", r"names .*gain\.toml, which cannot be read"),
        ("'gains.toml'", "must be a tuple of paths"),
        ("(1.0,)", "must be a tuple of paths"),
    ],
)
def test_a_declaration_that_names_no_file_is_refused(
    project: Path, declared: str, why: str
) -> None:
    (project / "plug.py").write_text(f"GAIN = 1.0\nCC_MUJOCO_FILES = {declared}\n")
    controller("law:make", DRIVE)
    with pytest.raises(CableError, match=rf"plug\.py: CC_MUJOCO_FILES .*{why}"):
        code_provenance("law:make")


def test_a_recorded_trajectory_counts(project: Path) -> None:
    Path("walk.csv").write_text("0,1\n")
    then = code_provenance("pi", "walk.csv")
    assert set(then["files"]) == {"walk.csv"}
    Path("walk.csv").write_text("0,2\n")
    assert provenance_differences(then, code_provenance("pi", "walk.csv")) == [
        "walk.csv"
    ]


def test_sources_are_all_that_numbers_follow_from_and_no_results() -> None:
    names = set(source_files())
    assert names >= {
        "cc_mujoco/plugin/native_plugin.c",
        "cc_mujoco/native/native.h",
        "cc_mujoco/cable/parameters.csv",
        "cc_mujoco/assets/wrist_handle.xml",
    }
    assert not [name for name in names if name.startswith("cc_mujoco/benchmark/v")]


def test_other_sources_and_versions_are_named() -> None:
    now = code_provenance("pi")
    assert now["files"] == {}
    assert {"mujoco", "numpy", "scipy"} <= set(now["versions"])
    then = {**now, "sources": "", "versions": {**now["versions"], "scipy": "0.1"}}
    scipy = now["versions"]["scipy"]
    assert provenance_differences(then, now) == [
        "the sources of cc_mujoco",
        f"scipy (0.1, now {scipy})",
    ]
    for older in (None, {}, {"code": "abc"}, "text"):
        assert provenance_differences(older, now) == ["an earlier version of cc_mujoco"]


def test_a_table_carries_what_made_it() -> None:
    table = pa.table({"a": [1.0]})
    assert read_provenance(table) is None
    assert read_provenance(
        with_provenance(table, code_provenance("pi"))
    ) == code_provenance("pi")
    assert (
        read_provenance(table.replace_schema_metadata({b"cc_mujoco": b"torn{"})) is None
    )


def test_what_is_kept_is_told_in_sentences() -> None:
    assert earlier_results_message(0, 3, "cells") == ""
    assert (
        earlier_results_message(2, 3, "cells")
        == "2 of 3 cells kept; --again runs them anew."
    )
    assert earlier_results_message(2, 3, "cells", ["law.py", "law.py"]).endswith(
        "Earlier cells are replaced: they differ in law.py."
    )
