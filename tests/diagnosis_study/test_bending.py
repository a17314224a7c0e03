"""The bench whose conduits bend, and the sensors along them."""

from __future__ import annotations

import numpy as np
import pytest
import self_tuning
from self_tuning import (
    PLACES,
    VARIANTS,
    ZONES,
    BendingBench,
    Elbow,
    Quality,
    Taps,
    along,
)

from rig import make_rig
from rig.guides import plant_of

PERFECT = Quality(0.0, 0.0, 0.0)
RIG = make_rig(1, make="guides")
ELBOW = Elbow(0.25, 0.5, 2.0, (2.0, 2.0), (1.0, 1.0))


def pulled(elbow: Elbow, seconds: float) -> BendingBench:
    """Return a bench whose motor winds a cable against a held joint."""
    bench = BendingBench(RIG, {}, 0.001, elbow, hand=(2e3, 5.0))
    for step in range(round(1e3 * seconds)):
        bench.advance(8.0 * step / (1e3 * seconds), 0.0, 0.0)
    return bench


def test_ends_of_a_sliding_cable_obey_the_capstan_of_the_path_that_it_has() -> None:
    for seconds in (0.5, 1.0):
        bench = pulled(ELBOW, seconds)
        first, last = bench.tensions[0, [0, -1]]
        wrap = plant_of(RIG).bend[0].sum() + ELBOW.bend(seconds)
        assert np.log(first / last) == pytest.approx(RIG.friction_a * wrap, rel=0.01)
    assert ELBOW.bend(0.0) == 0.0 and ELBOW.bend(1.0) == pytest.approx(2.0)


def test_a_conduit_that_stays_straight_is_the_bench_that_it_was() -> None:
    bench = pulled(Elbow(0.25, 0.5, 0.0, (2.0, 2.0), (1.0, 1.0)), 0.1)
    assert np.array_equal(bench.plant.bend, plant_of(RIG).bend)


def test_perfect_sensors_tell_the_path_and_bad_ones_err_by_what_they_are() -> None:
    bench = pulled(ELBOW, 1.0)
    bends, tensions = Taps(1, 0.001, PERFECT, PERFECT).read(bench)
    added = (bends.sum(axis=1) - plant_of(RIG).bend.sum(axis=1)) / ELBOW.bend(1.0)
    assert added == pytest.approx(1.0)
    assert bends.shape == (2, ZONES) and tensions.shape == (2, len(PLACES))
    bad = Quality(0.02, 0.0, 0.0)
    noise = [Taps(s, 0.001, bad, PERFECT).read(bench)[0] - bends for s in range(200)]
    assert np.std(noise) == pytest.approx(0.02, rel=0.1)
    taps = Taps(1, 0.001, Quality(0.0, 0.0, 0.03), PERFECT)
    steps = np.diff([taps.read(bench)[0] for _ in range(300)], axis=0)
    assert np.std(steps) == pytest.approx(0.03 * np.sqrt(0.001 / 10.0), rel=0.1)


def test_wrap_angles_of_zones_are_shared_out_among_segments() -> None:
    angles = along(np.array([1.0, 3.0]), 4)
    assert angles == pytest.approx([0.5, 0.5, 1.5, 1.5])
    assert along(np.array([1.0, 3.0, 2.0]), 50).sum() == pytest.approx(6.0)


def test_a_task_is_the_same_again_and_follows_what_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name = "bend+strain"
    monkeypatch.setattr(self_tuning, "SECONDS", 0.9)
    monkeypatch.setattr(self_tuning, "SETTLED", 0.6)
    record = self_tuning.played(name, "path", 1)
    assert name in VARIANTS and record["outcome"] == "the 0.9 s are over."
    assert 0.0 < record["rms"] < 1.0
    assert self_tuning.played(name, "path", 1) == record


def test_errors_are_compared_by_geometric_means_over_seeds_that_both_finished() -> None:
    errors = {"fixed": (1.0, 2.0, 4.0), "bend": (2.0, 1.0, np.nan), "pi": (np.nan,) * 3}
    records = [
        {"controller": name, "effect": "path", "seed": seed, "rms": error}
        for name, own in errors.items()
        for seed, error in enumerate(own)
    ]
    shown = [self_tuning.over_fixed(records, "path", name) for name in errors]
    assert shown == ["1.00", "1.00", "-"]
    records[4]["rms"] = 4.0
    assert self_tuning.over_fixed(records, "path", "bend") == "2.00"
