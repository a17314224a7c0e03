r"""Tensions at all nodes of a cable from several noisy tension sensors (3.2.1).

    gain = tension_gains(Mesh.of(cable), direction, sensors.on(cable))
    tension, deviation = fuse(reading, gain, sensors.deviation)

Where neighbouring segments slip, the capstan law (2.10) gives the ratio of the tensions
at their nodes from the directions of slip alone. A reading :math:`y_j` is then also one
of every such node i, :math:`T_i = y_j\,T_i/T_j`, with its noise multiplied by the same
ratio. The unbiased estimate of least variance is the mean of these readings, weighted
by inverse variance (Gauss-Markov). The plain mean equals it only if the noise of every
sensor is proportional to the tension there.

Where the direction of slip changes, it does so inside a segment, whose ratio is then
between the two. The error is at most the ratio of that one segment.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._segments import Mesh
from cc_mujoco.native import FloatArray

Weights = Literal["variance", "mean"]
"""Inverse variance, or the plain mean of the thesis."""


class Fused(NamedTuple):
    """Tension of every node and the standard deviation of its error."""

    tension: FloatArray  # (..., n + 1) [N]
    deviation: FloatArray  # (..., n + 1) [N]


def tension_gains(
    mesh: Mesh,
    direction: ArrayLike,
    nodes: NDArray[np.intp],
    *,
    through_rest: bool = False,
) -> FloatArray:
    """Return the ratio of every node's tension to that at each sensor (2.10).

    `direction` is the slip of every segment, -1, 0 or 1, (..., n); `nodes` are those of
    the sensors (m,). Ratios (..., m, n + 1) are NaN if a segment at rest lies between,
    because the two tensions are then independent. With `through_rest` tension is
    constant along such a segment, as if it were in mass motion (3.2.2) at zero speed.
    """
    sign = np.sign(np.asarray(direction, dtype=float))
    level = cumulative_sums(mesh.angle * sign)
    ratio: FloatArray = np.exp(level[..., None, :] - level[..., nodes][..., None])
    if through_rest:
        return ratio
    run = cumulative_sums((sign == 0.0).astype(float))
    return np.where(run[..., None, :] == run[..., nodes][..., None], ratio, np.nan)


def fuse(
    reading: ArrayLike,
    gain: FloatArray,
    deviation: ArrayLike,
    weights: Weights = "variance",
) -> Fused:
    """Combine readings of one or many instants into the tension of every node.

    Return tensions and their standard deviation, NaN at nodes with a ratio to no
    sensor.

    Args:
        reading: reading of every sensor (..., m) [N].
        gain: ratios from `tension_gains`, (..., m, n + 1).
        deviation: standard deviation of the sensors (m,) or (..., m) [N].
        weights: `"variance"` for the unbiased estimate of least variance, `"mean"` for
            the plain mean, as in the thesis.
    """
    readings, spread = np.asarray(reading, float), np.asarray(deviation, float)
    tied = np.isfinite(gain)
    ratio = np.where(tied, gain, 1.0)
    noise = ratio * spread[..., None]
    share = tied / (noise**2 if weights == "variance" else 1.0)
    total = np.sum(share, axis=-2)
    share = share / np.where(total > 0.0, total, np.nan)[..., None, :]
    predicted = ratio * readings[..., None]
    tension = np.sum(share * predicted, axis=-2)
    return Fused(tension, np.sqrt(np.sum((share * noise) ** 2, axis=-2)))


def cumulative_sums(values: FloatArray) -> FloatArray:
    """Return, for every node, the sum of segment values before it (..., n + 1)."""
    total = np.zeros((*values.shape[:-1], values.shape[-1] + 1))
    np.cumsum(values, axis=-1, out=total[..., 1:])
    return total
