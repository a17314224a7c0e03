"""The bilateral exosuit: mirrored legs, six motors, and joints that share cables."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD
from cc_mujoco.plugin import from_mjcf, read, route, route_wrap, settle, step_limits

Array = NDArray[np.float64]

CABLES = {"hip": "hip_flexor", "knee": "knee_extensor", "ankle": "plantarflexor"}
"""Cable that the motor of each joint winds."""
SIDES = ("left", "right")
JOINTS = [f"{side}_{joint}" for side in SIDES for joint in CABLES]
PARTS = ("thigh", "shank", "foot")


def load(scene: str = "bilateral") -> tuple[mujoco.MjModel, mujoco.MjData]:
    m = mujoco.MjModel.from_xml_path(str(scene_path(scene)))
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    return m, d


def cable_of(joint: str) -> str:
    side, kind = joint.split("_")
    return f"{side}_{CABLES[kind]}"


def felt(m: mujoco.MjModel, d: mujoco.MjData) -> dict[str, float]:
    """Torques of all cables at the joints of the legs [N m]."""
    torque = d.qfrc_actuator + d.qfrc_passive - d.qfrc_spring - d.qfrc_damper
    return {
        joint: float(
            torque[m.joint(joint).dofadr[0]] - d.actuator(f"wearer_{joint}").force[0]
        )
        for joint in JOINTS
    }


def arm(m: mujoco.MjModel, d: mujoco.MjData, cable: str, joint: str) -> float:
    """Return the shortening of a cable's tendon with a joint [m/rad]."""
    e, step, found = mujoco.MjData(m), 1e-5, []
    for side in (-step, step):
        e.qpos[:] = d.qpos
        e.joint(joint).qpos[0] += side
        mujoco.mj_fwdPosition(m, e)
        found.append(float(e.tendon(cable).length[0]))
    return (found[0] - found[1]) / (2.0 * step)


def pose(phase: float) -> dict[str, float]:
    """Angles of level walking [rad]; the right leg leads by half a cycle."""
    return {
        f"{side}_{joint}": GAIT_ANGLES[joint]((phase + shift) % 1.0)
        for side, shift in (("left", 0.5), ("right", 0.0))
        for joint in CABLES
    }


def stand(m: mujoco.MjModel, d: mujoco.MjData, angles: dict[str, float]) -> None:
    """Bring a simulation to a pose at rest, with the cables at pretension."""
    mujoco.mj_resetData(m, d)
    for joint, angle in angles.items():
        d.joint(joint).qpos[0] = angle
        d.actuator(f"wearer_{joint}").ctrl[0] = angle
    mujoco.mj_fwdPosition(m, d)
    for joint in JOINTS:
        tendon = d.tendon(cable_of(joint)).length[0]
        rest = m.tendon_length0[m.tendon(cable_of(joint)).id]
        radius = -m.actuator(f"{cable_of(joint)}_proximal").gear[0]
        d.joint(f"drum_{joint}").qpos[0] = (rest - tendon) / radius
    settle(m, d)


def turn(d: mujoco.MjData, joint: str) -> float:
    """Angle by which the cable of a hip bends at its guide [rad]."""
    mouth, guide, anchor = (
        d.site(f"{joint}_{place}").xpos for place in ("mouth", "guide", "anchor")
    )
    before, after = (guide - mouth, anchor - guide)
    lengths = np.linalg.norm(before) * np.linalg.norm(after)
    return float(np.arccos(before @ after / lengths))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let MuJoCo write its log here."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_right_leg_is_the_mirror_image_of_the_left() -> None:
    m, d = load()
    mirror = np.array([1.0, -1.0, 1.0])
    for number, parts in ((m.nbody, m.body), (m.nsite, m.site), (m.ngeom, m.geom)):
        place = {m.body: d.xpos, m.site: d.site_xpos, m.geom: d.geom_xpos}[parts]
        for i in range(number):
            name = parts(i).name
            if name.startswith("left_"):
                other = parts(name.replace("left_", "right_")).id
                assert np.allclose(place[other], mirror * place[i], atol=1e-9), name
    for joint in JOINTS[:3]:
        d.joint(joint).qpos[0] = d.joint(joint.replace("left", "right")).qpos[0] = -0.3
    mujoco.mj_forward(m, d)
    for kind in CABLES.values():
        ours, theirs = d.tendon(f"left_{kind}"), d.tendon(f"right_{kind}")
        assert ours.length == pytest.approx(theirs.length, rel=1e-9)
        one, other = (from_mjcf(m)[f"{side}_{kind}"] for side in SIDES)
        named = one.route.replace("left", "right"), one.mouth.replace("left", "right")
        assert one.replace(route=named[0], mouth=named[1]) == other


@pytest.mark.parametrize("side", SIDES)
def test_a_leg_is_that_of_the_exosuit(side: str) -> None:
    ours, theirs = load()[0], load("exosuit")[0]
    for part in PARTS:
        one, other = ours.body(f"{side}_{part}"), theirs.body(part)
        assert one.mass == other.mass
        assert np.array_equal(one.inertia, other.inertia)
    for part in PARTS[1:]:
        assert np.array_equal(ours.body(f"{side}_{part}").pos, theirs.body(part).pos)
    movers = {"hip": "wearer", "knee": "wearer_knee", "ankle": "wearer_ankle"}
    for joint, mover in movers.items():
        one, other = ours.joint(f"{side}_{joint}"), theirs.joint(joint)
        assert np.array_equal(one.range, other.range)
        assert np.array_equal(one.axis, other.axis)
        one, other = ours.actuator(f"wearer_{side}_{joint}"), theirs.actuator(mover)
        assert np.array_equal(one.gainprm, other.gainprm)
        assert np.array_equal(one.biasprm, other.biasprm)


def test_the_sections_are_what_is_drawn() -> None:
    m, d = load()
    for name, cable in from_mjcf(m).items():
        line = route(m, d, name)
        if cable.mouth:
            inside = np.linalg.norm(line - d.site(cable.mouth).xpos, axis=1).argmin()
            line = line[: inside + 1]
        drawn = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert cable.length == pytest.approx(drawn, rel=1e-2)
        assert cable.wrap == pytest.approx(route_wrap(m, d, name), rel=1e-2)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_drum_winds_the_rope_that_leaves_it(joint: str) -> None:
    m, d = load()
    cable = cable_of(joint)
    free = m.geom(f"{cable}_free_proximal")
    along = d.geom(free.id).xmat.reshape(3, 3)[:, 2]
    ends = [d.geom(free.id).xpos + way * free.size[1] * along for way in (-1, 1)]
    exit_site = m.wrap_objid[m.tendon_adr[m.tendon(cable).id]]
    away = [np.linalg.norm(end - d.site_xpos[exit_site]) for end in ends]
    assert min(away) < 1e-4
    leaving = along if away[0] > away[1] else -along
    drum, axis = d.geom(f"{joint}_drum").xpos, d.joint(f"drum_{joint}").xaxis
    across = ends[int(np.argmax(away))] - drum
    across -= (across @ axis) * axis
    gear = m.actuator(f"{cable}_proximal").gear[0]
    assert np.cross(axis, across) @ leaving == pytest.approx(gear, rel=5e-3)
    assert np.linalg.norm(across) == pytest.approx(-gear, rel=5e-3)
    assert m.geom(f"{joint}_drum").size[0] == pytest.approx(-gear)


def test_all_begin_at_pretension_without_a_warning(folder: Path) -> None:
    m, d = load()
    for name, cable in from_mjcf(m).items():
        assert read(m, d, name).tension == pytest.approx(cable.pretension)
    for limits in step_limits(m).values():
        assert min(limits) > 3.5 * m.opt.timestep
    mujoco.mj_step(m, d, 200)
    assert not (folder / "MUJOCO_LOG.TXT").exists()
    assert all(warning.number == 0 for warning in d.warning)


@pytest.mark.parametrize("joint", JOINTS[3:])
@pytest.mark.parametrize("phase", [0.1, 0.7])
def test_a_motor_pulls_its_joint_with_the_loss_of_the_bends(
    joint: str, phase: float
) -> None:
    m, d = load()
    stand(m, d, pose(phase))
    limit = m.actuator(f"motor_{joint}").ctrlrange[1]
    for torque in np.linspace(0.0, limit, 1600):
        d.actuator(f"motor_{joint}").ctrl[0] = torque
        mujoco.mj_step(m, d)
    mujoco.mj_step(m, d, 200)
    name = cable_of(joint)
    cable, reading = from_mjcf(m)[name], read(m, d, name)
    assert np.all(reading.slip[reading.slip != 0] == -1)
    radius = -m.actuator(f"{name}_proximal").gear[0]
    assert reading.tension_proximal == pytest.approx(limit / radius, rel=1e-2)
    wrap = float(np.log(reading.tension_proximal / reading.tension_distal))
    assert 0.1 < wrap / cable.friction < 4.0
    torque = felt(m, d)
    pulled = arm(m, d, name, joint) * reading.tension_distal
    if "hip" in joint:
        # What passes the hip ends at the guide on the thigh, which takes its share.
        pulled *= np.exp(cable.friction * turn(d, joint))
    assert torque.pop(joint) == pytest.approx(pulled, rel=5e-3)
    if "knee" in joint:
        # The piece at the hip has the tension of the winch.
        hip = joint.replace("knee", "hip")
        pulled = arm(m, d, name, hip) * reading.tension_proximal
        assert torque.pop(hip) == pytest.approx(pulled, rel=5e-3)
        assert pulled > 20.0
    assert list(torque.values()) == pytest.approx([0.0] * len(torque), abs=1e-6)


def test_payed_out_cables_leave_the_legs_alone() -> None:
    m, d = load()
    for joint in JOINTS:
        d.actuator(f"motor_{joint}").ctrl[0] = -0.2
    mujoco.mj_step(m, d, 400)
    assert list(felt(m, d).values()) == pytest.approx([0.0] * 6, abs=1e-12)
    assert all(read(m, d, cable_of(joint)).slack > 1e-3 for joint in JOINTS)


def test_the_friction_of_the_heel_follows_hip_and_knee() -> None:
    m, d = load()
    found = []
    for phase in np.linspace(0.0, 1.0, 40):
        for joint, angle in pose(float(phase)).items():
            d.joint(joint).qpos[0] = angle
        mujoco.mj_forward(m, d)
        found.append(route_wrap(m, d, "right_plantarflexor"))
    assert (min(found), max(found)) == pytest.approx((1.1, 2.2), abs=0.1)


def test_walking_stays_clear_of_the_stops_and_of_the_treadmill() -> None:
    m, d = load()
    soles = [i for i in range(m.ngeom) if m.mat(m.geom_matid[i]).name == "sole"]
    deck = max(
        d.geom_xpos[i][2] + m.geom_size[i][2]
        for i in range(m.ngeom)
        if m.mat(m.geom_matid[i]).name == "deck"
    )
    for phase in np.linspace(0.0, 1.0, 50):
        for joint, angle in pose(float(phase)).items():
            low, high = m.joint(joint).range
            assert low + 0.1 < angle < high - 0.1
            d.joint(joint).qpos[0] = angle
        mujoco.mj_kinematics(m, d)
        for i in soles:
            half, turn = m.geom_size[i], d.geom_xmat[i].reshape(3, 3)[2]
            if m.geom_type[i] == mujoco.mjtGeom.mjGEOM_CYLINDER:
                half = np.array([half[0], half[0], half[1]])
            assert d.geom_xpos[i][2] - np.abs(turn) @ half > deck + 0.005


def test_six_motors_at_random_torques_leave_the_walk_stable() -> None:
    m, d = load()
    stand(m, d, pose(0.0))
    rng = np.random.default_rng(1)
    limits = np.array([m.actuator(f"motor_{joint}").ctrlrange[1] for joint in JOINTS])
    motors = [m.actuator(f"motor_{joint}").id for joint in JOINTS]
    for step in range(3000):
        if step % 200 == 0:
            d.ctrl[motors] = limits * rng.uniform(-1.0, 1.0, len(JOINTS))
        for joint, angle in pose(d.time / GAIT_PERIOD).items():
            d.actuator(f"wearer_{joint}").ctrl[0] = angle
        mujoco.mj_step(m, d)
    assert np.isfinite(d.qpos).all()
    assert all(warning.number == 0 for warning in d.warning)
    # Left alone, everything comes to rest: nothing is fed by the time step.
    d.ctrl[motors] = 0.0
    mujoco.mj_step(m, d, 6000)
    legs = [m.joint(joint).dofadr[0] for joint in JOINTS]
    assert np.abs(d.qvel[legs]).max() < 1e-3
