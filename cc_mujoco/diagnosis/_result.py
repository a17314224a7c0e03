"""Options of a diagnosis, and everything that it results in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._fit.baseline import BaselineFit
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._report_data import Evidence
from cc_mujoco.diagnosis._rig.motions import CataloguedTrial
from cc_mujoco.diagnosis._search.acceptance import Thresholds
from cc_mujoco.diagnosis._verdict import Diagnosis
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class Options:
    """Choices that a diagnosis is made with, besides data and scene."""

    ids: Sequence[str] | None = None
    """Effects to consider; by default all but the rare ones that are not `requested`,
    which are considered where the others leave the error unexplained."""
    requested: Sequence[str] = ()
    """Effects that the user requested, rare ones included."""
    thresholds: Thresholds = Thresholds()  # noqa: RUF009
    """Thresholds of the decisions."""
    seed: int = 0
    """Seed of bootstraps and noise draws."""


@dataclass(frozen=True)
class DiagnosisResult:
    """A diagnosis with everything that belongs to it."""

    diagnosis: Diagnosis
    """Verdict, in numbers and sentences."""
    evidence: Evidence
    """Signals and maps that the report draws."""
    problem: Problem | None
    """Final model, or None where there is none."""
    x: FloatArray
    """Parameters of the final model."""
    bench: Bench
    """Rig as the scene has it."""
    baseline_fit: BaselineFit | None = None
    """Fit of the baseline, or None where there is none."""
    motion: CataloguedTrial | None = None
    """Motion of the proposed trial, or None."""
