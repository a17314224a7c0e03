"""Learned curves of a diagnosis: their choice, test, fit, words and file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.problem import Problem
from cc_mujoco.diagnosis._learn.curves import (
    FACTORS,
    QUANTITIES,
    SIDES,
    LearnedAngleCurve,
    LearnedCurve,
)
from cc_mujoco.diagnosis._learn.formulas import FORMULAS, repeating
from cc_mujoco.diagnosis._learn.formulas import described as formula_words
from cc_mujoco.diagnosis._learn.learning import (
    CurveTerm,
    ErrorRecord,
    ErrorRows,
    choose,
    formula_of,
)
from cc_mujoco.diagnosis._phrases import channel_name, format_number, format_share
from cc_mujoco.diagnosis._rig.simulation import values_on
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, Gap, Learned, LearnedTable
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

PREFIX = "learned_"
"""Begin of the id of every learned curve."""
SAME_DATA = (
    "A learned curve is in the model; odds and shares say nothing of it where these "
    "are the data that it was learned from."
)


class LearnedModel(NamedTuple):
    """Model with learned curves as effects, fitted to all data."""

    problem: Problem
    x: FloatArray
    kinds: tuple[type, ...]  # classes of the curves, in `EFFECTS` only while used


def learn_residual(
    found: Found, judged: Diagnosis
) -> tuple[Diagnosis, LearnedModel | None]:
    """Add curves of the unexplained error to a diagnosis; return it and their model.

    The model is None where no curve is given. Curves are learned where the verdict is
    `unknown` or a named model stays far off, but not of an event or of constants that
    differ from trial to trial.
    """
    if any(effect.id.startswith(PREFIX) for effect in judged.effects):
        problems = (*judged.problems, SAME_DATA)
        judged = replace(judged, problems=problems)
    far = found.search.after.misfit > Limit.max_explained_error
    wanted = judged.verdict == "unknown" or (judged.verdict in ("named", "tie") and far)
    event = found.by_trial or judged.interrupted or judged.belief is None
    if not wanted or event:
        return judged, None
    rows = rows_of(found.problem, found.x)
    if len(rows.names) < Limit.min_curve_groups or not _left_out_whole(found.problem):
        statement = (
            "No curve is learned from what is left: that takes four trials or more, "
            "some of which can be left out whole."
        )
        none = Learned(statement, (), {}, math.nan, (math.nan, math.nan))
        return replace(judged, learned=none), None
    gap, whole = tested(found.problem, found.x, rows, found.fitted.settings.seed)
    terms = choose(rows, np.arange(len(rows.names)))
    closed, (low, high) = whole.gap_closed, whole.ci95
    share = f"{format_share(closed)} of the error above the noise floor that is left"
    if not (terms and closed >= Limit.min_learned_share and low > 0.0):
        tried = "No curve of one quantity takes enough of what is left"
        if terms and np.isfinite(closed):
            tried = f"Learned curves take {share}"
            if closed <= 0.0:
                tried = "Learned curves make the error larger"
        statement = (
            f"{tried} on trials that were not used to find them, so none is given (a "
            "third is needed)."
        )
        return replace(
            judged, learned=Learned(statement, (), gap, closed, (low, high))
        ), None
    fit = rows.fitted(terms, np.arange(len(rows.names)))
    curves = tuple(_table(rows, terms, k, fit) for k in range(len(terms)))
    names = list_words(described(curve) for curve in curves)
    looks = list_words(curve.formula for curve in curves if curve.formula)
    like = f" It looks like {looks}." if looks else ""
    statement = (
        f"Learned from the error: {names}.{like} On trials that neither choice nor "
        f"fit has seen, it takes {share} (95 % interval {format_share(low)} to "
        f"{format_share(high)}). It is no name for a cause; learned.py has it as an "
        "effect to edit."
    )
    learned = Learned(statement, curves, gap, closed, (low, high))
    model = _refitted(found, fit[: rows.precise.size], classes_of(learned))
    return replace(judged, learned=learned), model


def _left_out_whole(problem: Problem) -> bool:
    """Return whether whole trials are held out, not stretches of all of them."""
    records = problem.plant.records
    for fold in fitting.trial_folds(records):
        parts = (
            {r.group for r, mask in zip(records, masks, strict=True) if mask.any()}
            for masks in fold
        )
        if set.intersection(*parts):
            return False
    return True


def rows_of(problem: Problem, x: FloatArray) -> ErrorRows:
    """Return torque errors and slopes at `x` (parameters,), weighted as in a fit."""
    records, instruments = problem.plant.records, problem.plant.instruments
    every, values = range(len(records)), problem.values(x)
    torques = problem.torques(x)
    slopes = problem.slopes.of(problem, x, every, torques)
    masks = [record.counts for record in records]
    steep = fitting.residual_slopes(problem, torques, [np.ones_like(m) for m in masks])
    stretches = []
    for k, record in enumerate(records):
        if not masks[k].any():
            continue
        weight = np.where(masks[k], -steep[k][0], 0.0)
        if record.load_cell is not None:  # which no curve changes
            weight[[row == record.load_cell.row for row in instruments.rows]] = 0.0
        own = values_on(values, record.occasion)
        signals = problem.plant.signals(record, own, problem.effects)
        error, noise = record.measured - torques[k], problem.sensed[k]
        rest = weight, noise, record.band
        stretches.append(ErrorRecord(record.group, signals, error, slopes[k], *rest))
    sides = tuple(SIDES[row] for row in instruments.rows)
    prior = np.array([tuned.prior for tuned in problem.tuned])
    return ErrorRows(
        stretches, sides, x, np.where(np.isfinite(prior), 1.0 / prior, 0.0)
    )


def tested(
    problem: Problem, x: FloatArray, rows: ErrorRows, seed: int
) -> tuple[dict[str, Gap], Gap]:
    """Return gaps by channel, and of all, on trials left out of choice and fit.

    They compare the model tuned to the other trials without curves and with them.
    """
    records = problem.plant.records
    division = fitting.trial_folds(records)
    played = problem.torques(x)
    slopes = problem.slopes.of(problem, x, range(len(records)), played)
    before, after = ([torque.copy() for torque in played] for _ in range(2))
    used = [k for k, record in enumerate(records) if record.counts.any()]
    for fold in division:
        tested_ = [k for k in used if fold.test[k].any()]
        train = {records[k].group for k in used if fold.train[k].any()}
        groups = np.flatnonzero([name in train for name in rows.names])
        terms = choose(rows, groups)
        for into, chosen in ((before, []), (after, terms)):
            fit = rows.fitted(chosen, groups)
            tables = rows.tables(chosen, fit)
            for k in tested_:
                change = np.tensordot(-fit[: x.size], slopes[k], 1)
                place = used.index(k)
                for term, table in zip(chosen, tables, strict=True):
                    change = change + rows.curve(place, term, table)
                into[k] = played[k] + change
    both = before, after, division, seed
    return fitting.gaps(problem, *both), fitting.whole_gap(problem, *both)


def _table(
    rows: ErrorRows, terms: Sequence[CurveTerm], place: int, fit: FloatArray
) -> LearnedTable:
    term, table = terms[place], rows.tables(terms, fit)[place]
    at, quantity = rows.at(term), QUANTITIES[term.over]
    torque_unit = "N m" if FACTORS[term.times].unit == "1" else "1"
    formula = ""
    if (better := formula_of(rows, terms, place)) is not None:
        made = [*terms[:place], better, *terms[place + 1 :]]
        refitted = rows.fitted(made, np.arange(len(rows.names)))
        functions = FORMULAS[better.formula].functions(at, *better.shape)
        size = np.max(np.abs(rows.tables(made, refitted)[place] @ np.array(functions)))
        words = better.formula, term.over, quantity.unit, better.shape
        sized = f"{format_number(float(size))} {torque_unit}".removesuffix(" 1")
        formula = f"{formula_words(*words)} (up to {sized})"
    pairs = zip(rows.sides, table, strict=True)
    values = {
        f"{side}_torque_nm": tuple(row.tolist())
        for side, row in pairs
        if side in term.sides
    }
    taken = {name for name in EFFECTS if name.startswith(PREFIX)}
    name = f"{PREFIX}{term.over}".replace(" ", "_")
    name += f"_times_{term.times}".replace(" ", "_") if term.times else ""
    name += "_again" if name in taken else ""
    points = term.period, tuple(at.tolist()), torque_unit, values, formula
    return LearnedTable(name, term.over, quantity.unit, term.times, *points)


def described(curve: LearnedTable) -> str:
    """Return a phrase with the torques, quantity, factor and period of a curve."""
    torques = list_words(channel_name(name) for name in curve.torque)
    times = f" times the {curve.times}" if curve.times else ""
    text = f"a curve of the {torques} over the {curve.over}{times}"
    again = f", {repeating(curve.period, curve.unit)}" if curve.period else ""
    return text + again


def classes_of(learned: Learned) -> tuple[type, ...]:
    """Return a class of an effect for every curve, as `learned.py` defines them."""
    found = []
    for curve in learned.curves:
        parts = {
            **_attributes(curve),
            "__doc__": f"{described(curve)[2:].capitalize()}.",
        }
        found.append(type(_class_name(curve), (_base(curve),), parts))
    return tuple(found)


def _base(curve: LearnedTable) -> type:
    own = {f"{name.partition('_')[0]} angle" for name in curve.torque}
    return (
        LearnedAngleCurve if own == {curve.over} and not curve.times else LearnedCurve
    )


def _class_name(curve: LearnedTable) -> str:
    return curve.id.title().replace("_", "")


def _attributes(curve: LearnedTable) -> dict[str, Any]:
    found: dict[str, Any] = {"id": curve.id, "over": curve.over}
    if curve.times:
        found["times"] = curve.times
    if curve.period:
        found["period"] = curve.period
    found["at"] = curve.at
    return found | {name.removesuffix("_nm"): t for name, t in curve.torque.items()}


def file_text(learned: Learned) -> str:
    """Return the text of `learned.py`, with the classes of the curves to edit."""
    names = sorted({_base(curve).__name__ for curve in learned.curves})
    asked = " ".join(f"learned.py:{_class_name(c)}" for c in learned.curves)
    lines = [
        '"""Curves that a diagnosis learned from the error that no effect explains.',
        "",
        "Edit the tables; then they are effects like others:",
        "",
        f"    cc-mujoco diagnose SCENE DATA --out OUT --effects {asked}",
        "",
        f"Quantities: {', '.join(QUANTITIES)}.",
        f"Factors: {', '.join(filter(None, FACTORS))}.",
        '"""',
        "",
        f"from cc_mujoco.diagnosis import {', '.join(names)}",
    ]
    for curve in learned.curves:
        text = f"{described(curve)[2:].capitalize()}."
        lines += ["", "", f"class {_class_name(curve)}({_base(curve).__name__}):"]
        lines += [f'    """{text}"""', ""]
        for name, value in _attributes(curve).items():
            shown = repr(value)
            if isinstance(value, tuple):
                rounded = ", ".join(f"{float(f'{number:.6g}')!r}" for number in value)
                shown = f"({rounded})"
            lines.append(f"    {name} = {shown}")
    return "\n".join([*lines, ""])


def _refitted(found: Found, steps: FloatArray, kinds: Sequence[type]) -> LearnedModel:
    """Return the model with curves of `kinds` as effects, fitted to all data.

    `steps` (parameters,) are the changes of the parameters in the linear fit.
    """
    problem, x = found.problem, found.x
    counts = [record.counts for record in problem.plant.records]
    with effects_in_use(kinds) as ids:
        wider = replace(problem, plant=replace(problem.plant))  # with these effects
        for name in ids:
            wider = wider.with_effect(name, {f"{name}_share": 1.0})
        start = np.concatenate([x - steps, np.ones(len(ids))])
        both = counts, Limit.learned_evaluations
        x = fitting.fit(wider, start, *both).x
    return LearnedModel(wider, x, tuple(kinds))
