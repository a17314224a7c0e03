"""Docstrings begin with a verb in the imperative or with what a thing is."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("cc_mujoco", "envs", "assets", "scripts", "tests")
REFUSED = re.compile(
    r"(What|Whether|How|Which|Where|Of|Likewise|The same|By how)\b(?!-)"
)


def _docstrings(tree: ast.Module) -> list[tuple[int, str]]:
    """Return the line and the first line of every docstring, fields included."""
    return [
        (node.lineno, node.value.value.strip().split("\n")[0])
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_docstring_begins_with_a_relative_word(folder: str) -> None:
    found, count = [], 0
    for path in sorted((ROOT / folder).rglob("*.py")):
        for line, text in _docstrings(ast.parse(path.read_text(encoding="utf-8"))):
            count += 1
            if REFUSED.match(text):
                found.append(f"{path.relative_to(ROOT)}:{line}: {text}")
    assert count > 0
    assert not found, "\n".join(found)
