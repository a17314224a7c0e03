"""Capstan friction of an ordinary tendon, over a post, a guide and a knuckle."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.plugin import from_mjcf, read, route_wrap, to_mjcf


def load(friction: float, **changes: object) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the scene with another coefficient of friction and without its driver."""
    spec = mujoco.MjSpec.from_file(str(scene_path("finger")))
    cable = from_mjcf(spec)["extensor"].replace(friction=friction, **changes)
    to_mjcf(spec, "extensor", cable)
    m = spec.compile()
    alone(m)
    return m, mujoco.MjData(m)


def alone(m: mujoco.MjModel) -> None:
    """Take the wearer away."""
    wearer = m.actuator("wearer")
    wearer.gainprm[0], wearer.biasprm[:3] = 0.0, 0.0


def pull(m: mujoco.MjModel, d: mujoco.MjData, torque: float, seconds: float) -> None:
    """Change the torque of the winch steadily."""
    steps = round(seconds / m.opt.timestep)
    for value in np.linspace(d.ctrl[0], torque, steps):
        d.ctrl[0] = value
        mujoco.mj_step(m, d)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.3])
def test_tension_ratio_is_exp_of_friction_times_wrap(friction: float) -> None:
    """While it slides, either way, with the wrap angle of the pose it is in."""
    m, d = load(friction)
    mujoco.mj_step(m, d, 2000)  # curls against 5 N of pretension
    seen = []
    for torque, way in ((0.06, 1), (0.12, 1), (0.16, 1), (0.02, -1), (0.015, -1)):
        pull(m, d, torque, 0.5)
        reading = read(m, d, "extensor")
        assert np.all(reading.slip == -way)
        ratio = reading.tension_proximal / reading.tension_distal
        wrap = route_wrap(m, d, "extensor")
        assert math.log(ratio) == pytest.approx(way * friction * wrap, abs=1e-6)
        assert d.sensor("tension_extensor_proximal").data[0] == pytest.approx(
            reading.tension_proximal
        )
        seen.append((d.joint("finger").qpos[0], wrap))
    angle, wrap = np.array(seen).T
    # The path turns by 2.46 rad at the finger half flexed, over the knuckle with it.
    assert wrap == pytest.approx(2.457 + angle, abs=1e-2)
    assert np.ptp(angle) > 0.4


def test_finger_holds_still_while_the_pull_stays_within_friction() -> None:
    m, d = load(0.3)
    pull(m, d, 0.2, 1.0)
    mujoco.mj_step(m, d, 2000)
    held = d.joint("finger").qpos[0]
    most = read(m, d, "extensor")
    limit = math.exp(0.3 * route_wrap(m, d, "extensor"))
    assert most.tension_proximal == pytest.approx(limit * most.tension_distal, rel=1e-2)
    pull(m, d, 0.2 / limit, 1.0)  # halfway down to where the tendon would run back
    still = read(m, d, "extensor")
    assert d.joint("finger").qpos[0] == pytest.approx(held, abs=1e-3)
    assert still.tension_distal == pytest.approx(most.tension_distal, rel=1e-2)
    assert still.tension_proximal < 1.05 * still.tension_distal
    pull(m, d, 0.8 * 0.2 / limit**2, 1.0)
    assert d.joint("finger").qpos[0] > held + 0.1


def test_without_friction_it_is_a_motor_on_the_tendon() -> None:
    m, d = load(0.0, axial_stiffness=20000.0)
    m.opt.timestep = 1e-4
    pull(m, d, 0.12, 0.5)
    mujoco.mj_step(m, d, 5000)
    finger, tension = d.joint("finger").qpos[0], 0.12 / 0.008

    spec = mujoco.MjSpec.from_file(str(scene_path("finger")))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    pulled = spec.add_actuator(name="pull", target="extensor")
    pulled.trntype = mujoco.mjtTrn.mjTRN_TENDON
    plain = spec.compile()
    e = mujoco.MjData(plain)
    e.ctrl[0] = -tension
    mujoco.mj_step(plain, e, 20000)
    assert -0.7 < finger < 0.3
    assert finger == pytest.approx(e.joint("finger").qpos[0], abs=1e-3)


def test_more_flexed_finger_gets_less_of_the_same_pull() -> None:
    passed = []
    for angle in (-0.7, 0.0, 0.7):
        m, d = load(0.2)
        for part in np.linspace(0.0, 1.0, 2000):
            d.qpos[:] = [-angle * 0.012 / 0.008 + part, angle]
            d.qvel[:] = 0.0
            mujoco.mj_step(m, d)
        reading = read(m, d, "extensor")
        passed.append(reading.tension_distal / reading.tension_proximal)
    assert np.diff(np.log(passed)) == pytest.approx([-0.2 * 0.7] * 2, rel=1e-6)


@pytest.mark.parametrize("way", [1, -1])
def test_finger_feels_the_tension_of_the_piece_that_pulls_it(way: int) -> None:
    """That behind the knuckle, whatever the tendon has before."""
    m, d = load(0.3)
    pull(m, d, 0.16, 1.0)
    if way < 0:
        pull(m, d, 0.03, 1.0)
    reading = read(m, d, "extensor")
    assert np.all(reading.slip == -way)
    finger = int(m.joint("finger").dofadr[0])
    others = d.qfrc_spring[finger] + d.qfrc_damper[finger]
    felt = d.qfrc_actuator[finger] + d.qfrc_passive[finger] - others
    assert felt == pytest.approx(-0.012 * reading.tension_distal, rel=1e-6)
    assert abs(reading.tension_proximal / reading.tension_distal - 1.0) > 0.4
