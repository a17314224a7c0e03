"""Learned curves of a diagnosis: their choice, test, fit, words and file."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.problem import Problem
from cc_mujoco.diagnosis._learn.curves import (
    FACTORS,
    QUANTITIES,
    SIDES,
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
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_number,
    format_share,
)
from cc_mujoco.diagnosis._rig.simulation import values_on
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, Gap, Learned, LearnedTable
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

PREFIX = "learned_"
"""Prefix of the id of every learned curve."""
SAME_DATA = (
    "A learned curve is in the model; odds and shares say nothing of it where these "
    "are the data that it was learned from."
)


def learn_residual(
    found: Found, judged: Diagnosis
) -> tuple[Diagnosis, Problem, FloatArray]:
    """Add curves of the unexplained error to a diagnosis and to the model found.

    They are returned with the model's parameters, fitted to all data. Curves are
    learned where the verdict is `unknown` or a named or tied model stays far off, but
    not of an event or of constants that differ from trial to trial.
    """
    problem, x = found.problem, found.x
    if any(effect.id.startswith(PREFIX) for effect in judged.effects):
        judged = replace(judged, problems=(*judged.problems, SAME_DATA))
    far = found.search.after.misfit > Limit.max_explained_error
    wanted = judged.verdict == "unknown" or (judged.verdict in ("named", "tie") and far)
    if not wanted or found.by_trial or judged.interrupted or judged.belief is None:
        return judged, problem, x
    rows = rows_of(problem, x)
    used = [record for record in problem.plant.records if record.counts.any()]
    # Trials that repeat each other are left out together, so both or none is reserved.
    parted = {(r.group, r.split == "test") for r in used}
    if len(rows.names) < Limit.min_curve_groups or len(parted) > len(rows.names):
        statement = (
            "No curve is learned from what is left: that takes four trials or more, "
            "some of which can be left out whole."
        )
        none = Learned(statement, (), {}, math.nan, (math.nan, math.nan))
        return replace(judged, learned=none), problem, x
    gap, whole = tested(problem, x, rows, found.fitted.settings.seed)
    terms = choose(rows, np.arange(len(rows.names)))
    closed, (low, high) = whole.gap_closed, whole.ci95
    share = f"{format_share(closed)} of the error above the noise floor that is left"
    fit = np.zeros(0)
    curves: tuple[LearnedTable, ...] = ()
    if terms and closed >= Limit.min_learned_share and low > 0.0:
        fit = rows.fitted(terms, np.arange(len(rows.names)))
        curves = tuple(_table(rows, terms, k, fit) for k in range(len(terms)))
        names = list_words(described(curve) for curve in curves)
        looks = list_words(curve.formula for curve in curves if curve.formula)
        like = f" It looks like {looks}." if looks else ""
        statement = (
            f"Learned from the error: {names}.{like} On trials that neither choice nor "
            f"fit has seen, it takes {share} (95 % interval {format_share(low)} to "
            f"{format_share(high)}). It is no name for a cause; learned.py has it as "
            "an effect to edit."
        )
    else:
        tried = "No curve of one quantity takes enough of what is left"
        if terms and np.isfinite(closed):
            tried = f"Learned curves take {share}"
            if closed <= 0.0:
                tried = "Learned curves make the error larger"
        statement = (
            f"{tried} on trials that were not used to find them, so none is given (a "
            "third is needed)."
        )
    learned = Learned(statement, curves, gap, closed, (low, high))
    judged = replace(judged, learned=learned)
    if not curves:
        return judged, problem, x
    with effects_in_use(classes_of(learned)) as ids:
        wider = replace(problem, plant=replace(problem.plant))  # with these effects
        for name in ids:
            wider = wider.with_effect(name, {f"{name}_share": 1.0})
        start = np.concatenate([x - fit[: x.size], np.ones(len(ids))])
        counts = [record.counts for record in problem.plant.records]
        fitted = fitting.fit(wider, start, counts, Limit.learned_evaluations)
    return judged, wider, fitted.x


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
    precise = np.where(np.isfinite(prior), 1.0 / prior, 0.0)
    return ErrorRows(stretches, sides, x, precise)


def tested(
    problem: Problem, x: FloatArray, rows: ErrorRows, seed: int
) -> tuple[dict[str, Gap], Gap]:
    """Return gaps by channel, and of all, on trials left out of choice and fit.

    They compare the model tuned to the other trials without curves and with them.
    """
    records = problem.plant.records
    division, played = fitting.trial_folds(records), problem.torques(x)
    before, after = ([torque.copy() for torque in played] for _ in range(2))
    used = [k for k, record in enumerate(records) if record.counts.any()]
    for fold in division:
        train = {records[k].group for k in used if fold.train[k].any()}
        groups = np.flatnonzero([name in train for name in rows.names])
        for into, terms in ((before, []), (after, choose(rows, groups))):
            factors = -np.delete(rows.fitted(terms, groups), x.size)
            for k, own in zip(used, rows.stretches, strict=True):
                if fold.test[k].any():
                    every = [own.slopes, *(rows.curve(own, term) for term in terms)]
                    change = np.tensordot(factors, np.concatenate(every), 1)
                    into[k] = played[k] + change
    both = before, after, division, seed
    return fitting.gaps(problem, *both), fitting.whole_gap(problem, *both)


def _table(
    rows: ErrorRows, terms: Sequence[CurveTerm], place: int, fit: FloatArray
) -> LearnedTable:
    term, table = terms[place], rows.table(terms, place, fit)
    at, unit = rows.at(term), QUANTITIES[term.over].unit
    torque_unit = "N m" if FACTORS[term.times].unit == "1" else "1"
    formula = ""
    if (better := formula_of(rows, terms, place)) is not None:
        made = [*terms[:place], better, *terms[place + 1 :]]
        sizes = rows.table(made, place, rows.fitted(made, np.arange(len(rows.names))))
        functions = FORMULAS[better.formula].functions(at, *better.shape)
        size = format_number(float(np.max(np.abs(sizes @ np.array(functions)))))
        sized = f"{size} {torque_unit}".removesuffix(" 1")
        words = formula_words(better.formula, term.over, unit, better.shape)
        formula = f"{words} (up to {sized})"
    pairs = zip(term.sides, table, strict=True)
    values = {f"{side}_torque_nm": tuple(row.tolist()) for side, row in pairs}
    name = f"{PREFIX}{term.over}" + (f"_times_{term.times}" if term.times else "")
    name = name.replace(" ", "_")
    name += "_again" if name in EFFECTS else ""
    points = term.period, tuple(at.tolist()), torque_unit, values, formula
    return LearnedTable(name, term.over, unit, term.times, *points)


def described(curve: LearnedTable) -> str:
    """Return a phrase with the torques, quantity, factor and period of a curve."""
    torques = list_words(channel_name(name) for name in curve.torque)
    times = f" times the {curve.times}" if curve.times else ""
    again = f", {repeating(curve.period, curve.unit)}" if curve.period else ""
    return f"a curve of the {torques} over the {curve.over}{times}{again}"


def classes_of(learned: Learned | None) -> list[type]:
    """Return a class of an effect for every curve, as `learned.py` defines them."""
    return [
        type(curve.id.title().replace("_", ""), (LearnedCurve,), _attributes(curve))
        for curve in (learned.curves if learned else ())
    ]


def _attributes(curve: LearnedTable) -> dict[str, Any]:
    found: dict[str, Any] = {
        "__doc__": f"{capitalise(described(curve)[2:])}.",
        **{name: getattr(curve, name) for name in ("id", "over", "times", "period")},
        "at": curve.at,
        **{name.removesuffix("_nm"): table for name, table in curve.torque.items()},
    }
    return {name: value for name, value in found.items() if value}


def file_text(learned: Learned) -> str:
    """Return the text of `learned.py`, with the classes of the curves to edit."""
    kinds = classes_of(learned)
    lines = [
        '"""Curves that a diagnosis learned from the error that no effect explains.',
        "",
        "Edit the tables; then they are effects like others:",
        "",
        "    cc-mujoco diagnose SCENE DATA --out OUT --effects "
        + " ".join(f"learned.py:{kind.__name__}" for kind in kinds),
        "",
        f"Quantities: {', '.join(QUANTITIES)}.",
        f"Factors: {', '.join(filter(None, FACTORS))}.",
        '"""',
        "",
        "from cc_mujoco.diagnosis import LearnedCurve",
    ]
    for kind, curve in zip(kinds, learned.curves, strict=True):
        lines += ["", "", f"class {kind.__name__}(LearnedCurve):"]
        lines += [f'    """{kind.__doc__}"""', ""]
        for name, value in _attributes(curve).items():
            shown = repr(value)
            if isinstance(value, tuple):
                rounded = ", ".join(f"{float(f'{number:.6g}')!r}" for number in value)
                shown = f"({rounded})"
            if name != "__doc__":
                lines.append(f"    {name} = {shown}")
    return "\n".join([*lines, ""])
