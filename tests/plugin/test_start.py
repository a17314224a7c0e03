"""Cables at rest in the present pose, and the longest stable time step."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cc_mujoco
from cc_mujoco.assets import scene_path
from cc_mujoco.cable._conduit import end_stiffness
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin import (
    cables,
    from_mjcf,
    read,
    settle,
    step_limits,
    tendon_report,
)
from plugin import damage
from plugin.open_scenes import atwood, winch
from plugin.scenes import (
    CONFIG,
    build,
    end,
    excitation,
    instance,
    model,
    pull_pull,
    run,
)

INTEGRATORS = ("Euler", "RK4", "implicitfast")
ROOT = Path(cc_mujoco.__file__).parents[1]
angles = st.floats(-2.5, 2.5)
TENDON = model(
    instance("flexor", CONFIG | {"eccentricity": "0.003", "bedding_strain": "1e-3"})
    + instance("pull", CONFIG | {"pretension": "25", "segments": "7"}),
    end("one", "flexor", 'joint="motor"', -0.02)
    + end("two", "flexor", 'joint="wrist"', -0.05)
    + end("three", "pull", 'joint="motor"', 0.03)
    + end("four", "pull", 'tendon="path"', 1.0),
)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@settings(deadline=None, derandomize=True, max_examples=25)
@given(motor=angles, wrist=angles, sledge=st.floats(-0.4, 0.4), past=st.booleans())
def test_settled_cables_have_their_pretension_in_any_pose(
    integrator: str, motor: float, wrist: float, sledge: float, past: bool
) -> None:
    m, d = build(TENDON.replace("<option", f'<option integrator="{integrator}"'))
    if past:
        run(m, d, excitation(40))
    else:
        mujoco.mj_resetData(m, d)
    d.qvel[:] = 0.0
    d.qpos[:3] = motor, wrist, sledge
    settle(m, d)
    for _ in range(2):
        for name, pretension in (("flexor", 10.0), ("pull", 25.0)):
            reading = read(m, d, name)
            assert reading.tension == pytest.approx(pretension, rel=1e-9)
            assert reading.dissipated == 0.0
            assert reading.moving_fraction == 0.0
        mujoco.mj_step(m, d)  # commits the pose in which it begins
    assert np.abs(d.actuator_force[1:]).max() < 40.0


def mixed_rope() -> str:
    """Return a drum and a slide on a rope that leaves its conduit at `b`."""
    config = CONFIG | {
        "route": "rope", "path": "mixed", "mouth": "b", "conduit": "0.5:0.3",
        "friction": "0", "axial_stiffness": "20000",
    }  # fmt: skip
    return f"""<mujoco><extension><plugin plugin="cc_mujoco.cable">
      {instance("rope", config)}</plugin></extension><worldbody>
      <site name="a"/><site name="b" pos=".4 0 0"/><site name="c" pos=".5 0 .1"/>
      <body><joint name="drum" axis="0 1 0" armature="1e-2"/><geom size=".01"/></body>
      <body pos=".8 0 0"><joint name="sled" type="slide" axis="1 0 0"/>
        <geom size=".02"/><site name="d"/></body></worldbody>
      <tendon><spatial name="rope"><site site="a"/><site site="b"/><site site="c"/>
        <site site="d"/></spatial></tendon><actuator>
      {end("near", "rope", 'joint="drum"', -0.02)}
      {end("far", "rope", 'tendon="rope"', 1.0)}</actuator></mujoco>"""


KEPT: dict[str, tuple[Any, list[list[float]]]] = {
    "guided": (lambda: mujoco.MjModel.from_xml_string(
        TENDON.replace('"friction" value="0.15"', '"friction" value="0"')),
        [[0.3, 0.1, 0.05], [-0.4, -0.1, -0.02], [0.6, -0.3, 0.02]]),
    "open": (lambda: winch(0.0, 2.0), [[0.1, 0.01], [0.5, 0.02], [-0.4, 0.02]]),
    "around a pulley that turns": (lambda: atwood(0.0, (1.0, 2.0), 0.1),
        [[0.5, 0.02, -0.01], [-0.8, -0.001, -0.001]]),
    "mixed": (lambda: mujoco.MjModel.from_xml_string(mixed_rope()),
        [[0.2, 0.01], [-0.5, 0.0], [0.9, -0.01]]),
    "mixed, with clearance": (lambda: mujoco.MjModel.from_xml_string(
        mixed_rope().replace('"0.5:0.3"', '"0.3:0.3 0.2:0.1:0.5:3"').replace(
            '<config key="friction"',
            '<config key="clearance" value="2e-3"/><config key="friction"')),
        [[0.2, 0.01], [-0.5, 0.0], [0.9, -0.01]]),
}  # fmt: skip
"""Cables without friction by path, and poses of their joints; the rest stays."""


@pytest.mark.parametrize("kind", KEPT)
def test_a_kept_rope_pulls_as_after_a_slow_motion_from_where_it_was_mounted(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    build_model, poses = KEPT[kind]
    m = build_model()
    slack = []
    for pose in poses:
        led, kept = mujoco.MjData(m), mujoco.MjData(m)
        for share in np.linspace(0.0, 1.0, 101):
            led.qpos[:], led.qvel[:] = m.qpos0, 0.0
            led.qpos[: len(pose)] += share * np.array(pose)
            mujoco.mj_forward(m, led)
            reached = led.qpos.copy()
            mujoco.mj_step(m, led)  # commits the pose in which it begins
        kept.qpos[:] = reached
        settle(m, kept, rope="keep")
        for name in cables(m):
            true, found = read(m, led, name), read(m, kept, name)
            assert found.tension == pytest.approx(true.tension, rel=2e-3, abs=0.02)
            assert found.slack == pytest.approx(true.slack, rel=2e-3, abs=1e-6)
            assert found.dissipated == 0.0
            slack.append(found.slack > 0.0)
        again = kept.plugin_state.copy()
        settle(m, kept, rope="keep")
        assert np.array_equal(kept.plugin_state, again)
    assert any(slack)
    assert not all(slack)


def test_a_kept_rope_keeps_the_relation_of_motor_and_joint() -> None:
    m = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
    moved = mujoco.MjData(m)
    for step in range(500):
        moved.ctrl[0] = 2.0 * np.sin(0.01 * step)
        mujoco.mj_step(m, moved)
    kept, remounted, offset = mujoco.MjData(m), mujoco.MjData(m), {}
    kept.qpos[:] = remounted.qpos[:] = moved.qpos
    settle(m, kept, rope="keep")
    settle(m, remounted)
    for rope, d in (("true", moved), ("keep", kept), ("remount", remounted)):
        d.qvel[:] = d.ctrl[:] = 0.0
        mujoco.mj_step(m, d, 6000)
        offset[rope] = d.qpos[0] - 0.104 / 0.02 * d.qpos[1]
    # Friction holds the joint within 0.03 rad of where nothing pulls.
    assert abs(offset["keep"] - offset["true"]) < 0.03
    assert abs(offset["remount"] - offset["true"]) > 0.4


def test_settling_a_model_without_cables_is_warned_of() -> None:
    m = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    with pytest.warns(CableWarning, match="settle finds no cable"):
        settle(m, mujoco.MjData(m))


def test_another_rope_is_refused() -> None:
    m, d = build(pull_pull())
    wrong: Any = "kept"
    with pytest.raises(CableError, match=r"unknown rope 'kept'.*did you mean 'keep'"):
        settle(m, d, rope=wrong)
    d.qpos[0] = np.nan
    settle(m, d, rope="keep")
    assert np.isnan(d.qfrc_actuator).any()


def test_without_it_another_pose_is_a_jump() -> None:
    m, d = build(pull_pull())
    d.qpos[1] = 0.3
    mujoco.mj_step(m, d)
    assert max(read(m, d, name).tension.max() for name in cables(m)) > 40.0


def test_settling_at_the_reference_is_a_reset() -> None:
    for integrator in INTEGRATORS:
        m, d = build(pull_pull(option=f'integrator="{integrator}"'))
        fresh = d.plugin_state.copy()
        settle(m, d)
        assert np.array_equal(d.plugin_state, fresh)


def test_data_of_another_model_are_refused_as_they_are() -> None:
    bare = mujoco.MjModel.from_xml_string("<mujoco/>")
    others = {kind: damage.scene(kind) for kind in damage.KINDS}
    path_of = {kind: damage.path_of(kind) for kind in damage.KINDS} | {"none": ""}
    for one, ours in [*others.items(), ("none", bare)]:
        for other, theirs in [*others.items(), ("none", bare)]:
            if one == other or path_of[one] == path_of[other]:
                continue
            d = mujoco.MjData(theirs)
            before = d.plugin_state.copy()
            uses = (settle, step_limits, tendon_report)
            # A report needs the pose alone, which the sizes decide.
            for use in uses[: 3 if bare in (ours, theirs) else 2]:
                with pytest.raises(CableError, match=r"kind of path|and the model"):
                    use(ours, data=d)
            for reader in damage.READERS if ours is not bare else ():
                with pytest.raises(CableError, match=r"kind of path|and the model"):
                    reader(ours, d, "cable")
            assert np.array_equal(d.plugin_state, before)


def test_a_keyframe_starts_at_rest_once_settled() -> None:
    key = '<keyframe><key time="3" qpos="0.9 -0.5 0.1 1 0 0 0"/></keyframe>'
    for integrator in INTEGRATORS:
        m, d = build(pull_pull(option=f'integrator="{integrator}"', extra=key))
        mujoco.mj_resetDataKeyframe(m, d, 0)
        settle(m, d)
        assert d.time == 3.0
        mujoco.mj_step(m, d)
        for name in cables(m):
            assert read(m, d, name).tension == pytest.approx(10.0, rel=1e-9)


def test_batch_and_rollout_take_the_settled_state_over() -> None:
    m, d = build(pull_pull())
    poses = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 2))
    batch = mujoco.batch.Batch(m, 3)
    qpos, plugin_state = batch.bind("qpos"), batch.bind("plugin_state")
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.empty((3, mujoco.mj_stateSize(m, full)))
    for row, pose in enumerate(poses):
        mujoco.mj_resetData(m, d)
        d.qpos[:2] = pose
        settle(m, d)
        qpos[row], plugin_state[row] = d.qpos, d.plugin_state
        mujoco.mj_getState(m, d, starts[row], full)
    batch.step()
    states, _ = mujoco.rollout.rollout(m, [mujoco.MjData(m)], starts, nstep=1)
    for row in range(3):
        mujoco.mj_setState(m, d, states[row, 0], full)
        assert np.array_equal(d.plugin_state, plugin_state[row])
        assert read(m, d, "flexor").tension == pytest.approx(10.0, rel=1e-9)


def loaded(
    radius: float, inertia: float, segments: int, second: float, ends: str = "auto"
) -> str:
    """Return a motor held by one or two cables, their far ends on a heavy joint."""
    pulled = CONFIG | {"segments": str(segments), "ends": ends}
    names = ("one", "two") if second else ("one",)
    ends = "".join(
        end(f"{name}_near", name, 'joint="motor"', gear)
        + end(f"{name}_far", name, 'joint="wrist"', 0.1)
        for name, gear in zip(names, (radius, -second), strict=False)
    )
    return f"""<mujoco><option timestep="1e-5"/>
      <extension><plugin plugin="cc_mujoco.cable">
        {"".join(instance(name, pulled) for name in names)}</plugin></extension>
      <worldbody>
        <body><joint name="motor" armature="{inertia}"/>
          <geom size="0.01" mass="1e-9"/></body>
        <body><joint name="wrist" armature="1e3"/><geom size="0.01" mass="1"/></body>
      </worldbody><actuator>{ends}</actuator></mujoco>"""


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    radius=st.floats(0.005, 0.1),
    inertia=st.floats(1e-6, 1e-2),
    segments=st.integers(1, 60),
    second=st.one_of(st.just(0.0), st.floats(0.005, 0.1)),
)
def test_the_limit_is_that_of_the_springs_on_the_joint(
    radius: float, inertia: float, segments: int, second: float
) -> None:
    m = mujoco.MjModel.from_xml_string(loaded(radius, inertia, segments, second))
    stiffness = end_stiffness(from_mjcf(m)["one"])[0] * (radius**2 + second**2)
    expected = 2.0 / np.sqrt(stiffness / inertia)
    for limits in step_limits(m).values():
        assert limits.proximal == pytest.approx(expected, rel=1e-4)
        assert limits.distal > 5.0 * limits.proximal or inertia > 1e-3


@pytest.mark.parametrize("second", [0.0, 0.02])
def test_a_pulley_at_rest_is_stable_below_the_limit_only(
    second: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shaken by a little, it keeps its swing below the limit and gains above it."""
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    m = mujoco.MjModel.from_xml_string(loaded(0.02, 1e-4, 20, second))
    limit = step_limits(m)["one"].proximal
    pull = 10.0 * (0.02 - second)  # the pretension, by both cables
    gain = {}
    for share, ends in ((0.9, "explicit"), (1.1, "explicit"), (30.0, "auto")):
        m = mujoco.MjModel.from_xml_string(loaded(0.02, 1e-4, 20, second, ends))
        m.opt.timestep = share * limit
        d = mujoco.MjData(m)
        mujoco.mj_forward(m, d)
        d.qfrc_applied[0] = -pull
        d.qvel[0] = 1e-6
        swing = np.empty(60)
        for i in range(swing.size):
            mujoco.mj_step(m, d)
            swing[i] = d.qvel[0]
        gain[share] = np.abs(swing).max() / 1e-6
    assert gain[0.9] < 10.0
    assert gain[1.1] > 1e4
    assert gain[30.0] < 2.0


def test_a_cable_that_nothing_holds_is_one_spring() -> None:
    m = mujoco.MjModel.from_xml_string(
        loaded(0.02, 1e-4, 20, 0.0).replace(
            'key="friction" value="0.15"', 'key="friction" value="0"'
        )
    )
    highest = np.sqrt(4000.0 / 2.0 * 0.02**2 / 1e-4)
    (limits,) = step_limits(m).values()
    assert 0.7 * 2.0 / highest < limits.proximal <= 2.0 / highest


def test_an_end_that_moves_nothing_has_no_limit() -> None:
    xml = loaded(0.02, 1e-4, 20, 0.0)
    m = mujoco.MjModel.from_xml_string(xml)
    m.actuator_gear[0, 0] = 1e-300
    assert step_limits(m)["one"].proximal > 1.0


SAID = """
import mujoco, sys
import cc_mujoco
for path, factor in zip(sys.argv[1::2], sys.argv[2::2]):
    print("next", file=sys.stderr, flush=True)
    m = mujoco.MjModel.from_xml_path(path)
    m.opt.timestep *= float(factor)
    for _ in range(3):
        d = mujoco.MjData(m)
        mujoco.mj_step(m, d, 2)
        mujoco.mj_resetData(m, d)
        mujoco.mj_step(m, d, 2)
"""


SCENES = ("wrist", "ankle", "finger", "bench")


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, float], Any]:
    """Return MuJoCo's warnings for each scene with its time step scaled."""
    folder = tmp_path_factory.mktemp("scenes")
    own, implicit = folder / "scene.xml", folder / "implicit.xml"
    text = loaded(0.02, 1e-4, 20, 0.0, "explicit").replace("1e-5", "0.004")
    own.write_text(text)
    implicit.write_text(text.replace("explicit", "auto"))
    plays = {("own", 0.5): own, ("own", 1.0): own, ("implicit", 10.0): implicit}
    for factor in (1.0, 40.0):
        plays |= {(name, factor): scene_path(name) for name in SCENES}
    words = [str(word) for (_, by), path in plays.items() for word in (path, by)]
    done = subprocess.run(
        [sys.executable, "-c", SAID, *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    parts = done.stderr.split("next\n")[1:]
    found = (re.findall(r"WARNING: (.*)", part) for part in parts)
    return dict(zip(plays, found, strict=True))


def test_too_long_a_step_is_warned_of_once_unless_it_is_mended_after_loading(
    said: dict[tuple[str, float], Any],
) -> None:
    assert not said["own", 0.5]
    assert not said["implicit", 10.0]
    (warning,) = said["own", 1.0]
    for part in ("'one'", "proximal end", "below 3.123 ms", "is 4.000 ms", "armature"):
        assert part in warning


@pytest.mark.parametrize("name", SCENES)
def test_the_scenes_are_not_warned_of(
    name: str, said: dict[tuple[str, float], Any]
) -> None:
    assert said[name, 1.0] == []
    # The ends of the others are implicit then, and vibrate faster than that.
    unstable = [line for line in said[name, 40.0] if "is stable only" in line]
    assert ["its open path" in line for line in unstable] == [True] * (name == "finger")
    others = [line for line in said[name, 40.0] if line not in unstable]
    assert all("the period of its ends is" in line for line in others)


JUMPS = """
import mujoco, sys
import cc_mujoco
from cc_mujoco.plugin import settle
xml = sys.stdin.read()
for ends in "auto", "explicit":
    for integrator in "Euler", "RK4", "implicitfast":
        for lay in settle, mujoco.mj_forward:
            options = f'<option integrator="{integrator}"/></mujoco>'
            m = mujoco.MjModel.from_xml_string(
                xml.replace("ENDS", ends)
                .replace('"one', f'"{integrator}')  # as none is told of twice
                .replace("</mujoco>", options)
            )
            d = mujoco.MjData(m)
            print(ends, integrator, lay is settle, file=sys.stderr, flush=True)
            d.qpos[:] = 1.0  # 20 and 100 mm of the pulleys
            lay(m, d)
            mujoco.mj_step(m, d, 3)
            mujoco.mj_resetData(m, d)
            d.qvel[:] = 100.0  # 1 mm and more a step
            mujoco.mj_step(m, d, 5)
print("idle", "any", False, file=sys.stderr, flush=True)
m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
mujoco.mj_step(m, mujoco.MjData(m), 5)
print("group", "any", False, file=sys.stderr, flush=True)
for group in 3, 4:
    m = mujoco.MjModel.from_xml_string(
        xml.replace('gear', f'group="{group}" gear').replace('"one', f'"{group}')
        .replace("</mujoco>", '<option actuatorgroupdisable="3"/></mujoco>')
        .replace("ENDS", "auto")
    )
    mujoco.mj_step(m, mujoco.MjData(m), 5)
"""


def test_ends_moved_by_hand_and_cables_that_cannot_pull_are_warned_of_once(
    tmp_path: Path,
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", JUMPS],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        input=loaded(0.02, 1e-2, 20, 0.0, "ENDS").replace('"1e-5"', '"5e-4"'),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    said: dict[tuple[str, ...], list[str]] = {}
    for line in done.stderr.splitlines():
        if line.endswith(("True", "False")):
            said[tuple(line.split())] = []
        elif "WARNING: " in line:
            next(reversed(said.values())).append(line)
    (idle,) = said.pop(("idle", "any", "False"))
    assert "`actuation` is disabled in <flag>, so the cable does not pull" in idle
    (group,) = said.pop(("group", "any", "False"))
    assert "'3" in group
    assert "the cable pulls all the same" in group
    for (ends, _, settled), lines in said.items():
        assert bool(lines) == (ends == "auto" and settled == "False"), (ends, settled)
        for line in lines:
            assert f"by {100 if 'distal end' in line else 20}.000 mm" in line
            assert "settle" in line
