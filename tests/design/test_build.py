"""Designs become models: what changes, what stays, what is impossible."""

from __future__ import annotations

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco import plugin
from cc_mujoco.device import Device, Plant, load_device
from cc_mujoco.device import _device as made
from cc_mujoco.device._strip_visuals import strip
from cc_mujoco.errors import CableError
from cc_mujoco.plugin._mjcf import instances

SCENES = ("wrist", "ankle")


@pytest.fixture(scope="module", params=SCENES)
def device(request: pytest.FixtureRequest) -> Device:
    return load_device(str(request.param))


def test_a_bare_model_moves_as_the_whole_one_bit_for_bit(device: Device) -> None:
    one = Plant(device, {"friction": 0.12, "joint_radius": 0.09, "motor_torque": 2.0})
    one.check()
    assert moved(one, whole=False) == moved(one, whole=True)


def moved(one: Plant, whole: bool) -> bytes:
    """Return the state of a plant after a motion."""
    model = one.model(whole)
    data = mujoco.MjData(model)
    data.qvel[:] = 0.5 * np.random.default_rng(0).standard_normal(model.nv)
    most = model.actuator("motor").ctrlrange[1]
    for step in range(400):
        data.ctrl[model.actuator("motor").id] = most * np.sin(step / 40.0)
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel, data.plugin_state]).tobytes()


def test_threads_that_begin_together_copy_one_scene(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each with one of its own, all but one would lose what their copies point to."""
    workers = 4
    together = threading.Barrier(workers)
    stripped = []

    def slowly(*given: Any) -> mujoco.MjSpec:
        stripped.append(given)
        time.sleep(0.05)
        return strip(*given)

    one = load_device("wrist", 1.23e-4)  # with a time step that none has had before

    def built(friction: float) -> list[float]:
        together.wait()
        found = plugin.from_mjcf(Plant(one, {"friction": friction}).model())
        return [cable.friction for cable in found.values()]

    monkeypatch.setattr(made.stripping, "strip", slowly)
    with ThreadPoolExecutor(workers) as pool:
        found = list(pool.map(built, (0.1, 0.2, 0.3, 0.4)))
    assert found == [[x, x] for x in (0.1, 0.2, 0.3, 0.4)]
    assert len(stripped) == 1


def test_a_design_says_what_the_cable_is(device: Device) -> None:
    design = {"friction": 0.3, "static_friction": 0.0, "loops": 2, "segments": 7}
    for cable in plugin.from_mjcf(Plant(device, design).model()).values():
        assert (cable.friction, cable.segments) == (0.3, 7)
        assert cable.wrap == pytest.approx(4.0 * math.pi)
    nominal = next(iter(device.cables.values()))
    longer = Plant(device, {"length": 2.0 * nominal.length}).cables
    assert all(c.wrap == pytest.approx(nominal.wrap) for c in longer.values())
    assert all(c.length == pytest.approx(2.0 * nominal.length) for c in longer.values())
    bent = Plant(device, {"wrap": 3.0}).cables
    assert all(c.wrap == pytest.approx(3.0) for c in bent.values())
    assert all(c.length == pytest.approx(nominal.length) for c in bent.values())
    thick = Plant(device, {"diameter": 2.0 * device.description.diameter}).cables
    stiffness = nominal.axial_stiffness
    assert all(
        c.axial_stiffness == pytest.approx(4 * stiffness) for c in thick.values()
    )
    strength = Plant(device, {"diameter": 2.0 * device.description.diameter}).strength
    assert all(
        s == pytest.approx(4 * device.description.strength) for s in strength.values()
    )


@pytest.mark.parametrize("straight", [{"loops": 0}, {"wrap": 0}])
def test_a_conduit_may_be_straight(straight: dict[str, object]) -> None:
    for cable in plugin.from_mjcf(Plant("wrist", straight).model()).values():
        assert cable.wrap == 0.0
        assert cable.length == pytest.approx(2.0, rel=0.5)


def test_the_name_of_an_axis_means_its_cables() -> None:
    plant = Plant("bilateral", {"left_knee.friction": 0.31, "friction": 0.11})
    named = plant.device.axis_cables["left_knee"]
    for cable, own in plant.cables.items():
        assert own.friction == (0.31 if cable in named else 0.11)
    cable = named[0]
    closest = Plant("bilateral", {f"{cable}.friction": 0.2, "left_knee.friction": 0.3})
    assert closest.cables[cable].friction == 0.2
    for wrong, words in (
        ({"left_knee.wrap": 3, f"{cable}.loops": 1}, "set the same thing"),
        ({"left_shin.friction": 0.1}, "unknown cable or axis"),
        ({"left_knee.body_mass": 60}, "belongs to no cable"),
    ):
        with pytest.raises(CableError, match=words):
            Plant("bilateral", wrong)


def test_break_away_friction_follows_friction_unless_it_is_given() -> None:
    device = load_device("wrist")
    nominal = device.cables["flexor"]
    ratio = nominal.static_friction / nominal.friction
    assert ratio > 2.0
    both = Plant(device, {"friction": 0.05, "extensor.static_friction": 0.06}).cables
    assert both["flexor"].static_friction == pytest.approx(ratio * 0.05)
    assert both["extensor"].static_friction == 0.06
    alone = Plant(device, {"static_friction": 0.3}).cables["flexor"]
    assert (alone.friction, alone.static_friction) == (nominal.friction, 0.3)
    kept = Plant(device, {"friction": nominal.friction}).cables["flexor"]
    assert kept.static_friction == pytest.approx(nominal.static_friction)
    rope = Plant(device, {"material": "steel_ptfe", "static_friction": 0.4}).cables
    other = Plant(device, {"material": "steel_ptfe"}).cables["flexor"]
    assert rope["flexor"].friction == other.friction != nominal.friction
    assert rope["flexor"].static_friction == 0.4
    assert other.static_friction == pytest.approx(ratio * other.friction)


def test_pulleys_and_lever_set_the_ratio(device: Device) -> None:
    joint = device.description.axis().joint
    design = {"motor_radius": 0.03, "joint_radius": 0.09}
    model = Plant(device, design).model()
    data = mujoco.MjData(model)
    data.qvel[int(model.joint(joint).dofadr[0])] = 1.0
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    for proximal, distal in _ends(model):
        arm = data.actuator_velocity[distal]
        assert abs(arm) == pytest.approx(0.09, rel=1e-3)
        assert abs(model.actuator_gear[proximal, 0]) == 0.03


@pytest.mark.parametrize(
    ("scene", "motor", "joint"), [("wrist", 1.6e-5, 1.1e-3), ("ankle", 1.5e-4, 0.0)]
)
def test_pulleys_weigh_what_discs_do(scene: str, motor: float, joint: float) -> None:
    """In the scene as the comments of its file say; else as radius to the power 4."""
    device = load_device(scene)
    places = ("motor", device.description.axis().joint)

    def inertia(**design: float) -> np.ndarray:
        model = Plant(device, design).model()
        return np.array([model.dof_M0[model.joint(n).dofadr[0]] for n in places])

    small, large = inertia(motor_radius=0.01), inertia(motor_radius=0.03)
    radius = {"wrist": 0.02, "ankle": 0.025}[scene]
    grown = (0.03**4 - 0.01**4) / radius**4
    assert large - small == pytest.approx([motor * grown, 0.0], rel=1e-9, abs=1e-15)
    wide = inertia(joint_radius=0.15) - inertia(joint_radius=0.05)
    grown = (0.15**4 - 0.05**4) / 0.104**4
    assert wide == pytest.approx([0.0, joint * grown], rel=1e-9, abs=1e-15)
    assert inertia(motor_radius=radius) == pytest.approx(inertia())
    lightest = inertia(motor_radius=1e-4, joint_radius=1e-3)
    assert inertia() - lightest == pytest.approx([motor, joint], rel=1e-6, abs=1e-15)


def test_half_a_pulley_is_each_cable_s() -> None:
    device = load_device("wrist")
    one, both = (
        Plant(device, {name: 0.04}).model().dof_M0[0] - Plant(device).model().dof_M0[0]
        for name in ("flexor.motor_radius", "motor_radius")
    )
    assert [one, both] == pytest.approx([7.5 * 1.6e-5, 15.0 * 1.6e-5])


def test_one_cable_may_differ_from_the_other() -> None:
    device = load_device("wrist")
    cables = Plant(device, {"friction": 0.2, "extensor.friction": 0.4}).cables
    assert cables["flexor"].friction == 0.2
    assert cables["extensor"].friction == 0.4
    model = Plant(device, {"flexor.motor_radius": 0.03}).model()
    assert np.sort(np.abs(model.actuator_gear[2:, 0])).tolist() == [
        0.02,
        0.03,
        0.104,
        0.104,
    ]


@pytest.mark.parametrize(
    ("design", "wrong"),
    [
        ({"friction": 0.3, "static_friction": 0.2}, "static_friction"),
        ({"friction": 2.0}, "cable 'flexor': break-away friction is 3 times"),
        ({"loops": 1, "bend_radius": 0.2}, "set the same thing"),
        ({"flexor.loops": 1, "wrap": 2}, "set the same thing"),
        ({"conduit": "2"}, "length:radius"),
        ({"route": "nowhere"}, "must be a tendon"),
        ({"pretension": 265}, "breaking load of 265 N"),
        ({"extensor.pretension": 20, "strength": 15}, "'extensor' is 20 N"),
        ({"diameter": 1e-4}, "breaking load of 7.36111 N"),
    ],
)
def test_impossible_designs_say_why(design: dict[str, object], wrong: str) -> None:
    with pytest.raises(CableError, match=wrong):
        Plant("wrist", design).check()


@pytest.mark.parametrize(
    ("design", "wrong"),
    [
        ({"loops": 2}, "'loops' cannot be varied for cable 'extensor', which leaves"),
        ({"extensor.length": 0.3}, "'length' cannot be varied for cable 'extensor'"),
        ({"joint_radius": 0.01}, "'joint_radius' .* has no lever that moves"),
        ({"axial_stiffness": 1e6}, "time step"),
    ],
)
def test_what_the_drawing_decides_of_an_open_cable_is_not_varied(
    design: dict[str, object], wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong) as raised:
        Plant("finger", design).check()
    assert str(raised.value).count(". ") == 0


def test_a_bare_open_cable_moves_as_the_whole_one_bit_for_bit() -> None:
    one = Plant("finger", {"friction": 0.12, "motor_radius": 0.007})
    one.check()
    assert moved(one, whole=False) == moved(one, whole=True)


def test_only_the_pieces_of_an_open_path_limit_the_step() -> None:
    stiff = {"axial_stiffness": 1e6, "rotor_inertia": 1e-5}
    Plant(load_device("wrist", 0.005), stiff).check()
    with pytest.raises(CableError, match="the pieces of its cables are so stiff"):
        Plant(load_device("finger", 0.005), {"axial_stiffness": 1e6}).check()


def _ends(model: mujoco.MjModel) -> list[tuple[int, int]]:
    found = []
    for index in instances(model).values():
        proximal, distal = np.flatnonzero(model.actuator_plugin == index)
        out = model.actuator_outadr
        found.append((int(out[proximal]), int(out[distal])))
    return found


@pytest.mark.parametrize("scene", ["ankle", "exosuit", "finger", "wrist"])
def test_a_simulation_of_a_design_is_small_and_has_room_to_spare(scene: str) -> None:
    """A larger one leaves holes in the allocator, by which a long study grew."""
    model = Plant(scene).model()
    data = mujoco.MjData(model)
    data.qpos[:] = model.jnt_range[:, 1] + 0.5  # every joint beyond its stop
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    assert max(data.maxuse_arena, data.maxuse_stack) < model.narena / 8
    assert model.narena + model.nbuffer + data.nbuffer < 128 * 1024


@pytest.mark.parametrize("scene", ["exosuit", "hand"])
def test_a_fine_mesh_has_memory(scene: str) -> None:
    model = Plant(scene, {"segments": 400}).model()
    data = mujoco.MjData(model)
    for _ in range(5):
        mujoco.mj_step(model, data)
    assert data.maxuse_arena < model.narena / 2
