"""Table of all metrics, and metrics of the user.

    METRICS["rms_torque_error"].compute(log)       # of an `EpisodeLog` or `ArrayLog`
    find_metric("my_module:PEAK_ANGLE")            # a `Metric` of the user
    measure(log, [METRICS["efficiency"]])          # value by metric

A value that an episode cannot give is NaN; it is never made up.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import re
import sys
from collections.abc import Iterable, Iterator
from functools import partial
from numbers import Real

import numpy as np

from cc_mujoco._utils.user_code import named_object, user_errors
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import Pace
from cc_mujoco.human._gait import GAIT_MOMENTS
from cc_mujoco.human._gait_joints import GaitJoint
from cc_mujoco.metrics import _clamped as clamped
from cc_mujoco.metrics import _metric as keys
from cc_mujoco.metrics import _torque as torque
from cc_mujoco.metrics._clamped import CHIRP_HIGH, CHIRP_LOW
from cc_mujoco.metrics._metric import Array, Better, LogLike, Metric, peak, rms
from cc_mujoco.metrics._signals import MEAN_WINDOW
from cc_mujoco.metrics._torque import RATE_WINDOW, efficiency, peak_rate

ANKLE = GaitJoint("ankle", "ankle")
"""Joint whose strides are measured where the metadata name none."""


def stride_metrics(log: LogLike) -> dict[str, float]:
    """Return numbers of the assisted joint over the whole strides of an episode.

    Strides go from heel strike to heel strike. The first, in which the walk begins, is
    left out. There is no number without a stride.

    The scripted wearer is a spring and a damper to the measured motion, on a leg that
    swings free of the floor: its resistance does not show what it would save. So the
    work of the muscles is computed separately from the simulation: the moment of the
    joint in the measured walk, by inverse dynamics, less the torque that the cables
    gave, at the velocity of the measured walk. That holds while motion and moment in
    all stay as they were without help, which people change; and work is not metabolic
    cost.
    """
    if keys.PACE not in log.metadata:
        return {}
    pace: Pace = log.metadata[keys.PACE]
    size = log.metadata.get(keys.MOMENT_RATIO, 1.0)
    time = log["time_s"]
    phase = np.mod(np.arctan2(log["phase_sine"], log["phase_cosine"]) / math.tau, 1.0)
    strikes = np.flatnonzero(np.diff(phase) < -0.5) + 1
    if strikes.size < 2:
        return {}
    step, count = float(time[1] - time[0]), strikes.size - 1
    whole = slice(int(strikes[0]), int(strikes[-1]))
    phase, given = phase[whole], log["joint_torque_nm"][whole]
    meant = np.gradient(log["reference_angle_rad"], step)[whole]
    joint: GaitJoint = log.metadata.get(keys.GAIT_JOINT, ANKLE)
    own = size * pace.moment(joint.part) * GAIT_MOMENTS[joint.part](pace.phase(phase))
    if joint.turned:
        own = -own
    desired = log["desired_torque_nm"][whole]
    helps = -1.0 if -desired.min() >= desired.max() else 1.0

    def work(torque: Array, velocity: Array) -> float:
        return float(np.sum(np.maximum(torque * velocity, 0.0))) * step / count

    alone, helped = work(own, meant), work(own - given, meant)
    swing = phase > pace.toe_off
    return {
        "wearer_work": helped,
        "wearer_work_change": (helped - alone) / alone,
        "assistance_work": work(given, log["joint_velocity_rad_s"][whole]),
        "peak_assistance": float(np.max(helps * given)),
        "torque_rate": peak_rate(given, step),
        "swing_torque": float(np.max(np.abs(given[swing]))),
    }


WINDING_KEYS = (keys.WINDING_RESISTANCE, keys.TORQUE_CONSTANT)


def _constant(
    name: str,
    unit: str,
    meaning: str,
    better: Better = "low",
    *needs: str,
    whole: bool = True,
) -> Metric:
    compute = partial(keys.metadata_constant, key=name)
    return Metric(name, unit, meaning, compute, better, "parts", needs, whole)


def _stride(name: str, unit: str, meaning: str, better: Better = "low") -> Metric:
    def compute(log: LogLike) -> float:
        return float(stride_metrics(log).get(name, math.nan))

    return Metric(name, unit, meaning, compute, better, needs=(keys.PACE,))


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("rms_torque_error", "N m", "RMS of joint torque minus desired torque",
               lambda log: rms(log["joint_torque_nm"] - log["desired_torque_nm"])),
        Metric("peak_torque_error", "N m", "largest |joint torque minus desired "
               "torque|",
               lambda log: peak(log["joint_torque_nm"] - log["desired_torque_nm"])),
        Metric("torque_lag", "s", "delay of the joint torque after the desired torque, "
               "by cross-correlation, negative where it leads; none where the "
               "coefficient stays below 0.5", torque.torque_lag, better=""),
        Metric("rms_angle_error", "rad", "RMS of joint angle minus the angle that the "
               "wearer aims for",
               lambda log: rms(log["joint_angle_rad"] - log["reference_angle_rad"])),
        Metric("peak_angle_error", "rad", "largest |joint angle minus the angle that "
               "the wearer aims for|",
               lambda log: peak(log["joint_angle_rad"] - log["reference_angle_rad"])),
        Metric("peak_joint_torque", "N m", "largest |joint torque|",
               lambda log: peak(log["joint_torque_nm"]), better=""),
        Metric("peak_over_safe", "1", "largest |joint torque| over the device's "
               "`safe_torque`", lambda log: peak(log["joint_torque_nm"])
               / keys.metadata_constant(log, keys.SAFE_TORQUE),
               needs=(keys.SAFE_TORQUE,)),
        Metric("unstable", "1", "1 where the joint torque swings about its mean over "
               f"{1e3 * torque.SWING_WINDOW:g} ms by more, RMS, than "
               f"{torque.SWING_SHARE:g} of the largest desired torque and "
               f"{torque.SWING_SCALE:g} of the device's `safe_torque`, else 0",
               lambda log: float(torque.is_unstable(
                   log, log.metadata.get(keys.SAFE_TORQUE, math.inf)))),
        Metric("rms_joint_torque", "N m", "RMS of the joint torque",
               lambda log: rms(log["joint_torque_nm"]), better=""),
        Metric("peak_wearer_torque", "N m", "largest |torque| with which the wearer "
               "holds the joint to the motion, the limb's weight and inertia included",
               lambda log: peak(log["wearer_torque_nm"])),
        Metric("wearer_power", "W", "mean positive power of that torque: work of the "
               "wearer per second",
               lambda log: float(np.mean(np.maximum(
                   log["wearer_torque_nm"] * log["joint_velocity_rad_s"], 0.0)))),
        Metric("peak_torque_rate", "N m/s", "fastest change of the joint torque, over "
               f"{1e3 * RATE_WINDOW:g} ms; jerks are uncomfortable",
               lambda log: torque.peak_rate(
                   log["joint_torque_nm"], float(log["time_s"][1] - log["time_s"][0]))),
        Metric("reflected_torque", "N m", "RMS of the joint torque while the wearer "
               "moves the device and the motor gives none",
               lambda log: rms(log["joint_torque_nm"]), test="backdrive"),
        Metric("peak_motor_torque", "N m", "largest |torque| at the motor pulley",
               lambda log: peak(log["motor_torque_nm"])),
        Metric("rms_motor_torque", "N m", "RMS of the torque at the motor pulley; a "
               "constant torque of that size heats the winding as much",
               lambda log: rms(log["motor_torque_nm"])),
        Metric("chatter", "N m", "RMS of the torque at the motor pulley minus its mean "
               f"over {1e3 * MEAN_WINDOW:g} ms", lambda log: torque.ripple(
                   log["motor_torque_nm"], torque.period_of(log), MEAN_WINDOW)),
        Metric("peak_motor_power", "W", "largest power that the motor gives",
               lambda log: float(np.max(torque.motor_power(log)))),
        Metric("thermal_load", "1", "RMS of the motor's torque per torque that it can "
               "give for ever; above 1 it becomes too hot in the end",
               torque.thermal_load, needs=(keys.CONTINUOUS_TORQUE,)),
        Metric("motor_heat", "W", "mean heat of the motor's winding: resistance times "
               "(torque over gearing and torque constant)^2",
               lambda log: float(np.mean(torque.motor_heat(log))), needs=WINDING_KEYS),
        Metric("electrical_power", "W", "mean power drawn from a supply that takes "
               "none back: what the motor gives and the heat of its winding",
               lambda log: float(np.mean(np.maximum(
                   torque.motor_power(log) + torque.motor_heat(log), 0.0))),
               needs=WINDING_KEYS),
        Metric("efficiency", "1", "work delivered to the side that the task means to "
               "receive it, over that work plus all that friction took; none where "
               "none arrives", lambda log: efficiency(log).overall, better="high"),
        Metric("efficiency_motor_drives", "1", "efficiency from motor to joint: "
               "friction while the motor gives more power",
               lambda log: efficiency(log).motor_drives, better="high"),
        Metric("efficiency_wearer_drives", "1", "efficiency from joint to motor: "
               "friction while the wearer gives more power",
               lambda log: efficiency(log).wearer_drives, better="high"),
        Metric("motor_share", "1", "part of all work put into the cables that came "
               "from the motor", lambda log: efficiency(log).motor_share, better=""),
        Metric("dissipated_energy_{cable}", "J", "energy that cable {cable} lost to "
               "friction", lambda log, cable: float(
                   np.diff(log[f"dissipated_{cable}_j"]).sum())),
        Metric("twist_backlash", "rad", "width at zero torque of the loop of joint "
               "torque against twist", torque.twist_backlash),
        Metric("spring_backlash", "rad", "between the angles at which the joint torque "
               "crosses zero on the way out and back, means over "
               f"{1e3 * MEAN_WINDOW:g} ms; where a spring is desired",
               torque.spring_backlash),
        Metric("held_backlash", "rad", "joint held, motor torque swung slowly: width "
               "at half height of the loop of joint torque against twist",
               clamped.held_backlash, test="backlash"),
        Metric("slack_margin", "N", "least tension anywhere in a cable; 0 is slack",
               lambda log: float(torque.least_tension(log).min()), better="high"),
        Metric("slack_share", "1", "part of the time in which some of a cable carries "
               "no tension",
               lambda log: float(np.mean(torque.least_tension(log) <= 0.0))),
        Metric("slack_under_load", "1", "share of the time with a slack cable where "
               f"more than {torque.TAUT_SHARE:g} of the largest torque is desired; of "
               "two cables that pull against each other, both slack",
               torque.slack_under_load, needs=(keys.PULL_PULL,)),
        Metric("slack_time_{cable}", "s", "time for which some of cable {cable} hung "
               "slack", torque.slack_time),
        Metric("peak_tension", "N", "largest tension at an end of a cable",
               lambda log: max(torque.peak_tension(log, c)
                               for c in keys.driven_cables(log))),
        Metric("strength_used", "1", "peak tension per breaking load of the cable",
               torque.strength_used, needs=(keys.STRENGTH,)),
        Metric("failed", "1", "episodes that diverged, or put more than the device's "
               f"`safe_torque` into the joint for {1e3 * torque.MAX_UNSAFE_TIME:g} "
               "ms, or tore a cable", torque.failed),
        Metric("bandwidth", "Hz", "where the joint torque, the joint held, falls 3 dB "
               f"below its response at {CHIRP_LOW:g} Hz; {CHIRP_HIGH:g} where it does "
               "not, 0 where nothing arrives", clamped.bandwidth, "high", "bandwidth"),
        Metric("response", "1", "joint torque per desired torque, the joint held, at "
               f"{CHIRP_LOW:g} Hz, which `bandwidth` goes by; friction makes it small",
               lambda log: float(clamped.torque_response(log)[1][0]), "high",
               "bandwidth"),
        _constant("reflected_inertia", "kg m^2", "inertia of rotor and motor pulley "
              "as the joint feels it; goes with the square of the ratio", whole=False),
        _constant("cable_mass", "kg", "mass of rope and conduit over the length of the "
              "conduits; goes with the square of the diameter", "low", "rope_density"),
        _constant("mass", "kg", "mass of motor, ropes, conduits and pulleys; gears, "
              "levers, fittings and frames left out", "low", "rope_density",
              "motor_mass"),
        _constant("bend_ratio", "1", "diameter of the tightest bend of conduit or "
              "pulley per diameter of the rope, D/d", "high"),
        _constant("bending_stress", "N/m^2", "stress of a wire that goes from straight "
              "into the tightest bend, by Reuleaux; none for fibres", "low",
              "material"),
        _constant("cost", "1", "cost of motor, pulleys, ropes, conduits and fittings "
              "by the table of costs, in its money"),
        _stride("wearer_work", "J", "positive work per stride of the muscles of the "
                "assisted joint, if its motion and its moment in all stay those of the "
                "measured walk: that moment less the torque of the cables; none for a "
                "knee at another speed"),
        _stride("wearer_work_change", "1", "wearer_work minus what it is without help, "
                "over the latter; below 0 the wearer is helped"),
        _stride("assistance_work", "J", "positive work per stride of the cables on the "
                "assisted joint", "high"),
        _stride("peak_assistance", "N m", "largest torque of the cables on the "
                "assisted joint, in the direction of the largest that the task asks "
                "for"),
        _stride("torque_rate", "N m/s", "fastest change of the torque of the cables on "
                f"the assisted joint, over {1e3 * RATE_WINDOW:g} ms"),
        _stride("swing_torque", "N m", "largest |torque| of the cables on the assisted "
                "joint from toe-off to heel strike, which hinders the swing"),
    )
}  # fmt: skip
"""Every metric by name, those of the user once `find_metric` has found them."""

_BUILT_IN = frozenset(METRICS)
_ORIGINS: dict[str, str | Metric] = {}
"""Metrics of the user as they were given, by name."""


def find_metric(given: str | Metric) -> Metric:
    """Return a metric: a name, `MODULE:NAME` of a metric of the user, or the metric.

    One of the user is in `METRICS` from now on.

    Raises:
        CableError: There is no such metric, or its name cannot be that of a column.
    """
    found: object = given
    if isinstance(given, str):
        if ":" not in given:
            return look_up("metric", given, METRICS)
        found = named_object("metric", given, "metric")
    if not isinstance(found, Metric):
        raise CableError(
            f"metric {given!r} must be a Metric(name, unit, meaning, compute), not "
            f"{found!r}."
        )
    if METRICS.get(found.name) is found and found.name in _BUILT_IN:
        return found
    if not re.fullmatch(r"[^\W\d]\w*", found.name) or found.name in _BUILT_IN:
        raise CableError(
            f"metric {given!r} is called {found.name!r}; it needs a name of letters, "
            "digits and _ that no metric of the package has."
        )
    _ORIGINS[found.name] = _importable(found) or given
    METRICS[found.name] = found
    return found


def user_metrics(names: Iterable[str]) -> tuple[str | Metric, ...]:
    """Return the `MODULE:NAME` of the user's metrics among these names."""
    return tuple(_ORIGINS[name] for name in names if name in _ORIGINS)


def metric_key(given: str | Metric) -> str:
    """Return a text that is the same for the same metric of the user.

    It is `MODULE:NAME`, or else a digest of the source, or else of this object alone.
    """
    if isinstance(given, str):
        return given
    try:
        source = inspect.getsource(given.compute)
    except (OSError, TypeError):
        source = str(id(given))
    about = repr((given.unit, given.meaning, given.better, given.test, source))
    return hashlib.sha256(about.encode()).hexdigest()[:24]


def _importable(metric: Metric) -> str:
    """Return `MODULE:NAME` of a metric in the module of its function, or ""."""
    place = getattr(metric.compute, "__module__", "")
    inside = vars(sys.modules[place]) if place in sys.modules else {}
    names = (name for name, value in inside.items() if value is metric)
    name = "" if place == "__main__" else next(names, "")
    return f"{place}:{name}" if name else ""


def table_rows(metrics: Iterable[Metric]) -> list[list[str]]:
    """Return name, unit, direction and meaning of metrics, below their heads."""
    head = ["metric", "unit", "better", "meaning"]
    return [head, *([m.name, m.unit, m.better or "-", m.meaning] for m in metrics)]


def expand_cable_metrics(
    metrics: Iterable[Metric], cables: Iterable[str]
) -> list[Metric]:
    """Return metrics with those of a cable once for every cable, in a block."""
    metrics = tuple(metrics)
    each = [metric for metric in metrics if metric.per_cable]
    found = [metric for metric in metrics if not metric.per_cable]
    return found + [metric.of(cable) for cable in cables for metric in each]


def measure(log: LogLike, metrics: Iterable[Metric]) -> dict[Metric, float]:
    """Return the value of each metric of an episode.

    Raises:
        CableError: A metric of the user raises, or gives what is no real number.
    """
    found: dict[Metric, float] = {}
    for metric in metrics:
        with user_errors(f"metric {metric.name!r}"):
            value = metric.compute(log)
        if not isinstance(value, Real):
            raise CableError(f"metric {metric.name!r} gave {value!r}, not a number.")
        found[metric] = float(value)
    return found


def measure_axes(
    log: LogLike, metrics: Iterable[Metric]
) -> Iterator[tuple[str, Metric, float]]:
    """Yield axis, metric and value for every number of an episode.

    Metrics of one axis come first, axis by axis. The axis is "" where the device has
    only one, and for metrics of a cable or of the device as a whole.

    Args:
        log: Log of an episode; one of several axes is an `EpisodeLog`.
        metrics: Metrics, those of cables as `expand_cable_metrics` gives them.

    Raises:
        CableError: See `measure`.
    """
    rest, axes = list(metrics), getattr(log, "axes", ())
    each = [metric for metric in rest if axes and metric.of_axis]
    rest = [metric for metric in rest if not (axes and metric.of_axis)]
    for axis in axes:
        own: LogLike = log.axis(axis)  # type: ignore[attr-defined]
        yield from ((axis, *pair) for pair in measure(own, each).items())
    yield from (("", *pair) for pair in measure(log, rest).items())
