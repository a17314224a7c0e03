"""Tests of tendons with actuators and features that become cables."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin import TendonTakeover, read, route_wrap
from cc_mujoco.plugin._takeover.survey import kind_of

Law = Callable[[float], float]
LENGTH = 0.22
"""Length of the tendons of `arm` in the pose `qpos0`, about [m]."""
DRIVES: dict[str, tuple[str, Law]] = {
    "position": ('<position name="x" tendon="t" kp="600" kv="5"/>',
                 lambda t: LENGTH - 0.01 - 0.02 * math.sin(4.0 * t)),
    "motor": ('<motor name="x" tendon="t" gear="-2"/>',
              lambda t: 4.0 + 3.0 * math.sin(6.0 * t)),
    "velocity": ('<velocity name="x" tendon="t" kv="150"/>',
                 lambda t: -0.08 + 0.02 * math.cos(6.0 * t)),
    "general": ('<general name="x" tendon="t" dyntype="filter" dynprm="0.05" '
                'gainprm="20" biastype="affine" biasprm="4 -60 -2"/>',
                lambda t: -0.3 - 0.2 * math.sin(6.0 * t)),
    "muscle": ('<muscle name="x" tendon="t" force="60" lengthrange="0.12 0.26"/>',
               lambda t: 0.3 + 0.2 * math.sin(6.0 * t)),
    "dcmotor": ('<dcmotor name="x" tendon="t" motorconst="2" resistance="1"/>',
                lambda t: -7.0 - 3.0 * math.sin(6.0 * t)),
    "two": ('<motor name="x" tendon="t"/><position name="y" tendon="t" kp="300"/>',
            lambda t: -12.0 - 3.0 * math.sin(6.0 * t)),
}  # fmt: skip
"""Actuators, and the command of the first one at time t [s]."""
BURDENS = {
    "stiffness": 'stiffness="60" springlength="0 0.15"',
    "damping": 'damping="3"',
    "frictionloss": 'frictionloss="1"',
    "range": 'range="0 0.23"',
    "armature": 'armature="0.3"',
    "actuatorfrcrange": 'actuatorfrcrange="0 5"',
}


def arm(seed: int, drive: str = "", burden: str = "", pulley: str = "") -> str:
    """Return a random hinged arm, with a tendon over a post or a cylinder."""
    random = np.random.default_rng(seed)
    integrator = ("Euler", "RK4", "implicitfast")[seed % 3]
    height, mass = random.uniform(0.04, 0.07), random.uniform(0.3, 0.7)
    lean = random.uniform(-0.02, 0.02)
    over = '<site site="post"/>'
    if seed % 2:
        over = '<geom geom="roll" sidesite="above"/>'
    return f"""<mujoco><option timestep="1e-3" integrator="{integrator}"/><worldbody>
      <site name="a" pos="0 {lean} .03"/><site name="post" pos=".1 0 {height}"/>
      <geom name="roll" type="cylinder" size=".02 .1" zaxis="0 1 0"
        pos=".1 0 {height - 0.02}" contype="0" conaffinity="0"/>
      <site name="above" pos=".1 0 .2"/><site name="c" pos="0 .05 .03"/>
      <body pos=".2 0 0">
        <joint name="knee" axis="0 1 0" damping=".05" stiffness="2" range="-60 60"/>
        <geom size=".05" mass="{mass}" pos=".1 0 0"/>
        <site name="b" pos=".02 0 {height}"/></body></worldbody>
      <tendon><spatial name="t" {burden}><site site="a"/>{over}<site site="b"/>
        {pulley}</spatial></tendon>
      <actuator>{drive}</actuator></mujoco>"""


def taken(
    xml: str, friction: float = 0.0, **more: Any
) -> tuple[mujoco.MjModel, TendonTakeover]:
    spec = mujoco.MjSpec.from_string(xml)
    report = cc_mujoco.add_friction(spec, "t", friction=friction, **more)
    return spec.compile(), report


def moved(model: mujoco.MjModel, law: Law | None, time: float = 0.5) -> np.ndarray:
    """Return the knee's angle over time under a command [rad]."""
    data = mujoco.MjData(model)
    knee = []
    for _ in range(round(time / model.opt.timestep)):
        if law is not None:
            data.actuator("x").ctrl[:] = law(data.time)
        if "y" in (model.actuator(i).name for i in range(model.nactuator)):
            data.actuator("y").ctrl[:] = LENGTH
        mujoco.mj_step(model, data)
        knee.append(data.joint("knee").qpos[0])
    return np.array(knee)


def assert_moves_alike(xml: str, law: Law | None, share: float = 0.03) -> Any:
    model, report = taken(xml)
    before = moved(mujoco.MjModel.from_xml_string(xml), law)
    after = moved(model, law)
    assert np.ptp(before) > 0.03
    error = np.abs(after - before).max()
    assert error < share * np.ptp(before) + 2e-3, f"{error} of {np.ptp(before)}"
    return report


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", DRIVES)
def test_without_friction_a_drive_moves_what_it_moved(kind: str, seed: int) -> None:
    actuator, law = DRIVES[kind]
    report = assert_moves_alike(arm(seed, actuator), law)
    name = "motor" if kind == "two" else kind
    assert f"{name} 'x': pulls at the first site" in str(report)
    if kind == "two":
        assert "position 'y': pulls at the first site" in str(report)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("burden", BURDENS)
def test_without_friction_what_a_tendon_has_acts_as_before(
    burden: str, seed: int
) -> None:
    actuator, law = DRIVES["motor"]
    if burden == "armature":
        seed *= 2  # MuJoCo has none where a tendon bends over a geom
    share = 0.12 if burden == "range" else 0.03  # at an impact
    report = assert_moves_alike(arm(seed, actuator, BURDENS[burden]), law, share)
    assert sum(line.startswith(burden) for line in report.lines) == 1


@pytest.mark.parametrize("seed", [0, 3, 9])
def test_a_load_that_dry_friction_holds_does_not_fall_into_the_cable(seed: int) -> None:
    xml = arm(seed, DRIVES["motor"][0], 'frictionloss="4"')
    report = assert_moves_alike(xml, lambda t: 2.2 + 3.0 * (1.0 - math.cos(6.0 * t)))
    assert "what the dry friction holds in qpos0" in str(report)


@pytest.mark.parametrize("seed", range(3))
def test_a_spring_alone_becomes_a_band(seed: int) -> None:
    report = assert_moves_alike(
        arm(seed, "", 'stiffness="60" springlength="0 .15"'), None
    )
    assert report.winch == ""
    assert "axial_stiffness 9 N" in str(report)


@pytest.mark.parametrize("divisor", [1.0, 2.0])
def test_branches_behind_a_pulley_pull_by_their_share(divisor: float) -> None:
    pulley = f'<pulley divisor="{divisor}"/><site site="c"/><site site="b"/>'
    actuator, law = DRIVES["motor"]
    xml = arm(0, actuator, "", pulley)
    report = assert_moves_alike(xml, law)
    assert report.cables == ("t_1", "t_2")
    model, _ = taken(xml)
    data = mujoco.MjData(model)
    for _ in range(1500):
        data.actuator("x").ctrl[:] = 5.0
        mujoco.mj_step(model, data)
    first, second = (read(model, data, name).tension for name in report.cables)
    assert first == pytest.approx(10.0, rel=0.02)
    assert second == pytest.approx(10.0 / divisor, rel=0.02)
    with pytest.raises(CableError, match=r"unknown guide of tendon 't' .*'nowhere'"):
        taken(xml, guides={"nowhere": "roller"})
    with pytest.raises(CableError, match=r"guides is \['a'\]; it must be a dict"):
        taken(xml, guides=["a"])


def test_an_equality_holds_the_length_that_is_paid_out() -> None:
    xml = arm(0, *DRIVES["motor"][:1]).replace(
        "<actuator>", '<equality><tendon tendon1="t"/></equality><actuator>'
    )
    model, report = taken(xml)
    assert "equality" in str(report)
    data = mujoco.MjData(model)
    for _ in range(1000):
        data.actuator("x").ctrl[:] = 5.0
        mujoco.mj_step(model, data)
    assert abs(data.joint("knee").qpos[0]) < 0.03


@pytest.mark.parametrize("seed", [0, 1])
def test_friction_takes_the_capstan_s_share(seed: int) -> None:
    model, _ = taken(arm(seed, DRIVES["motor"][0]), friction=0.2)
    data = mujoco.MjData(model)
    for step in range(800):
        data.actuator("x").ctrl[:] = 2.0 + 4.0 * step / 800
        mujoco.mj_step(model, data)
    cable = read(model, data, "t")
    assert np.all(cable.slip < 0)
    wrap = route_wrap(model, data, "t")
    assert wrap > 0.2
    loss = cable.tension_distal / cable.tension_proximal
    assert loss == pytest.approx(math.exp(-0.2 * wrap), rel=1e-3)
    # The winch accelerates a little.
    assert cable.tension_proximal == pytest.approx(2.0 * 6.0, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_friction_never_adds_energy(seed: int) -> None:
    spring = 'stiffness="60" springlength="0 .15"'
    drive = '<motor name="x" tendon="t" gear="-2"/>'
    spec = mujoco.MjSpec.from_string(arm(seed, drive, spring))
    cc_mujoco.add_friction(spec, "t", friction=0.3)
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    work, least = 0.0, float(np.sum(data.energy))
    random = np.random.default_rng(seed)
    start, slack = least, 0.0
    for step in range(1000):
        if step % 100 == 0:
            data.actuator("x").ctrl[:] = random.uniform(0.0, 6.0)
        paid = data.joint("t_winch").qpos[0]
        mujoco.mj_step(model, data)
        force = data.actuator("x").force[0] * -2.0
        work += force * (data.joint("t_winch").qpos[0] - paid)
        gained = float(np.sum(data.energy)) - start
        slack = max(slack, gained - work)
    # Explicit integration of forces that step makes the tolerance.
    assert slack < 0.02 * abs(work) + 1e-3
    assert read(model, data, "t").dissipated > 0.0


def test_commands_and_units_stay_with_a_drum() -> None:
    actuator, law = DRIVES["position"]
    light = moved(taken(arm(0, actuator))[0], law)
    drum = moved(taken(arm(0, actuator), winch=(0.01, 1e-6))[0], law)
    assert np.abs(light - drum).max() < 0.02 * np.ptp(light)


def test_a_keyframe_pays_out_what_its_pose_takes() -> None:
    xml = arm(0, DRIVES["motor"][0]).replace(
        "</mujoco>", '<keyframe><key qpos="0.3" ctrl="2"/></keyframe></mujoco>'
    )
    model, _ = taken(xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.joint("t_winch").qpos[0] == pytest.approx(data.tendon("t").length[0])
    assert data.actuator("x").ctrl[0] == 2.0


def test_what_has_no_meaning_is_refused_with_the_way_out() -> None:
    def refused(xml: str, told: str, **more: Any) -> None:
        spec = mujoco.MjSpec.from_string(xml)
        before = spec.to_xml()
        with pytest.raises(CableError, match=told):
            cc_mujoco.add_friction(spec, "t", friction=0.1, **more)
        assert spec.to_xml() == before

    both = '<motor tendon="t" gear="1"/><motor tendon="t" gear="-1"/>'
    refused(arm(0, both), "gears of both signs.*write the negative gears")
    push = 'actuatorfrcrange="0 5"'
    refused(arm(0, '<motor tendon="t"/>', push), "only push; a cable cannot")
    driven = arm(0, DRIVES["motor"][0])
    refused(driven, "leave motor= out", motor=("knee", 0.01))
    refused(driven, "winch must be the radius", winch=(0.0, 1.0))
    refused(arm(0), "give motor=, the joint of a drum", winch=(0.01, 1e-6))
    spring = 'stiffness="60" springlength="0 .15"'
    refused(arm(0, "", spring), "leave axial_stiffness= out", axial_stiffness=1e3)


def test_a_second_cable_on_a_tendon_is_refused() -> None:
    for drive in ("", DRIVES["motor"][0]):
        spec = mujoco.MjSpec.from_string(arm(0, drive))
        cc_mujoco.add_friction(spec, "t", friction=0.1)
        with pytest.raises(CableError, match="tendon 't' is a cable already"):
            cc_mujoco.add_friction(spec, "t", friction=0.1)


def test_a_stiffness_that_a_step_does_not_bear_is_reported() -> None:
    bounds = set()
    for stiffness in (1e6, 1e7):
        _, report = taken(arm(0, DRIVES["motor"][0]), axial_stiffness=stiffness)
        found = re.search(r"more than (\S+) N may make it unstable", str(report))
        assert found is not None
        bounds.add(round(math.log(float(found[1])), 1))
    assert len(bounds) == 1  # whatever is asked for
    assert math.exp(*bounds) < 1e6


def test_a_step_that_bears_only_a_soft_tendon_warns() -> None:
    slow = arm(0, DRIVES["motor"][0]).replace('timestep="1e-3"', 'timestep="0.05"')
    with pytest.warns(CableWarning, match="give its joints more `armature`"):
        taken(slow)


FINGER = """<mujoco><option timestep="{step}"/><worldbody>
    <site name="base" pos="-.05 0 .01"/>
    <body><joint name="mcp" axis="0 1 0" stiffness=".5" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 .05 0 0" size=".008" mass=".05"/>
      <site name="p" pos=".01 0 .01"/><site name="q" pos=".04 0 .01"/>
      <body pos=".05 0 0"><joint name="pip" axis="0 1 0" stiffness=".5" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 .04 0 0" size=".007" mass=".03"/>
        <site name="tip" pos=".015 0 .01"/></body></body></worldbody>
  <tendon><spatial name="t"><site site="base"/><site site="p"/><site site="q"/>
    <site site="tip"/></spatial></tendon>
  <actuator><motor name="x" tendon="t" gear="-1" ctrlrange="0 {pull}"/></actuator>
</mujoco>"""


@pytest.mark.filterwarnings("ignore::cc_mujoco.errors.CableWarning")
def test_the_stiffness_by_default_is_stable_under_the_pull_of_its_actuators(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """At once, at any step; or it is refused with a step that it bears."""
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    refused_at = []
    for pull in (0.1, 1.0, 10.0, 30.0):
        for step in (5e-4, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2):
            xml = FINGER.format(step=step, pull=pull)
            try:
                model, _ = taken(xml, 0.1)
            except CableError as error:
                refused_at.append((pull, step))
                found = re.search(r"shorten the timestep to (\S+) s", str(error))
                assert found is not None
                model, _ = taken(FINGER.format(step=found[1], pull=pull), 0.1)
            data = mujoco.MjData(model)
            data.ctrl[0] = pull
            mujoco.mj_step(model, data, round(1.0 / model.opt.timestep))
            tension = read(model, data, "t").tension_proximal
            assert 0.5 * pull < tension < 2.0 * pull, (pull, step)
    assert "stable only" not in capfd.readouterr().err
    assert (10.0, 1e-2) in refused_at and (10.0, 2e-3) not in refused_at


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        ("motor", ""),
        ("position", 'kp="10"'),
        ("intvelocity", 'kp="10" actrange="-1 1"'),
        ("velocity", 'kv="2"'),
        ("damper", 'kv="2" ctrlrange="0 1"'),
        ("cylinder", 'area="2" timeconst="0.1"'),
    ],
)
def test_an_actuator_is_called_what_it_was_written_as(kind: str, numbers: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='j'/><geom size='1'/></body></worldbody>"
        f"<actuator><{kind} joint='j' {numbers}/></actuator></mujoco>"
    )
    assert kind_of(model, 0) == ("general" if kind == "cylinder" else kind)
