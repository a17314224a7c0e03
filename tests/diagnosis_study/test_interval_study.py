"""Coverage of intervals on rigs with known constants."""

from __future__ import annotations

import pytest
from interval_study import covered, off


def test_a_value_is_as_far_off_as_its_interval_reaches_that_way() -> None:
    assert off(2.0, 1.0, 6.0, 1.0) == pytest.approx(1.0)
    assert off(2.0, 1.0, 6.0, 6.0) == pytest.approx(-1.0)
    assert off(2.0, 1.0, 6.0, 2.0) == 0.0


def test_intervals_that_cover_are_counted_by_make_and_in_all() -> None:
    records = [
        {"make": make, "intervals": {"friction": [0.1, 0.09, 0.11, truth]}}
        for make, truth in (("guides", 0.105), ("guides", 0.12), ("elements", 0.095))
    ]
    lines = covered(records).splitlines()
    assert [line.split(" (")[0] for line in lines] == [
        "elements, friction: 1 of 1",
        "guides, friction: 1 of 2",
        "elements and guides, friction: 2 of 3",
    ]
    assert "(9 to 99 %)" in lines[-1]
