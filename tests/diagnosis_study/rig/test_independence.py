"""The rig shares no code with the model it is meant to test."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ALLOWED = {"rig", "numba", "numpy", "scipy", *sys.stdlib_module_names}


def imported(file: Path) -> set[str]:
    """Top-level names of everything that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return {name.split(".")[0] for name in names}


def test_only_general_libraries_are_imported(scripts: Path) -> None:
    files = sorted((scripts / "rig").rglob("*.py"))
    assert len(files) > 5
    for file in files:
        assert imported(file) <= ALLOWED, file
