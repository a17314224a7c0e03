"""A cable drive that is added to a model of another maker."""

from __future__ import annotations

import doctest
import math
from typing import Any

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.cable import Section
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import _add_cable as add_cable
from cc_mujoco.plugin import from_mjcf, read, segment_wrap, settle, stored_energy
from public_models import with_knee_exoskeleton

LEG = """<mujoco>
  <compiler angle="degree"/>
  <option timestep="5e-4" integrator="implicitfast"><flag contact="disable"
    gravity="disable"/></option>
  <default>
    <joint armature="3" damping="5" stiffness="7" frictionloss="2" limited="true"/>
    <tendon stiffness="900" damping="4" frictionloss="3" limited="true" range="0 .01"/>
    <geom contype="1" density="500"/>
    <general gainprm="5" forcerange="-1 1" ctrlrange="-2 2"/>
    <motor forcerange="-1 1" ctrlrange="-2 2"/>
  </default>
  <worldbody>
    <site name="on_wall" pos="0 0 1"/>
    <body name="pelvis" pos="0 0 1"><geom size=".1"/>
      <body name="drum"><joint name="shaft" axis="0 1 0" limited="false" damping=".1"
        stiffness="0" frictionloss="0" armature=".001"/><geom size=".03"/></body>
      <body name="thigh" pos="0 0 -.1"><geom type="capsule" size=".05"
          fromto="0 0 0 0 0 -.3"/>
        <site name="clamp" pos=".09 0 -.3"/>
        <body name="shank" pos="0 0 -.4">
          <joint name="knee" axis="0 -1 0" range="-150 60" damping=".1" armature="0"
            stiffness="0" frictionloss="0"/>
          <joint name="slide" type="slide" axis="0 0 1" range="-1 1" armature="0"/>
          <geom type="capsule" size=".04" fromto="0 0 0 0 0 -.3"/>
          <site name="shin" pos=".07 0 -.1"/>
          <body name="shaker" pos="0 0 -.4"><joint name="ball" type="ball"
            limited="false"/><geom size=".02"/></body>
        </body></body></body>
  </worldbody>
  <actuator><motor name="ideal" joint="knee" forcerange="-100 100"/>
    <motor name="spin" joint="shaft"/></actuator>
  <sensor><actuatorfrc name="cell" actuator="spin"/></sensor>
  <keyframe><key name="bent" qpos=".2 -1 .1 1 0 0 0" ctrl=".5 .25"/></keyframe>
</mujoco>"""
ROUTE = [
    ("pelvis", (-0.1, 0.0, 0.1)),
    ("pelvis", (-0.05, 0.1, 0.0)),
    ("thigh", (0.08, 0.05, -0.1)),
    "clamp",
]
DRIVE: dict[str, Any] = {
    "motor": "pelvis",
    "drum": 0.03,
    "torque_limit": 20.0,
    "joint": "knee",
    "friction": 0.2,
    "axial_stiffness": 50e3,
    "pretension": 2.0,
    "segments": 30,
}


def leg() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(LEG)


def with_cable(**changes: Any) -> mujoco.MjSpec:
    spec = leg()
    cc_mujoco.add_cable(spec, "cord", **DRIVE | changes)
    return spec


def pull(
    model: mujoco.MjModel, torque: float, held: str, steps: int = 3000
) -> mujoco.MjData:
    """Ramp the motor up while a stiff spring holds a joint."""
    joint = model.joint(held)
    model.jnt_stiffness[joint.id] = 1e4
    model.dof_damping[joint.dofadr[0]] = 50.0
    model.qpos_spring[joint.qposadr[0]] = model.qpos0[joint.qposadr[0]]
    data = mujoco.MjData(model)
    for step in range(steps):
        data.actuator("cord_motor").ctrl = torque * min(1.0, 1.5 * step / steps)
        mujoco.mj_step(model, data)
    return data


SERVOS = {
    "position": ('<position name="s" joint="knee" kp="50"/>', "holds it against"),
    "velocity": ('<velocity name="s" joint="knee" kv="5"/>', "holds it against"),
    "motor": ('<motor name="s" joint="knee"/>', "adds its force"),
    "fixed tendon": ('<position name="s" tendon="f" kp="50"/>', "holds it against"),
    "elsewhere": ('<position name="s" joint="slide" kp="50"/>', ""),
}
"""Actuators beside a cable, and what the account says of them."""


@pytest.mark.parametrize("kind", SERVOS)
def test_what_drives_the_joint_already_is_reported(kind: str) -> None:
    actuator, effect = SERVOS[kind]
    xml = LEG.replace("</actuator>", f"{actuator}</actuator>").replace(
        "<sensor>", '<tendon><fixed name="f" limited="false"><joint joint="knee" '
        'coef="1"/></fixed></tendon><sensor>'
    ).replace('ctrl=".5 .25"', 'ctrl=".5 .25 .1"')  # fmt: skip
    spec = mujoco.MjSpec.from_string(xml)
    there = [a.name for a in spec.actuators]
    report = cc_mujoco.add_cable(
        spec, "cord", **DRIVE, pulley=0.06, conduit="0.5:0.2", replace="ideal"
    )
    assert [a.name for a in spec.actuators][:2] == there[1:]
    assert report.cables == ("cord",)
    assert report.winch == "cord_winch"
    assert "motor 'ideal': deleted" in report.lines
    said = [line for line in report.lines if "already" in line]
    assert len(said) == bool(effect)
    if effect:
        assert "'s' drives joint 'knee' already, and " + effect in said[0]


def test_a_motor_that_exists_and_an_actuator_by_index_are_reported() -> None:
    xml = LEG.replace('<motor name="ideal" ', "<motor ")
    given = DRIVE | {"motor": "shaft", "torque_limit": None}
    more: dict[str, Any] = {"pulley": 0.06, "conduit": "0.5:0.2"}
    spec = mujoco.MjSpec.from_string(xml)
    report = cc_mujoco.add_cable(spec, "cord", **given, **more, replace=0)
    assert report.winch == ""
    assert "motor 0: deleted" in report.lines
    assert "motor: joint 'shaft'" in report.lines
    spec = mujoco.MjSpec.from_string(xml)
    with pytest.raises(CableError, match="at it are 0"):
        cc_mujoco.add_cable(spec, "cord", **given, **more, replace="spin")
    with pytest.raises(CableError, match=r"unknown actuator 'x'.*1 of the 2.*no name"):
        cc_mujoco.add_cable(spec, "cord", **given, **more, replace="x")
    spec.delete(spec.sensor("cell"))
    spec.delete(spec.actuator("spin"))
    for key in spec.keys:
        key.ctrl = [0.5]
    report = cc_mujoco.add_cable(spec, "cord", **given, **more)
    assert "nothing but the cable turns joint 'shaft' yet" in report.lines


def test_the_example_runs() -> None:
    assert doctest.testmod(add_cable).failed == 0


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_torque_arrives_with_capstan_loss_at_a_pulley(sense: float) -> None:
    conduit = "0.1:inf 0.4:0.25 0.2:inf"
    model = with_cable(pulley=sense * 0.06, conduit=conduit).compile()
    data = pull(model, 10.0, "knee")
    passed = math.exp(-0.2 * 0.4 / 0.25)
    found = read(model, data, "cord")
    assert found.tension_proximal == pytest.approx(10.0 / 0.03, rel=0.01)
    assert found.tension_distal == pytest.approx(passed * 10.0 / 0.03, rel=0.01)
    assert data.joint("knee").qfrc_actuator[0] == pytest.approx(
        sense * 0.06 * passed * 10.0 / 0.03, rel=0.01
    )


@pytest.mark.parametrize("bend", ["route", "fixed"])
def test_a_route_bends_the_conduit_as_it_is_drawn(bend: str) -> None:
    spec = with_cable(lever="shin", route=ROUTE, bend=bend)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    cable = from_mjcf(spec)["cord"]
    drawn = cc_mujoco.plugin.route_wrap(model, data, "cord")
    assert cable.length == pytest.approx(data.tendon("cord_route").length[0])
    assert cable.wrap == pytest.approx(drawn)
    assert segment_wrap(model, data, "cord").sum() == pytest.approx(drawn)
    assert cable.bend == bend
    pulled = pull(model, 10.0, "knee")
    found = read(model, pulled, "cord")
    ratio = found.tension_distal / found.tension_proximal
    assert ratio == pytest.approx(math.exp(-0.2 * drawn), rel=0.02)


def test_a_fixed_conduit_keeps_the_place_of_every_bend() -> None:
    sections = from_mjcf(with_cable(lever="shin", route=ROUTE, bend="fixed"))
    conduit = sections["cord"].conduit
    assert [math.isinf(section.radius) for section in conduit] == [
        True, False, False, True,
    ]  # fmt: skip
    following = from_mjcf(with_cable(lever="shin", route=ROUTE))["cord"]
    assert len(following.conduit) == 1
    assert following.wrap == pytest.approx(sections["cord"].wrap)


def test_what_the_motor_gives_is_stored_heat_or_done_at_the_joint() -> None:
    model = with_cable(lever="shin", route=ROUTE, bend="fixed").compile()
    model.opt.timestep = 1e-4
    data = mujoco.MjData(model)
    settle(model, data)
    ends = [model.actuator(f"cord_{end}").id for end in ("proximal", "distal")]
    start, rows = stored_energy(model, data, "cord"), []
    for step in range(6000):
        data.actuator("cord_motor").ctrl = 4.0 - 4.0 * math.cos(step / 800.0)
        pose = data.actuator_length[ends].copy()
        mujoco.mj_step(model, data)
        rows.append([pose, data.actuator_force[ends].copy()])
        mujoco.mj_fwdPosition(model, data)
    poses, forces = np.array(rows).transpose(1, 0, 2)
    work = 0.5 * (forces[1:] + forces[:-1]) * np.diff(poses, axis=0)
    into, out = -work[:, 0].sum(), work[:, 1].sum()
    spent = stored_energy(model, data, "cord") - start
    spent += read(model, data, "cord").dissipated
    assert into > 5.0
    assert into - out == pytest.approx(spent, rel=0.01)


def test_the_lever_pulls_by_its_moment_arm() -> None:
    model = with_cable(lever="shin", route=ROUTE).compile()
    data = pull(model, 8.0, "knee")
    joint = model.joint("knee")
    tension = read(model, data, "cord").tension_distal
    lengths = []
    for change in (-1e-6, 1e-6):
        probe = mujoco.MjData(model)
        probe.qpos[:] = data.qpos
        probe.qpos[joint.qposadr[0]] += change
        mujoco.mj_fwdPosition(model, probe)
        lengths.append(probe.tendon("cord_rope").length[0])
    arm = (lengths[1] - lengths[0]) / 2e-6
    assert abs(arm) > 0.03
    assert data.joint("knee").qfrc_actuator[0] == pytest.approx(
        -arm * tension, rel=1e-3
    )


def test_nothing_new_takes_a_default_of_the_model() -> None:
    spec = with_cable(lever="shin", route=ROUTE, replace="ideal")
    for model in (spec.compile(), mujoco.MjSpec.from_string(spec.to_xml()).compile()):
        joint, motor = model.joint("cord_winch"), model.actuator("cord_motor")
        dof = joint.dofadr[0]
        assert model.dof_armature[dof] == add_cable.ROTOR_INERTIA
        assert model.dof_damping[dof] == add_cable.ROTOR_DAMPING
        assert model.jnt_stiffness[joint.id] == model.dof_frictionloss[dof] == 0.0
        assert not model.jnt_limited[joint.id]
        assert model.geom("cord_winch").contype == 0
        assert model.body("cord_winch").mass == add_cable.MOTOR_MASS
        assert list(motor.ctrlrange) == [-20.0, 20.0]
        assert not model.actuator_forcelimited[motor.id]
        assert motor.gainprm[0] == motor.gear[0] == 1.0
        for tendon in ("cord_route", "cord_rope"):
            index = model.tendon(tendon).id
            assert model.tendon_stiffness[index] == model.tendon_damping[index] == 0.0
            assert model.tendon_frictionloss[index] == model.tendon_limited[index] == 0


def test_xml_moves_as_the_specification() -> None:
    spec = with_cable(lever="shin", route=ROUTE, replace="ideal")
    ends = []
    for model in (spec.compile(), mujoco.MjSpec.from_string(spec.to_xml()).compile()):
        data = mujoco.MjData(model)
        data.actuator("cord_motor").ctrl = 3.0
        mujoco.mj_step(model, data, 300)
        ends.append(data.qpos.copy())
    assert ends[0] == pytest.approx(ends[1], rel=1e-4, abs=1e-6)
    assert abs(ends[0]).max() > 0.1


def test_keyframes_keep_the_pose_of_every_joint() -> None:
    model = with_cable(pulley=0.06, conduit="0.5:0.3", replace="ideal").compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("bent").id)
    assert data.joint("shaft").qpos[0] == 0.2
    assert data.joint("knee").qpos[0] == -1.0
    assert data.joint("slide").qpos[0] == 0.1
    assert data.joint("cord_winch").qpos[0] == 0.0
    assert data.actuator("spin").ctrl[0] == 0.25
    assert data.actuator("cord_motor").ctrl[0] == 0.0


@pytest.mark.parametrize("replaced", ["first", "second", "last"])
def test_keyframes_keep_controls_and_activations_of_other_actuators(
    replaced: str,
) -> None:
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><body><joint name="hinge"/><geom size=".1"/></body>
        <body pos="1 0 0"><joint name="shaft"/><geom size=".1"/></body></worldbody>
        <actuator><motor name="first" joint="hinge"/>
        <intvelocity name="second" joint="hinge" kp="1" actrange="-9 9"/>
        <intvelocity name="last" joint="hinge" kp="1" actrange="-9 9"/></actuator>
        <keyframe><key name="bent" ctrl=".1 .2 .3" act=".4 .5"/><key name="straight"/>
        </keyframe></mujoco>"""
    )
    drive = {"drum": 0.02, "pulley": 0.05, "conduit": "0.5:0.3", "replace": replaced}
    cc_mujoco.add_cable(spec, "cord", motor="shaft", joint="hinge", **drive)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("bent").id)
    controls = {"first": 0.1, "second": 0.2, "last": 0.3}
    activations = {"second": 0.4, "last": 0.5}
    for name in controls.keys() - {replaced}:
        assert data.actuator(name).ctrl[0] == controls[name]
    for name in activations.keys() - {replaced}:
        assert data.act[model.actuator(name).actadr[0]] == activations[name]


def test_two_cables_pull_a_joint_both_ways_from_one_motor() -> None:
    spec = leg()
    both = {"motor": "shaft", "joint": "knee", "conduit": "0.5:0.3", "segments": 20}
    cc_mujoco.add_cable(spec, "front", drum=0.02, pulley=0.05, **both)
    cc_mujoco.add_cable(spec, "back", drum=-0.02, pulley=-0.05, replace="ideal", **both)
    model = spec.compile()
    assert [model.actuator(i).name for i in range(model.nu)] == [
        "spin",
        "front_proximal",
        "front_distal",
        "back_proximal",
        "back_distal",
    ]
    for torque in (1.0, -1.0):
        data = mujoco.MjData(model)
        data.joint("shaft").qfrc_applied[:] = torque
        mujoco.mj_step(model, data, 200)
        assert torque * data.joint("knee").qpos[0] > 0.01


def test_a_slide_is_driven_by_a_lever() -> None:
    model = with_cable(
        joint="slide", lever=("shank", (0.09, 0.0, 0.0)), route=ROUTE
    ).compile()
    data = mujoco.MjData(model)
    data.actuator("cord_motor").ctrl = 5.0
    mujoco.mj_step(model, data, 100)
    assert data.joint("slide").qpos[0] > 1e-3


def test_a_winch_is_mounted_where_the_route_begins_or_where_it_is_said() -> None:
    for motor, place in (
        ("pelvis", (-0.1, 0.0, 0.1)),
        (("pelvis", (0.0, 0.2, 0.0)), (0.0, 0.2, 0.0)),
        ("thigh", (0.0, 0.0, 0.0)),
    ):
        spec = with_cable(motor=motor, lever="shin", route=ROUTE)
        assert spec.body("cord_winch").pos == pytest.approx(place)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"motor": "pelvix"}, "joint or body 'pelvix': did you mean 'pelvis'"),
    ({"motor": "knee", "torque_limit": None, "joint": "kne"}, "mean 'knee'"),
    ({"motor": "ball", "torque_limit": None}, "motor must be a hinge.*'ball'"),
    ({"motor": "shaft"}, "torque_limit is that of a new winch.*'shaft' exists"),
    ({"motor": 3}, "motor must be a site, or a body and a position"),
    ({"torque_limit": None}, "winch on body 'pelvis' needs torque_limit="),
    ({"torque_limit": -1.0}, "torque_limit must be a number above 0, not -1"),
    ({"rotor_damping": -1.0}, "rotor_damping must be a number of at least 0"),
    ({"motor_mass": math.nan}, "motor_mass must be a number above 0, not nan"),
    ({"drum": 30.0}, "drum must be a radius in metres below 1"),
    ({"drum": -1}, "drum must be a radius in metres below 1"),
    ({"drum": 0.0}, "drum must be a radius"),
    ({"pulley": "big"}, "pulley must be a radius"),
    ({"joint": "slide"}, "a hinge, which turns a pulley, and joint 'slide'"),
    ({"joint": "ball", "pulley": None, "lever": "shin"}, "hinge or a slide.*'ball'"),
    ({"pulley": None}, "either pulley=.*or lever="),
    ({"lever": "shin"}, "either pulley=.*or lever="),
    ({"pulley": None, "lever": "shun", "route": ROUTE}, "site 'shun'.*'shin'"),
    ({"pulley": None, "lever": "shin"}, "has a lever but no route"),
    ({"pulley": None, "lever": ("thigh", (0, 0, 0)), "route": ROUTE},
     "joint 'knee' does not move the rope.*'thigh' to body 'thigh'"),
    ({"conduit": None}, "needs conduit=.*or a route of at least two points"),
    ({"route": None}, "cable 'cord': route is None; it must be a list of sites"),
    ({"route": "clamp"}, "cable 'cord': route is 'clamp'; it must be a list"),
    ({"conduit": 3}, "cable parameter `conduit` is 3; it must be sections"),
    ({"conduit": [Section(1)]}, "`conduit` is .* each a length and a radius"),
    ({"conduit": "0.5"}, "cable 'cord': key `conduit` is '0.5'"),
    ({"conduit": [(0.5, -1.0)]}, "cable parameter `conduit`"),
    ({"route": ["clamp", "clamp"], "conduit": None}, "points 1 and 2 of the route"),
    ({"route": ["clamp", ("thigh", (0.09, 0, -0.3))], "conduit": None},
     "points 1 and 2 of the route"),
    ({"route": [("thigh", (0, 0))]}, "route point 1 must be a site, or a body and"),
    ({"route": [("thig", (0, 0, 0))]}, "body 'thig': did you mean 'thigh'"),
    ({"replace": "idea"}, "actuator 'idea': did you mean 'ideal'"),
    ({"replace": "spin"}, "an actuator at joint 'knee'.*'shaft'.*ideal"),
    ({"motor": "shaft", "torque_limit": None, "joint": "shaft", "replace": "spin"},
     "sensor 'cell' reads actuator 'spin'"),
    ({"mu": 0.1}, "cable parameter 'mu'"),
    ({"friction": -1.0}, "cable parameter `friction` is -1"),
    ({"name": ""}, "name must be the name"),
    ({"name": "pelvis", "lever": None, "route": ["on_wall", ("world", (0, 0, 2))],
      "rotor_inertia": 0.0}, "rotor_inertia must be a number above 0"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    changes: dict[str, Any], message: str
) -> None:
    spec = leg()
    before = spec.to_xml()
    given = DRIVE | {"pulley": 0.06, "conduit": "0.5:0.2", "name": "cord"} | changes
    with pytest.raises(CableError, match=message):
        cc_mujoco.add_cable(spec, given.pop("name"), **given)
    assert spec.to_xml() == before


def test_a_second_cable_needs_its_own_name() -> None:
    spec = with_cable(pulley=0.06, conduit="0.5:0.3")
    again = DRIVE | {"pulley": 0.06, "conduit": "0.5:0.3"}
    with pytest.raises(CableError, match="cable 'cord' exists already"):
        cc_mujoco.add_cable(spec, "cord", **again)
    spec.worldbody.add_body(name="other_winch")
    before = spec.to_xml()
    with pytest.raises(CableError, match="other_winch"):
        cc_mujoco.add_cable(spec, "other", **again)
    assert spec.to_xml() == before
    wrong: Any = LEG
    with pytest.raises(CableError, match="spec must be a MjSpec, not"):
        cc_mujoco.add_cable(wrong, "cord", **again)


@pytest.mark.parametrize("package", ["gymnasium", "dm_control"])
def test_a_humanoid_wears_a_knee_exoskeleton(package: str) -> None:
    spec = with_knee_exoskeleton(package)
    spec.delete(spec.joint("root"))  # it hangs by the torso
    model = spec.compile()
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data.joint("right_knee").qpos[0] = -1.0
    settle(model, data)
    bent, torque = -1.0, 4.0
    while data.time < 1.0:
        data.actuator("extensor_motor").ctrl = torque * min(1.0, data.time)
        mujoco.mj_step(model, data)
    # It stretches the knee against the weight of the shin.
    found = read(model, data, "extensor")
    assert data.joint("right_knee").qpos[0] > bent + 0.5
    assert found.tension_proximal == pytest.approx(torque / 0.03, rel=0.05)
    assert 0.6 < found.tension_distal / found.tension_proximal < 0.95


def test_sections_follow_the_points_of_a_route() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
    sections = add_cable._drawn_sections(points, "cord")
    assert sections == (
        Section(0.5, math.inf),
        Section(1.5, pytest.approx(3.0 / math.pi)),
        Section(1.0, math.inf),
    )
