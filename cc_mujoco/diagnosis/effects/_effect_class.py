"""Effects written as a class: the user's own, and rare ones of the library.

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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, get_args

import numpy as np

from cc_mujoco._utils.user_code import user_errors
from cc_mujoco.cable import Cable, Parameter
from cc_mujoco.diagnosis.effects._effect import (
    PLUGIN_KEYS,
    Cables,
    Effect,
    EffectError,
    EffectParameter,
    Place,
    Signals,
    Values,
    form_key,
)
from cc_mujoco.errors import CableError

CHANGES = ("signals", "cables", "joint_arm", "motor_arm")
"""Methods that change a simulation, of which an effect has at least one."""
_METHODS = ("parameters", *CHANGES, "edit_spec")
_BOUND = 1e4
"""Bound of a size that has none, over its typical value."""
_MAX_STARTS = 16
_PLACES = get_args(Place)


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
        plausible: range of the effect; one that fits only beyond is not named.
    """

    name: str
    unit: str
    typical: float
    meaning: str = ""
    low: float | None = None
    high: float | None = None
    plausible: tuple[float, float] = (-math.inf, math.inf)

    def described(self) -> EffectParameter:
        """Return the parameter as fits have it."""
        most = _BOUND * abs(self.typical)
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
        within: largest value to either side, over the joint's range of motion; what
            fits beyond is not named.
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
        """Return the parameter as fits have it."""
        values = self.values
        if not values or not all(self.low <= value <= self.high for value in values):
            raise CableError(
                f"shape {self.name!r}: its starts are {self.starts!r}; they must be in "
                f"[{self.low:g}, {self.high:g}]"
            )
        positive = self.low > 0.0
        known = Parameter(
            self.name,
            self.unit,
            self.meaning or self.name,
            self.low,
            self.high,
            scale="log" if positive else "linear",
        )
        typical = values[0] if positive else 0.1 * (self.high - self.low)
        found = EffectParameter(known, typical, shape=not positive)
        if math.isfinite(self.within):
            found = found._replace(plausible=(-self.within, self.within), of="motion")
        return found


def effect_of_class(given: Any, rare: bool = False) -> Effect:
    """Return the effect that a class, or an object of one, describes.

    Args:
        given: the class; made without arguments.
        rare: True if it is searched on request, and where the other effects leave the
            error unexplained.

    Raises:
        EffectError: a method or an attribute is missing, unknown or wrong, or the
            code of the class raises.
    """
    kind = given if inspect.isclass(given) else type(given)
    name = getattr(given, "id", "") or _snake_case(kind.__name__)
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
        if public and method not in _METHODS:
            raise CableError.unknown(f"method of effect {name!r}", method, _METHODS)
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
    if where not in _PLACES:
        raise CableError.unknown("where", where, _PLACES)
    parameters, starts = _parameters(made)
    forms = tuple(getattr(made, "forms", ()))
    if forms:
        starts = tuple(
            {**start, form_key(name): float(k)}
            for start in starts
            for k in range(len(forms))
        )
    signals, cables, joint_arm, motor_arm, editing = (
        getattr(made, method, None) for method in (*CHANGES, "edit_spec")
    )
    in_keys = changes == ["cables"]
    return Effect(
        id=name,
        title=getattr(made, "title", "") or _first_line(kind, name),
        equation=getattr(made, "equation", ""),
        where=where,
        parameters=parameters,
        starts=starts,
        required_excitation=needs,
        confounded_with=tuple(getattr(made, "confused_with", ())),
        mujoco=getattr(made, "scene_note", "")
        or (PLUGIN_KEYS if in_keys else "as its class edits the scene")
        if editing or in_keys
        else "",
        source=getattr(made, "source", f"class {kind.__qualname__}"),
        cables=_guarded(name, cables, _checked_cables),
        torques=_guarded(name, signals, _checked_signals),
        joint_arm=_guarded(name, joint_arm, _checked_arm),
        motor_arm=_guarded(name, motor_arm, _checked_arm),
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
    if len(combined) > _MAX_STARTS:
        raise CableError(
            f"its shapes have {len(combined)} combinations of starts; at most "
            f"{_MAX_STARTS} are tried"
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
    """Refuse methods that cannot be called with their arguments."""
    for method, arguments in _ARGUMENTS.items():
        called = getattr(made, method, None)
        if called is None:
            continue
        try:
            inspect.signature(called).bind(*arguments)
        except TypeError:
            wanted = ", ".join(("self", *arguments))
            code = getattr(inspect.unwrap(called), "__code__", None)
            place = (
                f" in {code.co_filename}, line {code.co_firstlineno}" if code else ""
            )
            raise CableError(
                f"method {method}{place} takes {inspect.signature(called)}; it must be "
                f"{method}({wanted})"
            ) from None


def _guarded(
    name: str,
    method: Callable[..., Any] | None,
    checked: Callable[..., Any] = lambda *_: None,
) -> Callable[..., Any] | None:
    """Return the method with errors that name the effect, the file and the line.

    `checked` returns its result, or says in words what it must return.
    """
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


def _checked_signals(
    found: Any, _: str, given: Signals, values: Values
) -> Signals | str:
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


def _checked_cables(found: Any, _: str, given: Cables, *__: Any) -> Cables | str:
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


def _checked_arm(found: Any, method: str, _: Values) -> tuple[float, ...] | str:
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


def _snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
