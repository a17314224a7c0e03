"""Cables go into MJCF and come back exactly, whatever MjSpec does in between."""

from __future__ import annotations

import doctest
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.random_cables import sections
from cc_mujoco.cable import PARAMETERS, Cable, Section
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import _mjcf as mjcf
from cc_mujoco.plugin import from_mjcf, route, route_tendon, to_mjcf, write_cable
from cc_mujoco.plugin._instance_data import COMMITMENT_SIZE, Commitment
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

ODD = Cable(
    axial_stiffness=4000.1,
    pretension=1 / 3,
    friction=0.1 + 0.2,
    static_friction=0.7,
    critical_slip_distance=1e-5,
    viscous_friction=5e-324,
    stribeck_friction=0.2,
    load_independent_friction=1e5,
    segments=7,
    conduit=(Section(1 / 7, math.inf), Section(0.5, 0.1), Section(2.0, 1e300)),
)

FOLLOWING = {"route": "path", "bend": "route"}
SHORT: list[dict[str, Any]] = [
    {"friction": 0.0, "static_friction": 0.0},
    {"axial_stiffness": 5e4},
    {"pretension": 7.5},
    {"viscous_friction": 20.0, "conduit": (Section(0.5, 0.1),)},
]


@st.composite
def any_cable(draw: st.DrawFn) -> Cable:
    values = {
        p.name: draw(st.floats(p.low, p.high, exclude_min=p.low_open))
        for p in PARAMETERS
    }
    if values["static_friction"] < values["friction"]:
        values["static_friction"] = 0.0
    # What the motor's pulley of 0.02 m and a cable without pretension allow.
    values["eccentricity"] *= 0.09
    values["ovality"] *= 0.09
    if values["pretension"] == 0.0:
        values["tension_exponent"] = 0.0
    for place in "end", "proximal":
        if values[f"{place}_compliance"] == 0.0:
            values[f"{place}_hardening"] = values[f"{place}_loss"] = 0.0
    return Cable(
        **values,
        segments=draw(st.integers(1, 60)),
        conduit=tuple(draw(st.lists(sections(1e-3), min_size=1, max_size=8))),
        **draw(st.sampled_from([{}, {"route": "path"}, FOLLOWING])),
    )


@pytest.mark.filterwarnings("ignore:.*no effect")
@settings(max_examples=30)
@given(any_cable())
def test_any_cable_survives_specification_text_and_compilation(cable: Cable) -> None:
    spec = mujoco.MjSpec.from_string(pull_pull())
    to_mjcf(spec, "flexor", cable)
    assert from_mjcf(spec)["flexor"] == cable
    assert from_mjcf(spec.compile())["flexor"] == cable
    assert from_mjcf(spec.to_xml())["flexor"] == cable
    assert from_mjcf(spec)["extensor"] == from_mjcf(pull_pull())["extensor"]


def test_reads_text_path_specification_and_model(tmp_path: Path) -> None:
    xml = pull_pull()
    path = tmp_path / "scene.xml"
    path.write_text(xml)
    expected = {name: Cable.from_config(CONFIG) for name in ("flexor", "extensor")}
    spec = mujoco.MjSpec.from_string(xml)
    for source in (xml, path, str(path), spec, spec.compile()):
        assert from_mjcf(source) == expected
    assert from_mjcf("<mujoco/>") == {}


def test_new_cable_gets_two_ends() -> None:
    spec = mujoco.MjSpec.from_string(model("", ""))
    to_mjcf(spec, "one", ODD, ("motor", -0.02), (spec.tendon("path"), 1.5))
    m = spec.compile()
    assert from_mjcf(m) == {"one": ODD}
    proximal, distal = m.actuator("one_proximal"), m.actuator("one_distal")
    assert proximal.trntype == mujoco.mjtTrn.mjTRN_JOINT
    assert proximal.trnid[0] == m.joint("motor").id
    assert proximal.gear[0] == -0.02
    assert distal.trntype == mujoco.mjtTrn.mjTRN_TENDON
    assert distal.trnid[0] == m.tendon("path").id
    assert distal.gear[0] == 1.5


def test_specification_and_its_text_simulate_alike() -> None:
    spec = mujoco.MjSpec.from_string(pull_pull())
    to_mjcf(spec, "flexor", ODD, distal=("wrist", -0.06))
    m = spec.compile()
    assert m.actuator("flexor_distal").gear[0] == -0.06
    assert m.actuator("flexor_proximal").gear[0] == -0.02
    again = mujoco.MjSpec.from_string(spec.to_xml()).compile()
    torque = excitation(100)
    ours = run(m, mujoco.MjData(m), torque)
    theirs = run(again, mujoco.MjData(again), torque)
    assert np.array_equal(ours[0], theirs[0])
    assert np.array_equal(ours[1], theirs[1])


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ({"proximal": ("motor", 0.02)}, "no distal end"),
        ({"proximal": ("moter", 0.02), "distal": ("wrist", 1)}, "did you mean 'motor'"),
        ({"proximal": ("motor", 0.0), "distal": ("wrist", 1)}, "no pulley radius"),
        ({"proximal": ("motor", math.nan), "distal": ("wrist", 1)}, "no pulley radius"),
    ],
)
def test_impossible_ends_are_refused_and_change_nothing(
    ends: dict[str, mjcf.End], message: str
) -> None:
    spec = mujoco.MjSpec.from_string(model("", ""))
    before = spec.to_xml()
    with pytest.raises(CableError, match=message):
        to_mjcf(spec, "one", ODD, **ends)
    assert spec.to_xml() == before


ROUTED = CONFIG | {"route": "path"}
CHILD = model(
    instance("bowden", ROUTED),
    end("near", "bowden", 'joint="motor"', -0.02)
    + end("far", "bowden", 'joint="wrist"', -0.05),
)


def test_friction_may_change_during_a_run() -> None:
    """A cable written anew goes on as one that has been so from the start."""
    spec = mujoco.MjSpec.from_string(pull_pull())
    mjcf.make_room(spec)
    compiled = spec.compile()
    name, cable = next(iter(from_mjcf(compiled).items()))
    rough = cable.replace(friction=0.2345678, static_friction=0.0)
    to_mjcf(spec, name, rough)
    other = spec.compile()
    one, two = mujoco.MjData(compiled), mujoco.MjData(other)
    for step in range(200):
        one.ctrl[0] = 0.3 * math.sin(0.05 * step)
        if step == 100:
            two.qpos[:], two.qvel[:], two.time = one.qpos, one.qvel, one.time
            two.plugin_state[:] = one.plugin_state
            write_cable(compiled, name, rough)
        mujoco.mj_step(compiled, one)
        if step >= 100:
            two.ctrl[0] = one.ctrl[0]
            mujoco.mj_step(other, two)
    assert from_mjcf(compiled)[name] == rough
    assert one.plugin_state == pytest.approx(two.plugin_state, rel=1e-9, abs=1e-12)
    for wrong, other, words in (
        ("flexxor", rough, "unknown cable 'flexxor'"),
        (name, rough.replace(segments=rough.segments + 1), "cannot change its `segm"),
        (name, 5, "not 5"),
    ):
        with pytest.raises(CableError, match=words):
            write_cable(compiled, wrong, other)  # type: ignore[arg-type]
    compiled.plugin_attr[:] = -56  # no UTF-8
    with pytest.raises(CableError):
        from_mjcf(compiled)


@pytest.mark.filterwarnings("ignore:.*no effect")
@settings(max_examples=25, deadline=None)
@given(cable=any_cable(), other=st.sampled_from(SHORT))
def test_a_configuration_that_is_no_longer_needs_no_room(
    cable: Cable, other: dict[str, Any]
) -> None:
    spec = mujoco.MjSpec.from_string(pull_pull())
    to_mjcf(spec, "flexor", cable)
    compiled = spec.compile()
    start, end = compiled.plugin_attradr[:2].tolist()
    changed = cable.replace(**other)
    write_cable(compiled, "flexor", changed)
    assert from_mjcf(compiled)["flexor"] == changed
    # As the compiled reader has it, which knows no other texts.
    mujoco.mj_forward(compiled, mujoco.MjData(compiled))
    written = bytes(compiled.plugin_attr[start:end])
    longer = changed.replace(route="r" * 9000)
    with pytest.raises(CableError, match=r"has room for, by [1-9][0-9]* characters"):
        write_cable(compiled, "flexor", longer)
    assert bytes(compiled.plugin_attr[start:end]) == written


@pytest.mark.parametrize("friction", [0.25, 0.2, 0.0, 0.1234567])
def test_friction_of_a_scene_without_room_may_change(friction: float) -> None:
    compiled, _ = build(pull_pull())
    cable = from_mjcf(compiled)["flexor"].replace(friction=friction)
    write_cable(compiled, "flexor", cable)
    assert from_mjcf(compiled)["flexor"] == cable


def test_attached_twice_with_prefixes() -> None:
    parent = mujoco.MjSpec.from_string(CHILD)  # has a tendon `path` of its own
    for x, (prefix, suffix) in enumerate([("left_", ""), ("right_", "_b")]):
        child = mujoco.MjSpec.from_string(CHILD)
        frame = parent.worldbody.add_frame(pos=[x + 1, 0, 0])
        parent.attach(child, frame=frame, prefix=prefix, suffix=suffix)
    m = parent.compile()
    expected = Cable.from_config(ROUTED)
    names = ["bowden", "left_bowden", "right_bowden_b"]
    assert from_mjcf(parent) == from_mjcf(m) == dict.fromkeys(names, expected)
    assert from_mjcf(parent.to_xml()) == dict.fromkeys(names, expected)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    tendons = ("path", "left_path", "right_path_b")
    for x, (name, tendon) in enumerate(zip(names, tendons, strict=True)):
        assert route_tendon(m, name) == m.tendon(tendon).id
        assert np.allclose(route(m, d, name)[:, 0], [x, x + 0.1])
    single = mujoco.MjSpec.from_string(CHILD).compile()
    torque = excitation(50)
    _, alone = run(single, mujoco.MjData(single), torque)
    for prefix in ("", "left_", "right_"):
        name = f"{prefix}drive" + ("_b" if prefix == "right_" else "")
        for i, value in enumerate(torque):
            d.ctrl[m.actuator(name).id] = value
            if prefix == "right_":
                d.ctrl[m.actuator("drive").id] = torque[i]
                d.ctrl[m.actuator("left_drive").id] = torque[i]
                mujoco.mj_step(m, d)
    # One number is a checksum of the pose of the whole model.
    pose = (Commitment.pose.offset - COMMITMENT_SIZE) // 8
    wanted = np.delete(alone[-1], pose)
    for state in d.plugin_state.reshape(3, -1):
        assert np.allclose(np.delete(state, pose), wanted, rtol=1e-6, atol=1e-12)


def test_examples_in_the_documentation() -> None:
    assert doctest.testmod(mjcf).failed == 0
