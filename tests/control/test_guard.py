"""The guard: a joint that is pulled far beyond what is planned is let go."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from gymnasium.utils import seeding
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.control import (
    CONTROLLERS,
    Controller,
    DisturbanceObserver,
    PredictiveCompensation,
    controller,
)
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control._guard import NO_TORQUE_LIMIT, release_state
from cc_mujoco.device import (
    TENSION_COLUMN,
    Drive,
    Measuring,
    Plant,
    Sensors,
    find_device,
)
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import first_unsafe_sample
from cc_mujoco.metrics._torque import MAX_UNSAFE_TIME
from cc_mujoco.simulation import Fleet, Trace, WornDevice, run
from control.devices import pull_pull, single

SAFE = 8.0
GUARDED = [name for name in CONTROLLERS if name != "none"]  # which measures nothing

torques = st.floats(-50.0, 50.0)


@given(measured=torques, planned=torques, safe=st.floats(0.1, 40.0))
def test_a_joint_is_let_go_before_it_is_unsafe_and_not_where_it_is_as_planned(
    measured: float, planned: float, safe: float
) -> None:
    for before in (0.0, 1.0):
        found = release_state(before, measured, 0.0, planned, safe)
        if abs(measured) > safe:
            assert found == 1.0
        elif abs(measured) <= planned * np.sign(measured):
            assert found == 0.0
        assert found == release_state(before, -measured, 0.0, -planned, safe)
    # What lets go keeps on until much less is left.
    assert release_state(1.0, measured, 0.0, planned, safe) >= release_state(
        0.0, measured, 0.0, planned, safe
    )


@given(measured=torques, rushing=torques, planned=torques, safe=st.floats(0.1, 40.0))
def test_a_motor_that_would_be_stopped_unsafely_is_let_go_before(
    measured: float, rushing: float, planned: float, safe: float
) -> None:
    for before in (0.0, 1.0):
        found = release_state(before, measured, rushing, planned, safe)
        assert found >= release_state(before, measured, 0.0 * rushing, planned, 1e9)
        if abs(measured + rushing) > safe:
            assert found == 1.0
        elif (
            release_state(before, measured, 0.0, planned, safe) == 0.0 and before == 0.0
        ):
            assert found == 0.0


@given(measured=torques, planned=torques)
def test_without_a_safe_torque_there_is_no_guard(
    measured: float, planned: float
) -> None:
    assert release_state(0.0, measured, 0.0, planned, NO_TORQUE_LIMIT) == 0.0
    assert release_state(0.0, np.nan, 0.0, planned, 1.0) == 0.0


def drive(pair: bool, safe: float) -> Drive:
    plain = pull_pull() if pair else single()
    nodes = Sensors((2, 5, 8), (0.1,) * 3)
    return dataclasses.replace(
        plain,
        safe_torque=safe,
        inertia=1e-3,
        sensors=(nodes,) * len(plain.cables),
    )


def seen(law: Controller, torque: float) -> dict[str, Any]:
    told: dict[str, Any] = dict.fromkeys(MEASURED_COLUMNS, 0.0)
    told |= {"joint_torque_nm": torque, "desired_torque_nm": 1.0}
    told[TENSION_COLUMN] = np.full((len(law.drive.cables), 3), 12.0)
    return told


@pytest.mark.parametrize("pair", [True, False])
@pytest.mark.parametrize("name", [name for name in GUARDED if name != "fused"])
def test_every_controller_that_measures_lets_go_of_what_it_should_not_pull(
    name: str, pair: bool
) -> None:
    """A sensor that shows more and more, whatever the motor does about it."""
    for safe in (SAFE, np.inf):
        law: Any = controller(name, drive(pair, safe))
        law.reset()
        torque = 0.0
        for measured in np.linspace(0.0, 1.2 * SAFE, 30):
            torque = law.torque(seen(law, float(measured)))
        if isinstance(law, PredictiveCompensation):
            released_now = law._devices.memory[0, planner_memory.RELEASED] == 1.0
        else:
            # Motor and joint are at rest, so there is nothing to follow.
            released_now = torque == 0.0
        assert released_now == (safe == SAFE) or (not pair and torque == 0.0)


@given(
    torque=st.floats(-20.0, 20.0),
    motor=st.floats(-9.0, 9.0),
    joint=st.floats(-9.0, 9.0),
)
def test_a_motor_that_is_let_go_follows_the_joint(
    torque: float, motor: float, joint: float
) -> None:
    """And otherwise its law is `proportional_integral`, bit for bit."""
    gains = compiled_laws.FeedbackGains(
        ratio=2.0, low=-5.0, high=5.0, safe_torque=SAFE, settling=0.1, inertia=1e-2
    )
    read = np.array([0.0, motor, joint, torque, 1.0])
    memory, plain = (
        np.zeros(compiled_laws.MEMORY_SIZE),
        np.zeros(compiled_laws.MEMORY_SIZE),
    )
    found = compiled_laws.guarded_torque(gains.packed, 20.0, memory, read)
    usual = compiled_laws.proportional_integral(gains.packed, plain, 1.0, torque)
    rushing = (motor - 2.0 * joint) * np.sqrt(20.0 * 1e-2)
    if release_state(0.0, torque, rushing, 1.0, SAFE) == 0.0:
        assert found == usual
        assert np.array_equal(memory, plain)
    else:
        damped = 0.1 * 20.0 / 2.0**2 * (2.0 * joint - motor)
        assert found == pytest.approx(min(max(damped, -5.0), 5.0), abs=1e-12)
        assert memory[compiled_laws.INTEGRAL_TORQUE] == 0.0


def test_a_disturbance_is_not_learned_while_the_joint_is_let_go() -> None:
    law = controller("disturbance", drive(True, SAFE))
    assert isinstance(law, DisturbanceObserver)
    law.reset()
    for _ in range(20):
        law.torque(seen(law, 3.0))
    assert law.disturbance() != 0.0
    for _ in range(20):
        law.torque(seen(law, 1.2 * SAFE))
    assert law.disturbance() == 0.0
    for _ in range(20):
        law.torque(seen(law, 1.0))
    assert law.disturbance() != 0.0


def peaks(
    scene: str, law: str, changes: dict[str, float], believed: float, duration: float
) -> list[tuple[float, bool]]:
    """Return peak torque [N m], and whether it was unsafe, with the guard and without.

    Args:
        scene: Name of the device.
        law: Name of the controller.
        changes: Parameters of its cables that the controller does not know.
        believed: Friction that the controller believes, over the true one.
        duration: Of the episode [s].
    """
    setup, plant = find_device(scene).description, Plant(scene, changes)
    exo = WornDevice(
        setup, plant.model(), setup.trajectory, setup.axes[0].task, duration
    )
    script = exo.author.write(seeding.np_random(0)[0])
    plain = exo.drive
    row = tuple(
        dataclasses.replace(
            one,
            cable=plant.device.cables[name].replace(
                friction=believed * plant.device.cables[name].friction,
                static_friction=believed * plant.device.cables[name].static_friction,
            ),
        )
        for one, name in zip(plain.cables, exo.device.driven[0], strict=True)
    )
    known = dataclasses.replace(plain, cable_drives=(row,))
    found = []
    for own in (known, dataclasses.replace(known, safe_torque=np.inf)):
        fleet = Fleet(exo, [exo.device], (script,))
        measuring = Measuring(
            setup.sensing, own, exo.device.driven[0], [0], fleet.steps
        )
        trace = Trace(("joint_torque_nm",), fleet.steps, fleet.going)
        run(fleet, controller(law, own), trace.keep, measure=measuring.measure)
        torque = trace.columns["joint_torque_nm"][:, 0]
        unsafe = (
            first_unsafe_sample(torque, setup.axes[0].safe_torque, exo.period)
            is not None
        )
        found.append((float(np.abs(torque).max()), unsafe))
    return found


SEALS = {"seal_proximal": 20.0, "seal_distal": 20.0}


@pytest.mark.parametrize(
    ("scene", "name", "changes", "believed", "duration"),
    [
        # Its motor winds up slack at 100 rad/s, and the cable stops it.
        ("ankle", "pi", SEALS, 1.0, 1.2),
        ("ankle", "disturbance", SEALS, 3.0, 1.2),
    ],
)
def test_a_joint_stays_safe_that_is_unsafe_without_the_guard(
    scene: str, name: str, changes: dict[str, float], believed: float, duration: float
) -> None:
    guarded, unguarded = peaks(scene, name, changes, believed, duration)
    assert unguarded[1] and not guarded[1]
    assert guarded[0] < 0.8 * find_device(scene).description.axes[0].safe_torque


@pytest.mark.study
@pytest.mark.parametrize("name", GUARDED)
@pytest.mark.parametrize("scene", ("wrist", "ankle", "finger"))
def test_no_wrong_friction_is_unsafe(scene: str, name: str) -> None:
    for believed in (0.3, 2.0, 4.0):
        (_, unsafe), _ = peaks(scene, name, {}, believed, 3.0)
        assert not unsafe, believed


def test_a_safe_torque_is_above_zero() -> None:
    with pytest.raises(CableError, match="safe_torque must be above 0 N m, not -1"):
        drive(True, -1.0)


@given(
    long=st.integers(1, 40), first=st.integers(0, 50), sign=st.sampled_from([-1.0, 1.0])
)
def test_a_torque_is_unsafe_once_it_was_too_high_for_too_long(
    long: int, first: int, sign: float
) -> None:
    torque = np.zeros(100)
    torque[first : first + long] = sign * 2.0
    period = 1e-3
    found = first_unsafe_sample(torque, 1.0, period)
    assert found == (first if long * period >= MAX_UNSAFE_TIME else None)
    assert first_unsafe_sample(torque, 2.0, period) is None
