"""Tables in Markdown keep their cells, whatever these hold."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.report import table

TEXT = st.text("ab|` 1", max_size=8).map(str.strip)


def test_a_table_is_a_head_a_rule_and_rows() -> None:
    text = table(("force", "N"), [("a", "1"), ("b|c", "")], numbers=[1])
    assert text.splitlines() == [
        "| force | N |",
        "|---|---:|",
        "| a | 1 |",
        "| b\\|c | |",
    ]


@given(st.lists(st.tuples(TEXT, TEXT, TEXT)))
def test_cells_can_be_read_back(rows: list[tuple[str, str, str]]) -> None:
    lines = table(("x", "y", "z"), rows).splitlines()[2:]
    found = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    assert [[c.strip().replace("\\|", "|") for c in row] for row in found] == [
        [*row] for row in rows
    ]
