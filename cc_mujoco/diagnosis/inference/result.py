"""A diagnosis with everything that belongs to it."""

from __future__ import annotations

from dataclasses import dataclass

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.evidence import Evidence
from cc_mujoco.diagnosis.inference.baseline import BaselineFit
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.verdict import Diagnosis


@dataclass(frozen=True)
class DiagnosisResult:
    """A diagnosis with everything that belongs to it.

    Attributes:
        diagnosis: what is said.
        evidence: what is drawn.
        problem: the final model, or None where there is none.
        x: its parameters.
        bench: of the scene.
        baseline_fit: the baseline, or None where there is none.
    """

    diagnosis: Diagnosis
    evidence: Evidence
    problem: Problem | None
    x: FloatArray
    bench: Bench
    baseline_fit: BaselineFit | None = None
