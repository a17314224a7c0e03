"""What these data cannot tell: effects too small to show, and those that tuning hides.

What an effect changes of the torques is compared with what each parameter of the
baseline changes. Where the freedom of one parameter makes the effect vanish, the two
are confounded; and where that parameter was tuned further from the scene than is known
of it, the effect may be why.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EFFECTS, Effect
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.inference.jacobian import jacobian
from cc_mujoco.diagnosis.inference.plant import CLOCKS, OFFSETS
from cc_mujoco.diagnosis.inference.screen import Signature, amplitudes
from cc_mujoco.diagnosis.verdict import Confounded, NotTestable, Strayed
from cc_mujoco.diagnosis.wording import number, plain
from cc_mujoco.estimation.least_squares import Estimate, Tuned
from cc_mujoco.page import listed

SEEN = 3.0
"""Size over its uncertainty with which a plausible effect would show."""
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


def independent(problem: Problem) -> float:
    """Number of independent samples, by which errors average out."""
    size = sum(r.measured[:, r.free].size for r in problem.plant.records)
    return max(size * problem.weight**2, 1.0)


def confounded(
    problem: Problem, x: FloatArray, signatures: Sequence[Signature]
) -> tuple[Confounded, ...]:
    """Effects that would show but for the freedom of the baseline's parameters.

    Of an effect with several sizes it is the mixture that tuning hides best.

    Args:
        problem: the baseline, on whose free samples the signatures were taken.
        x: where it was fitted.
        signatures: of the effects.
    """
    masks = [record.free for record in problem.plant.records]
    slopes = jacobian(problem, x, masks)
    size = np.linalg.norm(slopes, axis=0)
    free = np.flatnonzero(size > 0.0)
    scaled = slopes[:, free] / size[free]
    tangent, _ = np.linalg.qr(scaled)
    found = []
    for sign in signatures:
        if not sign.changes.any():
            continue
        mix = _hidden(sign.changes, tangent)
        change = sign.changes @ mix
        left = float(np.linalg.norm(change - tangent @ (tangent.T @ change)))
        if left > SEEN or float(np.linalg.norm(change)) < CLEAR * SEEN:
            continue
        shifts = np.linalg.lstsq(scaled, change)[0]
        most = int(np.argmax(np.abs(shifts)))
        shift, index = float(shifts[most] / size[free[most]]), int(free[most])
        place = float(x[index])
        effect = problem.plant.library.effects[sign.id]
        found.append(_confounded(effect, mix, problem.tuned[index], shift, place))
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
    effect: Effect, mix: FloatArray, parameter: Tuned, shift: float, place: float
) -> Confounded:
    first = amplitudes(effect)[int(np.argmax(np.abs(mix)))]
    told = (
        f"{_size(first.name, first.typical, first.unit)} looks like "
        f"{plain(parameter.name)} {_value(parameter, shift)} in place of "
        f"{_value(parameter, 0.0)}"
    )
    share = place / shift if shift else math.inf
    possible = (0.0 if first.low == 0.0 else -LARGEST) < share < LARGEST
    explains = ""
    if possible and abs(place) > FAR * parameter.prior:
        explains = f"about {_size(first.name, share * first.typical, first.unit)}"
    remedy = REMEDY[parameter.name]
    return Confounded(effect.id, parameter.name, told, explains, remedy)


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
    signatures: Sequence[Signature], problem: Problem, hidden: Sequence[Confounded]
) -> tuple[NotTestable, ...]:
    """Effects that would not show at a plausible size, whatever hides them."""
    scale = math.sqrt(independent(problem))
    confused = {each.id: each for each in hidden}
    able = problem.plant.library
    found = [NotTestable(name, why) for name, why in able.hidden.items()]
    for sign in signatures:
        clarity = sign.visible * scale
        if clarity >= SEEN:
            continue
        first = problem.plant.library.effects[sign.id].parameters[0]
        typical = _size(first.name, first.typical, first.unit)
        told = f"a plausible size ({typical}) would stand out by "
        told += f"{number(clarity, 1.0)} standard deviations only; "
        if each := confused.get(sign.id):
            told += f"tuning {plain(each.parameter)} hides it: {each.remedy}"
        else:
            told += f"it takes {EFFECTS[sign.id].required_excitation}"
        found.append(NotTestable(sign.id, told))
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
