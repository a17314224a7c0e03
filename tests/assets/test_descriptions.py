"""The descriptions beside the scenes: they name what is there, and leave room."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import mujoco
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.device import Sensing
from cc_mujoco.human import TASKS, TRAJECTORIES
from cc_mujoco.plugin import from_mjcf

FILES = sorted(scene_path("wrist").parent.glob("*.device.toml"))


@pytest.fixture(params=FILES, ids=lambda path: path.name.split(".")[0])
def path(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


def described(path: Path) -> tuple[dict[str, Any], mujoco.MjModel]:
    scene = path.with_name(path.name.replace(".device.toml", ".xml"))
    return tomllib.loads(path.read_text()), mujoco.MjModel.from_xml_path(str(scene))


def test_every_scene_with_a_wearer_or_a_course_has_a_description() -> None:
    folder = scene_path("wrist").parent
    worn = [path for path in folder.glob("*.xml") if '"wearer' in path.read_text()]
    worn.append(scene_path("endoscope"))
    assert {path.with_suffix(".device.toml") for path in worn} == set(FILES)


def test_motors_joints_and_movers_are_those_of_the_scene(path: Path) -> None:
    device, m = described(path)
    for axis in device["axis"]:
        motor = m.actuator(axis["motor"])
        assert motor.trntype == mujoco.mjtTrn.mjTRN_JOINT
        assert m.actuator_plugin[motor.id] == -1
        assert axis["joint"] in device["wearer"]
        for site in axis.get("lever", ()):
            assert m.site(site).id >= 0
    wearers = {j: one for j, one in device["wearer"].items() if "none" not in one}
    for joint, mover in wearers.items():
        actuator = m.actuator(mover["actuator"])
        assert actuator.trnid[0] == m.joint(joint).id
    motors = {axis["motor"] for axis in device["axis"]}
    movers = {mover["actuator"] for mover in wearers.values()}
    ends = {f"{c}_{end}" for c in from_mjcf(m) for end in ("proximal", "distal")}
    assert motors | movers | ends == {m.actuator(i).name for i in range(m.nu)}


def test_every_motor_winds_a_cable(path: Path) -> None:
    device, m = described(path)
    driven = {int(m.actuator(axis["motor"]).trnid[0]) for axis in device["axis"]}
    wound = {int(m.actuator(f"{name}_proximal").trnid[0]) for name in from_mjcf(m)}
    assert driven == wound


def test_tasks_motions_and_sensors_are_known(path: Path) -> None:
    device, _ = described(path)
    assert device["trajectory"] in TRAJECTORIES
    Sensing(**device["sensors"])
    for axis in device["axis"]:
        name, *number = axis["task"].split(":")
        assert name in TASKS
        assert len([float(part) for part in number]) <= 1
        sizes = axis["observation"]
        assert ("phase" in sizes) == (device["trajectory"] == "walk")
        assert all(value > 0.0 for value in sizes.values())


def test_the_rope_holds_and_named_motions_stay_clear_of_the_stops(path: Path) -> None:
    device, m = described(path)
    for axis in device["axis"]:
        motor = m.actuator(axis["motor"])
        limit = float(motor.ctrlrange[1])
        for name in from_mjcf(m):
            end = m.actuator(f"{name}_proximal")
            if end.trnid[0] == motor.trnid[0]:
                pull = limit / abs(float(end.gear[0]))
                assert pull < 0.5 * device["rope"]["strength"]
        low, high = m.joint(axis["joint"]).range
        assert 2.0 * axis["reach"] < high - low
        rotor = m.dof_armature[m.jnt_dofadr[motor.trnid[0]]]
        assert 0.0 < axis["motor_pulley"] < rotor
