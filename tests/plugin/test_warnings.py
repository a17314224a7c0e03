"""Warnings of a cable when a simulation begins: once, in one sentence, or none."""

from __future__ import annotations

import itertools
import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import Cable, Section
from cc_mujoco.plugin import cables, make_room, settle, to_mjcf, write_cable

POSTS = """<mujoco><option timestep="1e-3" gravity="0 0 0"/><worldbody>
<geom name="drum" type="cylinder" size="0.05 0.03" euler="90 0 0" pos="0 0 1"/>
<site name="over" pos="0 0 1.07"/><site name="m" pos="-.05 0 .7"/>
<body pos="-.05 0 .5"><joint name="l" type="slide" axis="0 0 1"/>
  <geom size=".02" mass="1"/><site name="l"/></body>
<body pos=".05 0 .5"><joint name="h" type="slide" axis="0 0 1"/>
  <geom size=".02" mass="1"/><site name="h"/></body>
<body><joint name="w" axis="0 1 0" armature="1e-3"/><geom size=".02" mass=".1"/></body>
<body><joint name="v" axis="0 1 0" armature="1e-3"/><geom size=".02" mass=".1"/></body>
</worldbody><tendon><spatial name="{name}">{path}</spatial></tendon></mujoco>"""
PATHS = {
    "geom": '<site site="l"/><geom geom="drum" sidesite="over"/><site site="h"/>',
    "sites": '<site site="l"/><site site="over"/><site site="h"/>',
    "straight": '<site site="l"/><site site="m"/>',
}
DRUMS = {"motor": ("w", 0.02), "joint": ("v", 0.02)}
PER_LENGTH = ("viscous_friction", "load_independent_friction", "grease_drag")
_names = (f"cable_{i}" for i in itertools.count())
"""A warning comes once in a process, so every model has a cable of its own name."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let MuJoCo write its log here."""
    monkeypatch.chdir(tmp_path)


def warned(what: mujoco.MjModel | None = None, steps: int = 2) -> list[str]:
    """Return what MuJoCo has warned of, after it has stepped a model."""
    if what is not None:
        mujoco.mj_step(what, mujoco.MjData(what), steps)
    log = Path("MUJOCO_LOG.TXT")
    lines = log.read_text().splitlines() if log.exists() else []
    return [line for line in lines if "instance 'cable_" in line]


def over(path: str, **given: object) -> mujoco.MjModel:
    """Return two sledges on a cord, of an own name, over a post."""
    name = next(_names)
    spec = mujoco.MjSpec.from_string(POSTS.format(path=PATHS[path], name=name))
    given = {"friction": 0.2, "axial_stiffness": 2e3, "pretension": 20} | given
    cc_mujoco.add_friction(spec, name, **given)
    return spec.compile()


def final(m: mujoco.MjModel) -> np.ndarray:
    """Return tensions after the ends were led to and fro by hand [N]."""
    d = mujoco.MjData(m)
    for i in range(150):
        d.qpos[:] = 1e-3 * i * np.array([0.2, -0.22, 5.0, -4.0])
        mujoco.mj_step(m, d)
    return cc_mujoco.read(m, d, cables(m)[0]).tension


@pytest.mark.parametrize("drums", [False, True], ids=["tied", "drums"])
@pytest.mark.parametrize("path", ["geom", "sites"])
@pytest.mark.parametrize(
    "key", [*PER_LENGTH, "wrap_growth", "eccentricity", "ovality", "friction"]
)
def test_a_term_of_an_open_path_acts_or_is_warned_of(
    path: str, key: str, drums: bool
) -> None:
    ends = DRUMS if drums else {}
    value = {"eccentricity": 2e-3, "ovality": 2e-3, "friction": 0.3}.get(key, 9)
    m = over(path, ends="explicit", **(ends | {key: value}))
    without = final(over(path, ends="explicit", **ends))
    # Other solvers find the same tensions, but for rounding.
    acts = not np.allclose(final(m), without, rtol=1e-9)
    assert acts != any(f"key `{key}` has no effect" in line for line in warned())


def test_friction_on_a_path_without_a_bend_is_warned_of() -> None:
    (line,) = warned(over("straight", **DRUMS))
    assert "key `friction` has no effect: the path rubs at no site" in line
    assert len(warned(over("straight", **(DRUMS | {"friction": 0.0})))) == 1


@pytest.mark.parametrize("ends", [DRUMS, {"motor": DRUMS["motor"]}, {}])
@pytest.mark.parametrize("pretension", [5.0, 39.0, 41.0, 400.0])
def test_soft_rope_on_a_drum_is_warned_of(
    pretension: float, ends: dict[str, tuple[str, float]]
) -> None:
    issued = warned(over("geom", pretension=pretension, ends="explicit", **ends))
    soft = [line for line in issued if "its pretension stretches it by" in line]
    assert len(soft) == (bool(ends) and pretension > 40.0)
    assert all(f"by {pretension / 20.0:.3f} %, and rope" in line for line in soft)


@pytest.mark.parametrize("gap", [0.0, 1e-3])
def test_sites_in_one_place_are_warned_of_as_a_small_gap_is(gap: float) -> None:
    name = next(_names)
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option timestep="1e-3"/><worldbody>
        <site name="a" pos="-.3 0 0"/><site name="b" pos="0 0 .05"/>
        <body pos="{gap} 0 .05"><joint type="slide" axis="1 0 0" stiffness="200"/>
          <geom size=".03" mass="1"/><site name="c"/><site name="e" pos=".1 0 -.1"/>
        </body><body pos="-.4 0 0"><joint name="w" axis="0 1 0" armature="1e-3"/>
          <geom size=".02" mass=".1"/></body></worldbody><tendon>
        <spatial name="{name}"><site site="a"/><site site="b"/><site site="c"/>
          <site site="e"/></spatial></tendon></mujoco>"""
    )
    cc_mujoco.add_friction(
        spec, name, motor=("w", 0.02), friction=0.3, axial_stiffness=5e4
    )
    (line,) = warned(spec.compile())
    stable = float(line.partition("only with a `timestep` below ")[2].split()[0])
    assert 5e-3 < stable < 0.5


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"seating_tension": 6.0}, ["`seating_tension` has no effect: clearance is 0"]),
        ({"grease_exponent": 1.0}, ["`grease_exponent` has no effect: grease_drag is"]),
        ({"conduit": (Section(1.0, 0.3, 2.0, 1.0),)}, ["factors in `conduit` have no"]),
        ({"clearance": 1e-4, "conduit": (Section(1.0, np.inf),)}, ["no section bends"]),
        ({"clearance": 1e-4, "seating_tension": 6.0}, []),
        ({}, []),
    ],
)
def test_a_key_without_the_one_that_it_scales_is_warned_of(
    given: dict[str, object], expected: list[str]
) -> None:
    spec = mujoco.MjSpec.from_string(POSTS.format(path=PATHS["sites"], name="rope"))
    cable = Cable(conduit=(Section(1.0, 0.3),)).replace(**given)
    to_mjcf(spec, next(_names), cable, *DRUMS.values())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        spec.compile()
    assert len(caught) == len(expected)
    for one, text in zip(caught, expected, strict=True):
        assert text in str(one.message)


@pytest.mark.parametrize("soft", [{}, {"clearance": 1e-4, "end_compliance": 1e-4}])
@pytest.mark.parametrize("value", [-1e5, -50.0, np.nan])
def test_a_state_that_no_cable_has_is_named(
    soft: dict[str, float], value: float
) -> None:
    spec = mujoco.MjSpec.from_string(POSTS.format(path=PATHS["sites"], name="rope"))
    cable = Cable(conduit=(Section(1.0, 0.3),)).replace(**soft)
    to_mjcf(spec, next(_names), cable, *DRUMS.values())
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 3)
    assert not any("`plugin_state` is not" in line for line in warned())
    data.plugin_state[:] = value
    mujoco.mj_step(model, data, 3)
    (line,) = [line for line in warned() if "`plugin_state` is not" in line]
    assert "reset the data" in line


def test_models_that_are_not_finished_are_not_warned_of() -> None:
    names = [next(_names) for _ in range(3)]
    bodies = "".join(
        f'<site name="a{name}"/><body pos=".2 0 0"><joint axis="0 1 0"/>'
        f'<geom size=".02"/><site name="b{name}" pos=".05 0 .02"/></body>'
        for name in names
    )
    tendons = "".join(
        f'<spatial name="{name}"><site site="a{name}"/><site site="b{name}"/></spatial>'
        for name in names
    )
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="0.01"/><worldbody>{bodies}</worldbody>'
        f"<tendon>{tendons}</tendon></mujoco>"
    )
    for name in names:
        cc_mujoco.add_friction(spec, name, friction=0.0, axial_stiffness=1e5)
    assert warned() == []
    assert len(warned(spec.compile())) == 3


LEVER = """<mujoco><option timestep="1e-3" integrator="{integrator}"/><worldbody>
<body name="hull"><body>
  <joint name="m" axis="0 1 0" armature="1e-3" damping=".5" {own}/>
  <geom size=".02"/></body><site name="near"/></body>
<body pos="1 0 0"><joint name="j" axis="0 1 0" stiffness="5" damping=".2"/>
  <geom size=".02" mass="1"/><site name="far" pos=".1 0 0"/></body>
<site name="post" pos="1 0 .3"/></worldbody><tendon>
<spatial name="way"><site site="near"/><site site="far"/></spatial>
<spatial name="held"><site site="post"/><site site="far"/></spatial></tendon>
<actuator>{more}</actuator></mujoco>"""


def lever(
    proximal: tuple[str, float],
    distal: tuple[str, float],
    own: str = "",
    more: str = "",
    integrator: str = "Euler",
    **given: object,
) -> mujoco.MjModel:
    """Return a motor `m` and a lever `j`, with a cable between two of its parts."""
    text = LEVER.format(own=own, more=more, integrator=integrator)
    spec = mujoco.MjSpec.from_string(text)
    keys = {"axial_stiffness": 2e4, "pretension": 20.0, "friction": 0.1} | given
    cable = Cable(conduit=(Section(1.0, 0.5),), segments=20, **keys)
    held = spec.tendon("held")
    ends = [(held if e[0] == "held" else e[0], e[1]) for e in (proximal, distal)]
    to_mjcf(spec, next(_names), cable, *ends)
    return spec.compile()


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_a_state_restored_without_its_cables_is_warned_of(integrator: str) -> None:
    m = lever(
        ("m", -0.02),
        ("j", -0.03),
        more='<position joint="m" kp="20"/>',
        integrator=integrator,
    )
    d = mujoco.MjData(m)
    settle(m, d)
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d, 200)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(m, full))
    mujoco.mj_getState(m, d, state, full)
    qpos, qvel = d.qpos.copy(), d.qvel.copy()
    d.ctrl[0] = 0.55
    mujoco.mj_step(m, d, 60)
    assert 1e-4 < 0.02 * abs(d.qpos[0] - qpos[0]) < 2e-3
    mujoco.mj_setState(m, d, state, full)
    mujoco.mj_step(m, d, 60)
    assert warned() == []
    d.qpos[:], d.qvel[:] = qpos, qvel
    mujoco.mj_step(m, d)
    (first, *_) = warned()
    for remedy in ('rope="keep"', 'rope="remount"', "restore a state with its"):
        assert remedy in first


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_by_hand_is_no_jump_until_a_step_exceeds_its_velocity(
    seed: int,
) -> None:
    """The motion turns often; there the velocity after a step is about zero."""
    rng = np.random.default_rng(seed)
    m = lever(("m", -0.02), ("held", 1.0), pretension=1.0)
    m.opt.timestep = dt = rng.uniform(5e-4, 5e-3)
    time = dt * np.arange(600)
    waves = 2.0 * np.pi * rng.uniform(0.5, 6.0, (4, 1))
    turned = np.sin(waves * time + rng.uniform(0.0, 6.0, (4, 1)))
    angles = rng.normal(0.0, 0.3, (m.nq, 4)) @ turned
    speeds = np.gradient(angles, dt, axis=1)
    d = mujoco.MjData(m)
    d.qpos[:] = angles[:, 0]
    settle(m, d)
    for position, velocity in zip(angles.T, speeds.T, strict=True):
        d.qpos[:], d.qvel[:] = position, velocity
        mujoco.mj_step(m, d)
    assert warned() == []
    d.qpos[:], d.qvel[:] = angles[:, -1], speeds[:, -1]
    d.qpos[0] += 1.6 * np.abs(speeds[0, -2:]).max() * dt + 0.11
    mujoco.mj_step(m, d)
    assert "its proximal end jumped" in warned()[0]


def test_a_joint_set_by_hand_elsewhere_and_small_differences_are_no_jump() -> None:
    m = lever(("m", -0.02), ("held", 1.0))
    d = mujoco.MjData(m)
    settle(m, d)
    for _ in range(20):
        d.qpos[:] += 1e-6
        mujoco.mj_step(m, d)
    assert warned() == []


@pytest.mark.parametrize("speed", [3.0, 30.0])
def test_a_mocap_body_may_be_fast(speed: float) -> None:
    name = next(_names)
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option timestep="1e-3" gravity="0 0 0"/><worldbody>
        <site name="a" pos="-.3 0 0"/>
        <body mocap="true"><site name="x" pos="0 0 .1"/></body>
        <body pos=".4 0 0"><joint type="slide" axis="1 0 0" stiffness="20"/>
          <geom size=".03" mass="1"/><site name="b"/></body></worldbody><tendon>
        <spatial name="{name}"><site site="a"/><site site="x"/><site site="b"/>
        </spatial></tendon></mujoco>"""
    )
    cc_mujoco.add_friction(spec, name, friction=0.1, axial_stiffness=100)
    m = spec.compile()
    d = mujoco.MjData(m)
    for i in range(50):
        d.mocap_pos[0, 2] = 1e-3 * speed * i
        mujoco.mj_step(m, d)
    assert d.ten_length[0] > 0.8
    assert warned() == []


def test_a_geom_that_the_path_never_touches_is_named() -> None:
    text = POSTS.format(path=PATHS["geom"], name="{name}")
    for place, touched in (("0 0 1", True), ("5 0 1", False)):
        name = next(_names)
        spec = mujoco.MjSpec.from_string(
            text.format(name=name).replace("0 0 1", place, 1)
        )
        cc_mujoco.add_friction(spec, name, friction=0.1, axial_stiffness=100)
        lines = [line for line in warned(spec.compile()) if f"'{name}'" in line]
        assert len(lines) == (0 if touched else 1)
    assert "its path never touches geom 'drum'" in lines[0]


def test_a_geom_that_the_path_touches_in_another_pose_is_not_named() -> None:
    name = next(_names)
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><worldbody><site name="a" pos="-.3 0 .04"/>
        <geom name="knee" type="cylinder" size=".03 .02" zaxis="0 1 0"/>
        <body><joint axis="0 1 0" range="-10 100"/><geom size=".02" pos=".2 0 0"/>
          <site name="b" pos=".3 0 .04"/></body></worldbody><tendon>
        <spatial name="{name}"><site site="a"/><geom geom="knee"/><site site="b"/>
        </spatial></tendon></mujoco>"""
    )
    cc_mujoco.add_friction(spec, name, friction=0.1, axial_stiffness=100)
    m = spec.compile()
    assert m.tendon_length0[0] == pytest.approx(0.6)
    assert warned(m) == []


def test_each_model_of_equal_structure_is_warned_of_once() -> None:
    spec = mujoco.MjSpec.from_string(APART.format(name=(name := next(_names))))

    def issued(length: float, joint: float = 0.05) -> int:
        """Return the number of new warnings of a conduit that is too short."""
        before = [line for line in warned() if "key `conduit`" in line]
        cable = Cable(conduit=(Section(length, 1.0),), segments=5)
        to_mjcf(spec, name, cable, ("motor", 0.02), ("knee", joint))
        make_room(spec)
        model = spec.compile()
        text = model.plugin_attr.copy()
        for _ in range(2):
            data = mujoco.MjData(model)
            mujoco.mj_step(model, data, 2)
            write_cable(model, name, cable.replace(friction=0.2))
            mujoco.mj_resetData(model, data)
            mujoco.mj_step(model, data, 2)
            model.plugin_attr[:] = text
        return sum("key `conduit`" in line for line in warned()) - len(before)

    assert [issued(length) for length in (0.3, 0.3, 0.4, 5.5, 0.3)] == [1, 0, 1, 0, 0]
    assert issued(0.3, joint=0.06) == 1
    spec.body("knee").pos[0] += 0.1
    assert [issued(0.3), issued(0.3)] == [1, 0]


PAYS_OUT = "can only pay the cable out from its pose in `qpos0`"
ORDERS = {
    "right": (("m", -0.02), ("j", 0.02), {}, None),
    "tendon": (("m", -0.02), ("held", 1.0), {}, None),
    "pushes": (("m", -0.02), ("held", -1.0), {}, "pushes its tendon apart"),
    "range": (
        ("m", 0.02),
        ("j", 0.02),
        {"own": 'range="0 3"', "more": '<motor joint="m"/>'},
        PAYS_OUT,
    ),
    "range, right": (
        ("m", -0.02),
        ("j", 0.02),
        {"own": 'range="0 3"', "more": '<motor joint="m"/>'},
        None,
    ),
    "motor": (
        ("m", 0.02),
        ("j", 0.02),
        {"more": '<motor joint="m" ctrlrange="0 1"/>'},
        PAYS_OUT,
    ),
    "motor, right": (
        ("m", 0.02),
        ("j", 0.02),
        {"more": '<motor joint="m" ctrlrange="-1 1"/>'},
        None,
    ),
    "servo": (
        ("m", 0.02),
        ("j", 0.02),
        {"more": '<position joint="m" kp="10" ctrlrange="0 3"/>'},
        PAYS_OUT,
    ),
    "servo, right": (
        ("m", -0.02),
        ("j", 0.02),
        {"more": '<position joint="m" kp="10" ctrlrange="0 3"/>'},
        None,
    ),
    "route": (("m", -0.02), ("j", 0.02), {"route": "way"}, None),
    "route, swapped": (
        ("j", 0.02),
        ("m", -0.02),
        {"route": "way"},
        "is at the last site of the route",
    ),
}


@pytest.mark.parametrize("case", ORDERS)
def test_an_end_that_can_never_pull_is_warned_of(case: str) -> None:
    proximal, distal, given, wanted = ORDERS[case]
    lines = warned(lever(proximal, distal, **given))
    if wanted is None:
        assert lines == []
    else:
        assert len(lines) == 1
        assert wanted in lines[0]


APART = """<mujoco><option timestep="1e-4" gravity="0 0 0"/><worldbody>
<site name="a"/><site name="mouth" pos="5.2 0 0"/>
<body><joint name="motor" armature="1e-3"/><geom size=".02" mass=".1"/></body>
<body name="knee" pos="5.3 0 0"><joint name="knee" armature="1e-3"/>
  <geom size=".02" mass=".1"/>
  <site name="b" pos=".1 0 0"/></body></worldbody>
<tendon><spatial name="{name}"><site site="a"/><site site="mouth"/><site site="b"/>
</spatial></tendon></mujoco>"""


@pytest.mark.parametrize(
    ("keys", "apart"),
    [
        ({}, 5230),
        ({"route": True}, 5400),
        ({"route": True, "bend": "route"}, 5400),
        ({"route": True, "path": "mixed", "mouth": "mouth"}, 5200),
    ],
    ids=["joints", "route", "bend", "mixed"],
)
def test_a_conduit_that_is_too_short_for_its_ends_is_warned_of(
    keys: dict[str, object], apart: int
) -> None:
    for length in (0.3, 5.5):
        name = next(_names)
        spec = mujoco.MjSpec.from_string(APART.format(name=name))
        given = keys | ({"route": name} if "route" in keys else {})
        cable = Cable(
            conduit=(Section(length, 1.0),), friction=0.1, segments=5,
            axial_stiffness=1e4, **given,
        )  # fmt: skip
        distal = (spec.tendon(name), 1.0) if "path" in keys else ("knee", 0.05)
        to_mjcf(spec, name, cable, ("motor", 0.02), distal)
        issued = [x for x in warned(spec.compile()) if f"'{name}'" in x]
        if length < 1.0:
            (line,) = (x for x in issued if "key `conduit`" in x)
            assert "is 300.000 mm long" in line
            assert f"its ends are {apart}.000 mm apart" in line
        else:
            assert not any("key `conduit`" in x for x in issued)


@pytest.mark.parametrize("stiffness", [20.0, 150.0, 4e3])
def test_a_cable_that_its_pretension_tears_is_warned_of(stiffness: float) -> None:
    name = next(_names)
    spec = mujoco.MjSpec.from_string(APART.format(name=name))
    section = Section(5.5, 1.0)
    cable = Cable(conduit=(section,), axial_stiffness=stiffness, pretension=15.0)
    to_mjcf(spec, name, cable, ("motor", 0.02), ("knee", 0.05))
    issued = [x for x in warned(spec.compile()) if "stretches it by" in x]
    assert len(issued) == (stiffness == 20.0)
    assert all("by 75.000 %" in x and "`axial_stiffness` is" in x for x in issued)


ATTRIBUTES = {
    "acts": {
        "gear": "0.04",
        "instance": "other",
        "joint": "k",
        "plugin": "mujoco.pid",
        "site": "s",
        "tendon": "t",
        "jointinparent": "j",
    },
    "ignored": {
        "actdim": "1",
        "ctrlrange": "0 1",
        "delay": '0.01" nsample="5',
        "dyntype": "integrator",
    },
    "refused": {
        "actrange": "0 1",
        "armature": "1",
        "cranklength": "1",
        "cranksite": "s",
        "damping": "1",
        "forcerange": "0 1",
        "slidersite": "s",
    },
    "only with another one": {
        "actearly": "true",
        "actlimited": "false",
        "ctrllimited": "false",
        "dynprm": "3",
        "forcelimited": "false",
        "interp": "linear",
        "nsample": "5",
    },
    "no physics": {
        "class": "plain",
        "group": "3",
        "lengthrange": "0 1",
        "name": "end",
        "user": "1",
    },
}
"""Attributes that MuJoCo takes for <plugin> in <actuator>, and a value of each."""
PLUGINS = """<mujoco><option timestep="1e-3"/><default><default class="plain"/>
</default><extension><plugin plugin="cc_mujoco.cable"><instance name="{name}">
  <config key="axial_stiffness" value="4000"/><config key="friction" value=".1"/>
  <config key="pretension" value="10"/><config key="conduit" value="1:.3"/>
</instance></plugin></extension><worldbody>
<body><joint name="m" axis="0 1 0" armature="1e-3"/><geom size=".02"/></body>
<body name="hand" pos=".5 0 0"><joint name="j" axis="0 1 0" armature="1e-3"/>
  <geom size=".02"/><site name="s"/>{inside}</body></worldbody><actuator>
<motor joint="m" gear="0.1"/>
<plugin plugin="cc_mujoco.cable" instance="{name}" joint="m" gear=".02"/>
<plugin plugin="cc_mujoco.cable" instance="{name}" joint="j" {end}/>
</actuator>{more}</mujoco>"""


def pulled(end: str, name: str, inside: str = "", more: str = "") -> list[float]:
    """Return the position after some steps in which every control is 1."""
    text = PLUGINS.format(name=name, end=end, inside=inside, more=more)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    mujoco.mj_step(model, data, 20)
    return data.qpos.tolist()


def test_every_attribute_of_an_end_is_known_to_act_or_not() -> None:
    schema = mujoco.mj_printSchema(False, False)
    (listed,) = re.findall(r"plugin \(\*\) +(actdim.*?) config", schema, re.DOTALL)
    known = {each for kind in ATTRIBUTES.values() for each in kind}
    assert set(listed.split()) == known


@pytest.mark.parametrize("attribute", ATTRIBUTES["ignored"])
def test_an_attribute_of_an_end_without_effect_is_named(attribute: str) -> None:
    name, value = next(_names), ATTRIBUTES["ignored"][attribute]
    plain = pulled('gear=".03"', name)
    assert warned() == []
    assert pulled(f'gear=".03" {attribute}="{value}"', name) == plain
    (line,) = warned()
    assert f"its actuator 2 has `{attribute}`, its own or that of a default" in line


@pytest.mark.parametrize("attribute", ATTRIBUTES["refused"])
def test_an_attribute_that_an_end_cannot_have_is_refused(attribute: str) -> None:
    value = ATTRIBUTES["refused"][attribute]
    with pytest.raises(ValueError, match=f"{attribute}|transmission|slider-crank"):
        pulled(f'gear=".03" {attribute}="{value}"', next(_names))


@pytest.mark.parametrize("kind", ["only with another one", "no physics"])
def test_an_attribute_that_means_nothing_alone_changes_nothing(kind: str) -> None:
    name = next(_names)
    plain = pulled('gear=".03"', name)
    for attribute, value in ATTRIBUTES[kind].items():
        assert pulled(f'gear=".03" {attribute}="{value}"', name) == plain
    assert warned() == []


def test_a_cable_named_by_another_element_is_refused_or_warned_of() -> None:
    name = next(_names)
    plugin = f'<plugin plugin="cc_mujoco.cable" instance="{name}"/>'
    plain = pulled('gear=".03"', name)
    assert pulled('gear=".03"', name, inside=plugin) == plain
    (line,) = warned()
    assert "its <plugin> in body 'hand' has no effect; take it away there" in line
    for inside, more in (
        (f'<geom size=".01">{plugin}</geom>', ""),
        ("", f"<sensor>{plugin}</sensor>"),
    ):
        with pytest.raises(ValueError, match="plugin"):
            pulled('gear=".03"', name, inside=inside, more=more)


def test_a_number_below_a_hundredth_is_not_rounded_to_0() -> None:
    m = lever(("m", -0.02), ("j", 0.02))
    m.opt.timestep = 1e3
    (period,) = [line for line in warned(m, 1) if "the period of its ends" in line]
    assert re.search(r"ends is [1-9]\.\d\d\de-\d+ time steps", period)
