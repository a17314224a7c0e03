"""Identifiability: effects too small to show, and effects that tuning hides.

The torque change by an effect of plausible size is compared with the noise and with the
change by each parameter of the accepted model. If tuning of one parameter cancels the
effect, the two are confounded. If that parameter was tuned farther from the scene than
its uncertainty allows, the effect is a possible cause. The remaining model error is not
counted as noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.fitting import Problem, jacobian
from cc_mujoco.diagnosis._fit.plausibility import plausible_size
from cc_mujoco.diagnosis._phrases import format_number, plain_name
from cc_mujoco.diagnosis._rig.bench_simulation import CLOCK_PARAMETERS, TORQUE_OFFSETS
from cc_mujoco.diagnosis._rig.occasions import base_name, is_change
from cc_mujoco.diagnosis._search.screening import (
    Changes,
    changes_by_effects,
    effect_amplitudes,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Confounded, Deviating, NotTestable
from cc_mujoco.diagnosis.effects import EFFECTS, Effect
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

GUESSED_DEVIATIONS = {"friction": 0.4, "axial_stiffness": 0.4}
"""Standard deviation of the logarithm of a value of the scene that is not declared."""

REMEDIES = {
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
    "joint_angle_offset": "record where both cables pull equally, and declare the "
    "offset of the joint's angle",
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
    "motor_wind_up": "a current shows the wind-up of motor and gear as well: measure "
    "the torque behind them, or the tension of the cable there",
    "motor_damping": "a current shows the drag of motor and gear as well: measure the "
    "torque behind them, or the tension of the cable there",
    "clock_offset": "record all channels by one clock, or declare the delay of each",
    "motor_torque_late": "declare the delay of the motor's torque sensor",
    "joint_torque_late": "declare the delay of the joint's torque sensor",
}
"""Advice to distinguish a baseline parameter from the effects it can stand for."""

ZERO_REMEDY = (
    "the arm of the cable hangs on that angle, so let motor and joint read 0 where the "
    "scene's are, and declare the offset of the column that does not"
)
"""Advice if the tuned zero of a joint with a lever is far from its prior."""


class EffectChange(NamedTuple):
    """Torque changes due to plausible sizes of an effect.

    Attributes:
        effect: effect of the library.
        sizes: plausible sizes on the rig, by name of the parameter.
        made: (residuals, sizes) change over the noise floor without retuning; its
            length is the RMS.
    """

    effect: Effect
    sizes: Mapping[str, float]
    made: FloatArray


class Testability(NamedTuple):
    """Evidence in the data for effects that the accepted model has not.

    Attributes:
        problem: model with the noise of the sensors as its floor.
        x: fitted parameters.
        slopes: (residuals, parameters) changes by each parameter, over the noise floor.
        tangent: (residuals, k) orthonormal basis of the changes by tuning.
        changes: changes by effects.
    """

    problem: Problem
    x: FloatArray
    slopes: FloatArray
    tangent: FloatArray
    changes: tuple[EffectChange, ...]

    def left(self, change: FloatArray) -> FloatArray:
        """Compute the part of changes that tuning cannot explain (residuals, ...)."""
        found: FloatArray = change - self.tangent @ (self.tangent.T @ change)
        return found


def detectability(
    problem: Problem, x: FloatArray, ids: Sequence[str], known: Changes
) -> Testability:
    """Compute by the accepted model and the noise what the data show of effects."""
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
        parameters = effect_amplitudes(effect)
        plausible = {p.name: plausible_size(p, problem, x) for p in parameters}
        factors = np.array([plausible[p.name] / p.typical for p in parameters])
        changes.append(EffectChange(effect, plausible, columns * factors / scale))
    return Testability(quiet, x, slopes, tangent, tuple(changes))


def confounded_effects(shown: Testability) -> tuple[Confounded, ...]:
    """Return effects that would show but for the freedom of the model's parameters.

    An effect with several amplitudes is judged by the mixture that tuning hides best.
    """
    size = np.linalg.norm(shown.slopes, axis=0)
    free = np.flatnonzero(size > 0.0)
    scaled = shown.slopes[:, free] / size[free]
    found = []
    for each in shown.changes:
        if not each.made.any():
            continue
        mix = _best_hidden_mix(each.made, shown.tangent)
        change = each.made @ mix
        least = math.sqrt(Limit.min_visible_change)
        if float(np.linalg.norm(shown.left(change))) > least:
            continue
        if float(np.linalg.norm(change)) < Limit.hidden_clarity * least:
            continue
        shifts = np.linalg.lstsq(scaled, change)[0]
        most = int(np.argmax(np.abs(shifts)))
        shift, index = float(shifts[most] / size[free[most]]), int(free[most])
        parameter, place = shown.problem.tuned[index], float(shown.x[index])
        found.append(_confounded_effect(each, mix, parameter, shift, place))
    return tuple(found)


def _best_hidden_mix(changes: FloatArray, tangent: FloatArray) -> FloatArray:
    """Return the amplitudes (k,), the largest 1, that tuning absorbs best."""
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


def _confounded_effect(
    change: EffectChange, mix: FloatArray, parameter: Tuned, shift: float, place: float
) -> Confounded:
    first = effect_amplitudes(change.effect)[int(np.argmax(np.abs(mix)))]
    size = change.sizes[first.name]
    statement = (
        f"{_size_text(first.name, size, first.unit)} looks like "
        f"{plain_name(parameter.name)} {_value_text(parameter, shift)} in place of "
        f"{_value_text(parameter, 0.0)}"
    )
    share = place / shift if shift else math.inf
    possible = (
        (0.0 if first.parameter.low == 0.0 else -Limit.max_size_ratio)
        < share
        < Limit.max_size_ratio
    )
    explains = ""
    if possible and abs(place) > Limit.max_prior_sigmas * parameter.prior:
        explains = f"about {_size_text(first.name, share * size, first.unit)}"
    remedy = _remedy(parameter.name, change.effect)
    return Confounded(change.effect.id, parameter.name, statement, explains, remedy)


def _remedy(parameter: str, effect: Effect) -> str:
    # Parameters of effects that are in the model have none of their own.
    return REMEDIES.get(base_name(parameter), f"record {effect.required_excitation}")


def deviating_parameters(
    problem: Problem,
    x: FloatArray,
    estimated: Mapping[str, Estimate],
    hidden: Sequence[Confounded],
) -> tuple[Deviating, ...]:
    """Return the parameters tuned further from the scene than is known of it."""
    found = []
    for parameter, place in zip(problem.tuned, x.tolist(), strict=True):
        name = parameter.name
        known = parameter.prior
        if not math.isfinite(known) and name in GUESSED_DEVIATIONS:
            known = GUESSED_DEVIATIONS[name] / parameter.scale
        home = 0.0  # place of what is given
        if name == "joint_angle_offset" and problem.plant.bench.lever is not None:
            known = Limit.zero_angle_deviation / parameter.scale
            home = -parameter.start / parameter.scale
        if name in (*TORQUE_OFFSETS, *CLOCK_PARAMETERS) or not math.isfinite(known):
            continue
        if is_change(name) or name == "motor_wind_up":  # reported as such; never given
            continue
        deviation = abs(place - home) / known
        given = parameter.value(home)
        if (scene := problem.plant.given.get(name)) is not None:
            if name == "pretension":  # a fit that replaces it believes in nothing
                known = Limit.pretension_deviation / parameter.scale
            given, deviation = scene, _prior_distance(parameter, place, scene) / known
        if deviation < Limit.max_prior_sigmas or estimated[name].holds(given):
            continue
        others = [
            f"{EFFECTS[each.id].title} ({each.explains})"
            for each in hidden
            if each.parameter == name and each.explains
        ]
        statement = (
            f"{plain_name(name)} had to be tuned to {_value_text(parameter, place)}, "
            f"where {_with_unit(given, parameter)} is given: either it is so"
        )
        if name == "axial_stiffness" and (
            unit := _suspected_unit(parameter.value(place) / given)
        ):
            statement += f", or angles in {unit} were taken for another unit"
        if others:
            statement += f", or these data hide {list_words(others, 'or')}"
        else:
            statement += ", or something that is not in the model looks like it"
        remedy = ZERO_REMEDY if name == "joint_angle_offset" else REMEDIES[name]
        found.append(
            Deviating(
                name, given, estimated[name], deviation, f"{statement}; {remedy}."
            )
        )
    return tuple(found)


def _prior_distance(parameter: Tuned, place: float, given: float) -> float:
    """Return the distance of a place from the scene's value, perhaps 0 [scales]."""
    if given <= 0.0:
        return math.inf
    return abs(math.log(parameter.value(place) / given)) / parameter.scale


def untestable_effects(
    shown: Testability, hidden: Sequence[Confounded]
) -> tuple[NotTestable, ...]:
    """Return effects that are not detectable at a plausible size, with the reason."""
    confused = {each.id: each for each in hidden}
    able = shown.problem.plant.library
    found = [
        NotTestable(name, why)
        for name, why in able.hidden.items()
        if not EFFECTS[name].rare
    ]
    for each in shown.changes:
        left = np.linalg.norm(shown.left(each.made), axis=0)
        most = int(np.argmax(left))
        if float(left[most]) ** 2 >= Limit.min_visible_change:
            continue
        size = effect_amplitudes(each.effect)[most]
        plausible = _size_text(size.name, each.sizes[size.name], size.unit)
        statement = (
            f"once all is tuned, a plausible size ({plausible}) would change the "
        )
        statement += f"torques by {float(left[most]):.2f} times the noise floor only; "
        if other := confused.get(each.effect.id):
            statement += (
                f"tuning {plain_name(other.parameter)} hides it: {other.remedy}"
            )
        else:
            statement += f"it shows only with {each.effect.required_excitation}"
        found.append(NotTestable(each.effect.id, statement))
    return tuple(found)


def _suspected_unit(ratio: float) -> str:
    """Return the angle units whose confusion explains a stiffness ratio, or ""."""
    size = abs(math.log(max(ratio, 1e-300)))
    for unit, factor in (
        ("degrees or radians", math.degrees(1.0)),
        ("turns", math.tau),
    ):
        if abs(size - math.log(factor)) < Limit.unit_tolerance:
            return unit
    return ""


def _size_text(name: str, value: float, unit: str) -> str:
    return f"{plain_name(name)} {format_number(value)} {unit}".removesuffix(" 1")


def _value_text(parameter: Tuned, place: float) -> str:
    return _with_unit(parameter.value(place), parameter)


def _with_unit(value: float, parameter: Tuned) -> str:
    text = format_number(value) if value else "0"
    return f"{text} {parameter.unit}".removesuffix(" 1")
