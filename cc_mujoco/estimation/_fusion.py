r"""Tensions at all nodes of a cable from several noisy tension sensors (3.2.1).

    sensors = Sensors.at(cable, positions=(0.2, 1.0, 1.8), deviation=(1.0, 0.5, 2.0))
    fusion = TensionFusion(cable, sensors)
    reading = cc_mujoco.read(model, data, "flexor")      # in an environment step
    fusion.update(measured, reading.slip)
    fusion.tension, fusion.deviation                  # every node, with its error

    over_time = fusion.over(measured, log["slip_flexor_direction"])   # of a recording

Where neighbouring segments slip, the capstan law (2.10) gives the ratio of the tensions
at their nodes from the directions of slip alone. A reading :math:`y_j` is then also one
of every such node i, :math:`T_i = y_j\,T_i/T_j`, with its noise multiplied by the same
ratio. The unbiased estimate of least variance is the mean of these readings, weighted
by inverse variance (Gauss-Markov). The plain mean equals it only if the noise of every
sensor is proportional to the tension there.

A node at rest keeps its tension. The thesis then keeps the estimate, with the error of
the last moment of motion. Here further readings are averaged, as all are of the same
tension, so that the error falls with the duration of rest. The tension at an end may
change while the segment next to it still rests; a reading that differs too much from
the average resets it.

Where the direction of slip changes, it does so inside a segment, whose ratio is then
between the two. The error is at most the ratio of that one segment.
"""

from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.arguments import MAX_FORCE, numbers, require_kind
from cc_mujoco._validation import require_number
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError, look_up, shown
from cc_mujoco.estimation._tracks import NoisySensors, checked_sample, rows
from cc_mujoco.native import FloatArray

Weights = Literal["variance", "mean"]
"""Inverse variance, or the plain mean of the thesis."""

AtRest = Literal["average", "hold"]
"""Treatment of nodes at rest: go on averaging, or hold as the thesis does."""

UNKNOWN_DEVIATION = 1e6  # standard deviation of an unknown tension [N]


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
    level = _cumulative_sums(mesh.angle * sign)
    ratio: FloatArray = np.exp(level[..., None, :] - level[..., nodes][..., None])
    if through_rest:
        return ratio
    run = _cumulative_sums((sign == 0.0).astype(float))
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

    Raises:
        CableError: numbers that are not finite, deviations that are not positive, a
            number of deviations other than of sensors, or an unknown choice.
    """
    _require_choice("weights", weights, Weights)
    readings = numbers("reading", reading, high=MAX_FORCE, unit="N")
    spread = numbers("deviation", deviation, high=MAX_FORCE, unit="N")
    if not np.all(spread > 0.0):
        raise CableError(f"deviation is {spread.min():g} N; it must be positive")
    tied = np.isfinite(gain)
    ratio = np.where(tied, gain, 1.0)
    if ratio.ndim < 2 or np.any(np.abs(ratio) > 1e100):
        raise CableError("gain must be the ratios that `tension_gains` returns")
    sizes = (readings.shape, spread.shape, gain.shape[:-1])
    try:
        np.broadcast_shapes(*sizes)
    except ValueError:
        raise CableError(
            f"reading, deviation and gain have shapes {sizes[0]}, {sizes[1]} and "
            f"{gain.shape}; they must be of the same sensors"
        ) from None
    noise = ratio * spread[..., None]
    share = tied / (noise**2 if weights == "variance" else 1.0)
    total = np.sum(share, axis=-2)
    share = share / np.where(total > 0.0, total, np.nan)[..., None, :]
    predicted = ratio * readings[..., None]
    tension = np.sum(share * predicted, axis=-2)
    return Fused(tension, np.sqrt(np.sum((share * noise) ** 2, axis=-2)))


def _require_choice(label: str, given: str, choices: Any) -> None:
    look_up(label, given, dict.fromkeys(get_args(choices)))


class TensionFusion(NoisySensors):
    """Estimator of all tensions of a cable whose directions of slip are known.

    One object serves one cable or many: readings and directions may have leading axes,
    which `reset` declares. `tension` is that of every node (..., n + 1) [N].
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        weights: Weights = "variance",
        at_rest: AtRest = "average",
    ) -> None:
        """Start from the pretension of a cable, whose friction must be Coulomb's alone.

        For `weights` see `fuse`. For nodes at rest, `at_rest="average"` averages
        further readings; `"hold"` keeps the estimate of the last moment of motion, as
        the thesis.

        Raises:
            CableError: no cable, no sensors, a sensor off the cable, or an unknown
                choice.
        """
        require_kind("cable", cable, Cable)
        require_kind("sensors", sensors, Sensors)
        _require_choice("weights", weights, Weights)
        _require_choice("at_rest", at_rest, AtRest)
        self.cable, self.sensors = cable, sensors
        self.mesh = Mesh.of(cable)
        self.noise = sensors.deviation
        self.weights: Weights = weights
        self.at_rest: AtRest = at_rest
        self._nodes = sensors.on(cable)
        self.reset()

    def reset(
        self,
        tension: ArrayLike | None = None,
        deviation: float = UNKNOWN_DEVIATION,
        shape: tuple[int, ...] = (),
    ) -> None:
        """Reset the state, and set the leading axes of later readings to `shape`.

        `tension` is that of the nodes, a number or (..., n + 1) [N], by default the
        pretension. Their errors are independent, of standard deviation `deviation` [N].

        Raises:
            CableError: a tension of another shape or not finite, a negative deviation,
                or an invalid shape.
        """
        count = self.mesh.segments + 1
        start = self.cable.pretension if tension is None else tension
        given = numbers("tension", start, unit="N", high=MAX_FORCE)
        require_number("deviation", deviation, 0.0, UNKNOWN_DEVIATION, "N")
        try:
            self.tension = np.array(np.broadcast_to(given, (*shape, count)))
        except (TypeError, ValueError):
            raise CableError(
                f"tension has shape {given.shape} and shape is {shown(shape)}; they "
                f"must give one number per node, (..., {count})"
            ) from None
        spread = np.diag(np.full(count, float(deviation) ** 2))
        self._covariance = np.array(np.broadcast_to(spread, (*shape, count, count)))

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the error of `tension` (..., n + 1) [N]."""
        variance = np.diagonal(self._covariance, axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def update(self, reading: ArrayLike, direction: ArrayLike) -> FloatArray:
        """Return the tension of every node (..., n + 1) [N] at the next instant.

        The attribute `tension` keeps it. `reading` is that of every sensor (..., m)
        [N], `direction` the slip of every segment, -1, 0 or 1, (..., n).

        Raises:
            CableError: shapes that match neither the sensors nor the cable, a reading
                that is not finite, or another direction.
        """
        sizes, leading = (self._nodes.size, self.mesh.segments), self.tension.shape[:-1]
        reading, sign = checked_sample(reading, direction, *sizes, leading)
        moves = np.zeros(self.tension.shape, dtype=bool)
        moves[..., :-1] |= sign != 0.0
        moves[..., 1:] |= sign != 0.0
        gain = tension_gains(self.mesh, sign, self._nodes)
        fused = fuse(reading, gain, self.noise, self.weights)
        found = moves & np.isfinite(fused.tension)
        self.tension = np.where(found, fused.tension, self.tension)
        # The errors of moving nodes are renewed, in one run all in proportion.
        deviation = np.where(found, fused.deviation, UNKNOWN_DEVIATION)
        run = _cumulative_sums((sign == 0.0).astype(float))
        together = run[..., :, None] == run[..., None, :]
        together &= found[..., :, None] & found[..., None, :]
        together |= np.eye(self.mesh.segments + 1, dtype=bool)
        new = together * deviation[..., :, None] * deviation[..., None, :]
        either = moves[..., :, None] | moves[..., None, :]
        self._covariance = np.where(either, new, self._covariance)
        if self.at_rest == "average":
            self._average(reading, ~moves[..., self._nodes])
        return self.tension

    def over(self, reading: ArrayLike, direction: ArrayLike) -> Fused:
        """Return estimates (samples, ..., n + 1) over a recording.

        They start from the present state. Readings are (samples, ..., m) [N],
        directions (samples, ..., n).

        Raises:
            CableError: unequal numbers of samples, or as `update`.
        """
        found = [
            (self.update(*row), self.deviation)
            for row in rows(reading=reading, direction=direction)
        ]
        whole = np.reshape(found, (-1, 2, *self.tension.shape))
        return Fused(whole[:, 0], whole[:, 1])

    def _average(self, reading: FloatArray, rests: NDArray[np.bool_]) -> None:
        """Apply a Kalman update for each sensor whose node rests.

        If a reading differs by more than 4 standard deviations, the node has moved
        after all, and its estimate is reset.
        """
        for sensor, node in enumerate(self._nodes):
            lack = reading[..., sensor] - self.tension[..., node]
            total = self._covariance[..., node, node] + self.noise[sensor] ** 2
            # Standard deviations by which a reading at rest may differ from the
            # estimate.
            moved = rests[..., sensor] & (lack**2 > 4.0**2 * total)
            self._covariance[..., node, :] *= ~moved[..., None]
            self._covariance[..., :, node] *= ~moved[..., None]
            self._covariance[..., node, node] += UNKNOWN_DEVIATION**2 * moved
            column = self._covariance[..., :, node]
            total = column[..., node] + self.noise[sensor] ** 2
            gain = column * (rests[..., sensor] / total)[..., None]
            self.tension = self.tension + gain * lack[..., None]
            self._covariance -= gain[..., :, None] * column[..., None, :]


def _cumulative_sums(values: FloatArray) -> FloatArray:
    """Return, for every node, the sum of segment values before it (..., n + 1)."""
    total = np.zeros((*values.shape[:-1], values.shape[-1] + 1))
    np.cumsum(values, axis=-1, out=total[..., 1:])
    return total
