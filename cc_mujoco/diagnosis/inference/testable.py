"""Limits of these data: effects too small to show, and those that tuning hides.

What an effect of a size that is plausible on the rig changes of the torques is compared
with the noise, and with what each parameter of the accepted model changes. Where the
freedom of one parameter makes the effect vanish, the two are confounded; and where that
parameter was tuned further from the scene than is known of it, the effect may be why.
How far the model still is from the data does not enter: what is missing is no noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EFFECTS, Effect
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.inference.jacobian import jacobian
from cc_mujoco.diagnosis.inference.plant import CLOCKS, OFFSETS, PRETENSION_KNOWN
from cc_mujoco.diagnosis.inference.plausibility import plausible_size
from cc_mujoco.diagnosis.inference.screen import (
    Changes,
    amplitudes,
    changes_by_effects,
)
from cc_mujoco.diagnosis.verdict import Confounded, NotTestable, Strayed
from cc_mujoco.diagnosis.wording import number, plain
from cc_mujoco.estimation.least_squares import Estimate, Tuned
from cc_mujoco.page import listed

SEEN = 3.0
"""Size over its uncertainty with which a planned trial would show an effect."""
SHOWN = 0.1
"""Squared RMS change over the noise floor with which a plausible effect would show: at
the floor it then takes so much of the error as effects are named for."""
FAR = 3.0
"""Standard deviations of what is known from which on a tuned parameter has strayed."""
GUESSED = {"friction": 0.4, "axial_stiffness": 0.4}
"""Standard deviation of the logarithm of what a scene says and nobody has declared."""
ZERO_KNOWN = 0.03
"""Standard deviation of the joint's zero where the arm of the cable hangs on it [rad]:
on a pulley any zero does."""
_ALIKE = 0.25
"""Difference of logarithms by which a stiffness may miss that of a wrong unit."""
CLEAR = 5.0
"""How much more clearly than it takes a hidden effect would show without tuning."""
LARGEST = 30.0
"""Most of its plausible size that an effect may be taken to have."""

REMEDY = {
    "pretension": "declare a measured pretension ([rig] pretension with its "
    "uncertainty), or record trials at a second pretension and declare both",
    "friction": "declare friction that was measured another way ([rig] friction with "
    "its uncertainty), or record other loads",
    "axial_stiffness": "declare a measured stiffness ([rig] axial_stiffness with its "
    "uncertainty), or record the joint locked",
    "friction_balance": "pull each cable by itself, the other one slack, and compare "
    "their friction",
    "motor_radius": "measure the motor's pulley and declare it ([rig] motor_radius)",
    "joint_radius": "measure the joint's pulley and declare it ([rig] joint_radius)",
    "motor_torque_offset": "read the motor's torque sensor without any load and "
    "declare the offset of its column",
    "joint_torque_offset": "read the joint's torque sensor without any load and "
    "declare the offset of its column",
    "joint_angle_offset": "record where both cables pull alike, and declare the offset "
    "of the joint's angle",
    "load_stiffness": "measure the spring by itself and declare it more exactly ([rig] "
    "load_stiffness with its uncertainty), or measure the joint's torque",
    "load_rest_angle": "record the joint where its spring is at rest, and declare that "
    "angle ([rig] load_rest_angle)",
    "load_inertia": "declare the inertia of the load more exactly ([rig] "
    "load_inertia), or measure the joint's torque",
    "load_damping": "declare the damping of the load more exactly ([rig] "
    "load_damping), or measure the joint's torque",
    "load_weight": "weigh the load and declare it more exactly ([rig] load_weight), or "
    "measure the joint's torque",
    "torque_constant": "measure the motor's torque constant and declare it more "
    "exactly, or measure the torque behind motor and gear",
    "motor_friction": "a current shows the motor's own friction as well: measure the "
    "torque behind motor and gear, or the tension of the cable there",
    "motor_damping": "a current shows the drag of motor and gear as well: measure the "
    "torque behind them, or the tension of the cable there",
    "clock_offset": "record all channels by one clock, or declare the delay of each",
    "motor_torque_late": "declare the delay of the motor's torque sensor",
    "joint_torque_late": "declare the delay of the joint's torque sensor",
}
"""What tells a parameter of the baseline from the effects it can stand for."""

ZERO_REMEDY = (
    "the arm of the cable hangs on that angle, so let motor and joint read 0 where the "
    "scene's are, and declare the offset of the column that does not"
)
"""What to do where the zero of a joint strayed that a cable pulls by a lever."""


class EffectChange(NamedTuple):
    """Torque changes due to plausible sizes of an effect.

    Attributes:
        effect: of the library.
        sizes: plausible on the rig, by name of the parameter.
        made: (residuals, sizes) change over the noise floor, nothing retuned; its
            length is the RMS.
    """

    effect: Effect
    sizes: Mapping[str, float]
    made: FloatArray


class Testability(NamedTuple):
    """Evidence in the data for effects that the accepted model has not.

    Attributes:
        problem: the model by the noise of the sensors alone.
        x: where it was fitted.
        slopes: (residuals, parameters) changes by each parameter, in the same unit.
        tangent: (residuals, k) orthonormal, of what tuning can do.
        changes: by effects.
    """

    problem: Problem
    x: FloatArray
    slopes: FloatArray
    tangent: FloatArray
    changes: tuple[EffectChange, ...]

    def left(self, change: FloatArray) -> FloatArray:
        """Compute what tuning leaves of changes (residuals, ...)."""
        found: FloatArray = change - self.tangent @ (self.tangent.T @ change)
        return found


def reach(
    problem: Problem, x: FloatArray, ids: Sequence[str], known: Changes
) -> Testability:
    """Compute what the data show of effects, by the accepted model and the noise.

    Args:
        problem: the model.
        x: where it was fitted.
        ids: of effects that it has not.
        known: changes kept from the search.
    """
    records = problem.plant.records
    masks = [record.free for record in records]
    # Torques are compared up to a band: so many of the samples are independent.
    sizes = np.array([int(mask.sum()) for mask in masks])
    shares = np.array([min(1.0, 2.0 * r.band * r.dt) for r in records])
    quiet = replace(
        problem,
        floor=tuple(floor / problem.inflation for floor in problem.floor),
        inflation=1.0,
        weight=float(np.sqrt(np.sum(shares * sizes) / np.sum(sizes))),
    )
    rows = len(records[0].measured)
    scale = quiet.weight * math.sqrt(rows * int(np.sum(sizes)))
    slopes = jacobian(quiet, x, masks, explained=True) / scale
    size = np.linalg.norm(slopes, axis=0)
    tangent, _ = np.linalg.qr(slopes[:, size > 0.0] / size[size > 0.0])
    made = changes_by_effects(quiet, x, masks, ids, known)
    changes = []
    for name, columns in made.items():
        effect = problem.plant.library.effects[name]
        parameters = amplitudes(effect)
        plausible = {p.name: plausible_size(p, problem, x) for p in parameters}
        factors = np.array([plausible[p.name] / p.typical for p in parameters])
        changes.append(EffectChange(effect, plausible, columns * factors / scale))
    return Testability(quiet, x, slopes, tangent, tuple(changes))


def confounded(shown: Testability) -> tuple[Confounded, ...]:
    """List effects that would show but for the freedom of the model's parameters.

    Of an effect with several sizes it is the mixture that tuning hides best.
    """
    size = np.linalg.norm(shown.slopes, axis=0)
    free = np.flatnonzero(size > 0.0)
    scaled = shown.slopes[:, free] / size[free]
    found = []
    for each in shown.changes:
        if not each.made.any():
            continue
        mix = _hidden(each.made, shown.tangent)
        change = each.made @ mix
        least = math.sqrt(SHOWN)
        if float(np.linalg.norm(shown.left(change))) > least:
            continue
        if float(np.linalg.norm(change)) < CLEAR * least:
            continue
        shifts = np.linalg.lstsq(scaled, change)[0]
        most = int(np.argmax(np.abs(shifts)))
        shift, index = float(shifts[most] / size[free[most]]), int(free[most])
        parameter, place = shown.problem.tuned[index], float(shown.x[index])
        found.append(_confounded(each, mix, parameter, shift, place))
    return tuple(found)


def _hidden(changes: FloatArray, tangent: FloatArray) -> FloatArray:
    """Sizes (amplitudes,), the largest 1, of which tuning leaves the least."""
    lengths = np.linalg.norm(changes, axis=0)
    lengths[lengths == 0.0] = 1.0
    plain = changes / lengths
    left = plain - tangent @ (tangent.T @ plain)
    values, axes = np.linalg.eigh(plain.T @ plain)
    kept = values > 1e-9 * values[-1]
    white = axes[:, kept] / np.sqrt(values[kept])
    _, vectors = np.linalg.eigh(white.T @ (left.T @ left) @ white)
    mix = (white @ vectors[:, 0]) / lengths
    found: FloatArray = mix / mix[np.argmax(np.abs(mix))]
    return found


def _confounded(
    change: EffectChange, mix: FloatArray, parameter: Tuned, shift: float, place: float
) -> Confounded:
    first = amplitudes(change.effect)[int(np.argmax(np.abs(mix)))]
    size = change.sizes[first.name]
    told = (
        f"{_size(first.name, size, first.unit)} looks like "
        f"{plain(parameter.name)} {_value(parameter, shift)} in place of "
        f"{_value(parameter, 0.0)}"
    )
    share = place / shift if shift else math.inf
    possible = (0.0 if first.parameter.low == 0.0 else -LARGEST) < share < LARGEST
    explains = ""
    if possible and abs(place) > FAR * parameter.prior:
        explains = f"about {_size(first.name, share * size, first.unit)}"
    remedy = _remedy(parameter.name, change.effect)
    return Confounded(change.effect.id, parameter.name, told, explains, remedy)


def _remedy(parameter: str, effect: Effect) -> str:
    """Return what tells an effect from a parameter of the model."""
    # Parameters of effects that are in the model have none of their own.
    return REMEDY.get(parameter, f"record {effect.required_excitation}")


def strayed(
    problem: Problem,
    x: FloatArray,
    estimated: Mapping[str, Estimate],
    hidden: Sequence[Confounded],
) -> tuple[Strayed, ...]:
    """Parameters that were tuned further from the scene than is known of it.

    Args:
        problem: the model.
        x: where it was fitted.
        estimated: its parameters.
        hidden: effects that tuning would hide.
    """
    found = []
    for parameter, place in zip(problem.tuned, x.tolist(), strict=True):
        name = parameter.name
        known = parameter.prior
        if not math.isfinite(known) and name in GUESSED:
            known = GUESSED[name] / parameter.scale
        home = 0.0  # place of what is given
        if name == "joint_angle_offset" and problem.plant.bench.lever is not None:
            known = ZERO_KNOWN / parameter.scale
            home = -parameter.start / parameter.scale
        if name in (*OFFSETS, *CLOCKS) or not math.isfinite(known):
            continue
        apart = abs(place - home) / known
        given = parameter.value(home)
        if (scene := problem.plant.given.get(name)) is not None:
            if name == "pretension":  # a fit that replaces it believes in nothing
                known = PRETENSION_KNOWN / parameter.scale
            given, apart = scene, _far(parameter, place, scene) / known
        if apart < FAR or estimated[name].holds(given):
            continue
        others = [
            f"{EFFECTS[each.id].title} ({each.explains})"
            for each in hidden
            if each.parameter == name and each.explains
        ]
        told = (
            f"{plain(name)} had to be tuned to {_value(parameter, place)}, where "
            f"{_of(given, parameter)} is given: either it is so"
        )
        if name == "axial_stiffness" and (
            unit := _misread(parameter.value(place) / given)
        ):
            told += f", or angles in {unit} were taken for another unit"
        if others:
            told += f", or these data hide {listed(others, 'or')}"
        else:
            told += ", or something that is not in the model looks like it"
        remedy = ZERO_REMEDY if name == "joint_angle_offset" else REMEDY[name]
        found.append(Strayed(name, given, estimated[name], apart, f"{told}; {remedy}."))
    return tuple(found)


def _far(parameter: Tuned, place: float, given: float) -> float:
    """Return how far a place is from a value of the scene, which may be 0 [scales]."""
    if given <= 0.0:
        return math.inf
    return abs(math.log(parameter.value(place) / given)) / parameter.scale


def untestable(
    shown: Testability, hidden: Sequence[Confounded]
) -> tuple[NotTestable, ...]:
    """List effects that would not show at a plausible size, whatever hides them."""
    confused = {each.id: each for each in hidden}
    able = shown.problem.plant.library
    found = [NotTestable(name, why) for name, why in able.hidden.items()]
    for each in shown.changes:
        left = np.linalg.norm(shown.left(each.made), axis=0)
        most = int(np.argmax(left))
        if float(left[most]) ** 2 >= SHOWN:
            continue
        size = amplitudes(each.effect)[most]
        plausible = _size(size.name, each.sizes[size.name], size.unit)
        told = f"once all is tuned, a plausible size ({plausible}) would change the "
        told += f"torques by {float(left[most]):.2f} times the noise floor only; "
        if other := confused.get(each.effect.id):
            told += f"tuning {plain(other.parameter)} hides it: {other.remedy}"
        else:
            told += f"it takes {each.effect.required_excitation}"
        found.append(NotTestable(each.effect.id, told))
    return tuple(found)


def _misread(ratio: float) -> str:
    """Unit of angles that makes a cable so many times as stiff or soft; else ""."""
    size = abs(math.log(max(ratio, 1e-300)))
    for unit, factor in (
        ("degrees or radians", math.degrees(1.0)),
        ("turns", math.tau),
    ):
        if abs(size - math.log(factor)) < _ALIKE:
            return unit
    return ""


def _size(name: str, value: float, unit: str) -> str:
    return f"{plain(name)} {number(value)} {unit}".removesuffix(" 1")


def _value(parameter: Tuned, place: float) -> str:
    return _of(parameter.value(place), parameter)


def _of(value: float, parameter: Tuned) -> str:
    told = number(value) if value else "0"
    return f"{told} {parameter.unit}".removesuffix(" 1")
