"""Changes between occasions, and the size of every effect on each of them.

An effect that is part of the mechanism has one size on all occasions; an error of form
that it stands in for changes with load, pose and pretension. So the size of every
accepted effect is fitted to each occasion by itself while all other parameters are
shared. An occasion could show the effect if the standard error there is below a third
of the shared size, and shows it if 95 % of its size is on the same side of 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.plausibility import amplitude_indices
from cc_mujoco.diagnosis._fit.trial_constants import (
    TrialConstants,
    constants_by_occasion,
)
from cc_mujoco.diagnosis._phrases import format_fitted, format_number, plain_name
from cc_mujoco.diagnosis._rig.occasions import (
    base_name,
    change_name,
    is_change,
    occasions_of,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import OccasionChange, Occasions, OccasionSize
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

_REPORTED = ("friction", "pretension", "axial_stiffness", "friction_balance")
"""Parameters whose changes say something about the rig, in the order of reports."""


def compare_occasions(
    problem: Problem, x: FloatArray, estimated: Mapping[str, Estimate]
) -> Occasions | None:
    """Return the comparison of the occasions; None where there is one."""
    names = occasions_of(problem.plant.records)
    if len(names) < 2:
        return None
    changes = _changes(problem, names, estimated)
    recent = [each for each in changes if each.until == names[-1]]
    return Occasions(
        names, tuple(changes), tuple(_sizes(problem, x)), _statement(recent, names)
    )


def agreement_shares(compared: Occasions) -> dict[str, float]:
    """Return the share of the sizes of each effect on which all occasions agree."""
    by_effect: dict[str, list[bool]] = {}
    for each in compared.sizes:
        by_effect.setdefault(each.effect, []).append(each.agree)
    return {name: sum(own) / len(own) for name, own in by_effect.items()}


def _changes(
    problem: Problem, names: Sequence[str], estimated: Mapping[str, Estimate]
) -> list[OccasionChange]:
    """Return the changes from every earlier occasion to the last."""
    tuned = {parameter.name: parameter for parameter in problem.tuned}
    found = []
    for since in reversed(names[:-1]):
        for base in (*_REPORTED, *(n for n in tuned if n not in _REPORTED)):
            name = change_name(base, since)
            if name in tuned and not is_change(base):
                change, words = describe_change(tuned[name], estimated[name])
                factor = tuned[name].factor
                found.append(
                    OccasionChange(base, since, names[-1], change, factor, words)
                )
    return found


def describe_change(tuned: Tuned, earlier: Estimate) -> tuple[Estimate, str]:
    """Return the change to the later occasion, and the same in words.

    Args:
        tuned: parameter that is a change, see `occasions`.
        earlier: its estimate: earlier occasion over the later one, or less it.
    """
    low, high = earlier.ci95
    if tuned.factor:
        change = Estimate(
            1.0 / earlier.value - 1.0, "1", (1.0 / high - 1.0, 1.0 / low - 1.0)
        )
    else:
        change = Estimate(-earlier.value, earlier.unit, (-high, -low))
    words = _percent(change) if tuned.factor else _difference(change)
    return change, f"{plain_name(base_name(tuned.name))} {words}"


def _percent(change: Estimate) -> str:
    low, high = change.ci95
    if high - low > Limit.max_relative_width:
        return "not determined"
    scaled = Estimate(100.0 * change.value, "%", (100.0 * low, 100.0 * high))
    return _difference(scaled)


def _difference(change: Estimate) -> str:
    low, high = change.ci95
    unit = f" {change.unit}".removesuffix(" 1")
    if math.isnan(low):
        return "not determined"
    if change.holds(0.0):
        most = format_number(max(abs(low), abs(high)), high - low)
        return f"unchanged within {most}{unit}"
    sign = "+" if change.value > 0.0 else ""
    return (
        f"{sign}{format_fitted(change)}{unit} (95 %: "
        f"{format_number(low, high - low)} to {format_number(high, high - low)})"
    )


def _statement(recent: Sequence[OccasionChange], names: Sequence[str]) -> str:
    """Return what changed since the last occasion but one, as a sentence."""
    own = [e for e in recent if e.since == names[-2] and e.parameter in _REPORTED]
    changed = [e.statement for e in own if not e.change.holds(0.0)]
    same = [e.statement for e in own if e.change.holds(0.0)]
    start = f"Since {names[-2]}: "
    if not changed:
        return f"{start}nothing that these data show; {list_words(same)}."
    return f"{start}{list_words(changed + same)}."


def _sizes(problem: Problem, x: FloatArray) -> list[OccasionSize]:
    found = []
    for effect in problem.effects:
        sizes = amplitude_indices(problem, [effect])
        indices = [
            k for k in sizes if abs(x[k]) > Limit.absent
        ]  # others are at a bound
        for each in constants_by_occasion(problem, x, indices):
            shared = each.parameter.value(float(x[problem.tuned.index(each.parameter)]))
            found.append(compare_size(effect, each, shared))
    return found


def compare_size(effect: str, found: TrialConstants, shared: float) -> OccasionSize:
    unit = found.parameter.unit
    name = plain_name(found.parameter.name)
    if not np.all(np.isfinite(found.value)):
        text = f"{name}: the fit to each occasion fails, so agreement is not known."
        return OccasionSize(effect, found.parameter.name, {}, True, text)
    sizes = {
        name: Estimate(
            value, unit, (value - Limit.sigmas * error, value + Limit.sigmas * error)
        )
        for name, value, error in zip(
            found.trials, found.value.tolist(), found.value_error.tolist(), strict=True
        )
    }
    able = [
        name
        for name, error in zip(found.trials, found.value_error.tolist(), strict=True)
        if Limit.visible_ratio * error < abs(shared)
    ]
    missing = [n for n in able if sizes[n].holds(0.0) or sizes[n].value * shared < 0.0]
    words = [f"{format_fitted(size)} on {name}" for name, size in sizes.items()]
    text = f"{name} [{unit or '1'}]: {list_words(words)}"
    if missing:
        text += f"; {list_words(missing)} could show it and does not"
    elif len(able) < len(sizes):
        blind = [name for name in sizes if name not in able]
        text += f"; {list_words(blind)} cannot show a size of {format_number(shared)}"
    return OccasionSize(effect, found.parameter.name, sizes, not missing, f"{text}.")
