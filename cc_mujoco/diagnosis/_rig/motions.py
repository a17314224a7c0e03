"""Trials that most rigs can run, from which experiments are chosen."""

from __future__ import annotations

import csv
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._instruments import TORQUE_SENSORS, Instruments
from cc_mujoco.datasets._load_cells import SingleCell
from cc_mujoco.diagnosis._rig.records import wind_up_angle
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

MOTION_STEP = 0.008
"""Time between the samples of a motion [s]."""
QUARTER_TURN = 0.5 * np.pi
"""Angle that a rig is turned by, so that its weights pull otherwise [rad]."""


@dataclass(frozen=True)
class CataloguedTrial:
    """A trial that most rigs can run.

    Attributes:
        description: instruction.
        motor: angle of the motor (samples,) [rad].
        joint: angle of the joint (samples,) [rad].
        pretension: relative to that of the data; 0 with the cables taken off.
        tilt: angle by which the rig is turned about the joint's axis [rad].
        known_torques: of known weights in place of the cables, at motor and joint; see
            `Facts` [N m].
        swapped: whether the torque sensors change places.
        load_cell: channel of a load cell in one cable, or ""; see `Facts`.
        hard: whether it is proposed only where no other trial settles the tie.
        usual: whether a plan considers it; others are proposed for a tie.
        standard: whether a plan always has it: no other trial separates the effects of
            weights, springs and sensors.
    """

    description: str
    motor: FloatArray
    joint: FloatArray
    pretension: float = 1.0
    tilt: float = 0.0
    known_torques: tuple[float, float] = (0.0, 0.0)
    swapped: bool = False
    load_cell: str = ""
    hard: bool = False
    usual: bool = True
    standard: bool = False

    def cell_on(self, bench: Bench, pretension: float | None) -> SingleCell | None:
        """Return its load cell on a rig of this pretension [N], None without one."""
        if not self.load_cell:
            return None
        return SingleCell.of(self.load_cell, bench, pretension)

    @property
    def toml(self) -> tuple[str, ...]:
        """Lines of its table in `dataset.toml`, but for pretension and notes."""
        lines = ["unhooked = true"] if self.pretension == 0.0 else []
        if self.description.startswith("joint locked"):
            lines.append('locked = "joint"')
        if self.tilt:
            lines.append(f"tilt = {self.tilt:.4g}")
        for side, torque in zip(("motor", "joint"), self.known_torques, strict=True):
            if torque:
                lines.append(f"known_{side}_torque = {torque:g}")
        if self.swapped:
            lines.append("swapped = true")
        if self.load_cell:
            lines.append(f'load_cell = "{self.load_cell}"')
        return tuple(lines)


def motions(
    bench: Bench,
    swing: float,
    rate: float,
    load: float | None = None,
    instruments: Instruments = TORQUE_SENSORS,
    cells: Collection[str] = (),
) -> list[CataloguedTrial]:
    """Return trials within these limits, and two of a larger swing.

    They go to and fro about `middle_angle` by at most `swing` to either side [rad], at
    most at `rate` [rad/s]. The joint turns a known `load` in every trial [N m/rad].
    Some trials take torque sensors; each of the `cells`, channels of load cells in
    single cables, has its own.
    """
    from scipy.ndimage import gaussian_filter1d

    ratio = bench.motor_radius / bench.joint_radius
    wind = wind_up_angle(bench)
    motor_middle = middle_angle(bench, swing)
    (joint_middle,) = bench.carried(np.array([motor_middle]))

    def free(motor: FloatArray) -> FloatArray:
        """Return the change of the joint's angle as the motor carries it along."""
        found: FloatArray = bench.carried(motor_middle + motor) - joint_middle
        return found

    time = np.arange(0.0, Limit.motion_duration, MOTION_STEP)

    def triangle(size: float, speed: float | FloatArray) -> FloatArray:
        phase = (
            np.cumsum(np.broadcast_to(speed, time.shape)) * MOTION_STEP / (4.0 * size)
        )
        wave = size * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5))
        # No motor turns in an instant.
        found: FloatArray = gaussian_filter1d(
            wave, Limit.turn_rounding_time / MOTION_STEP, mode="nearest"
        )
        return found

    steps = np.repeat((0.02, 0.06, 0.2, 0.5, 1.0), -(-time.size // 5))[: time.size]
    ladder = triangle(swing, rate * steps)
    loudness = min(0.3 * swing, rate / (2.0 * np.pi * 3.3))
    chirp = loudness * np.sin(2.0 * np.pi * (0.1 * time + 0.04 * time**2))
    cable = bench.cables[0]
    # This nearly loosens one cable and tightens the other as much.
    stretch = (
        Limit.max_tension_change
        * cable.pretension
        / cable.axial_stiffness
        * cable.length
    )
    taut_angle = stretch / bench.motor_radius
    give = 1.0 - stretch / (ratio * swing * bench.joint_radius)
    sweep = triangle(swing, rate * 0.2)
    dwell = swing * np.interp(
        time, [0, 1, 2, 3, 6, 7, 15, 16, 38, 39, 40], [0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    )
    locked = min(4.0 * wind, taut_angle)
    small = triangle(min(2.0 * wind, 0.5 * taut_angle), rate * 0.1)
    still = np.zeros(time.size)

    def taut(motor: FloatArray) -> FloatArray:
        """Return the motor angle, shifted to one side if there is only one cable."""
        if len(bench.cables) == 2:
            return motor
        found: FloatArray = 0.5 * (motor - motor.min())
        return found

    if load is not None:
        stiffness = len(bench.cables) * cable.axial_stiffness / cable.length
        kept = 1.0 / (1.0 + load / (stiffness * bench.joint_radius**2))
        found = [
            CataloguedTrial(
                f"joint turning its load, {how}", each, free(kept * each), share
            )
            for how, each, share in (
                ("triangles at five speeds", ladder, 1.0),
                ("chirp from 0.1 to 3 Hz", chirp, 1.0),
                ("moves with rests of 1, 3, 8 and 22 s", dwell, 1.0),
                ("small reversals within the wind-up of the cable", small, 1.0),
                ("slow triangle over the whole range, pretension halved", sweep, 0.5),
            )
        ]
        return [_centre_motion(each, motor_middle, joint_middle) for each in found]
    found = [
        CataloguedTrial(
            "joint free, triangles at five speeds from 2 % to 100 % of the fastest",
            ladder,
            free(ladder),
        ),
        CataloguedTrial("joint free, chirp from 0.1 to 3 Hz", chirp, free(chirp)),
        CataloguedTrial(
            "joint free, moves with rests of 1, 3, 8 and 22 s", dwell, free(dwell)
        ),
        CataloguedTrial(
            "joint locked, slow triangles of the motor a few times its wind-up",
            taut(triangle(locked, wind)),
            still,
        ),
        CataloguedTrial(
            "joint locked, small reversals of the motor within its wind-up",
            taut(small),
            still,
        ),
        CataloguedTrial(
            "motor locked, joint moved slowly to and fro by hand",
            still,
            triangle(locked * ratio, wind),
        ),
        CataloguedTrial(
            "joint free, slow triangle over the whole range, pretension halved",
            sweep,
            free(sweep),
            0.5,
        ),
        *(
            CataloguedTrial(
                f"joint free, slow triangle over {words} the range, if the rig allows",
                triangle(times * swing, rate * 0.2),
                free(triangle(times * swing, rate * 0.2)),
                usual=False,
                hard=times > 2.0,
            )
            for words, times in (("twice", 2.0), ("four times", 4.0))
        ),
        CataloguedTrial(
            "joint free, slow triangle over the whole range, the rig turned by 90 "
            f"degrees about the joint's axis (`tilt = {QUARTER_TURN:.3f}`), if it "
            "allows",
            sweep,
            free(sweep),
            tilt=QUARTER_TURN,
            standard=True,
        ),
        CataloguedTrial(
            "cables off, motor and joint each turned slowly over the whole range",
            sweep,
            free(sweep),
            0.0,
            standard=True,
        ),
        CataloguedTrial(
            "cables off, motor and joint each turned slowly over the whole range, the "
            "rig turned by 90 degrees about the joint's axis",
            sweep,
            free(sweep),
            0.0,
            tilt=QUARTER_TURN,
            usual=False,
        ),
        CataloguedTrial(
            "joint locked, slow triangles, pretension halved",
            taut(triangle(min(2.0 * wind, 0.5 * taut_angle), wind)),
            still,
            0.5,
        ),
        CataloguedTrial(
            "joint against a spring, triangles at five speeds",
            ladder,
            free(give * ladder),
        ),
        CataloguedTrial(
            "joint against a spring, chirp from 0.1 to 3 Hz",
            chirp,
            free(give * chirp),
        ),
    ]
    force = Limit.weight_share * cable.pretension
    weights = tuple(
        float(f"{force * radius:.2g}") if instrument in able else 0.0
        for radius, instrument, able in (
            (
                bench.motor_radius,
                instruments.motor,
                ("torque sensor", "motor current"),
            ),
            (bench.joint_radius, instruments.joint, ("torque sensor",)),
        )
    )
    if any(weights):
        sides = [
            f"{size:g} N m at the {side}"
            for side, size in zip(("motor", "joint"), weights, strict=True)
            if size
        ]
        found.append(
            CataloguedTrial(
                "cables off, a known weight hung in place of the cable "
                f"({list_words(sides)}), motor and joint each turned slowly over the "
                "whole range",
                sweep,
                free(sweep),
                0.0,
                known_torques=(weights[0], weights[1]),
                standard=True,
            )
        )
    if instruments == TORQUE_SENSORS:
        found.append(
            CataloguedTrial(
                "the two torque sensors exchanged (`swapped = true`), joint against a "
                "spring, triangles at five speeds",
                ladder,
                free(give * ladder),
                swapped=True,
                usual=False,
            )
        )
    found += [
        CataloguedTrial(
            f"a load cell in cable {bench.names[0]} at its {end} end "
            f"(`{_cell_channel(bench, end)}`), joint against a spring, triangles at "
            "five speeds",
            ladder,
            free(give * ladder),
            load_cell=_cell_channel(bench, end),
            hard=True,
            usual=_cell_channel(bench, end) in cells,
            standard=_cell_channel(bench, end) in cells,
        )
        for instrument, end in zip(instruments, ("proximal", "distal"), strict=True)
        if instrument in ("torque sensor", "motor current")
    ]
    if instruments.joint != "torque sensor":  # which alone sees weights and springs
        found = [
            replace(each, standard=each.load_cell in cells)
            for each in found
            if each.pretension
        ]
    if len(bench.cables) == 1:  # which a free joint leaves slack
        found = [_with_weight(each, bench) for each in found]
    return [_centre_motion(each, motor_middle, joint_middle) for each in found]


def _with_weight(motion: CataloguedTrial, bench: Bench) -> CataloguedTrial:
    """Return a trial with a weight that keeps a lone cable taut where it is free."""
    torque = motion.pretension * bench.cables[0].pretension * bench.joint_radius
    pulled = f"joint pulled against the cable by a weight of {torque:.2g} N m"
    return replace(motion, description=motion.description.replace("joint free", pulled))


def _cell_channel(bench: Bench, end: str) -> str:
    """Return the channel of a load cell in the agonist."""
    return f"tension_{bench.names[0]}_{end}_n"


def middle_angle(bench: Bench, swing: float) -> float:
    """Return the motor angle about which it can go to and fro by a swing [rad].

    There the joint is in the middle of its named trajectories, or as near to it as the
    scene knows the joint.
    """
    low, high = np.sort(bench.following(np.array(bench.span)))
    if high - low < 2.0 * swing:
        return 0.5 * float(low + high)
    middle = float(bench.following(np.array([bench.centre]))[0])
    return min(max(middle, float(low) + swing), float(high) - swing)


def _centre_motion(
    motion: CataloguedTrial, motor: float, joint: float
) -> CataloguedTrial:
    return replace(motion, motor=motor + motion.motor, joint=joint + motion.joint)


def trial_table(
    name: str, motion: CataloguedTrial, tension: float, occasion: str = ""
) -> list[str]:
    """Return the lines of a trial in `dataset.toml`.

    `tension` is the pretension of the trial [N], 0 with the cables off.
    """
    known = [f"pretension = {tension:g}"] if tension else []
    if occasion:
        known.append(f'occasion = "{occasion}"')
    notes = f'notes = "{motion.description}"'
    return [f'[trials."{name}"]', *known, *motion.toml, notes]


def write_motion(path: Path, motion: CataloguedTrial) -> None:
    """Write the angles of a trial as CSV, to be played."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "motor_angle_rad", "joint_angle_rad"))
        rows.writerows(
            (f"{MOTION_STEP * k:.3f}", f"{motor:.6f}", f"{joint:.6f}")
            for k, (motor, joint) in enumerate(
                zip(motion.motor, motion.joint, strict=False)
            )
        )
