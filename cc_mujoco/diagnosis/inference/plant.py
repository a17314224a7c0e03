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
from cc_mujoco.diagnosis.effects import (
    EFFECTS,
    JOINT_DELAY,
    EffectParameter,
    Rig,
    Torques,
)
from cc_mujoco.diagnosis.inference.records import Record, low_passed
from cc_mujoco.diagnosis.inference.replays import Setting, played, shifted
from cc_mujoco.estimation.least_squares import Tuned, in_threads
from cc_mujoco.transmission import Cable

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
        settings = {
            pretension: self.setting(values, effects, pretension)
            for pretension in {record.pretension for record in chosen}
        }
        return in_threads(
            lambda record: self._shown(
                record, settings[record.pretension], values, effects
            ),
            chosen,
        )

    def setting(
        self, values: Values, effects: Sequence[str], pretension: float | None = None
    ) -> Setting:
        """What the cables feel of these values, see `cables`."""
        return Setting(
            self.cables(values, effects, pretension),
            *self.radii(values),
            values.get("backlash", 0.0) if "backlash" in effects else 0.0,
            values.get("clock_offset", 0.0) + values.get(JOINT_DELAY, 0.0),
            values.get("joint_angle_offset", 0.0),
            self.substeps,
        )

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
        rig = Rig(*self.radii(values), self.bench.exit_angle)
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

    def _shown(
        self, record: Record, setting: Setting, values: Values, effects: Sequence[str]
    ) -> FloatArray:
        """Both torques (2, samples) of a record as its sensors show them."""
        joint_angle, motor, joint = played(record, setting)
        time = record.start + record.dt * np.arange(motor.size, dtype=np.float64)
        shown = Torques(record.dt, time, record.motor_angle, joint_angle, motor, joint)
        for sensor in (False, True):
            for name in effects:
                effect = EFFECTS[name]
                if effect.torques is not None and effect.sensor is sensor:
                    shown = effect.torques(shown, values)
        behind = [values.get(name, 0.0) for name in LATE]
        shown_torques = np.array(
            [
                shifted(shown.motor, -behind[0] / record.dt)
                + values.get(OFFSETS[0], 0.0),
                shifted(shown.joint, -(setting.late + behind[1]) / record.dt)
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


def plausible(parameter: EffectParameter, plant: Plant) -> tuple[float, float]:
    """Least and largest value that a parameter of an effect can stand for."""
    low, high = parameter.plausible
    if not parameter.of:
        return low, high
    records = plant.records
    if parameter.of == "motor_radius":
        whole = plant.bench.motor_radius
    elif parameter.of == "motion":
        whole = max(float(np.ptp(record.joint_angle)) for record in records)
    else:
        row = ("motor_torque", "joint_torque").index(parameter.of)
        whole = max(float(np.max(np.abs(r.measured[row]))) for r in records)
    return low * whole, high * whole
