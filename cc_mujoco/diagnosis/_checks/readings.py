"""Checks of readings for impossible values.

Checks of a recording use all rows as recorded; checks of a trial use its valid
stretches, with declared units, signs, offsets and delays applied.
"""

import itertools
import math
import re
from collections.abc import Iterator, Sequence

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._clock import GAP_FACTOR
from cc_mujoco.datasets._data_findings import DataFinding, doubt, error, errors, warning
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._glitches import leaps
from cc_mujoco.datasets._load_cells import SingleCell
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import (
    TORQUE_SENSORS,
    Dataset,
    FloatArray,
    Trial,
    TrialFacts,
)
from cc_mujoco.diagnosis._checks import mechanics
from cc_mujoco.diagnosis._checks.mechanics import Findings, Mechanics
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError
from cc_mujoco.report._html import list_words

_ANGLES = {"motor": channels.MOTOR_ANGLE, "joint": channels.JOINT_ANGLE}
_LOAD_KINDS = (channels.TORQUE, channels.FORCE, channels.CURRENT)


def check_recording(recording: Recording, facts: TrialFacts, file: DatasetFile) -> None:
    """Add the findings on a recording to it."""
    _check_locked(recording, facts)
    _check_constants(recording, facts)
    angles = [channel for channel in channels.ANGLES if channel in recording.values]
    for channel in angles[::-1]:
        _check_degrees(recording, file, channel)
    for check in (_check_turnovers, _check_leaps):
        for channel in angles:
            check(recording, channel)
    _check_second_clock(recording, file)
    _check_copied_loads(recording)
    _check_copied_rows(recording)


def check_trials(trials: Sequence[Trial], alone: bool = False) -> Findings:
    """Run the checks of trials that need no scene; `alone` if of a single cable."""
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    known = [mechanics.measure_mechanics(trial) for trial in hooked]
    findings = mechanics.check_ratios(hooked, known)
    findings += mechanics.check_sizes(hooked, known)
    for group in mechanics.group_trials(hooked, known):
        findings += mechanics.check_signs(group) + mechanics.check_units(group)
    for trial in hooked:
        findings += mechanics.check_alignment(trial, alone)
    return findings + check_motions(trials)


def check_motions(trials: Sequence[Trial]) -> Findings:
    return [finding for trial in trials for finding in _check_motion(trial)]


def check_ratio(trial: Trial, ratio: float, several: bool = False) -> Findings:
    """Report motor over joint angle far from `ratio`, stricter as best of `several`."""
    known = mechanics.measure_mechanics(trial)
    if abs(known.follows) < 0.6:
        return []
    ratio_error = known.ratio * ratio
    if 1.0 / Limit.max_wind_up < ratio_error < Limit.max_lead:
        return []
    degrees = math.degrees(1.0)
    motor, joint = channels.ANGLES
    reasons = {
        mechanics.wrong_unit(trial, joint): ratio_error / degrees,
        mechanics.wrong_unit(trial, motor): ratio_error * degrees,
        "the scene has other pulleys, or an angle another unit": 3.0,
    }
    if abs(math.log(abs(ratio))) > 0.5:
        reasons["the sides are swapped"] = ratio_error / ratio**2
    likely = min(reasons, key=lambda text: abs(math.log(abs(reasons[text]))))
    if ratio_error < 0.0:
        likely = "a sign is inverted"
    message = (
        f"{trial.path}: the motor turns {1.0 / known.ratio:.3g} rad per joint radian, "
        f"but {ratio:.3g} in the scene; perhaps {likely}."
    )
    far = several and ratio_error > Limit.impossible_lead
    impossible = far or not 0.25 < ratio_error < 4.0
    return [(error if impossible else warning)(message, trial.name)]


def check_bench(trials: Sequence[Trial], bench: Bench) -> Findings:
    """Return findings if ratio, torques or ranges of trials contradict the bench."""
    checks = [_check_overload, _check_known_range]
    findings: Findings = []
    if bench.others:  # the ends do not turn by one ratio
        checks.append(_check_others_range)
    else:
        ratio = bench.joint_radius / bench.motor_radius
        found = [
            (t, mechanics.measure_mechanics(t)) for t in trials if not t.facts.unhooked
        ]
        certain = [(trial, m) for trial, m in found if abs(m.follows) > 0.6]
        findings = _check_inverse(certain, ratio)
        if certain and not findings:
            closest, _ = min(
                certain, key=lambda e: abs(math.log(abs(e[1].ratio * ratio)))
            )
            findings = check_ratio(closest, ratio, several=len(certain) >= 3)
            if not errors(findings):
                findings = _check_pulleys(certain, ratio) or findings
    for trial in trials:
        for check in checks:
            findings += check(trial, bench)
    return findings


def _check_pulleys(trials: Sequence[tuple[Trial, Mechanics]], ratio: float) -> Findings:
    """Doubt the scene's `ratio` where angles and torques state the same other one.

    Elasticity changes the ratio of the angles only, a gain that of the torques only.
    """
    by_angle = 1.0 / float(np.median([m.ratio for _, m in trials]))
    known = [m.torque_ratio for _, m in trials if m.torque_ratio > 0.0]
    if not known or by_angle <= 0.0:
        return []
    by_torque = 1.0 / float(np.median(known))
    off = [math.log(found / ratio) for found in (by_angle, by_torque)]
    if min(map(abs, off)) < Limit.unequal_pulleys or abs(off[0] - off[1]) > 0.5 * max(
        map(abs, off)
    ):
        return []
    message = (
        f"The motor turns {by_angle:.3g} rad per joint radian and the joint has "
        f"{by_torque:.3g} times the motor's torque, but the pulleys of the scene make "
        f"both {ratio:.3g}; correct their radii (`gear`)."
    )
    return [doubt(message)]


def _check_inverse(trials: Sequence[tuple[Trial, Mechanics]], ratio: float) -> Findings:
    """Find trials in which the angles turn by the inverse of the scene's `ratio`.

    A soft cable may do so at a ratio below 1, unless all trials or the torques agree.
    """
    if abs(math.log(ratio)) < Limit.unequal:
        return []

    def inverse(found: float) -> bool:
        return found > 0.0 and abs(math.log(found / ratio)) < Limit.inverse

    turned = [(trial, m) for trial, m in trials if inverse(m.ratio)]
    certain = ratio > 1.0 or (len(trials) > 1 and len(turned) == len(trials))
    wrong = [(t, m) for t, m in turned if certain or inverse(m.torque_ratio)]
    if not wrong:
        return []
    trial, first = wrong[0]
    message = (
        f"{list_words([t.path for t, _ in wrong])}: the motor turns "
        f"{1.0 / first.ratio:.3g} rad per joint radian, but the inverse, {ratio:.3g}, "
        "in the scene; the motor's columns are swapped with the joint's, or the "
        "pulleys of the scene are."
    )
    return [error(message, trial.name if len(wrong) == 1 else "")]


def check_load_cells(dataset: Dataset, bench: Bench) -> Findings:
    findings, rows = [], dataset.instruments.rows
    for trial in dataset.trials:
        channel, problem = trial.facts.load_cell, ""
        if not channel:
            continue
        try:
            if channel not in trial.tensions:
                problem = (
                    f"{trial.path} has no such column; record it there, or name its "
                    "own file in [files]"
                )
            elif SingleCell.of(channel, bench, None).row not in rows:
                problem = "the torque at that end is not compared; leave it out"
        except CableError as wrong:
            problem = str(wrong).rstrip(".")
        if problem:
            where = f"[trials.{trial.name!r}] load_cell = {channel!r}"
            findings.append(error(f"{where}: {problem}.", trial.name, channel))
    return findings


def check_known_torques(dataset: Dataset) -> Findings:
    known = dataset.instruments
    motor = known.motor in ("torque sensor", "motor current")
    able = {"known_motor_torque": motor, "swapped": known == TORQUE_SENSORS}
    able["known_joint_torque"] = known.joint == "torque sensor"
    return [
        error(
            f"[trials.{trial.name!r}] declares `{fact}`, but that torque is not of a "
            "sensor that would show it; take it out, or leave that trial out.",
            trial.name,
        )
        for trial in dataset.trials
        for fact, shown in able.items()
        if getattr(trial.facts, fact) and not shown
    ]


def _check_known_range(trial: Trial, bench: Bench) -> Iterator[DataFinding]:
    if bench.lever is None and not bench.led:
        return
    low, high = bench.span
    least, most = np.nanmin(trial.joint_angle), np.nanmax(trial.joint_angle)
    if not (low <= least and most <= high):
        part = "lever" if bench.lever else "path"
        message = (
            f"{trial.column(channels.JOINT_ANGLE)} goes from {least:.3g} to {most:.3g} "
            f"rad, but the {part} of the scene is known from {low:.3g} to {high:.3g} "
            "rad, 0 being the scene's 0 and positive where the cable pulls; declare "
            f"offset and sign of [columns.{channels.JOINT_ANGLE}]."
        )
        yield error(message, trial.name, channels.JOINT_ANGLE)


def _check_others_range(trial: Trial, bench: Bench) -> Iterator[DataFinding]:
    for joint, (low, high) in zip(bench.others, bench.stops, strict=True):
        channel = channels.other_angle(joint)
        least, most = (f(trial.channel(channel)) for f in (np.nanmin, np.nanmax))
        if low - Limit.beyond_stops <= least and most <= high + Limit.beyond_stops:
            continue
        message = (
            f"{trial.column(channel)} goes from {least:.3g} to {most:.3g} rad, but "
            f"joint {joint!r} of the scene from {low:.3g} to {high:.3g} rad; declare "
            f"unit, offset and sign of [columns.{channel}], which count as the scene."
        )
        yield error(message, trial.name, channel)


def _check_overload(trial: Trial, bench: Bench) -> Iterator[DataFinding]:
    taut = trial.facts.pretension or bench.cables[0].pretension
    for channel, torque, radius in (
        (channels.MOTOR_TORQUE, trial.motor_torque, bench.motor_radius),
        (channels.JOINT_TORQUE, trial.joint_torque, bench.joint_radius),
    ):
        if torque is None or taut == 0.0:  # nobody knows what to expect
            continue
        tension = float(np.sqrt(np.nanmean(torque**2))) / radius
        share = tension / max(taut, 1.0)
        if share > Limit.overload_ratio:
            message = (
                f"{trial.column(channel)} takes a tension of {tension:.3g} N, "
                f"{share:.3g} times the pretension of the scene; perhaps it is in mNm: "
                f"declare [columns.{channel}] unit = 'mNm'."
            )
            yield error(message, trial.name, channel)


def _check_locked(recording: Recording, facts: TrialFacts) -> None:
    channel = _ANGLES.get(facts.locked or "", "")
    values = recording.values.get(channel, np.zeros(0))
    if (moved := _robust_range(values)) > Limit.locked_range:
        problem = (
            f" moves by {moved:.3g} rad, though locked = {facts.locked!r} says that it "
            "was held fast."
        )
        recording.report("error", problem, channel)


def _check_constants(recording: Recording, facts: TrialFacts) -> None:
    sides = {channel: side for side, channel in _ANGLES.items()}
    known = (channels.TIME, channels.VALID, channels.TEMPERATURE)
    for channel, values in recording.values.items():
        side = sides.get(channel, "")
        if channel in known or channels.is_further(channel):
            continue
        if recording.rows < 2 or (side and side == facts.locked):
            continue
        highest = np.nanmax(values)
        if not highest == np.nanmin(values):
            continue
        advice = "check the sensor"
        if side:
            advice += f", or declare locked = {side!r} if it was held fast"
        problem = f" is {highest:.6g} in every row; {advice}."
        recording.report("error", problem, channel)


def _check_degrees(recording: Recording, file: DatasetFile, channel: str) -> None:
    joint = channel == channels.JOINT_ANGLE
    turns = _robust_range(recording.values[channel]) / math.tau
    if turns <= (Limit.max_joint_turns if joint else Limit.max_motor_turns):
        return
    label = recording.labels.get(channel, channel)
    if file.source(channel).unit or file.unit(channel, label) == "deg":
        recording.report("warning", f" covers {turns:.3g} turns, as declared.", channel)
        return
    problem = (
        f" covers {turns:.3g} turns if it is in radians; declare [columns.{channel}] "
        "unit = 'deg' if it is in degrees, or 'rad'."
    )
    recording.report("error", problem, channel)


def _check_turnovers(recording: Recording, channel: str) -> None:
    steps = np.abs(np.diff(recording.values[channel]))
    steps = steps[np.isfinite(steps)]
    jumps = int(np.sum(np.abs(steps - 2.0 * math.pi) < Limit.max_angle_step))
    # A motor that turns as far in one sample as in the next is fast.
    if jumps and np.quantile(steps, 0.9) <= Limit.max_angle_step:
        problem = (
            f" jumps by a full turn {jumps} times, as an encoder does that begins anew "
            "after each; make it continuous before (numpy.unwrap)."
        )
        recording.report("error", problem, channel)


def _check_leaps(recording: Recording, channel: str) -> None:
    values = recording.values[channel]
    time = recording.clocks.get(channel, recording.values[channels.TIME])
    rows = leaps(values)
    interval = np.diff(time)
    rows = rows[interval[rows - 1] < GAP_FACTOR * np.median(interval)]
    turn = np.abs(np.abs(values[rows] - values[rows - 1]) - 2.0 * math.pi)
    rows = rows[turn > Limit.max_angle_step]
    if rows.size:
        row = int(rows[0])
        more = f", and {rows.size - 1} times more" if rows.size > 1 else ""
        problem = (
            f" leaps from {values[row - 1]:.4g} to {values[row]:.4g} rad at "
            f"{time[row]:.6g} s (row {row + 1}){more}, as an encoder does that slips "
            "or is zeroed; correct the rows after it, or name the stretch before it as "
            "`valid` in dataset.toml."
        )
        recording.report("doubt", problem, channel)


def _check_copied_loads(recording: Recording) -> None:
    loads = [c for c in recording.values if channels.kind_of(c) in _LOAD_KINDS]
    for channel, other in itertools.combinations(loads, 2):
        one, two = recording.values[channel], recording.values[other]
        if _robust_range(one) > 0.0 and np.array_equal(one, two, equal_nan=True):
            problem = (
                " holds the readings of column "
                f"{recording.labels.get(channel, channel)}, in every row; record both, "
                "each by its own sensor."
            )
            recording.report("error", problem, other)


def _check_copied_rows(recording: Recording) -> None:
    kinds = channels.ANGLE, *_LOAD_KINDS
    able = [c for c in recording.values if channels.kind_of(c) in kinds]
    known = [recording.values[c] for c in able if c not in recording.clocks]
    # Rows are compared by a sum, so that a million of them take a tenth of a second.
    rows = np.zeros(recording.rows, dtype=np.uint64)
    for factor, value in enumerate(known, 1):
        own = np.ascontiguousarray(value).view(np.uint64)
        rows += own * np.uint64(0x9E3779B97F4A7C15 * factor % 2**64)
    _, first, place = np.unique(rows, return_index=True, return_inverse=True)
    shift = np.arange(rows.size) - first[place]
    # A rest repeats its first row, at a shift that grows.
    edges = np.flatnonzero(np.diff(shift, prepend=-1, append=-1))
    lengths = np.diff(edges) * (shift[edges[:-1]] > 0)
    longest = int(np.argmax(lengths)) if lengths.size else 0
    if not lengths.size or lengths[longest] < Limit.min_copied_rows:
        return
    start, end = int(edges[longest]), int(edges[longest + 1])
    before, time = start - int(shift[start]), recording.values[channels.TIME]
    first_part, part = slice(before, before + end - start), slice(start, end)
    if not all(np.array_equal(v[first_part], v[part], equal_nan=True) for v in known):
        return  # sums of different rows are equal by chance
    problem = (
        f" has the rows {before + 1} to {before + end - start} again as rows "
        f"{start + 1} to {end}, from {time[start]:.6g} s on; a copy is no repeat, so "
        "take it out or record it."
    )
    recording.report("doubt", problem)


def _robust_range(values: FloatArray) -> float:
    values = values[:: max(1, len(values) // 100_000)]
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0
    low, high = np.percentile(values, [0.5, 99.5])
    return float(high - low)


def _check_second_clock(recording: Recording, file: DatasetFile) -> None:
    declared = {file.source(channel).clock for channel in recording.values}
    used = {*declared, *recording.labels.values()}
    for name in recording.names:
        drive = re.search("motor|joint|handle|output|tension|torque|angle", name, re.I)
        if name not in used and drive and re.search("time|clock|stamp", name, re.I):
            problem = (
                f" has times of its own in column {name}; say in dataset.toml which "
                f"channels they belong to: clock = {name!r}."
            )
            recording.report("error", problem)


def _check_motion(trial: Trial) -> Iterator[DataFinding]:
    speed = np.abs(velocity(trial.motor_angle, trial.step, trial.segments))
    turn = np.abs(velocity(trial.joint_angle, trial.step, trial.segments))
    travel = np.nanmax(speed) * trial.duration, np.nanmax(turn) * trial.duration
    if travel[0] < 1e-3 and travel[1] < 1e-3:  # [rad]
        message = f"{trial.path}: neither side moves by more than a milliradian."
        yield warning(message, trial.name)
    elif not trial.ends_held and _is_copy(trial.motor_angle, trial.joint_angle):
        message = (
            f"{trial.column(channels.JOINT_ANGLE)} is "
            f"{trial.labels.get(channels.MOTOR_ANGLE, channels.MOTOR_ANGLE)} times a "
            "number to the last digit; record both angles, each by its own encoder."
        )
        yield error(message, trial.name, channels.JOINT_ANGLE)


def _is_copy(one: FloatArray, other: FloatArray) -> bool:
    there = np.isfinite(one) & np.isfinite(other)
    one, other = one[there], other[there]
    if one.size < 3 or not min(np.ptp(one), np.ptp(other)) > 0.0:
        return False
    gain, offset = np.polyfit(one, other, 1)
    left = float(np.max(np.abs(other - gain * one - offset)))
    return left < Limit.copy_tolerance * float(np.ptp(other))
