"""Catalogue of trials that most rigs can run, and the one that separates two rivals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._load_cells import SingleCell
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Instruments
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.problem import CrossValidation, Problem, TorqueDerivatives
from cc_mujoco.diagnosis._phrases import effect_name, format_number
from cc_mujoco.diagnosis._rig.records import Arrays, Record, wind_up_angle
from cc_mujoco.diagnosis._search.candidates import are_confusable, tie_reason
from cc_mujoco.diagnosis._search.search import Found, Search
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, NextExperiment
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

MOTION_STEP = 0.008
"""Time between the samples of a motion [s]."""
QUARTER_TURN = 0.5 * np.pi
"""Angle that a rig is turned by, so that its weights pull otherwise [rad]."""


@dataclass(frozen=True)
class CataloguedTrial:
    """Trial of the catalogue, which most rigs can run."""

    description: str  # instruction
    motor: FloatArray  # angle of the motor (samples,) [rad]
    joint: FloatArray  # angle of the joint (samples,) [rad]
    pretension: float = 1.0  # relative to that of the data; 0 with the cables taken off
    tilt: float = 0.0  # angle by which the rig is turned about the joint's axis [rad]
    # Of known weights in place of cables, at motor and joint; see `TrialFacts` [N m]
    known_torques: tuple[float, float] = (0.0, 0.0)
    swapped: bool = False  # whether the torque sensors change places
    load_cell: str = ""  # channel of a load cell in one cable, or ""; see `TrialFacts`
    hard: bool = False  # whether it is proposed only if no other settles the tie
    usual: bool = True  # whether a plan considers it; others are proposed for a tie
    # Whether a plan always has it, as no other separates weights, springs and sensors
    standard: bool = False

    def cell_on(self, bench: Bench, pretension: float | None) -> SingleCell | None:
        cell = self.load_cell
        return SingleCell.of(cell, bench, pretension) if cell else None

    @property
    def toml(self) -> tuple[str, ...]:
        """Lines of the trial in `dataset.toml`, without `pretension` and `notes`."""
        motor, joint = self.known_torques
        lines = {
            "unhooked = true": self.pretension == 0.0,
            'locked = "joint"': self.description.startswith("joint locked"),
            f"tilt = {self.tilt:.4g}": self.tilt,
            f"known_motor_torque = {motor:g}": motor,
            f"known_joint_torque = {joint:g}": joint,
            "swapped = true": self.swapped,
            f'load_cell = "{self.load_cell}"': self.load_cell,
        }
        return tuple(line for line, there in lines.items() if there)


def motions(
    bench: Bench,
    swing: float,
    rate: float,
    load: float | None = None,
    instruments: Instruments = TORQUE_SENSORS,
    cells: Collection[str] = (),
) -> list[CataloguedTrial]:
    """Return the trials of the catalogue within these limits, two beyond `swing`.

    They move about `middle_angle` by at most `swing` to either side [rad], at most at
    `rate` [rad/s], against a known `load` if any [N m/rad]. Each of the `cells`,
    channels of load cells in single cables, adds its own trials.
    """
    from scipy.ndimage import gaussian_filter1d

    ratio = bench.motor_radius / bench.joint_radius
    wind = wind_up_angle(bench)
    motor_middle = middle_angle(bench, swing)
    (joint_middle,) = bench.carried(np.array([motor_middle]))

    def free(motor: FloatArray) -> FloatArray:
        return np.asarray(bench.carried(motor_middle + motor) - joint_middle)

    time = np.arange(0.0, 40.0, MOTION_STEP)

    def triangle(size: float, speed: float | FloatArray) -> FloatArray:
        travel = np.cumsum(np.broadcast_to(speed, time.shape)) * MOTION_STEP
        phase = travel / (4.0 * size)
        wave = size * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5))
        # No motor turns in an instant.
        width = 0.03 / MOTION_STEP
        return np.asarray(gaussian_filter1d(wave, width, mode="nearest"))

    shares = 0.02, 0.06, 0.2, 0.5, 1.0  # of the greatest speed, one after another
    steps = np.repeat(shares, math.ceil(time.size / len(shares)))[: time.size]
    ladder = triangle(swing, rate * steps)
    # From 0.1 Hz on by 0.08 Hz/s, to 3.3 Hz after 40 s, where its speed is `rate`
    loudness = min(0.3 * swing, rate / (2.0 * np.pi * 3.3))
    chirp = loudness * np.sin(2.0 * np.pi * (0.1 * time + 0.04 * time**2))
    cable = bench.cables[0]
    # This nearly loosens one cable and tightens the other as much.
    taut = 0.8 * cable.pretension
    stretch = taut / cable.axial_stiffness * cable.length
    taut_angle = stretch / bench.motor_radius
    give = 1.0 - stretch / (ratio * swing * bench.joint_radius)
    sweep = triangle(swing, rate * 0.2)
    dwell = swing * np.interp(
        time, [0, 1, 2, 3, 6, 7, 15, 16, 38, 39, 40], [0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    )
    locked, reversal = min(4.0 * wind, taut_angle), min(2.0 * wind, 0.5 * taut_angle)
    small = triangle(reversal, rate * 0.1)
    still = np.zeros(time.size)

    def play(
        words: str, motor: FloatArray, joint: FloatArray | None = None, **more: Any
    ) -> CataloguedTrial:
        """Return a trial about the middle; the joint follows the motor by default."""
        along = joint_middle + (free(motor) if joint is None else joint)
        return CataloguedTrial(words, motor_middle + motor, along, **more)

    def hold(words: str, motor: FloatArray, pretension: float = 1.0) -> CataloguedTrial:
        """Return a trial with the joint locked; a lone cable is pulled to one side."""
        if len(bench.cables) == 1:
            motor = 0.5 * (motor - motor.min())
        return play(f"joint locked, {words}", motor, still, pretension=pretension)

    if load is not None:
        stiffness = len(bench.cables) * cable.axial_stiffness / cable.length
        kept = 1.0 / (1.0 + load / (stiffness * bench.joint_radius**2))
        turning = "joint turning its load"
        return [
            play(f"{turning}, {how}", each, free(kept * each), pretension=share)
            for how, each, share in (
                ("triangles at five speeds", ladder, 1.0),
                ("chirp from 0.1 to 3 Hz", chirp, 1.0),
                ("moves with rests of 1, 3, 8 and 22 s", dwell, 1.0),
                ("small reversals within the wind-up of the cable", small, 1.0),
                ("slow triangle over the whole range, pretension halved", sweep, 0.5),
            )
        ]

    turned = "the rig turned by 90 degrees about the joint's axis"
    unhooked = "cables off, motor and joint each turned slowly over the whole range"
    whole = "joint free, slow triangle over the whole range"
    against = free(give * ladder)
    off: dict[str, Any] = {"pretension": 0.0}
    found = [
        play(
            "joint free, triangles at five speeds from 2 % to 100 % of the fastest",
            ladder,
        ),
        play("joint free, chirp from 0.1 to 3 Hz", chirp),
        play("joint free, moves with rests of 1, 3, 8 and 22 s", dwell),
        hold(
            "slow triangles of the motor a few times its wind-up",
            triangle(locked, wind),
        ),
        hold("small reversals of the motor within its wind-up", small),
        play(
            "motor locked, joint moved slowly to and fro by hand",
            still,
            triangle(locked * ratio, wind),
        ),
        play(f"{whole}, pretension halved", sweep, pretension=0.5),
        *(
            play(
                f"joint free, slow triangle over {words} the range, if the rig allows",
                triangle(times * swing, rate * 0.2),
                usual=False,
                hard=times > 2.0,
            )
            for words, times in (("twice", 2.0), ("four times", 4.0))
        ),
        play(
            f"{whole}, {turned} (`tilt = {QUARTER_TURN:.3f}`), if it allows",
            sweep,
            tilt=QUARTER_TURN,
            standard=True,
        ),
        play(unhooked, sweep, **off, standard=True),
        play(f"{unhooked}, {turned}", sweep, **off, tilt=QUARTER_TURN, usual=False),
        hold("slow triangles, pretension halved", triangle(reversal, wind), 0.5),
        play("joint against a spring, triangles at five speeds", ladder, against),
        play(
            "joint against a spring, chirp from 0.1 to 3 Hz", chirp, free(give * chirp)
        ),
    ]
    force = Limit.weight_share * cable.pretension
    sensors = ("torque sensor", "motor current"), ("torque sensor",)
    radii = bench.motor_radius, bench.joint_radius
    able = [kind in own for kind, own in zip(instruments, sensors, strict=True)]
    sizes = [force * r if there else 0.0 for r, there in zip(radii, able, strict=True)]
    weights = tuple(float(f"{size:.2g}") for size in sizes)
    if any(weights):
        pairs = zip(("motor", "joint"), weights, strict=True)
        sides = list_words(f"{s:g} N m at the {side}" for side, s in pairs if s)
        words = (
            f"cables off, a known weight hung in place of the cable ({sides}), motor "
            "and joint each turned slowly over the whole range"
        )
        found.append(play(words, sweep, **off, known_torques=weights, standard=True))
    if instruments == TORQUE_SENSORS:
        words = (
            "the two torque sensors exchanged (`swapped = true`), joint against a "
            "spring, triangles at five speeds"
        )
        found.append(play(words, ladder, against, swapped=True, usual=False))
    for instrument, end in zip(instruments, ("proximal", "distal"), strict=True):
        if instrument in ("torque sensor", "motor current"):
            cell = f"tension_{bench.names[0]}_{end}_n"  # in the agonist
            words = (
                f"a load cell in cable {bench.names[0]} at its {end} end (`{cell}`), "
                "joint against a spring, triangles at five speeds"
            )
            asked = cell in cells
            known: dict[str, Any] = {"load_cell": cell, "usual": asked}
            known |= {"standard": asked, "hard": True}
            found.append(play(words, ladder, against, **known))
    if instruments.joint != "torque sensor":  # which alone sees weights and springs
        hooked = [each for each in found if each.pretension]
        found = [replace(each, standard=each.load_cell in cells) for each in hooked]
    if len(bench.cables) == 1:  # which a free joint leaves slack
        for place, each in enumerate(found):
            torque = each.pretension * cable.pretension * bench.joint_radius
            pulled = f"joint pulled against the cable by a weight of {torque:.2g} N m"
            words = each.description.replace("joint free", pulled)
            found[place] = replace(each, description=words)
    return found


def middle_angle(bench: Bench, swing: float) -> float:
    """Return the motor angle with equal room for the swing to both sides [rad]."""
    low, high = np.sort(bench.following(np.array(bench.span)))
    if high - low < 2.0 * swing:
        return 0.5 * float(low + high)
    middle = float(bench.following(np.array([bench.centre]))[0])
    return min(max(middle, float(low) + swing), float(high) - swing)


def trial_table(
    name: str, motion: CataloguedTrial, tension: float, occasion: str = ""
) -> list[str]:
    """Return the lines of a trial of pretension `tension` [N] in `dataset.toml`."""
    known = [f"pretension = {tension:g}"] if tension else []
    if occasion:
        known.append(f'occasion = "{occasion}"')
    notes = f'notes = "{motion.description}"'
    return [f'[trials."{name}"]', *known, *motion.toml, notes]


def write_motion(path: Path, motion: CataloguedTrial) -> None:
    time = MOTION_STEP * np.arange(motion.motor.size)
    table = np.column_stack([time, motion.motor, motion.joint])
    how: Any = {"fmt": ("%.3f", "%.6f", "%.6f"), "delimiter": ",", "newline": "\r\n"}
    names = "time_s,motor_angle_rad,joint_angle_rad"
    np.savetxt(path, table, header=names, comments="", **how)


def catalogue(problem: Problem) -> list[CataloguedTrial]:
    """Return motions within speed and range of the data, and two beyond the range."""
    plant = problem.plant
    swing = 0.5 * max(float(np.ptp(r.motor_angle)) for r in plant.records)
    speeds = (np.abs(np.gradient(r.motor_angle, r.dt)) for r in plant.records)
    rate = max(float(np.quantile(speed, 0.99)) for speed in speeds)
    return motions(plant.bench, swing, rate, instruments=plant.instruments)


class Rivals(NamedTuple):
    """Two effects that the data do not distinguish, and the models with either."""

    ids: tuple[str, str]  # of the effects
    before: CrossValidation  # the model without either
    models: tuple[CrossValidation, CrossValidation]  # with either
    confused: bool  # whether they are easily confused

    @property
    def fitted(self) -> list[tuple[Problem, FloatArray]]:
        """Both models, weighted by their own errors, with their fitted parameters."""
        found = []
        for model in self.models:
            masks = [record.free for record in model.problem.plant.records]
            found.append((model.problem.with_updated_floor(model.x, masks), model.x))
        return found


class Proposal(NamedTuple):
    experiment: NextExperiment
    motion: CataloguedTrial  # of the trial


def propose(
    found: Found, judged: Diagnosis
) -> tuple[Diagnosis, CataloguedTrial | None]:
    """Return the diagnosis with the trial that separates its first tie, if any."""
    if not found.ties:
        return judged, None
    tie = found.ties[0]
    if (best := best_trial(_tied_refits(found.search, tie))) is not None:
        return replace(judged, next_experiment=best.experiment), best.motion
    declared = {  # facts of `[rig]` that remove or bound an effect
        "joint_gravity": "balanced",
        "joint_stiffness": "joint_spring",
        "torque_sensor_gain": "gain_uncertainty",
        "torque_sensor_offset": "zeroed",
    }
    facts = [declared[name] for name in tie if name in declared]
    decide = "on such motions either gives the same torques"
    if facts:
        decide = f"declare what is known of them ([rig] {list_words(facts, 'or')})"
    none = " No trial of the catalogue that is not among these would separate them"
    return replace(judged, statement=f"{judged.statement}{none}: {decide}."), None


def _tied_refits(found: Search, tie: Sequence[str]) -> Rivals:
    """Return the first two effects of a tie, fitted on top of one model."""
    one, two = tie[:2]
    # The last round that has both; parts of the data may name others.
    before, models = found.before, {}
    for step in reversed(found.rounds):
        refitted = {c.id: c.crossed for c in step.candidates}
        if {one, two} <= refitted.keys():
            before, models = step.before, refitted
            break
        models |= refitted
    signs = {sign.id: sign for sign in found.signatures}
    confused = EFFECTS[one].confused(EFFECTS[two]) or (
        {one, two} <= signs.keys() and are_confusable(signs[one], signs[two])
    )
    return Rivals((one, two), before, (models[one], models[two]), confused)


def best_trial(rivals: Rivals) -> Proposal | None:
    """Return the trial that best distinguishes two rivals; None if none can.

    If one effect were true, the other would be fitted again, to old and new data: only
    the remaining difference beyond the form error of effects counts. A trial is
    proposed if the difference is significant, if the rule that found the tie would find
    none with it, and if the data have no such trial yet. If no trial settles the tie
    whichever effect is true, one that does if the better effect is true is proposed.
    """
    fitted = rivals.fitted
    problem = fitted[0][0]
    records, bench = problem.plant.records, problem.plant.bench
    noise = _row_medians(problem.noise)
    floor = _row_medians(rivals.before.problem.floor)  # of held-out errors
    masks = [[record.free for record in other.plant.records] for other, _ in fitted]
    known = [fitting.jacobian(*f, m) for f, m in zip(fitted, masks, strict=True)]
    weight = min(other.weight for other, _ in fitted)
    best: tuple[tuple[bool, bool, float], Proposal] | None = None
    trial = next_trial_name(records)
    better, worse = np.argsort([model.held_out_mse for model in rivals.models])
    every = catalogue(problem)
    done = recorded(every, bench, records)
    for motion in every:
        if motion.description in done:
            continue
        record = as_record(problem, motion)
        shown, without = [], []
        for (other, x), name in zip(fitted, rivals.ids, strict=True):
            plant = other.plant.limited([record])
            shown += replace(other, plant=plant).torques(x)
            rest = [each for each in other.effects if each != name]
            without += plant.simulate(other.values(x), rest)
        difference = (shown[0] - shown[1]) / noise
        played = [replace(record, measured=torque) for torque in shown]
        pairs = zip(fitted, played, known, strict=True)
        lefts = [refit_difference(*f, r, noise, old, difference) for f, r, old in pairs]
        left = min(lefts, key=np.linalg.norm)
        unsure = np.hypot(1.0, form_error(shown, without, noise))
        score = weight * float(np.linalg.norm(left / unsure))
        if score < Limit.decisive_sigmas:
            continue
        # If one is true, the error of the other one, fitted again, remains.
        share = noise / floor
        made = [(s - w) / floor for s, w in zip(shown, without, strict=True)]
        settles = [
            separates_rivals(rivals, record, true, made[true], share * lefts[1 - true])
            for true in (0, 1)
        ]
        rank = settles[worse], not motion.hard, score
        if settles[better] and (best is None or rank > best[0]):
            description = _describe_difference(problem, rivals.ids, shown, left, noise)
            if not settles[worse]:
                names = [effect_name(rivals.ids[each]) for each in (better, worse)]
                description += (
                    f"; it settles the tie if it is {names[0]}, which fits better now, "
                    f"and need not if it is {names[1]}"
                )
            tension = record.pretension or 0.0
            facts = tuple(trial_table(trial, motion, tension, record.occasion))
            experiment = NextExperiment(
                motion.description, rivals.ids, description, trial, facts
            )
            best = rank, Proposal(experiment, motion)
    return best[1] if best else None


def next_trial_name(records: Sequence[Record]) -> str:
    """Return a name that no trial has on any occasion."""
    taken = {record.trial.rsplit("/", 1)[-1] for record in records}
    names = (f"trial_{k:02d}" for k in itertools.count(1))
    return next(name for name in names if name not in taken)


def _describe_difference(
    problem: Problem,
    ids: tuple[str, str],
    shown: Arrays,
    left: FloatArray,
    noise: FloatArray,
) -> str:
    sizes = np.sqrt(np.mean(left**2, axis=1))
    row = int(np.argmax(sizes))
    most = int(np.argmax(np.abs(left[row])))
    channel = problem.plant.instruments.channels[row]
    return (
        f"{channel} differs by {sizes[row] * noise[row, 0]:.3g} N m RMS even when all "
        f"else is tuned, {format_number(sizes[row])} times the noise; at "
        f"{most * MOTION_STEP:.1f} s {effect_name(ids[0])} gives "
        f"{shown[0][row, most]:.3g} N m and {effect_name(ids[1])} "
        f"{shown[1][row, most]:.3g} N m"
    )


def recorded(
    every: Sequence[CataloguedTrial], bench: Bench, records: Sequence[Record]
) -> set[str]:
    """Return the descriptions of those motions of `every` that the data contain.

    A trial contains a motion if its notes name it, or if it has the same facts and
    travel, begun at any time. With the cables off, half the travel of the joint is
    enough. Of several motions it is the one whose lag of the joint is most similar.
    """
    known = [r.pretension for r in records if r.pretension]
    usual = float(np.median(known)) if known else 1.0
    spans = [bench.carried(motion.motor) - motion.joint for motion in every]
    words = [motion.description for motion in every]
    lags = {w: float(np.ptp(span)) for w, span in zip(words, spans, strict=True)}
    found = set()
    for record in records:
        if record.notes in lags:
            found.add(record.notes)  # as proposed or planned, however well followed
            continue
        tension = usual if record.pretension is None else record.pretension
        own = float(np.ptp(bench.carried(record.motor_angle) - record.joint_angle))
        ratio = tension / usual
        able = [each for each in every if _matches_motion(each, bench, record, ratio)]
        matching = [each.description for each in able]
        if matching:
            found.add(min(matching, key=lambda each: abs(lags[each] - own)))
    return found


def _matches_motion(
    motion: CataloguedTrial, bench: Bench, record: Record, pretension: float
) -> bool:
    # Pretension within 10 %, tilt within 0.1 rad, spans within a fifth
    if abs(pretension - motion.pretension) > 0.1 * motion.pretension:
        return False
    if abs(record.tilt - motion.tilt) > 0.1 or record.swapped != motion.swapped:
        return False
    if record.load_cell != motion.cell_on(bench, record.pretension):
        return False
    if [*map(bool, record.known_torques)] != [*map(bool, motion.known_torques)]:
        return False
    pairs = (record.motor_angle, motion.motor), (record.joint_angle, motion.joint)
    spans = [(float(np.ptp(there)), float(np.ptp(here))) for there, here in pairs]
    if motion.pretension == 0.0:  # moved by hand
        return spans[1][0] > 0.5 * spans[1][1]
    largest = max(max(pair) for pair in spans)
    if any(abs(a - b) > 0.2 * max(a, b) + 0.02 * largest for a, b in spans):
        return False
    known = record.dt * np.arange(record.motor_angle.size)
    there = np.interp(np.arange(0.0, known[-1], MOTION_STEP), known, record.motor_angle)
    there = there - there.mean()
    motor = motion.motor - motion.motor.mean()
    size = there.size + motor.size
    product = np.fft.rfft(there, size) * np.conj(np.fft.rfft(motor, size))
    most = float(np.max(np.fft.irfft(product, size)))
    norm = float(np.linalg.norm(there) * np.linalg.norm(motor))
    return norm == 0.0 or most > Limit.min_motion_correlation * norm


def separates_rivals(
    rivals: Rivals, record: Record, true: int, made: FloatArray, left: FloatArray
) -> bool:
    """Return whether one more trial would end the tie of two effects.

    `true` is the index of the true effect, `made` (rows, samples) its change of torque
    over the floor, `left` (rows, samples) the error of the other one, fitted again.
    """
    model, other = rivals.models[true], rivals.models[1 - true]
    names = rivals.ids[true], rivals.ids[1 - true]
    before = _with_trial(rivals.before, record, made)
    better = _with_trial(model, record, np.zeros_like(left))
    worse = _with_trial(other, record, left)
    return not tie_reason(before, better, worse, names, rivals.confused)


def _with_trial(
    crossed: CrossValidation, record: Record, error: FloatArray
) -> CrossValidation:
    """Return a cross-validation with one trial more, of this error (rows, samples)."""
    problem = crossed.problem
    base = problem.plant.records[0]
    times = max(1, round(record.dt / base.dt))
    size = times * record.time.size
    both = map(_row_medians, (problem.floor, problem.noise))
    floor, noise = (np.repeat(each, size, axis=1) for each in both)
    more = replace(record, dt=base.dt, group=record.trial)
    plant = problem.plant.limited([*problem.plant.records, more])
    floors, noises = (*problem.floor, floor), (*problem.noise, noise)
    wider = replace(problem, plant=plant, floor=floors, noise=noises)
    wider = replace(wider, slopes=TorqueDerivatives())
    wide = fitting.huber_residual(np.repeat(error, times, axis=1))
    off = np.hypot(wide, noise / floor)
    return crossed._replace(problem=wider, errors=(*crossed.errors, off))


def _row_medians(each: Arrays) -> FloatArray:
    return np.median(np.concatenate(each, axis=1), axis=1)[:, None]


def form_error(shown: Arrays, without: Arrays, noise: FloatArray) -> FloatArray:
    """Return the form error of an effect, relative to the noise (rows, 1).

    `shown` are the torques of a trial (rows, samples) by each of two models, `without`
    those without the effect, `noise` (rows, 1) that of the torques [N m].
    """
    pairs = zip(shown, without, strict=True)
    parts = [(torque - rest) / noise for torque, rest in pairs]
    sizes = [np.mean(part**2, axis=1, keepdims=True) for part in parts]
    return np.asarray(np.sqrt(Limit.form_error_share * np.min(sizes, axis=0)))


def motion_record(
    motion: CataloguedTrial, bench: Bench, rows: int, tension: float
) -> Record:
    """Return a motion as a record of `rows` torques, all 0, at a `tension` [N]."""
    size = min(motion.motor.size, motion.joint.size)
    angles = np.array([motion.motor[:size], motion.joint[:size]])
    pretension = tension * motion.pretension
    return Record(
        trial=motion.description,
        dt=MOTION_STEP,
        step=MOTION_STEP,
        time=MOTION_STEP * np.arange(size, dtype=np.float64),
        motor_angle=angles[0],
        joint_angle=angles[1],
        read=angles,
        measured=np.zeros((rows, size)),
        band=Limit.max_band,
        counts=np.ones(size, dtype=bool),
        pretension=pretension,
        start=0.0,
        split=None,
        group=motion.description,
        tilt=motion.tilt,
        known_torques=motion.known_torques,
        swapped=motion.swapped,
        load_cell=motion.cell_on(bench, pretension),
    )


def as_record(problem: Problem, motion: CataloguedTrial) -> Record:
    """Return a motion as a record on the last occasion of the data."""
    records, bench = problem.plant.records, problem.plant.bench
    last = problem.plant.occasions[-1]  # on which it is recorded
    records = tuple(each for each in records if each.occasion == last)
    base = next((each for each in records if not each.unhooked), records[0])
    tension = base.pretension
    if tension is None:
        tension = bench.cables[0].pretension
    found = motion_record(motion, bench, len(base.measured), tension)
    size = found.time.size
    columns = {name: np.full(size, np.mean(own)) for name, own in base.columns.items()}
    kept = ("step", "band", "split", "group", "occasion", "conditions")
    known = {name: getattr(base, name) for name in kept}
    return replace(found, trial="next", columns=columns, **known)


def refit_difference(
    problem: Problem,
    x: FloatArray,
    record: Record,
    noise: FloatArray,
    known: FloatArray,
    difference: FloatArray,
) -> FloatArray:
    """Return the difference (2, samples) that is left after a refit within bounds.

    `record` is the new trial as predicted, `noise` (2, 1) that of its torques [N m],
    `known` (residuals, parameters) the Jacobian on present data and priors.
    `difference` (2, samples) is relative to the noise.
    """
    from scipy.optimize import lsq_linear

    wide = (np.broadcast_to(noise, difference.shape),)
    plant, unknown = problem.plant.limited([record]), TorqueDerivatives()
    new = replace(problem, plant=plant, noise=wide, floor=wide, slopes=unknown)
    every = [np.ones(record.counts.size, dtype=bool)]
    slopes = fitting.jacobian(new, x, every)[: difference.size]
    wanted = np.concatenate([problem.weight * difference.ravel(), np.zeros(len(known))])
    low, high = (
        np.array([getattr(p, k) for p in problem.tuned]) for k in ("low", "high")
    )
    moves = np.flatnonzero(high > low)
    table = np.concatenate([slopes, known])[:, moves]
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    axes, short = np.linalg.qr(table / size)
    least, most = np.minimum(low - x, 0.0)[moves], np.maximum(high - x, 0.0)[moves]
    bounds = (least - 1e-9) * size, (most + 1e-9) * size
    change = np.zeros(x.size)
    change[moves] = lsq_linear(short, axes.T @ wanted, bounds).x / size
    return difference - (slopes @ change).reshape(difference.shape) / problem.weight
