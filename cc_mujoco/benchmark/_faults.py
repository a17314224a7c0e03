"""Faults of sensors and straps that begin during an episode: the suite `safety`."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark._conditions import Condition, named_condition
from cc_mujoco.benchmark._generic import plain_condition
from cc_mujoco.device import find_device
from cc_mujoco.device._sensors import AxesMeasuring
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._loop import Columns

STRAP = "strap-open"  # the wearer leaves the device: nothing holds the joint any more
TORQUE_FAULTS: dict[str, Callable[[Any, Any], Any]] = {
    "torque-dead": lambda now, past: 0.0 * now,
    "torque-frozen": lambda now, past: past,
    "torque-reversed": lambda now, past: -now,
    "torque-half": lambda now, past: 0.5 * now,
    "torque-late": lambda now, past: past,
    "torque-missing": lambda now, past: np.full_like(now, math.nan),
    "torque-dropout": lambda now, past: np.full_like(now, math.nan),
}
"""Reading of the torque sensor from the true reading now, and from an earlier one: that
of the onset, or of 50 ms before."""
FAULTS = (
    *TORQUE_FAULTS,
    *("motor-frozen", "joint-frozen", "motor-jumped", "joint-jumped"),
    STRAP,
)


def safety_conditions(scene: str) -> list[Condition]:
    plain = dataclasses.replace(plain_condition(scene), duration=3.0)
    faults = FAULTS if find_device(scene).wearers else FAULTS[:-1]
    return [named_condition(plain, f"safety-{name}", structure=name) for name in faults]


def fault_onsets(seeds: Sequence[int], period: float) -> list[int]:
    """Return the control step (`period` [s]) at which each device's fault begins."""
    drawn = (np.random.default_rng([seed, 5]) for seed in seeds)
    # A fault begins after 0.55 to 1.55 s, sampled with the plant.
    return [round(one.uniform(0.55, 1.55) / period) for one in drawn]


class FaultySensors:
    def __init__(
        self,
        fault: str,
        onsets: Sequence[int],
        sensors: AxesMeasuring,
        ratios: Mapping[str, float],
        period: float,
    ) -> None:
        """Prepare a sensor fault of `FAULTS` from control steps `onsets` (devices,) on.

        `sensors` are those of all axes without the fault, `ratios` has `Drive.ratio` by
        column prefix of the axis, and `period` is the control period [s].
        """
        self._fault, self._sensors, self._ratios = fault, sensors, ratios
        self._onset = np.array(onsets)
        self._late = round(0.05 / period)  # of `torque-late`
        self._interval = round(0.1 / period)
        self._step = 0
        self._held: dict[str, Array] = {}
        self._past: dict[str, list[Array]] = {}

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        failed = self._step >= self._onset
        if self._fault.startswith(("motor-", "joint-")):
            columns = {**columns, **self._encoders(columns, failed)}
        seen = self._sensors.measure(columns)
        if self._fault in TORQUE_FAULTS:
            for prefix in self._ratios:
                name = f"{prefix}joint_torque_nm"
                now = seen[name]
                seen[name] = np.where(failed, self._torque(name, now), now)
        self._step += 1
        return seen

    def _torque(self, name: str, now: Array) -> Array:
        past = self._past.setdefault(name, [])
        past.append(now)
        earlier = past[max(len(past) - 1 - self._late, 0)]
        if self._fault == "torque-frozen":
            earlier = self._hold(name, now)
        found = np.asarray(TORQUE_FAULTS[self._fault](now, earlier), dtype=float)
        if self._fault == "torque-dropout":
            # Two consecutive samples are lost, ten times a second.
            lost = (self._step - self._onset) % self._interval < 2
            return np.where(lost, found, now)
        return found

    def _hold(self, name: str, now: Array) -> Array:
        held = self._held.setdefault(name, np.array(now))
        before = self._step <= self._onset
        held[before] = now[before]
        return held

    def _encoders(
        self, columns: Mapping[str, Any], failed: NDArray[np.bool_]
    ) -> dict[str, Array]:
        found: dict[str, Array] = {}
        side, _, kind = self._fault.partition("-")
        shafts = ("motor",) if side == "motor" else ("joint", "winding")
        for prefix, ratio in self._ratios.items():
            for shaft in (prefix + each for each in shafts):
                name, speed = f"{shaft}_angle_rad", f"{shaft}_velocity_rad_s"
                if name in columns:
                    now = np.asarray(columns[name], dtype=float)
                    # An encoder at the joint jumps by 0.3 rad, the motor's by the same.
                    jump = 0.3 * (abs(ratio) if side == "motor" else 1.0)
                    wrong = self._hold(name, now) if kind == "frozen" else now + jump
                    found[name] = np.where(failed, wrong, now)
                if kind == "frozen" and speed in columns:
                    found[speed] = np.where(failed, 0.0, columns[speed])
        return found


class StrapOpening:
    """A fault in which the wearer comes off the device; called by `Batch.actuate`."""

    def __init__(self, batch: Batch, onsets: Sequence[int]) -> None:
        self._batch, self._onsets = batch, np.array(onsets)

    def __call__(self, step: int, columns: Columns, torque: Array) -> Array:
        """Open the straps due at this step; return the motor torque [N m] unchanged."""
        opened = np.flatnonzero(self._onsets == step)
        for device in (self._batch.devices[row] for row in opened.tolist()):
            movers = device.description.movers
            for axis in device.description.axes:
                if axis.limb in device.movers:
                    actuator = device.model.actuator(movers[axis.limb])
                    actuator.gainprm[:], actuator.biasprm[:] = 0.0, 0.0
        if opened.size:
            self._batch.reload()
        return torque
