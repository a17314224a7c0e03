"""Faults and events that begin during an episode: suites `safety` and `v3`."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark._conditions import Condition, named_condition
from cc_mujoco.benchmark._generic import plain_condition
from cc_mujoco.device import DeviceModel, find_device
from cc_mujoco.device._sensors import AxesMeasuring
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin import write_cable
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
    "torque-lost": lambda now, past: 0.0 * now,
    "torque-held": lambda now, past: past,
    "torque-gain": lambda now, past: 0.8 * now,
    "torque-tared": lambda now, past: now - past,
}
"""Reading of the torque sensor from the true reading now, and from an earlier one: that
of the onset, or of 50 ms before."""
BRIEF = {"torque-lost": 0.3, "torque-held": 0.3}  # faults that end, after a time [s]
FAULTS = (
    *tuple(TORQUE_FAULTS)[:7],
    *("motor-frozen", "joint-frozen", "motor-jumped", "joint-jumped"),
    STRAP,
)
EVENTS = (*tuple(TORQUE_FAULTS)[7:], "clamp-slips", "cable-off")
"""Events of suite `v3`.

A loose plug makes the torque sensor 0, or holds its reading, for 0.3 s; its supply
falls by a fifth; it is zeroed under load. The clamps of a conduit, of the first cable
of each axis, hold no more than a fifth of the pretension for 0.3 s; or that cable comes
off for good, where another remains."""


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
        self._end = self._onset + round(BRIEF.get(fault, 1e6) / period)
        self._late = round(0.05 / period)  # of `torque-late`
        self._interval = round(0.1 / period)
        self._step = 0
        self._held: dict[str, Array] = {}
        self._past: dict[str, list[Array]] = {}

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        failed = (self._step >= self._onset) & (self._step < self._end)
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
        if self._fault in ("torque-frozen", "torque-held", "torque-tared"):
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


class PlantEvent:
    """A change of the plant during an episode; called by `Batch.actuate`."""

    def __init__(
        self, name: str, batch: Batch, onsets: Sequence[int], period: float
    ) -> None:
        """Prepare an event from control steps `onsets` (devices,) on.

        `period` is the control period [s].
        """
        change, end = PLANT_EVENTS[name]
        held = round(SLIP_TIME / period)
        self._changes = [(0, change)] + ([(held, end)] if end else [])
        self._batch, self._onsets = batch, np.array(onsets)

    def __call__(self, step: int, columns: Columns, torque: Array) -> Array:
        """Change the devices due at this step; return the motor torque unchanged."""
        for later, change in self._changes:
            due = np.flatnonzero(self._onsets + later == step).tolist()
            for device in (self._batch.devices[row] for row in due):
                change(device)
            if due:
                self._batch.reload()
        return torque


def _open_strap(device: DeviceModel) -> None:
    movers = device.description.movers
    for axis in device.description.axes:
        if axis.limb in device.movers:
            actuator = device.model.actuator(movers[axis.limb])
            actuator.gainprm[:], actuator.biasprm[:] = 0.0, 0.0


def _clamp(device: DeviceModel, time: float, share: float) -> None:
    """Let the first cable of each axis lose what exceeds a share of its pretension.

    The conduit slides in its clamps, with a time constant [s].
    """
    for name in (names[0] for names in device.driven):
        cable = device.cables[name]
        speed = min(cable.length / (cable.axial_stiffness * time), 1.0)
        ends = dict.fromkeys(("clamp_creep_proximal", "clamp_creep_distal"), speed)
        loose = cable.replace(**ends, clamp_force=share * cable.pretension)
        write_cable(device.model, name, loose)


def _disconnect(device: DeviceModel) -> None:
    """Let the first cable of each axis keep the tension that it has for good."""
    for name in (names[0] for names in device.driven):
        cable = device.cables[name]
        write_cable(device.model, name, cable.replace(axial_stiffness=1e-6))


Change = Callable[[DeviceModel], None]
SLIP_TIME = 0.3  # time after which a clamp holds again [s]
PLANT_EVENTS: dict[str, tuple[Change, Change | None]] = {
    STRAP: (_open_strap, None),
    "clamp-slips": (
        lambda device: _clamp(device, 0.02, 0.2),
        lambda device: _clamp(device, 0.02, 1e4),
    ),
    "cable-off": (lambda device: _clamp(device, 5e-4, 0.0), _disconnect),
}
"""Changes of a plant by the name of their condition: at the onset, and at the end."""
