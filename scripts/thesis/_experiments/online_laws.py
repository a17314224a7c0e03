"""Fig. 3.9, and the update law that the thesis proposes from it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cc_mujoco.cable._segments import Mesh
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.estimation._tension_slope import FrictionEstimator
from cc_mujoco.native import FloatArray
from thesis._experiments.online_runs import (
    CABLE,
    DRIFT_START,
    DT,
    FRICTION_MEMORY,
    INITIAL_GUESS_FACTOR,
    MODEL_FRICTIONS,
    simulate,
    strokes,
)
from thesis.estimators._slope_law import SlopeLaw

GAINS = np.geomspace(1e-5, 1e-1, 13)  # gains of the printed law [1/N]


class MassMotion(NamedTuple):
    """Fig. 3.9: one instant of mass motion towards the motor."""

    reading: FloatArray  # (11,) [N]
    line: FloatArray  # straight fit to them (11,) [N]
    models: FloatArray  # every sensor's extrapolation, (len(MODELS), 11, 11) [N]
    # mean of T_1 - T_N of the models over that of the line (len(MODELS),)
    ratio: FloatArray
    exact: float  # T_1 - T_N of the line over the truth's without noise


def slopes(seed: int = 39) -> MassMotion:
    """Carry readings along the cable by models of wrong friction."""
    truth = simulate(CABLE, strokes(2.0), seed)
    row = round(0.8 / DT)
    reading, clean = truth.reading[row], truth.tension[row]
    nodes = np.arange(reading.size)
    line = np.polyval(np.polyfit(nodes, reading, 1), nodes.astype(float))
    mesh = Mesh.of(CABLE)
    models = []
    for model in MODEL_FRICTIONS:
        wrong = replace(mesh, angle=model * mesh.angle)
        models.append(
            tension_gains(wrong, truth.direction[row], nodes) * reading[:, None]
        )
    told = np.array(models)
    apart = np.mean(told[:, :, 0] - told[:, :, -1], axis=1)
    straight = -10.0 * float(np.polyfit(nodes, clean, 1)[0])
    return MassMotion(
        reading,
        line,
        told,
        apart / (line[0] - line[-1]),
        straight / float(clean[0] - clean[-1]),
    )


class PrintedLaws(NamedTuple):
    """The printed law and what it takes to make it work, each at its best gain."""

    time: FloatArray  # (samples,) [s]
    tracks: dict[str, FloatArray]  # of the laws by name (samples,)
    left: dict[str, float]  # RMS error over the last two strokes, over the first error
    bias: float  # error at which the law comes to rest without noise, over the truth


LAWS: dict[str, dict[str, bool]] = {
    "as printed": {},
    "with the sign of motion": {"signed": True},
    "and integrated": {"signed": True, "integrated": True},
}


def laws(duration: float = DRIFT_START, seed: int = 40) -> PrintedLaws:
    """Run the printed law with the gain that serves it best."""
    truth = simulate(CABLE, strokes(duration), seed)
    late = truth.time >= duration - 8.0
    tracks, left = {}, {}
    for name, choice in LAWS.items():
        best = np.inf
        for gain in GAINS:
            law = SlopeLaw(
                CABLE,
                truth.sensors,
                gain,
                start=INITIAL_GUESS_FACTOR * CABLE.friction,
                **choice,
            )
            rows = zip(truth.reading, truth.direction, strict=True)
            track = np.array([law.update(*row) for row in rows])
            error = track[late] / CABLE.friction - 1.0
            if (size := float(np.sqrt(np.mean(error**2)))) < best:
                best, tracks[name] = size, track
                left[name] = size / (INITIAL_GUESS_FACTOR - 1.0)
            if size > 3.0 * (INITIAL_GUESS_FACTOR - 1.0):
                break  # larger gains only oscillate more
    ours = FrictionEstimator(
        CABLE,
        truth.sensors,
        start=INITIAL_GUESS_FACTOR * CABLE.friction,
        memory=FRICTION_MEMORY,
    )
    tracks["least squares"] = ours.over(truth.reading, truth.direction).value
    error = tracks["least squares"][late] / CABLE.friction - 1.0
    left["least squares"] = float(np.sqrt(np.mean(error**2))) / (
        INITIAL_GUESS_FACTOR - 1.0
    )
    return PrintedLaws(truth.time, tracks, left, bias())


def bias() -> float:
    """Return the relative bias of the printed law, whose line is not the profile."""
    truth = simulate(CABLE, strokes(2.0), 0, noise=1e-9)
    row = round(0.8 / DT)
    law = SlopeLaw(CABLE, truth.sensors, 1.0)

    def discrepancy(friction: float) -> float:
        law.friction = friction
        return law.discrepancy(truth.reading[row], float(truth.direction[row, 0]))

    low, high = 0.5 * CABLE.friction, 2.0 * CABLE.friction
    return float(brentq(discrepancy, low, high)) / CABLE.friction - 1.0
