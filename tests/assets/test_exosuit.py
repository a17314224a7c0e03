"""The soft exosuit: its drawing is its configuration; joints feel their pieces."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.plugin import from_mjcf, read, route, route_wrap, settle, step_limits

LEG = ("thigh", "shank", "foot")


def load(scene: str = "exosuit") -> tuple[mujoco.MjModel, mujoco.MjData]:
    m = mujoco.MjModel.from_xml_path(str(scene_path(scene)))
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    return m, d


def felt(m: mujoco.MjModel, d: mujoco.MjData) -> dict[str, float]:
    """Torques of all cables at the joints of the leg [N m]."""
    torque = d.qfrc_actuator + d.qfrc_passive - d.qfrc_spring - d.qfrc_damper
    found = {}
    for joint, mover in (("hip", "wearer"), ("knee", "wearer_knee"),
                         ("ankle", "wearer_ankle")):  # fmt: skip
        place = m.joint(joint).dofadr[0]
        found[joint] = float(torque[place] - d.actuator(mover).force[0])
    return found


def test_the_sections_are_what_is_drawn() -> None:
    m, d = load()
    cables = from_mjcf(m)
    assert cables["thigh"].length == pytest.approx(d.ten_length[0], rel=1e-3)
    line = route(m, d, "heel")[:-1]
    drawn = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert cables["heel"].length == pytest.approx(drawn, rel=1e-2)
    assert cables["heel"].wrap == pytest.approx(route_wrap(m, d, "heel"), rel=1e-2)
    assert np.allclose(line[-1], d.site("heel_mouth").xpos)


def test_the_leg_is_that_of_the_ankle_exoskeleton() -> None:
    ours, theirs = load()[0], load("ankle")[0]
    for body in LEG:
        assert np.array_equal(ours.body(body).pos, theirs.body(body).pos)
    for joint in ("hip", "knee", "ankle"):
        assert np.array_equal(ours.joint(joint).range, theirs.joint(joint).range)
        assert np.array_equal(ours.joint(joint).axis, theirs.joint(joint).axis)
    assert ours.body("thigh").mass == theirs.body("thigh").mass
    # A brace of 0.25 kg instead of a frame of 0.45 kg, a lever of 0.15 kg too.
    lighter = [float(theirs.body(b).mass[0] - ours.body(b).mass[0]) for b in LEG]
    assert lighter == pytest.approx([0.0, 0.2, 0.3])


@pytest.mark.parametrize("scene", ["finger", "exosuit"])
def test_the_time_step_resolves_every_piece(scene: str) -> None:
    m, _ = load(scene)
    for limits in step_limits(m).values():
        assert min(limits) > 3.5 * m.opt.timestep


@pytest.mark.parametrize("knee", [-0.4, -1.1])
def test_hip_and_knee_feel_the_pieces_that_pass_them(knee: float) -> None:
    """As the winch pulls, the piece at the hip has more than that at the knee."""
    m, d = load()
    for joint, angle in (("hip", 0.3), ("knee", knee)):
        d.joint(joint).qpos[0] = angle
    settle(m, d)
    for name, angle in (("wearer", 0.3), ("wearer_knee", knee)):
        d.actuator(name).ctrl[0] = angle
    for torque in np.linspace(0.0, 2.0, 1200):
        d.actuator("motor").ctrl[0] = torque
        mujoco.mj_step(m, d)
    reading = read(m, d, "thigh")
    assert np.all(reading.slip[reading.slip != 0] == -1)
    friction = from_mjcf(m)["thigh"].friction
    loss = np.log(reading.tension_proximal / reading.tension_distal)
    assert loss == pytest.approx(friction * route_wrap(m, d, "thigh"), rel=1e-2)
    assert loss > 0.1
    torque = felt(m, d)
    hip, knee_arm = (lever(m, d, joint) for joint in ("hip", "knee"))
    assert torque["hip"] == pytest.approx(hip * reading.tension_proximal, rel=2e-3)
    assert torque["knee"] == pytest.approx(knee_arm * reading.tension_distal, rel=2e-3)


def lever(m: mujoco.MjModel, d: mujoco.MjData, joint: str) -> float:
    """Return the shortening of the thigh's tendon with a joint [m/rad]."""
    e, step, found = mujoco.MjData(m), 1e-5, []
    for side in (-step, step):
        e.qpos[:] = d.qpos
        e.joint(joint).qpos[0] += side
        mujoco.mj_fwdPosition(m, e)
        found.append(float(e.tendon("thigh").length[0]))
    return (found[0] - found[1]) / (2.0 * step)


def test_the_conduit_to_the_heel_leaves_hip_and_knee_alone() -> None:
    m, d = load()
    for torque in np.linspace(0.0, 6.0, 1200):
        d.actuator("motor_ankle").ctrl[0] = torque
        mujoco.mj_step(m, d)
    pull = read(m, d, "heel").tension_distal
    assert pull > 150.0
    after = felt(m, d)
    assert after["ankle"] == pytest.approx(-0.12 * pull, rel=5e-3)
    assert read(m, d, "thigh").tension_proximal == 0.0  # nobody winds it
    assert [after["hip"], after["knee"]] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_ends_take_up_and_give_back_the_work_that_was_measured() -> None:
    """Yandell et al. 2017, see the scene; the work is that of joints and tensions."""
    m, d = load()
    drum, ankle = d.joint("motor_ankle"), d.joint("ankle")
    own, log = from_mjcf(m)["heel"], []
    d.actuator("wearer_ankle").ctrl[0] = ankle.qpos[0] = 0.2
    settle(m, d)
    steps = 4000  # slow: 4 s, up and down
    for k in range(steps):
        share = k / steps
        d.actuator("wearer_ankle").ctrl[0] = 0.2 - 0.4 * share
        d.actuator("motor_ankle").ctrl[0] = 7.4 * min(2.0 * share, 2.0 - 2.0 * share)
        for _ in range(2):
            mujoco.mj_step(m, d)
        reading = read(m, d, "heel")
        mean = reading.tension.mean()
        stretch = own.length * mean / own.axial_stiffness
        given = 0.025 * drum.qpos[0] - stretch  # past the mouth
        log.append((reading.tension_distal, given, -d.tendon("heel").length[0]))
    pull, given, used = np.array(log).T
    peak = int(np.argmax(pull))
    assert pull[peak] == pytest.approx(250.0, rel=0.1)
    taken = given - used  # by the ends
    used_up, taken_up, used_all, taken_all = (
        np.trapezoid(pull[part], path[part])
        for part in (slice(peak + 1), slice(None))
        for path in (used, taken)
    )
    assert taken_up / (used_up + taken_up) == pytest.approx(0.55, abs=0.05)
    assert taken_all < 0.5 * taken_up  # most comes back
    assert used_all / (used_all + taken_all) == pytest.approx(0.75, abs=0.05)
