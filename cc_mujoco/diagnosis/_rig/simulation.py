"""Simulation of the rig: baseline parameters, effects and sensor readings.

Both angles of a record go in, both torques come out. The baseline (`concepts.md`) is
that of the last occasion. For every earlier one the fit has a parameter
`<name>@<occasion>`: the ratio to the last occasion where the parameter is fitted as a
logarithm, the difference from it elsewhere. So the interval of a change does not
contain the error that both occasions have in common.

A load cell on the cable does not measure effects behind it, a known load has no sensor
with errors, and a torque without an instrument shows none of its effects. Effects left
out for that are reported with the instrument that would show them. Declared facts of
the rig exclude or bound others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco.cable import PARAMETERS, Cable, Parameter
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._rig_table import LOAD_CONSTANTS, RATIO_KEY, MomentArm
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Constant, Instrument, Instruments
from cc_mujoco.diagnosis._rig.records import (
    Indices,
    Record,
    Setting,
    agonist_less_antagonist,
    cached_replay,
    load_torque,
    load_values,
    low_pass,
    shift_signal,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects import _effect as terms
from cc_mujoco.diagnosis.effects._drive_effects import JOINT_DELAY, acceleration
from cc_mujoco.estimation._least_squares import Tuned, in_threads
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

_CHANGE_DEVIATIONS = {"friction": 1.0, "pretension": 1.0, "axial_stiffness": 0.3}
"""Prior standard deviation of the logarithm of a ratio between two occasions.

A pretension that is declared for every trial changes by its own uncertainty only.
"""
_CHANGING = (
    *_CHANGE_DEVIATIONS,
    *("motor_torque_offset", "joint_torque_offset", "joint_angle_offset"),
    *("clock_offset", "motor_torque_late", "joint_torque_late", "friction_balance"),
)
"""Parameters of the baseline that may change between occasions."""
_LARGEST = {p.name: p.high for p in PARAMETERS if p.name in _CHANGE_DEVIATIONS}


def change_name(name: str, occasion: str) -> str:
    """Return the name of the fit's parameter for a change since an occasion."""
    return f"{name}@{occasion}"


def base_name(name: str) -> str:
    """Return the parameter's name without the occasion of a change."""
    return name.partition("@")[0]


def values_on(values: Mapping[str, float], occasion: str) -> Mapping[str, float]:
    there = {name: values.get(change_name(name, occasion)) for name in _CHANGING}
    own = {name: change for name, change in there.items() if change is not None}
    if not own:
        return values
    found = dict(values)
    for name, change in own.items():
        if name in _CHANGE_DEVIATIONS:
            found[name] = min(values[name] * change, 0.9 * _LARGEST[name])
        else:
            found[name] = values[name] + change
    return found


def change_parameters(
    baseline: Sequence[Tuned], records: Sequence[Record], bench: Bench
) -> list[Tuned]:
    """Return a parameter for each change of `baseline` since an earlier occasion."""
    *earlier, last = dict.fromkeys(record.occasion for record in records)
    found = []
    for occasion in earlier:
        pair = occasion, last
        before, after = ([r for r in records if r.occasion == day] for day in pair)
        declared = all(record.pretension is not None for record in before + after)
        for tuned in baseline:
            if tuned.name not in _CHANGING:
                continue
            name, both = change_name(tuned.name, occasion), math.sqrt(2.0)
            if tuned.factor:
                meaning = tuned.parameter.meaning
                described = Parameter(name, "1", meaning, scale="log")
                prior = _CHANGE_DEVIATIONS[tuned.name]
                if tuned.name == "pretension" and declared:
                    prior = both * tuned.scale * tuned.prior
                most = math.log(30.0)  # the logarithm of the largest ratio
                found.append(Tuned(described, 1.0, 1.0, -most, most, prior))
                continue
            described = replace(tuned.parameter, name=name)
            start, (low, high) = 0.0, (2.0 * tuned.low, 2.0 * tuned.high)
            if tuned.name == "joint_angle_offset":
                start = _angle_offset(bench, before) - _angle_offset(bench, after)
            prior = both * tuned.prior
            found.append(Tuned(described, start, tuned.scale, low, high, prior))
    return found


_MECHANICAL_INSTRUMENTS: dict[str, tuple[Instrument, ...]] = {
    "motor": ("torque sensor", "motor current"),
    "joint": ("torque sensor", "known load"),
}
"""Instruments that show effects beyond the cable, on the torque of one side."""
_SENSOR_INSTRUMENTS: dict[str, tuple[Instrument, ...]] = {
    "motor": ("torque sensor", "load cells", "motor current"),
    "joint": ("torque sensor", "load cells"),
}
"""Instruments to which sensor errors of the torque apply, by side."""


class Library(NamedTuple):
    effects: Mapping[str, terms.Effect]  # by id, with parameters that show
    hidden: Mapping[str, str]  # reason why each other effect is not detectable, by id
    declared: Mapping[str, str]  # facts that remove or bound an effect, by id


def available_effects(plant: SimulatedRig) -> Library:
    """Return the effects that the rig can show, with the parameters it can show."""
    bench, constants = plant.bench, plant.constants
    columns = [set(record.columns) for record in plant.records]
    recorded = set.intersection(*columns) if columns else set()
    sides: dict[str, Instrument | None] = dict(plant.instruments._asdict())

    def acts(parameter: terms.EffectParameter) -> bool:
        for side, known in sides.items():
            if parameter.name.startswith(f"{side}_torque_"):
                return known in _SENSOR_INSTRUMENTS[side]
        if bench.led == "open" and parameter.name in ("seal_proximal", "seal_distal"):
            return False  # which only a conduit has
        return len(bench.cables) > 1 or terms.ANTAGONIST not in parameter.name

    effects: dict[str, terms.Effect] = {}
    hidden: dict[str, str] = {}
    declared: dict[str, str] = {}
    # Statements by which a rig does not have an effect
    excluding = {"joint_gravity": "balanced", "joint_stiffness": "joint_spring"}
    turning = (  # effects of an angle at an end, which held ends do not have
        *("pulley_eccentricity", "configuration_dependent_wrap"),
        *("drum_winding", "lever_geometry"),
    )
    for name, effect in EFFECTS.items():
        side = effect.where if effect.torques and not effect.sensor else ""
        shown = _MECHANICAL_INSTRUMENTS.get(side, ())
        kept, most = tuple(filter(acts, effect.parameters)), math.nan
        if sides["joint"] == "known load":  # a part of it that is not declared
            most = math.inf if name in ("joint_stiffness", "joint_inertia") else most
        if (fact := excluding.get(name, "")) in constants:
            declared[name] = f"{fact} = {str(bool(constants[fact].value)).lower()}"
            continue
        if name == "torque_sensor_offset" and "zeroed" in constants:
            kept = tuple(each for each in kept if not each.name.endswith("_bias"))
            declared[name] = "zeroed = true leaves drifts"
        if name == "torque_sensor_gain" and "gain_uncertainty" in constants:
            known = constants["gain_uncertainty"].value
            most = Limit.gain_sigmas * known
            declared[name] = f"gain_uncertainty = {known:g} leaves at most {most:.2g}"
        if not math.isnan(most):
            kept = tuple(each._replace(plausible=(-most, most)) for each in kept)
        absent = [column for column in effect.columns if column not in recorded]
        if reason := _path_exclusion(effect, bench):
            hidden[name] = reason
        elif bench.ends_held and name in turning:
            hidden[name] = "both ends are held, so no pulley turns"
        elif absent:
            hidden[name] = f"it takes the column {absent[0]}, which not all trials have"
        elif shown and sides[side] not in shown:
            reason = f"load cells on the cable do not see what happens at the {side}"
            if sides[side] is None:
                reason = f"the {side}'s torque is not measured"
            hidden[name] = f"{reason}; it takes a {list_words(shown, 'or')} there"
        elif not kept:
            hidden[name] = "no sensor of a torque is there that could be off"
        else:
            effects[name] = _with_parameters(effect, kept, plant)
    return Library(effects, hidden, declared)


def _with_parameters(
    effect: terms.Effect, kept: tuple[terms.EffectParameter, ...], plant: SimulatedRig
) -> terms.Effect:
    """Return an effect with the `kept` parameters, in forms that the rig may have."""
    key = terms.form_key(effect.id)
    forms, starts = effect.forms, effect.starts
    one_exit = len(plant.bench.cables) == 1 or "exit_angle" in plant.constants
    if forms and effect.id == "pulley_eccentricity" and one_exit:
        forms, starts = (), tuple(s for s in starts if s[key] == 0.0)
    names = {parameter.name for parameter in kept}
    if forms:
        names.add(key)
    starts = tuple({k: v for k, v in start.items() if k in names} for start in starts)
    return replace(effect, parameters=kept, starts=starts, forms=forms)


def _path_exclusion(effect: terms.Effect, bench: Bench) -> str:
    """Return the reason why the bench's kind of path excludes an effect, or ""."""
    if bench.led and (effect.joint_arm is not None or effect.motor_arm is not None):
        return "a path that the joint moves is played with the arms of the scene"
    if bench.led == "open" and effect.id == "clamp_creep":
        return "an open cable has no conduit that a clamp could hold"
    if bench.led and effect.id == "backlash":
        if bench.tied:
            return "the cable ends on the body that it turns, where nothing has play"
        return "play is looked for where the joint moves the end of the cable alone"
    if bench.tied and effect.id == "configuration_dependent_wrap":
        return "the path in the scene says how much the cable bends at every angle"
    return ""


Values = Mapping[str, float]

MAX_FITTED_STIFFNESS = 0.9 * _LARGEST["axial_stiffness"]
"""Largest axial stiffness that is fitted, below the limit of a cable [N]."""
TORQUE_OFFSETS = ("motor_torque_offset", "joint_torque_offset")
"""Parameters for the readings of the torque sensors at zero torque [N m]."""
TORQUE_DELAYS = ("motor_torque_late", "joint_torque_late")
CLOCK_PARAMETERS = ("clock_offset", *TORQUE_DELAYS)
"""Parameters for the delays of the joint's readings and of either torque [s].

Their prior deviation is half a sample and their bound one sample. A larger delay is an
effect.
"""


def _baseline() -> Iterator[tuple[Parameter, str]]:
    known = {parameter.name: parameter for parameter in PARAMETERS}
    for row in read_sheet(Path(__file__).with_name("baseline.csv")).rows:
        name, unit, meaning, scale, remedy = row.cells
        own: Any = known.get(name) or Parameter(name, unit, meaning)
        yield replace(own, scale=scale), remedy


_TABLE = tuple(_baseline())
BASELINE: dict[str, Parameter] = {parameter.name: parameter for parameter, _ in _TABLE}
"""Parameters of the baseline by name.

Their bounds depend on the data, see `baseline_parameters`.
"""
REMEDIES = {parameter.name: remedy for parameter, remedy in _TABLE}
"""Advice to distinguish a baseline parameter from the effects it can stand for."""


def baseline_parameters(
    bench: Bench,
    records: Sequence[Record],
    constants: Mapping[str, Constant],
    instruments: Instruments = TORQUE_SENSORS,
    guessed: Collection[str] = (),
) -> tuple[Tuned, ...]:
    """Return the baseline's parameters; those `guessed` have rough start values."""
    cable = bench.cables[0]
    step = records[0].step

    def unsure(name: str, value: float, otherwise: float) -> float:
        given = constants.get(name, Constant(value)).uncertainty
        return given / value if given > 0.0 and value > 0.0 else otherwise

    usual = Limit.pretension_deviation
    if "pretension" in guessed:
        usual = Limit.guessed_pretension_deviation
    known = unsure("pretension", cable.pretension, usual)
    wide = math.log(100.0)
    stiffest = min(wide, math.log(MAX_FITTED_STIFFNESS / cable.axial_stiffness))
    whole = np.concatenate([record.measured for record in records], axis=1)
    rms = dict(zip(instruments.rows, np.std(whole, axis=1).tolist(), strict=True))
    # A torque from the motion of a load has no sensor that could be off or late.
    sensors = [k for k in instruments.rows if instruments[k] != "known load"]
    centre = _angle_offset(bench, records)
    friction = max(cable.friction, Limit.min_fitted_friction)
    most = max(0.0, math.log(Limit.max_fitted_friction / friction))
    least = min(-wide, math.log(Limit.min_fitted_friction / friction))
    found = [
        Tuned(BASELINE[name], value, 1.0, low, high, unsure(name, value, math.inf))
        for name, value, low, high in (
            ("friction", friction, least, most),
            ("axial_stiffness", cable.axial_stiffness, -wide, stiffest),
        )
    ]
    tension = max(cable.pretension, 1e-9)
    tautest = math.log(0.9 * _LARGEST["pretension"] / tension) / known
    found.append(_known("pretension", cable.pretension, known, high=min(10.0, tautest)))
    for k in sensors:
        size = max(Limit.offset_deviation * rms[k], 1e-6)
        found.append(_known(TORQUE_OFFSETS[k], 0.0, size, -2.0, 2.0))
    late = [TORQUE_DELAYS[k] for k in sensors]
    if not bench.ends_held:
        found.append(Tuned(BASELINE["joint_angle_offset"], centre, 0.01, -1e3, 1e3))
        late = ["clock_offset", *late]
    found += [Tuned(BASELINE[name], 0.0, step, -1.0, 1.0, 0.5) for name in late]
    if len(bench.cables) == 2:
        found.append(_known("friction_balance", 0.0, Limit.balance_deviation))
    # A stiff cable shows the least error of the ratio, so one pulley is always
    # uncertain. Where the path is the arm at the joint it is the motor's.
    uncertain = "" if bench.ends_held else "motor" if bench.tied else "joint"
    for side, given in (("motor", bench.motor_radius), ("joint", bench.joint_radius)):
        otherwise = Limit.ratio_deviation if side == uncertain else 0.0
        relative = unsure(f"{side}_radius", given, otherwise)
        if side == "joint" and RATIO_KEY in constants:
            pairs = constants[RATIO_KEY]
            relative = max(relative, pairs.uncertainty / pairs.value)
        if relative > 0.0:
            found.append(_known(f"{side}_radius", given, relative))
    if instruments.motor == "motor current":
        found += _motor_parameters(records, constants, rms[0])
    if instruments.joint == "known load":
        for name in LOAD_CONSTANTS:
            load = constants.get(name, Constant(0.0))
            if load.uncertainty > 0.0:
                found.append(_known(name, load.value, load.uncertainty / load.value))
        if "load_stiffness" in constants:
            rest = constants.get("load_rest_angle", Constant(0.0))
            scale = rest.uncertainty or Limit.rest_angle_deviation
            found.append(_known("load_rest_angle", rest.value, scale))
    found += change_parameters(found, records, bench)
    return tuple(found)


def _known(
    name: str, value: float, deviation: float, low: float = -10.0, high: float = 10.0
) -> Tuned:
    """Return a fit parameter with a prior of this standard deviation, its scale."""
    return Tuned(BASELINE[name], value, deviation, low, high, 1.0)


def _motor_parameters(
    records: Sequence[Record], constants: Mapping[str, Constant], rms: float
) -> list[Tuned]:
    speeds = [np.abs(np.gradient(r.motor_angle, r.dt))[r.counts] for r in records]
    speed = max(float(np.quantile(np.concatenate(speeds), 0.95)), 1e-6)
    low, high = (math.log(each / Limit.wind_up) for each in terms.WIND_UP_BOUNDS)
    wind_up = BASELINE["motor_wind_up"], Limit.wind_up
    found = [
        Tuned(BASELINE["motor_friction"], 0.0, 0.1 * rms, 0.0, 100.0),
        Tuned(*wind_up, 1.0, low, high, 2.0),
        Tuned(BASELINE["motor_damping"], 0.0, 0.1 * rms / speed, 0.0, 100.0),
    ]
    known = constants["torque_constant"]
    if known.uncertainty > 0.0:
        size = known.uncertainty / known.value
        found.append(_known("torque_constant", known.value, size))
    return found


def _angle_offset(bench: Bench, records: Sequence[Record]) -> float:
    """Return the median angle that the joint lacks to follow the motor [rad]."""
    ratio = bench.motor_radius / bench.joint_radius
    pairs = [(r.motor_angle, bench.turned(r.joint_angle, r.path)) for r in records]
    gaps = [np.median(ratio * motor - turned) for motor, turned in pairs]
    return float(np.median(gaps))


@dataclass(frozen=True)
class SimulatedRig:
    bench: Bench  # bench with the nominal radii and cables
    records: tuple[Record, ...]  # records to simulate
    segments: int  # segments per cable
    substeps: int = 1  # simulation steps per sample
    instruments: Instruments = TORQUE_SENSORS  # of the torques of the records
    # Constants of motor and load in the rig's file
    constants: Mapping[str, Constant] = field(default_factory=dict)
    # Values of the scene that the data contradict; the bench has estimates for them
    given: Values = field(default_factory=dict)

    @cached_property
    def library(self) -> Library:
        return available_effects(self)

    @cached_property
    def occasions(self) -> tuple[str, ...]:
        """Occasions of the records, in the order of their first trials."""
        return tuple(dict.fromkeys(record.occasion for record in self.records))

    @cached_property
    def by_trial(self) -> dict[str, list[int]]:
        """Indices of the records of each trial in which samples count."""
        found: dict[str, list[int]] = {}
        for k, record in enumerate(self.records):
            if record.counts.any():
                found.setdefault(record.trial, []).append(k)
        return found

    @cached_property
    def _absent(self) -> dict[str, float]:
        every = (p for effect in EFFECTS.values() for p in effect.parameters)
        return {parameter.name: 0.0 for parameter in every if parameter.linear}

    def simulate(
        self, values: Values, effects: Sequence[str] = (), only: Indices | None = None
    ) -> list[FloatArray]:
        """Return the torques (rows, samples) of every record, or of indices `only`."""
        chosen = self.records if only is None else [self.records[k] for k in only]
        here = {own: values_on(values, own) for own in {r.occasion for r in chosen}}
        settings: dict[tuple[object, ...], Setting] = {}  # many trials share one
        tasks = []
        for record in chosen:
            own, conditions = here[record.occasion], self.conditions_of(record, effects)
            key = record.pretension, conditions, record.occasion
            if key not in settings:
                settings[key] = self.setting(own, effects, *key[:2])
            tasks.append((record, settings[key], own))
        return in_threads(lambda task: self._shown(*task, effects), tasks)

    @staticmethod
    def conditions_of(record: Record, effects: Sequence[str]) -> terms.TrialConditions:
        """Return the conditions of a trial; the usual ones if no effect uses them."""
        by_trial = any(EFFECTS[name].by_trial for name in effects)
        return record.conditions if by_trial else terms.USUAL_CONDITIONS

    def slack_share(self, values: Values, effects: Sequence[str], index: int) -> float:
        """Return the share of a record's samples in which a cable is slack."""
        record = self.records[index]
        if record.unhooked:
            return 0.0
        here = values_on(values, record.occasion)
        conditions = self.conditions_of(record, effects)
        setting = self.setting(here, effects, record.pretension, conditions)
        played = cached_replay(record, setting)
        loose = np.minimum(played.tension_proximal, played.tension_distal) <= 0.0
        return float(np.mean(np.any(loose, axis=0)))

    def setting(
        self,
        values: Values,
        effects: Sequence[str],
        pretension: float | None = None,
        conditions: terms.TrialConditions = terms.USUAL_CONDITIONS,
    ) -> Setting:
        """Return the parameters of a replay for these values, see `cables`."""
        radii, whole = self.radii(values), {**self._absent, **values}
        acting, lever = [EFFECTS[name] for name in effects], self.bench.lever
        arm = _moment_arm((e.joint_arm for e in acting), whole, self.bench.arm)
        return Setting(
            self.cables(values, effects, pretension, conditions),
            *radii,
            backlash=values.get("backlash", 0.0) if "backlash" in effects else 0.0,
            late=values.get("clock_offset", 0.0) + values.get(JOINT_DELAY, 0.0),
            offset=values.get("joint_angle_offset", 0.0),
            substeps=self.substeps,
            profile=MomentArm(arm, lever) if arm else lever,
            courses=self.bench.courses(self.segments),
            share=radii[1] / self.bench.drawn_radius if self.bench.led else 1.0,
            motor_arm=_moment_arm((e.motor_arm for e in acting), whole),
        )

    def cables(
        self,
        values: Values,
        effects: Sequence[str],
        pretension: float | None = None,
        conditions: terms.TrialConditions = terms.USUAL_CONDITIONS,
    ) -> tuple[Cable, ...]:
        """Return the cables with values and effects, at a trial's pretension [N]."""
        first = self.bench.cables[0]
        tension = values.get("pretension", first.pretension)
        if pretension is not None and first.pretension > 0.0:
            tension *= pretension / first.pretension
        balance = values.get("friction_balance", 0.0)
        stiffness = values.get("axial_stiffness", first.axial_stiffness)
        coulomb = values.get("friction", first.friction)
        made: tuple[Cable, ...] = ()
        for cable, side in zip(self.bench.cables, (balance, -balance), strict=False):
            friction = coulomb * _ratio(cable.friction, first.friction) * (1.0 + side)
            stiff = stiffness * _ratio(cable.axial_stiffness, first.axial_stiffness)
            own = cable.replace(
                friction=terms.clamp_to_bounds("friction", friction),
                axial_stiffness=terms.clamp_to_bounds("axial_stiffness", stiff),
                pretension=max(tension, 0.0),
                segments=max(self.segments, self.bench.min_cable_segments),
                static_friction=0.0,
            )
            made = (*made, own)
        rig = terms.RigGeometry(*self.radii(values), self.bench.exit_angle, conditions)
        values = {**self._absent, **values}
        for change in (EFFECTS[name].cables for name in effects):
            if change is not None:
                made = change(made, values, rig)
        return made

    def radii(self, values: Values) -> tuple[float, float]:
        bench = self.bench
        motor = values.get("motor_radius", bench.motor_radius)
        return motor, values.get("joint_radius", bench.joint_radius)

    def signals(
        self, record: Record, values: Values, effects: Sequence[str]
    ) -> terms.Signals:
        """Return the signals of a record, before lag, offset and filter of sensors."""
        own = values_on(values, record.occasion)
        conditions = self.conditions_of(record, effects)
        setting = self.setting(own, effects, record.pretension, conditions)
        return self._with_effects(self._torques(record, setting, own), own, effects)

    def _with_effects(
        self, shown: terms.Signals, values: Values, effects: Sequence[str]
    ) -> terms.Signals:
        values = {**self._absent, **values}
        for effect in sorted(map(EFFECTS.__getitem__, effects), key=lambda e: e.sensor):
            if effect.torques is not None:
                shown = effect.torques(shown, values)
        return shown

    def _shown(
        self, record: Record, setting: Setting, values: Values, effects: Sequence[str]
    ) -> FloatArray:
        if record.swapped:
            values = _swap_sensors(values)
        shown = self._with_effects(
            self._torques(record, setting, values), values, effects
        )
        motor, joint = (values.get(name, 0.0) for name in TORQUE_DELAYS)
        lags = (shown.motor, motor), (shown.joint, setting.late + joint)
        moved = [shift_signal(torque, -late / record.dt) for torque, late in lags]
        offsets = [values.get(name, 0.0) for name in TORQUE_OFFSETS]
        both = np.array([row + by for row, by in zip(moved, offsets, strict=True)])
        if (cell := record.load_cell) is not None:  # no torque sensor shows its fault
            late = setting.late if cell.row else 0.0
            ends = (shown.tension_proximal, shown.tension_distal)[cell.row]
            pull = cell.torque(ends[cell.cable])
            both[cell.row] = shift_signal(pull, -late / record.dt)
        rows = both[list(self.instruments.rows)]
        return low_pass(rows, record.band, 1.0 / record.dt)

    def _torques(
        self, record: Record, setting: Setting, values: Values
    ) -> terms.Signals:
        """Return the signals of a record, before the effects outside the cables.

        Readings were converted by declared constants; tuned ones act relative to these.
        """
        played = cached_replay(record, setting)
        joint_angle, motor, joint = played.joint_angle, played.motor, played.joint
        known, constants = self.instruments, self.constants
        if known.motor == "load cells":
            pull = agonist_less_antagonist(played.tension_proximal)
            motor = self.bench.motor_radius * pull
        if known.motor in _MECHANICAL_INSTRUMENTS["motor"]:
            if (rotor := constants.get("rotor_inertia")) is not None:
                turning = acceleration(record.motor_angle, record.dt)
                motor = motor + rotor.value * turning
            motor = motor + record.known_torques[0]
        if known.motor == "motor current":
            speed = np.gradient(record.motor_angle, record.dt)
            wind_up = values.get("motor_wind_up", Limit.wind_up)
            share = terms.dry_friction(record.motor_angle, wind_up)
            motor = motor + values.get("motor_friction", 0.0) * share
            motor = motor + values.get("motor_damping", 0.0) * speed
            given = constants["torque_constant"].value
            motor = motor * (given / values.get("torque_constant", given))
        if known.joint == "load cells":
            pull = agonist_less_antagonist(played.tension_distal)
            joint = self.bench.joint_radius * pull
        elif known.joint == "torque sensor":
            joint = joint + record.known_torques[1]
        elif known.joint == "known load":
            declared = {"load_rest_angle": 0.0, **load_values(constants)}
            here = {k: values.get(k, v) for k, v in declared.items()}
            both = ((here, record.tilt), (declared, record.tilt))
            tuned, usual = (load_torque(joint_angle, record.dt, *load) for load in both)
            joint = joint - (tuned - usual)
        # A lever has its arm by the joint's own angle, and so have weights and springs.
        # With pulleys, the offset is the motor's zero as much as the joint's.
        there = joint_angle + (setting.offset if self.bench.lever is not None else 0.0)
        return terms.Signals(
            dt=record.dt,
            time=record.start + record.dt * np.arange(motor.size, dtype=np.float64),
            motor_angle=record.motor_angle,
            joint_angle=there,
            motor=motor,
            joint=joint,
            tilt=record.tilt,
            tension_proximal=played.tension_proximal,
            tension_distal=played.tension_distal,
            motor_radius=setting.motor_radius,
            joint_radius=setting.joint_radius,
            conditions=record.conditions,
            columns=record.columns,
        )

    @cached_property
    def coarse(self) -> SimulatedRig:
        """Same rig with an eighth of the segments and steps, enough for differences."""
        least = min(self.segments, Limit.min_segments)
        segments = max(self.segments // Limit.coarsening, least)
        substeps = max(self.substeps // Limit.coarsening, 1)
        if (segments, substeps) == (self.segments, self.substeps):
            return self
        return replace(self, segments=segments, substeps=substeps)

    def limited(self, records: Sequence[Record]) -> SimulatedRig:
        return replace(self, records=tuple(records))


def _ratio(own: float, first: float) -> float:
    return own / first if first > 0.0 else 1.0


def _moment_arm(
    changes: Iterable[Callable[[Values], tuple[float, ...]] | None],
    values: Values,
    known: tuple[float, ...] = (),
) -> tuple[float, ...]:
    """Return the coefficients of a `MomentArm`, all changes added; () if all are 0."""
    found = [change(values) for change in changes if change is not None]
    rows = zip_longest(*found, known, fillvalue=0.0)
    total = tuple(float(sum(row)) for row in rows)
    return total if any(total) else ()


def _swap_sensors(values: Values) -> dict[str, float]:
    """Return values for a trial in which the two torque sensors were exchanged."""
    motor, joint = "motor_torque_", "joint_torque_"
    others = {motor: joint, joint: motor}
    swapped = {}
    for name, value in values.items():
        side = next(filter(name.startswith, others), "")
        swapped[others.get(side, "") + name.removeprefix(side)] = value
    return swapped


def plausible_range(
    parameter: terms.EffectParameter, plant: SimulatedRig
) -> tuple[float, float]:
    """Return the range of an effect's parameter that is plausible on a rig."""
    (low, high), records = parameter.plausible, plant.records
    if not parameter.of:
        return low, high
    motion = max((float(np.ptp(r.joint_angle)) for r in records), default=0.0)
    if parameter.of == "motor_radius":
        whole = plant.bench.motor_radius
    elif parameter.of == "cable":
        whole = min(c.length / c.axial_stiffness for c in plant.bench.cables)
    elif parameter.of == "motion":
        whole = motion
    else:
        torque, _, per_motion = parameter.of.partition(" per ")
        side = ("motor_torque", "joint_torque").index(torque)
        row = plant.instruments.rows.index(side)
        whole = max(float(np.max(np.abs(r.measured[row]))) for r in records)
        if per_motion:
            whole /= max(0.5 * motion, 1e-9)
    return low * whole, high * whole
