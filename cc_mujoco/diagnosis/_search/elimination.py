"""Backward elimination: models without one of their effects, and what that costs."""

from __future__ import annotations

from collections.abc import Sequence

from cc_mujoco.diagnosis._fit.folds import CrossValidation, Fold, cross_validate
from cc_mujoco.diagnosis._search.acceptance import FORM_ERROR_SHARE


def gap_shares(
    baseline: CrossValidation,
    now: CrossValidation,
    division: Sequence[Fold],
    known: list[CrossValidation],
) -> dict[str, float]:
    """Return the share of the gap that reopens without each effect, by id.

    What is fitted for that joins `known`.

    Args:
        baseline: the model without any.
        now: the model.
        division: of both.
        known: models that have been fitted already.
    """
    inflation = baseline.problem.inflation
    beyond = max(baseline.misfit**2 - 1.0, 1e-12)
    left = now.misfit_by(inflation) ** 2
    slim = {
        name: _without_effect(now, name, division, known)
        for name in now.problem.effects
    }
    known += slim.values()
    return {
        name: (crossed.misfit_by(inflation) ** 2 - left) / beyond
        for name, crossed in slim.items()
    }


def eliminate(
    now: CrossValidation,
    division: Sequence[Fold],
    known: list[CrossValidation],
) -> CrossValidation:
    """Remove the effects that later ones have made redundant.

    What is fitted for that joins `known`, models that have been fitted already.
    """
    while True:
        # The effect that was added last is needed: it was accepted on top of the rest.
        earlier = now.problem.effects[:-1]
        slim = [_without_effect(now, name, division, known) for name in earlier]
        known += slim
        useless = (1.0 + FORM_ERROR_SHARE) * now.held_out_mse
        redundant = [model for model in slim if model.held_out_mse <= useless]
        if not redundant:
            return now
        now = redundant[0]


def _without_effect(
    now: CrossValidation,
    name: str,
    division: Sequence[Fold],
    known: Sequence[CrossValidation],
) -> CrossValidation:
    slim = now.problem.without(name)
    kept = [i for i, p in enumerate(now.problem.tuned) if p in slim.tuned]
    starts = [fit.x[kept] for fit in now.fits]
    for crossed in known:
        old = crossed.problem
        if set(old.effects) != set(slim.effects) or old.forms != slim.forms:
            continue
        if old.plant is slim.plant and old.floor is slim.floor:
            return crossed
        starts = [slim.place(old.values(fit.x)) for fit in crossed.fits]
    slim = slim.sharing([crossed.problem for crossed in known])
    return cross_validate(slim, division, starts)
