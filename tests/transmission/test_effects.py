"""Effects beyond the friction terms: each against a closed form or another model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.transmission import Cable, Section, replay
from transmission.test_kernel_physics import BENT, STRAIGHT, sliding, wander


def ends(seed, samples=2000, size=0.01):
    rng = np.random.default_rng(seed)
    return wander(rng, samples, size), wander(rng, samples, size)


def test_asymmetric_friction_in_steady_sliding():
    cable = BENT.replace(friction_asymmetry=0.4)
    low, high = sliding(cable, 0.05)
    assert math.log(high / low) == pytest.approx(0.21 * 1.4 * BENT.wrap, rel=1e-9)
    time = np.linspace(0.0, 0.3, 3000)
    away = replay(cable, 1e-3, u_proximal=time, u_distal=time)
    ratio = away.tension_distal[-1] / away.tension_proximal[-1]
    assert math.log(ratio) == pytest.approx(0.21 * 0.6 * BENT.wrap, rel=1e-9)


@pytest.mark.parametrize("static", [0.0, 0.5])
def test_asymmetry_changes_sign_with_the_ends_exchanged(static):
    cable = BENT.replace(segments=20, static_friction=static, friction_asymmetry=0.3)
    near, far = ends(1, size=4e-3)
    one = replay(cable, 1e-3, u_proximal=near, u_distal=far)
    other = replay(
        cable.replace(friction_asymmetry=-0.3), 1e-3, u_proximal=-far, u_distal=-near
    )
    assert other.tension_distal == pytest.approx(one.tension_proximal, abs=1e-7)
    assert other.tension_proximal == pytest.approx(one.tension_distal, abs=1e-7)


def test_asymmetric_friction_converges_with_the_mesh():
    near, far = ends(3)
    found = [
        replay(
            BENT.replace(segments=n, friction_asymmetry=0.5),
            1e-3,
            u_proximal=near,
            u_distal=far,
        ).tension_proximal
        for n in (25, 50, 100, 200)
    ]
    errors = [float(np.sqrt(np.mean((f - found[-1]) ** 2))) for f in found[:-1]]
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]
    assert errors[2] < 0.01 * found[-1].max()


def test_end_spring_in_series_with_a_smooth_cable():
    cable = STRAIGHT.replace(friction=0.0, end_compliance=2e-4)
    near, far = ends(0, size=4e-3)
    motion = replay(cable, 1e-3, u_proximal=near, u_distal=far)
    compliance = 2.0 / 4000.0 + 2e-4
    tension = np.maximum(10.0 + (far - near) / compliance, 0.0)
    assert motion.tension_proximal == pytest.approx(tension, abs=1e-9)
    assert motion.tension_distal == pytest.approx(tension, abs=1e-9)
    assert motion.stored == pytest.approx(0.5 * compliance * tension**2, abs=1e-12)
    assert motion.slack == pytest.approx(
        np.maximum(near - far - 10.0 * compliance, 0.0), abs=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("terms", [{}, {"viscous_friction": 30.0}], ids=["march", "-"])
def test_end_spring_is_that_of_a_cable_whose_end_moves_less(seed, terms):
    """The cable behind the spring is one without it, driven by what the spring left."""
    near, far = ends(seed)
    far = far + 0.02
    far[0] = near[0]
    sprung = BENT.replace(end_compliance=3e-4, pretension=30.0, segments=25, **terms)
    motion = replay(sprung, 1e-3, u_proximal=near, u_distal=far)
    assert motion.slack.max() == 0.0
    behind = far - 3e-4 * (motion.tension_distal - 30.0)
    bare = sprung.replace(end_compliance=0.0)
    alone = replay(bare, 1e-3, u_proximal=near, u_distal=behind)
    # A null point that passes the last segment is placed in it by the motion of its
    # ends, one of which is now the spring's; it is gone after a few samples.
    for ours, wanted in (
        (alone.tension_distal, motion.tension_distal),
        (alone.tension_proximal, motion.tension_proximal),
    ):
        error = np.abs(ours - wanted) / wanted.max()
        assert error.max() < 5e-3
        assert np.mean(error > 1e-4) < 0.03
