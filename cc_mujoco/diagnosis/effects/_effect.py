"""Effect: its location, its parameters and its action on a simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from cc_mujoco.cable import PARAMETERS, Cable, Parameter
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, compiled

if TYPE_CHECKING:
    from mujoco import MjSpec

    from cc_mujoco.datasets import Bench

Values = Mapping[str, float]
Cables = tuple[Cable, ...]
"""Cables of a rig, agonist first."""
Place = Literal["conduit", "motor", "joint", "sensor"]
"""Part of a rig in which an effect acts."""


class EffectError(CableError):
    """Fault in the code of an effect, which no other value of a fit mends."""


_OF_CABLES = {parameter.name: parameter for parameter in PARAMETERS}

ANTAGONIST = "antagonist"
"""Part of a parameter name that marks the second cable of a pair."""
WIND_UP_BOUNDS = (1e-5, 0.1)
"""Angles over which dry friction of a motor or a joint may build up [rad]."""
PLUGIN_KEYS = "keys of the cable plugin"
"""Realisation in MuJoCo of effects in the cables."""


class EffectParameter(NamedTuple):
    """Parameter of an effect with its plausible size; 0 is off."""

    # Its descriptor, with the bounds of fits; logarithmic where it cannot be 0 and only
    # shapes the effect
    parameter: Parameter
    typical: float  # size that is plausible on a rig; the scale of fits
    # Least and largest value of the effect; one that fits only beyond is not named
    plausible: tuple[float, float] = (-math.inf, math.inf)
    # Reference of `plausible`: the joint's range of motion, the motor's radius, the
    # largest torque, the same over half of the joint's range, the elongation of the
    # scene's cable per tension, or nothing
    of: Literal[
        "",
        "motion",
        "motor_radius",
        "motor_torque",
        "joint_torque",
        "joint_torque per motion",
        "cable",
    ] = ""
    # Size that any rig may have without a report, a fraction of `ordinary_of`; a
    # smaller one belongs into the model, but is not called missing
    ordinary: float = 0.0
    # The elongation of the cable per tension, or the pretension (of the friction per
    # length times the length of the conduit)
    ordinary_of: Literal["", "cable", "pretension", "pretension per length"] = ""
    # True if it may accompany the effect without being a size of it: the effect is
    # absent if all other sizes are 0
    beside: bool = False
    # True if it only shapes the effect, although it is fitted linearly, as the place of
    # a stop is
    shape: bool = False

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name

    @property
    def unit(self) -> str:
        """Unit of the parameter."""
        return self.parameter.unit

    @property
    def linear(self) -> bool:
        """True if 0 is off; other parameters only shape the effect."""
        return self.parameter.scale == "linear" and not self.shape

    @property
    def size(self) -> bool:
        """True if it is one of the sizes of the effect."""
        return self.linear and not self.beside


class TrialConditions(NamedTuple):
    """Conditions of one trial that an effect may depend on.

    Attributes:
        order: place among the trials, the middle one 0: -1, 0, 1 of three.
        temperature: mean over the trial minus the mean over all trials [K]; 0 where
            it is not measured.
        warming: rate at which the temperature rises during the trial [K/s].
    """

    order: float = 0.0
    temperature: float = 0.0
    warming: float = 0.0


USUAL_CONDITIONS = TrialConditions()
"""Conditions of the repaired scene: the mean of all trials."""


@dataclass(frozen=True)
class Signals:
    """Signals of one record (samples,): motion given, torques simulated [SI].

    Attributes:
        dt: time between samples.
        time: time since the start of the trial.
        motor_angle: angle of the motor.
        joint_angle: measured angle of the joint; for a lever, the angle of the scene.
        motor: torque that the motor puts into its pulley.
        joint: torque that the transmission puts into the joint.
        tilt: angle by which the rig was turned about the joint's axis.
        tension_proximal: simulated tensions at the motor (cables, samples), agonist
            first.
        tension_distal: simulated tensions at the joint, likewise.
        motor_radius: radius of the motor's pulley.
        joint_radius: radius of the joint's pulley.
        conditions: conditions of the trial.
        columns: columns of the file that the effect requested (samples,), by name, as
            they are recorded; with `temperature_c`.
    """

    dt: float
    time: FloatArray
    motor_angle: FloatArray
    joint_angle: FloatArray
    motor: FloatArray
    joint: FloatArray
    tilt: float = 0.0
    tension_proximal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    tension_distal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    motor_radius: float = math.nan
    joint_radius: float = math.nan
    conditions: TrialConditions = USUAL_CONDITIONS
    columns: Mapping[str, FloatArray] = field(default_factory=dict)

    def added(
        self, motor: FloatArray | float = 0.0, joint: FloatArray | float = 0.0
    ) -> Signals:
        """Return the signals with torques added [N m]."""
        return replace(self, motor=self.motor + motor, joint=self.joint + joint)

    @property
    def motor_speed(self) -> FloatArray:
        """Speed of the motor (samples,) [rad/s]."""
        return np.gradient(self.motor_angle, self.dt)

    @property
    def joint_speed(self) -> FloatArray:
        """Speed of the joint (samples,) [rad/s]."""
        return np.gradient(self.joint_angle, self.dt)

    @property
    def cable_speed(self) -> FloatArray:
        """Speeds of the agonist's ends towards the motor (2, samples) [m/s].

        The end at the motor comes first; the antagonist has the opposite speeds.
        """
        return np.array(
            [self.motor_radius * self.motor_speed, self.joint_radius * self.joint_speed]
        )


class RigGeometry(NamedTuple):
    """Properties of the rig and the trial that an effect may need.

    Attributes:
        motor_radius: radius of the motor's pulley [m].
        joint_radius: radius of the joint's pulley, or arm of its lever at 0 [m].
        exit_angle: angle between where the two cables leave the motor's pulley [rad].
        conditions: conditions of the trial.
    """

    motor_radius: float
    joint_radius: float
    exit_angle: float
    conditions: TrialConditions = USUAL_CONDITIONS


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One physical effect."""

    id: str  # its name in `verdict.json`
    title: str  # name for readers
    equation: str  # term that it adds
    parameters: tuple[EffectParameter, ...]  # its parameters
    required_excitation: str  # excitation that a recording needs to show it
    confounded_with: tuple[str, ...]  # ids that it is easily confused with
    source: str  # publication
    where: Place = "conduit"  # part of the rig in which it acts
    # Values from which it is screened and fitted, typical ones unless given; several
    # where the fit depends on an unknown scale
    starts: tuple[Values, ...] = ({},)
    mujoco: str = PLUGIN_KEYS  # how a scene has it
    # The cables with the effect; an effect of the conduit that says nothing else sets
    # its parameters on every cable
    cables: Callable[[Cables, Values, RigGeometry], Cables] | None = None
    # The signals with the effect, in the order motor, joint, sensors
    torques: Callable[[Signals, Values], Signals] | None = None
    # True for an effect of a sensor, applied after the mechanical ones
    sensor: bool = False
    # Ids that are special cases of it; where one of them does as well, this one is no
    # rival
    generalises: tuple[str, ...] = ()
    # Ids of effects whose form it has on some rigs, so that the quality of the fit does
    # not distinguish them
    form_of: tuple[str, ...] = ()
    # Coefficients (a, b, ...) of the joint's moment arm over the nominal one, 1 + a q +
    # b q^2 + ..., at joint angle q
    joint_arm: Callable[[Values], tuple[float, ...]] | None = None
    # The same at the motor, where q is the angle by which each cable is wound on: the
    # motor's angle, and its negative for the antagonist
    motor_arm: Callable[[Values], tuple[float, ...]] | None = None
    # Adds the effect to an `MjSpec`; None where it is in keys of the cable plugin,
    # where a table of `realisation` has it, or where a scene cannot
    edit_spec: Callable[[MjSpec, Bench, Values], None] | None = None
    columns: tuple[str, ...] = ()  # columns of the file that it takes
    by_trial: bool = False  # True if the cables depend on the trial's conditions
    # True if it is searched on request, and where the other effects leave the error
    # unexplained
    rare: bool = False
    # Ids of usual effects that a rare one can equal on motions alone: it competes
    # wherever one of them is accepted
    resembles: tuple[str, ...] = ()
    # Names of the forms in which it is offered; the value `form_key(id)` is the index
    # of the one that is simulated, 0 where there is none
    forms: tuple[str, ...] = ()
    # Why sizes that are plausible by themselves are not together, in words after "fits
    # only with"; "" if they are
    implausible: Callable[[Values], str] | None = None

    def __post_init__(self) -> None:
        typical = {parameter.name: parameter.typical for parameter in self.parameters}
        starts = tuple({**typical, **start} for start in self.starts)
        object.__setattr__(self, "starts", starts)
        if not (self.cables or self.torques or self.joint_arm or self.motor_arm):
            names = tuple(typical)

            def cables(given: Cables, values: Values, _: RigGeometry) -> Cables:
                changes = {name: values[name] for name in names}
                return tuple(cable.replace(**changes) for cable in given)

            object.__setattr__(self, "cables", cables)

    def form(self, values: Values) -> str:
        """Return the form that values select, "" of an effect with only one."""
        forms = self.forms or ("",)
        return forms[round(values.get(form_key(self.id), 0.0))]

    def confused(self, other: Effect) -> bool:
        """Return whether either is easily confused with the other."""
        return other.id in self.confounded_with or self.id in other.confounded_with

    def forms_meet(self, other: Effect) -> bool:
        """Return whether either has the form of the other on some rigs."""
        return other.id in self.form_of or self.id in other.form_of


def form_key(effect: str) -> str:
    """Return the name of the value that selects the form of an effect."""
    return f"{effect}_form"


def of_cable(
    name: str, low: float, high: float, typical: float, called: str = "", **more: Any
) -> EffectParameter:
    """Return a parameter of the cable as that of an effect.

    With a lower bound above 0, it is fitted as a logarithm; `called` is the name in the
    effect, if it differs.
    """
    known = replace(
        _OF_CABLES[name],
        name=called or name,
        low=low,
        high=high,
        low_open=False,
        scale="log" if low > 0.0 else "linear",
    )
    return EffectParameter(known, typical, **more)


def sized(
    name: str,
    unit: str,
    meaning: str,
    low: float,
    high: float,
    typical: float,
    plausible: tuple[float, float] = (-math.inf, math.inf),
    of: Any = "",
    **more: Any,
) -> EffectParameter:
    known = Parameter(name, unit, meaning, low, high)
    return EffectParameter(known, typical, plausible, of, **more)


def clamp_to_bounds(name: str, value: float) -> float:
    known = _OF_CABLES[name]
    return min(max(value, known.low), known.high)


def dry_friction(angle: FloatArray, wind_up: float) -> FloatArray:
    """Return dry friction over its largest value, against motion (samples,) [-1 to 1].

    A bristle holds the surface, as in the cables' presliding: it bends with the angle,
    and slides where it is bent by the wind-up [rad], above 0. It is straight at the
    first sample.
    """
    return (angle - follow_with_play(angle, wind_up)) / wind_up


def follow_with_play(angle: FloatArray, width: float) -> FloatArray:
    """Return the angle followed with play of this half width (samples,) [rad]."""
    followed = np.empty(angle.size)
    _follow_with_play(angle, width, followed)
    return followed


@compiled
def _follow_with_play(angle: FloatArray, width: float, out: FloatArray) -> None:
    x = angle[0]
    for i in range(angle.size):
        x = min(max(x, angle[i] - width), angle[i] + width)
        out[i] = x
