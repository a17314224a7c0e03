"""The rig of finite elements obeys what is known of cables, by equations of its own.

What simulates long trials of it is a study.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rig import dataset
from rig.dataset import clean_dataset, make_dataset, make_trials, run, truth_of
from rig.elements import Cables, Plant, deflected, plant_of, start, step
from rig.engine import COLUMNS
from rig.makes import MAKES
from rig.nominal import Rig, make_rig
from rig.sensors import BASIC, CHANNELS, logged, sampled
from rig.sensors import imperfect as chain_of
from rig.trials import SETS, Trial

EFFECTS = MAKES["elements"].effects
FLOORS = np.array([CHANNELS[name].floor for name in BASIC])
simulates = pytest.mark.study


@pytest.fixture(scope="module")
def rig() -> Rig:
    return make_rig(4, make="elements")


def cut(name: str, which: int, seconds: float) -> Trial:
    whole = make_trials(name, 3)[which]
    rows = round(1000 * seconds) + 1
    return dataclasses.replace(
        whole, command=whole.command[:rows], target=whole.target[:rows]
    )


@pytest.fixture(scope="module")
def trial() -> Trial:
    """Two seconds with many reversals."""
    return cut("rich", 4, 2.0)


def seen(
    rig: Rig, trial: Trial, effects: dict[str, float], refine: int = 1, **mesh: int
) -> NDArray[np.float64]:
    """Noise-free samples over the noise floors."""
    truth = truth_of(rig, effects, 3, **mesh)
    records = run(truth, rig, trial, refine)
    return np.asarray(sampled(records, rig, truth.chain, BASIC) / FLOORS)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2, axis=0)).max())


class Bench:
    """One cable whose ends are moved by hand."""

    def __init__(self, p: Plant, tight: float = 80.0) -> None:
        self.p, self.tight = p, tight
        self.cables: Cables = start(p, tight, (0.0, 0.0))
        self.at = (0.0, 0.0)

    def to(self, near: float, far: float) -> tuple[float, float]:
        ends = (self.at[0], near), (self.at[1], far)
        self.at = near, far
        *tensions, found = step(
            self.p, self.cables, 0, self.tight, *ends, 0.0, 0.0, 1e-3
        )
        assert found
        return tensions[0], tensions[1]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_cable_that_slides_obeys_the_capstan_equation(rig: Rig, way: float) -> None:
    bench = Bench(plant_of(rig))
    for k in range(400):
        near, far = bench.to(way * 1e-4 * k, way * 1e-4 * k)
    gain = math.exp(way * rig.friction_a * rig.wrap)
    assert near / far == pytest.approx(gain, rel=1e-4)
    assert bench.p.bend.sum(axis=1) == pytest.approx(rig.wrap)


def test_a_cable_that_is_let_go_is_slack_and_comes_back(rig: Rig) -> None:
    bench = Bench(plant_of(rig))
    for near in [*np.linspace(0.0, -0.05, 200), *np.linspace(-0.05, 0.0, 200)]:
        bench.to(near, 0.0)
        assert np.all(bench.cables.tension >= 0.0)
        if near == -0.05:
            assert bench.cables.tension[0, 0] == 0.0
    for _ in range(100):
        ends = bench.to(0.0, 0.0)
    assert max(ends) > 40.0


@given(st.floats(-1.0, 1.0), st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=8))
def test_a_contact_never_holds_more_than_makes_it_slide(
    z: float, moves: list[float]
) -> None:
    """And a move in two parts is one move."""
    for move in moves:
        after, slope = deflected(z, move, 1.0)
        assert abs(after) <= 1.0
        assert 0.0 <= slope <= 1.0
        half, _ = deflected(z, 0.5 * move, 1.0)
        assert deflected(half, 0.5 * move, 1.0)[0] == pytest.approx(after, abs=1e-12)
        z = after
    assert deflected(z, 50.0, 1.0)[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    "effects",
    [{}, {"viscous_friction": 80.0}, {"dwell_dependent_stiction": 0.5},
     {"presliding": 1e-3}, {"asymmetric_friction": 0.4}],
    ids=str,
)  # fmt: skip
@simulates
def test_work_is_dissipated_or_stored(
    rig: Rig, trial: Trial, effects: dict[str, float]
) -> None:
    records = run(truth_of(rig, effects, 3), rig, trial)
    at_end = dict(zip(COLUMNS, records[-1], strict=True))
    at_start = records[0, COLUMNS.index("energy_stored")]
    lost = at_end["work_friction"] + at_end["work_damping"]
    assert lost > 1.0
    left = at_end["work_in"] - at_end["work_out"] - lost
    # What implicit Euler takes out of fast waves is not counted, and is no more.
    assert abs(left - (at_end["energy_stored"] - at_start)) < 1e-3 * lost


@pytest.mark.parametrize(
    "effects",
    [{}, {"backlash": 0.004}, {"stribeck_friction": 0.07},
     {"dwell_dependent_stiction": 0.2}, {"asymmetric_friction": 0.2},
     {"end_compliance": 2e-5}, {"cable_stiffening": 0.5}],
    ids=str,
)  # fmt: skip
@simulates
def test_half_the_step_changes_less_than_a_tenth_of_the_noise(
    rig: Rig, trial: Trial, effects: dict[str, float]
) -> None:
    assert rms(seen(rig, trial, effects) - seen(rig, trial, effects, 2)) < 0.1


@simulates
def test_half_the_step_changes_little_in_slow_creep(rig: Rig) -> None:
    creeping = cut("restful", 4, 3.0)
    assert rms(seen(rig, creeping, {}) - seen(rig, creeping, {}, 2)) < 0.1


@simulates
def test_more_elements_change_less_and_less(rig: Rig, trial: Trial) -> None:
    finest = seen(rig, trial, {}, elements=120)
    errors = [
        rms(seen(rig, trial, {}, elements=elements) - finest)
        for elements in (10, 20, 40)
    ]
    assert errors[2] < 0.6 * errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.2


@simulates
def test_without_effects_it_is_the_rig_of_another_make_to_about_the_noise(
    trial: Trial,
) -> None:
    one, other = (
        clean_dataset(make_rig(4, make=make), {}, [trial], 3)[0]
        for make in ("guides", "elements")
    )
    assert rms((one - other) / FLOORS) < 4.0


@pytest.fixture(scope="module")
def plain(rig: Rig, trial: Trial) -> NDArray[np.float64]:
    """Return what is seen without effects."""
    return clean_dataset(rig, {}, [trial], 3)[0]


@pytest.mark.parametrize("name", list(EFFECTS))
@simulates
def test_an_effect_shows_and_is_nothing_at_amount_zero(
    rig: Rig, trial: Trial, plain: NDArray[np.float64], name: str
) -> None:
    amount = min(3.0 * EFFECTS[name].typical, EFFECTS[name].limit)
    off, hidden = (
        clean_dataset(rig, effects, [trial], 3)[0]
        for effects in ({name: 0.0}, {name: amount})
    )
    np.testing.assert_array_equal(plain, off)
    assert np.all(np.isfinite(hidden))
    assert rms((hidden - plain) / FLOORS) > 0.5


def test_it_hides_what_a_library_can_know_and_unknowns_of_its_own() -> None:
    others = [MAKES["bristles"], MAKES["guides"]]
    more = {"grease_drag", "joint_friction"}
    assert set(MAKES["elements"].named) == {*others[0].named, *more}
    for other in others:
        assert not set(MAKES["elements"].unknown) & set(other.unknown)


def test_every_rig_has_some_of_what_no_builder_gets_rid_of() -> None:
    counts = []
    for seed in range(40):
        rig = make_rig(seed, make="elements")
        p, chain = plant_of(rig).bench, chain_of(rig)
        has = [
            p.shaft, p.teeth, p.amplifier < 1e5, chain.motor_offcentre,
            chain.joint_offcentre, chain.slow, chain.jitter,
        ]  # fmt: skip
        counts.append([bool(each) for each in has])
        assert MAKES["elements"].trials(rig) == ("restful" if seed % 2 else "rich")
    shares = np.mean(counts, axis=0)
    assert np.all((shares > 0.25) & (shares < 0.75))


@simulates
def test_coarse_encoders_round_and_jitter_is_stamped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    short = cut("restful", 4, 1.2)
    monkeypatch.setitem(SETS, "restful", lambda _rng: [short])
    rigs = [make_rig(seed, make="elements") for seed in range(1, 60, 2)]
    rig = next(each for each in rigs if chain_of(each).jitter)
    (columns,) = make_dataset(rig, {}, "restful", 1)
    for name, bits in (("motor_angle", 15), ("joint_angle", 13)):
        digits = columns[CHANNELS[name].column] / (2.0 * math.pi) * 2**bits
        np.testing.assert_allclose(digits, np.round(digits), atol=1e-6)
        assert chain_of(rig).channels()[name].noise == 0.0
    steps = np.diff(columns["time_s"])
    assert np.all(steps > 1e-3)
    assert np.std(steps) > 1e-5


def test_noise_does_not_know_what_is_hidden(rig: Rig) -> None:
    clean, chain = np.zeros((400, 4)), chain_of(rig)
    once = logged(clean, chain, BASIC, [3, 3, 0])
    other = logged(clean + 1.0, chain, BASIC, [3, 3, 0])
    for name in BASIC:
        channel = chain.channels()[name]
        apart = other[channel.column] - once[channel.column] - 1.0
        assert np.abs(apart).max() < 1.01 * channel.resolution


def test_a_data_set_is_the_same_each_time(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "make_trials", lambda *_: [cut("rich", 4, 0.9)])
    one, other = (make_dataset(rig, {"joint_gravity": 0.2}, "rich", 3) for _ in "ab")
    for name, values in one[0].items():
        np.testing.assert_array_equal(values, other[0][name])
