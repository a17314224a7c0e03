"""What to record next, so that two rivals would no longer look the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.evidence import CHANNELS
from cc_mujoco.diagnosis.fitting import Problem
from cc_mujoco.diagnosis.records import Record, wind_up
from cc_mujoco.diagnosis.verdict import NextExperiment

DT = 0.008
CLEAR = 5.0
"""Difference over the noise that settles it."""


@dataclass(frozen=True)
class Motion:
    """A trial that most rigs can run.

    Attributes:
        description: what to do.
        motor: angle of the motor (samples,) [rad].
        joint: angle of the joint (samples,) [rad].
        pretension: relative to what the data had.
    """

    description: str
    motor: FloatArray
    joint: FloatArray
    pretension: float = 1.0


def catalogue(problem: Problem) -> list[Motion]:
    """Trials within the range of the data."""
    records = problem.plant.records
    bench = problem.plant.bench
    ratio = bench.motor_radius / bench.joint_radius
    swing = 0.5 * max(float(np.ptp(r.motor_angle)) for r in records)
    rate = max(
        float(np.quantile(np.abs(np.gradient(r.motor_angle, r.dt)), 0.99))
        for r in records
    )
    wind = wind_up(bench)
    time = np.arange(0.0, 40.0, DT)

    def triangle(size: float, speed: float) -> FloatArray:
        phase = (time * speed / (4.0 * size)) % 1.0
        found: FloatArray = size * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5))
        return found

    ladder = np.concatenate(
        [
            triangle(swing, rate * part)[: time.size // 5]
            for part in (0.02, 0.06, 0.2, 0.5, 1.0)
        ]
    )
    ladder = ladder[: time.size]
    chirp = swing * 0.3 * np.sin(2.0 * np.pi * (0.1 * time + 0.04 * time**2))
    dwell = swing * np.interp(
        time, [0, 1, 2, 3, 6, 7, 15, 16, 38, 39, 40], [0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    )
    small = triangle(2.0 * wind, rate * 0.1)
    still = np.zeros(time.size)
    return [
        Motion(
            "joint free, triangles at five speeds from 2 % to 100 % of the fastest",
            ladder,
            ladder * ratio,
        ),
        Motion("joint free, chirp from 0.1 to 3 Hz", chirp, chirp * ratio),
        Motion(
            "joint free, moves with rests of 1, 3, 8 and 22 s", dwell, dwell * ratio
        ),
        Motion(
            "joint locked, slow triangles of the motor a few times its wind-up",
            triangle(4.0 * wind, wind),
            still,
        ),
        Motion(
            "joint locked, small reversals of the motor within its wind-up",
            small,
            still,
        ),
        Motion(
            "motor locked, joint moved slowly to and fro by hand",
            still,
            triangle(4.0 * wind * ratio, wind),
        ),
        Motion(
            "joint free, slow triangle over the whole range, pretension halved",
            triangle(swing, rate * 0.2),
            triangle(swing, rate * 0.2) * ratio,
            0.5,
        ),
        Motion(
            "joint locked, slow triangles, pretension halved",
            triangle(4.0 * wind, wind),
            still,
            0.5,
        ),
    ]


def propose(
    rivals: Sequence[tuple[Problem, FloatArray]], ids: Sequence[str]
) -> NextExperiment | None:
    """The trial on which two fitted rivals differ most over the noise.

    Args:
        rivals: two models and where they were fitted.
        ids: of the effects that they have.
    """
    if len(rivals) < 2:
        return None
    problem = rivals[0][0]
    quiet = [
        float(np.median(np.concatenate([f[row] for f in problem.noise])))
        for row in (0, 1)
    ]
    best: tuple[float, str, str] | None = None
    for motion in catalogue(problem):
        record = _record(problem, motion)
        shown = [
            other.plant.limited([record]).simulate(other.values(at), other.effects)[0]
            for other, at in rivals[:2]
        ]
        apart = shown[0] - shown[1]
        for row in (0, 1):
            size = float(np.sqrt(np.mean(apart[row] ** 2)))
            score = size / quiet[row]
            if best is None or score > best[0]:
                most = int(np.argmax(np.abs(apart[row])))
                told = (
                    f"{CHANNELS[row]} differs by {size:.3g} Nm RMS, {score:.1f} times "
                    f"the noise; at {most * DT:.1f} s "
                    f"{EFFECTS[ids[0]].title} gives {shown[0][row, most]:.3g} Nm and "
                    f"{EFFECTS[ids[1]].title} {shown[1][row, most]:.3g} Nm"
                )
                best = (score, motion.description, told)
    assert best is not None
    settled = "" if best[0] > CLEAR else " (may not be enough)"
    return NextExperiment(f"{best[1]}{settled}", tuple(ids[:2]), best[2])


def _record(problem: Problem, motion: Motion) -> Record:
    base = problem.plant.records[0]
    size = min(motion.motor.size, motion.joint.size)
    tension = base.pretension or problem.plant.bench.cables[0].pretension
    return replace(
        base,
        trial="next",
        dt=DT,
        time=np.arange(size, dtype=np.float64) * DT,
        motor_angle=motion.motor[:size],
        joint_angle=motion.joint[:size],
        measured=np.zeros((2, size)),
        counts=np.ones(size, dtype=bool),
        pretension=tension * motion.pretension,
        start=0.0,
    )
