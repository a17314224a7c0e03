"""Section 3.2.3: friction, bend and stiffness estimated while the cable runs.

Each estimator starts wrong by a factor of 2 and then follows a truth that drifts for
three minutes. Encoders are taken as exact; the memory of each estimator is stated in
its claim. Fig. 3.9 comes first, with the update law that the thesis proposes from it.

Chosen, because the text gives none: the cable of Table 2.2 with its kinetic friction
and 40 N of pretension, which keeps it taut; strokes of the motor end of 30 mm in 4 s
that the output follows with 20 mm; 100 samples a second; a sensor at each of the 11
nodes of 3.2.1 with 1 N of white noise. Truth is this package's kernel.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from cc_mujoco.cable import PARAMETERS, Cable, Section, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.estimation._tension_slope import FrictionEstimator
from cc_mujoco.estimation._tracks import EstimateTrack
from cc_mujoco.native import FloatArray
from thesis._outcome import Finding, Outcome, Panel, Progress, rms
from thesis._rig import PRINTED_CABLE
from thesis.estimators import _parameters as parameters
from thesis.estimators._unscented import UnscentedEstimator

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
    """A motion, the true state of the cable, and the readings of the sensors."""

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
    """Return time [s] and displacements of both ends [m], (3, samples), to and fro."""
    time = np.arange(0.0, duration, DT)
    wave = -np.sin(2.0 * np.pi * time / PERIOD)
    return np.array([time, proximal * wave, distal * wave])


def pulls(duration: float, depth: float) -> FloatArray:
    """Return the arrays of `strokes` for pulls of the motor end, the output locked."""
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
    """Simulate a motion of a cable whose parameter `drifting` is scaled by `factor`."""
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
    """Return a factor (samples,): 1 for `rest` [s], then linear to `gain`."""
    time = np.arange(0.0, duration, DT)
    return np.interp(time, [0.0, rest, duration], [1.0, 1.0, gain])


def winding_path(cable: Cable, swing: float = 0.8, pieces: int = 20) -> Cable:
    """Return the cable in a path whose 1/R varies about its mean by this fraction."""
    x = (np.arange(pieces) + 0.5) / pieces
    curvature = cable.wrap / cable.length * (1.0 + swing * np.cos(2.0 * np.pi * x))
    length = cable.length / pieces
    path = tuple(Section(length, 1.0 / float(c)) for c in curvature)
    return cable.replace(conduit=path)


class Following(NamedTuple):
    """Convergence and tracking error of an estimate that follows a drifting truth."""

    settled: float  # time after which the error stays within 5 % [s]; inf: never
    error: float  # RMS error after that, relative
    stated: float  # RMS of the deviation that it stated after that, relative
    covered: float  # share of samples after that with an error within two deviations


def tracking_statistics(
    time: FloatArray, value: FloatArray, deviation: FloatArray, truth: FloatArray
) -> Following:
    """Compare an estimate and its deviation with the truth, (samples,) each."""
    error = value / truth - 1.0
    outside = np.flatnonzero(~(np.abs(error) <= 0.05))
    start = int(outside[-1]) + 1 if outside.size else 0
    if start >= time.size:
        return Following(np.inf, np.nan, np.nan, np.nan)
    error, stated = error[start:], (deviation / truth)[start:]
    covered = float(np.mean(np.abs(error) < 2.0 * stated))
    return Following(float(time[start]), rms(error), rms(stated), covered)


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
    """Propagate sensor readings along the cable by models of wrong friction."""
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
    carried = np.array(models)
    drop = np.mean(carried[:, :, 0] - carried[:, :, -1], axis=1)
    straight = -10.0 * float(np.polyfit(nodes, clean, 1)[0])
    return MassMotion(
        reading, line, carried, drop / (line[0] - line[-1]),
        straight / float(clean[0] - clean[-1]),
    )  # fmt: skip


class PrintedLaws(NamedTuple):
    """The printed update law and its corrections, each at its best gain."""

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
    """Run the printed update law and its corrections, each with its best gain."""
    truth = simulate(CABLE, strokes(duration), seed)
    late = truth.time >= duration - 8.0
    tracks, left = {}, {}
    for name, choice in LAWS.items():
        best = np.inf
        for gain in GAINS:
            law = parameters.SlopeLaw(
                CABLE, truth.sensors, gain,
                start=INITIAL_GUESS_FACTOR * CABLE.friction, **choice,
            )  # fmt: skip
            rows = zip(truth.reading, truth.direction, strict=True)
            track = np.array([law.update(*row) for row in rows])
            error = track[late] / CABLE.friction - 1.0
            if (size := rms(error)) < best:
                best, tracks[name] = size, track
                left[name] = size / (INITIAL_GUESS_FACTOR - 1.0)
            if size > 3.0 * (INITIAL_GUESS_FACTOR - 1.0):
                break  # larger gains only oscillate more
    ours = FrictionEstimator(
        CABLE, truth.sensors, start=INITIAL_GUESS_FACTOR * CABLE.friction,
        memory=FRICTION_MEMORY,
    )  # fmt: skip
    track = ours.over(truth.reading, truth.direction).value
    error = track[late] / CABLE.friction - 1.0
    tracks["least squares"] = track
    left["least squares"] = rms(error) / (INITIAL_GUESS_FACTOR - 1.0)
    return PrintedLaws(truth.time, tracks, left, bias())


def bias() -> float:
    """Return the relative bias of the printed law, which fits a line to a curve."""
    truth = simulate(CABLE, strokes(2.0), 0, noise=1e-9)
    row = round(0.8 / DT)
    law = parameters.SlopeLaw(CABLE, truth.sensors, 1.0)

    def discrepancy(friction: float) -> float:
        law.friction = friction
        return law.discrepancy(truth.reading[row], float(truth.direction[row, 0]))

    low, high = 0.5 * CABLE.friction, 2.0 * CABLE.friction
    return float(brentq(discrepancy, low, high)) / CABLE.friction - 1.0


FRICTION_DRIFT, STIFFNESS_DRIFT = 1.5, 0.7
"""Friction and stiffness at the end, over those at the start."""


def simulate_wear(duration: float = DRIFT_END, seed: int = 41) -> Truth:
    """Simulate strokes while friction grows."""
    factor = drift(duration, DRIFT_START, FRICTION_DRIFT)
    return simulate(CABLE, strokes(duration), seed, factor=factor)


def estimate_recursively(truth: Truth) -> EstimateTrack:
    """Return friction by recursive least squares from sensors along the cable."""
    rate = (FRICTION_DRIFT - 1.0) * CABLE.friction * DT / (truth.time[-1] - DRIFT_START)
    estimator = FrictionEstimator(
        CABLE, truth.sensors, start=INITIAL_GUESS_FACTOR * CABLE.friction,
        memory=FRICTION_MEMORY, drift=rate,
    )  # fmt: skip
    return estimator.over(truth.reading, truth.direction)


def estimate_unscented(truth: Truth) -> EstimateTrack:
    """Estimate friction, stiffness and pretension from the ends, from wrong guesses."""
    guess = CABLE.replace(
        friction=INITIAL_GUESS_FACTOR * CABLE.friction,
        axial_stiffness=1.5 * CABLE.axial_stiffness,
        pretension=0.75 * CABLE.pretension,
    )
    names = ("friction", "axial_stiffness", "pretension")
    drifts = [0.02, 0.0, 0.0]
    estimator = UnscentedEstimator(guess, names, DT, noise=NOISE, drift=drifts)
    ends = truth.reading[:, 0], truth.reading[:, -1]
    return estimator.over(truth.u_proximal, truth.u_distal, *ends)


class Bends(NamedTuple):
    """mu/R at places along a winding cable: truth and estimate."""

    truth: FloatArray  # (samples, places) [1/m]
    found: parameters.Bend  # the estimate (samples, places) [1/m]
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
    estimator = parameters.BendEstimator(
        cable, data.sensors, start=INITIAL_GUESS_FACTOR * mean, memory=BEND_MEMORY,
        drift=rate,
    )  # fmt: skip
    found = estimator.over(data.reading, data.direction, CURVATURE_PLACES)
    angle = [section.length / section.radius for section in cable.conduit]
    middle = (np.arange(len(angle)) + 0.5) * cable.length / len(angle)
    curvature = np.array(angle) * len(angle) / cable.length
    along = np.interp(CURVATURE_PLACES, middle, curvature)
    truth = factor[:, None] * CABLE.friction * along
    error = (found.value - truth) / (factor[:, None] * mean)
    stated = found.deviation / (factor[:, None] * mean)
    late = data.time >= DRIFT_START
    settled = ~late & (data.time >= DRIFT_START - 4.0)
    return Bends(
        truth, found, rms(error[settled]), rms(error[late]), rms(stated[late]),
        INITIAL_GUESS_FACTOR * mean,
    )  # fmt: skip


class Softening(NamedTuple):
    """Axial stiffness EA while it falls: truth and estimate."""

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
    """Estimate stiffness with locked output, by pulls whose motion ends inside."""
    cable = CABLE.replace(segments=50, pretension=20.0)
    factor = drift(duration, DRIFT_START, STIFFNESS_DRIFT)
    motion = pulls(duration, PULL_DEPTH)
    data = simulate(cable, motion, seed, drifting="axial_stiffness", factor=factor)
    stiffness = cable.axial_stiffness
    rate = (1.0 - STIFFNESS_DRIFT) * stiffness * DT / (duration - DRIFT_START)
    estimator = parameters.StiffnessEstimator(
        cable, data.sensors, start=INITIAL_GUESS_FACTOR * stiffness,
        memory=SOFT_MEMORY, drift=rate,
    )  # fmt: skip
    found = estimator.over(data.u_proximal, data.reading, data.direction)
    settled = (data.time > 0.5 * DRIFT_START) & (data.time < DRIFT_START)
    # Mass motion only, declared as partial and as what it is.
    free = simulate(CABLE, strokes(DRIFT_START), seed)
    mass = np.all(free.direction != 0, axis=1)
    rows, direction = (free.u_proximal[mass], free.reading[mass]), free.direction[mass]
    lie = direction.copy()
    lie[:, -1] = 0
    start = INITIAL_GUESS_FACTOR * CABLE.axial_stiffness
    fooled, refused = (
        parameters.StiffnessEstimator(CABLE, free.sensors, start=start)
        .over(*rows, each)
        .value[-1]
        for each in (lie, direction)
    )
    return Softening(
        data.time, stiffness * data.factor, found,
        float(np.mean(found.value[settled])) / stiffness - 1.0,
        float(fooled / CABLE.axial_stiffness), float(refused / start),
    )  # fmt: skip


def run(progress: Progress) -> Outcome:
    instant = slopes()
    printed = laws()
    progress(0.3)
    truth = simulate_wear()
    friction = CABLE.friction * truth.factor
    by_slope = estimate_recursively(truth)
    progress(0.5)
    by_ends = estimate_unscented(truth)
    progress(0.6)
    bend = estimate_bends()
    progress(0.9)
    soft = estimate_softening()
    one = tracking_statistics(truth.time, *by_slope, friction)
    ends = tracking_statistics(
        truth.time, by_ends.value[:, 0], by_ends.deviation[:, 0], friction
    )
    claims = (
        _claim_slopes(instant), claim_law(printed), _claim_filters(one, ends),
        _claim_bend(bend), claim_stiffness(soft),
    )  # fmt: skip
    tracks = {
        "slope of ln T, 11 sensors": (by_slope.value, by_slope.deviation),
        "unscented, ends only": (by_ends.value[:, 0], by_ends.deviation[:, 0]),
    }
    figures = {
        "slopes": _slopes(instant, printed),
        "tracking": _tracking(truth.time, friction, tracks),
        "bend_and_stiffness": [_bend(bend), _stiffness(soft)],
    }
    return Outcome(claims, figures)


def _claim_slopes(found: MassMotion) -> Finding:
    ratio = found.ratio
    grows = bool(np.all(np.diff(ratio) > 0.0)) and ratio[0] < 0.9 and ratio[-1] > 1.1
    carried = ", ".join(
        f"{r:.2f} (x{m:g})" for r, m in zip(ratio, MODEL_FRICTIONS, strict=True)
    )
    return Finding(
        f"T_1 - T_N of the model over the fit's: {carried}",
        "agrees" if grows else "disagrees",
        "one instant, 11 sensors with 1 N; even at the right mu the line differs: "
        f"without noise it has {found.exact:.1%} of the true T_1 - T_N",
    )


def claim_law(found: PrintedLaws) -> Finding:
    """Judge whether the update law of the thesis works, as printed or corrected."""
    left = found.left
    printed, signed, summed, ours = left
    good = left[printed] < 0.25
    mended = left[summed] < 0.05
    return Finding(
        f"error left of 100 %, at its best k: {left[printed]:.0%}; turned with motion "
        f"{left[signed]:.0%}; also integrated {left[summed]:.1%} (at rest "
        f"{found.bias:+.1%} off); ours {left[ours]:.2%}",
        "agrees" if good else "in part" if mended else "disagrees",
    )


def _claim_filters(one: Following, ends: Following) -> Finding:
    good = all(f.settled < DRIFT_START and f.error < 0.02 for f in (one, ends))
    honest = all(f.covered > 0.85 for f in (one, ends))
    return Finding(
        f"from 2 mu: 5 % in {one.settled:.2f} s (slope), {ends.settled:.2f} s "
        f"(unscented); +50 % in 3 min followed to {one.error:.2%} and {ends.error:.2%} "
        f"RMS, stated {one.stated:.2%} and {ends.stated:.2%}",
        "agrees" if good and honest else "in part",
        f"slope: 11 sensors, memory {FRICTION_MEMORY} samples, mostly lag; unscented: "
        "both ends only, stiffness and pretension found too; 1 N noise",
    )


def _claim_bend(found: Bends) -> Finding:
    good = found.before < 0.03 and found.during < 0.03
    return Finding(
        f"from uniform 2 x mean: RMS over x {found.before:.1%} of the mean; mu +50 % "
        f"in 3 min followed to {found.during:.1%} (stated {found.stated:.1%})",
        "agrees" if good else "in part",
        "1/R swings by 80 % once along the cable, 11 sensors; cubic spline of 4 pieces "
        f"for mu/R, its misfit not in what it states; memory {BEND_MEMORY} samples",
    )


def claim_stiffness(found: Softening) -> Finding:
    """Judge whether stiffness is followed in partial motion, refused in mass motion."""
    result = tracking_statistics(found.time, *found.found, found.truth)
    good = result.settled < DRIFT_START and result.error < 0.05
    guarded = abs(found.refused - 1.0) < 1e-12 and abs(found.fooled - 1.0) > 0.2
    return Finding(
        f"from 2 K_c: 5 % in {result.settled:.1f} s; -30 % in 3 min followed to "
        f"{result.error:.1%} RMS (stated {result.stated:.1%}); in mass motion it would "
        f"find {found.fooled:.2f} K_c, so it refuses",
        "agrees" if good and guarded else "in part",
        f"output locked, memory {SOFT_MEMORY} samples; lag, and {found.before:+.1%} "
        "by quadrature at 11 sensors; tension is fitted on the encoder, which is exact",
    )


def _slopes(instant: MassMotion, printed: PrintedLaws) -> list[Panel]:
    """Return Fig. 3.9, and the laws that use it."""
    nodes = np.arange(1, instant.reading.size + 1)
    models = {
        f"mean of models with {model:g} mu": (nodes, carried.mean(axis=0))
        for model, carried in zip(MODEL_FRICTIONS, instant.models, strict=True)
    }
    models["line fitted"] = (nodes, instant.line)
    models["sensors"] = (nodes, instant.reading, "o")
    laws = {name: (printed.time, track) for name, track in printed.tracks.items()}
    laws["truth"] = (printed.time, np.full(printed.time.size, CABLE.friction), "--")
    return [
        Panel(
            "Each sensor's reading, carried along the cable by models",
            "node, from the motor", "tension [N]", models,
        ),
        Panel(
            "Friction from twice the truth, laws at their best gains", "time [s]",
            "friction coefficient", laws, limits=(0.0, 0.7),
        ),
    ]  # fmt: skip


def _tracking(
    time: FloatArray,
    friction: FloatArray,
    tracks: dict[str, tuple[FloatArray, FloatArray]],
) -> list[Panel]:
    values = {"truth": (time, friction)}
    errors = {}
    for name, (value, deviation) in tracks.items():
        values[name] = (time, value)
        errors[name] = (time, 100.0 * (value / friction - 1.0))
        stated = 200.0 * deviation / friction
        errors[f"{name}: two stated deviations"] = (time, stated, "--")
    return [
        Panel(
            "Friction that grows by half in three minutes", "time [s]",
            "friction coefficient", values, limits=(0.15, 0.45),
        ),
        Panel(
            "Error, and what the estimators state", "time [s]",
            "error [% of the truth]", errors, limits=(-2.5, 2.5),
        ),
    ]  # fmt: skip


def _bend(bend: Bends) -> Panel:
    curves = {}
    moments = {
        f"after {DRIFT_START:g} s": round(DRIFT_START / DT) - 1,
        "at the end, friction grown by half": -1,
    }
    for name, row in moments.items():
        value, spread = bend.found.value[row], 2.0 * bend.found.deviation[row]
        curves[f"estimate {name}"] = (CURVATURE_PLACES, value)
        curves[f"two deviations more, {name}"] = (CURVATURE_PLACES, value + spread, ":")
        curves[f"truth {name}"] = (CURVATURE_PLACES, bend.truth[row], "--")
    title = f"Friction over bend radius, start at {bend.start:.2f} 1/m"
    return Panel(title, "position from the motor [m]", "mu/R [1/m]", curves)


def _stiffness(soft: Softening) -> Panel:
    spread = 2.0 * soft.found.deviation
    return Panel(
        "Axial stiffness from partial motion, start at twice the truth", "time [s]",
        "EA [N]",
        {
            "truth": (soft.time, soft.truth), "estimate": (soft.time, soft.found.value),
            "two deviations more": (soft.time, soft.found.value + spread, ":"),
            "two deviations less": (soft.time, soft.found.value - spread, ":"),
        },
        limits=(2e3, 5e3),
    )  # fmt: skip
