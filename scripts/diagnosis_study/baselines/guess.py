"""Answer of a naive method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Guess(NamedTuple):
    """The name that a naive way gives to what is missing."""

    named: str | None  # id of the effect, or None where it finds nothing missing
    ranking: tuple[str, ...]  # ids, the likeliest first; named or not
    # of the squared residual that is explained, by the first of the ranking or, where a
    # model has several effects, by that model
    share: float


def decided(shares: Mapping[str, float], least: float) -> Guess:
    """Return the effect with the largest share, named if that is at least `least`."""
    ranking = tuple(sorted(shares, key=lambda name: -shares[name]))
    if not ranking:
        return Guess(None, (), 0.0)
    first = shares[ranking[0]]
    return Guess(ranking[0] if first >= least else None, ranking, first)
