"""The estimators of 3.2.3, each from a wrong start and behind a slow drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.estimation.friction import FrictionEstimator
from cc_mujoco.estimation.samples import EstimateTrack
from cc_mujoco.thesis.estimators.bend import Bend, BendEstimator
from cc_mujoco.thesis.estimators.stiffness import StiffnessEstimator
from cc_mujoco.thesis.estimators.unscented import UnscentedEstimator
from cc_mujoco.thesis.experiments.online_runs import (
    CABLE,
    DT,
    DURATION,
    MEMORY,
    NOISE,
    PLACES,
    REST,
    START,
    Truth,
    drift,
    pulls,
    simulate,
    strokes,
    winding,
)
from cc_mujoco.transmission import Cable

WEAR, SOFTENING = 1.5, 0.7
"""Friction and stiffness at the end, over those at the start."""


def wearing(duration: float = DURATION, seed: int = 41) -> Truth:
    """Strokes while friction grows."""
    return simulate(CABLE, strokes(duration), seed, factor=drift(duration, REST, WEAR))


def recursive(truth: Truth) -> EstimateTrack:
    """Friction by least squares from the sensors along the cable."""
    rate = (WEAR - 1.0) * CABLE.friction * DT / (truth.time[-1] - REST)
    estimator = FrictionEstimator(
        CABLE, truth.sensors, start=START * CABLE.friction, memory=MEMORY, drift=rate
    )
    return estimator.over(truth.reading, truth.direction)


def unscented(truth: Truth) -> EstimateTrack:
    """Friction, stiffness and pretension from the ends alone, all guessed wrong."""
    guess = CABLE.replace(
        friction=START * CABLE.friction,
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
    """mu/R along a winding cable.

    Attributes:
        truth: (samples, places) [1/m].
        found: the estimate (samples, places) [1/m].
        before: RMS error before the drift, over the mean of mu/R.
        during: the same during the drift, over the mean at the time.
        stated: RMS of the stated deviation during the drift, over the same.
        start: the guess [1/m].
    """

    truth: FloatArray
    found: Bend
    before: float
    during: float
    stated: float
    start: float


BEND_MEMORY = 300


def bends(duration: float = DURATION, seed: int = 42) -> Bends:
    """Estimate an unknown bend of a cable; the guess is uniform and twice the mean."""
    cable = winding(CABLE.replace(segments=50))
    factor = drift(duration, REST, WEAR)
    data = simulate(cable, strokes(duration), seed, factor=factor)
    mean = CABLE.friction * CABLE.wrap / CABLE.length
    rate = (WEAR - 1.0) * mean * DT / (duration - REST)
    estimator = BendEstimator(
        cable, data.sensors, start=START * mean, memory=BEND_MEMORY, drift=rate
    )
    found = estimator.over(data.reading, data.direction, PLACES)
    angle = [section.length / section.radius for section in cable.conduit]
    middle = (np.arange(len(angle)) + 0.5) * cable.length / len(angle)
    along = np.interp(PLACES, middle, np.array(angle) * len(angle) / cable.length)
    truth = factor[:, None] * CABLE.friction * along
    error = (found.value - truth) / (factor[:, None] * mean)
    stated = found.deviation / (factor[:, None] * mean)
    late = data.time >= REST
    settled = ~late & (data.time >= REST - 4.0)
    return Bends(
        truth,
        found,
        _rms(error[settled]),
        _rms(error[late]),
        _rms(stated[late]),
        START * mean,
    )


class Softening(NamedTuple):
    """EA while it falls.

    Attributes:
        time: (samples,) [s].
        truth: (samples,) [N].
        found: in partial motion (samples,) [N].
        before: mean error before the drift, over the truth.
        fooled: estimate over the truth in strokes whose mass motion is given to it as
            partial.
        refused: the same with the true motion given, over its start.
    """

    time: FloatArray
    truth: FloatArray
    found: EstimateTrack
    before: float
    fooled: float
    refused: float


SOFT_MEMORY = 200
PULL = 0.012
"""Pull of the motor end, output locked [m]; the front turns before the output."""


def softening(duration: float = DURATION, seed: int = 43) -> Softening:
    """Output locked, the motor pulled and let go within the reach of friction."""
    cable = CABLE.replace(segments=50, pretension=20.0)
    data = simulate(
        cable,
        pulls(duration, PULL),
        seed,
        drifting="axial_stiffness",
        factor=drift(duration, REST, SOFTENING),
    )
    stiffness = cable.axial_stiffness
    rate = (1.0 - SOFTENING) * stiffness * DT / (duration - REST)
    estimator = StiffnessEstimator(
        cable, data.sensors, start=START * stiffness, memory=SOFT_MEMORY, drift=rate
    )
    found = estimator.over(data.u_proximal, data.reading, data.direction)
    settled = (data.time > 0.5 * REST) & (data.time < REST)
    free = simulate(CABLE, strokes(REST), seed)
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
    start = START * cable.axial_stiffness
    estimator = StiffnessEstimator(cable, data.sensors, start=start)
    fooled = estimator.over(rows[0], rows[1], lie).value[-1]
    estimator.reset()
    refused = estimator.over(*rows).value[-1]
    return float(fooled / cable.axial_stiffness), float(refused / start)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
