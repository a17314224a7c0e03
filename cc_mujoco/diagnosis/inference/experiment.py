"""What to record next, so that two rivals would no longer look the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.inference.jacobian import Slopes, jacobian
from cc_mujoco.diagnosis.inference.motions import DT, Motion, motions
from cc_mujoco.diagnosis.inference.records import Record
from cc_mujoco.diagnosis.inference.search import FORM
from cc_mujoco.diagnosis.verdict import NextExperiment
from cc_mujoco.diagnosis.wording import number

CLEAR = 5.0
"""Difference over its standard deviation, by noise and form, that settles it."""


def catalogue(problem: Problem) -> list[Motion]:
    """Trials within the speeds and tensions of the data; one goes further."""
    records = problem.plant.records
    swing = 0.5 * max(float(np.ptp(r.motor_angle)) for r in records)
    rate = max(
        float(np.quantile(np.abs(np.gradient(r.motor_angle, r.dt)), 0.99))
        for r in records
    )
    return motions(problem.plant.bench, swing, rate)


def propose(
    rivals: Sequence[tuple[Problem, FloatArray]], ids: Sequence[str]
) -> NextExperiment | None:
    """The trial on which two fitted rivals differ most, whatever else is tuned.

    If one of them were true, the other would be fitted again, to the old data and the
    new; the difference that counts is what would be left then. A difference that comes
    from friction, say, which the two estimate differently, settles nothing; nor does
    one that is no more than effects are off by in their form.

    Args:
        rivals: two models and where they were fitted.
        ids: of the effects that they have.
    """
    if len(rivals) < 2:
        return None
    problem = rivals[0][0]
    noise = np.array(
        [
            [np.median(np.concatenate([f[row] for f in problem.noise]))]
            for row in range(len(problem.plant.instruments.rows))
        ]
    )
    known = [
        jacobian(other, x, [r.free for r in other.plant.records])
        for other, x in rivals[:2]
    ]
    best: tuple[float, str, str] | None = None
    for motion in catalogue(problem):
        record = _record(problem, motion)
        shown = [
            other.plant.limited([record]).simulate(other.values(x), other.effects)[0]
            for other, x in rivals[:2]
        ]
        apart = (shown[0] - shown[1]) / noise
        unsure = form_error(rivals[:2], ids, record, shown, noise)
        left = min(
            (
                left_after_fit(
                    other, x, replace(record, measured=torque), noise, old, apart
                )
                for (other, x), torque, old in zip(rivals, shown, known, strict=False)
            ),
            key=np.linalg.norm,
        )
        score = float(np.linalg.norm(left / np.hypot(1.0, unsure))) * problem.weight
        if best is None or score > best[0]:
            sizes = np.sqrt(np.mean(left**2, axis=1))
            row = int(np.argmax(sizes))
            most = int(np.argmax(np.abs(left[row])))
            channel = problem.plant.instruments.channels[row]
            told = (
                f"{channel} differs by {sizes[row] * noise[row, 0]:.3g} Nm RMS "
                f"even when all else is tuned, {number(sizes[row])} times the noise; "
                f"at {most * DT:.1f} s {EFFECTS[ids[0]].title} gives "
                f"{shown[0][row, most]:.3g} Nm and {EFFECTS[ids[1]].title} "
                f"{shown[1][row, most]:.3g} Nm"
            )
            best = (score, motion.description, told)
    assert best is not None
    settled = "" if best[0] > CLEAR else " (may not be enough)"
    return NextExperiment(f"{best[1]}{settled}", tuple(ids[:2]), best[2])


def form_error(
    rivals: Sequence[tuple[Problem, FloatArray]],
    ids: Sequence[str],
    record: Record,
    shown: Sequence[FloatArray],
    noise: FloatArray,
) -> FloatArray:
    """What the form of an effect may be off by, over the noise (2, 1).

    Args:
        rivals: two models and where they were fitted.
        ids: of the effects that they have.
        record: the trial.
        shown: what each model says of it (2, samples) [Nm].
        noise: (2, 1) of the torques [Nm].
    """
    sizes = []
    for (problem, x), name, torque in zip(rivals, ids, shown, strict=False):
        rest = [effect for effect in problem.effects if effect != name]
        without = problem.plant.limited([record]).simulate(problem.values(x), rest)[0]
        sizes.append(np.mean(((torque - without) / noise) ** 2, axis=1, keepdims=True))
    found: FloatArray = np.sqrt(FORM * np.min(sizes, axis=0))
    return found


def left_after_fit(
    problem: Problem,
    x: FloatArray,
    record: Record,
    noise: FloatArray,
    known: FloatArray,
    apart: FloatArray,
) -> FloatArray:
    """What is left of a difference when a model is fitted again (2, samples).

    Args:
        problem: the model.
        x: where it was fitted.
        record: the new trial, with what the model says of it as measured.
        noise: (2, 1) of the torques [Nm].
        known: (residuals, parameters) Jacobian on the data there are, and priors.
        apart: (2, samples) difference over the noise.
    """
    wide = (np.broadcast_to(noise, apart.shape),)
    new = replace(
        problem,
        plant=problem.plant.limited([record]),
        noise=wide,
        floor=wide,
        slopes=Slopes(),
    )
    every = [np.ones(record.counts.size, dtype=bool)]
    slopes = jacobian(new, x, every)[: apart.size]
    wanted = np.concatenate([problem.weight * apart.ravel(), np.zeros(len(known))])
    change = np.linalg.lstsq(np.concatenate([slopes, known]), wanted)[0]
    left: FloatArray = apart - (slopes @ change).reshape(apart.shape) / problem.weight
    return left


def _record(problem: Problem, motion: Motion) -> Record:
    base = problem.plant.records[0]
    size = min(motion.motor.size, motion.joint.size)
    tension = base.pretension
    if tension is None:
        tension = problem.plant.bench.cables[0].pretension
    return replace(
        base,
        trial="next",
        dt=DT,
        time=np.arange(size, dtype=np.float64) * DT,
        motor_angle=motion.motor[:size],
        joint_angle=motion.joint[:size],
        read=np.array([motion.motor[:size], motion.joint[:size]]),
        measured=np.zeros((len(base.measured), size)),
        counts=np.ones(size, dtype=bool),
        pretension=tension * motion.pretension,
        start=0.0,
        tilt=motion.tilt,
    )
