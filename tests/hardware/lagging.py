"""The example of the hardware page and a wrist, played with a motor that lags.

The bench is the rig of `play_rig.py`, in simulated time: a hand swings the joint while
0.5 N m are desired. A controller either knows the lag (`Drive.motor_lag`) or takes it
for 0. Errors are RMS, of the torque that the joint truly got.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from driven import Bench, Lockstep, play

import cc_mujoco.envs  # noqa: F401, registers the environments
from cc_mujoco.control import Controller, controller
from cc_mujoco.device import Drive, Measuring, load_device
from cc_mujoco.hardware import RunOutcome, Settings, read_settings
from cc_mujoco.simulation import Single, Trace, run
from rig import make_rig

PAGE = Path(__file__).resolve().parents[2] / "cc_mujoco" / "hardware" / "README.md"
NOTHING = "motor off"  # A controller that asks for no torque
SWING, SWING_PERIOD = 0.3, 2.0
"""Swing of the hand at the bench, as in `play_rig.py` [rad], [s]."""
SECONDS, SETTLED = 6.0, 2.0
"""Length of a run of the bench, and from when on its error counts [s]."""


class Off(Controller):
    def reset(self, where: Any = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Any) -> Any:
        return np.zeros(np.shape(observation["desired_torque_nm"]))[()]


def law_of(name: str, drive: Drive) -> Controller:
    return Off(drive) if name == NOTHING else controller(name, drive)


def page_settings(changes: dict[str, str] | None = None) -> Settings:
    """Return the settings of the `rig.toml` on the hardware page."""
    text = PAGE.read_text("utf-8").partition("```toml\n")[2].partition("```")[0]
    for key, value in (changes or {}).items():
        text = re.sub(rf"(?m)^{key} = \S+", f"{key} = {value}", text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        path.write_text(text, "utf-8")
        return read_settings(path)


def bench(
    law: str,
    settings: Settings,
    *,
    lag: float = 0.0,
    seed: int = 1,
    rate_known: bool = True,
    seconds: float = SECONDS,
) -> tuple[float, RunOutcome]:
    """Simulate the bench with a motor of lag `lag` [s]; return error and outcome.

    The controller assumes the `motor_lag` of the settings. The error is the RMS of the
    joint's true torque [N m], infinite for a run that was stopped.
    """
    drive = settings.drive()
    if not rate_known:
        drive = dataclasses.replace(drive, torque_rate=math.inf)
    pace = 2.0 * math.pi / SWING_PERIOD

    def swing(now: float) -> tuple[float, float]:
        size = SWING * min(1.0, now)
        return size * math.sin(pace * now), size * pace * math.cos(pace * now)

    rig = Lockstep(
        Bench(make_rig(seed, make="guides"), {}, settings.period, motor_lag=lag),
        seed,
        swing,
    )
    desired = settings.desired(seconds)
    outcome = play(
        rig, law_of(law, drive), desired, settings.limits, seconds,
        watchdog=settings.watchdog,
    )  # fmt: skip
    torque = np.array(rig.torques)[: round(seconds / settings.period)]
    torque = torque[round(min(SETTLED, 0.5 * seconds) / settings.period) :]
    wanted = settings.task.number("torque") or 0.0
    rms = float(np.sqrt(np.mean((torque - wanted) ** 2)))
    return (rms if outcome.code == 0 else math.inf), outcome


def device(law: str, scene: str, lag: float, known: bool, seed: int) -> float:
    """Return the RMS torque error of a device in its own task [N m]."""
    made = load_device(scene)
    spec = made.spec.copy()
    if lag:
        motor = spec.actuator(made.description.axis().motor)
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        motor.dynprm[0] = lag
        motor.actearly = True
    env = gymnasium.make(
        "cc_mujoco/Device-v1",
        disable_env_checker=True,
        device=made,
        model=spec.compile(),
        duration=2.0,
    )
    inner: Any = env.unwrapped
    drive = inner.exo.drive
    if not known:
        drive = dataclasses.replace(drive, motor_lag=0.0)
    plant = Single(env, seed)
    measuring = Measuring(
        made.description.sensing, drive, *inner.exo.device.driven, seed, plant.steps
    )
    trace = Trace(("joint_torque_nm", "desired_torque_nm"), plant.steps)
    run(plant, law_of(law, drive), trace.keep, measure=measuring.measure)
    env.close()
    off = trace.columns["joint_torque_nm"] - trace.columns["desired_torque_nm"]
    return float(np.sqrt(np.mean(off**2)))
