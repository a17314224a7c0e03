"""The shape of the residual of Experiment 2 comes from the friction that is missing."""

from __future__ import annotations

import numpy as np

from thesis._experiments import tunnel


def test_linear_term_takes_a_third_and_leaves_what_is_large_at_low_speed() -> None:
    recording = tunnel.record(tunnel.RIG, duration=9.0)
    found = tunnel.residual(recording)
    assert 0.2 < found.removed < 0.45
    assert 0.2 < tunnel.rms(found.before) < 0.35
    places = np.digitize(recording.handle_velocity, [0.05, 0.4, 0.8, 1.4])
    slow, middle, fast = (np.mean(found.after[places == k]) for k in (1, 2, 3))
    # Friction that the model lacks holds the handle back: less torque reaches it.
    assert slow < middle < fast


def test_linear_term_takes_nearly_all_of_viscous_friction() -> None:
    rig = tunnel.RIG.replace(stribeck_friction=0.0)
    assert tunnel.residual(tunnel.record(rig, duration=6.0)).removed > 0.8


def test_without_missing_friction_the_residual_is_that_of_the_sensors() -> None:
    found = tunnel.residual(tunnel.record(tunnel.COULOMB, duration=6.0))
    assert tunnel.rms(found.before) < 0.04
