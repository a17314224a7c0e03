"""Scenes whose joint moves the path of its cable, played inside MuJoCo and out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.diagnosis import repair_scene, rollout, write
from cc_mujoco.diagnosis._scene.repair import require_repairable
from cc_mujoco.errors import CableError

ARM = """<mujoco><option timestep="0.0005"/><compiler angle="radian"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="cord">
    <config key="route" value="cord"/> {keys}
    <config key="conduit" value="{length}:0.2"/> <config key="friction" value="0.15"/>
    <config key="axial_stiffness" value="3000"/> <config key="pretension" value="20"/>
    <config key="segments" value="10"/>
  </instance></plugin></extension>
  <worldbody>
    <body name="winch" pos="-0.5 0 0"><joint name="motor" axis="0 1 0" armature="1e-3"/>
      <geom size="0.02"/></body>
    <site name="a" pos="-0.4 0 0.05"/> <site name="b" pos="-0.2 0 0.12"/>
    <site name="mouth" pos="-0.1 0.01 0.1"/>
    <geom name="post" type="cylinder" size="0.02 0.02" pos="-0.05 0 0.07"
      zaxis="0 1 0"/>
    <site name="over" pos="-0.05 0 0.12"/>
    <body name="arm"><joint name="elbow" axis="0 1 0" range="-0.8 0.9" limited="true"/>
      <geom size="0.03" pos="0.1 0 0"/>
      <site name="near" pos="0.05 0 0.06"/> <site name="tip" pos="0.15 0.01 0.03"/>
      <body name="hand" pos="0.2 0 0"><joint name="wrist" axis="0 1 0"/>
        <geom size="0.02"/> <site name="nail" pos="0.03 0 0.02"/></body>
    </body>
  </worldbody>
  <tendon><spatial name="cord"><site site="a"/> <site site="b"/> <site site="mouth"/>
    <geom geom="post" sidesite="over"/> <site site="near"/> <site site="{end}"/>
  </spatial></tendon>
  <actuator>
    <plugin joint="motor" gear="-0.02" plugin="cc_mujoco.cable" instance="cord"/>
    <plugin {distal} plugin="cc_mujoco.cable" instance="cord"/>
  </actuator>
</mujoco>"""
TIED = 'tendon="cord" gear="1"'
KINDS = {
    "open": ('<config key="path" value="open"/>', TIED),
    "mixed": (
        '<config key="path" value="mixed"/><config key="mouth" value="mouth"/>',
        TIED,
    ),
    "bends on a pulley": (
        '<config key="bend" value="route"/>',
        'joint="elbow" gear="-0.05"',
    ),
    "lever": ("", TIED),
    "mixed and bends": (
        '<config key="path" value="mixed"/><config key="mouth" value="mouth"/>'
        '<config key="bend" value="route"/>',
        TIED,
    ),
}


def arm(folder: Path, kind: str, end: str = "tip") -> Path:
    keys, distal = KINDS[kind]
    path = folder / "arm.xml"
    length = {"tip": 0.575, "nail": 0.6545}[end] if kind == "open" else 0.5
    text = ARM.format(keys=keys, distal=distal, end=end, length=length)
    path.write_text(text, encoding="utf-8")
    return path


def motion(bench: Bench, step: float = 5e-4) -> tuple[np.ndarray, ...]:
    time = step * np.arange(1500)
    joint = 0.5 * np.sin(7.0 * time) * np.minimum(1.0, 5.0 * time)
    wound = 0.02 / bench.motor_radius * np.sin(5.0 * time) ** 2
    return time, bench.following(joint) + wound * 0.3, joint


def apart(bench: Bench, path: Path) -> float:
    """Largest difference of both torques, over the largest of each."""
    time, motor, joint = motion(bench)
    shown = rollout(path, time, motor, joint)
    played = bench.replay(time[1], motor, joint)
    wanted = played.motor_torque, played.joint_torque
    assert max(np.abs(w).max() / np.abs(w[0]) for w in wanted) > 1.5
    return max(
        float(np.abs(a - b).max() / np.abs(b).max())
        for a, b in zip(shown, wanted, strict=True)
    )


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "lever"])
def test_a_path_that_the_joint_moves_is_played_as_mujoco_plays_it(
    tmp_path: Path, kind: str
) -> None:
    path = arm(tmp_path, kind)
    bench = Bench.of(path)
    require_repairable(bench)
    assert apart(bench, path) < 2e-5
    # What matters is that the path moves: left where it is at 0, it is another.
    course = bench.courses(10)[0]
    assert np.ptp(course.wrap, axis=0).max() > 0.1


@pytest.mark.parametrize("scene", ["finger", "ankle"])
def test_the_scenes_are_played_as_mujoco_plays_them(scene: str) -> None:
    bench = Bench.of(scene_path(scene))
    require_repairable(bench)
    assert apart(bench, bench.path) < 1e-5


def test_a_repaired_path_loads_and_plays_as_its_cable(tmp_path: Path) -> None:
    bench = Bench.of(scene_path("finger"))
    stiffer = tuple(
        cable.replace(viscous_friction=200.0, end_compliance=1e-5, segments=18)
        for cable in bench.cables
    )
    write(tmp_path / "scene.xml", repair_scene(bench, stiffer, {}))
    again = Bench.of(tmp_path / "scene.xml")
    assert again.cables == stiffer
    assert apart(again, again.path) < 1e-5


@pytest.mark.parametrize(
    ("kind", "end", "told"),
    [
        ("open", "nail", "lies along a path that moves with joints elbow, wrist"),
        ("bends on a pulley", "nail", "lies along a route that moves with wrist as"),
    ],
)
def test_a_path_that_another_joint_moves_needs_an_axis_and_no_pulley(
    tmp_path: Path, kind: str, end: str, told: str
) -> None:
    with pytest.raises(CableError, match=told):
        Bench.of(arm(tmp_path, kind, end))


@pytest.mark.parametrize(
    ("scene", "axis"),
    [
        ("bilateral", "right_hip"),
        ("bilateral", "right_ankle"),
        ("hand", "index_flexor"),
    ],
)
def test_an_axis_is_played_as_mujoco_plays_it_while_other_joints_move(
    scene: str, axis: str
) -> None:
    bench = Bench.of(scene, axis)
    require_repairable(bench)
    # Ends that harden are solved to 1e-5 of the largest tension.
    assert moved_apart(bench) < 3e-5


@pytest.mark.parametrize("kind", ["mixed and bends", "lever"])
def test_the_driven_joint_of_a_path_that_several_move_can_be_named(
    tmp_path: Path, kind: str
) -> None:
    path = arm(tmp_path, kind, "nail")
    bench = Bench.of(path, driven="elbow")
    assert bench.others == ("wrist",)
    assert moved_apart(bench) < 2e-5


def moved_apart(bench: Bench) -> float:
    """`apart`, with the other joints in motion, which must matter."""
    time = 5e-4 * np.arange(700)
    joint = bench.centre + 0.25 * np.sin(7.0 * time + 0.3)
    angles = np.array(
        [-0.1 + 0.2 * np.sin(5.0 * time + k) for k in range(len(bench.others))]
    )
    path = bench.recorded_path(joint, angles)
    wound = 0.006 / bench.motor_radius * np.sin(5.0 * time) ** 2
    motor = bench.following(joint, path) + wound
    played = bench.replay(time[1], motor, joint, angles)
    others = dict(zip(bench.others, angles, strict=True))
    shown = rollout(
        bench.path,
        time,
        motor,
        joint,
        cables=bench.names,
        driven=bench.joint,
        others=others,
    )
    wanted = played.motor_torque, played.joint_torque
    if bench.others:
        still = bench.replay(time[1], motor, joint)
        assert np.abs(still.motor_torque - wanted[0]).max() > 1e-3 * wanted[0].max()
    return max(
        float(np.abs(a - b).max() / np.abs(b).max())
        for a, b in zip(shown, wanted, strict=True)
    )


def test_a_path_is_no_pulley_whose_radius_could_be_declared() -> None:
    bench = Bench.of(scene_path("finger"))
    assert bench.known({"motor_radius": Constant(0.009)}).motor_radius == 0.009
    with pytest.raises(CableError, match="joint_radius is of a pulley"):
        bench.known({"joint_radius": Constant(0.01)})
