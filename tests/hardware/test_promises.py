"""Guarantees of the page: every sentence names existing tests."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "cc_mujoco" / "hardware" / "README.md").read_text("utf-8")
SECTION = PAGE.partition("\n## What is guaranteed\n")[2].partition("\n## ")[0]
FILES = {
    letter: (ROOT / "tests" / "hardware" / name).read_text("utf-8")
    for name, letter in re.findall(r"\[`(test_\w+\.py)`\]\([^)]*\)\s+\((\w)\)", SECTION)
}
PROMISES = [
    tuple(line.strip("| ").rsplit(" | ", 1))
    for line in SECTION.partition("| promise | test |\n|---|---|\n")[2]
    .partition("\n\n")[0]
    .splitlines()
]


def test_the_table_and_its_letters_are_read() -> None:
    assert set(FILES) == set("LUCPBSTA")
    assert len(PROMISES) >= 10


@pytest.mark.parametrize(("promise", "tests"), PROMISES)
def test_a_promise_names_tests_that_are_there(promise: str, tests: str) -> None:
    named = 0
    for part in tests.split("; "):
        letter, _, names = part.partition(" ")
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"^def \w*{name}\w*\(", FILES[letter], re.M), name
            named += 1
    assert named
