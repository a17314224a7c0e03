"""Parameters of which the default run takes only some."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def study_unless(daily: Callable[[Any], bool], values: Iterable[Any]) -> list[Any]:
    """Return the parameters of a test, those of the study alone marked as such.

    Args:
        daily: Whether the default run takes a parameter.
        values: Parameters; a tuple stands for several arguments.
    """
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=[] if daily(value) else pytest.mark.study,
        )
        for value in values
    ]


def study_but(every: int, values: Iterable[Any]) -> list[Any]:
    """Return the parameters of a test, of which a default run takes few."""
    values = list(values)
    kept = values[::every]
    return study_unless(lambda value: any(value is each for each in kept), values)
