"""Formulas of metrics on torque, efficiency, slack and tension along an episode.

Some are of tests with the joint held: a slow swing of the torque, and a chirp.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cc_mujoco.metrics._metric import (
    Key,
    LogLike,
    driven_cables,
    metadata_constant,
    rms,
)
from cc_mujoco.native import FloatArray as Array


@dataclass(frozen=True)
class Efficiency:
    """Efficiency of a transmission by the side that drives it; NaN where undefined."""

    overall: float  # both directions together, in (0, 1]
    motor_drives: float  # motor to joint, in (0, 1]
    wearer_drives: float  # joint to motor (the device is backdriven), in (0, 1]
    motor_share: float
    """Work put in by the motor over work put in by both sides, in [0, 1]."""


def efficiency(log: LogLike) -> Efficiency:
    r"""Return the share of the cables' work input that reaches the side it is for.

    The task's power \(\tau_d \omega_j\) tells the side: while it is positive, work is
    for the joint; while it is negative (a virtual spring is being loaded), for the
    motor; while it is zero, for neither. With the power of the motor into the cables
    \(P_m = \tau_m \omega_m\) and of the cables into the joint \(P_j = \tau_j \omega_j\)

    \[ \eta = \frac{W}{W + D}, \quad W_\text{motor drives} = \int_{\tau_d \omega_j > 0}
       P_j\,dt, \quad W_\text{wearer drives} = -\int_{\tau_d \omega_j < 0} P_m\,dt \]

    where \(D\) is the work that friction dissipates in the cables that the motor winds:
    at all times for both \(W\) together, and for one direction alone while \(P_m +
    P_j\) has its sign, positive for the motor. So losses while winding up before any
    work is desired count for the motor. \(W + D\) is the work put in, without the
    energy that the elastic cable stores, so storage cannot lift the ratio above 1; in
    steady motion it is the ratio of power out to power in, \(e^{-\mu \theta}\) for one
    cable.

    The efficiency is NaN if no net work arrives (friction dissipates more than the task
    transmits, or the receiving side has to drive), and for a direction with less than a
    hundredth of the task's work in both, which is a tremble of the joint.
    """
    time = log["time_s"]
    velocity = log["joint_velocity_rad_s"]
    motor = work_between_samples(time, motor_power(log))
    joint = work_between_samples(time, log["joint_torque_nm"] * velocity)
    task_work = work_between_samples(time, log["desired_torque_nm"] * velocity)
    lost = np.zeros_like(motor)
    for cable in driven_cables(log):
        lost += np.diff(log[f"dissipated_{cable}_j"])
    to_joint = _useful_work(joint, task_work)
    to_motor = _useful_work(-motor, -task_work)
    motor_in = float(np.maximum(motor, 0).sum())
    wearer_in = float(np.maximum(-joint, 0).sum())
    return Efficiency(
        overall=_efficiency(to_joint + to_motor, float(lost.sum())),
        motor_drives=_efficiency(to_joint, float(lost[motor + joint > 0].sum())),
        wearer_drives=_efficiency(to_motor, float(lost[motor + joint < 0].sum())),
        motor_share=_divide(motor_in, motor_in + wearer_in),
    )


def work_between_samples(time: Array, power: Array) -> Array:
    """Return the trapezoidal work (T-1,) [J] between samples of power (T,) [W]."""
    return 0.5 * (power[1:] + power[:-1]) * np.diff(time)


def _useful_work(arrived: Array, task_work: Array) -> float:
    """Return the work [J] that arrived during positive task work, 0 if that is rare."""
    wanted = task_work > 0
    if not task_work[wanted].sum() > 0.01 * np.abs(task_work).sum():
        return 0.0
    return max(float(arrived[wanted].sum()), 0.0)


def _efficiency(delivered: float, lost: float) -> float:
    return _divide(delivered, delivered + lost) if delivered > 0 else math.nan


def _divide(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else math.nan


SWING_PERIODS = 2
"""Periods of the slow swing; the last but a quarter is measured, trough to trough."""
CHIRP_LOW, CHIRP_HIGH = 0.5, 60.0  # range of the chirp [Hz]
MAX_UNSAFE_TIME = 0.01  # time from which a torque beyond the safe one is a failure [s]


def torque_error(log: LogLike) -> Array:
    """Return joint torque minus desired torque (T,) [N m]."""
    found: Array = log["joint_torque_nm"] - log["desired_torque_nm"]
    return found


def angle_error(log: LogLike) -> Array:
    """Return joint angle minus the wearer's reference angle (T,) [rad]."""
    found: Array = log["joint_angle_rad"] - log["reference_angle_rad"]
    return found


def mean_positive(power: Array) -> float:
    return float(np.mean(np.maximum(power, 0.0)))


def torque_lag(log: LogLike) -> float:
    """Return the lag of joint torque behind desired torque [s]; see `signal_lag`.

    NaN if the unshifted torques correlate by less than 0.8: then the error is not a
    mere delay but due to friction, for example, which lags by some 40 degrees of phase.
    """
    # Steps of 5 ms suffice: `signal_lag` interpolates between them.
    thin = slice(None, None, max(1, round(5e-3 / period_of(log))))
    names = ("time_s", "desired_torque_nm", "joint_torque_nm")
    time, desired, actual = (log[name][thin] for name in names)
    if not correlation(desired, actual) >= 0.8:
        return math.nan
    return signal_lag(time, desired, actual, signed=True)


def twist_backlash(log: LogLike) -> float:
    r"""Return the width [rad] of the loop of joint torque over twist at zero torque.

    The twist is \(\theta_m\,\rho - \theta_j\), with \(\rho\) the joint angle per motor
    angle of an unstretched cable. Over twist, not over joint angle, the loop shows the
    transmission and not the virtual environment that the task renders. The width is
    `loop_width`; NaN without \(\rho\).
    """
    ratio = log.metadata.get(Key.RATIO)
    if ratio is None:
        return math.nan
    twist = ratio * log["motor_angle_rad"] - log["joint_angle_rad"]
    return loop_width(twist, log["joint_torque_nm"])


def spring_backlash(log: LogLike) -> float:
    """Return the angle [rad] between the zero crossings of a rendered spring."""
    if not log.metadata.get(Key.SPRING):
        return math.nan
    names = ("joint_angle_rad", "joint_torque_nm")
    return loop_opening(*(moving_mean(log[name], period_of(log)) for name in names))


def peak_rate(torque: Array, step: float) -> float:
    """Return the fastest change of a torque (T,) in 10 ms [N m/s], `step` in [s]."""
    gap = max(1, round(0.01 / step))
    if torque.size <= gap:
        return math.nan
    return float(np.max(np.abs(torque[gap:] - torque[:-gap]) / (gap * step)))


def motor_power(log: LogLike) -> Array:
    """Return the mechanical power of the motor (T,) [W]."""
    power: Array = log["motor_torque_nm"] * log["motor_velocity_rad_s"]
    return power


def motor_heat(log: LogLike) -> Array:
    """Return the motor's winding heat (T,) [W]: resistance times current squared."""
    gear = metadata_constant(log, Key.GEARING) * metadata_constant(
        log, Key.TORQUE_CONSTANT
    )
    current = log["motor_torque_nm"] / gear
    heat: Array = metadata_constant(log, Key.WINDING_RESISTANCE) * current**2
    return heat


def thermal_load(log: LogLike) -> float:
    rated = metadata_constant(log, Key.GEARING) * metadata_constant(
        log, Key.CONTINUOUS_TORQUE
    )
    return rms(log["motor_torque_nm"]) / rated


def least_tension(log: LogLike, *cables: str) -> Array:
    """Return the least tension in `cables`, by default the driven ones (T,) [N]."""
    names = [f"tension_{one}_nodes_n" for one in cables or driven_cables(log)]
    least = [
        np.concatenate([rows.min(axis=1) for rows in log.pieces(name)])
        for name in names
    ]
    found: Array = np.min(least, axis=0)
    return found


def slack_time(log: LogLike, cable: str) -> float:
    slack = (least_tension(log, cable) <= 0.0).astype(float)
    return float(work_between_samples(log["time_s"], slack).sum())


def slack_under_load(log: LogLike) -> float:
    hanging = [least_tension(log, cable) <= 0.0 for cable in driven_cables(log)]
    if log.metadata.get(Key.PULL_PULL):
        return float(np.mean(np.all(hanging, axis=0)))
    desired = np.abs(log["desired_torque_nm"])
    # Above a tenth of the largest a cable that only pulls is taut.
    is_pulled = desired > 0.1 * desired.max()
    return float(np.mean(np.any(hanging, axis=0) & is_pulled))


def peak_tension(log: LogLike, cable: str) -> float:
    """Return the largest tension at an end of a cable [N]."""
    ends = (log[f"tension_{cable}_{end}_n"] for end in ("proximal", "distal"))
    return max(float(end.max()) for end in ends)


def strength_used(log: LogLike, *cables: str) -> float:
    """Return the largest peak tension over breaking load, by default of driven cables.

    NaN if a breaking load is unknown.
    """
    strength: Mapping[str, float] = log.metadata.get(Key.STRENGTH, {})
    shares = [
        peak_tension(log, cable) / strength.get(cable, math.nan)
        for cable in cables or driven_cables(log)
    ]
    return float(np.max(shares))


def failed(log: LogLike) -> float:
    """Return 1 for an episode that diverged, was unsafe or broke a cable, else 0.

    NaN if it did not diverge and the safe torque is unknown.
    """
    torque = log["joint_torque_nm"]
    if not np.all(np.isfinite(torque)):
        return 1.0
    if Key.SAFE_TORQUE not in log.metadata:
        return math.nan
    safe = metadata_constant(log, Key.SAFE_TORQUE)
    unsafe = first_unsafe_sample(torque, safe, period_of(log)) is not None
    return float(unsafe or strength_used(log, *log.cables) > 1.0)


def is_unstable(log: LogLike, scale: float) -> bool:
    """Return whether the joint torque oscillates faster than any task demands.

    The deviation from its moving mean over 0.1 s must have an RMS above a quarter of
    the largest desired torque, and above a twentieth of `scale` [N m], such as the
    device's safe torque. And it must alternate beyond these, four times within 0.6 s; a
    pulse that overshoots does so twice.
    """
    period = period_of(log)
    deviation = mean_deviation(log["joint_torque_nm"], period, 0.1)
    largest = float(np.abs(log["desired_torque_nm"]).max())
    least = 0.05 * scale if math.isfinite(scale) else 0.0
    swing = max(0.25 * largest, least)
    if not rms(deviation) > swing:
        return False
    beyond = np.flatnonzero(np.abs(deviation) > swing)
    side = deviation[beyond] > 0.0
    passes = beyond[1:][side[1:] != side[:-1]] * period
    return bool((passes[3:] - passes[:-3] < 0.6).any())


def first_unsafe_sample(torque: Array, safe: float, period: float) -> int | None:
    """Return the first sample of an unsafe joint torque (T,) [N m]; None if safe.

    It is unsafe if above `safe` [N m] for `MAX_UNSAFE_TIME`; `period` is the time
    between samples [s].
    """
    beyond = np.concatenate([[False], np.abs(torque) > safe, [False]])
    first, end = np.flatnonzero(np.diff(beyond)).reshape(-1, 2).T
    # Times that are differences of sums are off by rounding.
    unsafe = first[(end - first) * period >= MAX_UNSAFE_TIME * (1.0 - 1e-9)]
    return int(unsafe[0]) if unsafe.size else None


def ripple(torque: Array, period: float, window: float = 0.05) -> float:
    """Return the RMS [N m] of a torque minus its moving mean; see `mean_deviation`."""
    return rms(mean_deviation(torque, period, window))


def mean_deviation(torque: Array, period: float, window: float) -> Array:
    """Return a torque minus its moving mean over `window` [s], where that exists."""
    mean = moving_mean(torque, period, window)
    first = (torque.size - mean.size) // 2
    deviation: Array = torque[first : first + mean.size] - mean
    return deviation


def period_of(log: LogLike) -> float:
    time = log["time_s"]
    return float(time[-1] - time[0]) / (len(time) - 1)


def held_backlash(log: LogLike) -> float:
    """Return the width [rad] of the last torque-twist loop of the swing, at mid torque.

    The twist is motor angle times ratio minus joint angle. A cable that only pulls has
    no loop about zero torque, so the loop is measured about its middle.
    """
    ratio = log.metadata[Key.RATIO]
    swing = (log["time_s"].size - 1) / SWING_PERIODS
    # From trough to trough, so that both crossings of the middle lie inside.
    last = slice(
        round((SWING_PERIODS - 1.25) * swing), round((SWING_PERIODS - 0.25) * swing) + 1
    )
    torque, desired = log["joint_torque_nm"][last], log["desired_torque_nm"][last]
    if not np.ptp(torque) >= 0.05 * np.ptp(desired):  # nothing arrives
        return math.nan
    twist = ratio * log["motor_angle_rad"][last] - log["joint_angle_rad"][last]
    middle = 0.5 * (torque.max() + torque.min())
    return loop_width(twist, torque - middle)


def bandwidth(log: LogLike) -> float:
    """Return the frequency [Hz] at which the gain is 3 dB below the lowest band's.

    It is interpolated logarithmically between the centres of bands. It is `CHIRP_HIGH`
    if the gain stays above, and 0 if that of the lowest band is below 0.05.
    """
    centre, gain = torque_response(log)
    if np.isnan(gain[0]):
        return math.nan
    if gain[0] < 0.05:
        return 0.0
    below = np.flatnonzero(gain < gain[0] / math.sqrt(2.0))
    if below.size == 0:
        return CHIRP_HIGH
    k = int(below[0])
    share = (gain[k - 1] - gain[0] / math.sqrt(2.0)) / (gain[k - 1] - gain[k])
    return float(centre[k - 1] * (centre[k] / centre[k - 1]) ** share)


def torque_response(log: LogLike) -> tuple[Array, Array]:
    """Return centres of bands [Hz], and the gain from desired to joint torque in each.

    The gain is the cross spectrum of the two torques over the power spectrum of the
    desired one, each summed over bands of a sixth of an octave, of which the lowest is
    an octave; NaN if the sampling rate is too low for `CHIRP_HIGH`.
    """
    desired, actual = log["desired_torque_nm"], log["joint_torque_nm"]
    wanted = np.fft.rfft(desired - desired.mean())
    found = np.fft.rfft(actual - actual.mean())
    frequency = np.fft.rfftfreq(desired.size, float(log["time_s"][1]))
    octaves = math.log2(CHIRP_HIGH / CHIRP_LOW)
    # The lowest lines are few, so the lowest band is an octave.
    upper = np.arange(1.0, octaves + 1e-9, 1.0 / 6)  # six in an octave
    edges = CHIRP_LOW * 2.0 ** np.concatenate([[0.0], upper])
    if not frequency[-1] > edges[-1]:
        return np.sqrt(edges[1:] * edges[:-1]), np.full(upper.size, np.nan)
    places = np.searchsorted(frequency, edges)
    cross = np.add.reduceat(found * wanted.conj(), places)[:-1]
    power = np.add.reduceat(np.abs(wanted) ** 2, places)[:-1]
    gain = np.abs(cross) / power
    return np.sqrt(edges[1:] * edges[:-1]), gain


def moving_mean(values: Array, period: float, window: float = 0.05) -> Array:
    """Return the mean over a full moving window [s] of samples every `period` [s]."""
    width = min(max(1, round(window / period)), len(values))
    return np.convolve(values, np.full(width, 1.0 / width), mode="valid")


def loop_width(angle: Array, torque: Array) -> float:
    """Return the width [rad] of a torque-angle loop at zero torque.

    The torque visits zero from when it enters the band of 5 % of its peak until it
    leaves it, so that chatter inside the band is one visit. Each visit gives the angles
    at which the torque changes sign (interpolated) or is below 0.1 % of its peak (a
    dead zone). The width is the range of these angles over all visits: hysteresis and
    dead zone together. Angles [rad] and torques, in any unit, are (T,); NaN if the
    torque does not return through zero, so that there is no loop.
    """
    peak = float(np.max(np.abs(torque)))
    if not peak > 0:
        return math.nan
    outside = np.flatnonzero(np.abs(torque) > 0.05 * peak)
    touched: list[float] = []
    visits = returns = 0
    for first, last in itertools.pairwise(outside):
        crosses = torque[first] * torque[last] < 0
        if last - first == 1 and not crosses:
            continue
        part, at = torque[first : last + 1], angle[first : last + 1]
        here = list(at[np.abs(part) <= 1e-3 * peak])
        change = np.flatnonzero(part[:-1] * part[1:] < 0)
        share = part[change] / (part[change] - part[change + 1])
        here += list(at[change] + share * (at[change + 1] - at[change]))
        if here:
            touched += here
            visits += 1
            returns += not crosses
    if visits < 2 and not returns:
        return math.nan
    return float(max(touched) - min(touched))


def loop_opening(angle: Array, torque: Array) -> float:
    """Return the angle [rad] between a loop's zero crossings of torque, out and back.

    It is the difference between the mean angle of the torque's sign changes while the
    angle falls and that while it rises, at least 0. Friction F on a spring k opens the
    loop by 2 F/k, or by all of the motion if F exceeds the spring's torque.
    `loop_width` is the range of all crossings instead, which chatter about zero widens.
    Angles and torques are (T,); NaN if the torque does not cross zero in both
    directions.
    """
    change = np.flatnonzero(torque[:-1] * torque[1:] < 0)
    share = torque[change] / (torque[change] - torque[change + 1])
    step = angle[change + 1] - angle[change]
    at = angle[change] + share * step
    rising = step > 0
    if rising.all() or not rising.any():
        return math.nan
    return abs(float(np.mean(at[~rising]) - np.mean(at[rising])))


def signal_lag(
    time: Array, desired: Array, actual: Array, *, signed: bool = False
) -> float:
    """Return the lag of a signal `actual` (T,) behind the `desired` one [s].

    It is the shift, at most a quarter of the episode and at most 1 s, at which the
    correlation coefficient peaks, refined by a parabola. Of several peaks within 5 %,
    as of a periodic signal, it is the nearest to 0. The times (T,) [s] are equally
    spaced. If `actual` is ahead, the lag is negative when `signed`, else 0. NaN if the
    largest coefficient is below 0.5 or at the largest shift.
    """
    count = len(time)
    if count < 8:
        return math.nan
    step = float(time[-1] - time[0]) / (count - 1)
    reach = max(1, min(count // 4, round(1.0 / step)))
    shifts = np.arange(-reach if signed else 0, reach + 1)
    score = np.array([correlation(desired, actual, k) for k in shifts.tolist()])
    before = np.concatenate([[-1.0], score[:-1]])
    rising = score >= before
    falling = np.concatenate([score[:-1] >= score[1:], [True]])
    peaks = np.flatnonzero(rising & falling & (score >= 0.95 * score.max()))
    if peaks.size == 0:
        return math.nan
    best = int(peaks[np.argmin(np.abs(shifts[peaks]))])
    if abs(shifts[best]) == reach or score[best] < 0.5:
        return math.nan
    if best == 0:
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float((shifts[best] + offset) * step)


def correlation(desired: Array, actual: Array, shift: int = 0) -> float:
    """Return the correlation of `desired` with `actual` `shift` samples later."""
    ahead, behind = max(shift, 0), max(-shift, 0)
    one = desired[behind : desired.size - ahead]
    other = actual[ahead : actual.size - behind]
    one, other = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 1e-12 else -1.0
