"""Parameters from the blocked-output test, by the slope and by a fit."""

from __future__ import annotations

import numpy as np

from cc_mujoco.estimation import calibrate
from thesis._experiments import parameters
from thesis._rig import LENGTH, STIFFNESS, drive


def test_slope_of_the_loop_overstates_stiffness_and_the_fit_does_not() -> None:
    trial = parameters.blocked_trial(parameters.CABLE, 5)
    assert parameters.by_slope(trial) > 1.05 * STIFFNESS
    found = calibrate(
        [trial],
        drive(parameters.INITIAL_GUESS),
        ("friction", "axial_stiffness"),
        starts=0,
    )
    stiffness = found["axial_stiffness"]
    assert stiffness.value == np.clip(
        stiffness.value, 0.99 * LENGTH * STIFFNESS, 1.01 * LENGTH * STIFFNESS
    )


def test_without_friction_the_slope_is_the_stiffness() -> None:
    free = parameters.CABLE.replace(friction=1e-6)
    trial = parameters.blocked_trial(free, 5)
    assert abs(parameters.by_slope(trial) / STIFFNESS - 1.0) < 0.01
