"""Dead zones: travel after each reversal at which the pull of the cables stays.

Where cables are springs the pull changes evenly with their travel; friction and slip
bend it at the ends of a stroke. A level in between at which the travel is largest in
each cycle is lost motion, whatever its cause. Where no torque is known,
`_partial.motion` has the dead zone of the joint's angle.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.fit import mean_tension
from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray


class DeadZone(NamedTuple):
    trial: str  # its name
    travel: FloatArray  # by reversal, until the pull rises on the other side [m]
    lost: float  # median part of it at one level [m]
    pull: float  # median of that level [N]

    @property
    def statement(self) -> str:
        low, middle, high = np.quantile(1e3 * self.travel, (0.025, 0.5, 0.975))
        return (
            f"{self.trial} has a dead zone: after each of {self.travel.size} reversals "
            f"the cables travel {format_number(middle)} mm ({format_number(low)} to "
            f"{format_number(high)} mm in 95 % of them) until the pull rises on the "
            f"other side, {format_number(1e3 * self.lost)} mm of it at about "
            f"{format_number(self.pull)} N."
        )


def dead_zones(
    dataset: Dataset, bench: Bench, records: Sequence[Record]
) -> tuple[DeadZone, ...]:
    """Return the dead zone of each record that has one in all its cycles."""
    known = [dataset.noise.get(name) for name in (MOTOR_ANGLE, JOINT_ANGLE)]
    pairs = zip((bench.motor_radius, bench.joint_radius), known, strict=True)
    noise = math.hypot(*(radius * own.deviation for radius, own in pairs if own))
    found = []
    for record in records:
        usual = record.load_cell is None and record.path is None
        if usual and not record.unhooked:
            zone = _dead_zone(record, *_travel_and_pull(dataset, bench, record))
            if zone and zone.lost > Limit.still_sigmas * noise:
                found.append(zone)
    return tuple(found)


def describe_dead_zones(zones: tuple[DeadZone, ...], trials: int) -> str:
    """Return a sentence on dead zones in some of `trials`; "" if there is none."""
    if not zones:
        return ""
    sizes = [1e3 * float(np.median(zone.travel)) for zone in zones]
    size = " to ".join(dict.fromkeys(map(format_number, (min(sizes), max(sizes)))))
    return (
        f" Measured in {len(zones)} of {trials} trials: a dead zone, in which the "
        f"cables travel {size} mm after each reversal until the pull rises."
    )


def _travel_and_pull(
    dataset: Dataset, bench: Bench, record: Record
) -> tuple[FloatArray, FloatArray]:
    """Return the lead of the motor's end [m] and the pull [N], (samples,) each."""
    travel = bench.motor_radius * record.motor_angle
    if dataset.ends_held:  # what the cable lies on moves both of its ends
        radii = np.array([bench.motor_radius, bench.joint_radius])
        signs = np.array([1.0, -1.0])
        rows = list(dataset.instruments.rows)
        return travel, (signs / radii)[rows] @ record.measured
    travel = travel - bench.motor_radius * bench.following(record.joint_angle)
    return travel, mean_tension(dataset, bench, record)


def _dead_zone(record: Record, travel: FloatArray, pull: FloatArray) -> DeadZone | None:
    """Return the dead zone of a record, None if its cycles do not agree on one.

    A passage is from the last sample with the pull on one side to the first on the
    other. The travel over two steps of the pull is compared with the usual one.
    """
    low, high = np.quantile(pull, (0.05, 0.95))
    share = (pull - low) / max(high - low, 1e-300)
    levels = np.linspace(*Limit.passage, Limit.passage_levels)
    side = np.where(share <= levels[0], -1, np.where(share >= levels[-1], 1, 0))
    outside = np.flatnonzero(side)
    turns = np.flatnonzero(np.diff(side[outside]))
    if turns.size < Limit.min_passages:
        return None
    passages, before = [], 0
    for first, last in zip(outside[turns], outside[turns + 1], strict=True):
        part, rises = slice(first, last + 1), side[last]
        way = np.sign(travel[last] - travel[first])
        moved = way * travel[before : last + 1]
        moved -= moved[: first + 1 - before].min()  # since the reversal
        crossing = moved[first - before :]
        passed = np.maximum.accumulate(share[part][::rises])
        reached = np.interp(levels, passed, crossing[::rises])
        passages.append((rises * np.diff(reached), reached, crossing, pull[part]))
        before = last
    table = np.array([steps for steps, *_ in passages])
    usual = 2.0 * np.abs(np.median(table, axis=1))
    double = table[:, 1:] + table[:, :-1]
    ratio = double / np.maximum(usual, 1e-300)[:, None]
    place = int(np.argmax(np.median(ratio, axis=0)))
    if not 0 < place < ratio.shape[1] - 1:
        return None
    near = slice(place - 1, place + 2)
    if np.quantile(ratio[:, near].max(axis=1), 0.1) < Limit.dead_zone_ratio:
        return None
    lost = double[:, near].max(axis=1) - usual
    until, stays = [], []
    for over, (_, reached, crossing, force) in zip(double, passages, strict=True):
        most = place - 1 + int(np.argmax(over[near]))
        begin, end = np.sort(reached[[most, most + 2]])
        until.append(end)
        stays.append(force[np.argmin(np.abs(crossing - 0.5 * (begin + end)))])
    medians = float(np.median(lost)), float(np.median(stays))
    return DeadZone(record.trial, np.array(until), *medians)
