"""Named effects are possible, and significantly different from zero.

Plausible sizes grow with the rig.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import stdtrit

from cc_mujoco.diagnosis import EFFECTS, Problem, prepare
from cc_mujoco.diagnosis._fit.intervals import (
    Spread,
    doubtful_effects,
    estimates,
    implausibility,
    is_ordinary,
    plausible_size,
)
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from diagnosis.recorded import BENCH, dataset

SIZES = [p for effect in EFFECTS.values() for p in effect.parameters if p.size]
MOST = {parameter.name: parameter.plausible[1] for parameter in SIZES}


@pytest.fixture(scope="module")
def baseline() -> Problem:
    """Return a model without effects, of joints that move by about two radians."""
    records, _ = prepare(dataset(duration=1.5), BENCH)
    floor = tuple(np.ones(record.measured.shape) for record in records)
    free = baseline_parameters(BENCH, records, {})
    return Problem(SimulatedRig(BENCH, records, 4), free, (), floor, floor)


def place(problem: Problem, **values: float) -> np.ndarray:
    """Return the scaled parameters with these values, the others at their start."""
    return np.array(
        [(values.get(p.name, p.start) - p.start) / p.scale for p in problem.tuned]
    )


@pytest.mark.parametrize(
    ("effect", "possible", "impossible"),
    [
        (
            "torque_sensor_gain",
            {"joint_torque_gain": 0.9 * MOST["joint_torque_gain"]},
            {"joint_torque_gain": -0.83},
        ),
        ("joint_stiffness", {"joint_stiffness": 0.2}, {"joint_stiffness": -0.04}),
        ("motor_inertia", {"motor_inertia": 1e-4}, {"motor_inertia": -1e-4}),
        (
            "pulley_eccentricity",
            {"ovality_sine": 0.2 * BENCH.motor_radius},
            {"ovality_sine": -0.3 * BENCH.motor_radius},
        ),
    ],
)
def test_sizes_that_no_rig_has_are_told(
    baseline: Problem,
    effect: str,
    possible: dict[str, float],
    impossible: dict[str, float],
) -> None:
    wider = baseline.with_effect(effect, dict(EFFECTS[effect].starts[0]))
    assert implausibility(wider, place(wider, **possible)) == ""
    (name,) = impossible
    assert f"fits only with {name}" in implausibility(wider, place(wider, **impossible))


def test_a_spring_that_rests_out_of_reach_is_an_offset(baseline: Problem) -> None:
    wider = baseline.with_effect(
        "joint_stiffness", EFFECTS["joint_stiffness"].starts[0]
    )
    for stiffness, reason in ((0.02, ""), (0.002, "rests 50 rad from joint angle 0")):
        x = place(wider, joint_stiffness=stiffness, joint_stiffness_moment=-0.1)
        found = implausibility(wider, x)
        assert reason in found and bool(found) is bool(reason)


@pytest.mark.parametrize(
    ("name", "most"), [("end_compliance", 0.06), ("load_independent_friction", 0.015)]
)
def test_what_any_rig_may_have_is_little_beside_its_cable(
    baseline: Problem, name: str, most: float
) -> None:
    cable = BENCH.cables[0]
    wholes = {
        "load_independent_friction": cable.pretension / cable.length,
        "seal_proximal": cable.pretension,
        "seal_distal": cable.pretension,
    }
    fitting = cable.length / cable.axial_stiffness
    wider = baseline.with_effect(name, {})
    sizes = {
        p.name: most * wholes.get(p.name, fitting) for p in EFFECTS[name].parameters
    }
    assert is_ordinary(wider, place(wider), name)
    for size, usual in sizes.items():
        assert is_ordinary(wider, place(wider, **{size: 0.9 * usual}), name)
        assert not is_ordinary(wider, place(wider, **{size: 1.1 * usual}), name)
    together = {size: 0.6 * usual for size, usual in sizes.items()}
    assert not is_ordinary(wider, place(wider, **together), name)
    large = place(wider, **{size: 2.0 * usual for size, usual in sizes.items()})
    for share, expected in ((0.01, False), (10.0, True)):
        covariance = np.diag((share * np.maximum(np.abs(large), 1e-9)) ** 2)
        spread = Spread(covariance, np.full(large.size, 5.0))
        assert is_ordinary(wider, large, name, spread) == expected


def test_what_one_end_may_have_the_other_cable_may_have_as_well(
    baseline: Problem,
) -> None:
    cable = BENCH.cables[0]
    fitting = 0.05 * cable.length / cable.axial_stiffness
    wider = baseline.with_effect("end_compliance", {})
    ends = {"end_compliance": fitting, "proximal_compliance_antagonist": fitting}
    assert is_ordinary(wider, place(wider, **ends), "end_compliance")


def test_of_other_effects_no_size_is_what_any_rig_may_have(baseline: Problem) -> None:
    wider = baseline.with_effect("viscous_friction", {})
    assert not is_ordinary(
        wider, place(wider, viscous_friction=1e-6), "viscous_friction"
    )


def test_play_is_a_small_part_of_the_motion(baseline: Problem) -> None:
    wider = baseline.with_effect("backlash", {"backlash": 0.01})
    motion = max(float(np.ptp(r.joint_angle)) for r in baseline.plant.records)
    assert (
        implausibility(wider, place(wider, backlash=0.9 * MOST["backlash"] * motion))
        == ""
    )
    assert implausibility(wider, place(wider, backlash=1.1 * MOST["backlash"] * motion))
    half = tuple(
        replace(r, joint_angle=0.5 * r.joint_angle) for r in baseline.plant.records
    )
    less = replace(wider, plant=wider.plant.limited(half))
    assert implausibility(less, place(less, backlash=0.9 * MOST["backlash"] * motion))


def test_an_eccentric_pulley_can_be_tried_at_any_place(baseline: Problem) -> None:
    wider = baseline.with_effect("pulley_eccentricity", {})
    far = place(wider, eccentricity_sine=0.05, ovality_cosine=0.05, ovality_sine=-0.05)
    assert all(np.isfinite(torque).all() for torque in wider.torques(far))


def test_an_effect_whose_interval_contains_zero_is_doubtful(baseline: Problem) -> None:
    wider = baseline.with_effect("joint_gravity", {})
    wider = wider.with_effect("joint_stiffness", {})
    x = place(wider, gravity_sine=0.1, gravity_cosine=0.0, joint_stiffness=0.2)
    size = {p.name: k for k, p in enumerate(wider.tuned)}
    spread = np.eye(x.size)
    for name, deviation in (
        ("gravity_sine", 0.3),
        ("gravity_cosine", 0.3),
        ("joint_stiffness", 0.4),
    ):
        spread[size[name], size[name]] = deviation**2
    known = np.full(x.size, np.inf)
    assert doubtful_effects(wider, x, spread, known) == []
    spread[size["joint_stiffness"], size["joint_stiffness"]] = 0.6**2
    assert doubtful_effects(wider, x, spread, known) == ["joint_stiffness"]
    count = len(baseline.tuned)
    assert (
        doubtful_effects(baseline, place(baseline), np.eye(count), known[:count]) == []
    )


@pytest.mark.parametrize("freedom", [1.5, 6.0, np.inf])
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_size_is_doubtful_exactly_where_its_interval_contains_zero(
    baseline: Problem, freedom: float, share: float
) -> None:
    wider = baseline.with_effect("joint_stiffness", {})
    x = place(wider, joint_stiffness=0.2)
    where = [p.name for p in wider.tuned].index("joint_stiffness")
    covariance = np.eye(x.size)
    covariance[where, where] = (
        share * x[where] / stdtrit(min(freedom, 1e9), 0.975)
    ) ** 2
    known = np.full(x.size, np.inf)
    known[where] = freedom
    low, high = estimates(wider, x, Spread(covariance, known))["joint_stiffness"].ci95
    assert (low < 0.0 < high) is (share > 1.0)
    doubt = doubtful_effects(wider, x, covariance, known)
    assert doubt == (["joint_stiffness"] if share > 1.0 else [])


def test_a_size_that_only_its_shape_makes_uncertain_is_no_doubt(
    baseline: Problem,
) -> None:
    """Only the product of size and shape is determined, and it is not zero."""
    wider = baseline.with_effect("stribeck_friction", {})
    x = place(wider, stribeck_friction=0.05, stribeck_speed=0.02)
    size, shape = (
        next(k for k, p in enumerate(wider.tuned) if p.name == name)
        for name in ("stribeck_friction", "stribeck_speed")
    )
    spread = np.eye(x.size)
    along, across = x[size] ** 2, (0.1 * x[size]) ** 2
    spread[size, size] = along + across
    spread[size, shape] = spread[shape, size] = -x[size]
    assert spread[size, size] > (x[size] / 1.96) ** 2
    known = np.full(x.size, np.inf)
    assert doubtful_effects(wider, x, spread, known) == []
    low, high = estimates(wider, x, Spread(spread, known))["stribeck_friction"].ci95
    assert 0.0 < low < 0.05 < high
    spread[size, shape] = spread[shape, size] = 0.0
    assert doubtful_effects(wider, x, spread, known) == ["stribeck_friction"]


def size(parameter: Any, radius: float = 1.0, **changes: float) -> float:
    cables = [cable.replace(**changes) for cable in BENCH.cables]
    bench = SimpleNamespace(
        motor_radius=radius * BENCH.motor_radius,
        joint_radius=radius * BENCH.joint_radius,
    )
    plant = SimpleNamespace(bench=bench, cables=lambda values, effects: cables)
    problem: Any = SimpleNamespace(plant=plant, values=lambda x: {}, effects=())
    return plausible_size(parameter, problem, np.zeros(0))


@pytest.mark.parametrize("parameter", SIZES, ids=lambda each: each.name)
def test_a_size_scales_with_what_it_is_compared_with(parameter: Any) -> None:
    assert size(parameter) == pytest.approx(parameter.typical)
    force = {"pretension": 160.0, "axial_stiffness": 1e5}
    grown = size(parameter, 1.0, **force) / parameter.typical
    # Of a rig twice as strong and as stiff all forces and torques double.
    expected = {
        "N m": 2, "N m/s": 2, "N m/rad": 2, "kg m^2": 2, "N": 2, "N/m": 2,
        "N s/m^2": 2, "m/N": 0.5, "1/J": 0.5,
    }  # fmt: skip
    assert grown == pytest.approx(expected.get(parameter.unit, 1.0))
    wide = size(parameter, 3.0) / parameter.typical
    arms = {
        "N m": 3,
        "N m/s": 3,
        "N m/rad": 3,
        "kg m^2": 3,
        "N s/m^2": 1 / 3,
        "1/J": 1 / 3,
    }
    if parameter.name.startswith(("eccentricity", "ovality")):
        arms["m"] = 3
    assert wide == pytest.approx(arms.get(parameter.unit, 1.0))
