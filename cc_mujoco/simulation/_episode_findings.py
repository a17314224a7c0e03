"""Sentences for the user on an episode that was unsafe, unstable, guarded or slack."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._controller import SteppedController
from cc_mujoco.control._registry import AxesController
from cc_mujoco.device import Axis, Description
from cc_mujoco.metrics._formulas import MAX_UNSAFE_TIME, is_unstable
from cc_mujoco.metrics._metric import LogLike
from cc_mujoco.simulation._episode_log import EpisodeLog


class Guards:
    def __init__(self, law: Controller, description: Description) -> None:
        laws = law.laws if isinstance(law, AxesController) else (law,)
        each = zip(description.axes, laws, strict=False)
        self._watched = [
            (a, one) for a, one in each if isinstance(one, SteppedController)
        ]
        self._steps = 0
        self._begun: dict[tuple[str, float], list[float]] = {}
        self._count: dict[tuple[str, float], int] = {}
        self._last = [guard.FREE] * len(self._watched)

    def look(self, time: float) -> None:
        self._steps += 1
        for n, (axis, law) in enumerate(self._watched):
            state = float(law.guard_states().max(initial=guard.FREE))
            if state != guard.FREE:
                key = axis.limb, state
                self._count[key] = self._count.get(key, 0) + 1
                if state != self._last[n]:
                    self._begun.setdefault(key, []).append(time)
            self._last[n] = state

    def findings(self) -> Iterator[str]:
        safe = {axis.limb: axis.safe_torque for axis, _ in self._watched}
        for (limb, state), begun in self._begun.items():
            share = 100.0 * self._count[limb, state] / self._steps
            often = "once" if len(begun) == 1 else f"{len(begun)} times"
            when = f"at {begun[0]:.4g} s"
            if state < guard.STOPPED:
                when = f"{often} ({share:.2g} % of the time), first {when}"
            yield f"the guard {_action(state, limb, safe[limb])}: {when}."


def _action(state: float, limb: str, safe: float) -> str:
    """Return words for a guard's state at joint `limb` of safe torque `safe` [N m]."""
    return {
        guard.RELEASED: f"let joint {limb!r} go, as its torque, or that with which the "
        f"cables would stop its motor, came too close to the safe {safe:g} N m",
        guard.BRAKED: f"braked joint {limb!r}, as it was too fast or its sensors were "
        "silent",
        guard.STOPPED: f"stopped the motor of joint {limb!r}, which then follows the "
        "joint, as it was unsafe, or as motor and cables contradict the torque "
        "measured there",
        guard.LIMP: f"left joint {limb!r} without torque, as an angle measured there "
        "is not credible",
    }[state]


def episode_findings(
    log: EpisodeLog, model: mujoco.MjModel, description: Description, controller: str
) -> Iterator[str]:
    time = log["time_s"]
    for axis, (name, own) in zip(description.axes, log.each_axis(), strict=True):
        at = f" at joint {axis.limb!r}"
        yield from _unsafe(own["joint_torque_nm"], time, axis, at)
        if is_unstable(own, axis.safe_torque):
            advice = ""
            if "pi_tuned" not in controller:  # whose gains follow from the device
                whose = f"{name}=pi_tuned" if name else "pi_tuned"
                advice = f"; try --controller {whose}"
            yield f"{controller} is unstable on this device: it swings{at}{advice}."
        yield from _off_motion(own, axis, at)
        yield from _at_stop(own["joint_angle_rad"], model, axis)
    yield from _falls(log, model)


def _unsafe(
    torque: NDArray[np.float64], time: NDArray[np.float64], axis: Axis, at: str
) -> Iterator[str]:
    beyond = np.abs(torque) > axis.safe_torque
    if not beyond.any():
        return
    times = int(np.count_nonzero(np.diff(beyond.astype(int), prepend=0) == 1))
    share, peak = 100.0 * float(beyond.mean()), float(np.abs(torque).max())
    often = "once" if times == 1 else f"{times} times"
    yield (
        f"the torque{at} was above the safe {axis.safe_torque:g} N m {often} "
        f"({share:.2g} % of the time), up to {peak:.4g} N m, first at "
        f"{time[np.argmax(beyond)]:.4g} s; more than {1e3 * MAX_UNSAFE_TIME:g} ms in a "
        "row is a failure."
    )


def _off_motion(own: LogLike, axis: Axis, at: str) -> Iterator[str]:
    gap = np.abs(own["joint_angle_rad"] - own["reference_angle_rad"])
    if not np.isfinite(gap).all():
        return
    # A joint that deviates from its motion by half of the reach does not follow it.
    share = float(np.mean(gap > 0.5 * axis.reach))
    if share > 0.02:
        yield (
            f"the wearer is off the motion{at} {100.0 * share:.2g} % of the time, by "
            f"up to {gap.max():.3g} rad; the device pulls harder than the wearer holds."
        )


def _at_stop(
    angle: NDArray[np.float64], model: mujoco.MjModel, axis: Axis
) -> Iterator[str]:
    joint = model.joint(axis.limb)
    if not model.jnt_limited[joint.id]:
        return
    low, high = model.jnt_range[joint.id]
    # A hundredth of a joint's range at either end counts as its stop.
    room = 0.01 * (high - low)
    share = float(np.mean((angle < low + room) | (angle > high - room)))
    if share > 0.02:
        yield (
            f"joint {axis.limb!r} is at a stop {100.0 * share:.2g} % of the time; its "
            f"range is {low:.3g} to {high:.3g} rad."
        )


def _falls(log: EpisodeLog, model: mujoco.MjModel) -> Iterator[str]:
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE.value)
    poses: Any = log["qpos"] if free.size else None
    for joint in free.tolist():
        height = np.asarray(poses)[:, int(model.jnt_qposadr[joint]) + 2]
        lost = height[0] - height
        fallen = lost > 0.3 * abs(float(height[0]))
        if height[0] > 0.0 and fallen.any():
            body = model.body(int(model.jnt_bodyid[joint])).name
            yield (
                f"the free body {body!r} fell: from {height[0]:.3g} m at the start to "
                f"{height.min():.3g} m, beyond 30 % at "
                f"{log['time_s'][np.argmax(fallen)]:.4g} s."
            )
