"""Effect of a rig: its location, its parameters and its action on a simulation.

An effect may be written as a class, by a user or here:

    class JointDrag:
        '''Viscous drag on the joint.'''

        needs = "joint speeds over a decade"

        def parameters(self):
            return [Size("joint_drag", "N m s/rad", 0.05, low=0.0)]

        def signals(self, signals, values):
            return signals.added(joint=-values["joint_drag"] * signals.joint_speed)

    effect = effect_of_class(JointDrag)

`parameters` lists `Size` (0 is off) and `Shape`. At least one of `signals`, `cables`,
`joint_arm` and `motor_arm` changes the simulation; `edit_spec` adds the effect to an
`MjSpec`.
"""

from __future__ import annotations

import inspect
import itertools
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from cc_mujoco._utils.user_code import user_errors
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
    """Fault in the code of an effect, which occurs whatever values a fit tries."""


_OF_CABLES = {parameter.name: parameter for parameter in PARAMETERS}

ANTAGONIST = "antagonist"
"""Part of a parameter name that marks the second cable of a pair."""
WIND_UP_BOUNDS = (1e-5, 0.1)
"""Angles over which dry friction of a motor or a joint may build up [rad]."""


class EffectParameter(NamedTuple):
    """Parameter of an effect with its plausible size; a size of 0 is off."""

    # Descriptor with the bounds of fits; logarithmic if a shape that cannot be 0
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
    # Size that any rig may have, a fraction of `ordinary_of`, not called missing
    ordinary: float = 0.0
    # The elongation of the cable per tension, or the pretension (of the friction per
    # length times the length of the conduit)
    ordinary_of: Literal["", "cable", "pretension", "pretension per length"] = ""
    beside: bool = False  # True if it accompanies the effect without being a size of it
    shape: bool = False  # True if it only shapes the effect, though fitted linearly

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
        """True if the effect is off where it is 0; others only shape the effect."""
        return self.parameter.scale == "linear" and not self.shape

    @property
    def size(self) -> bool:
        """True if it is a size of the effect: neither its shape nor a companion."""
        return self.linear and not self.beside


class TrialConditions(NamedTuple):
    """Conditions of one trial that an effect may depend on."""

    order: float = 0.0  # place among the trials, the middle one 0: -1, 0, 1 of three
    # Mean over the trial less that over all trials [K]; 0 where it is not measured
    temperature: float = 0.0
    warming: float = 0.0  # rate at which the temperature rises in the trial [K/s]


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
        columns: further columns of the file (samples,), by name, as they are
            recorded; with `temperature_c`.
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
        rims = self.motor_radius, self.joint_radius
        return np.array([rims[0] * self.motor_speed, rims[1] * self.joint_speed])


class RigGeometry(NamedTuple):
    """Dimensions of the rig and conditions of the trial that an effect may need."""

    motor_radius: float  # of the motor's pulley [m]
    joint_radius: float  # of the joint's pulley, or arm of its lever at 0 [m]
    exit_angle: float  # between where two cables leave the motor's pulley [rad]
    conditions: TrialConditions = USUAL_CONDITIONS  # of the trial


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Physical effect that a rig may have and a scene may lack."""

    id: str  # its name in `verdict.json`
    title: str  # name for readers
    equation: str  # term that it adds
    parameters: tuple[EffectParameter, ...]  # its parameters
    required_excitation: str  # excitation that a recording needs to show it
    confounded_with: tuple[str, ...]  # ids that it is easily confused with
    source: str  # publication
    where: Place = "conduit"  # part of the rig in which it acts
    # Values that fits start from, typical unless given; several of an unknown scale
    starts: tuple[Values, ...] = ({},)
    # How `edit_spec` adds it, for the comment of a written scene, or why it cannot
    scene_note: str = ""
    # The cables with the effect; by default with its parameters on every cable
    cables: Callable[[Cables, Values, RigGeometry], Cables] | None = None
    # The signals with the effect, those of sensors last
    torques: Callable[[Signals, Values], Signals] | None = None
    sensor: bool = False  # True of a sensor, applied after the mechanical ones
    # Ids of its special cases; where one of them does as well, this one is no rival
    generalises: tuple[str, ...] = ()
    # Ids of effects whose form it has on some rigs, so that fits do not part them
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
    by_trial: bool = False  # True if cables may depend on the trial's conditions
    # True if searched on request, and where the others leave the error unexplained
    rare: bool = False
    # Ids of usual effects that a rare one equals on motions alone: they compete
    resembles: tuple[str, ...] = ()
    # Names of the forms in which it is offered; the value `form_key(id)` is the index
    # of the one that is simulated, 0 where there is none
    forms: tuple[str, ...] = ()
    # Why sizes are not plausible together, after "fits only with"; "" if they are
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
        """Return the form that `values` select; "" for an effect with only one."""
        forms = self.forms or ("",)
        return forms[round(values.get(form_key(self.id), 0.0))]

    def confused(self, other: Effect) -> bool:
        """Return whether either is easily confused with the other."""
        return other.id in self.confounded_with or self.id in other.confounded_with

    def forms_meet(self, other: Effect) -> bool:
        """Return whether one of both takes the form of the other on some rigs."""
        return other.id in self.form_of or self.id in other.form_of


def form_key(effect: str) -> str:
    """Return the name of the value that selects the form of an effect."""
    return f"{effect}_form"


def _read_parameter(table: dict[str, Any]) -> EffectParameter:
    """Return a parameter by its table in `effects.toml`, which is emptied."""
    low, high = table.pop("range")
    if (cable := table.pop("cable", None)) is not None:
        scale: Any = "log" if low > 0.0 else "linear"
        bounds: Any = {"low": low, "high": high, "low_open": False, "scale": scale}
        name = table.pop("called", cable)
        known = replace(_OF_CABLES[cable], name=name, **bounds)
    else:
        name, unit, meaning = map(table.pop, ("name", "unit", "meaning"))
        scale = table.pop("scale", "linear")
        known = Parameter(name, unit, meaning, low, high, scale=scale)
    if "plausible" in table:
        table["plausible"] = tuple(table["plausible"])
    return EffectParameter(known, **table)


def read_effects(actions: Mapping[str, Mapping[str, Any]]) -> Iterator[Effect]:
    """Yield the effects of `effects.toml`, with their functions by id."""
    text = Path(__file__).with_name("effects.toml").read_text(encoding="utf-8")
    for name, table in tomllib.loads(text).items():
        table["parameters"] = map(_read_parameter, table["parameters"])
        fields: dict[str, Any] = dict(actions.get(name, {}))
        for key, value in table.items():
            fields[key] = value if isinstance(value, (str, bool)) else tuple(value)
        yield Effect(id=name, **fields)


def clamp_to_bounds(name: str, value: float) -> float:
    known = _OF_CABLES[name]
    return min(max(value, known.low), known.high)


def dry_friction(angle: FloatArray, wind_up: float) -> FloatArray:
    """Return dry friction over its largest value, signed as the motion (samples,).

    It is elastic up to the angle `wind_up` [rad], then slides; it starts relaxed.
    """
    return (angle - follow_with_play(angle, wind_up)) / wind_up


def follow_with_play(angle: FloatArray, width: float) -> FloatArray:
    """Return an angle (samples,) that follows with play of this half width [rad]."""
    followed = np.empty(angle.size)
    _follow_with_play(angle, width, followed)
    return followed


@compiled
def _follow_with_play(angle: FloatArray, width: float, out: FloatArray) -> None:
    x = angle[0]
    for i in range(angle.size):
        x = min(max(x, angle[i] - width), angle[i] + width)
        out[i] = x


CHANGES = ("signals", "cables", "joint_arm", "motor_arm")
"""Methods that change a simulation, of which an effect has at least one."""


@dataclass(frozen=True)
class Size:
    """Size of an effect, which is off where all its sizes are 0.

    Attributes:
        name: name of the parameter.
        unit: SI unit.
        typical: size that is plausible on a rig, not 0; the scale of fits.
        meaning: meaning, for the report.
        low: least value of fits.
        high: largest value of fits.
        plausible: plausible range; an effect fitted beyond it is not named.
    """

    name: str
    unit: str
    typical: float
    meaning: str = ""
    low: float | None = None
    high: float | None = None
    plausible: tuple[float, float] = (-math.inf, math.inf)

    def described(self) -> EffectParameter:
        """Return the size as an `EffectParameter`, which fits use."""
        most = 1e4 * abs(self.typical)
        low = -most if self.low is None else self.low
        high = most if self.high is None else self.high
        if not (math.isfinite(self.typical) and self.typical != 0.0):
            raise CableError(
                f"size {self.name!r}: typical is {self.typical!r}; it must be a number "
                "other than 0"
            )
        if not (low <= 0.0 <= high and low < high):
            raise CableError(
                f"size {self.name!r}: its range is {low:g} to {high:g}; 0 is off and "
                "must be in it"
            )
        known = Parameter(self.name, self.unit, self.meaning or self.name, low, high)
        return EffectParameter(known, abs(self.typical), self.plausible)


@dataclass(frozen=True)
class Shape:
    """Parameter that shapes an effect, and is fitted from one or several values.

    Attributes:
        name: name of the parameter.
        unit: SI unit.
        starts: values from which it is fitted.
        low: least value of fits; where it is positive, the logarithm is fitted.
        high: largest value of fits.
        meaning: meaning, for the report.
        within: largest absolute value, over the joint's range of motion; an effect
            fitted beyond it is not named.
    """

    name: str
    unit: str
    starts: float | Sequence[float]
    low: float
    high: float
    meaning: str = ""
    within: float = math.inf

    @property
    def values(self) -> tuple[float, ...]:
        """Start values of the fit."""
        given = np.atleast_1d(np.asarray(self.starts, dtype=np.float64))
        return tuple(given.tolist())

    def described(self) -> EffectParameter:
        """Return the shape as an `EffectParameter`, which fits use."""
        values = self.values
        if not values or not all(self.low <= value <= self.high for value in values):
            raise CableError(
                f"shape {self.name!r}: its starts are {self.starts!r}; they must be in "
                f"[{self.low:g}, {self.high:g}]"
            )
        positive = self.low > 0.0
        scale: Any = "log" if positive else "linear"
        described = self.name, self.unit, self.meaning or self.name
        known = Parameter(*described, self.low, self.high, scale=scale)
        typical = values[0] if positive else 0.1 * (self.high - self.low)
        found = EffectParameter(known, typical, shape=not positive)
        if math.isfinite(self.within):
            found = found._replace(plausible=(-self.within, self.within), of="motion")
        return found


def effect_of_class(given: Any, rare: bool = False) -> Effect:
    """Return the effect that a class, or an object of one, describes.

    Args:
        given: the class, made without arguments, or an object.
        rare: True if it is searched on request, and where the other effects leave the
            error unexplained.

    Raises:
        EffectError: a method or an attribute is missing, unknown or wrong, or the
            code of the class raises.
    """
    kind = given if inspect.isclass(given) else type(given)
    in_words = re.sub("(?<=[a-z0-9])(?=[A-Z])", "_", kind.__name__).lower()
    name = getattr(given, "id", "") or in_words
    try:
        with user_errors(f"effect {name!r}"):
            return _effect(given() if inspect.isclass(given) else given, name, rare)
    except CableError as wrong:
        text = str(wrong)
        message = text if repr(name) in text else f"effect {name!r}: {text}"
        raise EffectError(message) from wrong


def _effect(made: Any, name: str, rare: bool) -> Effect:
    kind = type(made)
    if callable(getattr(made, "friction", None)):
        raise CableError(
            "a friction law as a function cannot be used, because the cable kernel is "
            "compiled with the terms of Cable and calls no other code; change Cable's "
            "friction parameters in `cables`, or add a torque in `signals`"
        )
    for method in vars(kind):
        public = not method.startswith("_") and inspect.isfunction(vars(kind)[method])
        if public and method not in _ARGUMENTS:
            raise CableError.unknown(f"method of effect {name!r}", method, _ARGUMENTS)
    if not callable(getattr(made, "parameters", None)):
        raise CableError("it has no method `parameters`, which lists Size and Shape")
    changes = [method for method in CHANGES if hasattr(made, method)]
    if not changes:
        raise CableError(
            f"it changes nothing; give it one of the methods {', '.join(CHANGES)}"
        )
    _require_arguments(made, name)
    needs = getattr(made, "needs", "")
    if not needs:
        raise CableError(
            "it does not say what a recording needs to show it; give the class a text "
            "`needs`, for example needs = 'joint speeds over a decade'"
        )
    sensor = bool(getattr(made, "sensor", False))
    usual: Place = "joint"
    if sensor or "cables" in changes:
        usual = "sensor" if sensor else "conduit"
    where: Place = getattr(made, "where", usual)
    if where not in get_args(Place):
        raise CableError.unknown("where", where, get_args(Place))
    parameters, starts = _parameters(made)
    forms = tuple(getattr(made, "forms", ()))
    if forms:
        every = itertools.product(starts, range(len(forms)))
        starts = tuple({**start, form_key(name): float(k)} for start, k in every)
    methods = (getattr(made, method, None) for method in (*CHANGES, "edit_spec"))
    signals, cables, joint_arm, motor_arm, editing = methods
    return Effect(
        id=name,
        title=getattr(made, "title", "") or _first_line(kind, name),
        equation=getattr(made, "equation", ""),
        where=where,
        parameters=parameters,
        starts=starts,
        required_excitation=needs,
        confounded_with=tuple(getattr(made, "confused_with", ())),
        scene_note=getattr(made, "scene_note", "")
        or ("as its class edits the scene" if editing else ""),
        source=getattr(made, "source", f"class {kind.__qualname__}"),
        cables=_guarded(name, cables, _check_cables),
        torques=_guarded(name, signals, _check_signals),
        joint_arm=_guarded(name, joint_arm, _check_arm),
        motor_arm=_guarded(name, motor_arm, _check_arm),
        edit_spec=_guarded(name, editing),
        sensor=sensor,
        columns=tuple(getattr(made, "columns", ())),
        by_trial=cables is not None,
        rare=rare,
        resembles=tuple(getattr(made, "resembles", ())),
        forms=forms,
        generalises=tuple(getattr(made, "generalises", ())),
    )


def _parameters(made: Any) -> tuple[tuple[EffectParameter, ...], tuple[Values, ...]]:
    listed = made.parameters()
    if not isinstance(listed, list | tuple) or not listed:
        raise CableError(
            f"`parameters` returned {listed!r}; it must be a list of Size and Shape"
        )
    if others := [each for each in listed if not isinstance(each, Size | Shape)]:
        raise CableError(
            f"`parameters` lists {others[0]!r}; entries must be Size or Shape"
        )
    if not any(isinstance(each, Size) for each in listed):
        raise CableError("`parameters` lists no Size, so nothing says where it is off")
    names = [each.name for each in listed]
    if twice := [name for name in names if names.count(name) > 1]:
        raise CableError(f"`parameters` lists {twice[0]!r} twice")
    described = tuple(each.described() for each in listed)
    choices = [e.values if isinstance(e, Shape) else (e.typical,) for e in listed]
    every = itertools.product(*choices)
    combined = [dict(zip(names, values, strict=True)) for values in every]
    most = 16
    if len(combined) > most:
        raise CableError(
            f"its shapes have {len(combined)} combinations of starts; at most {most} "
            "are tried"
        )
    return described, tuple(combined)


_ARGUMENTS = {
    "parameters": (),
    "signals": ("signals", "values"),
    "cables": ("cables", "values", "rig"),
    "joint_arm": ("values",),
    "motor_arm": ("values",),
    "edit_spec": ("spec", "bench", "values"),
}


def _require_arguments(made: Any, name: str) -> None:
    """Require that the methods of `made` take the arguments they are called with."""
    for method, arguments in _ARGUMENTS.items():
        called = getattr(made, method, None)
        if called is None:
            continue
        try:
            inspect.signature(called).bind(*arguments)
        except TypeError:
            wanted = ", ".join(("self", *arguments))
            code = getattr(inspect.unwrap(called), "__code__", None)
            at = f" in {code.co_filename}, line {code.co_firstlineno}" if code else ""
            raise CableError(
                f"method {method}{at} takes {inspect.signature(called)}; it must be "
                f"{method}({wanted})"
            ) from None


def _guarded(
    name: str,
    method: Callable[..., Any] | None,
    checked: Callable[..., Any] = lambda *_: None,
) -> Callable[..., Any] | None:
    """Return the method with errors that name its effect, and a check of its result."""
    if method is None:
        return None

    @wraps(method)
    def called(*given: Any) -> Any:
        try:
            with user_errors(f"effect {name!r}"):
                found = method(*given)
        except CableError as wrong:
            # A value that no cable accepts is no fault of the code.
            if isinstance(wrong.__cause__, Exception):
                raise EffectError(str(wrong)) from wrong.__cause__
            raise
        found = checked(found, method.__name__, *given)
        if isinstance(found, str):
            raise EffectError(f"effect {name!r}: {found}")
        return found

    return called


def _check_signals(found: Any, _: str, given: Signals, values: Values) -> Signals | str:
    if not isinstance(found, Signals):
        return (
            f"`signals` returned {type(found).__name__}; it must return the signals, "
            "for example signals.added(joint=...)"
        )
    for side in ("motor", "joint"):
        torque = np.asarray(getattr(found, side))
        if torque.shape != given.time.shape:
            return (
                f"the torque `{side}` has shape {torque.shape}; it must be "
                f"{given.time.shape}, one value a sample"
            )
        if not np.isfinite(torque).all():
            where = int(np.argmin(np.isfinite(torque)))
            known = [f"{key} {v:.4g}" for key, v in values.items() if v != 0.0]
            return (
                f"the torque `{side}` is {torque[where]} at {given.time[where]:.4g} s "
                f"with {', '.join(known[-4:]) or 'all sizes 0'}"
            )
    return found


def _check_cables(found: Any, _: str, given: Cables, *__: Any) -> Cables | str:
    if (
        not isinstance(found, list | tuple)
        or len(found) != len(given)
        or not all(isinstance(each, Cable) for each in found)
    ):
        return (
            f"`cables` must return as many cables as it is given, {len(given)}, not "
            f"{found!r:.80}"
        )
    return tuple(found)


def _check_arm(found: Any, method: str, _: Values) -> tuple[float, ...] | str:
    found = np.atleast_1d(np.asarray(found, dtype=np.float64))
    if found.ndim != 1 or not np.isfinite(found).all():
        return (
            f"`{method}` must return finite coefficients of q, q^2, ..., not "
            f"{found!r:.80}"
        )
    return tuple(found.tolist())


def _first_line(kind: type, name: str) -> str:
    line = (inspect.getdoc(kind) or "").partition("\n")[0].rstrip(".")
    if not line:
        return name.replace("_", " ")
    return line[0].lower() + line[1:] if line[1:2].islower() else line
