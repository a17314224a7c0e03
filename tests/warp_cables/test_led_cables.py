"""Cables that a tendon leads or bends, in mujoco_warp against the plugin."""

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
from cc_mujoco.errors import CableError
from cc_mujoco.warp import attach, without_plugin
from plugin.test_moving_route import LIMB
from warp_cables.test_capture import replay_equals_steps
from warp_cables.test_scenes import (
    played,
    played_on_warp,
    reset_world_leaves_others,
)

pytestmark = pytest.mark.study

WINCH = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="implicitfast"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="rope">
    <config key="route" value="rope"/> <config key="path" value="{path}"/>
    <config key="conduit" value="{length}:inf"/> <config key="segments" value="{n}"/>
    <config key="guides" value="guide:0.02"/> <config key="friction" value="0.15"/>
    <config key="axial_stiffness" value="20000"/>
    <config key="pretension" value="100"/>
    {more}
  </instance></plugin></extension>
  <worldbody>
    <body pos="-0.3 0 -0.3">
      <joint name="drum" axis="0 1 0" armature="2e-3" damping="0.1"/>
      <geom size="0.02" mass="0.1"/>
    </body>
    <site name="out" pos="-0.25 0 -0.3"/>
    <geom name="post" type="cylinder" size="0.05 0.02" zaxis="0 1 0"/>
    <site name="over" pos="0 0 0.2"/>
    <site name="guide" pos="0.3 0 -0.1"/>
    <body pos="0.5 0 -0.5">
      <joint name="load" type="slide" axis="0 0 1" damping="20"/>
      <joint name="swing" axis="0 1 0" damping="2" stiffness="60"/>
      <geom size="0.05" mass="10"/> <site name="hook" pos="0.1 0 0.1"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope">
      <site site="out"/> <geom geom="post" sidesite="over"/> <site site="guide"/>
      <site site="hook"/>
    </spatial>
  </tendon>
  <actuator>
    <motor joint="drum"/>
    <plugin joint="drum" gear="-0.03" plugin="cc_mujoco.cable" instance="rope"/>
    <plugin tendon="rope" gear="1" plugin="cc_mujoco.cable" instance="rope"/>
  </actuator>
</mujoco>
"""
SECONDS, HOLD = 1.0, 0.02


def winch(step: float = 5e-4, guide: str = "0.3 0 -0.1") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(winch_text(step, guide))


def winch_text(step: float = 5e-4, guide: str = "0.3 0 -0.1") -> str:
    given = {"step": step, "n": 8, "path": "open", "more": ""}
    text = WINCH.replace("0.3 0 -0.1", guide)
    probe = text.format(length=1.0, **given)
    bare = without_cable(mujoco.MjSpec.from_string(probe)).compile()
    return text.format(length=float(bare.tendon_length0[0]), **given)


def without_cable(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    for actuator in list(spec.actuators)[1:]:
        spec.delete(actuator)
    for plugin in list(spec.plugins):
        spec.delete(plugin)
    return spec


def lifted(time: float) -> list[float]:
    return [2.5 + 2.0 * np.sin(6.0 * time)]


def moved(spec: mujoco.MjSpec):
    """Return a control that moves all motors and wearers of a device."""
    model = spec.compile()
    others = np.flatnonzero(model.actuator_plugin < 0)
    low, high = model.actuator_ctrlrange[others].T
    names = [model.actuator(int(i)).name for i in others]
    winds = np.array([name.startswith("motor") for name in names])
    phase = np.arange(len(others))

    def control(time: float) -> list[float]:
        wave = np.sin(8.0 * time + phase) * (1.0 - np.exp(-50.0 * time))
        found = np.zeros(model.nu)
        found[others] = np.where(
            winds, 0.15 * high * (1.0 + wave), 0.1 * wave * (high - low)
        )
        return found.tolist()

    return control


@pytest.mark.parametrize(
    ("name", "seconds", "angle", "tension"),
    [
        ("finger", 0.25, 3e-6, 8e-5), ("hand", 0.25, 7e-6, 2e-4),
        ("exosuit", 0.25, 1.4e-4, 5e-4), ("bilateral", 0.25, 3e-5, 8e-5),
        ("endoscope", 10.0, 6e-6, 2e-5), ("finger", 10.0, 1.2e-4, 4e-4),
        ("hand", 10.0, 3e-4, 1e-3), ("exosuit", 10.0, 3e-4, 5e-4),
        ("bilateral", 10.0, 3e-4, 3e-4),
    ],
)  # fmt: skip
def test_a_device_moves_as_with_the_plugin(name, seconds, angle, tension):
    """Rounding of a suit's path, 3e-8 m, is 2e-3 N, and soft ends make it angles.

    It also decides which layers of rope on its drums become one, 3e-4 of the tension.
    """
    spec = mujoco.MjSpec.from_file(str(scene_path(name)))
    control = moved(spec)
    angles, tensions = played(spec, control, seconds)
    found, pulls = played_on_warp(spec, control, seconds)
    assert np.ptp(tensions, axis=0).max() > 0.2 * tensions.max()
    assert np.abs(found - angles).max() < angle
    assert np.abs(pulls - tensions).max() < tension * tensions.max()


PLAY = '<config key="clearance" value="2e-3"/>'
TO_C = '<config key="path" value="mixed"/><config key="mouth" value="c"/>'


@pytest.mark.parametrize(
    "more", ["", PLAY, PLAY + TO_C], ids=["tight", "clearance", "mixed"]
)
def test_a_conduit_bends_with_its_route_as_with_the_plugin(more):
    text = LIMB.format(integrator="Euler", more=more)
    text = text.replace("<plugin name", '<plugin plugin="cc_mujoco.cable" name')
    spec = mujoco.MjSpec.from_string(text)

    def control(time: float) -> list[float]:
        return [0.5 + 0.4 * np.sin(9.0 * time), np.sin(5.0 * time)]

    angles, tensions = played(spec, control, 0.5)
    found, pulls = played_on_warp(spec, control, 0.5)
    assert np.ptp(angles[:, 1]) > 0.2  # which bends the conduit
    assert np.abs(found - angles).max() < 1e-5 * np.abs(angles).max()
    assert np.abs(pulls - tensions).max() < 1e-3 * tensions.max()


@pytest.mark.parametrize("step", [4e-3, 1e-2])
def test_long_steps_err_no_more_than_the_plugin(step):
    def sampled(play, step):
        every = round(HOLD / step)
        return play(winch(step), lifted, SECONDS, HOLD)[0][every - 1 :: every]

    right = sampled(played, 2e-4)
    theirs, ours = (
        np.sqrt(((sampled(play, step) - right) ** 2).mean(0))
        for play in (played, played_on_warp)
    )
    assert (ours < 1.3 * theirs).all()


def test_worlds_do_not_see_each_other_and_readings_are_those_of_the_plugin():
    spec = winch()
    model = spec.compile()
    data = mujoco.MjData(model)
    cables = reset_world_leaves_others(spec, 1.0)
    data.ctrl[0] = 1.0
    for _ in range(200):
        mujoco.mj_step(model, data)
    right, found = cc_mujoco.read(model, data, "rope"), cables.read("rope")
    largest = right.tension.max()
    assert np.abs(found.tension[0] - right.tension).max() < 1e-3 * largest
    np.testing.assert_allclose(found.dissipated[0], right.dissipated, rtol=1e-3)
    state = cables.plugin_state()[0]
    again = cc_mujoco.plugin.read_state(model, "rope", state)
    np.testing.assert_array_equal(again.tension, found.tension[0])
    assert again.slack == found.slack[0]


def test_a_replay_of_a_captured_step_is_a_step():
    replay_equals_steps(winch(4e-3), lifted)


def elsewhere(text: str, away: float, floats: bool) -> mujoco.MjSpec:
    """Return a scene at some distance from the origin, turned and afloat or fixed."""
    begin, end = f"""<worldbody><frame pos="{away} 0 0">""", "</frame></worldbody>"
    if floats:
        begin = f"""<worldbody><body pos="{away} {-away} 0" euler="0.3 0.2 0.1">
            <freejoint/>
            <geom type="box" size="1 1 1" mass="200" contype="0" conaffinity="0"/>"""
        end = "</body></worldbody>"
        text = re.sub("<geom [^>]*plane[^>]*/>", "", text)
    text = text.replace("<worldbody>", begin).replace("</worldbody>", end)
    spec = mujoco.MjSpec.from_string(text)
    spec.option.gravity, spec.option.timestep = [0.0, 0.0, 0.0], 5e-4
    return spec


@pytest.mark.parametrize(
    ("name", "floats", "error"),
    [("winch", True, 2e-4), ("exosuit", True, 2e-4), ("winch", False, 1e-3)],
)
def test_tensions_do_not_depend_on_the_distance_from_the_origin(name, floats, error):
    if name == "winch":
        text, control = winch_text(), lifted
    else:
        text = Path(scene_path(name)).read_text("utf-8")
        control = moved(mujoco.MjSpec.from_string(text))
    _, tensions = played(elsewhere(text, 0.0, floats), control, 0.15)
    for away in (10.0, 100.0):
        _, pulls = played_on_warp(elsewhere(text, away, floats), control, 0.15)
        assert np.abs(pulls - tensions).max() < error * tensions.max()


def test_a_site_may_be_elsewhere_in_a_world():
    spec, other = winch(), winch(guide="0.32 0 -0.12")
    plain = without_plugin(spec).compile()
    _, tensions = played(other, lifted, 0.1)
    pulls, sites = [], np.tile(plain.site_pos[None], (2, 1, 1))
    sites[1] = without_plugin(other).compile().site_pos
    m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=2)
    m.site_pos = wp.array(sites, dtype=wp.vec3)
    attach(m, d, spec)
    with pytest.raises(CableError, match=r"site_pos .* rest_in_pose=True"):
        m.callback.act_bias(m, d)
    m.callback.act_bias = None
    cables = attach(m, d, spec, rest_in_pose=True)
    for k in range(len(tensions)):
        d.ctrl.fill_(lifted(k * plain.opt.timestep)[0])
        mjw.step(m, d)
        pulls.append(cables.tensions.numpy()[:, 0].copy())
    found = np.array(pulls)
    assert np.abs(found[:, 1] - tensions[:, 0]).max() < 1e-4 * tensions.max()
    assert np.abs(found[:, 0] - tensions[:, 0]).max() > 2e-3 * tensions.max()


def test_parameters_are_given_anew_on_the_path_of_the_scene():
    spec = winch()
    plain = without_plugin(spec).compile()
    m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=2)
    cables = attach(m, d, spec)
    stiffer = cc_mujoco.plugin.from_mjcf(spec)["rope"].replace(friction=0.3)
    cables.vary("rope", friction=np.array([0.15, 0.3]))
    packed = cables._rows.prm.numpy().copy()
    cables.assign("rope", {0: stiffer.replace(friction=0.15), 1: stiffer})
    np.testing.assert_allclose(cables._rows.prm.numpy(), packed, rtol=2e-6)
    for _ in range(100):
        mjw.step(m, d)
    losses = np.abs(np.diff(np.log(cables.tensions.numpy()[:, 0]), axis=1))
    assert losses[1] > 1.5 * losses[0]
