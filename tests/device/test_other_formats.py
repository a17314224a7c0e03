"""Models as other programs write them: URDF, MJZ, packages, keyframes without names."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli
from cc_mujoco.device import Device
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf
from cc_mujoco.plugin._spec import read_spec
from public_models import MODELS, folder

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0 0 -.15"/><mass value="1"/>
      <inertia ixx=".01" iyy=".01" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://arm_robot/meshes/upper.dae"/></geometry>
    </visual></link>
  <link name="fore">
    <inertial><origin xyz="0 0 -.12"/><mass value=".7"/>
      <inertia ixx=".005" iyy=".005" izz=".0005" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry>{shape}</geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="5"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 -.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper=".5" effort="10" velocity="5"/></joint>
</robot>"""
CYLINDER = '<cylinder radius=".02" length=".2"/>'
MESH = '<mesh filename="package://arm_robot/meshes/fore.stl"/>'
BARE = """<mujoco><option timestep="0.001"/><worldbody><body name="base">
  <geom size=".05"/><body name="leg" pos="0 0 -.1"><joint name="knee" axis="0 -1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/></body></body></worldbody>
  <actuator><motor name="m" joint="knee"/></actuator></mujoco>"""


def tetrahedron() -> bytes:
    corners = 0.1 * np.vstack((np.zeros(3), np.eye(3)))
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    rows = [np.vstack((np.zeros(3), corners[[*face]])).astype("<f4") for face in faces]
    body = b"".join(row.tobytes() + bytes(2) for row in rows)
    return bytes(80) + np.uint32(len(faces)).tobytes() + body


def arm(folder: Path, shape: str) -> mujoco.MjSpec:
    """Return the specification of a URDF in its package, as ROS lays it out."""
    package = folder / "arm_robot"
    for part in ("urdf", "meshes"):
        (package / part).mkdir(parents=True)
    (package / "urdf/arm.urdf").write_text(ARM.format(shape=shape))
    (package / "meshes/fore.stl").write_bytes(tetrahedron())
    return mujoco.MjSpec.from_file(str(package / "urdf/arm.urdf"))


def add(spec: mujoco.MjSpec, motor: Any, joint: Any, **more: str) -> str:
    report = cc_mujoco.add_cable(
        spec, "cord", motor=motor, joint=joint, drum=0.02, pulley=0.04,
        torque_limit=5.0, conduit="0.4:0.2", friction=0.1, axial_stiffness=2e4, **more,
    )  # fmt: skip
    return str(report)


def archive(path: Path, files: dict[str, str]) -> Path:
    with zipfile.ZipFile(path, "w") as into:
        for name, text in files.items():
            into.writestr(name, text)
    return path


@pytest.mark.parametrize("shape", [CYLINDER, MESH])
@pytest.mark.filterwarnings("ignore::cc_mujoco.errors.CableWarning")
def test_a_urdf_with_a_cable_is_kept_reloaded_played_and_attached(
    tmp_path: Path, shape: str
) -> None:
    spec = arm(tmp_path, shape)
    assert "joint 'elbow': `actuatorfrcrange`" in add(spec, "upper", "elbow")
    model = spec.compile()
    assert model.jnt_actfrclimited.sum() == 1  # of the shoulder
    kept = tmp_path / "elsewhere" / "robot.mjz"
    kept.parent.mkdir()
    spec.encode(str(kept))
    (kept.parent / "robot.xml").write_text(spec.to_xml())
    ends = []
    for file in (kept, kept.with_suffix(".xml")):
        device = Device(file)
        (axis,) = device.description.axes
        assert (axis.motor, axis.joint) == ("cord_motor", "elbow")
        log = cc_mujoco.simulate(device, "none", duration=0.2)
        ends.append(log["joint_angle_rad"][-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    whole = mujoco.MjSpec()
    for side in ("left_", "right_"):
        frame = whole.worldbody.add_frame(pos=[0, len(side), 0])
        whole.attach(read_spec(kept), prefix=side, frame=frame)
    both = whole.compile()
    assert [*from_mjcf(both)] == ["left_cord", "right_cord"]
    assert both.nmesh == model.nmesh * 2


def test_a_mesh_that_no_package_has_is_named(tmp_path: Path) -> None:
    spec = arm(tmp_path, MESH.replace("fore.stl", "thumb.stl"))
    with pytest.raises(CableError, match=r"no package://arm_robot/meshes/thumb\.stl: "):
        add(spec, "upper", "elbow")


@pytest.mark.filterwarnings("ignore:Attach conflict")
def test_keyframes_without_names_do_not_hinder_attaching() -> None:
    text = BARE.replace("<worldbody>", '<size nkey="3"/><worldbody>', 1)
    spec = mujoco.MjSpec.from_string(text)
    add(spec, "base", "knee", replace="m")
    whole = mujoco.MjSpec()
    for side in ("left_", "right_"):
        frame = whole.worldbody.add_frame(pos=[0, len(side), 0])
        whole.attach(spec.copy(), prefix=side, frame=frame)
    assert [*from_mjcf(whole.compile())] == ["left_cord", "right_cord"]


def test_a_body_with_a_cable_is_replicated(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_string(BARE)
    add(spec, "base", "knee", replace="m")
    (tmp_path / "child.xml").write_text(spec.to_xml())
    (tmp_path / "many.xml").write_text(
        '<mujoco><option timestep="0.001"/><asset>'
        '<model name="child" file="child.xml"/></asset><worldbody>'
        '<replicate count="3" offset="1 0 0"><attach model="child" '
        'body="base" prefix="x_"/></replicate></worldbody></mujoco>'
    )
    one, many = spec.compile(), read_spec(tmp_path / "many.xml").compile()
    assert [*from_mjcf(many)] == ["x_cord0", "x_cord1", "x_cord2"]
    alone, together = mujoco.MjData(one), mujoco.MjData(many)
    for data, model in ((alone, one), (together, many)):
        for _ in range(200):
            data.ctrl[:] = 1.0
            mujoco.mj_step(model, data)
    np.testing.assert_allclose(together.qpos, np.tile(alone.qpos, 3), rtol=1e-9)


@pytest.mark.parametrize("ending", [".xml", ".urdf", ".mjz"])
@pytest.mark.parametrize(
    "command",
    [
        "device", "play", "benchmark", "calibrate", "list", "whatif --vary wrap=1,2",
        "export --controller pi --out c", "diagnose --plan --out d",
        "diagnose data.csv --out d",
    ],
)  # fmt: skip
def test_every_command_says_how_a_model_gets_a_cable(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    ending: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / f"bare{ending}"
    if ending == ".mjz":
        archive(scene, {"bare.xml": BARE})
    else:
        scene.write_text(BARE if ending == ".xml" else ARM.format(shape=CYLINDER))
    (tmp_path / "data.csv").write_text(
        "time_s,motor_angle_rad,joint_angle_rad,motor_torque_nm\n"
        + "".join(f"{0.01 * k},0,0,0\n" for k in range(300))
    )
    name, *words = command.split()
    assert cli.main([name, scene.name, *words]) == 2
    (sentence,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert "has no cable: give `mujoco.MjSpec.from_file(" in sentence
    assert "by `cc_mujoco.add_cable`" in sentence


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "no.mjz",
            b"hello",
            "it must be a zip archive with the model in no.xml, no",
        ),
        ("no.mjz", {"other.xml": BARE}, "with the model in no.xml, no/no.xml or model"),
        ("no.mjz", {"no.xml": "<mujoco><bad/></mujoco>"}, "Element 'bad', line 1"),
        ("no.mjz", {"no.xml": "<mujoco>"}, "Line number=1"),
        ("no.urdf", b"<robot name='r'>\n<link name='a'>\n</robot>", "tag: line 3"),
    ],
)
def test_a_damaged_file_is_refused_with_its_place(
    tmp_path: Path, name: str, content: bytes | dict[str, str], message: str
) -> None:
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        archive(path, content)
    with pytest.raises(CableError) as found:
        Device(path)
    assert str(path) in str(found.value) and message in str(found.value)
    assert "\n" not in str(found.value)


def test_an_archive_writes_nothing_and_reads_what_it_holds(tmp_path: Path) -> None:
    inner = tmp_path / "in"
    inner.mkdir()
    path = archive(inner / "m.mjz", {"m.xml": BARE, "../evil.xml": "x", "/evil": "x"})
    assert read_spec(path).compile().nq == 1
    assert [*tmp_path.rglob("evil*")] == []
    lied = path.read_bytes().replace(b"PK\x01\x02", b"PK\x01\x03", 1)
    path.write_bytes(lied)
    with pytest.raises(CableError, match="does not load"):
        read_spec(path)
    # Zeros of 64 MB in place of a mesh.
    mesh = '<asset><mesh name="m" file="m.stl"/></asset><worldbody>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as into:
        into.writestr("m.xml", BARE.replace("<worldbody>", mesh, 1))
        into.writestr("m.stl", bytes(64_000_000))
    with pytest.raises(CableError, match=r"has no cable|does not load"):
        Device(path)


def test_a_description_finds_its_archive(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_string(BARE)
    add(spec, "base", "knee", replace="m")
    spec.compile()
    spec.encode(str(tmp_path / "leg.mjz"))
    (tmp_path / "leg.device.toml").write_text('meaning = "a leg"\n')
    for name in ("leg.device.toml", "leg.mjz"):
        assert Device(tmp_path / name).description.meaning == "a leg"


def twice(spec: mujoco.MjSpec) -> mujoco.MjModel:
    whole = mujoco.MjSpec()
    for side in ("left_", "right_"):
        frame = whole.worldbody.add_frame(pos=[5.0 * len(side), 0, 0])
        whole.attach(spec.copy(), prefix=side, frame=frame)
    return whole.compile()


def host(file: Path) -> mujoco.MjModel | None:
    """Return the model of a file with a cable at a hinge; None if it cannot be one."""
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        spec.copy().compile()
        mujoco.MjSpec.from_string(spec.to_xml())
    except ValueError:  # a part of another file, without its meshes, or not to be saved
        return None
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    hinges = [joint for joint in spec.joints if joint.type == hinge and joint.name]
    if not hinges:
        return None
    try:
        twice(spec)
        can_be_attached = True
    except ValueError:  # keyframes in the file without names
        can_be_attached = False
    joint = hinges[len(hinges) // 2]
    add(spec, joint.parent if joint.parent.name else spec.worldbody, joint)
    if can_be_attached:
        assert [*from_mjcf(twice(spec))] == ["left_cord", "right_cord"], file
    kept = spec.copy()
    model = kept.compile()
    kept.encode("kept.mjz")
    again = read_spec("kept.mjz").compile()
    sizes = [(m.nq, m.nu, m.nmesh, m.nplugin) for m in (model, again)]
    assert sizes[0] == sizes[1], file
    return again


@pytest.mark.parametrize("package", [*MODELS])
@pytest.mark.filterwarnings("ignore")
def test_models_of_others_are_hosts_of_a_drive_in_one_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    monkeypatch.chdir(tmp_path)
    count = 0
    for file in sorted(folder(package).rglob("*.xml")):
        if (model := host(file)) is None:
            continue
        model.opt.timestep = min(model.opt.timestep, 2e-3)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        assert cc_mujoco.read(model, data, "cord").tension.min() > 0.1, file
        for _ in range(20):
            data.actuator("cord_motor").ctrl = 0.2
            mujoco.mj_step(model, data)
        assert np.isfinite(cc_mujoco.read(model, data, "cord").tension).all(), file
        count += 1
    assert count >= 2
