"""The numbers that a design is judged by: one table, with what each means.

Numbers of the episode are computed from the columns of an episode log, so that they are
the same for a design in a batch and for its recording. What a design cannot give (the
loop of a torque that never comes back through zero) is NaN, and null in the table.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.recording.columns import DRIVEN, RATIO
from cc_mujoco.recording.metrics import EFFICIENCY, Samples, efficiency, wound
from cc_mujoco.recording.signals import loop_width
from cc_mujoco.whatif.across import LEAST, MOST
from cc_mujoco.whatif.motors import Motor
from cc_mujoco.whatif.protocol import CHIRP_HIGH, CHIRP_LOW, SWINGS, EpisodeProtocol
from cc_mujoco.whatif.simulate import Rollout
from cc_mujoco.whatif.strides import RATE_TIME

Array = NDArray[np.float64]
Test = Literal["episode", "backdrive", "backlash", "bandwidth", "parts"]
Needs = tuple[tuple[str, ...], ...]

MATERIAL: Needs = (("material", "rope_density"),)
MASS: Needs = (*MATERIAL, ("motor", "motor_mass"))
WINDING: Needs = (("motor", "winding_resistance"), ("motor", "torque_constant"))
RATED: Needs = (("motor", "continuous_torque"),)

BANDS_PER_OCTAVE = 6
LEAST_GAIN = 0.05
"""Joint torque per desired torque; below it nothing arrives."""


@dataclass(frozen=True)
class Metric:
    """A number of a design."""

    name: str
    unit: str
    meaning: str
    high: bool = False
    """Whether more is better."""
    test: Test = "episode"
    """What has to be played for it; nothing for that of the parts."""
    needs: Needs = ()
    """Variables that a design must have besides, since no scene says what they are: one
    of each of these."""
    asked: bool = False
    """Whether it is measured only where it is asked for."""
    strides: bool = False
    """Whether it is of the strides of an ankle that walks."""

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Variables of which designs with these names should have one; none: ()."""
        for ways in self.needs:
            if not any(name in names for name in ways):
                return ways
        return ()

    @property
    def driven(self) -> bool:
        """Whether a controller decides it, and not the hardware alone."""
        return self.test in ("episode", "bandwidth")


def _of_strides(name: str, unit: str, meaning: str, high: bool = False) -> Metric:
    return Metric(name, unit, meaning, high, asked=True, strides=True)


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("efficiency", "1", EFFICIENCY, high=True),
        Metric("backlash_width", "rad", "joint held, motor torque swung slowly: width "
               "at half height of the loop of joint torque against twist",
               test="backlash"),
        Metric("tracking_error", "N m", "RMS of joint torque minus desired torque"),
        Metric("peak_motor_torque", "N m", "largest |torque| at the motor pulley"),
        Metric("peak_motor_power", "W", "largest power that the motor gives"),
        Metric("rms_motor_torque", "N m", "RMS of the torque at the motor pulley; a "
               "constant torque of that size heats the winding as much"),
        Metric("thermal_load", "1", "RMS of the motor's torque per torque that it can "
               "give for ever; above 1 it becomes too hot in the end", needs=RATED),
        Metric("motor_heat", "W", "mean heat of the motor's winding: resistance times "
               "(torque over gearing and torque constant)^2", needs=WINDING),
        Metric("electrical_power", "W", "mean power drawn from a supply that takes "
               "none back: what the motor gives and the heat of its winding",
               needs=WINDING),
        Metric("slack_margin", "N", "least tension anywhere in a cable; 0 is slack",
               high=True),
        Metric("slack_share", "1", "part of the time in which some of a cable carries "
               "no tension"),
        Metric("peak_tension", "N", "largest tension at an end of a cable"),
        Metric("strength_used", "1", "peak tension per breaking load of the cable"),
        Metric("reflected_torque", "N m", "RMS of the joint torque while the wearer "
               "moves the device and the motor gives none", test="backdrive"),
        Metric("bandwidth", "Hz", "where the joint torque, the joint held, falls 3 dB "
               f"below its response at {CHIRP_LOW:g} Hz; {CHIRP_HIGH:g} where it does "
               "not, 0 where nothing arrives", high=True, test="bandwidth"),
        Metric("response", "1", "joint torque per desired torque, the joint held, at "
               f"{CHIRP_LOW:g} Hz, which `bandwidth` goes by; friction makes it small",
               high=True, test="bandwidth"),
        Metric("reflected_inertia", "kg m^2", "of rotor and motor pulley as the "
               "joint feels it; goes with the square of the ratio", test="parts"),
        Metric("cable_mass", "kg", "of rope and conduit over the length of the "
               "conduits; goes with the square of the diameter", test="parts",
               needs=MATERIAL),
        Metric("mass", "kg", "of motor, ropes, conduits and pulleys; gears, levers, "
               "fittings and frames left out", test="parts", needs=MASS),
        Metric("bend_ratio", "1", "diameter of the tightest bend of conduit or pulley "
               "per diameter of the rope, D/d", high=True, test="parts"),
        Metric("bending_stress", "N/m^2", "by which bending a wire swings that comes "
               "from straight into that bend, by Reuleaux; none for fibres",
               test="parts", needs=(("material",),)),
        Metric("cost", "1", "of motor, pulleys, ropes, conduits and fittings by the "
               "table of costs, in its money", test="parts", asked=True),
        _of_strides("wearer_work", "J", "positive work per stride of the muscles of "
                    "the ankle, if its motion and its moment in all stay those of the "
                    "measured walk: that moment less the torque of the cables"),
        _of_strides("wearer_work_change", "1", "that work less what it is without "
                    "help, over the latter; below 0 the wearer is helped"),
        _of_strides("assistance_work", "J", "positive work per stride of the cables on "
                    "the ankle", high=True),
        _of_strides("peak_assistance", "N m", "largest torque of the cables on the "
                    "ankle, in plantarflexion"),
        _of_strides("torque_rate", "N m/s", "fastest change of the torque of the "
                    f"cables on the ankle, over {1e3 * RATE_TIME:g} ms"),
        _of_strides("swing_torque", "N m", "largest |torque| of the cables on the "
                    "ankle from toe-off to heel strike, which hinders the swing"),
    )
}  # fmt: skip
"""Every metric by name."""

COST = "cost"
"""What a table of costs is for."""
CHOSEN_BY = "tracking_error"
"""What is least with the best of several controllers."""


def by_controller(protocol: EpisodeProtocol) -> dict[str, tuple[str, str]]:
    """Columns of what is measured with each of several controllers.

    Returns:
        Metric and controller by name of the column, `METRIC@CONTROLLER`; nothing where
        there is one controller.
    """
    if len(protocol.controllers) == 1:
        return {}
    return {
        f"{name}@{law}": (name, law)
        for law in protocol.controllers
        for name in protocol.metrics
        if METRICS[name].driven
    }


def by_case(protocol: EpisodeProtocol) -> dict[str, str]:
    """Columns of the least and the greatest number over the cases of a design.

    Returns:
        Metric by name of the column; nothing where there are no cases.
    """
    if not protocol.across.several:
        return {}
    ends = (LEAST, MOST)
    return {f"{name}@{end}": name for name in protocol.metrics for end in ends}


def numbers(protocol: EpisodeProtocol) -> tuple[str, ...]:
    """Columns of all numbers that a design has."""
    return (*protocol.metrics, *by_controller(protocol), *by_case(protocol))


def wants_high(protocol: EpisodeProtocol, name: str) -> bool:
    """Whether more of a metric is better in a study."""
    return METRICS[name].high != (name in protocol.across.turned)


@dataclass(frozen=True, eq=False)
class Row:
    """One design of a batch, in the shape of an episode log."""

    played: Rollout
    index: int
    cables: tuple[str, ...]

    @property
    def metadata(self) -> Mapping[str, Any]:
        """The ratio and what the motor winds, which is all that metrics ask for."""
        ratio = float(self.played.ratio[self.index])
        return {RATIO: ratio, DRIVEN: self.played.driven}

    def __getitem__(self, name: str) -> Array:
        """A column (T,); tension of nodes is that of the node with least, (T, 1)."""
        columns = self.played.columns
        if name in columns:
            found: Array = columns[name][self.index]
            return found
        for place, cable in enumerate(self.cables):
            places = {
                f"dissipated_{cable}_j": ("dissipated_j", place),
                f"tension_{cable}_proximal_n": ("tension_n", 2 * place),
                f"tension_{cable}_distal_n": ("tension_n", 2 * place + 1),
            }
            if name in places:
                column, of = places[name]
                row: Array = columns[column][self.index, of]
                return row
            if name == f"tension_{cable}_nodes_n":
                least = columns["least_tension_n"][self.index, place]
                return np.asarray(np.maximum(least, 0.0)[:, None])
        raise CableError.unknown("column", name, columns)


def measure_episode(
    log: Samples,
    strength: Mapping[str, float],
    motor: Motor | None = None,
    gearing: float = 1.0,
) -> dict[str, float]:
    """The metrics of an episode.

    Args:
        log: the episode.
        strength: breaking load of each cable [N].
        motor: its data sheet; without one nothing is known of its heat.
        gearing: turns of the motor per turn of its pulley.
    """
    motor = motor or Motor()
    torque, given = log["joint_torque_nm"], log["motor_torque_nm"]
    power, heat = given * log["motor_velocity_rad_s"], motor.heat(given, gearing)
    error = torque - log["desired_torque_nm"]
    cables = wound(log)
    least = np.min(
        [log[f"tension_{cable}_nodes_n"].min(axis=1) for cable in cables], axis=0
    )
    peaks = {
        cable: max(
            float(log[f"tension_{cable}_proximal_n"].max()),
            float(log[f"tension_{cable}_distal_n"].max()),
        )
        for cable in cables
    }
    return {
        "efficiency": efficiency(log).overall,
        "tracking_error": _rms(error),
        "peak_motor_torque": float(np.max(np.abs(given))),
        "peak_motor_power": float(np.max(power)),
        "rms_motor_torque": _rms(given),
        "thermal_load": _rms(given) / (gearing * motor.continuous_torque),
        "motor_heat": float(np.mean(heat)),
        "electrical_power": float(np.mean(np.maximum(power + heat, 0.0))),
        "slack_margin": float(least.min()),
        "slack_share": float(np.mean(least <= 0.0)),
        "peak_tension": max(peaks.values()),
        "strength_used": max(peaks[cable] / strength[cable] for cable in cables),
    }


def measure_backdrive(log: Samples) -> dict[str, float]:
    """The metric of the unpowered device."""
    return {"reflected_torque": _rms(log["joint_torque_nm"])}


def measure_backlash(log: Samples) -> dict[str, float]:
    """The metric of the slow swing: the width of its last loop at half its height.

    Against twist, motor angle times ratio minus joint angle, as in
    `recording.metrics.backlash_width`; a cable that only pulls has no loop about zero.
    """
    ratio = log.metadata[RATIO]
    swing = (log["time_s"].size - 1) / SWINGS
    # From trough to trough, so that both crossings of the middle lie inside.
    last = slice(round((SWINGS - 1.25) * swing), round((SWINGS - 0.25) * swing) + 1)
    torque, desired = log["joint_torque_nm"][last], log["desired_torque_nm"][last]
    if not np.ptp(torque) >= LEAST_GAIN * np.ptp(desired):
        return {"backlash_width": math.nan}
    twist = ratio * log["motor_angle_rad"][last] - log["joint_angle_rad"][last]
    middle = 0.5 * (torque.max() + torque.min())
    return {"backlash_width": loop_width(twist, torque - middle)}


def measure_bandwidth(log: Samples) -> dict[str, float]:
    """The metrics of the held joint."""
    step = float(log["time_s"][1])
    desired, actual = log["desired_torque_nm"], log["joint_torque_nm"]
    return {
        "bandwidth": bandwidth(desired, actual, step),
        "response": float(response(desired, actual, step)[1][0]),
    }


def bandwidth(desired: Array, actual: Array, step: float) -> float:
    """Frequency at which a response has fallen 3 dB below that at its lowest band [Hz].

    Args:
        desired: excitation with power in all of the band of the chirp, (T,).
        actual: what follows it, (T,).
        step: time between samples [s].

    Returns:
        The frequency, on a logarithmic scale between the centres of bands; `CHIRP_HIGH`
        if the response stays above, and 0 if its lowest band is below `LEAST_GAIN`.
    """
    centre, gain = response(desired, actual, step)
    if not gain[0] >= LEAST_GAIN:
        return 0.0
    below = np.flatnonzero(gain < gain[0] / math.sqrt(2.0))
    if below.size == 0:
        return CHIRP_HIGH
    k = int(below[0])
    share = (gain[k - 1] - gain[0] / math.sqrt(2.0)) / (gain[k - 1] - gain[k])
    return float(centre[k - 1] * (centre[k] / centre[k - 1]) ** share)


def response(desired: Array, actual: Array, step: float) -> tuple[Array, Array]:
    """How much of what is desired arrives, by frequency.

    The cross spectrum of the two signals over the power spectrum of the desired one,
    each summed over bands of a sixth of an octave, of which the lowest is an octave.

    Args:
        desired: excitation with power in all of the band of the chirp, (T,).
        actual: what follows it, (T,).
        step: time between samples [s].

    Returns:
        Centres of the bands [Hz]; absolute values of the response there.
    """
    wanted = np.fft.rfft(desired - desired.mean())
    found = np.fft.rfft(actual - actual.mean())
    frequency = np.fft.rfftfreq(desired.size, step)
    octaves = math.log2(CHIRP_HIGH / CHIRP_LOW)
    # The lowest lines are few, so the lowest band is an octave.
    upper = np.arange(1.0, octaves + 1e-9, 1.0 / BANDS_PER_OCTAVE)
    edges = CHIRP_LOW * 2.0 ** np.concatenate([[0.0], upper])
    places = np.searchsorted(frequency, edges)
    cross = np.add.reduceat(found * wanted.conj(), places)[:-1]
    power = np.add.reduceat(np.abs(wanted) ** 2, places)[:-1]
    gain = np.abs(cross) / power
    return np.sqrt(edges[1:] * edges[:-1]), gain


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
