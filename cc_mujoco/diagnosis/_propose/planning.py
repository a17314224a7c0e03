"""Choose trials before there are any data: all effects testable, none tied.

The catalogue's motions are simulated with the scene as it is, and with each effect at a
size that is plausible on the rig, see `plausibility`. What an effect changes, less what
tuning can do, adds up over trials (in the normal equations), so every set of trials is
judged without another simulation.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._instruments import TORQUE_SENSORS, Instruments
from cc_mujoco.datasets._trials import Constant, Noise
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.jacobian import jacobian
from cc_mujoco.diagnosis._fit.plausibility import plausible_size
from cc_mujoco.diagnosis._propose.identifiability import MIN_CLARITY
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig, baseline_parameters
from cc_mujoco.diagnosis._rig.load_trials import load_values
from cc_mujoco.diagnosis._rig.lowpass import MAX_BAND
from cc_mujoco.diagnosis._rig.motions import MOTION_STEP, CataloguedTrial, motions
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._search.screening import effect_amplitudes, screen
from cc_mujoco.diagnosis.effects import EffectParameter, usual_effects
from cc_mujoco.native import FloatArray

PLAN_SEGMENTS = 16
DEFAULT_TORQUE_NOISE = 0.005
"""Standard deviation of a torque's noise where none is declared, over its RMS."""
DEFAULT_ANGLE_NOISE = 1e-4
"""Standard deviation of an angle's noise where none is declared [rad]."""
SATURATED_CLARITY = 10.0 * MIN_CLARITY
"""Clarity from which more is of no further use; noise is not all that is in the way."""


MAX_SLACK = 0.05
"""Share of a trial in which a lone cable may be slack: nothing is transmitted there."""


class Resolved(NamedTuple):
    """Information that a set of trials gives about one effect.

    Attributes:
        id: of the effect.
        plausible: size of its first amplitude that is plausible on the rig, in its
            unit.
        clarity: of plausible sizes, in standard deviations once all is tuned.
        likest: the effect with which it is confused most, "nothing" without others.
        separation: clarity of a plausible size where that one is fitted as well.
    """

    id: str
    plausible: float
    clarity: float
    likest: str
    separation: float

    @property
    def least(self) -> float:
        """Size of the first amplitude that would just show, in its unit."""
        return MIN_CLARITY * self.plausible / max(self.clarity, 1e-12)


class _Column(NamedTuple):
    """Source of a column of changes.

    Attributes:
        effect: id; empty for a parameter of the baseline.
        size: of the effect's amplitude that makes the change.
    """

    effect: str
    size: float


@dataclass(frozen=True)
class TrialPlan:
    """Trials to record and what they would resolve.

    Attributes:
        trials: in the order of what they add.
        resolved: by the trials together, the least certain effect first.
        noise: standard deviation that was taken, by the torque that is compared [N m].
        hidden: effects that these instruments cannot show, and why.
        declared: facts that remove an effect or bound it.
        sizes: the first amplitude of every effect.
        slack: share of the samples of each trial in which a cable is slack.
    """

    trials: tuple[CataloguedTrial, ...]
    resolved: tuple[Resolved, ...]
    noise: Mapping[str, float]
    hidden: Mapping[str, str]
    declared: Mapping[str, str]
    sizes: Mapping[str, EffectParameter]
    slack: tuple[float, ...]


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
    """Return the smallest set of trials that leaves no effect untestable or tied.

    It has the standard trials, and those with the cables off last: hooking them up
    again changes the pretension.

    Args:
        bench: the rig as the scene has it.
        swing: largest angle of the motor to either side [rad].
        rate: largest speed of the motor [rad/s].
        constants: what is known of the rig.
        noise: of the channels where it is known.
        ids: effects to consider; default all.
        instruments: what the torques are to be known from.
        cells: channels of load cells in single cables that the rig has.
    """
    load = None
    if instruments.joint == "known load":
        load = load_values(constants).get("load_stiffness", 0.0)
    every = [
        motion
        for motion in motions(bench, swing, rate, load, instruments, cells)
        if motion.usual
    ]
    rows = len(instruments.rows)
    records = tuple(_record(motion, bench, rows) for motion in every)
    plant = SimulatedRig(bench, records, PLAN_SEGMENTS, 1, instruments, constants)
    records = _simulated_records(plant)
    slack = [plant.slack_share({}, (), k) for k in range(len(records))]
    if len(bench.cables) == 1:  # of a pair the other cable pulls
        kept = [k for k, share in enumerate(slack) if share <= MAX_SLACK]
        every, slack = [every[k] for k in kept], [slack[k] for k in kept]
        records = tuple(records[k] for k in kept)
    plant = plant.limited(records)
    free = baseline_parameters(bench, records, constants, instruments)
    library = plant.library
    wanted = usual_effects() if ids is None else ids
    hidden = {name: library.hidden[name] for name in wanted if name in library.hidden}
    able = [name for name in wanted if name in library.effects]
    place = np.zeros(len(free))
    blank = Problem(plant, free, (), (), ())
    torques = plant.simulate(blank.values(place))
    whole = np.concatenate(torques, axis=1)
    sizes = [
        noise[name].deviation
        if name in noise
        else DEFAULT_TORQUE_NOISE * float(np.std(row))
        for name, row in zip(instruments.channels, whole, strict=True)
    ]
    floor = tuple(
        _noise_response(plant, blank, record, torque, np.array(sizes), noise)
        for record, torque in zip(records, torques, strict=True)
    )
    seen = plant.limited(
        [
            replace(record, measured=torque)
            for record, torque in zip(records, torques, strict=True)
        ]
    )
    # Torques are compared up to `MAX_BAND`: so many of the samples are independent.
    weight = min(1.0, 2.0 * MAX_BAND * MOTION_STEP) ** 0.5
    problem = Problem(seen, free, (), floor, floor, weight)
    grams, owners = _gram_matrices(problem, place, able)
    standard = [k for k, motion in enumerate(every) if motion.standard]
    chosen = _choose_records(grams, owners, len(free), standard)
    chosen.sort(key=lambda k: every[k].pretension == 0.0)
    together = np.sum([grams[k] for k in chosen], axis=0)
    resolved = _resolved_effects(together, owners, len(free))
    return TrialPlan(
        tuple(every[k] for k in chosen),
        tuple(sorted(resolved, key=lambda each: each.separation)),
        dict(zip(instruments.channels, sizes, strict=True)),
        hidden,
        {name: library.declared[name] for name in wanted if name in library.declared},
        {name: effect_amplitudes(library.effects[name])[0] for name in able},
        tuple(slack[k] for k in chosen),
    )


def _simulated_records(plant: SimulatedRig) -> tuple[Record, ...]:
    """Return records simulated from the scene, which scale its tuning."""
    shown = plant.simulate({})
    return tuple(
        replace(record, measured=torque)
        for record, torque in zip(plant.records, shown, strict=True)
    )


def _record(motion: CataloguedTrial, bench: Bench, rows: int) -> Record:
    size = min(motion.motor.size, motion.joint.size)
    return Record(
        trial=motion.description,
        dt=MOTION_STEP,
        step=MOTION_STEP,
        time=MOTION_STEP * np.arange(size, dtype=np.float64),
        motor_angle=motion.motor[:size],
        joint_angle=motion.joint[:size],
        read=np.array([motion.motor[:size], motion.joint[:size]]),
        measured=np.zeros((rows, size)),
        band=MAX_BAND,
        counts=np.ones(size, dtype=bool),
        pretension=bench.cables[0].pretension * motion.pretension,
        start=0.0,
        split=None,
        group=motion.description,
        tilt=motion.tilt,
        known_torques=motion.known_torques,
        swapped=motion.swapped,
        load_cell=motion.cell_on(bench, bench.cables[0].pretension),
    )


def _noise_response(
    plant: SimulatedRig,
    blank: Problem,
    record: Record,
    torque: FloatArray,
    sizes: FloatArray,
    noise: Mapping[str, Noise],
) -> FloatArray:
    """Return the noise of both torques by torque and angle noise (2, samples) [N m]."""
    random = np.random.default_rng(0)
    deviation = [
        noise[name].deviation if name in noise else DEFAULT_ANGLE_NOISE
        for name in (MOTOR_ANGLE, JOINT_ANGLE)
    ]
    # Slow enough to pass the filters, and to strain a cable that sticks.
    slow = [
        np.repeat(random.normal(0.0, each, -(-record.time.size // 8)), 8)
        for each in deviation
    ]
    moved = replace(
        record,
        motor_angle=record.motor_angle + slow[0][: record.time.size],
        joint_angle=record.joint_angle + slow[1][: record.time.size],
    )
    (there,) = plant.limited([moved]).simulate(blank.values(np.zeros(len(blank.tuned))))
    scatter = np.sqrt(np.mean((there - torque) ** 2, axis=1))
    found: FloatArray = np.broadcast_to(np.hypot(scatter, sizes)[:, None], torque.shape)
    return found


def _gram_matrices(
    problem: Problem, x: FloatArray, ids: Sequence[str]
) -> tuple[list[FloatArray], list[_Column]]:
    """Return the Gram matrix of changes in each record, and its columns.

    First come the baseline's parameters, then the amplitudes of every effect at
    plausible sizes. The priors of the baseline are shared out over the records.
    """
    records = problem.plant.records
    masks = [record.counts for record in records]
    slopes = jacobian(problem, x, masks)
    signatures = screen(problem, x, masks, ids, starts=1)
    owners = [_Column("", 0.0)] * len(problem.tuned)
    columns = [slopes]
    for sign in signatures:
        sizes = effect_amplitudes(problem.plant.library.effects[sign.id])
        plausible = [plausible_size(each, problem, x) for each in sizes]
        typical = [each.typical for each in sizes]
        columns.append(sign.changes * np.divide(plausible, typical))
        owners += [_Column(sign.id, size) for size in plausible]
    table = np.concatenate(columns, axis=1)
    rows = len(problem.plant.instruments.rows)
    ends = np.cumsum([0, *(rows * record.time.size for record in records)])
    grams = [
        table[first:end].T @ table[first:end] for first, end in itertools.pairwise(ends)
    ]
    priors = table[ends[-1] :]
    share = priors.T @ priors
    return [gram + share / len(grams) for gram in grams], owners


def _choose_records(
    grams: Sequence[FloatArray],
    owners: Sequence[_Column],
    base: int,
    standard: Sequence[int],
) -> list[int]:
    """Return the standard records and those that improve the design, greedily."""
    chosen = list(standard)
    best = 0.0
    while len(chosen) < len(grams):
        tried = {
            k: _design_value(
                np.sum([grams[j] for j in (*chosen, k)], axis=0), owners, base
            )
            for k in range(len(grams))
            if k not in chosen
        }
        k = max(tried, key=lambda each: tried[each])
        if tried[k] < best + 0.02:
            break
        chosen.append(k)
        best = tried[k]
    return chosen


def _design_value(gram: FloatArray, owners: Sequence[_Column], base: int) -> float:
    """Return the number of effects that would be identified, in part or whole."""
    return sum(
        0.5 * min(each.clarity / SATURATED_CLARITY, 1.0)
        + 0.5 * min(each.separation / SATURATED_CLARITY, 1.0)
        for each in _resolved_effects(gram, owners, base)
    )


def _resolved_effects(
    gram: FloatArray, owners: Sequence[_Column], base: int
) -> list[Resolved]:
    known = gram[:base, :base]
    cross = gram[:base, base:]
    size = np.sqrt(np.diag(known))
    size[size == 0.0] = 1.0
    shift = np.linalg.lstsq(known / np.outer(size, size), cross / size[:, None])[0]
    left = gram[base:, base:] - (cross / size[:, None]).T @ shift
    index: dict[str, list[int]] = {}
    for place, column in enumerate(owners[base:]):
        index.setdefault(column.effect, []).append(place)
    white = {name: _whitened(left[np.ix_(own, own)]) for name, own in index.items()}
    found = []
    for name, own in index.items():
        clarity = float(np.sqrt(np.max(np.diag(left)[own])))
        cosines = {
            other: _cosine(left[np.ix_(own, theirs)], white[name], white[other])
            for other, theirs in index.items()
            if other != name
        }
        likest = max(cosines, key=lambda other: cosines[other], default="nothing")
        separation = clarity * float(np.sqrt(1.0 - cosines.get(likest, 0.0) ** 2))
        plausible = owners[base + own[0]].size
        found.append(Resolved(name, plausible, clarity, likest, separation))
    return found


def _whitened(own: FloatArray) -> FloatArray:
    """Return the orthonormal combinations of an effect's changes (amplitudes, k)."""
    values, vectors = np.linalg.eigh(own)
    kept = values > 1e-6 * max(float(values[-1]), 1e-300)
    found: FloatArray = vectors[:, kept] / np.sqrt(values[kept])
    return found


def _cosine(cross: FloatArray, one: FloatArray, other: FloatArray) -> float:
    """Return the largest cosine between the changes of two effects."""
    if not one.size or not other.size:
        return 0.0
    values = np.linalg.svd(one.T @ cross @ other, compute_uv=False)
    return float(min(values[0], 1.0))
