"""Before there are data: which trials a rig should record, ready to be played.

from cc_mujoco.diagnosis.plan import plan

plan("bench.xml", "trials", reach=0.8, speed=3.0).resolved
"""

from __future__ import annotations

import csv
import math
import os
import tomllib
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from cc_mujoco.diagnosis.data import channels
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.columns import DATASET_FILE
from cc_mujoco.diagnosis.data.dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.diagnosis.data.instruments import Instruments
from cc_mujoco.diagnosis.data.torques import derived_noise, expected
from cc_mujoco.diagnosis.data.trials import Noise
from cc_mujoco.diagnosis.effects import EffectParameter
from cc_mujoco.diagnosis.inference.motions import DT, CataloguedTrial, middle
from cc_mujoco.diagnosis.inference.planning import CLEARLY, TrialPlan, planned
from cc_mujoco.diagnosis.inference.testable import SEEN
from cc_mujoco.diagnosis.scene.requirements import require_repairable
from cc_mujoco.diagnosis.wording import number, plain
from cc_mujoco.errors import CableError
from cc_mujoco.estimation.least_squares import plain_algebra
from cc_mujoco.files import (
    as_written,
    replacing_folder,
    require_ours,
    require_untouched,
)
from cc_mujoco.markdown import table

PAGE = "plan.md"
MOTION = "motion_{}.csv"
"""What a trial is to play, by its number of two digits."""
REACH = 0.8
"""Angle of the motor to either side where the scene does not limit the joint [rad]."""
SPEED = 3.0
"""Largest speed of the motor where none is given [rad/s]."""
_TITLE = "# Trials to record"
_TURNED = (
    "If the rig cannot be turned, leave that trial out: a spring that softens, as "
    "rubber does, pulls like a weight, and only a weight notices the turn. Positive is "
    "as the joint is, in radians (`tilt` in `dataset.toml`)."
)


def plan(
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    reach: float | None = None,
    speed: float = SPEED,
    dataset_toml: str | os.PathLike[str] | None = None,
    ids: Sequence[str] | None = None,
) -> TrialPlan:
    """Choose trials by which every effect of the library shows and is told apart.

    Args:
        scene: MJCF file of the rig.
        out: folder for `plan.md`, one CSV a trial and the beginning of a
            `dataset.toml`; written whole or not at all.
        reach: largest angle of the motor to either side [rad], of 0 where the joint's
            range allows that; default at most half of that range.
        speed: largest speed of the motor [rad/s].
        dataset_toml: what is known of the rig and the noise of its channels.
        ids: effects to consider; default all.

    Raises:
        CableError: a scene that cannot be diagnosed, limits that are none or that the
            joint cannot have, or a folder with files that no plan wrote, or with a
            `dataset.toml` that was corrected since.
    """
    bench = Bench.of(Path(scene))
    require_repairable(bench)
    swing = _reach(bench) if reach is None else reach
    for name, value in (("reach", swing), ("speed", speed)):
        if not 0.0 < value < math.inf:
            raise CableError(f"{name} is {value:g}; it must be more than 0 and finite.")
    _require_possible(bench, swing)
    names = tuple(MOTION.format(f"{k:02d}") for k in range(1, 20))
    _require_free(Path(out), (PAGE, DATASET_FILE, *names))
    file = (
        DatasetFile() if dataset_toml is None else read_dataset_file(Path(dataset_toml))
    )
    bench = bench.known(file.rig)
    instruments = expected(file, bench)
    if not instruments.rows:
        raise CableError(
            f"{dataset_toml} says that neither torque is measured and declares no load "
            "in [rig]; a diagnosis compares at least one of the two"
        )
    declared = "" if dataset_toml is None else _declared(Path(dataset_toml))
    noise = _noise(file)
    noise |= derived_noise(noise, instruments, file.rig, bench)
    with plain_algebra():
        found = planned(bench, swing, speed, file.rig, noise, ids, instruments)
    with replacing_folder(out) as place:
        for name, motion in zip(names, found.trials, strict=False):
            _write_motion(place / name, motion)
        (place / DATASET_FILE).write_text(
            declared + _dataset(found, bench), encoding="utf-8"
        )
        said = page(found, bench, swing, speed, instruments)
        mark = f"<!-- {as_written(place / DATASET_FILE)} -->"  # no browser shows it
        (place / PAGE).write_text(f"{said}\n{mark}\n", encoding="utf-8")
    for name in names[len(found.trials) :]:  # of an earlier, longer plan
        (Path(out) / name).unlink(missing_ok=True)
    return found


def _require_free(out: Path, names: Sequence[str]) -> None:
    """See to it that nothing is replaced but an earlier plan that nobody touched."""
    page_now = _text(out / PAGE)
    require_ours(out, names, lambda _: page_now.startswith(_TITLE))
    require_untouched(out, [DATASET_FILE], page_now)


def _declared(path: Path) -> str:
    """Return what was declared for a plan, to go on with its trials.

    Raises:
        CableError: it speaks of trials, of which there are none before the plan.
    """
    text = path.read_text(encoding="utf-8")
    if "trials" in tomllib.loads(text):
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
    """Refuse a reach of the motor that no joint follows.

    Raises:
        CableError: it is beyond a turn of the joint, as degrees would be.
    """
    turn = 2.0 * math.pi
    if reach * bench.motor_radius / bench.joint_radius > turn:
        most = turn * bench.joint_radius / bench.motor_radius
        raise CableError(
            f"reach is {reach:g} rad, more than a turn of joint {bench.joint!r} to "
            f"either side; it must be at most {most:.3g}, in radians of the motor."
        )
    if bench.lever is not None and reach > (most := _room(bench)):
        raise CableError(
            f"reach is {reach:g} rad, which takes joint {bench.joint!r} to where its "
            f"lever is not known; it must be at most {most:.3g}, in radians of the "
            "motor."
        )


def _room(bench: Bench) -> float:
    """Angle of the motor that takes the joint over half of its range [rad]."""
    return 0.5 * float(np.ptp(bench.following(np.array(bench.span))))


def _reach(bench: Bench) -> float:
    """Angle of the motor to either side that the range of the joint allows [rad]."""
    model = mujoco.MjModel.from_xml_path(str(bench.path))
    if bench.lever is None and not model.jnt_limited[model.joint(bench.joint).id]:
        return REACH
    return min(REACH, _room(bench))


def _noise(file: DatasetFile) -> dict[str, Noise]:
    """Noise that is declared, by channel."""
    found = {}
    for name, source in file.columns.items():
        if source.noise is not None:
            factor = channels.kind(name).factors[file.unit(name, source.name or name)]
            digit = (source.resolution or 0.0) * factor
            found[name] = Noise(source.noise * factor, digit, "declared")
    return found


def _write_motion(path: Path, motion: CataloguedTrial) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "motor_angle_rad", "joint_angle_rad"))
        rows.writerows(
            (f"{DT * k:.3f}", f"{motor:.6f}", f"{joint:.6f}")
            for k, (motor, joint) in enumerate(
                zip(motion.motor, motion.joint, strict=False)
            )
        )


def _dataset(found: TrialPlan, bench: Bench) -> str:
    """Return what is known already of the trials, as TOML."""
    lines = ["# What is planned; correct it where the rig did otherwise.", ""]
    for k, motion in enumerate(found.trials, start=1):
        tension = bench.cables[0].pretension * motion.pretension
        lines += [f'[trials."trial_{k:02d}"]', f"pretension = {tension:g}"]
        if motion.description.startswith("joint locked"):
            lines.append('locked = "joint"')
        if motion.tilt:
            lines.append(f"tilt = {motion.tilt:.4g}")
        lines += [f'notes = "{motion.description}"', ""]
    return "\n".join(lines)


def page(
    found: TrialPlan, bench: Bench, swing: float, speed: float, instruments: Instruments
) -> str:
    """The plan in words and tables."""
    known = [
        f"the {side}'s torque from {instrument}, {number(found.noise[channel])} N m of "
        "noise"
        if instrument
        else f"the {side}'s torque not at all"
        for side, channel, instrument in zip(
            ("motor", "joint"), channels.TORQUES, instruments, strict=True
        )
    ]
    unseen = table(("effect", "why not"), sorted(found.hidden.items()))
    trials = table(
        ("file", "what to do", "pretension [N]", "seconds"),
        [
            (
                f"`{MOTION.format(f'{k:02d}')}`",
                motion.description,
                number(bench.cables[0].pretension * motion.pretension),
                number(DT * motion.motor.size),
            )
            for k, motion in enumerate(found.trials, start=1)
        ],
    )
    resolved = table(
        ("effect", "shows from", "plausible", "most like", "told apart by"),
        [
            (
                each.id,
                f"{_size(found.sizes[each.id], each.least)}",
                f"{_size(found.sizes[each.id], each.plausible)}",
                each.likest,
                f"{each.apart:.0f} sd" + ("" if each.apart >= SEEN else " (tied)"),
            )
            for each in found.resolved
        ],
    )
    return "\n".join(
        [
            _TITLE,
            "",
            f"For {bench.path.name}: motor within {_limits(bench, swing)} rad and "
            f"{number(speed)} rad/s; {known[0]}, {known[1]}.",
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
            f"{SEEN:g} standard deviations of the noise; told apart: a plausible size "
            "where the effect most like it is fitted as well. A real rig differs from "
            f"the scene by more than noise: {CLEARLY:g} is comfortable.",
            "",
            resolved,
            "",
            *((_TURNED, "") if any(motion.tilt for motion in found.trials) else ()),
            *(
                ("Not testable with these instruments:", "", unseen, "")
                if found.hidden
                else ()
            ),
        ]
    )


def _limits(bench: Bench, swing: float) -> str:
    """Angles within which the motor moves, in words."""
    at = middle(bench, swing)
    if at == 0.0:
        return number(swing)
    return f"{number(at - swing)} to {number(at + swing)}"


def _size(first: EffectParameter, value: float) -> str:
    return f"{plain(first.name)} {number(value)} {first.unit}".removesuffix(" 1")
