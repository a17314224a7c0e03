"""Before there are data: which trials a rig should record, ready to be played.

from cc_mujoco.diagnosis import plan

plan("bench.xml", "trials", reach=0.8, speed=3.0).resolved
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cc_mujoco._utils.atomic_io import (
    checksum_line,
    replacing_folder,
    require_ours,
    require_untouched,
)
from cc_mujoco._utils.parsing import parse_toml
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.datasets._folders import MOTION_FILE
from cc_mujoco.datasets._instruments import Instruments
from cc_mujoco.datasets._torques import derived_noise, expected_instruments
from cc_mujoco.datasets._trials import Noise
from cc_mujoco.diagnosis._phrases import format_number, format_share, plain_name
from cc_mujoco.diagnosis._propose.identifiability import MIN_CLARITY
from cc_mujoco.diagnosis._propose.planning import SATURATED_CLARITY, TrialPlan, planned
from cc_mujoco.diagnosis._rig.motions import (
    MOTION_STEP,
    middle_angle,
    trial_table,
    write_motion,
)
from cc_mujoco.diagnosis._scene.requirements import require_repairable
from cc_mujoco.diagnosis._search.verdict_rules import declared_sentence
from cc_mujoco.diagnosis.effects import EffectParameter
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import single_threaded_blas
from cc_mujoco.report._markdown import table

PLAN_PAGE = "plan.md"
DEFAULT_REACH = 0.8
"""Angle of the motor to either side where the scene does not limit the joint [rad]."""
DEFAULT_SPEED = 3.0
"""Default of the motor's largest speed [rad/s]."""
_TITLE = "# Trials to record"
_TILT_NOTE = (
    "If the rig cannot be turned, leave that trial out: a spring that softens, as "
    "rubber does, pulls like a weight, and only a weight notices the turn. Positive is "
    "as the joint is, in radians (`tilt` in `dataset.toml`)."
)


def plan(
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    axis: str | None = None,
    reach: float | None = None,
    speed: float = DEFAULT_SPEED,
    dataset_toml: str | os.PathLike[str] | None = None,
    ids: Sequence[str] | None = None,
) -> TrialPlan:
    """Choose trials by which every effect of the library shows and is distinguished.

    Args:
        scene: MJCF file of the rig, or name of a built-in scene.
        out: folder for `plan.md`, one CSV a trial and the beginning of a
            `dataset.toml`; written whole or not at all.
        axis: the axis to diagnose, of a device with several.
        reach: largest angle of the motor to either side [rad], of where the joint is in
            the middle of its named trajectories; default as far as these go.
        speed: largest speed of the motor [rad/s].
        dataset_toml: declared constants of the rig and noise of its channels; the noise
            of the joint's torque sensor is that of the device's description unless it
            is declared here.
        ids: effects to consider; default all.

    Raises:
        CableError: a scene that cannot be diagnosed, limits that are none or that the
            joint cannot have, or a folder with files that no plan wrote, or with a
            `dataset.toml` that was corrected since.
    """
    bench = Bench.of(Path(scene), axis)
    require_repairable(bench)
    swing = _reach(bench, speed) if reach is None else reach
    for name, value in (("reach", swing), ("speed", speed)):
        if not 0.0 < value < math.inf:
            raise CableError(f"{name} is {value:g}; it must be more than 0 and finite.")
    _require_possible(bench, swing)
    names = tuple(MOTION_FILE.format(f"{k:02d}") for k in range(1, 20))
    _require_free(Path(out))
    file = (
        DatasetFile() if dataset_toml is None else read_dataset_file(Path(dataset_toml))
    )
    if not file.source(channels.MOTOR_ANGLE).measured:
        raise CableError(
            f"{dataset_toml} says that the motor's angle is not measured, without "
            "which no effect can be planned for; record it"
        )
    bench = bench.known(file.rig)
    instruments = expected_instruments(file, bench)
    if not instruments.rows:
        raise CableError(
            f"{dataset_toml} says that neither torque is measured and declares no load "
            "in [rig]; a diagnosis compares at least one of the two"
        )
    declared = "" if dataset_toml is None else _read_declarations(Path(dataset_toml))
    noise = _noise(file, instruments, bench)
    noise |= derived_noise(noise, instruments, file.rig, bench)
    with single_threaded_blas():
        cells = [name for name in file.columns if channels.is_tension(name)]
        found = planned(bench, swing, speed, file.rig, noise, ids, instruments, cells)
    with replacing_folder(out) as place:
        for name, motion in zip(names, found.trials, strict=False):
            write_motion(place / name, motion)
        (place / DATASET_FILE).write_text(
            declared + _dataset(found, bench), encoding="utf-8"
        )
        text = page(found, bench, swing, speed, instruments)
        mark = f"<!-- {checksum_line(place / DATASET_FILE)} -->"  # no browser shows it
        (place / PLAN_PAGE).write_text(f"{text}\n{mark}\n", encoding="utf-8")
    for name in names[len(found.trials) :]:  # of an earlier, longer plan
        (Path(out) / name).unlink(missing_ok=True)
    return found


def _require_free(out: Path) -> None:
    """Require that at most an unchanged earlier plan is replaced."""
    page_now = _text(out / PLAN_PAGE)
    require_ours(out, lambda _: page_now.startswith(_TITLE))
    require_untouched(out, [DATASET_FILE], page_now)


def _read_declarations(path: Path) -> str:
    """Return the declarations of a plan, to continue with its trials.

    Raises:
        CableError: the file already has trials.
    """
    text = path.read_text(encoding="utf-8")
    if "trials" in parse_toml(text):
        raise CableError(
            f"{path} has [trials], and those of a plan are still to be recorded; leave "
            "them out."
        )
    return f"{text.rstrip()}\n\n" if text.strip() else ""


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def _require_possible(bench: Bench, reach: float) -> None:
    """Require that the joint can follow the reach of the motor.

    Raises:
        CableError: it exceeds a turn of the joint, as in degrees, or a lever's range.
    """
    turn = 2.0 * math.pi
    if reach * bench.motor_radius / bench.joint_radius > turn:
        most = turn * bench.joint_radius / bench.motor_radius
        raise CableError(
            f"reach is {reach:g} rad, more than a turn of joint {bench.joint!r} to "
            f"either side; it must be at most {most:.3g}, in radians of the motor."
        )
    limited = bench.lever is not None or math.isfinite(bench.reach)
    if limited and reach > (most := _half_range(bench)):
        lever = "to where its lever is not known"
        where = "beyond its stops" if bench.lever is None else lever
        raise CableError(
            f"reach is {reach:g} rad, which takes joint {bench.joint!r} {where}; it "
            f"must be at most {most:.3g}, in radians of the motor."
        )


def _half_range(bench: Bench) -> float:
    """Return the angle of the motor that moves the joint over half its range [rad]."""
    return 0.5 * float(np.ptp(bench.following(np.array(bench.span))))


def _reach(bench: Bench, speed: float) -> float:
    """Return the angle of the motor to either side by which a plan moves it [rad].

    The joint stays within the reach of its named trajectories, and the motor can go
    that far within a second.
    """
    if math.isinf(bench.reach):
        return min(
            DEFAULT_REACH, math.inf if bench.lever is None else _half_range(bench)
        )
    ends = bench.centre + bench.reach * np.array([-1.0, 0.0, 1.0])
    sides = np.abs(np.diff(bench.following(ends)))
    return min(float(sides.min()), speed)


def _noise(
    file: DatasetFile, instruments: Instruments, bench: Bench
) -> dict[str, Noise]:
    """Return the noise that the file declares, or the device's description, by channel.

    The file goes first.
    """
    found = {}
    if instruments.joint == "torque sensor" and bench.torque_noise > 0.0:
        found[channels.JOINT_TORQUE] = Noise(bench.torque_noise, 0.0, "declared")
    for name, source in file.columns.items():
        if source.noise is not None:
            factor = channels.kind_of(name).factors[
                file.unit(name, source.name or name)
            ]
            digit = (source.resolution or 0.0) * factor
            found[name] = Noise(source.noise * factor, digit, "declared")
    return found


def _dataset(found: TrialPlan, bench: Bench) -> str:
    """Return the known facts of the trials, as TOML."""
    lines = ["# What is planned; correct it where the rig did otherwise.", ""]
    for k, motion in enumerate(found.trials, start=1):
        tension = bench.cables[0].pretension * motion.pretension
        lines += [*trial_table(f"trial_{k:02d}", motion, tension), ""]
    return "\n".join(lines)


def page(
    found: TrialPlan, bench: Bench, swing: float, speed: float, instruments: Instruments
) -> str:
    """Return the plan as text and tables."""
    known = [
        f"the {side}'s torque from {instrument}, {format_number(found.noise[channel])} "
        "N m of noise"
        if instrument
        else f"the {side}'s torque not at all"
        for side, channel, instrument in zip(
            ("motor", "joint"), channels.TORQUES, instruments, strict=True
        )
    ]
    unseen = table(("effect", "why not"), sorted(found.hidden.items()))
    trials = table(
        ("file", "what to do", "pretension [N]", "slack", "seconds"),
        [
            (
                f"`{MOTION_FILE.format(f'{k:02d}')}`",
                motion.description,
                format_number(bench.cables[0].pretension * motion.pretension)
                if motion.pretension
                else "-",
                format_share(share) if motion.pretension else "-",
                format_number(MOTION_STEP * motion.motor.size),
            )
            for k, (motion, share) in enumerate(
                zip(found.trials, found.slack, strict=True), start=1
            )
        ],
    )
    resolved = table(
        ("effect", "shows from", "plausible", "most like", "separation"),
        [
            (
                each.id,
                f"{_size_text(found.sizes[each.id], each.least)}",
                f"{_size_text(found.sizes[each.id], each.plausible)}",
                each.likest,
                f"{each.separation:.0f} sd"
                + ("" if each.separation >= MIN_CLARITY else " (tied)"),
            )
            for each in found.resolved
        ],
    )
    return "\n".join(
        [
            _TITLE,
            "",
            f"For {bench.path.name}: motor within {_describe_limits(bench, swing)} "
            f"rad and {format_number(speed)} rad/s; {known[0]}, {known[1]}.",
            "",
            trials,
            "",
            "Each file has the motor's angle to play, and the joint's as expected: "
            "hold it there where it is locked or against a spring, leave it free else. "
            "Record both angles and what tells the torques at 200 Hz or more, call the "
            "recordings `trial_01.csv` and so on, and put them and `dataset.toml` into "
            "a folder of their own.",
            "",
            "What these trials would resolve, in the scene as it is, once everything "
            "else is tuned. An effect shows from the size that is "
            f"{MIN_CLARITY:g} standard deviations of the noise; separation: a "
            "plausible size where the effect most like it is fitted as well. A real "
            f"rig differs from the scene by more than noise: {SATURATED_CLARITY:g} is "
            "comfortable.",
            "",
            resolved,
            "",
            *(
                (facts.strip(), "")
                if (facts := declared_sentence(found.declared))
                else ()
            ),
            *((_TILT_NOTE, "") if any(motion.tilt for motion in found.trials) else ()),
            *(
                ("Not testable with these instruments:", "", unseen, "")
                if found.hidden
                else ()
            ),
        ]
    )


def _describe_limits(bench: Bench, swing: float) -> str:
    """Return the angles within which the motor moves, in words."""
    at = middle_angle(bench, swing)
    if at == 0.0:
        return format_number(swing)
    return f"{format_number(at - swing)} to {format_number(at + swing)}"


def _size_text(first: EffectParameter, value: float) -> str:
    return f"{plain_name(first.name)} {format_number(value)} {first.unit}".removesuffix(
        " 1"
    )
