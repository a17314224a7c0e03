"""Pieces of an open path are as stiff as they are short, and lose no cable."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco.plugin import read, settle, step_limits, stored_energy, tendon_report
from plugin.mechanisms import drawn, loop
from plugin.open_scenes import TIED, end, instance, scene
from plugin.tendon_chain import Chain

STIFFNESS, PRETENSION, RADIUS = 20000.0, 100.0, 0.05


def hoist(length: float, **keys: object) -> mujoco.MjModel:
    """Return a hook that hangs on a drum by a straight rope."""
    world = (
        '<body pos="0.3 0 0"><joint name="drum" axis="0 1 0" armature="0.1"/>'
        '<geom size="0.02" mass="0.1"/></body><site name="out"/>'
        f'<body pos="0 0 {-length}"><joint name="hook" type="slide" axis="0 0 1"/>'
        '<geom size="0.02" mass="10"/><site name="hook"/></body>'
    )
    given = {
        "conduit": f"{length}:inf", "segments": 1, "friction": 0.1, "ends": "explicit",
        "axial_stiffness": STIFFNESS, "pretension": PRETENSION,
    }  # fmt: skip
    return mujoco.MjModel.from_xml_string(
        scene(
            world, '<site site="out"/><site site="hook"/>',
            end("joint", "drum", -RADIUS) + end("tendon", "rope", 1),
            instance(**(given | keys)),
        )
    )  # fmt: skip


def put(m: mujoco.MjModel, d: mujoco.MjData, wound: float, up: float) -> float:
    """Wind the drum so far [m], with the hook so high [m]; tension of the rope."""
    d.qpos[:], d.qvel[:] = [wound / RADIUS, up], 0.0
    mujoco.mj_step(m, d)
    return float(read(m, d, "rope").tension_proximal)


SOFT = {"end_compliance": 2e-6, "end_hardening": 0.02}


@pytest.mark.parametrize(
    "more",
    [{}, {"end_compliance": 2e-6}, SOFT, SOFT | {"end_loss": 0.3}],
    ids=["hard", "spring", "hardening", "lossy"],
)
def test_a_hoisted_hook_hangs_on_the_spring_of_the_rope_that_is_left(
    more: dict[str, float],
) -> None:
    m = hoist(2.0, **more)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    for up in np.linspace(0.0, 1.8, 200):
        tension = put(m, d, up, up)
        assert tension == pytest.approx(PRETENSION, rel=1e-5)
    lowered = put(m, d, 1.8, 1.8 - 1e-5) - tension
    left = 0.2 / (1.0 + PRETENSION / STIFFNESS)
    spring = more.get("end_compliance", 0.0)
    spring /= 1.0 + more.get("end_hardening", 0.0) * PRETENSION
    soft = left / STIFFNESS + spring
    # Where stiffness depends on tension, a step is right to 1e-5 of the tension.
    assert lowered == pytest.approx(1e-5 / soft, rel=2e-3 if more else 1e-4)
    # Step limits know the pose.
    whole, short = step_limits(m, mujoco.MjData(m)), step_limits(m, d)
    if not more:
        shorter = (short["rope"].pieces / whole["rope"].pieces) ** 2
        assert shorter == pytest.approx(0.1, rel=1e-2)


def test_a_rope_in_a_soft_anchor_is_as_long_as_rope_and_anchor_let_it() -> None:
    more = {"end_compliance": 2e-5, "end_hardening": 0.02, "end_loss": 0.3}
    m = hoist(2.0, **more)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    start = stored_energy(m, d, "rope")
    low = -2e-2 * np.sin(np.linspace(0.0, np.pi, 801))
    tension = np.array([put(m, d, 0.0, at) for at in low])
    held = np.full_like(tension, PRETENSION)
    for k in range(1, tension.size):
        held[k] = min(max(held[k - 1], tension[k]), tension[k] / 0.55)
    given = np.log(1.0 + 0.02 * np.stack([tension, held]))
    spring = 2e-5 / 0.02 * np.array([1 / 3, 2 / 3]) @ given
    rope = (2.0 - low - spring) / (1.0 + tension / STIFFNESS)
    assert rope == pytest.approx(rope[0], abs=1e-7)
    heat = read(m, d, "rope").dissipated
    assert heat > 0.01
    work = -np.trapezoid(tension, low)
    kept = stored_energy(m, d, "rope") - start + heat
    assert work == pytest.approx(kept, rel=1e-4)


@pytest.mark.parametrize(
    "more",
    [{"end_compliance": 2e-5}, {"bedding_strain": 1e-2, "bedding_tension": 30.0},
     SOFT, SOFT | {"end_loss": 0.3}],
    ids=["spring", "bedding", "hardening", "lossy"],
)  # fmt: skip
def test_slack_longer_than_its_piece_comes_back(more: dict[str, float]) -> None:
    """Nothing is wound under tension, so the drum gives back what it took."""
    m = hoist(0.05, pretension=0.0, **more)
    tensions = []
    for slack in (0.0, 0.2):
        d = mujoco.MjData(m)
        mujoco.mj_forward(m, d)
        for turn in np.linspace(0.0, 2.0 * np.pi, 400):
            put(m, d, 0.5 * slack * (np.cos(turn) - 1.0), 0.0)
            assert read(m, d, "rope").tension_proximal < 1e-6
        tensions.append(put(m, d, 0.0, -2e-4))
    assert tensions[0] > 5.0
    assert tensions[1] == pytest.approx(tensions[0], rel=1e-6)


def test_limits_hold_in_every_pose_over_the_ranges_of_the_joints() -> None:
    """The hook has 0.2 m of 2 m of rope left where it is highest."""
    m = hoist(2.0)
    m.jnt_limited[1], m.jnt_range[1] = 1, (-0.5, 1.8)
    here, anywhere = step_limits(m, mujoco.MjData(m)), step_limits(m)
    shorter = (anywhere["rope"].pieces / here["rope"].pieces) ** 2
    assert shorter == pytest.approx(0.1, rel=1e-2)
    assert anywhere["rope"][:2] == here["rope"][:2]
    (summary,) = tendon_report(m, "rope").tendons
    assert summary.step_limit == anywhere["rope"].pieces


def test_a_drum_that_goes_to_and_fro_brings_the_rope_back() -> None:
    m = hoist(1.0)
    d = mujoco.MjData(m)
    for turn in np.linspace(0.0, 20.0 * np.pi, 800):
        wound = 0.1 - 0.1 * np.cos(turn)
        tension = put(m, d, wound, wound + 2e-3 * np.cos(3.0 * turn) - 2e-3)
    assert tension == pytest.approx(PRETENSION, rel=1e-6)


def test_rope_wound_again_at_another_load_stays_as_it_is_from_then_on() -> None:
    m = hoist(1.0)
    d = mujoco.MjData(m)
    turns = []
    for _ in range(4):
        for part in np.linspace(0.0, 2.0 * np.pi, 800):
            wound = -0.2 * np.sin(part)
            tension = put(m, d, wound, wound + 2e-3 * np.cos(3.0 * part) - 2e-3)
        turns.append(tension)
    # The rope went out at the pretension and came back at more.
    assert turns[0] < 0.99 * PRETENSION
    assert turns[1:] == pytest.approx(turns[:1] * 3, rel=1e-3)


def test_a_hook_moves_by_what_the_drum_winds_and_heats_only_at_another_load() -> None:
    m = hoist(2.0, axial_stiffness=500.0)  # 20 % of strain at the pretension
    d = mujoco.MjData(m)
    low = -(2.0 / 1.2) * 0.4  # at three times the pretension
    for up in np.linspace(0.0, low, 100):
        put(m, d, 0.0, up)
    for wound in (*np.linspace(0.0, 1.0, 100), *np.linspace(1.0, 0.5, 50)):
        tension = put(m, d, wound, low + wound)
        assert tension == pytest.approx(3.0 * PRETENSION, rel=1e-6)
    assert read(m, d, "rope").dissipated == pytest.approx(0.0, abs=1e-9)
    left = 2.0 / 1.2 - 0.5 / 1.6  # unstretched, and the hook hangs on 1.6 times that
    for strain in np.linspace(0.6, 0.2, 100):
        put(m, d, 0.5, 2.0 - left * (1.0 + strain))
    for wound in np.linspace(0.5, 0.2, 50):
        given = left + (0.5 - wound) / 1.6
        tension = put(m, d, wound, 2.0 - 1.2 * given)
        assert tension == pytest.approx(PRETENSION, rel=1e-6)
    # EA (strain - strain)^2 / 2 for all rope that left.
    heat = 0.5 * 500.0 * (0.6 - 0.2) ** 2 * 0.3 / 1.6
    assert read(m, d, "rope").dissipated == pytest.approx(heat, rel=1e-5)


@pytest.mark.parametrize("seed", [1, 4])
def test_without_friction_tension_is_that_of_the_whole_path(seed: int) -> None:
    """Over geoms that turn too, after many small steps: T = EA (L / M - 1)."""
    free = drawn(seed, friction=0.0)
    m = free.model
    d = mujoco.MjData(m)
    poses = loop(m, seed, 120)
    d.qpos[:] = poses[0]
    settle(m, d)
    stiffness, pretension = 1500.0, 100.0
    cable = d.ten_length[0] / (1.0 + pretension / stiffness)
    for k in range(240):
        d.qpos[:], d.qvel[:] = poses[k % 120], 0.0
        mujoco.mj_step(m, d)
        whole = stiffness * (d.ten_length[0] / cable - 1.0)
        if whole > 0.0:
            tension = read(m, d, "rope").tension
            assert tension == pytest.approx(whole, rel=1e-3, abs=1e-2)
            energy = 0.5 * whole**2 / stiffness * cable
            assert stored_energy(m, d, "rope") == pytest.approx(
                energy, rel=2e-3, abs=1e-4
            )
        else:
            lies = cable - d.ten_length[0]
            assert read(m, d, "rope").slack == pytest.approx(lies, rel=1e-2, abs=1e-4)


SITES = ["a", "b", "c", "e"]


def guides(friction: float) -> mujoco.MjModel:
    """Return a rope over sites of which two move, so that lengths change by half."""
    world = (
        '<site name="a" pos="-0.3 0 0"/><site name="b" pos="-0.1 0 0.1"/>'
        '<body><joint name="x" type="slide" axis="1 0 0"/>'
        '<geom size="0.01" mass="1"/><site name="c" pos="0.1 0 -0.05"/></body>'
        '<body><joint name="y" type="slide" axis="1 0 0"/>'
        '<geom size="0.01" mass="1"/><site name="e" pos="0.3 0 0"/></body>'
    )
    path = "".join(f'<site site="{name}"/>' for name in SITES)
    probe = mujoco.MjModel.from_xml_string(scene(world, path, "", ""))
    cable = instance(
        friction=friction, conduit=f"{probe.tendon_length0[0]}:inf", segments=2,
        axial_stiffness=3000, pretension=50, ends="explicit",
    )  # fmt: skip
    return mujoco.MjModel.from_xml_string(scene(world, path, TIED, cable))


@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_tensions_over_guides_that_move_are_those_of_the_chain(friction: float) -> None:
    """Through turns in which the middle piece is half and one and a half as long."""
    m = guides(friction)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    referee = Chain(m, d, SITES, stiffness=3000.0, pretension=50.0, friction=friction)
    ours, true = [], []
    for turn in np.linspace(0.0, 2.5 * np.pi, 800):
        d.qpos[:] = [0.1 * np.sin(turn), 0.09 * np.sin(turn) + 0.004 * np.sin(3 * turn)]
        d.qvel[:] = 0.0
        mujoco.mj_step(m, d)
        ours.append(read(m, d, "rope").tension)
        true.append(referee.tension(d, 0.0))
    error = np.sqrt(np.mean((np.array(ours) - true) ** 2, axis=0))
    assert np.all(error < 5e-3 * np.abs(true).max(axis=0))


def test_a_piece_that_becomes_too_short_for_the_step_is_warned_of_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    m = hoist(2.5)
    d = mujoco.MjData(m)
    m.opt.timestep = 0.6 * min(step_limits(m, d)["rope"])
    put(m, d, 0.0, 0.0)
    assert "stable only" not in capfd.readouterr().err
    for up in np.linspace(0.0, 2.45, 50):
        put(m, d, up, up)
    assert capfd.readouterr().err.count("is stable only with a `timestep`") == 1


def test_a_cable_takes_the_place_of_a_spring_that_is_a_tendon() -> None:
    """As the refusal of a tendon with a `stiffness` says."""
    stiffness, unstretched, turn = 500.0, 0.6, 1.0
    world = (
        '<site name="thigh" pos="-0.12 0 -0.15"/><geom name="roller" type="cylinder" '
        'size="0.1 0.12" pos="0 0 0.12" zaxis="0 1 0"/>'
        '<site name="back" pos="-0.14 0 0.12"/><body pos="0 0 0.12">'
        '<joint name="flexion" axis="0 1 0" armature="1e7"/>'
        '<geom size="0.09" mass="1e-9"/><site name="shoulder" pos="-0.11 0 0.38"/>'
        "</body>"
    )
    band = (
        '<site site="shoulder"/><geom geom="roller" sidesite="back"/>'
        '<site site="thigh"/>'
    )
    option = 'gravity="0 0 0" timestep="0.002"'
    probe = mujoco.MjModel.from_xml_string(scene(world, band, "", "", option))
    length = float(probe.tendon_length0[0])
    cable = instance(
        friction=0,
        conduit=f"{length}:inf",
        segments=8,
        axial_stiffness=stiffness * unstretched,
        pretension=stiffness * (length - unstretched),
    )
    m = mujoco.MjModel.from_xml_string(scene(world, band, TIED, cable, option))
    d = mujoco.MjData(m)
    d.qvel[0] = turn
    for _ in range(500):
        mujoco.mj_step(m, d)
    mujoco.mj_forward(m, d)
    spring = stiffness * (d.ten_length[0] - unstretched)
    assert spring > 1.2 * stiffness * (length - unstretched)
    lever = d.ten_J.ravel()[0]
    pulled = d.qfrc_passive[0] + d.qfrc_actuator[0]
    assert pulled == pytest.approx(-spring * lever, rel=1e-4)
