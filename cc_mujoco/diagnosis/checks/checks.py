"""Readings that cannot be what they say: every check is a function, all are listed.

Checks of a recording see all rows as they were recorded, checks of a trial the valid
stretches with everything known applied.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from cc_mujoco.diagnosis.checks.alignment import check_alignment
from cc_mujoco.diagnosis.checks.mechanics import mechanics
from cc_mujoco.diagnosis.checks.signs import (
    check_ratios,
    check_signs,
    check_sizes,
    check_units,
    groups,
    wrong_unit,
)
from cc_mujoco.diagnosis.data import channels
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.dataset_file import DatasetFile
from cc_mujoco.diagnosis.data.findings import DataFinding, error, warning
from cc_mujoco.diagnosis.data.reading import Recording
from cc_mujoco.diagnosis.data.smoothing import velocity
from cc_mujoco.diagnosis.data.trials import Facts, FloatArray, Trial

JOINT_TURNS, MOTOR_TURNS = 2.0, 8.0
"""Turns beyond which angles are taken for degrees, unless the unit is declared."""
_ANGLES = {"motor": channels.MOTOR_ANGLE, "joint": channels.JOINT_ANGLE}
_LOCKED = 0.05  # range of an angle that was held fast [rad]
_WOUND, _AHEAD, _FAR_AHEAD = 2.0, 1.3, 1.5
"""A cable that winds up keeps the joint behind its pulleys; nothing puts it ahead."""
_SEVERAL = 3
_COPIED = 1e-9
"""Share of a motion by which an angle is no copy of another."""
_CLIPPED = 5  # samples at an extreme that are one clipped stretch
_CLIPS = 2
_LOADS = (channels.TORQUE, channels.FORCE, channels.CURRENT)
_PASSED = 0.5  # turned at most from one sample to the next [rad]
_OVERLOAD = 150.0  # tensions that no scene explains, over its pretension
_SIDE = re.compile(r"motor|joint|handle|output|tension|torque|angle", re.I)
_CLOCK = re.compile(r"time|clock|stamp", re.I)


def check_recording(
    recording: Recording, facts: Facts, file: DatasetFile
) -> list[DataFinding]:
    """Run the checks of a recording."""
    return [
        *_locked(recording, facts),
        *_constants(recording, facts),
        *_clipping(recording),
        *_degrees(recording, file),
        *_turnovers(recording),
        *_second_clock(recording, file),
    ]


def check_trials(trials: Sequence[Trial], alone: bool = False) -> list[DataFinding]:
    """Run the checks of trials of one rig, of which one cable may be all that pulls.

    Where the cables were taken off, nothing relates one side to the other.
    """
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    known = [mechanics(trial) for trial in hooked]
    findings = check_ratios(hooked, known) + check_sizes(hooked, known)
    for group in groups(hooked, known):
        findings += check_signs(group) + check_units(group)
    for trial in hooked:
        findings += check_alignment(trial, alone)
    for trial in trials:
        findings += _motion(trial)
    return findings


def check_ratio(trial: Trial, ratio: float, several: bool = False) -> list[DataFinding]:
    """Compare the measured ratio of the angles with that of a scene.

    Args:
        trial: the trial that comes closest to the scene.
        ratio: motor angle per joint angle of the ideal transmission.
        several: whether there are enough others to rule out that the motor was held
            by a soft cable, or had play, in all.

    Returns:
        A finding if the two differ so much that units, signs or sides are wrong.
    """
    known = mechanics(trial)
    if abs(known.follows) < 0.6:
        return []
    apart = known.ratio * ratio
    if 1.0 / _WOUND < apart < _AHEAD:
        return []
    degrees = math.degrees(1.0)
    motor, joint = channels.ANGLES
    reasons = {
        wrong_unit(trial, joint): apart / degrees,
        wrong_unit(trial, motor): apart * degrees,
        "the scene has other pulleys, or an angle another unit": 3.0,
    }
    if abs(math.log(abs(ratio))) > 0.5:
        reasons["the sides are swapped"] = apart / ratio**2
    likely = min(reasons, key=lambda text: abs(math.log(abs(reasons[text]))))
    if apart < 0.0:
        likely = "a sign is inverted"
    told = (
        f"{trial.path}: the motor turns {1.0 / known.ratio:.3g} rad per joint radian, "
        f"but {ratio:.3g} in the scene; perhaps {likely}."
    )
    impossible = not 0.25 < apart < 4.0 or (several and apart > _FAR_AHEAD)
    return [(error if impossible else warning)(told, trial.name)]


def check_bench(trials: Sequence[Trial], bench: Bench) -> list[DataFinding]:
    """Compare trials with a scene: the ratio of the angles, the size of the torques.

    A cable that winds up moves the joint less than its pulleys would: what counts is
    the trial that comes closest to the scene.

    Args:
        trials: of one rig.
        bench: of the scene, with what is known of the rig.
    """
    ratio = bench.joint_radius / bench.motor_radius
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    found = {trial.name: mechanics(trial) for trial in hooked}
    certain = [t for t in hooked if abs(found[t.name].follows) > 0.6]
    closest = min(
        certain,
        key=lambda t: abs(math.log(abs(found[t.name].ratio * ratio))),
        default=None,
    )
    several = len(certain) >= _SEVERAL
    findings = check_ratio(closest, ratio, several) if closest else []
    for trial in trials:
        findings += _loads(trial, bench) + _beyond(trial, bench)
    return findings


def _beyond(trial: Trial, bench: Bench) -> list[DataFinding]:
    """Angles at which the lever or the path of a scene is not known."""
    if bench.lever is None and not bench.led:
        return []
    low, high = bench.span
    least, most = np.nanmin(trial.joint_angle), np.nanmax(trial.joint_angle)
    if low <= least and most <= high:
        return []
    told = (
        f"{trial.column(channels.JOINT_ANGLE)} goes from {least:.3g} to {most:.3g} "
        f"rad, but the {'lever' if bench.lever else 'path'} of the scene is known from "
        f"{low:.3g} to {high:.3g} "
        "rad, 0 being the scene's 0 and positive where the cable pulls; declare offset "
        f"and sign of [columns.{channels.JOINT_ANGLE}]."
    )
    return [error(told, trial.name, channels.JOINT_ANGLE)]


def _loads(trial: Trial, bench: Bench) -> list[DataFinding]:
    """Torques far beyond what the cables of a scene carry."""
    findings: list[DataFinding] = []
    taut = trial.facts.pretension or bench.cables[0].pretension
    if taut == 0.0:  # nobody knows what to expect
        return findings
    for channel, torque, radius in (
        (channels.MOTOR_TORQUE, trial.motor_torque, bench.motor_radius),
        (channels.JOINT_TORQUE, trial.joint_torque, bench.joint_radius),
    ):
        if torque is None:
            continue
        tension = float(np.sqrt(np.nanmean(torque**2))) / radius
        share = tension / max(taut, 1.0)
        if share > _OVERLOAD:
            told = (
                f"{trial.column(channel)} takes a tension of {tension:.3g} N, "
                f"{share:.3g} times the pretension of the scene; perhaps it is in mNm: "
                f"declare [columns.{channel}] unit = 'mNm'."
            )
            findings.append(error(told, trial.name, channel))
    return findings


def _locked(recording: Recording, facts: Facts) -> list[DataFinding]:
    """An angle that moves although it is said to have been held fast."""
    if not facts.locked:
        return []
    channel = _ANGLES[facts.locked]
    moved = _range(recording.values[channel])
    if moved <= _LOCKED:
        return []
    told = (
        f"{recording.column(channel)} moves by {moved:.3g} rad, though "
        f"locked = {facts.locked!r} says that it was held fast."
    )
    return [error(told, recording.name, channel)]


def _constants(recording: Recording, facts: Facts) -> list[DataFinding]:
    """Channels that never change."""
    findings = []
    for channel in recording.values:
        if channel in (channels.TIME, channels.VALID, channels.TEMPERATURE):
            continue
        values = recording.values[channel]
        if recording.rows < 2 or not np.nanmax(values) == np.nanmin(values):
            continue
        where = f"{recording.column(channel)} is {np.nanmax(values):.6g} in every row"
        if facts.locked and _ANGLES[facts.locked] == channel:
            continue
        advice = "check the sensor"
        if channel in _ANGLES.values():
            side = "motor" if channel == channels.MOTOR_ANGLE else "joint"
            advice += f", or declare locked = {side!r} if it was held fast"
        findings.append(error(f"{where}; {advice}.", recording.name, channel))
    return findings


def _clipping(recording: Recording) -> list[DataFinding]:
    """Torques and tensions that stay at their extreme while elsewhere they scatter."""
    findings = []
    for channel, values in recording.values.items():
        if channels.kind(channel) not in _LOADS:
            continue
        same = np.diff(values) == 0.0
        highest, lowest = np.nanmax(values), np.nanmin(values)
        # What is cut off on both sides repeats there for the same reason.
        outermost = (values == highest) | (values == lowest)
        elsewhere = ~(outermost[1:] & outermost[:-1])
        usual = float(same[elsewhere].mean()) if elsewhere.any() else 1.0
        if usual > 0.1:
            continue  # coarse readings repeat everywhere
        for extreme, side in ((highest, "above"), (lowest, "below")):
            there = values == extreme
            edges = np.flatnonzero(np.diff(there, prepend=False, append=False))
            lengths = edges[1::2] - edges[::2]
            flat = lengths[lengths >= _CLIPPED]
            if not len(flat) or (len(flat) < _CLIPS and flat[0] < 4 * _CLIPPED):
                continue
            mend = "use a sensor of wider range"
            if channel == channels.MOTOR_TORQUE:
                mend = f"ask less of the motor if this is its limit, else {mend},"
            told = (
                f"{recording.column(channel)} stays at {extreme:.6g} in "
                f"{flat.sum()} rows, as if cut off {side}; {mend} or mark these rows "
                "invalid."
            )
            findings.append(error(told, recording.name, channel))
    return findings


def _degrees(recording: Recording, file: DatasetFile) -> list[DataFinding]:
    """Angles too large for radians."""
    findings = []
    limits = {channels.JOINT_ANGLE: JOINT_TURNS, channels.MOTOR_ANGLE: MOTOR_TURNS}
    for channel, most in limits.items():
        values = recording.values[channel]
        turns = _range(values) / (2.0 * math.pi)
        if turns <= most:
            continue
        told = f"{recording.column(channel)} covers {turns:.3g} turns"
        label = recording.labels.get(channel, channel)
        if file.source(channel).unit or file.unit(channel, label) == "deg":
            findings.append(warning(f"{told}, as declared.", recording.name, channel))
            continue
        advice = (
            f"declare [columns.{channel}] unit = 'deg' if it is in degrees, or 'rad'"
        )
        findings.append(
            error(f"{told} if it is in radians; {advice}.", recording.name, channel)
        )
    return findings


def _turnovers(recording: Recording) -> list[DataFinding]:
    """Angles of an encoder that begins anew after a full turn."""
    findings = []
    for channel in channels.ANGLES:
        steps = np.abs(np.diff(recording.values[channel]))
        steps = steps[np.isfinite(steps)]
        jumps = int(np.sum(np.abs(steps - 2.0 * math.pi) < _PASSED))
        # Who turns as far in one sample as in the next is fast, or counts in turns.
        if not jumps or np.quantile(steps, 0.9) > _PASSED:
            continue
        told = (
            f"{recording.column(channel)} jumps by a full turn {jumps} times, as an "
            "encoder does that begins anew after each; make it continuous before "
            "(numpy.unwrap)."
        )
        findings.append(error(told, recording.name, channel))
    return findings


def _range(values: FloatArray) -> float:
    """Range of readings, spikes aside."""
    values = values[:: max(1, len(values) // 100_000)]
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0
    low, high = np.percentile(values, [0.5, 99.5])
    return float(high - low)


def _second_clock(recording: Recording, file: DatasetFile) -> list[DataFinding]:
    """Times of one side or channel that nobody has declared."""
    declared = {file.source(channel).clock for channel in recording.values}
    used = {*declared, *recording.labels.values()}
    return [
        error(
            f"{recording.path} has times of its own in column {name}; say in "
            f"dataset.toml which channels they belong to: clock = {name!r}.",
            recording.name,
        )
        for name in recording.names
        if name not in used and _SIDE.search(name) and _CLOCK.search(name)
    ]


def _motion(trial: Trial) -> list[DataFinding]:
    """Trials in which nothing happens."""
    speed = np.abs(velocity(trial.motor_angle, trial.step, trial.segments))
    turn = np.abs(velocity(trial.joint_angle, trial.step, trial.segments))
    if np.nanmax(speed) * trial.duration < 1e-3 > np.nanmax(turn) * trial.duration:
        told = f"{trial.path}: neither side moves by more than a milliradian."
        return [warning(told, trial.name)]
    if _is_copy(trial.motor_angle, trial.joint_angle):
        told = (
            f"{trial.column(channels.JOINT_ANGLE)} is "
            f"{trial.labels.get(channels.MOTOR_ANGLE, channels.MOTOR_ANGLE)} times a "
            "number to the last digit; record both angles, each by its own encoder."
        )
        return [error(told, trial.name, channels.JOINT_ANGLE)]
    return []


def _is_copy(one: FloatArray, other: FloatArray) -> bool:
    """Return whether a signal that moves is another one, scaled and shifted."""
    there = np.isfinite(one) & np.isfinite(other)
    one, other = one[there], other[there]
    if one.size < 3 or not np.ptp(one) > 0.0 < np.ptp(other):
        return False
    gain, offset = np.polyfit(one, other, 1)
    left = float(np.max(np.abs(other - gain * one - offset)))
    return left < _COPIED * float(np.ptp(other))
