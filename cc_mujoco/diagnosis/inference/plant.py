"""The rig as simulated: baseline parameters, effects, and what its sensors would show.

Both angles of a record go in, both torques come out. The baseline holds everything a
careful experimenter tunes before blaming physics: friction (times wrap), stiffness,
pretension, the balance of two cables, offsets, the clocks' offset and, where the rig's
file says they are uncertain, the pulleys.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.instruments import TORQUE_SENSORS, Instruments
from cc_mujoco.diagnosis.data.trials import Constant
from cc_mujoco.diagnosis.effects import (
    EFFECTS,
    JOINT_DELAY,
    EffectParameter,
    RigGeometry,
    Torques,
    acceleration,
)
from cc_mujoco.diagnosis.inference.library import Library, library
from cc_mujoco.diagnosis.inference.load import load_torque, load_tuned, values_of
from cc_mujoco.diagnosis.inference.passing import low_passed
from cc_mujoco.diagnosis.inference.records import Record
from cc_mujoco.diagnosis.inference.replays import Setting, played, shifted
from cc_mujoco.estimation.least_squares import Tuned, in_threads
from cc_mujoco.transmission import PARAMETERS, Cable, Parameter

Values = Mapping[str, float]

PRETENSION_KNOWN = 0.1
"""Relative standard deviation of a pretension that nobody measured."""
PRETENSION_GUESSED = 1.0
"""The same of one that is guessed by the data."""
STIFFEST = 0.9 * max(p.high for p in PARAMETERS if p.name == "axial_stiffness")
"""Largest axial stiffness that is fitted, short of what a cable takes [N]."""
TAUTEST = 0.9 * max(p.high for p in PARAMETERS if p.name == "pretension")
"""Largest pretension that is fitted, short of what a cable takes [N]."""
_TURNS = 0.01
"""Share of its usual top speed at which a motor's own friction has its direction."""
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
FRICTION_LEAST = 1e-3
"""Least coefficient of friction that a fit starts from."""
FRICTION_MOST = 3.5
"""Largest coefficient of friction that is fitted; cables take 5, some unbalanced."""
BALANCE_KNOWN = 0.03
"""Standard deviation of the difference of two cables' friction, relative."""

BASELINE: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        *(
            replace(p, scale="log")
            for p in PARAMETERS
            if p.name in ("friction", "axial_stiffness", "pretension")
        ),
        Parameter(OFFSETS[0], "N m", "reading of the motor torque sensor at no torque"),
        Parameter(OFFSETS[1], "N m", "reading of the joint torque sensor at no torque"),
        Parameter("joint_angle_offset", "rad", "joint angle where the motor is at 0"),
        Parameter(CLOCKS[0], "s", "lead of the joint's angle over the motor's"),
        Parameter(LATE[0], "s", "delay of the motor torque sensor"),
        Parameter(LATE[1], "s", "delay of the joint torque sensor"),
        Parameter("friction_balance", "1", "difference of two cables' friction"),
        Parameter("motor_radius", "m", "radius of the motor pulley", scale="log"),
        Parameter("joint_radius", "m", "radius of the joint pulley", scale="log"),
        Parameter("motor_friction", "N m", "dry friction of the motor"),
        Parameter("motor_damping", "N m s/rad", "viscous friction of the motor"),
        Parameter("torque_constant", "N m/A", "torque per current", scale="log"),
    )
}
"""Parameters of the baseline by name; their bounds depend on the data, see `tuned`."""


def tuned(
    bench: Bench,
    records: Sequence[Record],
    constants: Mapping[str, Constant],
    instruments: Instruments = TORQUE_SENSORS,
    guessed: Collection[str] = (),
) -> tuple[Tuned, ...]:
    """The baseline's parameters for these data.

    Args:
        bench: with the values of the constants, see `Bench.known`.
        records: that it is to explain.
        constants: of the rig's file, for their uncertainties.
        instruments: what the torques are known from.
        guessed: names of what the scene does not know.
    """
    cable = bench.cables[0]
    step = records[0].step

    def unsure(name: str, value: float, otherwise: float) -> float:
        given = constants.get(name, Constant(value)).uncertainty
        return given / value if given > 0.0 and value > 0.0 else otherwise

    known = unsure(
        "pretension",
        cable.pretension,
        PRETENSION_GUESSED if "pretension" in guessed else PRETENSION_KNOWN,
    )
    wide = math.log(100.0)
    stiffest = min(wide, math.log(STIFFEST / cable.axial_stiffness))
    whole = np.concatenate([record.measured for record in records], axis=1)
    rms = dict(zip(instruments.rows, np.std(whole, axis=1).tolist(), strict=True))
    # A load by its motion has no sensor that could be off or late.
    sensors = [k for k in instruments.rows if instruments[k] != "known load"]
    centre = _angle_offset(bench, records)
    friction = max(cable.friction, FRICTION_LEAST)
    most = max(0.0, math.log(FRICTION_MOST / friction))
    least = min(-wide, math.log(FRICTION_LEAST / friction))
    found = [
        Tuned(BASELINE[name], value, 1.0, low, high, unsure(name, value, math.inf))
        for name, value, low, high in (
            ("friction", friction, least, most),
            ("axial_stiffness", cable.axial_stiffness, -wide, stiffest),
        )
    ]
    tautest = math.log(TAUTEST / max(cable.pretension, 1e-9)) / known
    found += [
        Tuned(
            BASELINE["pretension"],
            cable.pretension,
            known,
            -10.0,
            min(10.0, tautest),
            1.0,
        ),
        *(
            Tuned(BASELINE[OFFSETS[k]], 0.0, size, -2.0, 2.0, 1.0)
            for k in sensors
            for size in [max(OFFSET_KNOWN * rms[k], 1e-6)]
        ),
        Tuned(BASELINE["joint_angle_offset"], centre, 0.01, -1e3, 1e3),
        *(
            Tuned(BASELINE[name], 0.0, step, -1.0, 1.0, 0.5)
            for name in ("clock_offset", *(LATE[k] for k in sensors))
        ),
    ]
    if len(bench.cables) == 2:
        found.append(
            Tuned(BASELINE["friction_balance"], 0.0, BALANCE_KNOWN, -10.0, 10.0, 1.0)
        )
    # A stiff cable shows the least error of the ratio, so one pulley is always unsure.
    # Where the path is the arm at the joint it is the motor's.
    for name, given, otherwise in (
        ("motor_radius", bench.motor_radius, RATIO_KNOWN if bench.tied else 0.0),
        ("joint_radius", bench.joint_radius, 0.0 if bench.tied else RATIO_KNOWN),
    ):
        relative = unsure(name, given, otherwise)
        if relative > 0.0:
            found.append(Tuned(BASELINE[name], given, relative, -10.0, 10.0, 1.0))
    if instruments.motor == "motor current":
        found += _motor_tuned(records, constants, rms[0])
    if instruments.joint == "known load":
        found += load_tuned(constants)
    return tuple(found)


def _motor_tuned(
    records: Sequence[Record], constants: Mapping[str, Constant], rms: float
) -> list[Tuned]:
    """Return what a current shows of the motor itself: nobody knows its friction."""
    speed = _top_speed(records)
    found = [
        Tuned(BASELINE["motor_friction"], 0.0, 0.1 * rms, 0.0, 100.0),
        Tuned(BASELINE["motor_damping"], 0.0, 0.1 * rms / speed, 0.0, 100.0),
    ]
    known = constants["torque_constant"]
    if known.uncertainty > 0.0:
        size = known.uncertainty / known.value
        found.append(
            Tuned(BASELINE["torque_constant"], known.value, size, -10.0, 10.0, 1.0)
        )
    return found


def _top_speed(records: Sequence[Record]) -> float:
    """Usual top speed of the motor [rad/s]."""
    speeds = [np.abs(np.gradient(r.motor_angle, r.dt))[r.counts] for r in records]
    return max(float(np.quantile(np.concatenate(speeds), 0.95)), 1e-6)


def _angle_offset(bench: Bench, records: Sequence[Record]) -> float:
    """Joint angle at which the motor at zero pulls neither way, roughly [rad]."""
    ratio = bench.motor_radius / bench.joint_radius
    gaps = [
        np.median(ratio * r.motor_angle - bench.turned(r.joint_angle)) for r in records
    ]
    return float(np.median(gaps))


@dataclass(frozen=True)
class SimulatedRig:
    """Simulates records.

    Attributes:
        bench: with the radii and cables that hold unless tuned.
        records: to simulate.
        segments: of each cable.
        substeps: simulation steps per sample.
        instruments: what the torques of the records are known from.
        constants: of the rig's file; of motor and load.
        given: values of the scene that the data contradict, by name; the bench has
            estimates in their place.
    """

    bench: Bench
    records: tuple[Record, ...]
    segments: int
    substeps: int = 1
    instruments: Instruments = TORQUE_SENSORS
    constants: Mapping[str, Constant] = field(default_factory=dict)
    given: Values = field(default_factory=dict)

    @cached_property
    def library(self) -> Library:
        """The effects that can be seen."""
        bench = self.bench
        return library(len(bench.cables), self.instruments, bench.led, bench.tied)

    def simulate(
        self,
        values: Values,
        effects: Sequence[str] = (),
        only: Sequence[int] | None = None,
    ) -> list[FloatArray]:
        """Torques (rows, samples) of every record, as instruments show them.

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
        """Return what the cables feel of these values, see `cables`."""
        radii = self.radii(values)
        return Setting(
            self.cables(values, effects, pretension),
            *radii,
            backlash=values.get("backlash", 0.0) if "backlash" in effects else 0.0,
            late=values.get("clock_offset", 0.0) + values.get(JOINT_DELAY, 0.0),
            offset=values.get("joint_angle_offset", 0.0),
            substeps=self.substeps,
            lever=self.bench.lever,
            courses=self.bench.courses(self.segments),
            share=radii[1] / self.bench.drawn_radius if self.bench.led else 1.0,
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
                segments=max(self.segments, self.bench.least_segments),
                static_friction=0.0,
            )
            for cable, side in zip(self.bench.cables, (balance, -balance), strict=False)
        )
        rig = RigGeometry(*self.radii(values), self.bench.exit_angle)
        values = {**_off(), **values}
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
        """Torques (rows, samples) of a record as its instruments show them."""
        shown = self._torques(record, setting, values)
        values = {**_off(), **values}
        for sensor in (False, True):
            for name in effects:
                effect = EFFECTS[name]
                if effect.torques is not None and effect.sensor is sensor:
                    shown = effect.torques(shown, values)
        behind = [values.get(name, 0.0) for name in LATE]
        both = np.array(
            [
                shifted(shown.motor, -behind[0] / record.dt)
                + values.get(OFFSETS[0], 0.0),
                shifted(shown.joint, -(setting.late + behind[1]) / record.dt)
                + values.get(OFFSETS[1], 0.0),
            ]
        )
        rows = both[list(self.instruments.rows)]
        return low_passed(rows, record.band, 1.0 / record.dt)

    def _torques(self, record: Record, setting: Setting, values: Values) -> Torques:
        """Both torques before any effect outside the cables.

        Readings were made torques by the values that are declared, so what was tuned
        since counts against these.
        """
        joint_angle, motor, joint, proximal, distal = played(record, setting)
        known = self.instruments
        if known.motor == "load cells":
            motor = self.bench.motor_radius * proximal
        rotor = self.constants.get("rotor_inertia")
        if rotor is not None and known.motor in ("torque sensor", "motor current"):
            motor = motor + rotor.value * acceleration(record.motor_angle, record.dt)
        if known.motor == "motor current":
            speed = np.gradient(record.motor_angle, record.dt)
            turns = _TURNS * max(float(np.quantile(np.abs(speed), 0.95)), 1e-9)
            motor = (
                motor
                + values.get("motor_friction", 0.0) * np.tanh(speed / turns)
                + values.get("motor_damping", 0.0) * speed
            )
            given = self.constants["torque_constant"].value
            motor = motor * (given / values.get("torque_constant", given))
        if known.joint == "load cells":
            joint = self.bench.joint_radius * distal
        if known.joint == "known load":
            given_load = values_of(self.constants)
            here = {k: values.get(k, v) for k, v in given_load.items()}
            here["load_rest_angle"] = values.get(
                "load_rest_angle", given_load.get("load_rest_angle", 0.0)
            )
            joint = joint - (
                load_torque(joint_angle, record.dt, here, record.tilt)
                - load_torque(joint_angle, record.dt, given_load, record.tilt)
            )
        time = record.start + record.dt * np.arange(motor.size, dtype=np.float64)
        # A lever has its arm by the joint's own angle, and so have weights and springs.
        # With pulleys, the offset is the motor's zero as much as the joint's.
        there = joint_angle + (setting.offset if setting.lever is not None else 0.0)
        return Torques(
            record.dt, time, record.motor_angle, there, motor, joint, record.tilt
        )

    def finer(self, segments: int = 1, substeps: int = 1) -> SimulatedRig:
        """Return the same with more segments or smaller steps, by these factors."""
        return replace(
            self, segments=self.segments * segments, substeps=self.substeps * substeps
        )

    def limited(self, records: Sequence[Record]) -> SimulatedRig:
        """Return the same plant for other records."""
        return replace(self, records=tuple(records))


def _off() -> dict[str, float]:
    """Sizes of effects that a rig does not have."""
    return {
        parameter.name: 0.0
        for effect in EFFECTS.values()
        for parameter in effect.parameters
        if parameter.linear
    }


def plausible(parameter: EffectParameter, plant: SimulatedRig) -> tuple[float, float]:
    """Least and largest value that a parameter of an effect can stand for."""
    low, high = parameter.plausible
    if not parameter.of:
        return low, high
    records = plant.records
    if parameter.of == "motor_radius":
        whole = plant.bench.motor_radius
    elif parameter.of == "cable":
        whole = min(c.length / c.axial_stiffness for c in plant.bench.cables)
    elif parameter.of == "motion":
        whole = max(float(np.ptp(record.joint_angle)) for record in records)
    else:
        side = ("motor_torque", "joint_torque").index(parameter.of)
        row = plant.instruments.rows.index(side)
        whole = max(float(np.max(np.abs(r.measured[row]))) for r in records)
    return low * whole, high * whole
