"""The experiments of the thesis, chapters 1 to 3, run again.

    cc-mujoco reproduce pretension loops

One module an experiment; each gives figures, their data, and claims: what is printed,
what we find, whether that agrees, and why.
"""

from __future__ import annotations

from cc_mujoco.thesis.outcome import Claim, ExperimentOutcome
from cc_mujoco.thesis.runner import (
    EXPERIMENTS,
    FinishedExperiment,
    reproduce,
    run,
    table,
)

__all__ = [
    "EXPERIMENTS",
    "Claim",
    "ExperimentOutcome",
    "FinishedExperiment",
    "reproduce",
    "run",
    "table",
]
