"""Runs for the online estimators: chosen motions, and a truth that drifts.

Chosen, because the text gives none: the cable of Table 2.2 with its kinetic friction
and 40 N of pretension, which keeps it taut; strokes of the motor end of 30 mm in 4 s
that the output follows with 20 mm; 100 samples a second; a sensor at each of the 11
nodes of 3.2.1 with 1 N of white noise. Truth is this package's kernel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import PARAMETERS, Cable, Section, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.native import FloatArray
from thesis._rig import PRINTED_CABLE

DT = 0.01
PERIOD = 4.0  # period of a stroke to and fro [s]
NOISE = 1.0  # standard deviation of every tension sensor [N]
SENSORS = 11
CABLE = PRINTED_CABLE.replace(static_friction=0.0, pretension=40.0, segments=10)
DRIFT_START, DRIFT_END = 20.0, 200.0  # times at which drifts begin and end [s]
INITIAL_GUESS_FACTOR = 2.0  # first guess of every estimator, over the truth
FRICTION_MEMORY = 200  # samples of `FrictionEstimator` (2 s of motion)
MODEL_FRICTIONS = (0.5, 1.0, 1.5, 2.0)
"""Friction of the model over the truth in Fig. 3.9."""
CURVATURE_PLACES = np.linspace(0.1, 1.9, 19)  # places at which mu/R is compared [m]
CHUNK_SIZE = 10  # samples between changes of a drifting parameter


class Truth(NamedTuple):
    """A motion, the state of the cable, and the readings of the sensors."""

    time: FloatArray  # (samples,) [s]
    u_proximal: FloatArray  # (samples,) [m]
    u_distal: FloatArray  # (samples,) [m]
    tension: FloatArray  # of the nodes (samples, n + 1) [N]
    direction: NDArray[np.int8]  # of the segments (samples, n)
    reading: FloatArray  # of the sensors (samples, SENSORS) [N]
    sensors: Sensors  # where they are
    factor: FloatArray  # of the drifting parameter (samples,)


def strokes(
    duration: float, proximal: float = 0.03, distal: float = 0.02
) -> FloatArray:
    """Return the time and displacement of both ends, to and fro, (3, samples)."""
    time = np.arange(0.0, duration, DT)
    wave = -np.sin(2.0 * np.pi * time / PERIOD)
    return np.array([time, proximal * wave, distal * wave])


def pulls(duration: float, depth: float) -> FloatArray:
    """Return the same with the output locked and the motor end pulled and let go."""
    time = np.arange(0.0, duration, DT)
    pull = 0.5 * (1.0 - np.cos(2.0 * np.pi * time / PERIOD))
    return np.array([time, -depth * pull, np.zeros_like(time)])


def simulate(
    cable: Cable,
    motion: FloatArray,
    seed: int,
    *,
    drifting: str = "friction",
    factor: FloatArray | float = 1.0,
    noise: float = NOISE,
) -> Truth:
    """Play a motion through a cable of which one parameter drifts.

    Args:
        motion: of `strokes` or `pulls`.
        factor: what it is multiplied by, (samples,) or a number.
        noise: of every sensor [N].
    """
    time, proximal, distal = motion
    n = cable.segments
    factors = np.broadcast_to(np.asarray(factor, dtype=float), time.shape)
    values = np.array(cable.scalars)
    place = [p.name for p in PARAMETERS].index(drifting)
    sections = np.array(cable.conduit)
    prm = np.empty(kernel.parameter_size(n))
    state = rest_state(cable)
    new, work = state.copy(), np.empty(kernel.work_size(n))
    tension = np.empty((time.size, n + 1))
    direction = np.empty((time.size, n), dtype=np.int8)
    first = kernel.STATE_HEADER
    for row in range(time.size):
        if row % CHUNK_SIZE == 0:
            now = values.copy()
            now[place] *= factors[row]
            kernel.pack(now, sections, n, prm)
        kernel.advance(prm, n, state, proximal[row], distal[row], DT, new, work)
        state, new = new, state
        tension[row] = state[first : first + n + 1]
        direction[row] = np.sign(state[first + n + 1 : first + 2 * n + 1])
    places = np.linspace(0.0, cable.length, SENSORS)
    sensors = Sensors.at(cable, places.tolist(), noise)
    tension = np.maximum(tension, 0.0)
    random = np.random.default_rng(seed)
    clean = tension[:, list(sensors.nodes)]
    reading = clean + noise * random.normal(size=clean.shape)
    return Truth(time, proximal, distal, tension, direction, reading, sensors, factors)


def drift(duration: float, rest: float, gain: float) -> FloatArray:
    """Return a factor 1 for `rest` seconds, then linear to `gain` (samples,)."""
    time = np.arange(0.0, duration, DT)
    return np.interp(time, [0.0, rest, duration], [1.0, 1.0, gain])


def winding_path(cable: Cable, swing: float = 0.8, pieces: int = 20) -> Cable:
    """Return the cable in a smooth path: 1/R swings about its mean by this share."""
    x = (np.arange(pieces) + 0.5) / pieces
    curvature = cable.wrap / cable.length * (1.0 + swing * np.cos(2.0 * np.pi * x))
    length = cable.length / pieces
    path = tuple(Section(length, 1.0 / float(c)) for c in curvature)
    return cable.replace(conduit=path)


class Following(NamedTuple):
    """Convergence of an estimate to the truth, and how it followed it."""

    settled: float  # time after which the error stays within 5 % [s]; inf: never
    error: float  # RMS error after that, relative
    stated: float  # RMS of the deviation that it stated after that, relative
    covered: float  # share of samples after that with an error within two deviations


def tracking_statistics(
    time: FloatArray, value: FloatArray, deviation: FloatArray, truth: FloatArray
) -> Following:
    """Measure an estimate (samples,) against the truth (samples,)."""
    error = value / truth - 1.0
    outside = np.flatnonzero(~(np.abs(error) <= 0.05))
    start = int(outside[-1]) + 1 if outside.size else 0
    if start >= time.size:
        return Following(np.inf, np.nan, np.nan, np.nan)
    error, stated = error[start:], (deviation / truth)[start:]
    return Following(
        float(time[start]),
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(stated**2))),
        float(np.mean(np.abs(error) < 2.0 * stated)),
    )
