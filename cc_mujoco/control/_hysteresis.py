"""Models of hysteresis from motor angle to joint angle, and their inverses.

    model = MODELS["backlash_inverse"].fit(trial)
    state = model.rest(1)
    motor = model.invert(state, np.array([0.1]))      # rad, for a joint at 0.1 rad

Angles are relative to rest in the neutral pose, and the motor angle is divided by the
ratio: without friction and stretch both are equal. Models are frozen dataclasses of
numbers and tuples of numbers, so that they can be written to a file.
"""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._validation import require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array

PLAYS, PIECES = 12, 8  # numbers of plays, and of straight pieces of the curve, of a fit


@dataclass(frozen=True)
class HysteresisTrial:
    """Slow motion of a motor and its joint, to which models are fitted.

    It begins at rest in the neutral pose and covers the range in use, back and forth,
    best in loops of several sizes.
    """

    motor_angle: Array  # from the start, over the ratio (samples,) [rad]
    joint_angle: Array  # from the start (samples,) [rad]

    @classmethod
    def of(
        cls,
        motor_angle: ArrayLike,
        joint_angle: ArrayLike,
        ratio: float,
        samples: int = 1500,
    ) -> "HysteresisTrial":
        """Return a trial of angles (n,) [rad], thinned to about `samples` of them.

        `ratio` is the motor angle per joint angle of an unstretched cable [-].

        Raises:
            CableError: There are too few samples, they are not finite, or one of the
                two does not move.
        """
        both = [np.asarray(one, dtype=float) for one in (motor_angle, joint_angle)]
        if both[0].ndim != 1 or both[0].shape != both[1].shape:
            raise CableError(
                "a trial needs as many motor angles as joint angles, (n,) each, not "
                f"{both[0].shape} and {both[1].shape}."
            )
        if both[0].size < 50 or not np.isfinite(both).all():
            raise CableError(
                "a trial needs at least 50 samples of finite numbers; "
                f"this has {both[0].size}."
            )
        every = max(1, both[0].size // samples)
        motor, joint = (one[::every] - one[0] for one in both)
        for name, one in (("motor", motor), ("joint", joint)):
            if np.ptp(one) == 0.0:
                raise CableError(f"the {name} does not move in this trial.")
        wound = motor / ratio
        if np.sum(np.diff(wound) * np.diff(joint)) <= 0.0:
            raise CableError(
                "the joint turns against the motor in this trial; change the sign of "
                "one of the two angles."
            )
        loops = np.sum(wound[:-1] * joint[1:] - wound[1:] * joint[:-1])
        if loops < -0.05 * np.ptp(wound) * np.ptp(joint):  # more than noise
            raise CableError(
                "the joint leads the motor in this trial; are the two angles swapped, "
                "or the rows in another order than that of time?"
            )
        return cls(wound, joint)

    @property
    def weights(self) -> Array:
        """Weight (samples,) of each sample when motor angles are fitted, 0 to 1.

        It is normalised joint speed over motor speed, so that samples inside the
        backlash count little.
        """
        moved = np.abs(np.diff(self.joint_angle, prepend=self.joint_angle[0]))
        turned = np.abs(np.diff(self.motor_angle, prepend=self.motor_angle[0]))
        scale = np.ptp(self.motor_angle) / np.ptp(self.joint_angle)
        return np.minimum(scale * moved / np.maximum(turned, 1e-12), 1.0)


@dataclass(frozen=True)
class HysteresisModel(ABC):
    """Model of hysteresis that can be inverted; subclasses are frozen dataclasses."""

    @classmethod
    @abstractmethod
    def fit(cls, trial: HysteresisTrial) -> Self:
        """Return the model that fits a trial best."""

    @abstractmethod
    def rest(self, count: int) -> Array:
        """Return the states of `count` separate inverses at rest (count, numbers)."""

    @abstractmethod
    def invert(self, state: Array, joint: Array) -> Array:
        """Return the motor angles for the next joint angles, (n,) [rad] both.

        The joint moves monotonically between two calls. `state`, which `rest` gives, is
        updated.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as numbers and lists of numbers."""
        fields = dataclasses.asdict(self)
        return {n: list(v) if isinstance(v, tuple) else v for n, v in fields.items()}

    @classmethod
    def from_dict(cls, name: str, given: Mapping[str, Any]) -> Self:
        """Return the model of parameters as in `to_dict`; error messages say `name`."""
        kinds = {f.name: f.type for f in dataclasses.fields(cls)}
        for key in given:
            if key not in kinds:
                raise CableError.unknown(f"parameter of {name!r}", key, kinds)
        values: dict[str, Any] = {}
        for key, kind in kinds.items():
            if key not in given:
                raise CableError(f"the model {name!r} needs a parameter {key!r}.")
            value = given[key]
            listed = "tuple" in str(kind)
            numbers = np.asarray(value)
            if numbers.dtype.kind not in "fiu" or numbers.ndim != int(listed):
                what = "a list of numbers" if listed else "a number"
                raise CableError(f"{name!r}, {key} must be {what}, not {value!r}.")
            if not np.isfinite(numbers).all():
                raise CableError(f"{name!r}, {key} must be finite, not {value!r}.")
            values[key] = tuple(map(float, value)) if listed else float(value)
        return cls(**values)


@dataclass(frozen=True)
class Line(HysteresisModel):
    """Straight line from joint to motor angle: mean stretch, without hysteresis."""

    slope: float  # motor angle per joint angle [-]
    offset: float  # motor angle at joint angle 0 [rad]

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> "Line":
        weights = trial.weights
        slope, offset = np.polyfit(trial.joint_angle, trial.motor_angle, 1, w=weights)
        return cls(float(slope), float(offset))

    def rest(self, count: int) -> Array:
        return np.zeros((count, 0))

    def invert(self, state: Array, joint: Array) -> Array:
        return self.slope * joint + self.offset


@dataclass(frozen=True)
class SmoothBacklash(HysteresisModel):
    r"""Backlash with a smooth transition, and its inverse in closed form.

    G. Tao, P. V. Kokotović, "Adaptive control of systems with backlash", Automatica 29,
    1993: a joint that is moved up lies on one line, moved down on another, and stays
    while the motor goes from one to the other. The inverse jumps between the lines.
    Here it changes over within a distance \(\delta\) of the joint, as the friction of
    P. Dahl, "A solid friction model", Aerospace Corporation TOR-158, 1968, does:

    \[ \theta = \tfrac{1 + z}{2} (a_+ q + c_+) + \tfrac{1 - z}{2} (a_- q + c_-), \qquad
       \frac{dz}{dq} = \frac{\operatorname{sign}(\dot q) - z}{\delta}
       \operatorname{sign}(\dot q) \]
    """

    slope_up: float  # motor angle per joint angle while the joint moves up, a+ [-]
    slope_down: float  # motor angle per joint angle while the joint moves down, a- [-]
    offset_up: float  # motor angle at joint angle 0 on the way up, c+ [rad]
    offset_down: float  # motor angle at joint angle 0 on the way down, c- [rad]
    transition: float  # distance over which one line changes into the other [rad]

    def __post_init__(self) -> None:
        require_parameter(self, "transition", 1e-6, 100.0, "rad")
        require_parameter(self, "slope_up", 1e-6, 1e6, "")
        require_parameter(self, "slope_down", 1e-6, 1e6, "")

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> "SmoothBacklash":
        joint, weights = trial.joint_angle, trial.weights
        fits: list[tuple[float, list[float]]] = []
        for share in np.geomspace(0.003, 0.5, 24):
            transition = float(np.ptp(joint) * share)
            z = _blend(joint, transition)
            up, down = 0.5 * (1.0 + z), 0.5 * (1.0 - z)
            columns = np.stack([up * joint, down * joint, up, down], axis=1)
            found = np.linalg.lstsq(
                columns * weights[:, None], trial.motor_angle * weights, rcond=None
            )[0]
            errors = weights * (columns @ found - trial.motor_angle)
            if min(found[:2]) > 1e-6:
                fits.append((float(np.sum(errors**2)), [*found.tolist(), transition]))
        if not fits:
            raise CableError(
                "no backlash fits this trial: the joint does not follow the motor in "
                "both directions."
            )
        return cls(*min(fits, key=lambda each: each[0])[1])

    def rest(self, count: int) -> Array:
        return np.zeros((count, 2))

    def invert(self, state: Array, joint: Array) -> Array:
        moved = joint - state[:, 0]
        way = np.sign(moved)
        z = way + (state[:, 1] - way) * np.exp(-np.abs(moved) / self.transition)
        state[:, 0], state[:, 1] = joint, z
        up = self.slope_up * joint + self.offset_up
        down = self.slope_down * joint + self.offset_down
        return np.asarray(0.5 * ((1.0 + z) * up + (1.0 - z) * down))


def _blend(joint: Array, transition: float) -> Array:
    """Return z of `SmoothBacklash` for successive joint angles (samples,) [rad]."""
    moved = np.diff(joint, prepend=joint[0])
    kept = np.exp(-np.abs(moved) / transition).tolist()
    ways, z, found = np.sign(moved).tolist(), 0.0, np.empty(joint.size)
    for place, (way, share) in enumerate(zip(ways, kept, strict=True)):
        z = way + (z - way) * share if way else z
        found[place] = z
    return found


@dataclass(frozen=True)
class PrandtlIshlinskii(HysteresisModel):
    r"""Modified Prandtl-Ishlinskii operator and its inverse in closed form.

    K. Kuhnen, "Modeling, identification and compensation of complex hysteretic
    nonlinearities: a modified Prandtl-Ishlinskii approach", European J. Control 9,
    2003: a weighted sum of play operators \(H\) of the motor angle, then a curve \(S\)
    without memory. The inverse of \(H\) is a sum of plays, too. Only the inverse \(S'\)
    of \(S\) is needed, a piecewise linear curve, so that weights and curve are found by
    one linear least-squares problem with bounds: \(H[\theta] = S'(q)\).
    """

    thresholds: tuple[float, ...]
    """Half widths of the plays of the motor angle; 0 first, increasing [rad]."""
    weights: tuple[float, ...]  # of each play [-]; the first above 0, no other below
    knots: tuple[float, ...]  # joint angles where pieces of S' meet, increasing [rad]
    values: tuple[float, ...]  # curve S' at these [rad]; the end pieces extend beyond

    def __post_init__(self) -> None:
        r, w, knots, values = map(np.array, dataclasses.astuple(self))
        if not (r.size and r.size == w.size and r[0] == 0.0 and np.all(np.diff(r) > 0)):
            raise CableError(
                "PrandtlIshlinskii.thresholds must begin with 0 and increase, with a "
                "weight for each."
            )
        if not (w[0] > 0.0 and np.all(w >= 0.0)):
            raise CableError(
                "PrandtlIshlinskii.weights must be at least 0, and the first above 0."
            )
        are_as_many = 2 <= knots.size == values.size
        if not (are_as_many and np.all(np.diff([knots, values]) > 0)):
            raise CableError(
                "PrandtlIshlinskii.knots and values must be at least two and increase."
            )

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> "PrandtlIshlinskii":
        from scipy.optimize import lsq_linear

        motor, joint = trial.motor_angle, trial.joint_angle
        reach = 0.5 * np.ptp(motor)
        thresholds = reach * np.arange(PLAYS) / PLAYS
        plays, state = np.empty((motor.size, PLAYS)), np.zeros(PLAYS)
        for place, angle in enumerate(motor):
            plays[place] = state = _plays(angle, thresholds, state)
        knots = np.linspace(joint.min(), joint.max(), PIECES + 1)
        width = knots[1] - knots[0]
        pieces = np.clip(joint[:, None] - knots[:-1], 0.0, width)
        # The scale of both sides is free: the curve has slope 1 in the mean.
        columns = np.hstack([plays, -pieces, -np.ones((joint.size, 1))])
        fixed = np.zeros(columns.shape[1])
        fixed[PLAYS:-1] = 1.0 / PIECES
        heavy = 1e3 * np.sqrt(joint.size) * width
        # The curve, and the play of no width, have at least a tenth of the mean slope.
        slope = np.ptp(joint) / np.ptp(motor)
        low = np.zeros(columns.shape[1])
        low[0], low[PLAYS:-1], low[-1] = 0.1 * slope, 0.1, -np.inf
        matrix = np.vstack([columns, heavy * fixed])
        right = np.append(np.zeros(joint.size), heavy)
        found = lsq_linear(matrix, right, bounds=(low, np.inf), tol=1e-12).x
        weights = np.maximum(found[:PLAYS], 0.0)
        values = found[-1] + width * np.concatenate([[0.0], np.cumsum(found[PLAYS:-1])])
        return cls(*(tuple(v.tolist()) for v in (thresholds, weights, knots, values)))

    def rest(self, count: int) -> Array:
        return np.zeros((count, len(self.thresholds)))

    def invert(self, state: Array, joint: Array) -> Array:
        *plays, knots, values = map(np.array, dataclasses.astuple(self))
        thresholds, weights = inverse_plays(*plays)
        # The curve is extrapolated by its end pieces.
        piece = np.clip(np.searchsorted(knots, joint) - 1, 0, knots.size - 2)
        slope = np.diff(values) / np.diff(knots)
        at = (values[piece] + slope[piece] * (joint - knots[piece]))[:, None]
        state[:] = _plays(at, thresholds, state)
        # A product of matrices would have other bits for other numbers of rows.
        return np.asarray(np.sum(state * weights, axis=1))


def _plays(angle: Any, thresholds: Array, state: Array) -> Array:
    """Return the outputs of play operators at an angle, `state` those before [rad]."""
    found: Array = np.maximum(angle - thresholds, np.minimum(angle + thresholds, state))
    return found


def inverse_plays(thresholds: Array, weights: Array) -> tuple[Array, Array]:
    """Return thresholds [rad] and weights of the inverse of a sum of plays (Kuhnen)."""
    total = np.cumsum(weights)
    inverse = np.concatenate(
        [[1.0 / weights[0]], -weights[1:] / (total[1:] * total[:-1])]
    )
    return total * thresholds - np.cumsum(weights * thresholds), inverse


@dataclass(frozen=True)
class BoucWen(HysteresisModel):
    r"""Bouc-Wen model of a tendon in a sheath, and its feed-forward.

    T. N. Do, T. Tjahjowidodo, M. W. S. Lau, T. Yamamoto, S. J. Phee, "Hysteresis
    modeling and position control of tendon-sheath mechanism in flexible endoscopic
    systems", Mechatronics 24, 2014, and T. N. Do, T. Tjahjowidodo, M. W. S. Lau, S. J.
    Phee, "Nonlinear friction modelling and compensation control of hysteresis phenomena
    for a pair of tendon-sheath actuated surgical robots", Mechanical Systems and Signal
    Processing 60-61, 2015:

    \[ q = a \theta - b z + c, \qquad
       \frac{dz}{d\theta} = 1 - |z| \bigl( \beta \operatorname{sign}(z \dot\theta)
       + \gamma \bigr) \]

    with the exponent 1 of their model and z scaled to slope 1. The feed-forward turns
    the motor by the angle that \(dq\) needs at the present z: \(d\theta = dq / (a - b\,
    dz/d\theta)\).
    """

    gain: float  # joint angle per motor angle while z is constant, a [-]
    hysteresis: float  # joint angle per z, b [-]; at least 0: the joint lags
    offset: float  # joint angle at motor angle 0 and z = 0, c [rad]
    beta: float  # symmetric saturation of z [1/rad]
    gamma: float  # asymmetric saturation of z [1/rad]; between -beta and beta

    def __post_init__(self) -> None:
        require_parameter(self, "gain", 1e-6, 1e6, "")
        require_parameter(self, "hysteresis", 0.0, 1e6, "")
        require_parameter(self, "beta", 1e-6, 1e9, "1/rad")
        if not abs(self.gamma) <= self.beta:
            raise CableError(
                f"BoucWen.gamma must be in [-{self.beta:g}, {self.beta:g}] 1/rad, not "
                f"{self.gamma!r}."
            )

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> "BoucWen":
        from scipy.optimize import least_squares

        motor, joint = trial.motor_angle, trial.joint_angle

        def linear(rates: Array) -> tuple[list[float], Array]:
            """Return all parameters for two rates, and the joint's errors [rad]."""
            beta = float(np.exp(rates[0])) / float(np.ptp(motor))
            gamma = beta * float(np.tanh(rates[1]))
            z = _hysteretic(motor, beta, gamma)
            columns = np.stack([motor, -z, np.ones(motor.size)], axis=1)
            found = np.linalg.lstsq(columns, joint, rcond=None)[0]
            if found[1] < 0.0:
                gain, offset = np.polyfit(motor, joint, 1)
                found = np.array([gain, 0.0, offset])
            return [*found.tolist(), beta, gamma], columns @ found - joint

        starts = [np.array([np.log(rate), 0.0]) for rate in (3.0, 10.0, 30.0)]
        start = min(starts, key=lambda one: float(np.sum(linear(one)[1] ** 2)))
        rates = least_squares(lambda one: linear(one)[1], start, diff_step=1e-3).x
        return cls(*linear(rates)[0])

    def rest(self, count: int) -> Array:
        state = np.zeros((count, 3))
        state[:, 0] = self.offset
        return state

    def invert(self, state: Array, joint: Array) -> Array:
        substeps = 4
        step = (joint - state[:, 0]) / substeps
        way = np.sign(step)
        z = state[:, 2]
        for _ in range(substeps):
            half = z + 0.5 * self._change(z, way, step)
            z = z + self._change(half, way, step)
        # By z alone, so that no error adds up.
        motor: Array = (joint - self.offset + self.hysteresis * z) / self.gain
        state[:, 0], state[:, 1], state[:, 2] = joint, motor, z
        return motor

    def _change(self, z: Array, way: Array, step: Array) -> Array:
        """Return the change of z for a step of the joint [rad] in a direction `way`."""
        slope = 1.0 - np.abs(z) * (self.beta * np.sign(z) * way + self.gamma)
        # The joint moves by at least 2 % of a per turn of the motor.
        moved = np.maximum(self.gain - self.hysteresis * slope, 0.02 * self.gain)
        return np.asarray(step / moved * slope)


def _hysteretic(motor: Array, beta: float, gamma: float) -> Array:
    """Return z of `BoucWen` for successive motor angles (samples,) [rad].

    The solution between samples is in closed form: z relaxes exponentially while its
    sign and that of the motion stay, and the step is divided where z crosses 0.
    """
    moved = np.diff(motor, prepend=motor[0]).tolist()
    found, z = np.empty(motor.size), 0.0
    for place, turn in enumerate(moved):
        left, way = abs(turn), 1.0 if turn > 0.0 else -1.0
        if left > 0.0 and z * way < 0.0:
            # z in the sense of the motion rises to 0: dy/ds = 1 + (beta - gamma) |y|.
            rate, size = beta - gamma, abs(z)
            to_zero = np.log1p(rate * size) / rate if rate > 1e-9 else size
            if left < to_zero:
                z, left = -way * _relaxed(size, left, rate, -1.0), 0.0
            else:
                z, left = 0.0, left - to_zero
        if left > 0.0:
            z = way * _relaxed(abs(z), left, beta + gamma, 1.0)
        found[place] = z
    return found


def _relaxed(size: float, left: float, rate: float, sign: float) -> float:
    """Return |z| after a motion `left` [rad], from `size` towards `sign / rate`."""
    if rate <= 1e-9:
        return size + sign * left
    end = sign / rate
    return float(end + (size - end) * np.exp(-rate * left))


MODELS: dict[str, type[HysteresisModel]] = {
    "linear": Line,
    "backlash_inverse": SmoothBacklash,
    "prandtl_ishlinskii": PrandtlIshlinskii,
    "bouc_wen": BoucWen,
}
"""Models by the name of the controller that inverts them."""
