"""The estimators of 3.2.3, each from a wrong start and behind a slow drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.estimation._tension_slope import FrictionEstimator
from cc_mujoco.estimation._tracks import EstimateTrack
from cc_mujoco.native import FloatArray
from thesis._experiments.online_runs import (
    CABLE,
    CURVATURE_PLACES,
    DRIFT_END,
    DRIFT_START,
    DT,
    FRICTION_MEMORY,
    INITIAL_GUESS_FACTOR,
    NOISE,
    Truth,
    drift,
    pulls,
    simulate,
    strokes,
    winding_path,
)
from thesis.estimators._bend_estimator import Bend, BendEstimator
from thesis.estimators._stiffness import StiffnessEstimator
from thesis.estimators._unscented import UnscentedEstimator

FRICTION_DRIFT, STIFFNESS_DRIFT = 1.5, 0.7
"""Friction and stiffness at the end, over those at the start."""


def simulate_wear(duration: float = DRIFT_END, seed: int = 41) -> Truth:
    """Simulate strokes while friction grows."""
    return simulate(
        CABLE,
        strokes(duration),
        seed,
        factor=drift(duration, DRIFT_START, FRICTION_DRIFT),
    )


def estimate_recursively(truth: Truth) -> EstimateTrack:
    """Return the friction by least squares from the sensors along the cable."""
    rate = (FRICTION_DRIFT - 1.0) * CABLE.friction * DT / (truth.time[-1] - DRIFT_START)
    estimator = FrictionEstimator(
        CABLE,
        truth.sensors,
        start=INITIAL_GUESS_FACTOR * CABLE.friction,
        memory=FRICTION_MEMORY,
        drift=rate,
    )
    return estimator.over(truth.reading, truth.direction)


def estimate_unscented(truth: Truth) -> EstimateTrack:
    """Estimate friction, stiffness and pretension from the ends and wrong guesses."""
    guess = CABLE.replace(
        friction=INITIAL_GUESS_FACTOR * CABLE.friction,
        axial_stiffness=1.5 * CABLE.axial_stiffness,
        pretension=0.75 * CABLE.pretension,
    )
    estimator = UnscentedEstimator(
        guess,
        ("friction", "axial_stiffness", "pretension"),
        DT,
        noise={"tension_proximal": NOISE, "tension_distal": NOISE},
        drift=[0.02, 0.0, 0.0],
    )
    return estimator.over(
        {
            "u_proximal": truth.u_proximal,
            "u_distal": truth.u_distal,
            "tension_proximal": truth.reading[:, 0],
            "tension_distal": truth.reading[:, -1],
        }
    )


class Bends(NamedTuple):
    """mu/R along a winding cable."""

    truth: FloatArray  # (samples, places) [1/m]
    found: Bend  # the estimate (samples, places) [1/m]
    before: float  # RMS error before the drift, over the mean of mu/R
    during: float  # the same during the drift, over the mean at the time
    stated: float  # RMS of the stated deviation during the drift, over the same
    start: float  # the guess [1/m]


BEND_MEMORY = 300


def estimate_bends(duration: float = DRIFT_END, seed: int = 42) -> Bends:
    """Estimate an unknown bend of a cable; the guess is uniform and twice the mean."""
    cable = winding_path(CABLE.replace(segments=50))
    factor = drift(duration, DRIFT_START, FRICTION_DRIFT)
    data = simulate(cable, strokes(duration), seed, factor=factor)
    mean = CABLE.friction * CABLE.wrap / CABLE.length
    rate = (FRICTION_DRIFT - 1.0) * mean * DT / (duration - DRIFT_START)
    estimator = BendEstimator(
        cable,
        data.sensors,
        start=INITIAL_GUESS_FACTOR * mean,
        memory=BEND_MEMORY,
        drift=rate,
    )
    found = estimator.over(data.reading, data.direction, CURVATURE_PLACES)
    angle = [section.length / section.radius for section in cable.conduit]
    middle = (np.arange(len(angle)) + 0.5) * cable.length / len(angle)
    along = np.interp(
        CURVATURE_PLACES, middle, np.array(angle) * len(angle) / cable.length
    )
    truth = factor[:, None] * CABLE.friction * along
    error = (found.value - truth) / (factor[:, None] * mean)
    stated = found.deviation / (factor[:, None] * mean)
    late = data.time >= DRIFT_START
    settled = ~late & (data.time >= DRIFT_START - 4.0)
    return Bends(
        truth,
        found,
        _rms(error[settled]),
        _rms(error[late]),
        _rms(stated[late]),
        INITIAL_GUESS_FACTOR * mean,
    )


class Softening(NamedTuple):
    """EA while it falls."""

    time: FloatArray  # (samples,) [s]
    truth: FloatArray  # (samples,) [N]
    found: EstimateTrack  # in partial motion (samples,) [N]
    before: float  # mean error before the drift, over the truth
    # estimate over the truth in strokes whose mass motion is given to it as partial
    fooled: float
    refused: float  # the same with the true motion given, over its start


SOFT_MEMORY = 200
PULL_DEPTH = 0.012
"""Pull of the motor end, output locked [m]; the front turns before the output."""


def estimate_softening(duration: float = DRIFT_END, seed: int = 43) -> Softening:
    """Estimate stiffness with locked output, by pulls within the reach of friction."""
    cable = CABLE.replace(segments=50, pretension=20.0)
    data = simulate(
        cable,
        pulls(duration, PULL_DEPTH),
        seed,
        drifting="axial_stiffness",
        factor=drift(duration, DRIFT_START, STIFFNESS_DRIFT),
    )
    stiffness = cable.axial_stiffness
    rate = (1.0 - STIFFNESS_DRIFT) * stiffness * DT / (duration - DRIFT_START)
    estimator = StiffnessEstimator(
        cable,
        data.sensors,
        start=INITIAL_GUESS_FACTOR * stiffness,
        memory=SOFT_MEMORY,
        drift=rate,
    )
    found = estimator.over(data.u_proximal, data.reading, data.direction)
    settled = (data.time > 0.5 * DRIFT_START) & (data.time < DRIFT_START)
    free = simulate(CABLE, strokes(DRIFT_START), seed)
    fooled, refused = _in_mass_motion(CABLE, free)
    return Softening(
        data.time,
        stiffness * data.factor,
        found,
        float(np.mean(found.value[settled])) / stiffness - 1.0,
        fooled,
        refused,
    )


def _in_mass_motion(cable: Cable, data: Truth) -> tuple[float, float]:
    """Return estimates from mass motion only, declared as partial and as what it is."""
    mass = np.all(data.direction != 0, axis=1)
    rows = data.u_proximal[mass], data.reading[mass], data.direction[mass]
    lie = rows[2].copy()
    lie[:, -1] = 0
    start = INITIAL_GUESS_FACTOR * cable.axial_stiffness
    fooled, refused = (
        StiffnessEstimator(cable, data.sensors, start=start)
        .over(*rows[:2], directions)
        .value[-1]
        for directions in (lie, rows[2])
    )
    return float(fooled / cable.axial_stiffness), float(refused / start)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
