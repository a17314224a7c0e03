"""Section 3.2.2: many noisy tension sensors, directions of slip unknown.

Chosen, as the text is silent: the cable of Table 2.2 with its kinetic friction,
10 segments, a sensor with 0.5 N noise at each of the 11 nodes, at most 50 N along the
cable; in the instant that is looked at the motor end moves by 0.5 mm. A sensor that is
wrong by the 1 to 2 N that stretch the cable as much sees the far end move backwards.

Single instants are exact by (2.10) and (2.12). The run in time has this package's
kernel on the same 11 nodes as truth, a weaker friction and 1 N noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable, replay
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray
from thesis import _directions as directions
from thesis._estimators import TensionFusion
from thesis._outcome import Finding, rms
from thesis._rig import PRINTED_CABLE

SEGMENTS = 10
CABLE = PRINTED_CABLE.replace(static_friction=0.0, segments=SEGMENTS)
TENSION, MOTION, NOISE = 50.0, 5e-4, 0.5
"""Largest tension [N], motion of the motor end [m], noise of every sensor [N]."""
SLOPES = (0.03, 0.21)  # friction coefficients of the slope check
RUN_CABLE = CABLE.replace(friction=0.1, pretension=20.0)
RUN_NOISE, DT = 1.0, 0.005
LAST_MOVING = (6, 7, 9, 7, 0, 0, 0)  # values of footnote 4


class _Votes(NamedTuple):
    moment: directions.Moment  # the truth
    reading: FloatArray  # (samples, m) [N]
    own: directions.OwnSolutions  # what each sensor makes of it
    wrong: NDArray[np.bool_]  # where a segment's direction is wrong (samples, m, n)


def sensor_votes(
    cable: Cable, condition: str, samples: int, noise: float = NOISE
) -> _Votes:
    """Return each sensor's own solution, from readings and the true state before."""
    mesh, pattern = Mesh.of(cable), directions.CONDITIONS[condition](SEGMENTS)
    moment = directions.Moment.of(mesh, pattern, TENSION, MOTION)
    sensors = Sensors.everywhere(cable, noise)
    reading, own = directions.sensor_votes(mesh, moment, sensors, samples, 38)
    return _Votes(moment, reading, own, own.pattern != pattern)


def side_means(values: FloatArray) -> tuple[float, float]:
    """Return means of `values` on either side of each sensor, one at every node.

    `values` are (m, n) for segments or (m, n + 1) for nodes.
    """
    sensor, place = np.indices(values.shape)
    extra = values.shape[1] == values.shape[0]
    after = place > sensor if extra else place >= sensor
    before = place < sensor
    return float(np.mean(values[before])), float(np.mean(values[after]))


Estimate = tuple[float, float]
"""Mean and its standard error."""


def bias(
    cable: Cable, condition: str, samples: int, noise: float
) -> tuple[Estimate, Estimate, float]:
    """Return the bias from omitting sensors that disagree (plain means, as printed).

    That is the error of the output tension [N] by the sensors alone whose solution is
    the consensus, that by all sensors with the matrix of the consensus, and the share
    of segments whose consensus direction is wrong.
    """
    moment, reading, own, _ = sensor_votes(cable, condition, samples, noise)
    mesh, nodes = Mesh.of(cable), np.arange(SEGMENTS + 1)
    pattern = directions.majority_directions(own.pattern, moment.pattern)
    gain = tension_gains(mesh, pattern, nodes, through_rest=True)[..., -1]
    agrees = np.all(own.pattern == pattern[:, None, :], axis=2)
    some = np.any(agrees, axis=1)
    theirs = np.where(agrees, own.tension[..., -1], 0.0)[some]
    agreeing = np.sum(theirs, axis=1) / np.sum(agrees[some], axis=1)
    by_agreeing, by_all = (
        (float(np.mean(out)) - moment.tension[-1], float(np.std(out)) / out.size**0.5)
        for out in (agreeing, np.mean(gain * reading, axis=1))
    )
    return by_agreeing, by_all, float(np.mean(pattern != moment.pattern))


def simulate_run(seconds: float = 6.0) -> tuple[dict[str, float], dict[str, float]]:
    """Return RMS errors at the output and over all nodes [N], by name of the estimator.

    Motor and wearer pull and release, with rests; the encoder is exact.
    """
    time = np.arange(0.0, seconds, DT)
    knots = [0.0, 1.0, 1.5, 2.5, 3.0, 4.0, 4.5, 5.5, 6.0]
    proximal = -0.03 * np.interp(time, knots, [0, 1, 1, 0.2, 0.2, 1.2, 1.2, 0.3, 0.3])
    distal = -0.02 * np.interp(time, knots, [0, 0.7, 0.7, 0, 0, 1, 1, 0.2, 0.2])
    true = replay(RUN_CABLE, DT, u_proximal=proximal, u_distal=distal, profile=True)
    random = np.random.default_rng(39)
    reading = true.tension + RUN_NOISE * random.normal(size=true.tension.shape)
    given = RUN_CABLE, Sensors.everywhere(RUN_CABLE, RUN_NOISE)
    vote = directions.SensorConsensus(*given, threshold=0.0)
    at_once = directions.SensorConsensus(*given, likeliest=True)
    rows = list(zip(proximal.tolist(), reading, strict=True))
    found = {
        name: np.array([each.update(*row).copy() for row in rows])
        for name, each in (("vote", vote), ("at once", at_once))
    }
    found["known"] = TensionFusion(*given).over(reading, true.direction).tension
    errors = {name: each - true.tension for name, each in found.items()}
    return (
        {name: rms(error[:, -1]) for name, error in errors.items()},
        {name: rms(error) for name, error in errors.items()},
    )


def run() -> tuple[Finding, ...]:
    """Reproduce what Figs. 3.7 and 3.8 show, and the consensus."""
    found = {name: sensor_votes(CABLE, name, 2000) for name in directions.CONDITIONS}
    wrong = {k: side_means(np.mean(v.wrong, axis=0)) for k, v in found.items()}
    ratio = {k: _excess_error(v) for k, v in found.items()}
    steeper = (CABLE.replace(friction=mu) for mu in SLOPES)
    votes = [sensor_votes(cable, "towards distal", 2000).wrong for cable in steeper]
    slope = [side_means(np.mean(each, axis=0))[1] for each in votes]
    agreeing, shared, consensus = bias(CABLE, "towards distal", 3000, NOISE)
    output, everywhere = simulate_run()
    several = max(float(np.mean(v.own.fitting > 1)) for v in found.values())
    distal = found["towards distal"]
    mistaken = np.any(distal.wrong, axis=2)
    low = float(np.mean((distal.reading < distal.moment.tension)[mistaken]))
    before = max(value[0] for value in wrong.values())
    after = [value[1] for value in wrong.values()]
    inner, outer = zip(*ratio.values(), strict=True)
    significant = abs(agreeing[0]) > 4.0 * agreeing[1]
    unbiased = abs(shared[0]) < 4.0 * shared[1]
    printed, mended = output["vote"], output["at once"]
    middle = directions.median_last_moving(LAST_MOVING)
    # A consensus should be worth more than one sensor at the output.
    verdict = "in part" if mended < RUN_NOISE else "disagrees"
    if printed < RUN_NOISE:
        verdict = "agrees"
    return (
        Finding(
            f"wrong {min(after):.1%} to {max(after):.0%} of segments after it, at most "
            f"{before:.2%} before; moving distally {low:.0%} of these read too low",
            "agrees" if 20.0 * before < min(after) and low > 0.95 else "in part",
            "after the sensor a wrong direction confirms itself: up to "
            f"{several:.0%} of solutions have several consistent patterns",
        ),
        Finding(
            f"RMS per noise carried with true directions: {min(outer):.1f} to "
            f"{max(outer):.0f} times after the sensor, {min(inner):.2f} to "
            f"{max(inner):.2f} before",
            "agrees" if min(outer) > 1.2 * max(inner) else "in part",
        ),
        Finding(
            f"wrong segments after the sensor: {slope[0]:.2%} at mu = {SLOPES[0]:g}, "
            f"{slope[-1]:.2%} at {SLOPES[-1]:g}",
            "agrees" if slope[-1] < slope[0] else "disagrees",
        ),
        Finding(
            f"output off by {agreeing[0]:+.3f} N +- {agreeing[1]:.3f} with only these, "
            f"{shared[0]:+.3f} N +- {shared[1]:.3f} with all",
            "agrees" if significant and unbiased else "in part",
            f"{NOISE:g} N noise on {TENSION:g} N, consensus wrong in "
            f"{consensus:.2%} of segments",
        ),
        Finding(
            f"mean {np.mean(LAST_MOVING):.1f}, median {middle}",
            "agrees" if middle == 6 else "disagrees",
        ),
        Finding(
            f"output RMS: vote {printed:.1f} N, all readings at once {mended:.2f} N; "
            f"known {output['known']:.2f} N; one sensor {RUN_NOISE:g} N",
            verdict,
            "the vote, as we read it, believes its past errors; all nodes: at once "
            f"{everywhere['at once']:.2f} N",
        ),
    )


def _excess_error(found: _Votes) -> tuple[float, float]:
    """Return the RMS error relative to noise that is carried correctly."""
    nodes = np.arange(SEGMENTS + 1)
    gain = tension_gains(Mesh.of(CABLE), found.moment.pattern, nodes, through_rest=True)
    truly = side_means((NOISE * gain) ** 2)
    error = found.own.tension - found.moment.tension
    have = side_means(np.mean(error**2, axis=0))
    return float(np.sqrt(have[0] / truly[0])), float(np.sqrt(have[1] / truly[1]))
