"""Catalogue of trials that most rigs can run, and the one that separates two rivals."""

import itertools
import math
import re
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
from cc_mujoco.diagnosis._phrases import NO_TRIAL, effect_name, format_number
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


class TrialSettings(NamedTuple):
    """Continuous settings of a trial; those that a kind of trial has."""

    seconds: float = 40.0  # duration [s]
    size: float = 1.0  # travel over the largest
    speed: float = 1.0  # over the usual one of its kind, at most up to the largest
    load: float = 1.0  # springs, weights and locked joints, over the largest
    tension: float = 0.5  # pretension over that of the data, where it is lower
    tilt: float = 0.5 * np.pi  # angle by which the rig is turned, where it is [rad]


LEAST = TrialSettings(8.0, 0.2, 0.2, 0.2, 0.3, 0.1)
MOST = TrialSettings(40.0, 1.0, 5.0, 1.0, 0.9, 0.5 * np.pi)
USUAL = TrialSettings()


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
    settings: TrialSettings = USUAL,
) -> list[CataloguedTrial]:
    """Return the trials of the catalogue within these limits, one beyond `swing`.

    They move about `middle_angle` by at most `swing` to either side [rad], at most at
    `rate` [rad/s], against a known `load` if any [N m/rad]. Each of the `cells`,
    channels of load cells in single cables, adds its own trials. With other `settings`
    they are the same, in the same order.
    """
    from scipy.ndimage import gaussian_filter1d

    ratio = bench.motor_radius / bench.joint_radius
    wind = wind_up_angle(bench)
    seconds, size, speed, strain, tension, tilt = settings
    motor_middle, room = middle_angle(bench, swing), half_range(bench)
    beyond = size * min(4.0 * swing, max(swing, room))
    span = f"{100.0 * size:.0f} % of the range"
    farther = f"{beyond / swing:.2g} times the range"
    swing, fast = swing * size, rate * min(speed, 1.0)
    (joint_middle,) = bench.carried(np.array([motor_middle]))

    def free(motor: FloatArray) -> FloatArray:
        return np.asarray(bench.carried(motor_middle + motor) - joint_middle)

    time = np.arange(0.0, seconds, MOTION_STEP)

    def triangle(reach: float, slope: float | FloatArray) -> FloatArray:
        slope = np.minimum(speed * np.broadcast_to(slope, time.shape), rate)
        phase = np.cumsum(slope) * MOTION_STEP / (4.0 * reach)
        wave = reach * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5))
        # No motor turns in an instant.
        width = 0.03 / MOTION_STEP
        return np.asarray(gaussian_filter1d(wave, width, mode="nearest"))

    shares = 0.02, 0.06, 0.2, 0.5, 1.0  # of the greatest speed, one after another
    steps = np.repeat(shares, math.ceil(time.size / len(shares)))[: time.size]
    ladder = triangle(swing, rate * steps)
    # From 0.1 Hz on evenly to 3.3 Hz at the end, where its speed is `fast`
    loudness = min(0.3 * swing, fast / (2.0 * np.pi * 3.3))
    chirp = loudness * np.sin(2.0 * np.pi * (0.1 + 1.6 / seconds * time) * time)
    cable = bench.cables[0]
    # This nearly loosens one cable and tightens the other as much.
    taut = 0.8 * strain * cable.pretension
    stretch = taut / cable.axial_stiffness * cable.length
    taut_angle = stretch / bench.motor_radius
    give = max(1.0 - stretch / (ratio * swing * bench.joint_radius), 0.0)
    sweep = triangle(swing, rate * 0.2)
    move = max(1.0, swing / fast)  # In a short trial only the rests are shorter.
    rests = np.array([1, 3, 8, 22]) * max(seconds - 5.0 * move - 1.0, 0.0) / 34.0
    corners = np.cumsum([0.0, *np.insert(rests, range(4), move), move])
    dwell = swing * np.interp(time, corners, [0, 1, 1, 0, 0, 1, 1, 0, 0, 1])
    rested = f"rests of {list_words(f'{rest:.2g}' for rest in rests)} s"
    slack = f"pretension at {100.0 * tension:.0f} %"
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
                (f"moves with {rested}", dwell, 1.0),
                ("small reversals within the wind-up of the cable", small, 1.0),
                (f"slow triangle over {span}, {slack}", sweep, tension),
            )
        ]

    turn = f"{math.degrees(tilt):.0f} degrees"
    turned = f"the rig turned by {turn} about the joint's axis"
    unhooked = f"cables off, motor and joint each turned slowly over {span}"
    whole = f"joint free, slow triangle over {span}"
    against = free(give * ladder)
    off: dict[str, Any] = {"pretension": 0.0}
    found = [
        play(
            "joint free, triangles at five speeds from 2 % to 100 % of the fastest",
            ladder,
        ),
        play("joint free, chirp from 0.1 to 3 Hz", chirp),
        play(f"joint free, moves with {rested}", dwell),
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
        play(f"{whole}, {slack}", sweep, pretension=tension),
        play(
            f"joint free, slow triangle over {farther}, if the rig allows",
            triangle(beyond, rate * 0.2),
            usual=False,
            hard=True,
        ),
        play(
            f"{whole}, {turned} (`tilt = {tilt:.3f}`), if it allows",
            sweep,
            tilt=tilt,
            standard=True,
        ),
        play(unhooked, sweep, **off, standard=True),
        play(f"{unhooked}, {turned}", sweep, **off, tilt=tilt, usual=False),
        hold(f"slow triangles, {slack}", triangle(reversal, wind), tension),
        play("joint against a spring, triangles at five speeds", ladder, against),
        play(
            "joint against a spring, chirp from 0.1 to 3 Hz", chirp, free(give * chirp)
        ),
    ]
    force = strain * Limit.weight_share * cable.pretension
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
            f"and joint each turned slowly over {span}"
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


def half_range(bench: Bench) -> float:
    """Return the angle of the motor that moves the joint over half its range [rad]."""
    return 0.5 * float(np.ptp(bench.following(np.array(bench.span))))


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
    known += [f'occasion = "{occasion}"'] if occasion else []
    known += [*motion.toml, f'notes = "{motion.description}"']
    return [f'[trials."{name}"]', *known]


def write_motion(path: Path, motion: CataloguedTrial) -> None:
    time = MOTION_STEP * np.arange(motion.motor.size)
    table = np.column_stack([time, motion.motor, motion.joint])
    how: Any = {"fmt": ("%.3f", "%.6f", "%.6f"), "delimiter": ",", "newline": "\r\n"}
    names = "time_s,motor_angle_rad,joint_angle_rad"
    np.savetxt(path, table, header=names, comments="", **how)


class Rivals(NamedTuple):
    """Two effects that the data do not distinguish, and the models with either."""

    ids: tuple[str, str]  # of the effects
    before: CrossValidation  # the model without either
    models: tuple[CrossValidation, CrossValidation]  # with either
    confused: bool  # whether they are easily confused


def propose(
    found: Found, judged: Diagnosis
) -> tuple[Diagnosis, tuple[CataloguedTrial, ...]]:
    """Return the diagnosis with the trials that separate its first tie, if any do."""
    tie = found.ties[0]
    comparison = Comparison(_tied_refits(found.search, tie))
    if (best := designed(comparison)) is not None:
        return replace(judged, next_experiment=comparison.next(best)), best.motions
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
    none = f"{NO_TRIAL} would separate them, nor the standard trials together"
    return replace(judged, statement=f"{judged.statement} {none}: {decide}."), ()


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


class Expected(NamedTuple):
    """Separation of two rivals that is expected of trials not recorded yet."""

    motions: tuple[CataloguedTrial, ...]
    shown: Arrays  # torques in all of them, one after another, by either model [N m]
    left: FloatArray  # difference that no tuning removes, over the noise; 0 in a run-in
    score: float  # the same over noise and form, in standard deviations
    # Whether the tie ends if the better or the worse is true, as expected; and if only
    # a share of the difference shows
    settles: tuple[bool, ...]

    @property
    def rank(self) -> tuple[float, ...]:
        """Preference: by what settles the tie, then squared separation per second."""
        hard = any(motion.hard for motion in self.motions)
        better, worse, *sure = self.settles
        rate = self.score**2 / (MOTION_STEP * self.left.shape[1])
        return better, worse, not hard, *sure, rate


class Comparison:
    """Two rivals, and the limits of the data within which trials are designed."""

    def __init__(self, rivals: Rivals) -> None:
        self.rivals, models = rivals, rivals.models
        masks = [[r.free for r in model.problem.plant.records] for model in models]
        pairs = [*zip(models, masks, strict=True)]
        # Weighted by their own errors; without an effect they would inflate the floor
        self.fitted = [
            (m.problem.with_updated_floor(m.x, own), m.x) for m, own in pairs
        ]
        self.problem = self.fitted[0][0]
        self.noise = _row_medians(self.problem.noise)
        self._floor = _row_medians(rivals.before.problem.floor)  # of held-out errors
        both = zip(self.fitted, masks, strict=True)
        self._known = [fitting.jacobian(*model, mask) for model, mask in both]
        self._weight = min(other.weight for other, _ in self.fitted)
        # Index of the model that fits better, and of the other one
        self._order = np.argsort([model.held_out_mse for model in models])

    def trials(self, settings: TrialSettings = USUAL) -> list[CataloguedTrial]:
        """Return the trials of every kind within speed and range of the data."""
        plant = self.problem.plant
        swing = 0.5 * max(float(np.ptp(r.motor_angle)) for r in plant.records)
        speeds = (np.abs(np.gradient(r.motor_angle, r.dt)) for r in plant.records)
        rate = max(float(np.quantile(speed, 0.99)) for speed in speeds)
        return motions(
            plant.bench, swing, rate, instruments=plant.instruments, settings=settings
        )

    def expected(self, *trials: CataloguedTrial, least: float = 0.0) -> Expected | None:
        """Return the separation that trials promise, None if too small.

        If one effect were true, the other would be refitted to old and new data; only
        the rest beyond the form error of effects counts. Its square per second must
        reach `least`.
        """
        records = [as_record(self.problem, motion) for motion in trials]
        counts = np.concatenate([record.counts for record in records])
        if not counts.any():
            return None
        shown, without, played = [], [], []
        for (other, x), name in zip(self.fitted, self.rivals.ids, strict=True):
            plant = other.plant.limited(records)
            played.append(replace(other, plant=plant).torques(x))
            shown.append(np.concatenate(played[-1], axis=1) * counts)
            rest = [each for each in other.effects if each != name]
            bare = plant.simulate(other.values(x), rest)
            without.append(np.concatenate(bare, axis=1) * counts)
        off = (shown[1] - shown[0]) / self.noise
        pairs = zip(shown, without, strict=True)
        parts = [(torque - rest)[:, counts] / self.noise for torque, rest in pairs]
        sizes = [np.mean(part**2, axis=1, keepdims=True) for part in parts]
        # Noise, and the form error of the effect that shows less
        unsure = np.sqrt(1.0 + Limit.form_error_share * np.min(sizes, axis=0))
        least = max(Limit.decisive_sigmas, math.sqrt(least * MOTION_STEP * counts.size))
        score = self._weight * float(np.linalg.norm(off / unsure))
        if score < least:  # refits only make it less
            return None
        refits = zip(self.fitted, played, (off, -off), self._known, strict=True)
        lefts = [
            refit_difference(*model, records, torques, self.noise, known, each)
            for model, torques, each, known in refits
        ]
        left = min(lefts, key=np.linalg.norm)
        score = self._weight * float(np.linalg.norm(left / unsure))
        if score < least:
            return None
        ids, before, models, confused = self.rivals
        settles: list[bool] = []
        for share, true in itertools.product((1.0, Limit.sure_share), self._order):
            # If one is true, the error of the other one, fitted again, remains.
            made = (shown[true] - without[true]) / self._floor
            wrong = share * self.noise / self._floor * lefts[1 - true]
            none = _with_record(before, records[0], made)
            right = _with_record(models[true], records[0], 0.0 * made)
            rival = _with_record(models[1 - true], records[0], wrong)
            names = ids[true], ids[1 - true]
            settles.append(not tie_reason(none, right, rival, names, confused))
        return Expected(trials, shown, left, score, tuple(settles))

    def next(self, best: Expected) -> NextExperiment:
        """Return the description of the trials with the expected separation."""
        ids, records = self.rivals.ids, self.problem.plant.records
        sizes = np.sqrt(np.mean(best.left**2, axis=1))
        row = int(np.argmax(sizes))
        most = int(np.argmax(np.abs(best.left[row])))
        one, two = (torque[row, most] for torque in best.shown)
        difference = (
            f"in {MOTION_STEP * best.left.shape[1]:.0f} s "
            f"{self.problem.plant.instruments.channels[row]} differs by "
            f"{sizes[row] * self.noise[row, 0]:.3g} N m RMS even when all "
            f"else is tuned, {format_number(sizes[row])} times the noise; at "
            f"{MOTION_STEP * most:.1f} s {effect_name(ids[0])} gives "
            f"{one:.3g} N m and {effect_name(ids[1])} {two:.3g} N m"
        )
        if not best.settles[1]:
            better, worse = (effect_name(ids[each]) for each in self._order)
            difference += (
                f"; it settles the tie if it is {better}, which fits better now, "
                f"and need not if it is {worse}"
            )
        names, facts = next_trial_names(records, len(best.motions)), list[str]()
        for name, motion in zip(names, best.motions, strict=True):
            new = as_record(self.problem, motion)
            facts += trial_table(name, motion, new.pretension or 0.0, new.occasion)
        words = "; ".join(motion.description for motion in best.motions)
        if len(names) > 1:
            words = f"no single trial separates them, these {len(names)} do: {words}"
        return NextExperiment(words, ids, difference, names, tuple(facts))


def designed(comparison: Comparison) -> Expected | None:
    """Return the trial that separates two rivals most for its duration, if any.

    Every kind of trial that the data do not have yet is tried with its usual settings,
    and those of the best ones are searched. If no trial settles the tie whichever
    effect is true, one that does if the better effect is true is taken, or else the
    standard trials together.
    """
    every = comparison.trials()
    noted = {kind_of(r.notes) for r in comparison.problem.plant.records}
    new = [k for k, m in enumerate(every) if kind_of(m.description) not in noted]
    tried = [(k, comparison.expected(every[k])) for k in new]
    able = [(k, usual) for k, usual in tried if usual is not None]
    able.sort(key=lambda each: each[1].rank, reverse=True)
    found: list[Expected] = []
    for kind, usual in able[: Limit.searched_trials]:
        found.append(_searched(comparison, kind, usual))
        if all(found[-1].settles):
            break
    best = max(found, key=lambda each: each.rank, default=None)
    standard = [every[k] for k in new if every[k].standard]
    if standard and (best is None or not best.settles[0]):
        best = comparison.expected(*standard)
    return best if best is not None and best.settles[0] else None


def _searched(comparison: Comparison, kind: int, usual: Expected) -> Expected:
    """Return the trial of one kind with the best settings, by a pattern search.

    (Hooke, Jeeves, Journal of the ACM 8, 1961.)
    """
    best, place = usual, USUAL
    steps = [each for step in Limit.setting_steps for each in (1.0 / step, step)]
    for step, name in itertools.product(steps, TrialSettings._fields):
        bounds = getattr(LEAST, name), getattr(MOST, name)
        value = float(np.clip(step * getattr(place, name), *bounds))
        new = place._replace(**{name: value})
        motion, (before,) = comparison.trials(new)[kind], best.motions
        facts = [(m.toml, m.pretension) for m in (motion, before)]
        angles = (motion.motor, before.motor), (motion.joint, before.joint)
        if facts[0] == facts[1] and all(np.array_equal(*pair) for pair in angles):
            continue  # no setting of this kind
        least = Limit.min_gain * best.rank[-1] if all(best.settles) else 0.0
        expected = comparison.expected(motion, least=least)
        if expected is not None and expected.rank > best.rank:
            best, place = expected, new
    return best


def kind_of(words: str) -> str:
    """Return the description of a trial without the numbers of its settings."""
    return re.sub(r"[0-9.]+", "", words)


def next_trial_names(records: Sequence[Record], count: int = 1) -> tuple[str, ...]:
    """Return the first `trial_NN` that no trial is on any occasion."""
    taken = {record.trial.rsplit("/", 1)[-1] for record in records}
    names = (f"trial_{k:02d}" for k in itertools.count(1))
    return tuple(itertools.islice((n for n in names if n not in taken), count))


def _with_record(
    crossed: CrossValidation, record: Record, error: FloatArray
) -> CrossValidation:
    """Return a cross-validation with one record more, of this error (rows, samples)."""
    problem = crossed.problem
    base = problem.plant.records[0]
    error = np.repeat(error, max(1, round(record.dt / base.dt)), axis=1)
    both = map(_row_medians, (problem.floor, problem.noise))
    floor, noise = (np.repeat(each, error.shape[1], axis=1) for each in both)
    more = replace(record, dt=base.dt, group=record.trial)
    plant = problem.plant.limited([*problem.plant.records, more])
    floors, noises = (*problem.floor, floor), (*problem.noise, noise)
    wider = replace(problem, plant=plant, floor=floors, noise=noises)
    off = np.hypot(fitting.huber_residual(error), noise / floor)
    return crossed._replace(problem=wider, errors=(*crossed.errors, off))


def _row_medians(each: Arrays) -> FloatArray:
    return np.median(np.concatenate(each, axis=1), axis=1)[:, None]


def motion_record(
    motion: CataloguedTrial, bench: Bench, rows: int, tension: float
) -> Record:
    """Return a motion as a record of `rows` torques, 0; `tension` [N] is nominal."""
    size, cell = motion.motor.size, motion.load_cell
    angles = np.array([motion.motor, motion.joint])
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
        load_cell=SingleCell.of(cell, bench, pretension) if cell else None,
    )


def as_record(problem: Problem, motion: CataloguedTrial) -> Record:
    """Return a motion as a record on the last occasion of the data, with a run-in."""
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
    travel = np.cumsum(np.abs(np.diff(motion.motor, prepend=motion.motor[0])))
    run_in = Limit.run_in_travel * wind_up_angle(bench) if motion.pretension else 0.0
    known |= {"trial": "next", "columns": columns, "counts": travel >= run_in}
    return replace(found, **known)


def refit_difference(
    problem: Problem, x: FloatArray, records: Sequence[Record], torques: Arrays,
    noise: FloatArray, known: FloatArray, difference: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the difference (rows, samples) that is left after a refit within bounds.

    `records` are new trials, `torques` those that the model predicts, `noise` (rows, 1)
    theirs [N m], `known` (residuals, parameters) the Jacobian on present data and
    priors. The `difference` of the truth from the model is relative to the noise.
    """
    from scipy.optimize import lsq_linear

    new = replace(problem, plant=problem.plant.limited(records))
    slopes = TorqueDerivatives().of(new, x, range(len(records)), torques)
    counts = np.concatenate([record.counts for record in records])
    changes = (np.concatenate(slopes, axis=2) * counts / noise).reshape(x.size, -1).T
    low, high = (
        np.array([getattr(p, k) for p in problem.tuned]) for k in ("low", "high")
    )
    moves = np.flatnonzero(high > low)
    table = np.concatenate([problem.weight * changes, known])[:, moves]
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    axes, short = np.linalg.qr(table / size)
    least, most = np.minimum(low - x, 0.0)[moves], np.maximum(high - x, 0.0)[moves]
    bounds = (least - 1e-9) * size, (most + 1e-9) * size
    wanted = axes[: difference.size].T @ (problem.weight * difference.ravel())
    change = np.zeros(x.size)
    change[moves] = lsq_linear(short, wanted, bounds).x / size
    return np.asarray(difference - (changes @ change).reshape(difference.shape))
