"""Tables of functions that C is given have their order in Python."""

from __future__ import annotations

import re
from pathlib import Path

import cc_mujoco
from cc_mujoco.native._entries import MOST_PARTS
from cc_mujoco.plugin._ffi import ENGINE
from cc_mujoco.plugin._registration import ENGINE_NAMES

PACKAGE = Path(cc_mujoco.__file__).parent
CALLS = (PACKAGE / "native/python_calls.h").read_text()


def functions(structure: str) -> list[str]:
    """Return the names of the pointers to functions in a structure of C."""
    return re.findall(r"\(\*(\w+)\)\(", structure)


def test_functions_of_mujoco() -> None:
    text = (PACKAGE / "plugin/native_plugin.h").read_text()
    (table,) = re.findall(r"typedef struct \{(.*?)\n\} Engine;", text, re.DOTALL)
    ours = [function.name for function in ENGINE]
    assert functions(table) == ours
    others = ["mj_version", "mjp_registerPlugin", "mju_warning"]
    assert list(ENGINE_NAMES) == [*ours, *others]


def test_room_for_the_parts_of_a_call() -> None:
    assert f"CC_MOST_PARTS = {MOST_PARTS} " in CALLS
