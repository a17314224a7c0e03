"""Plausible sizes grow with the rig."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.inference.sizes import plausible_size
from diagnosis.recorded import BENCH

SIZES = [p for effect in EFFECTS.values() for p in effect.parameters if p.size]


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
