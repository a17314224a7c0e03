"""The shipped scenes: what is drawn, what is configured and what is stated agree."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import cc_mujoco.plugin  # noqa: F401  (registers the plugin)
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

CABLES = {
    "wrist": ("flexor", "extensor"),
    "ankle": ("plantarflexor",),
    "bench": ("agonist", "antagonist"),
}
JOINTS = {
    "wrist": ("motor", "wrist"),
    "ankle": ("motor", "hip", "knee", "ankle"),
}
DISTAL = {"wrist": "wrist", "ankle": "ankle", "bench": "joint"}
WORN = ("wrist", "ankle", "finger", "exosuit")
EACH_CABLE = [(scene, cable) for scene in CABLES for cable in CABLES[scene]]


def load(scene: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(scene_path(scene)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def tree(scene: str) -> ElementTree.Element:
    return ElementTree.parse(scene_path(scene)).getroot()


def config(scene: str, cable: str) -> dict[str, str]:
    found = tree(scene).findall(f".//plugin/instance[@name='{cable}']/config")
    return {entry.attrib["key"]: entry.attrib["value"] for entry in found}


def sections(scene: str, cable: str) -> Array:
    text = config(scene, cable)["conduit"].split()
    return np.array([[float(part) for part in item.split(":")] for item in text])


def polyline(model: mujoco.MjModel, data: mujoco.MjData, tendon: str) -> Array:
    index = model.tendon(tendon).id
    start, number = data.ten_wrapadr[index], data.ten_wrapnum[index]
    return np.array(data.wrap_xpos).reshape(-1, 3)[start : start + number]


def length_and_wrap(points: Array) -> tuple[float, float]:
    edges = np.diff(points, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    units = edges / lengths[:, None]
    cosines = np.clip(np.sum(units[1:] * units[:-1], axis=1), -1, 1)
    return float(lengths.sum()), float(np.arccos(cosines).sum())


def tendon_length(
    model: mujoco.MjModel, data: mujoco.MjData, tendon: str, joint: str, angle: float
) -> float:
    data.joint(joint).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    return float(data.ten_length[model.tendon(tendon).id])


def lever(scene: str, cable: str, angle: float) -> float:
    """Return the derivative of the drawn free cable's length by the joint angle."""
    model, data = load(scene)
    tendon, step = f"{cable}_free_distal", 1e-5
    low = tendon_length(model, data, tendon, DISTAL[scene], angle - step)
    high = tendon_length(model, data, tendon, DISTAL[scene], angle + step)
    return (high - low) / (2 * step)


def test_a_scene_is_found_by_name() -> None:
    for scene in SCENES:
        assert scene_path(scene).is_file()
        assert scene_path(scene).is_absolute()
    with pytest.raises(
        CableError,
        match=r"'wirst'.*'wrist'.*Available: ankle, bench, bilateral, endoscope",
    ):
        scene_path("wirst")


def test_every_shipped_scene_is_listed() -> None:
    folder = Path(scene_path("wrist")).parent
    assert {path.name for path in folder.glob("*.xml")} == set(SCENES.values())


@pytest.mark.parametrize("scene", JOINTS)
def test_names_that_the_environments_rely_on(scene: str) -> None:
    model, _ = load(scene)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == JOINTS[scene]
    cameras = {model.camera(i).name for i in range(model.ncam)}
    assert {"overview", "detail"} <= cameras
    for sensor in ("motor_angle", "motor_velocity", "joint_angle", "joint_velocity"):
        assert model.sensor(sensor).id >= 0
    actuators = [model.actuator(i).name for i in range(model.nu)]
    assert actuators[:2] == ["motor", "wearer"]
    for cable in CABLES[scene]:
        proximal, distal = f"{cable}_proximal", f"{cable}_distal"
        assert actuators.index(proximal) < actuators.index(distal)
        assert model.sensor(f"tension_{proximal}").id >= 0
        assert model.sensor(f"tension_{distal}").id >= 0
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (1280, 720)


@pytest.mark.parametrize(("scene", "cable"), EACH_CABLE)
def test_the_drawn_route_is_the_configured_conduit(scene: str, cable: str) -> None:
    model, data = load(scene)
    route = config(scene, cable)["route"]
    assert route == f"{cable}_route"
    length, wrap = length_and_wrap(polyline(model, data, route))
    part = sections(scene, cable)
    assert length == pytest.approx(part[:, 0].sum(), rel=0.02)
    assert wrap == pytest.approx((part[:, 0] / part[:, 1]).sum(), rel=0.02)


@pytest.mark.parametrize(("scene", "cable"), EACH_CABLE)
def test_conduits_bend_smoothly(scene: str, cable: str) -> None:
    model, data = load(scene)
    points = polyline(model, data, f"{cable}_route")
    kinks = [length_and_wrap(points[i : i + 3])[1] for i in range(len(points) - 2)]
    assert max(kinks) < math.radians(17)


@pytest.mark.parametrize(("scene", "cable"), EACH_CABLE)
def test_free_cable_meets_the_conduit_at_both_ends(scene: str, cable: str) -> None:
    model, data = load(scene)
    route = polyline(model, data, f"{cable}_route")
    free = polyline(model, data, f"{cable}_free_distal")
    np.testing.assert_allclose(free[0], route[-1], atol=1e-9)
    geom = data.geom(f"{cable}_free_proximal")
    half = model.geom(f"{cable}_free_proximal").size[1]
    axis = geom.xmat.reshape(3, 3)[:, 2]
    ends = np.array([geom.xpos - half * axis, geom.xpos + half * axis])
    gaps = np.linalg.norm(ends - route[0], axis=1)
    assert gaps.min() < 1e-4
    # No kink where the cable leaves the conduit: friction there is not modelled.
    leaving = route[0] - ends[np.argmax(gaps)]
    entering = route[1] - route[0]
    turn = leaving @ entering / np.linalg.norm(leaving) / np.linalg.norm(entering)
    assert turn > math.cos(math.radians(1))


@pytest.mark.parametrize(
    ("scene", "cable", "pulley"),
    [
        ("wrist", "flexor", "load_pulley"),
        ("wrist", "extensor", "load_pulley"),
        ("bench", "agonist", "joint_pulley"),
        ("bench", "antagonist", "joint_pulley"),
    ],
)
@pytest.mark.parametrize("angle", [-1.15, -0.5, 0.0, 0.5, 1.15])
def test_joint_gear_is_the_drawn_pulley(
    scene: str, cable: str, pulley: str, angle: float
) -> None:
    model, _ = load(scene)
    gear = model.actuator(f"{cable}_distal").gear[0]
    assert lever(scene, cable, angle) == pytest.approx(gear, rel=0.01)
    assert abs(gear) == pytest.approx(model.geom(pulley).size[0])


@pytest.mark.parametrize(
    ("scene", "cable", "pulley"),
    [
        ("wrist", "flexor", "motor_pulley"),
        ("wrist", "extensor", "motor_pulley"),
        ("ankle", "plantarflexor", "motor_drum"),
        ("bench", "agonist", "motor_pulley"),
        ("bench", "antagonist", "motor_pulley"),
    ],
)
def test_motor_gear_is_the_drawn_pulley(scene: str, cable: str, pulley: str) -> None:
    model, data = load(scene)
    gear = model.actuator(f"{cable}_proximal").gear[0]
    radius = model.geom(pulley).size[0]
    assert abs(gear) == pytest.approx(radius)
    # The straight cable touches the rim where turning the motor moves the rim along it.
    free = data.geom(f"{cable}_free_proximal")
    half = model.geom(f"{cable}_free_proximal").size[1]
    along = free.xmat.reshape(3, 3)[:, 2]
    start = polyline(model, data, f"{cable}_route")[0]
    if along @ (start - free.xpos) < 0:
        along = -along
    touch = free.xpos - half * along - data.geom(pulley).xpos
    axis = data.joint("motor").xaxis
    across = touch - (touch @ axis) * axis
    assert np.linalg.norm(across) == pytest.approx(radius, rel=1e-3)
    assert np.cross(axis, across) @ along == pytest.approx(gear, rel=1e-3)


def test_heel_lever_shortens_the_cable_in_plantarflexion() -> None:
    assert lever("ankle", "plantarflexor", 0.0) == pytest.approx(0.12, rel=0.005)
    for angle in np.radians([-25, -10, 10, 20]):
        assert 0.10 < lever("ankle", "plantarflexor", float(angle)) < 0.125


def test_the_motor_pulls_the_joint_positive_through_the_flexor() -> None:
    model, _ = load("wrist")
    gears = {
        name: model.actuator(name).gear[0]
        for name in ("flexor_proximal", "flexor_distal")
    }
    assert gears == {"flexor_proximal": -0.02, "flexor_distal": -0.104}
    assert model.actuator("extensor_proximal").gear[0] == 0.02
    assert model.actuator("extensor_distal").gear[0] == 0.104


@pytest.mark.parametrize("cable", CABLES["wrist"])
def test_wrist_cables_have_the_values_of_table_2_2(cable: str) -> None:
    values = config("wrist", cable)
    assert sections("wrist", cable).tolist() == [[2.0, 0.28]]
    assert float(values["axial_stiffness"]) == 2000.0 * 2.0
    assert float(values["pretension"]) == 10.0
    assert float(values["friction"]) == 0.21
    assert float(values["static_friction"]) == 0.63


def test_leg_has_the_proportions_of_a_wearer_of_75_kg_and_1_75_m() -> None:
    model, _ = load("ankle")
    assert -model.body("shank").pos[2] == pytest.approx(0.245 * 1.75, abs=1e-3)
    assert -model.body("foot").pos[2] == pytest.approx(0.246 * 1.75, abs=1e-3)
    assert model.body("thigh").mass[0] == pytest.approx(0.100 * 75)
    exoskeleton = 0.9
    shoe = 0.35
    leg = model.body("shank").mass[0] + model.body("foot").mass[0]
    assert leg - exoskeleton - shoe == pytest.approx((0.0465 + 0.0145) * 75, abs=0.01)


def test_joint_signs_of_the_leg() -> None:
    model, data = load("ankle")

    def toes(joint: str) -> Array:
        mujoco.mj_resetData(model, data)
        data.joint(joint).qpos[0] = 0.2
        mujoco.mj_kinematics(model, data)
        rotation = data.body("foot").xmat.reshape(3, 3)
        return np.concatenate([data.body("foot").xpos, rotation[:, 0]])

    assert toes("hip")[0] > 0.1  # flexion brings the foot forward
    assert toes("knee")[0] > 0.05  # extension does too
    assert toes("ankle")[5] == pytest.approx(math.sin(0.2))  # dorsiflexion: toes up


@pytest.mark.parametrize(
    "pose", [(0.45, -0.1, 0.1), (-0.2, -0.1, 0.28), (0.1, -0.7, -0.2), (0.5, -1.1, 0.0)]
)
def test_the_route_follows_the_leg_through_a_stride(
    pose: tuple[float, float, float],
) -> None:
    model, data = load("ankle")
    neutral, least = length_and_wrap(polyline(model, data, "plantarflexor_route"))
    for joint, angle in zip(("hip", "knee", "ankle"), pose, strict=True):
        data.joint(joint).qpos[0] = angle
    mujoco.mj_forward(model, data)
    length, wrap = length_and_wrap(polyline(model, data, "plantarflexor_route"))
    assert length == pytest.approx(neutral, rel=0.05)
    assert least < wrap < 1.5 * least


@pytest.mark.parametrize("scene", SCENES)
def test_nothing_collides_and_drawings_weigh_nothing(scene: str) -> None:
    model, data = load(scene)
    assert data.ncon == 0
    assert model.geom_contype.sum() == model.geom_conaffinity.sum() == 0
    moving = [i for i in range(1, model.nbody) if model.body_mass[i] > 0]
    assert len(moving) == model.njnt


@pytest.mark.parametrize("scene", WORN)
def test_the_wearer_is_a_position_source_of_finite_impedance(scene: str) -> None:
    model, _ = load(scene)
    for name in [model.actuator(i).name for i in range(model.nu)]:
        if not name.startswith("wearer"):
            continue
        stiffness = model.actuator(name).gainprm[0]
        bias = model.actuator(name).biasprm
        assert stiffness > 0
        assert bias[0] == 0
        assert bias[1] == -stiffness
        assert bias[2] < 0


@pytest.mark.parametrize(
    ("scene", "stiffest"),
    [("wrist", 15_000.0), ("ankle", 200_000.0), ("bench", 160_000.0)],
)
def test_the_time_step_resolves_the_end_of_the_cable(
    scene: str, stiffest: float
) -> None:
    model, _ = load(scene)
    joint = DISTAL[scene]
    cables = CABLES[scene]
    values = config(scene, cables[0])
    stiffness = float(values["axial_stiffness"])
    end = (
        2 * int(values["segments"]) * stiffness / sections(scene, cables[0])[:, 0].sum()
    )
    motor = model.actuator(f"{cables[0]}_proximal").gear[0]
    for name, radius in (("motor", motor), (joint, lever(scene, cables[0], 0.0))):
        inertia = model.dof_M0[model.joint(name).dofadr[0]]
        frequency = math.sqrt(len(cables) * end * radius**2 / inertia)
        limit = 2 / frequency
        assert limit / model.opt.timestep > 3.5
        assert limit / math.sqrt(stiffest / stiffness) / model.opt.timestep > 2
