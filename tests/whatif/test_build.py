"""Designs become models: what changes, what stays, what is impossible."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco import engine
from cc_mujoco.bare import strip
from cc_mujoco.devices import DEVICES
from cc_mujoco.engine.mjcf import instances
from cc_mujoco.errors import CableError
from cc_mujoco.whatif import build
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.variables import Value

SCENES = ("wrist", "ankle")


@pytest.fixture(scope="module", params=SCENES)
def builder(request: pytest.FixtureRequest) -> Builder:
    return Builder(str(request.param))


def test_a_bare_model_moves_as_the_whole_one_bit_for_bit(builder: Builder) -> None:
    design = builder.check(
        {"friction": 0.12, "joint_radius": 0.09, "motor_torque": 2.0}
    )
    assert moved(builder, design, whole=False) == moved(builder, design, whole=True)


def moved(builder: Builder, design: Mapping[str, Value], whole: bool) -> bytes:
    """The state of a design after a motion."""
    model = builder.model(design, whole)
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

    def built(friction: float) -> list[float]:
        one = Builder("wrist", 1.23e-4)  # that no builder has had before
        together.wait()
        found = engine.from_mjcf(one.model({"friction": friction}))
        return [cable.friction for cable in found.values()]

    monkeypatch.setattr(build, "strip", slowly)
    with ThreadPoolExecutor(workers) as pool:
        found = list(pool.map(built, (0.1, 0.2, 0.3, 0.4)))
    assert found == [[x, x] for x in (0.1, 0.2, 0.3, 0.4)]
    assert len(stripped) == 1


def test_a_design_says_what_the_cable_is(builder: Builder) -> None:
    design = {"friction": 0.3, "static_friction": 0.0, "loops": 2, "segments": 7}
    for cable in engine.from_mjcf(builder.model(builder.check(design))).values():
        assert (cable.friction, cable.segments) == (0.3, 7)
        assert cable.wrap == pytest.approx(4.0 * math.pi)
    nominal = next(iter(builder.cables.values()))
    longer = builder.cables_of({"length": 2.0 * nominal.length})
    assert all(c.wrap == pytest.approx(nominal.wrap) for c in longer.values())
    assert all(c.length == pytest.approx(2.0 * nominal.length) for c in longer.values())
    bent = builder.cables_of({"wrap": 3.0})
    assert all(c.wrap == pytest.approx(3.0) for c in bent.values())
    assert all(c.length == pytest.approx(nominal.length) for c in bent.values())
    thick = builder.cables_of({"diameter": 2.0 * builder.device.diameter})
    stiffness = nominal.axial_stiffness
    assert all(
        c.axial_stiffness == pytest.approx(4 * stiffness) for c in thick.values()
    )
    strength = builder.strength({"diameter": 2.0 * builder.device.diameter})
    assert all(
        s == pytest.approx(4 * builder.device.strength) for s in strength.values()
    )


def test_break_away_friction_follows_friction_unless_it_is_given() -> None:
    builder = Builder("wrist")
    nominal = builder.cables["flexor"]
    ratio = nominal.static_friction / nominal.friction
    assert ratio > 2.0
    both = builder.cables_of({"friction": 0.05, "extensor.static_friction": 0.06})
    assert both["flexor"].static_friction == pytest.approx(ratio * 0.05)
    assert both["extensor"].static_friction == 0.06
    alone = builder.cables_of({"static_friction": 0.3})["flexor"]
    assert (alone.friction, alone.static_friction) == (nominal.friction, 0.3)
    kept = builder.cables_of({"friction": nominal.friction})["flexor"]
    assert kept.static_friction == pytest.approx(nominal.static_friction)
    rope = builder.cables_of({"material": "steel_ptfe", "static_friction": 0.4})
    other = builder.cables_of({"material": "steel_ptfe"})["flexor"]
    assert rope["flexor"].friction == other.friction != nominal.friction
    assert rope["flexor"].static_friction == 0.4
    assert other.static_friction == pytest.approx(ratio * other.friction)


def test_pulleys_and_lever_set_the_ratio(builder: Builder) -> None:
    setup = builder.device
    design = {"motor_radius": 0.03, "joint_radius": 0.09}
    model = builder.model(design)
    data = mujoco.MjData(model)
    data.qvel[int(model.joint(setup.joint).dofadr[0])] = 1.0
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
    builder = Builder(scene)
    places = ("motor", builder.device.joint)

    def inertia(**design: float) -> np.ndarray:
        model = builder.model(design)
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
    builder = Builder("wrist")
    one, both = (
        builder.model({name: 0.04}).dof_M0[0] - builder.model({}).dof_M0[0]
        for name in ("flexor.motor_radius", "motor_radius")
    )
    assert [one, both] == pytest.approx([7.5 * 1.6e-5, 15.0 * 1.6e-5])


def test_one_cable_may_differ_from_the_other() -> None:
    builder = Builder("wrist")
    cables = builder.cables_of({"friction": 0.2, "extensor.friction": 0.4})
    assert cables["flexor"].friction == 0.2
    assert cables["extensor"].friction == 0.4
    model = builder.model({"flexor.motor_radius": 0.03})
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
        Builder("wrist").check(design)


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
        Builder("finger").check(design)
    assert str(raised.value).count(". ") == 0


def test_a_bare_open_cable_moves_as_the_whole_one_bit_for_bit() -> None:
    builder = Builder("finger")
    design = builder.check({"friction": 0.12, "motor_radius": 0.007})
    assert moved(builder, design, whole=False) == moved(builder, design, whole=True)


def test_only_the_pieces_of_an_open_path_limit_the_step() -> None:
    stiff = {"axial_stiffness": 1e6, "rotor_inertia": 1e-5}
    assert Builder("wrist", 0.005).check(stiff)["axial_stiffness"] == 1e6
    with pytest.raises(CableError, match="the pieces of its cables are so stiff"):
        Builder("finger", 0.005).check({"axial_stiffness": 1e6})


def _ends(model: mujoco.MjModel) -> list[tuple[int, int]]:
    found = []
    for index in instances(model).values():
        proximal, distal = np.flatnonzero(model.actuator_plugin == index)
        out = model.actuator_outadr
        found.append((int(out[proximal]), int(out[distal])))
    return found


@pytest.mark.parametrize("scene", sorted(DEVICES))
def test_a_simulation_of_a_design_is_small_and_has_room_to_spare(scene: str) -> None:
    """A larger one leaves holes in the allocator, by which a long study grew."""
    model = Builder(scene).model({})
    data = mujoco.MjData(model)
    data.qpos[:] = model.jnt_range[:, 1] + 0.5  # every joint beyond its stop
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    assert max(data.maxuse_arena, data.maxuse_stack) < model.narena / 16
    assert model.narena + model.nbuffer + data.nbuffer < 128 * 1024
