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
from cc_mujoco.plugin import AddedCables, read, route_wrap, step_limits
from cc_mujoco.plugin._tendons.burden import kind_of

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
) -> tuple[mujoco.MjModel, AddedCables]:
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


SPRING: dict[str, Any] = {"stiffness": [60.0, 0.0, 0.0], "springlength": [0.0, 0.15]}
LIMIT: dict[str, Any] = {"range": [0.0, 0.23]}
DRY: dict[str, Any] = {"frictionloss": 1.0}
ON = mujoco.mjtLimited.mjLIMITED_TRUE
YIELDS = hasattr(mujoco.MjsTendon, "springyield")  # from MuJoCo 4.0
YIELD = ' springyield=".02"' if YIELDS else ""
CARRIED: dict[str, dict[str, Any]] = {
    "stiffness": SPRING | {"stiffness": [60.0, 300.0, 0.0]},
    "springlength": SPRING | {"springlength": [0.0, 0.18]},
    **({"springyield": SPRING | {"springyield": 0.05}} if YIELDS else {}),
    "damping": {"damping": [3.0, 5.0, 0.0]},
    "frictionloss": DRY,
    "solref_friction": DRY | {"solref_friction": [0.05, 1.0]},
    "solimp_friction": DRY | {"solimp_friction": [0.5, 0.6, 1e-3, 0.5, 2.0]},
    "range": LIMIT,
    "limited": LIMIT | {"limited": ON},
    "margin": LIMIT | {"margin": 0.004},
    "solref_limit": LIMIT | {"solref_limit": [0.04, 1.0]},
    "solimp_limit": LIMIT | {"solimp_limit": [0.8, 0.9, 1e-3, 0.5, 2.0]},
    "actfrcrange": {"actfrcrange": [-5.0, 5.0]},
    "actfrclimited": {"actfrclimited": ON, "actfrcrange": [-5.0, 5.0]},
    "armature": {"armature": 0.3},
}
"""Attributes of a tendon that a winch takes over, with what makes them act."""
KEPT: dict[str, Any] = {
    "group": 3, "material": "red", "rgba": [0.1, 0.2, 0.3, 0.4], "width": 0.007,
    "userdata": [1.5, 2.5],
}  # fmt: skip
"""Attributes that stay on the tendon."""
IDENTITY = {"name", "path", "id", "info", "signature", "compiler"}


def test_every_attribute_of_a_tendon_is_known() -> None:
    """A new one, of a MuJoCo to come, must be carried, kept or refused."""
    tendon = mujoco.MjSpec().add_tendon(name="t")
    there = {
        name
        for name in dir(tendon)
        if not name.startswith("_") and not callable(getattr(tendon, name))
    }
    assert there == set(CARRIED) | set(KEPT) | IDENTITY


@pytest.mark.parametrize("attribute", CARRIED)
def test_without_friction_each_attribute_of_a_tendon_acts_as_before(
    attribute: str,
) -> None:
    given, law = CARRIED[attribute], DRIVES["motor"][1]
    plain, spec, without = (
        mujoco.MjSpec.from_string(arm(0, DRIVES["motor"][0])) for _ in range(3)
    )
    for changed in (plain, spec, without):
        for field, value in given.items():
            if changed is not without or field != attribute:
                setattr(changed.tendon("t"), field, value)
    report = cc_mujoco.add_friction(spec, "t", friction=0.0)
    before, after = moved(plain.compile(), law), moved(spec.compile(), law)
    share = 0.12 if "range" in given else 0.03  # at an impact
    error = np.abs(after - before).max()
    assert error < share * np.ptp(before) + 2e-3, f"{error} of {np.ptp(before)}"
    feature = "actuatorfrcrange" if "actfrcrange" in given else next(iter(given))
    assert any(line.startswith(feature) for line in report.lines)
    if attribute in ("stiffness", "springyield", "damping", "armature", "actfrcrange"):
        change = np.abs(moved(without.compile(), law) - before).max()
        assert change > 2.0 * error  # so that losing it would have been noticed


@pytest.mark.parametrize("drive", ["", DRIVES["motor"][0]])
def test_what_is_not_mechanical_stays_on_the_tendon(drive: str) -> None:
    spec = mujoco.MjSpec.from_string(arm(0, drive))
    for color in ("blue", "red"):
        spec.add_material(name=color)
    spec.nuser_tendon = 2
    for field, value in KEPT.items():
        setattr(spec.tendon("t"), field, value)
    before = spec.copy().compile()
    cc_mujoco.add_friction(spec, "t", friction=0.1)
    after = spec.compile()
    for field in ("group", "matid", "rgba", "width", "user"):
        own, old = (getattr(m, f"tendon_{field}")[0] for m in (after, before))
        assert np.array_equal(own, old), field
        assert np.any(old), field


LISTS = (
    "bodies", "joints", "geoms", "sites", "tendons", "actuators", "sensors",
    "equalities", "excludes", "tuples", "numerics", "texts", "keys",
)  # fmt: skip


def elements(spec: mujoco.MjSpec) -> dict[str, list[str]]:
    """Return the names of all elements by kind, in their order."""
    return {kind: [x.name for x in getattr(spec, kind)] for kind in LISTS}


@pytest.mark.parametrize(
    ("drive", "burden"),
    [
        ("", ""),
        ("", 'stiffness="60" springlength="0 .15"'),
        (DRIVES["motor"][0], 'range="0 .4"'),
        (DRIVES["motor"][0], 'stiffness="60" springlength="0 .15"' + YIELD),
    ],
)
def test_all_else_of_a_model_is_kept_in_its_order(drive: str, burden: str) -> None:
    ctrl = 'ctrl="2"' if drive else ""
    numbers = ".1 .2 .3 .4" if "yield" in burden else ".3 .4"
    plastic = f'plastic="{numbers}"' if YIELDS else ""
    xml = arm(0, drive, burden).replace(
        "</tendon>", f'<fixed name="u" stiffness="1"{YIELD}><joint '
        'joint="knee" coef="1"/></fixed></tendon>'
    ).replace("</mujoco>", f"""<sensor><tendonpos name="l" tendon="t"/>
      <tendonvel tendon="t"/><jointpos name="t" joint="knee"/></sensor>
      <equality><tendon name="pair" tendon1="u" active="false"/></equality>
      <contact><exclude name="no" body1="world" body2="fore"/></contact>
      <custom><numeric name="n" data="1"/><text name="w" data="a"/>
        <tuple name="both"><element objtype="tendon" objname="t"/></tuple></custom>
      <keyframe><key name="k" qpos="0.3" qvel=".2" {ctrl} {plastic}/>
      </keyframe></mujoco>""").replace("<body ", '<body name="fore" ')  # fmt: skip
    spec = mujoco.MjSpec.from_string(xml)
    there = elements(spec)
    before = spec.copy().compile()
    report = cc_mujoco.add_friction(spec, "t", friction=0.0)
    for kind, names in elements(spec).items():
        assert names[: len(there[kind])] == there[kind], kind
    after = spec.compile()
    if report.winch:
        assert "sensors 'l', '1': still read" in str(report)
    data = [mujoco.MjData(m) for m in (before, after)]
    for m, d in zip((before, after), data, strict=True):
        mujoco.mj_resetDataKeyframe(m, d, 0)
        mujoco.mj_forward(m, d)
    assert data[1].sensordata == pytest.approx(data[0].sensordata)
    assert data[1].qpos[0] == 0.3
    assert data[1].qvel[0] == 0.2
    assert np.array_equal(data[1].ctrl[: before.nu], data[0].ctrl)
    if YIELDS:
        assert np.array_equal(data[1].tendon("u").plastic, [0.3, 0.4])
    if "yield" in burden:
        assert np.array_equal(data[1].tendon("t_winch").plastic, [0.1, 0.2])
    assert after.tuple("both").objid == before.tuple("both").objid


@pytest.mark.parametrize("seed", [0, 3, 9])
def test_a_load_that_dry_friction_holds_does_not_fall_into_the_cable(seed: int) -> None:
    xml = arm(seed, DRIVES["motor"][0], 'frictionloss="4"')
    report = assert_moves_alike(xml, lambda t: 2.2 + 3.0 * (1.0 - math.cos(6.0 * t)))
    assert "what the dry friction holds in qpos0" in str(report)


@pytest.mark.parametrize("given", [{}, {"axial_stiffness": 9e3}])
def test_the_stiffness_of_a_tendon_without_a_load_is_reported(
    given: dict[str, float],
) -> None:
    spec = mujoco.MjSpec.from_string(arm(0, ""))
    report = cc_mujoco.add_friction(spec, "t", friction=0.1, **given)
    (cable,) = cc_mujoco.from_mjcf(spec).values()
    assert cable.axial_stiffness == given.get("axial_stiffness", 4e3)
    assert f"axial_stiffness {cable.axial_stiffness:g} N: it str" in str(report)


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


def hand(fingers: int, drive: str = "motor", gain: str = 'gear="-1"') -> str:
    """Return fingers beside each other, each with a tendon of its own."""
    bodies = tendons = drives = ""
    for i in range(fingers):
        bodies += f"""<site name="base{i}" pos="-.05 {0.1 * i} .01"/>
          <body pos="0 {0.1 * i} 0"><joint name="j{i}" axis="0 1 0" stiffness=".5"
            damping=".02" range="-10 60"/><site name="p{i}" pos=".01 0 .01"/>
          <geom type="capsule" fromto="0 0 0 .05 0 0" size=".008" mass=".05"/>
          <site name="tip{i}" pos=".04 0 .01"/></body>"""
        tendons += f"""<spatial name="t{i}"><site site="base{i}"/><site site="p{i}"/>
          <geom geom="post" sidesite="over"/><site site="tip{i}"/></spatial>"""
        drives += f'<{drive} tendon="t{i}" {gain}/>'
    return f"""<mujoco><worldbody><geom name="post" type="sphere" size=".001"
      pos="0 0 9"/><site name="over" pos="0 0 8"/>{bodies}</worldbody>
      <tendon>{tendons}</tendon><actuator>{drives}</actuator></mujoco>"""


def bent(spec: mujoco.MjSpec) -> np.ndarray:
    """Return the angles of all joints of fingers that their tendons pull [rad]."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[:3] = 0.5, 1.0, 2.0
    mujoco.mj_step(model, data, 100)
    return np.array([data.joint(f"j{i}").qpos[0] for i in range(3)])


def test_several_tendons_at_once_are_as_one_after_another() -> None:
    once, each = (mujoco.MjSpec.from_string(hand(3)) for _ in range(2))
    friction = {"t0": 0.1, "t1": 0.2, "t2": 0.3}
    report = cc_mujoco.add_friction(once, list(friction), friction=friction)
    for name, mu in friction.items():
        single = cc_mujoco.add_friction(each, name, friction=mu)
        part = report.parts[int(name[1])]
        assert part.lines[:-1] == single.lines[:-1]  # before the places in ctrl
    assert report.cables == ("t0", "t1", "t2")
    assert [line.partition(";")[0] for line in report.lines] == [
        part.lines[0] for part in report.parts
    ]
    assert "winch 't0_winch': motor 0" in report.lines[0]
    assert bent(once) == pytest.approx(bent(each), rel=1e-3)


def test_several_tendons_take_no_more_trial_models_than_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    compiled: list[int] = []
    compile_ = mujoco.MjSpec.compile

    def counted(spec: mujoco.MjSpec, *more: Any) -> mujoco.MjModel:
        compiled.append(len(spec.tendons))
        return compile_(spec, *more)

    monkeypatch.setattr(mujoco.MjSpec, "compile", counted)
    counts = []
    for fingers in (1, 6):
        spec = mujoco.MjSpec.from_string(hand(fingers))
        compiled.clear()
        names = [f"t{i}" for i in range(fingers)]
        cc_mujoco.add_friction(spec, names, friction=0.1)
        counts.append(len(compiled))
    assert counts[0] == counts[1] < 6
    assert "never touches" not in capfd.readouterr().err
    model = spec.compile()
    mujoco.mj_step(model, mujoco.MjData(model))
    assert capfd.readouterr().err.count("never touches") == 6


def test_tendons_without_names_are_given_by_index() -> None:
    path = '<site site="a"/><site site="post"/><site site="b"/>'
    xml = arm(0).replace('name="t"', "").replace(
        "</tendon>", f'<spatial name="tendon_0">{path}</spatial></tendon>'
    )  # fmt: skip
    spec = mujoco.MjSpec.from_string(xml)
    report = cc_mujoco.add_friction(spec, [0, 1], friction={0: 0.1, "tendon_0": 0.2})
    assert report.cables == ("tendon_0_", "tendon_0")
    assert "friction 0.2" in report.lines[1]
    assert cc_mujoco.tendon_report(spec, 0).tendons[0].name == "tendon_0_"
    refusals: list[tuple[str, Any, str]] = [
        (xml, "t", "1 of the 2 tendons here have no name; give an index, 0 to 1; names "
         "are 'tendon_0'"),
        (xml.replace('name="tendon_0"', ""), "t", "none of the 2 tendons here has a "
         "name; give an index, 0 to 1"),
        (xml, 2, "unknown tendon 2: .*give an index, 0 to 1"),
        (xml, -1, "unknown tendon -1"),
        (xml, 0.5, "by its name or its index, not 0.5"),
        (xml, [], "add_friction needs a tendon"),
        ("<mujoco/>", 0, "there is no tendon here"),
    ]  # fmt: skip
    for text, which, why in refusals:
        with pytest.raises(CableError, match=why):
            cc_mujoco.add_friction(mujoco.MjSpec.from_string(text), which, friction=0.1)
    with pytest.raises(CableError, match=r"unknown tendon in friction= 'u'"):
        cc_mujoco.add_friction(
            mujoco.MjSpec.from_string(arm(0)), "t", friction={"u": 0.1}
        )


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


def spokes() -> mujoco.MjSpec:
    """Return a bulb and two balls that a tendon of limited length draws together."""
    return mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body><freejoint/><site name="bulb"/>'
        '<geom name="bulb" size=".3" density="100" contype="0" conaffinity="0"/></body>'
        '<body pos=".2 0 0"><freejoint/><site name="a"/><geom size=".03"/></body>'
        '<body pos="1.2 0 0"><freejoint/><site name="b"/><geom size=".1"/></body>'
        '</worldbody><tendon><spatial name="t" range="0 .5"><site site="a"/>'
        '<geom geom="bulb" sidesite="bulb"/><site site="b"/></spatial></tendon>'
        "</mujoco>"
    )


def test_a_range_that_qpos0_violates_is_warned_of_with_its_size() -> None:
    with pytest.warns(CableWarning, match="1 m long in `qpos0`, 0.5 m out of its"):
        report = cc_mujoco.add_friction(spokes(), "t", friction=0.1)
    assert sum("0.5 m out of its `range` of 0 to 0.5 m" in x for x in report.lines) == 1
    inside = spokes()
    inside.tendon("t").range = [0.0, 1.0]
    report = cc_mujoco.add_friction(inside, "t", friction=0.1)  # without a warning
    assert not any("out of its" in line for line in report.lines)


def test_the_step_that_pieces_bear_in_motion_is_reported() -> None:
    spec = spokes()
    spec.tendon("t").range = [0.0, 1.0]
    report = cc_mujoco.add_friction(spec, "t", friction=0.1)
    (line,) = (x for x in report.lines if x.startswith("timestep: "))
    model = spec.compile()
    worst = step_limits(model)["t"].pieces
    assert "in the worst pose over the ranges of its joints" in line
    assert f"stable only below {1e3 * worst:.3g} ms, and it is 2 ms" in line
    # No motion needs a shorter step.
    data, shortest = mujoco.MjData(model), math.inf
    data.qvel[:] = np.random.default_rng(0).normal(0.0, 1.0, model.nv)
    model.opt.timestep = 2e-4
    for _ in range(40):
        mujoco.mj_step(model, data, 50)
        here = mujoco.MjData(model)
        here.qpos[:] = data.qpos
        shortest = min(shortest, step_limits(model, here)["t"].pieces)
    assert worst <= shortest
