"""An end of a cable pulls with its tension under any defaults of actuators."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.errors import CableError

DEFAULTS = """<mujoco><default><general damping="5" armature="0.1" forcerange="-1 1"
  ctrlrange="-1 1" dyntype="muscle" gaintype="muscle" biastype="muscle" delay="0.01"
  nsample="20" group="3"/></default></mujoco>"""


def arm(defaults: str = "<mujoco/>", name: str = "cord") -> mujoco.MjSpec:
    """Return a link, a winch, and a tendon between them without friction yet."""
    spec = mujoco.MjSpec.from_string(defaults)
    spec.option.timestep = 5e-4
    world = spec.worldbody
    world.add_site(name="from")
    world.add_site(name="over", pos=[0.1, 0, 0.05])
    for part, place in (("link", 0.2), ("winch", -0.1)):
        body = world.add_body(pos=[place, 0, 0])
        body.add_joint(name=part, axis=[0, 1, 0])
        body.add_geom(size=[0.02, 0, 0])
        body.add_site(name=f"on_{part}", pos=[0.05, 0, 0.02])
    tendon = spec.add_tendon(name=name)
    for site in ("from", "over", "on_link"):
        tendon.wrap_site(site)
    return spec


def roped(defaults: str = "<mujoco/>", name: str = "cord") -> mujoco.MjSpec:
    """Return the same scene with friction."""
    spec = arm(defaults, name)
    cc_mujoco.add_friction(spec, name, motor=("winch", 0.02), friction=0.2)
    return spec


def played(model: mujoco.MjModel) -> np.ndarray:
    """Return the positions of the joints after the cord has been wound."""
    data = mujoco.MjData(model)
    data.joint("winch").qfrc_applied[:] = 0.3
    mujoco.mj_step(model, data, 200)
    return np.array(data.qpos)


def test_defaults_of_actuators_do_not_reach_the_ends() -> None:
    plain, spec = roped().compile(), roped(DEFAULTS)
    model = spec.compile()
    for field in (
        "damping",
        "armature",
        "forcelimited",
        "dyntype",
        "group",
        "gaintype",
    ):
        ours, theirs = (getattr(m, f"actuator_{field}") for m in (model, plain))
        assert np.array_equal(ours, theirs), field
    assert model.na == 0
    assert np.array_equal(played(model), played(plain))


def test_written_as_xml_they_do_not_reach_them_either() -> None:
    spec = roped(DEFAULTS.replace('"muscle"', '"none"').replace('gaintype="none"', ""))
    spec.compile()
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert played(again) == pytest.approx(played(roped().compile()), rel=1e-6)


@pytest.mark.parametrize(
    ("field", "value"), [("damping", [5, 0, 0]), ("damping", [0, 1, 0]),
                         ("damping", [0, 0, 1]), ("armature", 0.1)],
)  # fmt: skip
@pytest.mark.parametrize("end", ["proximal", "distal"])
def test_what_an_end_has_beside_its_tension_is_refused(
    field: str, value: object, end: str
) -> None:
    spec = roped()
    setattr(spec.actuator(f"cord_{end}"), field, value)
    with pytest.raises(ValueError, match=f"'cord_{end}' has an? `{field}`"):
        spec.compile()


SET = {
    "actuator_forcelimited": (0, 1, "'cord_proximal' has a `forcerange`"),
    "actuator_damping": (1, 3.0, "'cord_distal' has a `damping`"),
    "actuator_armature": (1, 0.2, "'cord_distal' has an `armature`"),
    "jnt_actfrclimited": (1, 1, "pulls a joint that has an `actuatorfrcrange`"),
    "tendon_stiffness": (0, 100.0, "its tendon has a `stiffness`"),
    "tendon_damping": (0, 10.0, "its tendon has a `damping`"),
    "tendon_frictionloss": (0, 1.0, "its tendon has a `frictionloss`"),
}


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("field", SET)
def test_what_is_set_on_the_compiled_model_is_told_when_a_simulation_begins(
    field: str,
    again: bool,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: object,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(str(tmp_path))  # MuJoCo writes its log there
    place, value, told = SET[field]
    name = f"{field}{again}"  # as nothing is told twice
    model = roped(name=name).compile()
    data = mujoco.MjData(model)
    if again:
        mujoco.mj_step(model, data, 3)
    warned = [x for x in capfd.readouterr().err.splitlines() if "WARNING" in x]
    assert all("the period of its ends" in line for line in warned)
    getattr(model, field)[place] = value
    if again:
        mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, 3)
    error = capfd.readouterr().err
    assert error.count(told.replace("cord", name)) == 1, error


def test_a_model_that_does_not_compile_says_why() -> None:
    spec = arm()
    spec.tendon("cord").wrap_site("nowhere")
    with pytest.raises(CableError, match="site 'nowhere' not found"):
        cc_mujoco.add_friction(spec, "cord", friction=0.1)
    spec = arm()
    spec.worldbody.add_body(name="light").add_joint()
    with pytest.raises(CableError, match="mass and inertia of moving bodies"):
        cc_mujoco.add_friction(spec, "cord", friction=0.1)
    with pytest.raises(CableError, match="by its name or its index"):
        cc_mujoco.add_friction(spec, spec.tendon("cord"), friction=0.1)  # type: ignore[arg-type]


TURNING = """<mujoco><option timestep="1e-3" gravity="0 0 0"/><worldbody>
  <site name="from" pos="-.3 0 0"/><geom name="drum" type="cylinder" size=".1 .1"
    euler="90 0 0"/>
  <body><joint name="spin" axis="0 1 0" armature="1"/>
    <geom size=".01" contype="0" conaffinity="0"/>
    <site name="side" pos="0 0 .2"/></body>
  <body pos=".3 0 0"><joint name="slide" type="slide" damping="50"/>
    <geom size=".02" contype="0" conaffinity="0"/><site name="to"/></body></worldbody>
  <tendon><spatial name="NAME"><site site="from"/>
    <geom geom="drum" sidesite="SIDE"/><site site="to"/></spatial></tendon></mujoco>"""


@pytest.mark.parametrize("integrator", ["EULER", "RK4"])
@pytest.mark.parametrize("turns", [True, False])
def test_a_path_that_jumps_is_told(
    integrator: str,
    turns: bool,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: object,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(str(tmp_path))
    name = f"{integrator}{turns}"
    text = TURNING.replace("NAME", name).replace("SIDE", "side")
    spec = mujoco.MjSpec.from_string(text)
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    # Off the middle, so that one way around is longer.
    spec.site("from").pos = [-0.3, 0, 0.05]
    spec.site("to").pos = [0, 0, 0.05]
    cc_mujoco.add_friction(spec, name, friction=0.1, axial_stiffness=500.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("spin").qvel[:] = 6.0 if turns else 0.0
    data.joint("slide").qvel[:] = 0.0 if turns else 2.0
    mujoco.mj_step(model, data, 800)
    error = capfd.readouterr().err
    assert error.count("its path jumped, without the velocity") == turns, error


def test_an_open_tendon_in_another_pose_is_told_unless_it_is_settled(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: object,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(str(tmp_path))
    for lay in (cc_mujoco.plugin.settle, mujoco.mj_forward):
        spec = arm(name=lay.__name__)
        cc_mujoco.add_friction(spec, lay.__name__, friction=0.2)
        model = spec.compile()
        data = mujoco.MjData(model)
        data.joint("link").qpos[:] = 0.5
        lay(model, data)
        mujoco.mj_step(model, data, 2)
        told = "its path jumped" in capfd.readouterr().err
        assert told is (lay is mujoco.mj_forward)
