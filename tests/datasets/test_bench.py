"""The rig as a scene describes it, and scenes that describe none."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.device import Device
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf
from cc_mujoco.viz._view import read_scene
from diagnosis.rigs import alone
from hardware.devices import ARM, KNEE, written
from shared_folder import SHARED

TEXT = scene_path("bench").read_text(encoding="utf-8")


def scene(folder: Path, *changes: tuple[str, str]) -> Path:
    """Return the shipped bench with parts of its text replaced."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scene.xml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_bench_is_a_pull_pull_pair() -> None:
    bench = Bench.of(scene_path("bench"))
    assert bench.names == ("agonist", "antagonist")
    assert (bench.motor, bench.joint) == ("motor", "joint")
    assert (bench.motor_radius, bench.joint_radius) == (0.05, 0.05)
    for cable in bench.cables:
        assert cable.length == pytest.approx(2.0)
        assert cable.wrap == pytest.approx(math.pi)
        assert (cable.axial_stiffness, cable.friction) == (50e3, 0.12)
        assert (cable.pretension, cable.segments) == (80.0, 20)
    assert bench.transmission.ratio == 1.0


def test_its_joints_have_the_stated_inertia_and_damping() -> None:
    model = mujoco.MjModel.from_xml_path(str(scene_path("bench")))
    for name, inertia in (("motor", 3e-4), ("joint", 2e-3)):
        assert model.dof_M0[model.joint(name).dofadr[0]] == pytest.approx(inertia)
    assert model.joint("joint").damping[0] == 0.02


def test_positive_motor_torque_pulls_the_joint_positive() -> None:
    model = mujoco.MjModel.from_xml_path(str(scene_path("bench")))
    data = mujoco.MjData(model)
    data.actuator("load").ctrl[0] = 0.0
    for _ in range(3000):
        data.actuator("motor").ctrl[0] = 6.0
        mujoco.mj_step(model, data)
    assert data.sensor("motor_angle_rad").data[0] > 0.01
    assert data.sensor("joint_angle_rad").data[0] > 0.01
    assert not any(warning.number for warning in data.warning)


def test_the_first_cable_is_the_one_that_pulls_positive(tmp_path: Path) -> None:
    names = [("agonist", "zz"), ("antzz", "aa")]
    assert Bench.of(scene(tmp_path, *names)).names == ("zz", "aa")
    swapped = [('gear="-0.05"', 'gear="x"'), ('gear="0.05"', 'gear="-0.05"')]
    path = scene(tmp_path, *swapped, ('gear="x"', 'gear="0.05"'))
    assert Bench.of(path).names == ("antagonist", "agonist")


def test_one_cable_is_a_bench_too(tmp_path: Path) -> None:
    bench = Bench.of(alone(tmp_path))
    assert (bench.names, bench.joint_radius) == (("agonist",), 0.05)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("<mujoco ", "<mujoko ")], "does not load"),
        ([('"antagonist_distal" joint="joint"', '"antagonist_distal" joint="motor"'),
          ('"antagonist_proximal" joint="motor"',
           '"antagonist_proximal" joint="joint"')],
         "different joints"),
        ([('joint="joint" gear="0.05"', 'joint="joint" gear="0.04"')],
         "different radii"),
        ([('joint="joint" gear="-0.05"', 'joint="joint" gear="0.05"'),
          ('joint="joint" gear="0.05"\n', 'joint="joint" gear="-0.05"\n')],
         "signs"),
        ([('joint="joint" gear="0.05"', 'tendon="agonist_route" gear="0.05"')],
         "turns one hinge joint"),
    ],
)  # fmt: skip
def test_a_scene_that_is_no_bench_is_refused_in_a_sentence(
    tmp_path: Path, changes: list[tuple[str, str]], message: str
) -> None:
    with pytest.raises(CableError, match=message):
        Bench.of(scene(tmp_path, *changes))


def test_what_is_wrong_with_a_conduit_is_said_once(tmp_path: Path) -> None:
    wrong = scene(tmp_path, ('value="2:0.6366197723675814"', 'value="2:x"'))
    with pytest.raises(CableError) as told:
        Bench.of(wrong)
    assert str(told.value).count("sections") == 1
    assert "does not load: cable 'agonist': key `conduit` is '2:x'" in str(told.value)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        (
            '"end_los" value="0.1"',
            r"key .end_los.(;| in .*:) did you mean .end_loss.",
        ),
        ('"end_loss" value=""', "key `end_loss` is ''; it must be a number in"),
    ],
)
@pytest.mark.parametrize("load", [Bench.of, Device, from_mjcf, read_scene])
def test_a_key_that_mujoco_misreads_is_refused_by_what_loads_a_scene(
    tmp_path: Path, load: Callable[[str], object], key: str, message: str
) -> None:
    """MuJoCo itself takes an empty key for a missing one, and names no other."""
    first = '<config key="friction"'
    wrong = scene(tmp_path, (first, f"<config key={key}/>\n{first}"))
    with pytest.raises(CableError, match=message):
        load(str(wrong))


def test_a_lever_whose_angle_is_not_0_at_pretension_is_refused(tmp_path: Path) -> None:
    text = scene_path("ankle").read_text(encoding="utf-8")
    assert text.count('name="ankle" type="hinge"') == 1
    path = tmp_path / "ankle.xml"
    path.write_text(
        text.replace('name="ankle" type="hinge"', 'name="ankle" type="hinge" ref="0.1"')
    )
    with pytest.raises(CableError, match=r"'ankle' has `ref`.*0\.1 rad where"):
        Bench.of(path)


def test_a_scene_with_several_axes_is_diagnosed_by_axis(tmp_path: Path) -> None:
    path = written(tmp_path, ARM)
    with pytest.raises(CableError, match="has the axes elbow, shoulder; name one"):
        Bench.of(path)
    bench = Bench.of(path, "elbow")
    assert (bench.names, bench.motor, bench.joint) == (("biceps",), "drum_b", "elbow")
    assert (bench.axis, bench.joint_radius) == ("elbow", 0.05)
    assert Bench.of(path, cables=bench.names).joint == "elbow"
    with pytest.raises(CableError, match="did you mean 'elbow'"):
        Bench.of(path, "elbw")


def test_a_description_names_the_joint_and_where_it_moves(tmp_path: Path) -> None:
    written(tmp_path, KNEE, "knee.xml")
    plain = Bench.of(tmp_path / "knee.xml")
    # Data are positive where the cable pulls, which is straight.
    assert (plain.centre, plain.reach) == (-1.0, 0.8)
    assert (plain.motor, plain.joint, plain.axis) == ("drum", "knee", "")
    table = tmp_path / "knee.device.toml"
    table.write_text("[axis]\ncentre = 0.7\nreach = 0.3\n")
    for source in (tmp_path / "knee.xml", table):
        bench = Bench.of(source)
        assert (bench.centre, bench.reach) == (-0.7, 0.3)
        assert bench.path == tmp_path / "knee.xml"


def test_a_cable_that_another_joint_moves_needs_the_angle_of_that_joint() -> None:
    assert Bench.of("exosuit", "hip").others == ("knee",)


@pytest.mark.shared
@pytest.mark.parametrize("name", ["knee_exo", "knee4", "knee_mid", "elbow"])
def test_devices_of_others_are_benches(name: str) -> None:
    bench = Bench.of(SHARED / "cases" / "device" / f"{name}.xml")
    low, high = bench.span
    assert low < bench.centre < high
    assert bench.motor in ("drum", "motor")


def test_a_scene_without_cable_or_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="is no file"):
        Bench.of(tmp_path / "none.xml")
    path = tmp_path / "empty.xml"
    path.write_text("<mujoco/>", encoding="utf-8")
    with pytest.raises(CableError, match="has no cable: give"):
        Bench.of(path)
