"""Cables on open paths: laws of pulleys, and each piece with its own tension."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section
from cc_mujoco.plugin import (
    read,
    route_wrap,
    segment_wrap,
    settle,
    stored_energy,
    to_mjcf,
)
from plugin.open_scenes import TIED, atwood, belt, instance, scene, tackle, winch
from plugin.tendon_chain import Chain
from study_marks import study_but

GRAVITY = 9.81


def slope(m: mujoco.MjModel, d: mujoco.MjData, seconds: float) -> np.ndarray:
    """Mean acceleration of every joint, once the rope has stretched [m/s^2]."""
    count = round(seconds / m.opt.timestep)
    speed = np.empty((count, m.nv))
    for row in speed:
        mujoco.mj_step(m, d)
        row[:] = d.qvel
    part = speed[count // 4 :]
    time = np.arange(len(part)) * m.opt.timestep
    return np.polyfit(time, part, 1)[0]


@pytest.mark.parametrize("friction", [0.02, 0.05, 0.08, 0.13, 0.25])
def test_atwoods_machine_over_a_pulley_that_turns(friction: float) -> None:
    """The rope drives the pulley up to the capstan ratio exp(friction pi)."""
    masses, inertia, radius = (1.0, 2.0), 0.02, 0.1
    cap = math.exp(friction * math.pi)
    a, b = masses
    together = (b - a) * GRAVITY / (a + b + inertia / radius**2)
    ratio = b * (GRAVITY - together) / (a * (GRAVITY + together))
    sliding = (b - cap * a) * GRAVITY / (b + cap * a)
    wanted = together if ratio <= cap else sliding
    difference = b * (GRAVITY - wanted) - a * (GRAVITY + wanted)
    m = atwood(friction, masses, inertia, axial_stiffness=60000)
    d = mujoco.MjData(m)
    wheel, up, down = slope(m, d, 0.3)
    assert up == pytest.approx(wanted, rel=5e-3)
    assert -down == pytest.approx(wanted, rel=5e-3)
    assert wheel == pytest.approx(difference * radius / inertia, rel=5e-3)
    assert (ratio > cap) == (friction < 0.09)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.2])
@pytest.mark.parametrize("way", [1, -1])
def test_a_winch_lifts_by_the_capstan_ratio_of_all_its_posts(
    friction: float, way: int
) -> None:
    m = winch(friction, 2.0)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    wrap = route_wrap(m, d, "rope")
    assert wrap == pytest.approx(segment_wrap(m, d, "rope").sum(), rel=1e-9)
    assert wrap > 4.0
    need = 2.0 * GRAVITY * math.exp(way * friction * wrap) * 0.05
    for share in np.linspace(0.0, 1.0, 2500):
        d.ctrl[0] = share * (need + way * 0.05)
        mujoco.mj_step(m, d)
    mujoco.mj_step(m, d, 2500)
    reading = read(m, d, "rope")
    if friction:
        assert np.all(reading.slip[segment_wrap(m, d, "rope") > 1e-6] == -way)
    ratio = math.log(reading.tension_proximal / reading.tension_distal)
    assert ratio == pytest.approx(way * friction * route_wrap(m, d, "rope"), abs=2e-6)
    assert d.qvel[1] * way > 0.0


def finger(friction: float, timestep: float = 5e-4) -> tuple[mujoco.MjModel, list[str]]:
    """Three joints and a tendon over two sites on each link, wound on a drum."""
    lengths = (0.045, 0.03, 0.025)
    sites = ["root"] + [f"{name}{i}" for i in range(3) for name in ("near", "far")]
    link = ""
    for i in (2, 1, 0):
        size = lengths[i]
        at = f"{lengths[i - 1]} 0 0" if i else "0 0 0"
        link = (
            f'<body pos="{at}"><joint name="j{i}" axis="0 -1 0" damping="0.002" '
            'armature="2e-5" stiffness="0.05"/><geom type="capsule" size="0.006" '
            f'fromto="0 0 0 {size} 0 0" mass="0.02"/>'
            f'<site name="near{i}" pos="{0.3 * size} 0 -0.009"/>'
            f'<site name="far{i}" pos="{0.75 * size} 0 -0.009"/>{link}</body>'
        )
    path = "".join(f'<site site="{name}"/>' for name in sites)
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="{timestep}" gravity="0 0 0">'
        '<flag contact="disable"/></option><worldbody><body pos="-0.06 0 -0.03">'
        '<joint name="motor" axis="0 1 0" armature="2e-5" damping="1e-3"/>'
        '<geom size="0.005" mass="0.01"/></body><site name="root" '
        f'pos="-0.04 0 -0.012"/>{link}</worldbody><tendon><spatial name="rope">{path}'
        '</spatial></tendon><actuator><motor joint="motor"/></actuator></mujoco>'
    )
    if friction < 0.0:
        return spec.compile(), sites
    cable = Cable(
        friction=friction,
        axial_stiffness=3000.0,
        pretension=5.0,
        segments=5,
        conduit=(Section(float(spec.copy().compile().tendon_length0[0]), math.inf),),
        route="rope",
        path="open",
    )
    to_mjcf(spec, "flexor", cable, ("motor", -0.01), (spec.tendon("rope"), 1.0))
    return spec.compile(), sites


def chain(m: mujoco.MjModel, sites: list[str], friction: float) -> Chain:
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    return Chain(m, d, sites, stiffness=3000.0, pretension=5.0, friction=friction)


@pytest.mark.parametrize("friction", study_but(2, [0.3, 0.1]))
def test_every_joint_of_a_finger_feels_the_pieces_that_pass_it(friction: float) -> None:
    """Through a motion of drum and joints, against a chain that knows no kernel."""
    m, sites = finger(friction)
    bare = finger(-1.0)[0]
    d, e = mujoco.MjData(m), mujoco.MjData(bare)
    mujoco.mj_forward(m, d)
    referee = chain(m, sites, friction)
    tensions, torques = [], []
    for t in np.arange(0.0, 2.4, 0.006):
        joints = [
            0.6 * (1.0 - math.cos(1.7 * t)),
            0.5 * (1.0 - math.cos(2.3 * t)),
            0.4 * math.sin(3.0 * t),
        ]
        # The drum lets go what the joints take up, and less at times.
        pose = [0.6 - 0.8 * sum(joints) + 0.2 * math.sin(5.0 * t), *joints]
        d.qpos[:], d.qvel[:] = pose, 0.0
        e.qpos[:], e.qvel[:] = pose, 0.0
        mujoco.mj_step(m, d)
        mujoco.mj_forward(bare, e)
        true = referee.tension(e, 0.01 * pose[0])
        tensions.append([read(m, d, "flexor").tension, true])
        felt = d.qfrc_actuator + d.qfrc_passive - e.qfrc_passive
        torques.append([felt[1:], referee.torque(e, true)[1:]])
    for ours, right in (np.moveaxis(np.array(a), 1, 0) for a in (tensions, torques)):
        error = np.sqrt(np.mean((ours - right) ** 2, axis=0))
        assert np.all(error < 1e-2 * np.abs(right).max(axis=0))
    ours = np.array(tensions)[:, 0]
    assert np.mean(np.ptp(ours, axis=1) > 0.1 * ours.max(axis=1)) > 0.1


def test_a_finger_closes_as_the_chain_says() -> None:
    """Compare a closing finger with the chain, the only cable of a simulation."""
    friction = 0.3
    m, sites = finger(friction, timestep=2e-4)
    bare = finger(-1.0, timestep=2e-4)[0]
    d, e = mujoco.MjData(m), mujoco.MjData(bare)
    mujoco.mj_forward(bare, e)
    referee = chain(bare, sites, friction)
    largest = worst = 0.0
    for step in range(900):
        pull = 0.12 * min(step / 400, 1.0) if step < 600 else 0.03
        d.ctrl[0] = e.ctrl[0] = pull
        mujoco.mj_step(m, d)
        mujoco.mj_kinematics(bare, e)
        mujoco.mj_comPos(bare, e)
        tension = referee.tension(e, 0.01 * e.qpos[0])
        e.qfrc_applied[:] = referee.torque(e, tension)
        e.qfrc_applied[0] -= 0.01 * tension[0]
        mujoco.mj_step(bare, e)
        worst = max(worst, np.abs(d.qpos[1:] - e.qpos[1:]).max())
        largest = max(largest, np.abs(e.qpos[1:]).max())
    assert largest > 0.5
    assert worst < 0.01 * largest


def test_what_another_joint_draws_is_felt_where_it_is_drawn() -> None:
    """The last joint moves alone: friction keeps its pull from the first piece."""
    m, _ = finger(0.3)
    d = mujoco.MjData(m)
    d.qpos[:] = [0.0, 0.6, 0.6, 0.6]
    settle(m, d)
    rest = mujoco.MjData(m)
    rest.qpos[:] = d.qpos
    mujoco.mj_forward(m, rest)
    d.qpos[3] -= 3e-4
    mujoco.mj_step(m, d)
    gained = read(m, d, "flexor").tension - 5.0
    before, after = (
        np.linalg.norm(x.site("near2").xpos - x.site("far1").xpos) for x in (rest, d)
    )
    piece = 3005.0 * (after / before - 1.0)  # EA and the pretension
    assert gained[4] == pytest.approx(piece, rel=1e-4)
    assert np.delete(gained, 4) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("friction", [0.03, 0.2])
def test_no_energy_is_lost_or_found(friction: float) -> None:
    """Masses, pulley, rope and friction together, better the shorter the step."""
    missing = []
    for timestep in (2e-4, 5e-5):
        m = atwood(friction, (1.0, 1.6), 0.02, timestep=timestep)
        d = mujoco.MjData(m)
        mujoco.mj_forward(m, d)
        start = d.energy.sum() + stored_energy(m, d, "rope")
        mujoco.mj_step(m, d, round(0.25 / timestep))
        mujoco.mj_energyVel(m, d)
        lost = read(m, d, "rope").dissipated
        mujoco.mj_forward(m, d)
        now = d.energy.sum() + stored_energy(m, d, "rope") + lost
        missing.append(abs(now - start))
        turned = abs(d.energy[1])
    assert missing[1] < 0.5 * missing[0] + 1e-6
    assert missing[1] < 2e-3 * turned


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.2])
def test_a_block_and_tackle_halves_the_pull_less_what_its_sheaves_take(
    friction: float,
) -> None:
    m = tackle(friction, 4.0)
    d = mujoco.MjData(m)
    ratio = math.exp(friction * math.pi)
    need = 4.0 * GRAVITY * ratio**2 / (1.0 + ratio)
    for share in np.linspace(0.0, 1.0, 2500):
        d.ctrl[0] = 0.05 * share * (need + 1.0)
        mujoco.mj_step(m, d)
    mujoco.mj_step(m, d, 5000)
    # Steady, but for the drum's and the load's own damping.
    assert d.qvel[1] > 0.0
    weight = 4.0 * GRAVITY + 20.0 * d.qvel[1]
    pull = read(m, d, "rope").tension_proximal
    assert pull == pytest.approx(weight * ratio**2 / (1.0 + ratio), rel=5e-3)


@pytest.mark.parametrize("share", [0.7, 1.5])
def test_a_belt_carries_a_torque_up_to_the_capstan_ratio(share: float) -> None:
    friction, pretension, inertia, radius = 0.2, 50.0, 0.01, 0.05
    m = belt(friction, pretension, inertia)
    d = mujoco.MjData(m)
    ratio = math.exp(friction * math.pi)
    most = 2.0 * pretension * (ratio - 1.0) / (ratio + 1.0) * radius
    for part in np.linspace(0.0, 1.0, 3000):
        d.ctrl[0] = share * most * part
        mujoco.mj_step(m, d)
    speed = d.qvel[0]
    mujoco.mj_step(m, d, 500)
    tension = read(m, d, "rope").tension
    tight, slack = max(tension[0], tension[5]), min(tension[0], tension[5])
    if share < 1.0:
        assert (tight - slack) * radius == pytest.approx(share * most, rel=2e-2)
        assert abs(d.qvel[0]) < 0.1
    else:
        assert tight / slack == pytest.approx(ratio, rel=5e-3)
        gained = (d.qvel[0] - speed) / (500 * m.opt.timestep)
        left = (share * most - (tight - slack) * radius) / inertia
        assert gained == pytest.approx(left, rel=1e-2)


def corner(sites: str) -> mujoco.MjModel:
    """Return a rope that turns by a right angle at sites in one place."""
    world = (
        '<site name="first" pos="-0.3 0 0"/><site name="at"/><site name="beside"/>'
        '<site name="on"/><body pos="0 0 -0.3"><joint type="slide" axis="0 0 1" '
        'damping="200"/><geom size="0.02" mass="4"/><site name="hook"/></body>'
    )
    path = "".join(f'<site site="{s}"/>' for s in ("first", *sites.split(), "hook"))
    cable = instance(friction=0.2, axial_stiffness=2000, conduit="0.6:inf")
    return mujoco.MjModel.from_xml_string(scene(world, path, TIED, cable))


@pytest.mark.parametrize("sites", ["at", "at beside", "at beside on"])
def test_sites_in_one_place_rub_as_one(sites: str) -> None:
    m = corner(sites)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert segment_wrap(m, d, "rope").sum() == pytest.approx(math.pi / 2)
    assert route_wrap(m, d, "rope") == pytest.approx(math.pi / 2)
    mujoco.mj_step(m, d, 5000)
    reading = read(m, d, "rope")
    ratio = reading.tension_proximal / reading.tension_distal
    assert -math.log(ratio) == pytest.approx(0.1 * math.pi, rel=0.05)
