"""The rig shares no code but the compiler with the model it is meant to test."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ALLOWED = {"rig", "numpy", "scipy", *sys.stdlib_module_names}
COMPILER = "cc_mujoco.native"


def imported(file: Path) -> set[str]:
    """Return the modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


def test_only_general_libraries_and_the_compiler_are_imported(scripts: Path) -> None:
    files = sorted((scripts / "rig").rglob("*.py"))
    assert len(files) > 5
    for file in files:
        others = imported(file) - {COMPILER}
        assert {name.split(".")[0] for name in others} <= ALLOWED, file
