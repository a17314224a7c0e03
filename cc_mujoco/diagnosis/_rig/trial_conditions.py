"""Conditions of every trial that effects may depend on: order and temperature."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cc_mujoco.datasets._trials import Trial
from cc_mujoco.diagnosis.effects import TrialConditions


def trial_conditions(trials: Sequence[Trial]) -> dict[str, TrialConditions]:
    """Return the conditions of trials, which are in the order of recording, by name."""
    means, rates = {}, {}
    for trial in trials:
        if trial.temperature is None or not np.isfinite(trial.temperature).any():
            continue
        known = np.isfinite(trial.temperature)
        time, celsius = trial.time[known], trial.temperature[known]
        means[trial.name] = float(celsius.mean())
        spread = time - time.mean()
        rates[trial.name] = float(spread @ celsius / max(spread @ spread, 1e-300))
    usual = float(np.mean(list(means.values()))) if means else 0.0
    middle = 0.5 * (len(trials) - 1)
    return {
        trial.name: TrialConditions(
            place - middle,
            means.get(trial.name, usual) - usual,
            rates.get(trial.name, 0.0),
        )
        for place, trial in enumerate(trials)
    }
