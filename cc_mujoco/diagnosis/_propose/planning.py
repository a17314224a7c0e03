"""Choice of trials before there are any data: all effects testable, none tied.

The catalogue's motions are simulated with the scene as it is, and with each effect at a
plausible size, see `plausible_size`. The change by an effect, less the part that tuning
can explain, adds up over trials in the normal equations, so every set of trials is
judged without another simulation.
"""

import itertools
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.parsing import parse_toml
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.datasets._folders import MOTION_FILE
from cc_mujoco.datasets._torques import derived_noise, expected_instruments
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Constant, Instruments, Noise
from cc_mujoco.diagnosis._fit.intervals import plausible_size
from cc_mujoco.diagnosis._fit.problem import Problem, jacobian
from cc_mujoco.diagnosis._judge import declared_sentence
from cc_mujoco.diagnosis._phrases import format_number, format_share, format_size
from cc_mujoco.diagnosis._propose import experiment
from cc_mujoco.diagnosis._propose.experiment import CataloguedTrial
from cc_mujoco.diagnosis._rig.records import Arrays, Record, load_values
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from cc_mujoco.diagnosis._scene.repair import require_repairable
from cc_mujoco.diagnosis._search.candidates import effect_amplitudes, screen
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import usual_effects
from cc_mujoco.diagnosis.effects._effect import EffectParameter
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import single_threaded_blas
from cc_mujoco.native import FloatArray
from cc_mujoco.report._markdown import table

SATURATED_CLARITY = 10.0 * Limit.min_clarity
"""Clarity above which more is of no further use: noise is not the only error."""

Owners = Sequence[tuple[str, float]]
"""Effect and plausible size of every amplitude; a column is its change."""


class Resolved(NamedTuple):
    """Visibility of one effect in a set of trials, and its separation from others."""

    id: str  # of the effect
    plausible: float  # size of its first amplitude that is plausible on the rig
    clarity: float  # of plausible sizes, in standard deviations once all is tuned
    likest: str  # effect that is most similar, "nothing" without others
    separation: float  # clarity of a plausible size once `likest` is fitted too

    @property
    def least(self) -> float:
        """Size of the first amplitude that would just show, in its unit."""
        return Limit.min_clarity * self.plausible / max(self.clarity, 1e-12)


@dataclass(frozen=True)
class TrialPlan:
    """Trials to record and the effects that they would resolve."""

    trials: tuple[CataloguedTrial, ...]  # in the order of their contribution
    resolved: tuple[Resolved, ...]  # by the trials together, the least certain first
    noise: Mapping[str, float]  # assumed deviation of every compared torque [N m]
    hidden: Mapping[str, str]  # effects that these instruments cannot show, and why
    declared: Mapping[str, str]  # facts that remove an effect or bound it
    sizes: Mapping[str, EffectParameter]  # first amplitude of every effect
    slack: tuple[float, ...]  # share of each trial's samples in which a cable is slack


def planned(
    bench: Bench,
    swing: float,
    rate: float,
    constants: Mapping[str, Constant],
    noise: Mapping[str, Noise],
    ids: Sequence[str] | None = None,
    instruments: Instruments = TORQUE_SENSORS,
    cells: Collection[str] = (),
) -> TrialPlan:
    """Return trials, chosen one by one, that make effects testable and not tied.

    It has the standard trials; those with the cables off come last, as mounting changes
    the pretension. `swing` is the motor's largest angle to either side [rad], `rate`
    its largest speed [rad/s], `cells` are channels of load cells in single cables.
    """
    load = None
    if instruments.joint == "known load":
        load = load_values(constants).get("load_stiffness", 0.0)
    every = experiment.motions(bench, swing, rate, load, instruments, cells)
    every = [motion for motion in every if motion.usual]
    rows, tension = len(instruments.rows), bench.cables[0].pretension
    records = tuple(experiment.motion_record(m, bench, rows, tension) for m in every)
    plant = SimulatedRig(bench, records, 16, 1, instruments, constants)

    def read(torques: Arrays) -> tuple[Record, ...]:
        pairs = zip(plant.records, torques, strict=True)
        return tuple(replace(record, measured=torque) for record, torque in pairs)

    records = read(plant.simulate({}))
    slack = [plant.slack_share({}, (), k) for k in range(len(records))]
    if len(bench.cables) == 1:  # of a pair the other cable pulls
        kept = [k for k, share in enumerate(slack) if share <= Limit.max_slack]
        every, slack = [every[k] for k in kept], [slack[k] for k in kept]
        records = tuple(records[k] for k in kept)
    plant = plant.limited(records)
    free = baseline_parameters(bench, records, constants, instruments)
    library, place = plant.library, np.zeros(len(free))
    wanted = usual_effects() if ids is None else ids
    able = [name for name in wanted if name in library.effects]
    usual = Problem(plant, free, (), (), ()).values(place)
    torques = plant.simulate(usual)
    sizes = {}
    whole = np.concatenate(torques, axis=1)
    for name, row in zip(instruments.channels, whole, strict=True):
        sizes[name] = Limit.default_torque_noise * float(np.std(row))
        if name in noise:
            sizes[name] = noise[name].deviation
    floor: tuple[FloatArray, ...] = ()
    for record, torque in zip(records, torques, strict=True):
        (there,) = plant.limited([_shaken(record, noise)]).simulate(usual)
        scatter = np.sqrt(np.mean((there - torque) ** 2, axis=1))
        size = np.hypot(scatter, [*sizes.values()])
        floor = (*floor, np.broadcast_to(size[:, None], torque.shape))
    # Torques are compared up to a band: so many of the samples are independent.
    weight = min(1.0, 2.0 * Limit.max_band * experiment.MOTION_STEP) ** 0.5
    problem = Problem(plant.limited(read(torques)), free, (), floor, floor, weight)
    grams, owners = _gram_matrices(problem, place, able)
    standard = [k for k, motion in enumerate(every) if motion.standard]
    chosen = _choose_records(grams, owners, standard)
    chosen.sort(key=lambda k: every[k].pretension == 0.0)
    together = np.sum([grams[k] for k in chosen], axis=0)
    resolved = _resolved_effects(together, owners)
    return TrialPlan(
        tuple(every[k] for k in chosen),
        tuple(sorted(resolved, key=lambda each: each.separation)),
        sizes,
        {name: library.hidden[name] for name in wanted if name in library.hidden},
        {name: library.declared[name] for name in wanted if name in library.declared},
        {name: effect_amplitudes(library.effects[name])[0] for name in able},
        tuple(slack[k] for k in chosen),
    )


def _shaken(record: Record, noise: Mapping[str, Noise]) -> Record:
    """Return the record with noise on both angles, slow enough to pass the filters."""
    random, size, angles = np.random.default_rng(0), record.time.size, []
    known = (MOTOR_ANGLE, record.motor_angle), (JOINT_ANGLE, record.joint_angle)
    for name, angle in known:
        deviation = Limit.default_angle_noise
        if name in noise:
            deviation = noise[name].deviation
        # Slow enough to pass the filters, and to strain a cable that sticks.
        slow = np.repeat(random.normal(0.0, deviation, -(-size // 8)), 8)
        angles.append(angle + slow[:size])
    return replace(record, motor_angle=angles[0], joint_angle=angles[1])


def _gram_matrices(
    problem: Problem, x: FloatArray, ids: Sequence[str]
) -> tuple[list[FloatArray], list[tuple[str, float]]]:
    """Return the Gram matrix of each record, and owners of its last columns."""
    records = problem.plant.records
    masks = [record.counts for record in records]
    slopes = jacobian(problem, x, masks)
    signatures = screen(problem, x, masks, ids, starts=1)
    owners, columns = [], [slopes]
    for sign in signatures:
        sizes = effect_amplitudes(problem.plant.library.effects[sign.id])
        plausible = [plausible_size(each, problem, x) for each in sizes]
        typical = [each.typical for each in sizes]
        columns.append(sign.changes * np.divide(plausible, typical))
        owners += [(sign.id, size) for size in plausible]
    table = np.concatenate(columns, axis=1)
    rows = len(problem.plant.instruments.rows)
    ends = np.cumsum([0, *(rows * record.time.size for record in records)])
    grams = [table[a:b].T @ table[a:b] for a, b in itertools.pairwise(ends)]
    priors = table[ends[-1] :]
    share = priors.T @ priors
    return [gram + share / len(grams) for gram in grams], owners


def _choose_records(grams: Arrays, owners: Owners, fixed: Sequence[int]) -> list[int]:
    """Return the `fixed` records and others that improve the design, one by one."""
    chosen, best = list(fixed), 0.0
    while len(chosen) < len(grams):
        tried = {}  # number of effects that would be identified, in part or whole
        for k in sorted(set(range(len(grams))) - set(chosen)):
            gram = np.sum([grams[j] for j in (*chosen, k)], axis=0)
            most, resolved = SATURATED_CLARITY, _resolved_effects(gram, owners)
            pairs = [(each.clarity / most, each.separation / most) for each in resolved]
            tried[k] = sum(0.5 * min(a, 1.0) + 0.5 * min(b, 1.0) for a, b in pairs)
        k = max(tried, key=lambda each: tried[each])
        if tried[k] < best + 0.02:
            break
        chosen.append(k)
        best = tried[k]
    return chosen


def _resolved_effects(gram: FloatArray, owners: Owners) -> list[Resolved]:
    base = len(gram) - len(owners)
    known = gram[:base, :base]
    cross = gram[:base, base:]
    size = np.sqrt(np.diag(known))
    size[size == 0.0] = 1.0
    shift = np.linalg.lstsq(known / np.outer(size, size), cross / size[:, None])[0]
    left = gram[base:, base:] - (cross / size[:, None]).T @ shift
    index: dict[str, list[int]] = {}
    for place, (name, _) in enumerate(owners):
        index.setdefault(name, []).append(place)
    white = {}  # orthonormal combinations of each effect's changes (amplitudes, k)
    for name, own in index.items():
        values, vectors = np.linalg.eigh(left[np.ix_(own, own)])
        kept = values > 1e-6 * max(float(values[-1]), 1e-300)
        white[name] = vectors[:, kept] / np.sqrt(values[kept])
    found = []
    for name, own in index.items():
        clarity = float(np.sqrt(np.max(np.diag(left)[own])))
        others = [(n, np.ix_(own, theirs)) for n, theirs in index.items() if n != name]
        cosines: dict[str, float] = {}  # of combinations of both effects' changes
        for other, part in others:
            crossed = white[name].T @ left[part] @ white[other]
            values = np.linalg.svd(crossed, compute_uv=False)
            cosines[other] = min(float(values.max(initial=0.0)), 1.0)
        likest = max(cosines, key=lambda other: cosines[other], default="nothing")
        separation = clarity * float(np.sqrt(1.0 - cosines.get(likest, 0.0) ** 2))
        plausible = owners[own[0]][1]
        found.append(Resolved(name, plausible, clarity, likest, separation))
    return found


PLAN_PAGE = "plan.md"
_TITLE = "# Trials to record"


def plan(
    scene: str | os.PathLike[str], out: str | os.PathLike[str], *,
    axis: str | None = None, reach: float | None = None,
    speed: float = Limit.default_speed,
    dataset_toml: str | os.PathLike[str] | None = None,
    ids: Sequence[str] | None = None, begun: Callable[[], object] = lambda: None,
) -> TrialPlan:  # fmt: skip
    """Choose trials by which every effect of the library shows and is distinguished.

    Args:
        scene: MJCF file of the rig, or name of a built-in scene.
        out: folder for `plan.md`, one CSV a trial and the beginning of a
            `dataset.toml`; written whole or not at all.
        axis: the axis to diagnose, of a device with several.
        reach: largest angle of the motor to either side [rad] of where the joint is in
            the middle of its named trajectories; default as far as these go.
        speed: largest speed of the motor [rad/s].
        dataset_toml: declared constants of the rig and noise of its channels; the noise
            of the joint's torque sensor is that of the device's description unless it
            is declared here.
        ids: effects to consider; default all.
        begun: called once all is checked, before the plan is computed.

    Raises:
        CableError: a scene that cannot be diagnosed, limits that are not positive or
            that the joint cannot reach, or a folder with files that no plan wrote, or
            with a `dataset.toml` that was corrected since.
    """
    bench = Bench.of(Path(scene), axis)
    require_repairable(bench)
    swing = _reach(bench, speed) if reach is None else reach
    for name, value in (("reach", swing), ("speed", speed)):
        if not 0.0 < value < math.inf:
            raise CableError(f"{name} is {value:g}; it must be more than 0 and finite.")
    _require_possible(bench, swing)
    names = tuple(MOTION_FILE.format(f"{k:02d}") for k in range(1, 20))
    page_now = ""
    with suppress(OSError, ValueError):
        page_now = (Path(out) / PLAN_PAGE).read_text(encoding="utf-8")
    atomic_io.require_ours(Path(out), lambda _: page_now.startswith(_TITLE))
    atomic_io.require_unmodified(out, [DATASET_FILE], page_now)
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
    declared = ""
    if dataset_toml is not None:
        declared = Path(dataset_toml).read_text(encoding="utf-8")
        if "trials" in parse_toml(declared):
            raise CableError(
                f"{dataset_toml} has [trials], and those of a plan are still to be "
                "recorded; leave them out."
            )
        declared = f"{declared.rstrip()}\n\n" if declared.strip() else ""
    noise = _noise(file, instruments, bench)
    noise |= derived_noise(noise, instruments, file.rig, bench)
    begun()
    with single_threaded_blas():
        cells = [name for name in file.columns if channels.is_tension(name)]
        found = planned(bench, swing, speed, file.rig, noise, ids, instruments, cells)
    with atomic_io.replacing_folder(out) as place:
        facts = ["# What is planned; correct it where the rig did otherwise.", ""]
        for k, motion in enumerate(found.trials, start=1):
            experiment.write_motion(place / names[k - 1], motion)
            tension = bench.cables[0].pretension * motion.pretension
            facts += [*experiment.trial_table(f"trial_{k:02d}", motion, tension), ""]
        (place / DATASET_FILE).write_text(declared + "\n".join(facts), encoding="utf-8")
        text = page(found, bench, swing, speed, instruments)
        mark = atomic_io.checksum_line(place / DATASET_FILE)  # no browser shows it
        (place / PLAN_PAGE).write_text(f"{text}\n<!-- {mark} -->\n", encoding="utf-8")
    for name in names[len(found.trials) :]:  # of an earlier, longer plan
        (Path(out) / name).unlink(missing_ok=True)
    return found


def _require_possible(bench: Bench, reach: float) -> None:
    """Require that the joint can follow the motor by `reach` [rad] to either side."""
    most, limit = math.tau * bench.joint_radius / bench.motor_radius, ""
    if reach * bench.motor_radius / bench.joint_radius > math.tau:
        limit = (
            f", more than a turn of joint {bench.joint!r} to either side; it must be "
            f"at most {most:.3g}, in radians of the motor."
        )
    elif (bench.lever is not None or math.isfinite(bench.reach)) and reach > (
        most := experiment.half_range(bench)
    ):
        where = "beyond its stops"
        if bench.lever is not None:
            where = "to where its lever is not known"
        limit = (
            f", which takes joint {bench.joint!r} {where}; it must be at most "
            f"{most:.3g}, in radians of the motor."
        )
    if limit:
        raise CableError(f"reach is {reach:g} rad{limit}")


def _reach(bench: Bench, speed: float) -> float:
    """Return the motor's default reach [rad]: to a stop, at most 1 s at `speed`."""
    if math.isinf(bench.reach):
        half = math.inf if bench.lever is None else experiment.half_range(bench)
        return min(Limit.default_reach, half)
    ends = bench.centre + bench.reach * np.array([-1.0, 0.0, 1.0])
    sides = np.abs(np.diff(bench.following(ends)))
    return min(float(sides.min()), speed)


def _noise(file: DatasetFile, known: Instruments, bench: Bench) -> dict[str, Noise]:
    found = {}
    if known.joint == "torque sensor" and bench.torque_noise > 0.0:
        found[channels.JOINT_TORQUE] = Noise(bench.torque_noise, 0.0, "declared")
    for name, source in file.columns.items():
        if source.noise is not None:
            factor = file.factor(name, source.name or name)
            digit = (source.resolution or 0.0) * factor
            found[name] = Noise(source.noise * factor, digit, "declared")
    return found


def page(
    found: TrialPlan, bench: Bench, swing: float, speed: float, instruments: Instruments
) -> str:
    known = []
    for side, channel, instrument in zip(
        ("motor", "joint"), channels.TORQUES, instruments, strict=True
    ):
        how = "not at all"
        if instrument:
            noise = format_number(found.noise[channel])
            how = f"from {instrument}, {noise} N m of noise"
        known.append(f"the {side}'s torque {how}")
    at, within = experiment.middle_angle(bench, swing), format_number(swing)
    if at != 0.0:
        within = f"{format_number(at - swing)} to {format_number(at + swing)}"
    trials = []
    for k, motion in enumerate(found.trials):
        tension, slack = "-", "-"
        if motion.pretension:
            tension = format_number(bench.cables[0].pretension * motion.pretension)
            slack = format_share(found.slack[k])
        file = f"`{MOTION_FILE.format(f'{k + 1:02d}')}`"
        seconds = format_number(experiment.MOTION_STEP * motion.motor.size)
        trials.append((file, motion.description, tension, slack, seconds))
    resolved = []
    for each in found.resolved:
        first = found.sizes[each.id]
        both = each.least, each.plausible
        least, usual = (format_size(first.name, size, first.unit) for size in both)
        separation = f"{each.separation:.0f} sd"
        if not each.separation >= Limit.min_clarity:
            separation += " (tied)"
        resolved.append((each.id, least, usual, each.likest, separation))
    blocks = [
        _TITLE,
        f"For {bench.path.name}: motor within {within} "
        f"rad and {format_number(speed)} rad/s; {known[0]}, {known[1]}.",
        table(("file", "what to do", "pretension [N]", "slack", "seconds"), trials),
        "Each file has the motor's angle to play, and the joint's as expected: "
        "hold it there where it is locked or against a spring, leave it free else. "
        "Record both angles and both torques, or what stands for them, at 200 Hz "
        "or more, call the recordings `trial_01.csv` and so on, and put them and "
        "`dataset.toml` into a folder of their own.",
        "What these trials would resolve, in the scene as it is, once everything "
        "else is tuned. An effect shows from the size that is "
        f"{Limit.min_clarity:g} standard deviations of the noise; separation: a "
        "plausible size where the effect most like it is fitted as well. A real "
        f"rig differs from the scene by more than noise: {SATURATED_CLARITY:g} is "
        "comfortable.",
        table(
            ("effect", "shows from", "plausible", "most like", "separation"), resolved
        ),
    ]
    if facts := declared_sentence(found.declared):
        blocks.append(facts.strip())
    if any(motion.tilt for motion in found.trials):
        blocks.append(
            "If the rig cannot be turned, leave that trial out: a spring that softens, "
            "as rubber does, pulls like a weight, and only a weight notices the turn. "
            "Positive is as the joint is, in radians (`tilt` in `dataset.toml`)."
        )
    if found.hidden:
        unseen = table(("effect", "why not"), sorted(found.hidden.items()))
        blocks += ["Not testable with these instruments:", unseen]
    return "\n\n".join(blocks) + "\n"
