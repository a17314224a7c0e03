"""The rig as simulated: baseline parameters, effects, and what its sensors would show.

Both angles of a record go in, both torques come out. The baseline holds everything a
careful experimenter tunes before blaming physics: friction (times wrap), stiffness,
pretension, the balance of two cables, offsets, the clocks' offset and, where the rig's
file says they are uncertain, the pulleys.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.trials import Constant
from cc_mujoco.diagnosis.effects import EFFECTS, JOINT_DELAY, Rig, Torques
from cc_mujoco.diagnosis.inference.records import LEAD, RAMP, Record, low_passed
from cc_mujoco.estimation.least_squares import Tuned
from cc_mujoco.transmission import Cable, Transmission

Values = Mapping[str, float]


PRETENSION_KNOWN = 0.1
"""Relative standard deviation of a pretension that nobody measured."""
OFFSETS = ("motor_torque_offset", "joint_torque_offset")
"""What the torque sensors show without any torque [Nm]."""
LATE = ("motor_torque_late", "joint_torque_late")
CLOCKS = ("clock_offset", *LATE)
"""By how much the joint's angle is ahead of the motor's, and torques are late [s].

Known to half a sample, and no more than one; beyond that it is an effect.
"""
OFFSET_KNOWN = 0.01
"""Standard deviation of a torque sensor's offset, over the RMS of its readings.

It is no more than two of them; beyond that it is an effect.
"""
RATIO_KNOWN = 0.003
"""Relative standard deviation of the ratio of two pulleys of nominal size."""
FRICTION_MOST = 3.5
"""Largest coefficient of friction that is fitted; cables take 5, some unbalanced."""
BALANCE_KNOWN = 0.03
"""Standard deviation of the difference of two cables' friction, relative."""


def tuned(
    bench: Bench, records: Sequence[Record], constants: Mapping[str, Constant]
) -> tuple[Tuned, ...]:
    """The baseline's parameters for these data.

    Args:
        bench: with the values of the constants, see `Bench.known`.
        records: that it is to explain.
        constants: of the rig's file, for their uncertainties.
    """
    cable = bench.cables[0]
    step = records[0].step

    def unsure(name: str, value: float, otherwise: float) -> float:
        given = constants.get(name, Constant(value)).uncertainty
        return given / max(value, 1e-9) or otherwise

    known = unsure("pretension", cable.pretension, PRETENSION_KNOWN)
    wide = math.log(100.0)
    whole = np.concatenate([record.measured for record in records], axis=1)
    sizes = np.maximum(OFFSET_KNOWN * np.std(whole, axis=1), 1e-6).tolist()
    centre = _angle_offset(bench, records)
    friction = max(cable.friction, 1e-3)
    most = max(0.0, min(wide, math.log(FRICTION_MOST / friction)))
    found = [
        Tuned(name, unit, value, 1.0, -wide, high, True, unsure(name, value, math.inf))
        for name, unit, value, high in (
            ("friction", "1", friction, most),
            ("axial_stiffness", "N", cable.axial_stiffness, wide),
        )
    ]
    found += [
        Tuned("pretension", "N", cable.pretension, known, -10.0, 10.0, True, 1.0),
        *(
            Tuned(name, "Nm", 0.0, size, -2.0, 2.0, False, 1.0)
            for name, size in zip(OFFSETS, sizes, strict=True)
        ),
        Tuned("joint_angle_offset", "rad", centre, 0.01, -1e3, 1e3, False),
        *(Tuned(name, "s", 0.0, step, -1.0, 1.0, False, 0.5) for name in CLOCKS),
    ]
    if len(bench.cables) == 2:
        found.append(
            Tuned("friction_balance", "1", 0.0, BALANCE_KNOWN, -10.0, 10.0, False, 1.0)
        )
    # A stiff cable shows the least error of the ratio, so one pulley is always unsure.
    for name, given, otherwise in (
        ("motor_radius", bench.motor_radius, 0.0),
        ("joint_radius", bench.joint_radius, RATIO_KNOWN),
    ):
        relative = unsure(name, given, otherwise)
        if relative > 0.0:
            found.append(Tuned(name, "m", given, relative, -10.0, 10.0, True, 1.0))
    return tuple(found)


def _angle_offset(bench: Bench, records: Sequence[Record]) -> float:
    """Joint angle at which the motor at zero pulls neither way, roughly [rad]."""
    ratio = bench.motor_radius / bench.joint_radius
    gaps = [np.median(ratio * r.motor_angle - r.joint_angle) for r in records]
    return float(np.median(gaps))


@dataclass(frozen=True)
class Plant:
    """Simulates records.

    Attributes:
        bench: with the radii and cables that hold unless tuned.
        records: to simulate.
        segments: of each cable.
        substeps: simulation steps per sample.
    """

    bench: Bench
    records: tuple[Record, ...]
    segments: int
    substeps: int = 1

    def simulate(
        self,
        values: Values,
        effects: Sequence[str] = (),
        only: Sequence[int] | None = None,
    ) -> list[FloatArray]:
        """Motor and joint torque (2, samples) of every record, as sensors show them.

        Args:
            values: baseline and effect parameters by name.
            effects: ids of the effects that are present.
            only: indices of the records that are wanted; default all.
        """
        chosen = self.records if only is None else [self.records[k] for k in only]
        cables = {
            pretension: self.cables(values, effects, pretension)
            for pretension in {record.pretension for record in chosen}
        }
        return [
            self._one(record, cables[record.pretension], values, effects)
            for record in chosen
        ]

    def cables(
        self, values: Values, effects: Sequence[str], pretension: float | None = None
    ) -> tuple[Cable, ...]:
        """The cables with these values.

        Args:
            values: baseline and effect parameters by name.
            effects: ids of the effects that are present.
            pretension: of a trial, in place of the scene's [N]; scaled alike.
        """
        start = self.bench.cables[0].pretension
        tension = values.get("pretension", start)
        if pretension is not None and start > 0.0:
            tension *= pretension / start
        balance = values.get("friction_balance", 0.0)
        made = tuple(
            cable.replace(
                friction=max(
                    values.get("friction", cable.friction) * (1.0 + side), 0.0
                ),
                axial_stiffness=values.get("axial_stiffness", cable.axial_stiffness),
                pretension=max(tension, 0.0),
                segments=self.segments,
                static_friction=0.0,
            )
            for cable, side in zip(self.bench.cables, (balance, -balance), strict=False)
        )
        rig = Rig(*self.radii(values))
        for name in effects:
            change = EFFECTS[name].cables
            if change is not None:
                made = change(made, values, rig)
        return made

    def radii(self, values: Values) -> tuple[float, float]:
        """Radii of the motor's and the joint's pulley [m]."""
        return (
            values.get("motor_radius", self.bench.motor_radius),
            values.get("joint_radius", self.bench.joint_radius),
        )

    def _one(
        self,
        record: Record,
        cables: tuple[Cable, ...],
        values: Values,
        effects: Sequence[str],
    ) -> FloatArray:
        proximal, distal = self.radii(values)
        transmission = Transmission(
            cables,
            proximal,
            distal,
            backlash=values.get("backlash", 0.0) if "backlash" in effects else 0.0,
        )
        offset = values.get("joint_angle_offset", 0.0)
        late = values.get("clock_offset", 0.0) + values.get(JOINT_DELAY, 0.0)
        behind = [values.get(name, 0.0) for name in LATE]
        joint = shifted(record.joint_angle, late / record.dt) + offset
        motor = record.motor_angle
        dt = record.dt / self.substeps
        led_motor, led_joint = with_lead_in(
            motor, joint, distal / proximal, self.substeps
        )
        played = transmission.replay(dt, motor_angle=led_motor, joint_angle=led_joint)
        keep = slice(LEAD * self.substeps, None, self.substeps)
        shown = Torques(
            record.dt,
            record.start + record.dt * np.arange(motor.size, dtype=np.float64),
            motor,
            joint - offset,
            played.motor_torque[keep],
            played.joint_torque[keep],
        )
        for sensor in (False, True):
            for name in effects:
                effect = EFFECTS[name]
                if effect.torques is not None and effect.sensor is sensor:
                    shown = effect.torques(shown, values)
        shown_torques = np.array(
            [
                shifted(shown.motor, -behind[0] / record.dt)
                + values.get(OFFSETS[0], 0.0),
                shifted(shown.joint, -(late + behind[1]) / record.dt)
                + values.get(OFFSETS[1], 0.0),
            ]
        )
        return low_passed(shown_torques, record.band, 1.0 / record.dt)

    def finer(self, segments: int = 1, substeps: int = 1) -> Plant:
        """The same with more segments or smaller steps, by these factors."""
        return replace(
            self, segments=self.segments * segments, substeps=self.substeps * substeps
        )

    def limited(self, records: Sequence[Record]) -> Plant:
        """The same plant for other records."""
        return replace(self, records=tuple(records))


def with_lead_in(
    motor: FloatArray, joint: FloatArray, ratio: float, substeps: int
) -> tuple[FloatArray, FloatArray]:
    """Both angles after a lead-in, refined to `substeps` per sample.

    It begins at the pose 0, where the cables are in pretension and to which wrap and
    pulleys refer, takes both ends to where the joint is, then the motor to its place.

    Args:
        motor: (samples,) [rad].
        joint: (samples,) [rad].
        ratio: turns of the motor per turn of the joint.
        substeps: of every sample.
    """
    there = np.linspace(0.0, 1.0, RAMP + 1)[:-1] * joint[0]
    rest = ratio * joint[0]
    settling = np.linspace(rest, motor[0], RAMP + 1)[:-1]
    led_motor = np.concatenate([ratio * there, settling, motor])
    led_joint = np.concatenate([there, np.full(RAMP, joint[0]), joint])
    if substeps == 1:
        return led_motor, led_joint
    size = led_motor.size
    x = np.arange(size * substeps - substeps + 1) / substeps
    old = np.arange(size)
    return np.interp(x, old, led_motor), np.interp(x, old, led_joint)


def shifted(signal: FloatArray, samples: float) -> FloatArray:
    """The signal as it was `samples` samples later (samples,), linear between."""
    if samples == 0.0:
        return signal
    x = np.arange(signal.size)
    found: FloatArray = np.interp(x + samples, x, signal)
    return found
