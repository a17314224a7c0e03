"""Capstan friction of an ordinary tendon, over a post, a guide and a knuckle."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.engine import from_mjcf, read, route_wrap, to_mjcf


def load(friction: float, **changes: object) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The scene with another coefficient of friction."""
    spec = mujoco.MjSpec.from_file(str(scene_path("finger")))
    cable = from_mjcf(spec)["extensor"].replace(friction=friction, **changes)
    to_mjcf(spec, "extensor", cable)
    m = spec.compile()
    return m, mujoco.MjData(m)


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
    # The path turns by 1.7 rad at the straight finger, and over the knuckle with it.
    assert wrap == pytest.approx(1.707 + angle, abs=1e-2)
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
    assert 0.1 < finger < 1.0
    assert finger == pytest.approx(e.joint("finger").qpos[0], abs=1e-3)


def test_more_flexed_finger_gets_less_of_the_same_pull() -> None:
    passed = []
    for angle in (0.0, 0.7, 1.4):
        m, d = load(0.2)
        for part in np.linspace(0.0, 1.0, 2000):
            d.qpos[:] = [-angle * 0.012 / 0.008 + part, angle]
            d.qvel[:] = 0.0
            mujoco.mj_step(m, d)
        reading = read(m, d, "extensor")
        passed.append(reading.tension_distal / reading.tension_proximal)
    assert np.diff(np.log(passed)) == pytest.approx([-0.2 * 0.7] * 2, rel=1e-6)


def along(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Points of the tendon's path, (n, 3), and the turn of the path at each [rad].

    The chord of an arc counts as a piece too; here it pulls nothing that moves.
    """
    start, count = int(d.ten_wrapadr[0]), int(d.ten_wrapnum[0])
    points = d.wrap_xpos.reshape(-1, 3)[start : start + count]
    piece = np.diff(points, axis=0)
    piece /= np.linalg.norm(piece, axis=1)[:, None]
    cosine = np.sum(piece[1:] * piece[:-1], axis=1)
    # A chord makes half of its arc's angle with the tangents at both ends.
    return points, np.concatenate([[0.0], np.arccos(np.minimum(cosine, 1.0)), [0.0]])


def pulled(m: mujoco.MjModel, d: mujoco.MjData, tension: np.ndarray) -> np.ndarray:
    """Joint torques of a tendon with this tension in each piece of its path, (nv,).

    Each body is pushed by what the pieces before and behind its points pull.
    """
    start, count = int(d.ten_wrapadr[0]), int(d.ten_wrapnum[0])
    points, _ = along(m, d)
    piece = np.diff(points, axis=0)
    piece /= np.linalg.norm(piece, axis=1)[:, None]
    force = np.zeros((count, 3))
    force[:-1] += tension[:, None] * piece
    force[1:] -= tension[:, None] * piece
    names = iter(["winch_exit", "guide", "insertion"])
    torque = np.zeros(m.nv)
    for point, push, geom in zip(
        points, force, d.wrap_obj.ravel()[start : start + count], strict=True
    ):
        body = m.geom_bodyid[geom] if geom >= 0 else m.site(next(names)).bodyid[0]
        jacobian = np.zeros((3, m.nv))
        mujoco.mj_jac(m, d, jacobian, None, point, body)
        torque += jacobian.T @ push
    return torque


@pytest.mark.parametrize("way", [1, -1])
def test_finger_feels_the_tension_that_the_tendon_has_where_it_pulls(way: int) -> None:
    """The local tension, piece by piece, against what the plugin applies.

    It falls along the path as exp(-friction * turn), and each piece pulls the bodies at
    its ends with its own; the plugin knows the distal one and MuJoCo's moment arms.
    """
    friction = 0.3
    m, d = load(friction)
    pull(m, d, 0.16, 1.0)
    if way < 0:
        pull(m, d, 0.03, 1.0)
    mujoco.mj_forward(m, d)
    assert np.all(read(m, d, "extensor").slip == -way)
    distal = -float(d.sensor("tension_extensor_distal").data[0])
    turn = along(m, d)[1]
    assert turn.sum() == pytest.approx(route_wrap(m, d, "extensor"), rel=1e-6)
    behind = turn.sum() - np.cumsum(turn)[:-1]
    local = distal * np.exp(way * friction * behind)
    proximal = float(d.sensor("tension_extensor_proximal").data[0])
    assert local[0] == pytest.approx(proximal, rel=1e-3)
    assert np.ptp(local) > 0.3 * distal
    finger = int(m.joint("finger").dofadr[0])
    applied = float(d.qfrc_actuator[finger])
    assert applied == pytest.approx(pulled(m, d, local)[finger], rel=1e-9)
    # A tendon without friction would pull no less exactly, with one tension.
    assert applied == pytest.approx(-0.012 * distal, rel=1e-6)
