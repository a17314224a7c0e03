"""Docstrings begin with a verb or a noun, and the names in them exist."""

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
QUOTED = re.compile(rf"""^\s*[rR]?["']+\s*{REFUSED.pattern}""", re.M)
"""Beginning of a string, on a line of its own, that may be a docstring to refuse."""


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
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if QUOTED.search(source):
            found += [
                f"{path.relative_to(ROOT)}:{line}: {text}"
                for line, text in _docstrings(ast.parse(source))
                if REFUSED.match(text)
            ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("quotes", ['"""', 'r"""', '"', "'''\n    "])
def test_a_relative_word_is_found_however_it_is_quoted(quotes: str) -> None:
    source = f"def f():\n    {quotes}Whether it is.{quotes.lstrip('r').strip()}\n"
    assert QUOTED.search(source)
    assert REFUSED.match(_docstrings(ast.parse(source))[0][1])


DOTTED = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)+)(?:\(\))?`")
FILE = re.compile(
    r"\.(py|pyi|csv|md|toml|xml|json|html|c|h|so|txt|parquet|safetensors)$"
)
FOREIGN = {
    "Batch", "config", "data", "dataclasses", "function", "gymnasium", "importlib",
    "info", "m", "model", "math", "mujoco", "mujoco_warp", "np", "scipy", "self",
    "servo", "spec", "torch", "unwrapped", "warnings", "warp", "wp",
}  # fmt: skip
"""Beginnings of names of other software, and of variables of the reader."""


class Names:
    """Names of the package by module and class, read from the sources."""

    def __init__(self) -> None:
        self.members: dict[str, set[str]] = {}
        self.bases: dict[str, set[str]] = {}
        for folder in ("cc_mujoco", "envs", "assets"):
            for path in sorted((ROOT / folder).rglob("*.py*")):
                if path.suffix in (".py", ".pyi"):
                    self._read(path)

    def _read(self, path: Path) -> None:
        stem = path.parent.name if path.stem == "__init__" else path.stem
        owned = self.members.setdefault(stem.lstrip("_"), set())
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                own = self.members.setdefault(node.name, set())
                own |= {name for each in node.body for name in _defined(each)}
                own |= {
                    found.attr
                    for found in ast.walk(node)
                    if isinstance(found, ast.Attribute)
                    and isinstance(found.ctx, ast.Store)
                }
                bases = {ast.unparse(base).partition("[")[0] for base in node.bases}
                self.bases.setdefault(node.name, set()).update(bases)
        owned |= {name for each in tree.body for name in _defined(each)}
        owned |= {a.asname or a.name for a in _imported(tree)}
        if path.stem == "__init__":
            owned |= {each.stem.lstrip("_") for each in path.parent.iterdir()}

    def has(self, name: str) -> bool:
        """Return whether every part of a dotted name belongs to the one before."""
        parts = [part.lstrip("_") for part in name.split(".")]
        last = next((i for i, p in enumerate(parts) if p in self.members), None)
        if last is None:
            return False
        for owner, part in zip(parts[last:], parts[last + 1 :], strict=False):
            if owner in self.members and not self._is_member(owner, part):
                return False
        return True

    def _is_member(self, owner: str, name: str) -> bool:
        own = {each.lstrip("_") for each in self.members[owner]}
        return name in own or any(
            base not in self.members or self._is_member(base, name)
            for base in self.bases.get(owner, ())
            if base != owner
        )


def _defined(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else []
    targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
    return {
        found.id
        for target in targets
        for found in ast.walk(target)
        if isinstance(found, ast.Name)
    }


def _imported(tree: ast.Module) -> list[ast.alias]:
    return [a for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names]


def test_every_dotted_name_in_backticks_exists() -> None:
    names, found = Names(), []
    for folder in ("cc_mujoco", "envs"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for line, text in enumerate(path.read_text("utf-8").splitlines(), 1):
                for match in DOTTED.finditer(text):
                    name = match[1].removeprefix("cc_mujoco.").removeprefix("envs.")
                    first = name.partition(".")[0]
                    if (
                        first == name
                        or first in FOREIGN
                        or first.isupper()
                        or FILE.search(name)
                    ):
                        continue
                    if not (first.lower().startswith("mj") or names.has(name)):
                        found.append(f"{path.relative_to(ROOT)}:{line}: {name}")
    assert not found, "\n".join(found)
    assert names.has("device._sensors.Measuring.measure")
    assert not names.has("device._sensors.Measuring.feel")
