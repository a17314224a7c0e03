"""Sentences on what went wrong in an episode that is played."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco import METRICS, Device, simulate
from cc_mujoco.control import CONTROLLERS, controller
from cc_mujoco.control._controller import SteppedController
from cc_mujoco.control._registry import law_drives
from cc_mujoco.device import Plant, find_device
from cc_mujoco.metrics._formulas import is_unstable
from cc_mujoco.metrics._metric import ArrayLog
from cc_mujoco.simulation import EpisodeLog, columns_for
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._episode_findings import Guards, episode_findings
from cc_mujoco.simulation._loop import run
from cc_mujoco.simulation._worn_device import WornDevice

KNEE = Path(__file__).parents[2] / "scripts" / "examples" / "knee_exo.xml"
WRIST = find_device("wrist").description
(AXIS,) = WRIST.axes
MODEL = mujoco.MjModel.from_xml_string(
    f"""<mujoco><worldbody><body name="trunk"><freejoint/><geom size="0.1"/>
    <body><joint name="{AXIS.limb}" range="-60 60"/><geom size="0.1"/></body>
    </body></worldbody></mujoco>"""
)
KNEE_MODEL = Plant(KNEE).model()
TIME = np.arange(2000) * 1e-3
ZERO = np.zeros(TIME.size)


def found(controller: str = "pi", height: Any = 1.0, **columns: Any) -> list[str]:
    """Return the sentences on an episode where nothing but these columns happens."""
    filled = {column.name: ZERO for column in columns_for(())} | {"time_s": TIME}
    qpos = np.zeros((TIME.size, MODEL.nq))
    qpos[:, 2] = height
    log = EpisodeLog(filled | {"qpos": qpos} | columns, {})
    return list(episode_findings(log, MODEL, WRIST, controller))


def test_nothing_is_said_of_an_episode_in_which_nothing_happens() -> None:
    sine = 0.5 * AXIS.safe_torque * np.sin(2.0 * np.pi * TIME)
    assert not found()
    assert not found(joint_torque_nm=sine, desired_torque_nm=sine)


def test_torque_above_the_safe_one_is_counted_and_sized() -> None:
    torque, desired = ZERO.copy(), ZERO + AXIS.safe_torque
    torque[500:520] = torque[900] = 1.5 * AXIS.safe_torque
    (sentence,) = found(joint_torque_nm=torque, desired_torque_nm=desired)
    assert f"safe {AXIS.safe_torque:g} N m 2 times (1.1 % of the time)" in sentence
    assert f"up to {1.5 * AXIS.safe_torque:.4g} N m, first at 0.5 s" in sentence
    torque[500:520] = 0.0
    (sentence,) = found(joint_torque_nm=torque, desired_torque_nm=desired)
    assert "N m once (0.05 %" in sentence


@pytest.mark.parametrize(
    ("controller", "advice"),
    [("pi", "; try --controller pi_tuned."), ("pi_tuned", "it swings at joint")],
)
def test_an_unstable_controller_is_named_with_one_that_is_tuned(
    controller: str, advice: str
) -> None:
    torque = 0.5 * AXIS.safe_torque * np.sin(2.0 * np.pi * 30.0 * TIME)
    (sentence,) = found(controller, joint_torque_nm=torque)
    assert sentence.startswith(f"{controller} is unstable on this device")
    assert advice in sentence
    assert ("try" in sentence) == (controller == "pi")


@given(
    width=st.floats(0.01, 0.2), over=st.floats(0.0, 0.9), seconds=st.floats(0.3, 2.0)
)
def test_a_pulse_that_overshoots_is_no_swing(
    width: float, over: float, seconds: float
) -> None:
    time = np.arange(round(1e3 * seconds)) * 1e-3
    pulse = 0.5 * AXIS.safe_torque * np.exp(-(((time - 0.6 * seconds) / width) ** 2))
    torque = {"joint_torque_nm": (1.0 + over) * pulse, "desired_torque_nm": pulse}
    assert not is_unstable(
        ArrayLog({"time_s": time} | torque, (), {}), AXIS.safe_torque
    )


@given(frequency=st.floats(6.0, 100.0), share=st.floats(0.25, 0.9))
def test_a_torque_that_goes_to_and_fro_swings_however_fast(
    frequency: float, share: float
) -> None:
    time = np.arange(round(1e3 * max(0.3, 5.0 / frequency))) * 1e-3
    torque = share * AXIS.safe_torque * np.sin(2.0 * np.pi * frequency * time)
    columns = {"joint_torque_nm": torque, "desired_torque_nm": 0.0 * torque}
    assert is_unstable(ArrayLog({"time_s": time} | columns, (), {}), AXIS.safe_torque)


def test_a_wearer_off_the_motion_is_said_with_share_and_size() -> None:
    angle = ZERO.copy()
    angle[:500] = 0.75 * AXIS.reach
    (sentence,) = found(joint_angle_rad=angle)
    assert f"off the motion at joint '{AXIS.limb}' 25 % of the time" in sentence
    assert f"by up to {0.75 * AXIS.reach:.3g} rad" in sentence


def test_a_joint_at_its_stop_is_said_with_its_range() -> None:
    angle = np.where(TIME < 0.5, np.radians(60.0), 0.0)
    (sentence,) = found(joint_angle_rad=angle, reference_angle_rad=angle)
    assert f"joint '{AXIS.limb}' is at a stop 25 % of the time" in sentence
    assert "its range is -1.05 to 1.05 rad" in sentence


def test_a_body_that_falls_is_said_with_time_and_heights() -> None:
    (sentence,) = found(height=np.where(TIME < 1.2, 0.9, 0.2))
    assert "the free body 'trunk' fell: from 0.9 m at the start to 0.2 m" in sentence
    assert "at 1.2 s" in sentence
    assert not found(height=np.where(TIME < 1.2, 0.9, 0.8))


def test_large_torque_fails_an_episode_of_a_device_without_a_safe_torque() -> None:
    device = Device.from_mjcf(KNEE)
    assert device.description.axis().safe_is_assumed
    log = simulate(device, "none", duration=0.1)
    assert METRICS["failed"].compute(log) == 0.0
    torque = np.full(len(log), 62.0)
    wild = EpisodeLog({**log.columns, "joint_torque_nm": torque}, log.metadata)
    assert METRICS["failed"].compute(wild) == 1.0


@settings(max_examples=15, deadline=None)
@given(demand=st.floats(0.1, 1e4), spring=st.booleans())
def test_an_assumed_safe_torque_leaves_room_for_what_the_motor_can_give_of_a_task(
    demand: float, spring: bool
) -> None:
    plant = Plant(KNEE)
    (axis,) = plant.description.axes
    task = f"spring:{demand}" if spring else f"hold:{demand}"
    exo = WornDevice(plant.description, KNEE_MODEL, task=task, duration=0.1)
    (found,), (drive,) = exo.description.axes, exo.drives
    most = max(map(abs, drive.reach))
    assert found.safe_torque == drive.safe_torque
    assert axis.safe_torque <= found.safe_torque <= axis.slip.safe_torque(most)
    if not spring:
        assert found.safe_torque >= 1.9 * min(demand, most)  # two digits


LOST = {"joint_torque_nm": "stopped the motor", "motor_angle_rad": "without torque"}


@pytest.mark.parametrize("lost", LOST)
@pytest.mark.parametrize("name", [name for name in CONTROLLERS if name != "none"])
def test_a_guard_that_stops_is_said_with_its_time_whatever_the_law(
    name: str, lost: str
) -> None:
    exo = WornDevice(WRIST, Plant("wrist").model(), duration=0.1)
    drives = [WRIST.sensing.equip(drive) for drive in exo.drives]
    law = controller(name, drives[0])
    assert isinstance(law, SteppedController)
    sensors = exo.controller_sensors(WRIST.sensing, law_drives(law, drives), 0)
    batch = Batch([exo], [0], alone=True, whole=True)
    guards = Guards(law, WRIST)

    def measure(columns: Any) -> Any:
        seen = sensors.measure(columns)
        return seen if columns["time_s"] < 0.02 else seen | {lost: np.nan}

    def observe(step: int, *_: object) -> None:
        guards.look(1e-3 * step)

    run(batch, law, observe, measure=measure)
    if (name, lost) == ("fused", "joint_torque_nm"):  # it measures tensions instead
        assert not [*guards.findings()]
        return
    (*_, sentence) = guards.findings()
    assert LOST[lost] in sentence and f"joint {AXIS.limb!r}" in sentence
    assert sentence.endswith((": at 0.025 s.", ": at 0.026 s."))


def test_a_guard_that_lets_go_is_said_with_count_and_share() -> None:
    guards = Guards(Flickering(), WRIST)
    for step in range(10):
        guards.look(0.1 * step)
    (sentence,) = guards.findings()
    assert "came too close to the safe 8 N m: 2 times (30 % of the time)" in sentence
    assert sentence.endswith("first at 0.2 s.")


class Flickering(SteppedController):
    """Law whose guard lets go twice."""

    def __init__(self) -> None:
        self._states = [0.0, 0.0, 1.0, 1.0, 0.0, 1.0, *4 * [0.0]]

    def guard_states(self) -> Any:
        """Return the next state."""
        return np.array([self._states.pop(0)])

    def law_tables(self) -> Any:
        """Have none."""
