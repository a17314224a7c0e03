"""The rig shares no code with the model it is meant to test."""

from __future__ import annotations

import ast
from pathlib import Path

ALLOWED = {"hidden_rig", "numba", "numpy", "scipy"}


def test_imports(scripts: Path) -> None:
    files = list((scripts / "hidden_rig").glob("*.py"))
    assert files
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module or ""]
            for name in names:
                assert name.split(".")[0] != "cc_mujoco", file
