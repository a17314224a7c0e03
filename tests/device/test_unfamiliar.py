"""Devices of unfamiliar kinds: they load, play, or say what is wrong.

An elbow with a motor for each of two cables, a gripper whose motor closes two fingers,
and an ankle on a body that floats freely above a floor.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco import simulate
from cc_mujoco.device import Device
from cc_mujoco.device._report import account
from cc_mujoco.errors import CableError

CABLE = """
<instance name="{name}">
  <config key="conduit" value="0.3:0.2 0.2:0.5"/>
  <config key="axial_stiffness" value="20000"/> <config key="pretension" value="15"/>
  <config key="friction" value="0.1"/> <config key="segments" value="8"/>
</instance>
"""
HEAD = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast">
    <flag contact="{contact}"/></option>
  <extension><plugin plugin="cc_mujoco.cable">{cables}</plugin></extension>
"""
ELBOW = (
    HEAD
    + """
  <worldbody>
    <body pos="-.2 .05 1.3">
      <joint name="biceps_drum" axis="0 1 0" armature="1e-3" damping=".02"/>
      <geom type="cylinder" size=".02 .01" mass=".2"/></body>
    <body pos="-.2 -.05 1.3">
      <joint name="triceps_drum" axis="0 1 0" armature="1e-3" damping=".02"/>
      <geom type="cylinder" size=".02 .01" mass=".2"/></body>
    <body name="forearm" pos="0 0 1.1">
      <joint name="elbow" axis="0 -1 0" range="-10 140" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".035" mass="1.6"/></body>
  </worldbody>
  <actuator>
    <motor name="biceps_motor" joint="biceps_drum" ctrlrange="-5 5"/>
    <motor name="triceps_motor" joint="triceps_drum" ctrlrange="-5 5"/>
    <position name="arm" joint="elbow" kp="60" kv="2"/>
    <plugin plugin="cc_mujoco.cable" instance="biceps" joint="biceps_drum" gear="-.02"/>
    <plugin plugin="cc_mujoco.cable" instance="biceps" joint="elbow" gear="-.06"/>
    <plugin plugin="cc_mujoco.cable" instance="triceps" joint="triceps_drum"
      gear="-.02"/>
    <plugin plugin="cc_mujoco.cable" instance="triceps" joint="elbow" gear=".04"/>
  </actuator>
</mujoco>
"""
)
GRIPPER = (
    HEAD
    + """
  <worldbody>
    <body pos="0 0 .3"><joint name="reel" axis="0 1 0" armature="2e-4" damping="5e-3"/>
      <geom type="cylinder" size=".01 .01" mass=".1"/></body>
    <body pos="-.04 0 0">
      <joint name="left" axis="0 1 0" range="-30 60" stiffness=".3" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 .1" size=".01" mass=".05"/></body>
    <body pos=".04 0 0">
      <joint name="right" axis="0 -1 0" range="-30 60" stiffness=".3" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 .1" size=".01" mass=".05"/></body>
  </worldbody>
  <actuator>
    <motor name="closer" joint="reel" ctrlrange="-.6 .6"/>
    <plugin plugin="cc_mujoco.cable" instance="one" joint="reel" gear="-.01"/>
    <plugin plugin="cc_mujoco.cable" instance="one" joint="left" gear="-.015"/>
    <plugin plugin="cc_mujoco.cable" instance="two" joint="reel" gear="-.01"/>
    <plugin plugin="cc_mujoco.cable" instance="two" joint="right" gear="-.012"/>
  </actuator>
</mujoco>
"""
)
ANKLE = (
    HEAD
    + """
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="shank" pos="0 0 .5"><freejoint name="float"/>
      <geom type="capsule" fromto="0 0 0 0 0 .4" size=".05" mass="5"/>
      <site name="clamp" pos="-.08 0 .1"/>
      <body name="pulley" pos="-.08 0 .3">
        <joint name="drum" axis="0 -1 0" armature="2e-3" damping=".05"/>
        <geom type="cylinder" size=".02 .01" mass=".2"/></body>
      <body name="foot" pos="0 0 -.02">
        <joint name="ankle" axis="0 -1 0" range="-40 30" damping=".5"/>
        <geom name="sole" type="box" pos=".04 0 -.44" size=".14 .08 .02" mass="1.2"/>
        <site name="heel" pos="-.1 0 -.1"/></body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope"><site site="clamp"/><site site="heel"/></spatial>
  </tendon>
  <actuator>
    <motor name="m" joint="drum" ctrlrange="-8 8"/>
    <position name="leg" joint="ankle" kp="400" kv="15"/>
    <plugin plugin="cc_mujoco.cable" instance="cord" joint="drum" gear="-.02"/>
    <plugin plugin="cc_mujoco.cable" instance="cord" tendon="rope" gear="1"/>
  </actuator>
</mujoco>
"""
)


def device(folder: Path, scene: str, cables: str, contact: str, **given: object):
    """Write a scene and read it as a device."""
    path = folder / "mine.xml"
    every = "".join(CABLE.format(name=name) for name in cables.split())
    path.write_text(scene.format(cables=every, contact=contact))
    return Device(path, **given)


def elbow(folder: Path, **given: object) -> Device:
    return device(folder, ELBOW, "biceps triceps", "disable", **given)


def gripper(folder: Path, **given: object) -> Device:
    return device(folder, GRIPPER, "one two", "enable", **given)


def ankle(folder: Path, **given: object) -> Device:
    return device(folder, ANKLE, "cord", "enable", root="free", **given)


@pytest.mark.parametrize("make", [elbow, gripper, ankle])
@pytest.mark.parametrize("law", ["none", "pi"])
def test_it_plays_with_torques_in_the_direction_that_the_task_asks_for(
    tmp_path: Path, make, law: str
) -> None:
    made = make(tmp_path)
    log = simulate(made, law, duration=0.3)
    assert len(log) == 301
    for axis, (_, own) in zip(made.description.axes, log.each_axis(), strict=True):
        torque, wanted = own["joint_torque_nm"], own["desired_torque_nm"]
        assert np.all(np.isfinite(torque))
        assert np.mean(torque * np.sign(wanted)) > 0.2 * np.abs(wanted).mean()
        # Positive motor torque winds, however the drum turns.
        assert np.mean(own["motor_torque_nm"]) > 0.0
        assert np.abs(own["motor_torque_nm"]).max() <= axis.torque


def test_two_motors_at_a_joint_are_two_axes_named_by_the_motors(tmp_path: Path) -> None:
    description = elbow(tmp_path).description
    assert [axis.name for axis in description.axes] == ["biceps_motor", "triceps_motor"]
    assert {axis.joint for axis in description.axes} == {"elbow"}
    ways = [float(axis.task.removeprefix("hold:")) for axis in description.axes]
    assert ways == [3.0, -2.0]
    assert description.movers == {"elbow": "arm"}


def test_each_of_two_motors_at_a_joint_feels_its_own_cable(tmp_path: Path) -> None:
    log = simulate(elbow(tmp_path), "none", duration=0.3)
    for name, arm in (("biceps", 0.06), ("triceps", -0.04)):
        tension = log[f"tension_{name}_distal_n"]
        torque = log[f"{name}_motor.joint_torque_nm"]
        np.testing.assert_allclose(torque[1:], arm * tension[1:], rtol=1e-6)


def test_axes_that_are_given_one_name_are_refused(tmp_path: Path) -> None:
    axes = [{"motor": f"{name}_motor", "name": "arm"} for name in ("biceps", "triceps")]
    with pytest.raises(CableError, match="two axes of the name 'arm'; give each"):
        elbow(tmp_path, axis=axes)


def test_a_joint_takes_one_cuff(tmp_path: Path) -> None:
    first: dict[str, object] = {"motor": "biceps_motor", "cuff": {"stiffness": 300.0}}
    log = simulate(elbow(tmp_path, axis=[first]), "none", duration=0.2)
    torque = log["triceps_motor.joint_torque_nm"][-1]
    assert torque == pytest.approx(-0.04 * log["tension_triceps_distal_n"][-1])
    with pytest.raises(CableError, match=r"'elbow_frame' already.*takes one cuff"):
        elbow(tmp_path, axis=[first, first | {"motor": "triceps_motor"}])


def test_two_motors_at_a_joint_need_guided_cables(tmp_path: Path) -> None:
    path = elbow(tmp_path).path
    text = path.read_text().replace(
        "<worldbody>", '<worldbody><site name="a" pos="0 0 1.3"/>'
    )
    text = text.replace(
        '<geom type="capsule" fromto="0 0 0 0 0 -.25"',
        '<site name="b" pos=".05 0 -.1"/><geom type="capsule" fromto="0 0 0 0 0 -.25"',
    )
    text = text.replace(
        "<actuator>",
        '<tendon><spatial name="open"><site site="a"/><site site="b"/></spatial>'
        "</tendon><actuator>",
    )
    text = text.replace(
        '<instance name="biceps">',
        '<instance name="biceps"><config key="path" value="open"/>'
        '<config key="route" value="open"/>',
    )
    text = text.replace('joint="elbow" gear="-.06"', 'tendon="open" gear="1"')
    length = np.linalg.norm([0.05, 0.0, 0.3])
    text = text.replace("0.3:0.2 0.2:0.5", f"{length}:inf", 1)
    path.write_text(text)
    with pytest.raises(CableError, match=r"several motors drive joint 'elbow'.*'open'"):
        Device(path)


def test_a_motor_for_two_fingers_drives_the_one_of_the_longer_arm_or_that_chosen(
    tmp_path: Path,
) -> None:
    made = gripper(tmp_path)
    assert made.description.axis().joint == "left"
    assert made.description.sources["axis.joint"] == "assumed"
    assert "cable two pulls right, whose torque is not measured" in account(made)
    log = simulate(made, "none", duration=0.3)
    both = [log[f"tension_{name}_distal_n"][-1] for name in ("one", "two")]
    assert min(both) > 1.0
    chosen = gripper(tmp_path, axis={"joint": "right"})
    assert chosen.description.axis().joint == "right"
    with pytest.raises(CableError, match=r"unknown joint .*'thumb'.*left, right"):
        gripper(tmp_path, axis={"joint": "thumb"})


def test_nobody_need_move_a_gripper(tmp_path: Path) -> None:
    made = gripper(tmp_path, wearer={"left": {"none": True}})
    assert made.description.movers == {}
    log = simulate(made, "none", duration=0.3)
    # The cables close both fingers against their springs.
    assert log["joint_angle_rad"][-1] > log["joint_angle_rad"][0] + 0.05
    assert np.all(log["wearer_torque_nm"] == 0.0)


def test_a_floating_body_lands_on_the_floor_and_stays_there(tmp_path: Path) -> None:
    made = ankle(tmp_path)
    log = simulate(made, "pi", duration=0.3)
    data = mujoco.MjData(model := made.spec.copy().compile())
    data.qpos[:] = log["qpos"][-1]
    mujoco.mj_forward(model, data)
    pairs = {tuple(sorted(contact.geom.tolist())) for contact in data.contact}
    assert pairs == {(model.geom("floor").id, model.geom("sole").id)}
    fallen = simulate(
        device(tmp_path, ANKLE, "cord", "disable", root="free"), "pi", duration=0.3
    )
    height = [int(model.joint("float").qposadr[0]) + 2]
    assert np.all(log["qpos"][-1, height] > fallen["qpos"][-1, height] + 0.2)
