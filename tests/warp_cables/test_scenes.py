"""Scenes in mujoco_warp against the plugin; compiling its kernels takes a minute."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import cc_mujoco
from cc_mujoco.assets import scene_path
from cc_mujoco.warp import attach, without_plugin

pytestmark = pytest.mark.study

PAGE = Path(__file__).parents[2] / "cc_mujoco" / "warp" / "README.md"


def wrist_control(time: float) -> list[float]:
    return [0.5 * np.sin(5 * time) + 0.2 * np.sin(13 * time), 0.6 * np.sin(3 * time)]


def ankle_control(time: float) -> list[float]:
    wearer = [0.3 * np.sin(4 * time), 0.3 * np.sin(3 * time), 0.3 * np.cos(4 * time)]
    return [8 * (1 - np.cos(5 * time)), wearer[0], wearer[1], wearer[2] - 0.4]


def differential_control(time: float) -> list[float]:
    drives = [3 + 2 * np.sin(7 * time), 2 - 2 * np.sin(5 * time)]
    return [*drives, 0.3 * np.sin(4 * time), 0.3 * np.cos(3 * time) - 0.4]


SCENES = {
    "wrist": wrist_control, "ankle": ankle_control, "differential": differential_control
}  # fmt: skip
EXAMPLES = Path(__file__).parents[2] / "scripts" / "examples"


def scene(name: str, step: float = 5e-4, away: float = 0.0) -> mujoco.MjSpec:
    """Return a scene, the world moved by so many metres."""
    own = EXAMPLES / f"{name}.xml"
    path = own if own.is_file() else Path(scene_path(name))
    text = path.read_text("utf-8")
    text = text.replace("<worldbody>", f'<worldbody><frame pos="{away} 0 0">')
    spec = mujoco.MjSpec.from_string(
        text.replace("</worldbody>", "</frame></worldbody>")
    )
    spec.option.timestep = step
    return spec


def played(spec, control, seconds, hold=0.0):
    """Joint angles and tensions of a scene: (steps, nq), (steps, cables, 2)."""
    model = spec.compile()
    data, names = mujoco.MjData(model), cc_mujoco.plugin.cables(model)
    angles, tensions = [], []
    for k in range(round(seconds / model.opt.timestep)):
        now = control(held(k * model.opt.timestep, hold))
        data.ctrl[: len(now)] = now
        mujoco.mj_step(model, data)
        reading = [cc_mujoco.plugin.read(model, data, name) for name in names]
        angles.append(data.qpos.copy())
        tensions.append([(r.tension_proximal, r.tension_distal) for r in reading])
    return np.array(angles), np.array(tensions)


def played_on_warp(spec, control, seconds, hold=0.0):
    """Play the scene in mujoco_warp; return the same of the second of two worlds."""
    plain = without_plugin(spec).compile()
    m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=2)
    cables = attach(m, d, spec)
    angles, tensions = [], []
    for k in range(round(seconds / plain.opt.timestep)):
        given = np.zeros((2, plain.nu), np.float32)
        now = control(held(k * plain.opt.timestep, hold))
        given[:, : len(now)] = now
        d.ctrl.assign(given)
        mjw.step(m, d)
        angles.append(d.qpos.numpy()[1].copy())
        tensions.append(cables.tensions.numpy()[1].copy())
    return np.array(angles), np.array(tensions)


def held(time: float, hold: float) -> float:
    return np.floor(time / hold + 1e-6) * hold if hold else time


@pytest.mark.parametrize(
    ("name", "seconds", "away", "angle", "tension"),
    [
        ("wrist", 2.0, 0.0, 1e-5, 1e-4),
        ("ankle", 1.0, 0.0, 1e-5, 1e-4),
        ("ankle", 1.0, 100.0, 1e-4, 1e-3),
        ("differential", 1.0, 0.0, 1e-5, 3e-4),  # held ends of 9 MN/m in single floats
    ],
)
def test_a_scene_moves_as_with_the_plugin(name, seconds, away, angle, tension):
    spec, control = scene(name, away=away), SCENES[name]
    angles, tensions = played(spec, control, seconds)
    found, pulls = played_on_warp(spec, control, seconds)
    assert np.abs(found - angles).max() < angle
    assert np.abs(pulls - tensions).max() < tension * tensions.max()


@pytest.mark.parametrize("step", [2e-3, 4e-3, 1e-2])
def test_long_steps_err_no_more_than_the_plugin(step):
    hold = 0.02  # control, so that it is the same at all steps

    def sampled(play, step):
        every = round(hold / step)
        spec = scene("wrist", step)
        return play(spec, wrist_control, 2.0, hold)[0][every - 1 :: every]

    right = sampled(played, 2e-4)
    theirs, ours = sampled(played, step) - right, sampled(played_on_warp, step) - right
    rms, most = (lambda e: np.sqrt((e**2).mean(0))), (lambda e: np.abs(e).max(0))
    assert (rms(ours) < 1.3 * rms(theirs)).all()
    assert (most(ours) < 1.3 * most(theirs)).all()


def reset_world_leaves_others(spec, control):
    """Reset one of three worlds after 100 steps of 200; check it and the others.

    Returns:
        The cables of a run without a reset.
    """
    plain = without_plugin(spec).compile()
    runs, held = [], []
    for resets in (False, True):
        m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=3)
        held.append(attach(m, d, spec))
        d.ctrl.fill_(control)
        for k in range(200):
            if resets and k == 100:
                mjw.reset_data(m, d, wp.array([False, True, False], dtype=bool))
                d.ctrl.fill_(control)
            mjw.step(m, d)
            if k == 99:
                half = d.qpos.numpy().copy()
        runs.append((d.qpos.numpy().copy(), held[-1].tensions.numpy().copy()))
    for whole, part in zip(*runs, strict=True):
        np.testing.assert_array_equal(whole[[0, 2]], part[[0, 2]])
    np.testing.assert_array_equal(runs[1][0][1], half[1])
    return held[0]


def test_a_world_that_is_reset_leaves_the_others():
    reset_world_leaves_others(scene("wrist"), 0.2)


def test_the_example_of_the_page(capsys):
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)[0]
    names = {}
    exec(compile(code, str(PAGE), "exec"), names)
    tensions = names["cables"].tensions.numpy()[:, 0]
    assert np.isfinite(tensions).all()
    assert (
        np.diff(tensions[:, 1]) < 0.0
    ).all()  # friction takes more from world to world
