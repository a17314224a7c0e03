"""Figures of a study show nothing where no design has been."""

from __future__ import annotations

import numpy as np

from cc_mujoco.design._report import outside_hull


def test_a_map_is_blank_beyond_the_designs() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(size=(200, 2))
    places = places[places.sum(axis=1) < 1.0]
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21))
    beyond = outside_hull(places, np.stack([x.ravel(), y.ravel()], axis=-1))
    total = (x + y).ravel()
    assert beyond[total > 1.15].all()
    inside = (total < 0.85) & (np.minimum(x, y).ravel() > 0.1)
    assert not beyond[inside].any()


def test_designs_on_a_line_bound_nothing() -> None:
    places = np.stack([np.linspace(0.0, 1.0, 5)] * 2, axis=-1)
    assert not outside_hull(places, np.array([[0.0, 1.0], [0.5, 0.5]])).any()
