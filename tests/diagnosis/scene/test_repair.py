"""Repaired scene: it moves by the formulas of effects, is plain MJCF and reloads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import read_channels, repair_scene, write
from cc_mujoco.diagnosis._scene.realisation import realisations
from cc_mujoco.diagnosis._scene.repair import require_repairable
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf
from diagnosis.rigs import BENCH, EFFECTS, MECHANICAL

SOFTER = tuple(
    cable.replace(axial_stiffness=30e3 / 7.0, friction=0.1 / 3.0)
    for cable in BENCH.cables
)
BACKLASH = {"backlash": {"backlash": 0.03}}


def inertia(name: str) -> float:
    """Return the inertia of the shipped bench's motor or joint [kg m^2]."""
    return {"motor": 3e-4, "joint": 2e-3}[name]


def stirred(spec: mujoco.MjSpec, steps: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the model and data of a scene after motion of its motor and load."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for step in range(steps):
        data.actuator("motor").ctrl[0] = 3.0 * np.sin(0.01 * step)
        data.actuator("load").ctrl[0] = 0.3 * np.cos(0.007 * step)
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert not any(warning.number for warning in data.warning)
    return model, data


@pytest.mark.parametrize("effect", MECHANICAL)
@pytest.mark.parametrize("steps", [700, 1500])
def test_the_shown_torques_are_what_moves_the_scene(effect: str, steps: int) -> None:
    # Newton, for what lies on the far side of the sensors: the scene as it was.
    spec = repair_scene(BENCH, BENCH.cables, {effect: EFFECTS[effect][0]})
    model, data = stirred(spec, steps)
    shown = read_channels(model, data)
    motor, joint = (model.joint(name).dofadr[0] for name in ("motor", "joint"))
    given = data.qfrc_passive - data.qfrc_spring
    drive = data.actuator("motor").force[0] + given[motor] - shown.motor_torque
    load = data.actuator("load").force[0] + given[joint] + shown.joint_torque
    assert abs(data.qacc[joint]) > 1.0
    assert drive == pytest.approx(inertia("motor") * data.qacc[motor], abs=1e-6)
    assert load == pytest.approx(inertia("joint") * data.qacc[joint], abs=1e-6)


def test_a_bench_with_backlash_stays_stable_and_within_its_play() -> None:
    model, data = stirred(repair_scene(BENCH, BENCH.cables, BACKLASH), 1000)
    apart = []
    for step in range(6000):
        data.actuator("motor").ctrl[0] = 0.0
        data.actuator("load").ctrl[0] = 0.3 * np.sin(0.002 * step)
        mujoco.mj_step(model, data)
        apart.append(data.joint("joint_pulley").qpos[0] - data.joint("joint").qpos[0])
    # Beyond it only while an impact lasts.
    low, high = np.percentile(apart, [2.0, 98.0])
    assert (low, high) == pytest.approx((-0.015, 0.015), abs=1e-4)
    assert np.abs(apart).max() < 0.017
    # Left alone pulley and joint come to rest, though the rotor still swings.
    data.ctrl[:] = 0.0
    mujoco.mj_step(model, data, 8000)
    for name in ("joint", "joint_pulley"):
        assert abs(data.joint(name).qvel[0]) < 1e-3
    assert not any(warning.number for warning in data.warning)


def test_the_pulley_with_play_is_light() -> None:
    model = repair_scene(BENCH, BENCH.cables, BACKLASH).compile()
    pulley = model.dof_M0[model.joint("joint_pulley").dofadr[0]]
    assert 0.0 < pulley < 0.03 * inertia("joint")
    # An explicit force is stable below 2 / frequency.
    stiffness = 2 * (2 * 20 * 50e3 / 2.0) * 0.05**2
    assert model.opt.timestep * np.sqrt(stiffness / pulley) < 1.01


def test_a_written_scene_loads_as_the_same_bench(tmp_path: Path) -> None:
    effects = {name: EFFECTS[name][0] for name in EFFECTS}
    spec = repair_scene(BENCH, SOFTER, effects)
    path = tmp_path / "deep" / "scene.xml"
    path.parent.mkdir()
    write(path, spec)
    again = Bench.of(path)
    assert again.cables == SOFTER
    assert replace(again, path=BENCH.path, sha256=BENCH.sha256, cables=()) == replace(
        BENCH, cables=()
    )
    assert [entry.name for entry in path.parent.iterdir()] == ["scene.xml"]
    text = path.read_text(encoding="utf-8")
    head = text[: text.index("<compiler")]
    for name, (values, _) in EFFECTS.items():
        assert name in head
        for key, value in values.items():
            assert f"{key} {value:g}" in head


def test_no_effect_adds_an_input_to_the_scene() -> None:
    before = mujoco.MjModel.from_xml_path(str(BENCH.path))
    effects = {**BACKLASH, **{name: EFFECTS[name][0] for name in EFFECTS}}
    after = repair_scene(BENCH, BENCH.cables, effects).compile()
    assert after.nu == before.nu
    names = [before.actuator(i).name for i in range(before.nu)]
    assert [after.actuator(i).name for i in range(before.nu)] == names


def test_values_of_zero_leave_the_scene_as_it_was() -> None:
    off = {
        name: dict.fromkeys(entry.parameters, 0.0)
        for name, entry in realisations().items()
    }
    off["motor_cogging"]["cogging_order"] = 7.0
    plain = repair_scene(BENCH, BENCH.cables, {})
    same = repair_scene(BENCH, BENCH.cables, off)
    same.comment = plain.comment
    assert same.to_xml() == plain.to_xml()


def test_a_time_step_that_the_cables_outgrow_is_reduced() -> None:
    stiff = tuple(cable.replace(axial_stiffness=3e6) for cable in BENCH.cables)
    spec = repair_scene(BENCH, stiff, {})
    assert spec.option.timestep < 1e-4
    data = stirred(spec, 3000)[1]
    assert np.abs(data.qvel).max() < 10.0
    assert repair_scene(BENCH, BENCH.cables, {}).option.timestep == 1e-4


@pytest.mark.parametrize("rest", [0.0, -0.2])
def test_a_spring_beside_one_that_is_not_linear(tmp_path: Path, rest: float) -> None:
    text = BENCH.path.read_text(encoding="utf-8").replace(
        'axis="-1 0 0" damping="0.02"',
        'axis="-1 0 0" damping="0.02" stiffness="2 0.5 0.3"',
    )
    path = tmp_path / "scene.xml"
    path.write_text(text, encoding="utf-8")
    bench = Bench.of(path)
    require_repairable(bench)
    more = {"joint_stiffness": 0.5, "joint_stiffness_moment": -0.5 * rest}
    spec = repair_scene(bench, bench.cables, {"joint_stiffness": more})
    dof = spec.compile().joint("joint").dofadr[0]
    for angle in (-0.5, 0.0, 0.4):
        pulls = []
        for model in (repair_scene(bench, bench.cables, {}).compile(), spec.compile()):
            data = mujoco.MjData(model)
            data.joint("joint").qpos[0] = angle
            mujoco.mj_forward(model, data)
            pulls.append(data.qfrc_spring[dof] + data.qfrc_actuator[dof])
        wanted = -0.5 * (angle - rest)
        assert pulls[1] - pulls[0] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("rest", [0.0, -0.2])
def test_two_springs_on_the_joint_are_one(tmp_path: Path, rest: float) -> None:
    text = BENCH.path.read_text(encoding="utf-8").replace(
        'axis="-1 0 0" damping="0.02"',
        'axis="-1 0 0" damping="0.02" stiffness="2" springref="0.3"',
    )
    path = tmp_path / "scene.xml"
    path.write_text(text, encoding="utf-8")
    bench = Bench.of(path)
    more = {"joint_stiffness": 0.5, "joint_stiffness_moment": -0.5 * rest}
    spec = repair_scene(bench, bench.cables, {"joint_stiffness": more})
    model = spec.compile()
    data = mujoco.MjData(model)
    dof = model.joint("joint").dofadr[0]
    for angle in (-0.5, 0.0, 0.4):
        data.joint("joint").qpos[0] = angle
        mujoco.mj_forward(model, data)
        wanted = -2.0 * (angle - 0.3) - 0.5 * (angle - rest)
        assert data.qfrc_spring[dof] == pytest.approx(wanted, abs=1e-12)


def test_the_rest_of_the_cables_follows_the_angle_offset() -> None:
    offset = {"angle_offset": {"joint_angle_offset": 0.2}}
    model = repair_scene(BENCH, BENCH.cables, offset).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shown = read_channels(model, data)
    assert (shown.motor_angle, shown.joint_angle) == (0.0, pytest.approx(-0.2))
    assert shown.motor_torque == pytest.approx(0.0, abs=1e-12)
    assert shown.joint_torque == pytest.approx(0.0, abs=1e-12)


def test_defaults_of_the_scene_do_not_reach_what_is_added(tmp_path: Path) -> None:
    text = (
        BENCH.path.read_text(encoding="utf-8")
        .replace(
            "<default>",
            '<default><joint damping="5" armature="1" stiffness="3" frictionloss="1"/>'
            '<general gear="7" forcerange="-0.01 0.01"/><tendon stiffness="4"/>',
            1,
        )
        .replace("<plugin name=", '<plugin forcelimited="false" name=')
    )
    path = tmp_path / "scene.xml"
    path.write_text(text, encoding="utf-8")
    bench = Bench.of(path)
    effects = {**BACKLASH, "joint_gravity": EFFECTS["joint_gravity"][0]}
    write(path, repair_scene(bench, bench.cables, effects))
    model = mujoco.MjModel.from_xml_path(str(path))
    pulley = model.joint("joint_pulley")
    for value in (pulley.damping, pulley.armature, pulley.stiffness):
        assert value[0] == 0.0
    assert model.dof_frictionloss[pulley.dofadr[0]] == 0.0
    assert model.tendon_stiffness[model.tendon("joint_backlash").id] == 0.0
    gravity = model.actuator("joint_gravity")
    assert (gravity.gear[0], gravity.forcelimited[0]) == (1.0, 0)


def test_keyframes_keep_their_poses(tmp_path: Path) -> None:
    text = BENCH.path.read_text(encoding="utf-8").replace(
        "</worldbody>",
        '<body><joint name="idle"/><geom size="0.01" mass="1"/></body></worldbody>',
    )
    key = '<keyframe><key name="away" qpos="0.1 0.2 0.3" qvel="1 2 3"/></keyframe>'
    path = tmp_path / "scene.xml"
    path.write_text(text.replace("</mujoco>", f"{key}</mujoco>"), encoding="utf-8")
    bench = Bench.of(path)
    write(path, repair_scene(bench, bench.cables, BACKLASH))
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    wanted = {"motor": 0.1, "joint": 0.2, "joint_pulley": 0.2, "idle": 0.3}
    assert {name: data.joint(name).qpos[0] for name in wanted} == wanted
    wanted = {"motor": 1.0, "joint": 2.0, "joint_pulley": 2.0, "idle": 3.0}
    assert {name: data.joint(name).qvel[0] for name in wanted} == wanted


def test_meshes_and_textures_are_found_from_another_folder(tmp_path: Path) -> None:
    home, away = tmp_path / "home", tmp_path / "away"
    (home / "shapes").mkdir(parents=True)
    away.mkdir()
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (home / "shapes" / "hand.obj").write_text(vertices + faces, encoding="utf-8")
    text = BENCH.path.read_text(encoding="utf-8")
    text = text.replace("<compiler ", '<compiler meshdir="shapes" ')
    text = text.replace("<asset>", '<asset><mesh name="hand" file="hand.obj"/>')
    (home / "scene.xml").write_text(text, encoding="utf-8")
    bench = Bench.of(home / "scene.xml")
    write(away / "scene.xml", repair_scene(bench, bench.cables, BACKLASH))
    model = mujoco.MjModel.from_xml_path(str(away / "scene.xml"))
    assert model.nmesh == 1


def test_a_scene_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text("old", encoding="utf-8")
    spec = repair_scene(BENCH, BENCH.cables, {})
    spec.add_sensor(
        type=mujoco.mjtSensor.mjSENS_JOINTPOS,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        objname="nobody",
    )
    with pytest.raises(CableError, match="cannot be written"):
        write(path, spec)
    assert path.read_text(encoding="utf-8") == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"backlash": {"backlsh": 0.1}}, r"unknown parameter of backlash 'backlsh'"),
        ({"joint_gravity": {"gravity_sine": 0.1}}, "gravity_cosine"),
        ({"backlash": {"backlash": float("nan")}}, "finite"),
        ({"backlash": {"backlash": -0.1}}, "0 or more"),
        ({"joint_inertia": {"joint_inertia": -0.01}}, "inertia"),
        ({"viscous_friction": {"viscous_friction": 1.0}}, "act in the cables"),
    ],
)
def test_what_cannot_be_realised_is_refused_in_a_sentence(
    effects: dict[str, dict[str, float]], message: str
) -> None:
    with pytest.raises(CableError, match=message):
        repair_scene(BENCH, BENCH.cables, effects)


def test_another_number_of_cables_is_refused() -> None:
    with pytest.raises(CableError, match="has 2 cables, got 1"):
        repair_scene(BENCH, BENCH.cables[:1], {})


def test_effects_in_the_cables_are_named_in_the_file() -> None:
    spec = repair_scene(BENCH, SOFTER, {"viscous_friction": {"viscous_friction": 12.5}})
    assert "viscous_friction 12.5" in spec.comment
    assert tuple(from_mjcf(spec).values()) == SOFTER
