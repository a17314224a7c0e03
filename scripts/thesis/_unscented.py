r"""Unscented filter on the parameters of a cable: any of them, from its ends alone.

The thesis names it as the alternative to an update law (3.2.3; Srang and Yamakita,
Proc. ACC 2014; Julier and Uhlmann, Proc. IEEE 92, 2004; Wan and van der Merwe, Proc.
AS-SPCC 2000). The state of the filter are the logarithms of the parameters, a random
walk; the measurement model is the cable itself, driven by what is measured at its ends.
It needs no sensors along the cable and no directions of slip. The unscented transform
is read as statistical linear regression: what a function does to a normal distribution,
as a straight line and the covariance of what the line leaves.

Every window is linearized again around what it has just taught, until that settles
(Garcia-Fernandez, Svensson, Morelande and Sarkka, IEEE Trans. Signal Process. 63,
2015). The plain filter, one linearization around what was known before, errs by its
curvature in the first windows, and believes later that it knew better.

A cable has a memory, the profile of tension that stands in its conduit. It ends
whenever the whole cable slips one way: what the profile is then follows from the
cable's length and its parameters alone. The latest such sample, the anchor, is where
replays begin, so a cable that goes to and fro has at most one stroke to replay. Until
there is an anchor they begin at the first sample, which must be at rest in the
pretension. Friction terms beyond Coulomb's, which remember more, must be off. Within a
window and back to the anchor parameters are taken as constant: what they drift
meanwhile is not in the deviation that the filter states.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import Replay, node_lengths, replay
from cc_mujoco.estimation._tension_slope import wrap_angles
from cc_mujoco.native import FloatArray
from thesis._estimators import EstimateTrack

CONVERGED_SIGMAS, ROUNDS = 0.1, 8
"""Change of the mean, in standard deviations, below which a window is done; most
linearizations of one window."""
SPREAD = 0.5  # standard deviation of the logarithms of the guess


def sigma_points(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean and 2 p points around it (2 p + 1, p).

    With the scaling of Wan and van der Merwe (Proc. AS-SPCC 2000) at alpha = 1,
    kappa = 0, where no weight is negative, so that every covariance made of them is
    one. The mean itself then counts for covariances only.
    """
    reach = np.sqrt(mean.size) * np.linalg.cholesky(covariance).T
    return np.concatenate([mean[None], mean + reach, mean - reach])


def linearize(
    points: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a statistical linear regression of values (2 p + 1, k) at sigma points.

    That is slope (k, p), offset (k,) and covariance (k, k) of the residual.
    """
    size = points.shape[1]
    # For a normal distribution.
    weight = np.concatenate([[2.0], np.full(2 * size, 0.5 / size)])
    mean, middle = np.mean(points[1:], axis=0), np.mean(values[1:], axis=0)
    shift, change = points - mean, values - middle
    covariance = (weight * shift.T) @ shift
    slope = np.linalg.solve(covariance, (weight * shift.T) @ change).T
    left = change - shift @ slope.T
    return slope, middle - slope @ mean, (weight * left.T) @ left


def replayed(
    cable: Cable, dt: float, ends: FloatArray, way: float, rest: float
) -> Replay:
    """Replay both ends (2, samples) [m] from an anchor at which all slips this way.

    `rest` is the distance of the ends in the pretension [m]; `way` is 0 at rest.
    """
    profile = np.exp(way * cable.friction * wrap_angles(cable))
    strain = cable.pretension * cable.length / cable.axial_stiffness
    stretch = max(strain + float(ends[1, 0] - ends[0, 0]) - rest, 0.0)
    profile *= stretch * cable.axial_stiffness / float(node_lengths(cable) @ profile)
    return replay(
        cable, dt, initial_tension=profile, u_proximal=ends[0], u_distal=ends[1]
    )


def whole_slip(cables: Sequence[Cable], played: Sequence[Replay]) -> FloatArray:
    """Return the direction in which the whole cable slips in every sample, or 0.

    It counts where all cables agree and where the tensions of the ends are those of
    the capstan law, so that no change of direction hides in a segment.
    """
    ways = []
    for cable, motion in zip(cables, played, strict=True):
        proximal, distal = motion.tension_proximal, motion.tension_distal
        taut = (proximal > 0.0) & (distal > 0.0) & (motion.moving_fraction == 1.0)
        ratio = np.log(np.where(taut, distal, 1.0) / np.where(taut, proximal, 1.0))
        whole = cable.friction * cable.wrap
        right = taut & (np.abs(np.abs(ratio) - whole) < 1e-6 * whole)
        ways.append(np.where(right, np.sign(ratio), 0.0))
    return np.where(np.all(np.array(ways) == ways[0], axis=0), ways[0], 0.0)


def follow_parameters(
    cable: Cable,
    names: Sequence[str],
    dt: float,
    ends: FloatArray,
    *,
    noise: float,
    drift: ArrayLike = 0.0,
    window: int = 50,
) -> EstimateTrack:
    """Estimate the named parameters (samples, p) from the cable's values of them.

    Ends are displacements [m] and tensions [N], (4, samples), proximal first, `dt`
    apart [s]; estimates change at every `window`-th. The standard deviation of both
    tensions is `noise` [N], that of the random walk of the logarithms in the root of a
    second `drift`.
    """
    prior = np.log([getattr(cable, name) for name in names])
    spread = SPREAD**2 * np.eye(prior.size)
    wander = np.broadcast_to(np.asarray(drift) ** 2 * window * dt, prior.shape)
    value = np.empty((ends.shape[1], prior.size))
    deviation = np.empty_like(value)
    value[:], deviation[:] = np.exp(prior), SPREAD * np.exp(prior)
    anchor, way, rest = 0, 0.0, float(ends[1, 0] - ends[0, 0])
    for last in range(window, ends.shape[1] + 1, window):
        measured = ends[2:, last - window : last].ravel()
        spread = spread + np.diag(wander)
        mean, covariance = prior, spread
        for _ in range(ROUNDS):
            points = sigma_points(mean, covariance)
            cables = [
                cable.replace(**dict(zip(names, np.exp(point).tolist(), strict=True)))
                for point in points
            ]
            recording = ends[:2, anchor:last]
            played = [replayed(one, dt, recording, way, rest) for one in cables]
            answers = [
                (motion.tension_proximal[-window:], motion.tension_distal[-window:])
                for motion in played
            ]
            slope, offset, residual = linearize(
                points, np.reshape(answers, (len(points), -1))
            )
            across = slope @ spread
            total = across @ slope.T + residual + noise**2 * np.eye(measured.size)
            gain = np.linalg.solve(total, across).T
            before = mean
            mean = prior + gain @ (measured - offset - slope @ prior)
            covariance = spread - gain @ across
            covariance = 0.5 * (covariance + covariance.T)
            moved = np.abs(mean - before)
            if np.all(moved < CONVERGED_SIGMAS * np.sqrt(np.diag(covariance))):
                break
        prior, spread = mean, covariance
        value[last - 1 :] = np.exp(mean)
        deviation[last - 1 :] = np.exp(mean) * np.sqrt(np.diag(covariance))
        anchors = np.flatnonzero(slips := whole_slip(cables, played))
        if anchors.size > 0:
            way = float(slips[anchors[-1]])
            anchor += int(anchors[-1])
    return EstimateTrack(value, deviation)
