"""Declared constants of the rig replace those of the scene."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.datasets._trials import Constant
from cc_mujoco.diagnosis import prepare
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from diagnosis.recorded import BENCH, dataset

KNOWN = {
    "motor_radius": Constant(0.02, 0.001),
    "friction": Constant(0.2),
    "axial_stiffness": Constant(3e4, 6e3),
    "pretension": Constant(40.0, 8.0),
}


def test_constants_replace_what_the_scene_says() -> None:
    bench = BENCH.known(KNOWN)
    assert bench.motor_radius == 0.02
    assert bench.joint_radius == BENCH.joint_radius
    for cable in bench.cables:
        assert (cable.friction, cable.axial_stiffness) == (0.2, 3e4)
        assert cable.pretension == 40.0


def test_uncertainties_are_priors_and_what_is_unsure_is_fitted() -> None:
    bench = BENCH.known(KNOWN)
    records, _ = prepare(dataset(), bench)
    free = {p.name: p for p in baseline_parameters(bench, records, KNOWN)}
    assert free["friction"].prior == np.inf
    assert free["axial_stiffness"].prior == pytest.approx(0.2)
    assert free["pretension"].scale == pytest.approx(0.2)
    assert free["motor_radius"].scale == pytest.approx(0.05)
    assert "motor_radius" not in {
        p.name for p in baseline_parameters(BENCH, records, {})
    }


def test_a_trial_s_pretension_is_relative_to_the_known_one() -> None:
    bench = BENCH.known(KNOWN)
    records, _ = prepare(dataset(), bench)
    plant = SimulatedRig(bench, records, 8)
    cables = plant.cables({"pretension": 44.0}, (), pretension=20.0)
    assert cables[0].pretension == pytest.approx(22.0)


@pytest.mark.parametrize("value", [0.0, 1e-3, 80.0, 8e5])
def test_a_pretension_as_uncertain_as_large_stays_one_of_a_cable(value: float) -> None:
    constants = {"pretension": Constant(value, value or 5.0)}
    bench = BENCH.known(constants)
    records, _ = prepare(dataset(duration=1.0), bench)
    (free,) = [
        p
        for p in baseline_parameters(bench, records, constants)
        if p.name == "pretension"
    ]
    plant = SimulatedRig(bench, records, 8, constants=constants)
    for place in (free.low, 0.0, free.high):
        cable, _ = plant.cables({"pretension": free.value(place)}, ())
        assert cable.pretension == free.value(place)
