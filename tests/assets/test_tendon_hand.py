"""The hand of four tendons: what bends take, and what a finger's joints share."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.plugin import from_mjcf, read, route_wrap, settle, step_limits

Array = NDArray[np.float64]

FINGERS = ("index", "middle")
JOINTS = [f"{finger}_{joint}" for finger in FINGERS for joint in ("mcp", "pip")]
TENDONS = [f"{finger}_{way}" for finger in FINGERS for way in ("flexor", "extensor")]


def load() -> tuple[mujoco.MjModel, mujoco.MjData]:
    m = mujoco.MjModel.from_xml_path(str(scene_path("hand")))
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    return m, d


def hold(m: mujoco.MjModel) -> None:
    """Make whoever moves the fingers stiff."""
    for joint in JOINTS:
        mover = m.actuator(f"wearer_{joint}")
        mover.gainprm[0], mover.biasprm[1], mover.biasprm[2] = 100.0, -100.0, -0.1


def felt(m: mujoco.MjModel, d: mujoco.MjData, joint: str) -> float:
    """Torque of all tendons at a joint [N m]."""
    torque = d.qfrc_actuator + d.qfrc_passive - d.qfrc_spring - d.qfrc_damper
    mover = d.actuator(f"wearer_{joint}").force[0]
    return float(torque[m.joint(joint).dofadr[0]] - mover)


def arm(m: mujoco.MjModel, d: mujoco.MjData, tendon: str, joint: str) -> float:
    """Torque of a tendon at a joint per pull, without friction [m]."""
    e, step, found = mujoco.MjData(m), 1e-5, []
    for side in (-step, step):
        e.qpos[:] = d.qpos
        e.joint(joint).qpos[0] += side
        mujoco.mj_fwdPosition(m, e)
        found.append(float(e.tendon(tendon).length[0]))
    return (found[0] - found[1]) / (2.0 * step)


def pose(m: mujoco.MjModel, d: mujoco.MjData, mcp: float, pip: float) -> None:
    """Bring all fingers to angles [rad], tendons at pretension."""
    mujoco.mj_resetData(m, d)
    for joint in JOINTS:
        d.joint(joint).qpos[0] = pip if joint.endswith("pip") else mcp
        d.actuator(f"wearer_{joint}").ctrl[0] = d.joint(joint).qpos[0]
    mujoco.mj_fwdPosition(m, d)
    for tendon in TENDONS:
        rest = m.tendon_length0[m.tendon(tendon).id]
        gained = (d.tendon(tendon).length[0] - rest) / 0.008
        d.joint(f"drum_{tendon}").qpos[0] = -gained
    settle(m, d)


def pull(m: mujoco.MjModel, d: mujoco.MjData, **torques: float) -> None:
    """Raise the torques of winches steadily."""
    for share in np.linspace(0.0, 1.0, 1200):
        for tendon, torque in torques.items():
            d.actuator(f"motor_{tendon}").ctrl[0] = share * torque
        mujoco.mj_step(m, d)


def test_the_sections_are_what_is_drawn() -> None:
    m, d = load()
    for name, cable in from_mjcf(m).items():
        assert cable.length == pytest.approx(d.tendon(name).length[0], rel=2e-3)
        assert cable.wrap == pytest.approx(route_wrap(m, d, name), rel=1e-2)


def test_all_begin_at_pretension_without_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    m, d = load()
    for name, cable in from_mjcf(m).items():
        assert read(m, d, name).tension == pytest.approx(cable.pretension)
    mujoco.mj_step(m, d, 200)
    assert not Path("MUJOCO_LOG.TXT").exists()
    assert all(warning.number == 0 for warning in d.warning)


def test_the_time_step_resolves_every_piece_in_every_pose() -> None:
    m, d = load()
    assert min(min(limits) for limits in step_limits(m).values()) > 2 * m.opt.timestep
    for mcp in np.linspace(-0.5, 1.0, 4):
        for pip in np.linspace(-0.7, 1.0, 4):
            pose(m, d, float(mcp), float(pip))
            for limits in step_limits(m, d).values():
                assert min(limits) > 2.5 * m.opt.timestep


def test_arms_are_those_of_the_comment() -> None:
    m, d = load()
    for finger in FINGERS:
        found = [
            [
                1e3 * arm(m, d, f"{finger}_{way}", f"{finger}_{joint}")
                for joint in ("mcp", "pip")
            ]
            for way in ("flexor", "extensor")
        ]
        assert np.allclose(found, [[10.8, 8.5], [-8.6, -3.6]], atol=0.06)
    other = {"index": "middle", "middle": "index"}
    for tendon in TENDONS:
        finger = tendon.split("_")[0]
        assert arm(m, d, tendon, f"{other[finger]}_mcp") == 0.0


def test_no_path_jumps_within_the_stops_and_a_little_beyond() -> None:
    m, d = load()
    mcp, pip = np.linspace(-0.6, 1.3, 60), np.linspace(-0.8, 1.3, 60)
    lengths = np.empty((mcp.size, pip.size, len(TENDONS)))
    for i, one in enumerate(mcp):
        for j, other in enumerate(pip):
            for finger in FINGERS:
                d.joint(f"{finger}_mcp").qpos[0] = one
                d.joint(f"{finger}_pip").qpos[0] = other
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_tendon(m, d)
            lengths[i, j] = [d.tendon(tendon).length[0] for tendon in TENDONS]
    for axis, angles in ((0, mcp), (1, pip)):
        slopes = np.abs(np.diff(lengths, axis=axis)) / (angles[1] - angles[0])
        assert slopes.max() < 0.02


@pytest.mark.parametrize("tendon", TENDONS)
@pytest.mark.parametrize(("mcp", "pip"), [(0.0, 0.0), (0.6, 0.7), (-0.4, -0.5)])
def test_a_winch_pulls_with_the_loss_of_the_bends(
    tendon: str, mcp: float, pip: float
) -> None:
    m, d = load()
    hold(m)
    pose(m, d, mcp, pip)
    pull(m, d, **{tendon: 0.2})
    reading, friction = read(m, d, tendon), from_mjcf(m)[tendon].friction
    assert reading.tension_proximal == pytest.approx(0.2 / 0.008, rel=1e-2)
    loss = np.log(reading.tension_proximal / reading.tension_distal)
    assert loss == pytest.approx(friction * route_wrap(m, d, tendon), rel=5e-2)
    finger, way = tendon.split("_")
    # The pieces that pass the joints have tensions between those of the ends.
    for joint in (f"{finger}_mcp", f"{finger}_pip"):
        tension = felt(m, d, joint) / arm(m, d, tendon, joint)
        assert 0.99 * reading.tension_distal < tension < reading.tension_proximal
    if way == "extensor":
        pulled = -0.0036 * reading.tension_distal
        assert felt(m, d, f"{finger}_pip") == pytest.approx(pulled, rel=5e-3)
    others = [joint for joint in JOINTS if not joint.startswith(finger)]
    assert [felt(m, d, joint) for joint in others] == pytest.approx([0, 0], abs=1e-12)


def test_two_tendons_load_one_joint_and_spare_the_other() -> None:
    """The tasks of the description: a torque at pip, none at mcp."""
    m, d = load()
    hold(m)
    arms = np.array(
        [
            [
                arm(m, d, f"index_{way}", f"index_{joint}")
                for way in ("flexor", "extensor")
            ]
            for joint in ("pip", "mcp")
        ]
    )
    pulls = np.linalg.solve(arms, [0.05, 0.0])
    assert np.all(pulls > 0.0)
    torques = {}
    for way, tension in zip(("flexor", "extensor"), pulls, strict=True):
        cable = from_mjcf(m)[f"index_{way}"]
        torques[f"index_{way}"] = 0.008 * tension * np.exp(cable.friction * cable.wrap)
    pull(m, d, **torques)
    limit = m.actuator("motor_index_flexor").ctrlrange[1]
    assert max(torques.values()) < 0.6 * limit
    assert felt(m, d, "index_pip") == pytest.approx(0.05, rel=0.3)
    # One alone would give 0.13 N m there.
    assert abs(felt(m, d, "index_mcp")) < 0.03


def test_payed_out_tendons_leave_the_fingers_alone() -> None:
    m, d = load()
    for tendon in TENDONS:
        d.actuator(f"motor_{tendon}").ctrl[0] = -0.02
    mujoco.mj_step(m, d, 400)
    assert [felt(m, d, joint) for joint in JOINTS] == pytest.approx([0] * 4, abs=1e-12)
    assert all(read(m, d, tendon).slack > 1e-3 for tendon in TENDONS)


def test_four_motors_at_random_torques_leave_the_hand_stable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    m, d = load()
    rng = np.random.default_rng(1)
    motors = [m.actuator(f"motor_{tendon}").id for tendon in TENDONS]
    movers = [m.actuator(f"wearer_{joint}").id for joint in JOINTS]
    for step in range(6000):
        if step % 150 == 0:
            d.ctrl[motors] = rng.uniform(-0.1, 0.4, 4)
            d.ctrl[movers] = rng.uniform(-0.5, 0.6, 4)
        mujoco.mj_step(m, d)
    assert np.isfinite(d.qpos).all()
    assert all(warning.number == 0 for warning in d.warning)
    assert not Path("MUJOCO_LOG.TXT").exists()
    # Left alone, everything comes to rest: nothing is fed by the time step.
    d.ctrl[:] = 0.0
    mujoco.mj_step(m, d, 8000)
    assert np.abs(d.qvel).max() < 1e-3
