r"""Loss of a transmission by direction and load, where no motor angle is known.

A dynamometer shows the torque at both ends while the joint turns. Once the whole cable
slides in the direction s = +1 or -1 of the joint,

    tau_joint = g x exp(-s sign(x) k) + o - s c - b omega - J alpha

x is the motor's torque times the ratio of the radii: the torque at the joint without
any loss. k = mu theta is the exponent of the capstan (Euler 1769), c the loss that does
not depend on the load, b drag and J inertia; g and o are the gain and the zero of the
instruments. A load that drives the motor back has the other sign of the exponent, so
both directions of flow are needed to distinguish k from g, and both directions of
motion to distinguish c from o.

Samples before the cable slides as a whole do not count: a stretch of travel after each
reversal, found from the data. There the loss may exceed that of sliding (break-away).
Noise of the current makes slopes too small; it is subtracted from the normal equations
(Fuller, Measurement Error Models, 1987). Intervals are by a bootstrap of blocks, which
end at every reversal, by direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, JOINT_TORQUE, MOTOR_TORQUE
from cc_mujoco.datasets._smoothing import velocity, velocity_noise
from cc_mujoco.datasets._trials import Constant, Dataset, Trial
from cc_mujoco.diagnosis._partial.motion import rms
from cc_mujoco.diagnosis._phrases import (
    DATA_PREFIX,
    NO_SCENE_PREFIX,
    capitalise,
    describe_mode,
    format_estimate,
    format_number,
    format_share,
)
from cc_mujoco.diagnosis._rig.records import compared_band, low_pass
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Baseline, Deviating, Diagnosis, Verdict
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.native import FloatArray

_DRAWS = 400
_TRAVEL_BINS = 24

DRIVING, DRIVEN, POSITIVE, NEGATIVE, DRAG, INERTIA = range(6)
"""Columns of the fit: slopes while the motor drives the load or the load the motor,
losses in either direction of motion, drag and inertia."""


class Stroke(NamedTuple):
    """Motion of the joint in one direction, between two reversals."""

    trial: int  # index of its trial
    sign: float  # direction, 1 or -1
    reversed: bool  # whether a reversal came before, in the same recording
    ideal: FloatArray  # torque of the joint without loss (samples,) [N m]
    torque: FloatArray  # measured torque of the joint (samples,) [N m]
    speed: FloatArray  # of the joint (samples,) [rad/s]
    acceleration: FloatArray  # of the joint (samples,) [rad/s^2]
    travel: FloatArray  # since the reversal (samples,) [rad]
    step: float  # time between samples [s]


@dataclass(frozen=True)
class LossFit:
    values: dict[str, Estimate]  # estimates by name, where the data determine them
    settling: float = math.nan  # travel after a reversal until the cable slides [rad]
    breakaway_at: float = math.nan  # travel of the largest break-away loss [rad]
    error: float = math.nan  # RMS torque of the joint beyond this law in sliding [N m]
    scene_error: float = math.nan  # the same beyond the law of the scene [N m]
    # Values that the law of the scene would have shown, by name
    scene: Mapping[str, float] = field(default_factory=dict)
    load: float = math.nan  # RMS of the joint's torque while sliding [N m]
    speed: float = math.nan  # RMS of its speed then [rad/s]
    undetermined: tuple[str, ...] = ()  # clauses on what these data do not determine
    refused: str = ""  # clause on why there are no numbers, or empty


class SceneLaw(NamedTuple):
    """Friction that the scene states, of one cable or of a pull-pull pair."""

    exponent: float  # mu theta of a cable
    pretension: float  # of a cable, as torque at the joint; 0 without a pair [N m]

    def torque(self, ideal: FloatArray, sign: float) -> FloatArray:
        less, more = math.exp(-sign * self.exponent), math.exp(sign * self.exponent)
        if self.pretension == 0.0:
            return np.where(ideal >= 0.0, less, more) * ideal
        # The sum of both tensions is constant until one cable is slack.
        half = np.clip(0.5 * ideal, -self.pretension, self.pretension)
        slack = ideal - 2.0 * half
        pulling = self.pretension + half + np.maximum(slack, 0.0)
        other = self.pretension - half - np.minimum(slack, 0.0)
        return pulling * less - other * more


def strokes_of(
    trial: int, angle: FloatArray, ideal: FloatArray, torque: FloatArray,
    step: float, speed_noise: float,
) -> list[Stroke]:  # fmt: skip
    """Return the strokes of a recording without gaps; rests are left out.

    `angle` of the joint [rad], `ideal` torque without loss, measured `torque` [N m] are
    (samples,), every `step` [s]; `speed_noise` is a standard deviation [rad/s].
    """
    speed = velocity(angle, step)
    top = float(np.percentile(np.abs(speed), 95))
    moves = np.abs(speed) > max(Limit.moving_share * top, 5.0 * speed_noise)
    acceleration = velocity(speed, step)
    sign = np.where(moves, np.sign(speed), 0.0)
    moving = np.flatnonzero(moves)
    turns = moving[1:][np.diff(sign[moving]) != 0.0]
    found: list[Stroke] = []
    for first, last in pairwise([*moving[:1], *turns, angle.size]):
        rows = moving[(moving >= first) & (moving < last)]
        begin = moving[np.searchsorted(moving, first) - 1] if found else 0
        way = float(sign[first])
        # The reversal is where the joint was furthest the other way.
        start = float(np.min(way * angle[begin : first + 1]))
        shown = (ideal[rows], torque[rows], speed[rows], acceleration[rows])
        travel = way * angle[rows] - start
        found.append(Stroke(trial, way, bool(found), *shown, travel, step))
    return found


class _Block(NamedTuple):
    """Part of a stroke in which the whole cable slides."""

    sign: float  # direction of the motion
    columns: FloatArray  # of the fit (samples, 6)
    torque: FloatArray  # of the joint (samples,) [N m]
    ideal: FloatArray  # torque of the joint without loss (samples,) [N m]


class _Law(NamedTuple):
    """Linear law of the joint torque, fitted by normal equations of blocks."""

    blocks: Sequence[_Block]  # of the data
    active: NDArray[np.int_]  # columns that the data distinguish, of six
    # Normal matrices (blocks, active, active), corrected for errors of the load
    squares: FloatArray
    products: FloatArray  # with the joint torque (blocks, active)

    @classmethod
    def of(cls, blocks: Sequence[_Block], load_noise: float) -> _Law:
        """Fit the law to blocks; columns that they cannot distinguish are left out."""
        active = _distinguished(np.concatenate([each.columns for each in blocks]))
        squares, products = [], []
        for each in blocks:
            columns = each.columns[:, active]
            own = np.count_nonzero(columns, axis=0) * np.isin(active, [DRIVING, DRIVEN])
            squares.append(columns.T @ columns - np.diag(own * load_noise**2))
            products.append(columns.T @ each.torque)
        return cls(blocks, active, np.array(squares), np.array(products))

    def solve(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients (draws, 6) for block weights (draws, blocks).

        Drag and inertia are 0 if not fitted, others NaN. All fitted ones are NaN in a
        draw that does not determine them, say without a load that drives the motor.
        """
        squares = np.tensordot(weights, self.squares, 1)
        products = (weights @ self.products)[..., None]
        found = np.full((len(weights), 6), np.nan)
        found[:, [DRAG, INERTIA]] = 0.0
        found[:, self.active] = np.nan
        sure = np.linalg.matrix_rank(squares) == self.active.size
        solved = np.linalg.solve(squares[sure], products[sure])[..., 0]
        found[np.ix_(sure, self.active)] = solved
        return found

    def best(self) -> FloatArray:
        return self.solve(np.ones((1, len(self.blocks))))

    @property
    def constant_load(self) -> bool:
        """True if the load varies too little to distinguish gain from loss."""
        used = {k: any(np.any(b.columns[:, k]) for b in self.blocks) for k in range(2)}
        present = [column for column in (DRIVING, DRIVEN) if used[column]]
        return not np.isin(present, self.active).all()


def _distinguished(columns: FloatArray) -> NDArray[np.int_]:
    active = [POSITIVE, NEGATIVE]
    for column in (DRIVING, DRIVEN):
        if _own_share(columns, column, active) > Limit.min_load_spread**2:
            active.append(column)
    speeds = np.percentile(np.abs(columns[:, DRAG]), [10, 90])
    if speeds[1] < Limit.min_speed_range * speeds[0]:
        columns = columns * (np.arange(6) != DRAG)
    for column in (DRAG, INERTIA):
        if _own_share(columns, column, active) > Limit.min_own_share:
            active.append(column)
    return np.array(sorted(active))


def _own_share(columns: FloatArray, column: int, others: Sequence[int]) -> float:
    """Return the share of a column's square that other columns do not explain."""
    own = columns[:, column]
    used = own != 0.0
    power = float(own @ own)
    if np.count_nonzero(used) < Limit.loss_min_blocks or power == 0.0:
        return 0.0
    rest = columns[used][:, others]
    left = own[used] - rest @ np.linalg.lstsq(rest, own[used], 1e-9)[0]
    return float(left @ left) / power


def fit_loss(
    strokes: Sequence[Stroke], load_noise: float, scene: SceneLaw,
    gain_uncertainty: float = math.inf, seed: int = 0,
) -> LossFit:  # fmt: skip
    """Fit the loss of a transmission by direction and load.

    `load_noise` is the deviation of the torque without loss [N m], `gain_uncertainty`
    that of the ratio of both gains, infinite if unknown.
    """
    if len({each.sign for each in strokes}) < 2:
        return LossFit(
            {},
            refused="the joint turns in one direction only, where friction, an error "
            "of the torque constant and the zeros of both torques change the ratio of "
            "the torques in the same way; record both directions",
        )
    travels = np.sort([float(each.travel[-1]) for each in strokes])
    covered = np.cumsum(travels)  # the median of travel, not of strokes
    usual = float(travels[np.searchsorted(covered, 0.5 * covered[-1])])
    settling, before = 0.3 * usual, math.nan
    for _ in range(4):
        blocks = _blocks(strokes, settling)
        signs = np.array([each.sign for each in blocks])
        few = int(min(np.sum(signs == way) for way in (1.0, -1.0)))
        if few < Limit.loss_min_blocks or settling > Limit.max_settling_share * usual:
            return LossFit(
                {},
                refused=f"strokes of {usual:.2g} rad are too short or too few for the "
                "loss to become steady after a reversal, so sliding cannot be "
                "distinguished from stretch and play; record longer strokes",
            )
        law = _Law.of(blocks, load_noise)
        best = law.best()
        if settling == before:
            break
        before = settling
        settling = _Profile.of(strokes, best[0], usual).settling(usual)
    random = np.random.default_rng(seed)
    weights = np.zeros((_DRAWS, len(blocks)))
    for way in (1.0, -1.0):
        own = np.flatnonzero(signs == way)
        even = np.full(own.size, 1.0 / own.size)
        weights[:, own] = random.multinomial(own.size, even, _DRAWS)
    derived, drawn = _derived(best, law), _derived(law.solve(weights), law, weights)
    wider = math.sqrt(few / (few - 1.0))
    values = {}
    for name, value in derived.items():
        spread = float(np.nanstd(drawn[name])) * wider
        fitted = _estimate(float(value[0]), _UNITS.get(name, "1"), spread, few - 2)
        if name not in ("drag", "rotor_inertia") or fitted.ci95[0] > 0.0:
            values[name] = fitted
    by_scene = [b._replace(torque=scene.torque(b.ideal, b.sign)) for b in blocks]
    expected = _Law.of(by_scene, 0.0)
    stated = _derived(expected.best(), expected)
    breakaway_at = math.nan
    losses = ("load_independent_loss", "friction_exponent")
    slides = [values[name].ci95[0] > 0.0 for name in losses if name in values]
    if len(slides) == 2 and any(slides):
        profile = _Profile.of(strokes, best[0], usual)
        excess, breakaway_at = _breakaway(profile, random)
        if excess is not None:
            values["breakaway_excess"] = excess
    left = [b.torque - b.columns @ np.nan_to_num(best[0]) for b in blocks]
    off = [b.torque - each.torque for b, each in zip(blocks, by_scene, strict=True)]
    misfit = rms(left) if "friction_exponent" in derived else math.nan
    given = {name: float(value[0]) for name, value in stated.items()}
    signals = rms([b.torque for b in blocks]), rms([b.columns[:, DRAG] for b in blocks])
    unknown = _undetermined(law, gain_uncertainty, breakaway_at)
    found = values, settling, breakaway_at, misfit, rms(off), given
    return LossFit(*found, *signals, unknown)


# Of all that is not a ratio
_UNITS = {"drag": "N m s/rad", "rotor_inertia": "kg m^2"}
_UNITS |= dict.fromkeys(("zero", "total_loss", "load_independent_loss"), "N m")
_UNITS |= {f"load_independent_{way}": "N m" for way in ("positive", "negative")}


def _derived(
    found: FloatArray, law: _Law, weights: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Return the physical quantities (draws,) of coefficients (draws, 6), by name."""
    values: dict[str, FloatArray] = {}
    known = set(law.active.tolist())
    if {DRIVING, DRIVEN} <= known:
        driving, driven = np.log(np.maximum(found[:, [DRIVING, DRIVEN]], 1e-9)).T
        values["friction_exponent"] = 0.5 * (driven - driving)
        values["exponent_driving"], values["exponent_driven"] = -driving, driven
        values["gain"] = np.exp(0.5 * (driven + driving))
    if known & {DRIVING, DRIVEN} and not law.constant_load:
        positive, negative = found[:, POSITIVE], found[:, NEGATIVE]
        values["load_independent_loss"] = 0.5 * (positive + negative)
        values["load_independent_positive"] = positive
        values["load_independent_negative"] = negative
        values["zero"] = 0.5 * (negative - positive)
    else:
        each = np.array([b.ideal.mean() - b.torque.mean() for b in law.blocks])
        signs = np.array([b.sign for b in law.blocks])
        used = np.ones((1, signs.size)) if weights is None else weights
        parts = [(used[:, signs == way], each[signs == way]) for way in (1.0, -1.0)]
        forth, back = (own @ mean / own.sum(axis=1) for own, mean in parts)
        values["total_loss"] = 0.5 * (forth - back)
    for name, column in (("drag", DRAG), ("rotor_inertia", INERTIA)):
        if column in known:
            values[name] = found[:, column]
    return values


def _estimate(value: float, unit: str, deviation: float, freedom: int) -> Estimate:
    from scipy.special import stdtrit

    reach = float(stdtrit(freedom, 0.975)) * deviation
    return Estimate(value, unit, (value - reach, value + reach))


def _columns(stroke: Stroke) -> FloatArray:
    columns = np.zeros((stroke.ideal.size, 6))
    drives = stroke.sign * stroke.ideal >= 0.0
    columns[drives, DRIVING] = stroke.ideal[drives]
    columns[~drives, DRIVEN] = stroke.ideal[~drives]
    columns[:, POSITIVE if stroke.sign > 0.0 else NEGATIVE] = -stroke.sign
    columns[:, DRAG], columns[:, INERTIA] = -stroke.speed, -stroke.acceleration
    return columns


def _blocks(strokes: Sequence[Stroke], settling: float) -> list[_Block]:
    """Return the parts of strokes after a travel of `settling` [rad], as blocks."""
    found: list[_Block] = []
    for way in (1.0, -1.0):
        own = [s for s in strokes if s.sign == way and s.travel[-1] > settling]
        time = sum(float(np.sum(s.travel > settling)) * s.step for s in own)
        longest = max(0.25, time / 12)
        for stroke in own:
            rows = np.flatnonzero(stroke.travel > settling)
            columns = _columns(stroke)
            parts = max(1, math.floor(rows.size * stroke.step / longest))
            for part in np.array_split(rows, parts):
                found.append(
                    _Block(way, columns[part], stroke.torque[part], stroke.ideal[part])
                )
    return found


class _Profile(NamedTuple):
    """Loss beyond that of steady sliding, by the travel since a reversal."""

    edges: FloatArray  # of the bins of travel (bins + 1,) [rad]
    excess: FloatArray  # sum of the excess by reversal and bin (reversals, bins) [N m]
    sliding: FloatArray  # sum of the loss of sliding (reversals, bins) [N m]

    @classmethod
    def of(cls, strokes: Sequence[Stroke], found: FloatArray, usual: float) -> _Profile:
        edges = np.append(0.0, np.geomspace(0.01 * usual, usual, _TRAVEL_BINS))
        sums = []
        law = np.nan_to_num(found)
        gain = math.sqrt(law[DRIVING] * law[DRIVEN])
        zero = 0.5 * (law[NEGATIVE] - law[POSITIVE])
        for each in strokes:
            if not each.reversed or each.travel[-1] < 0.5 * usual:
                continue
            columns = _columns(each)
            more = each.sign * (columns @ law - each.torque)
            other = columns[:, [DRAG, INERTIA]] @ law[[DRAG, INERTIA]]
            lossless = gain * each.ideal + zero + other
            loss = each.sign * (lossless - columns @ law)
            bins = np.searchsorted(edges, each.travel, side="right") - 1
            inside = (bins >= 0) & (bins < _TRAVEL_BINS)
            both = more, loss
            sums += [np.bincount(bins[inside], v[inside], _TRAVEL_BINS) for v in both]
        table = np.array(sums, dtype=np.float64).reshape(-1, _TRAVEL_BINS)
        return cls(edges, table[0::2], table[1::2])

    def ratio(self) -> tuple[FloatArray, FloatArray]:
        """Return excess over loss, and its error (bins,); NaN for few strokes."""
        whole = np.abs(self.sliding.sum(axis=0))
        used = np.count_nonzero(self.sliding, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = self.excess.sum(axis=0) / whole
            left = self.excess - ratio * self.sliding
            error = np.sqrt(np.sum(left**2, axis=0) * used / (used - 1.0)) / whole
        ratio[used < 3] = np.nan
        return ratio, error

    def settling(self, usual: float) -> float:
        """Return the travel [rad] after which the loss is steadily that of sliding."""
        if not len(self.excess):
            return 0.3 * usual
        ratio, error = self.ratio()
        settled = np.abs(ratio) < np.maximum(Limit.settled, 2.0 * error)
        for place in range(_TRAVEL_BINS - 2):
            if settled[place : place + 3].all():
                return Limit.settling_margin * float(self.edges[place])
        return usual


def _breakaway(profile: _Profile, random: Generator) -> tuple[Estimate | None, float]:
    """Return the largest relative excess of the loss, and its travel [rad].

    Half of the reversals choose the bin and the others evaluate it, then vice versa.
    """
    count = len(profile.excess)
    if count < Limit.min_reversals:
        return None, math.nan
    halves = [np.arange(count)[k::2] for k in range(2)]

    def largest(rows: Sequence[NDArray[np.int_]]) -> tuple[float, int]:
        excess, sliding = profile.excess, profile.sliding
        parts = [profile._replace(excess=excess[r], sliding=sliding[r]) for r in rows]
        sums = np.zeros(2)
        for chosen, other in (parts, parts[::-1]):
            ratio = chosen.ratio()[0]
            if np.isnan(ratio).all():
                return math.nan, 0
            best = int(np.nanargmax(ratio))
            sums += other.excess[:, best].sum(), abs(other.sliding[:, best].sum())
        return float(sums[0] / sums[1]) if sums[1] > 0.0 else math.nan, best

    value, place = largest(halves)
    resampled = ([random.choice(h, h.size) for h in halves] for _ in range(_DRAWS))
    draws = [largest(rows)[0] for rows in resampled]
    if not math.isfinite(value):
        return None, math.nan
    spread = float(np.nanstd(draws)) * math.sqrt(count / (count - 2.0))
    at = 0.5 * float(profile.edges[place] + profile.edges[place + 1])
    return _estimate(value, "1", spread, count - 2), at


def _undetermined(law: _Law, doubt: float, breakaway_at: float) -> tuple[str, ...]:
    found = ["stretch, play and pretension, which need the motor's angle"]
    known = set(law.active.tolist())
    if law.constant_load:
        found.append(
            "which part of the loss grows with the load, as the load hardly varies "
            "in one direction; record at two or more loads"
        )
    elif not {DRIVING, DRIVEN} <= known:
        found.append(
            "the loss that grows with the load, which an error of the torque constant "
            "resembles as long as the load never drives the motor back; record a load "
            "that does"
        )
    elif not math.isfinite(doubt):
        found.append(
            "a difference of friction between the directions, which an error of a "
            "gain or of a zero resembles; declare `gain_uncertainty` and `zeroed`"
        )
    if DRAG not in known:
        found.append(
            "a loss that grows with speed, which counts as independent of the load "
            "here; record at two speeds"
        )
    if INERTIA not in known:
        found.append(
            "the inertia of the rotor, whose torque varies like the load; declare "
            "`rotor_inertia`"
        )
    if not math.isfinite(breakaway_at):
        found.append(
            f"a break-away loss, which takes {Limit.min_reversals} reversals in the "
            "recordings"
        )
    return tuple(found)


def diagnose_loss(dataset: Dataset, bench: Bench, seed: int = 0) -> Diagnosis:
    """Return a diagnosis: the loss by direction and load, and what stays unknown."""
    where, known = dataset.path or "these trials", dataset.instruments
    if bench.led or bench.others:
        raise CableError(
            f"scene {bench.path} has a cable whose path its joint moves, which takes "
            "the motor's angle to diagnose; record it"
        )
    if known.motor is None or known.joint in (None, "known load"):
        raise CableError(
            f"in {where} the motor's angle is not measured and a torque is not either; "
            "record the torque at both ends (a current will do at the motor)"
        )
    if len({trial.facts.occasion for trial in dataset.trials}) > 1:
        raise CableError(
            f"{where} has several occasions, which take the motor's angle to compare; "
            "diagnose each by itself"
        )
    special = "unhooked swapped load_cell known_joint_torque known_motor_torque".split()
    facts = [(t, [getattr(t.facts, fact) for fact in special]) for t in dataset.trials]
    used = [trial for trial, own in facts if not any(own)]
    strokes = [s for k, t in enumerate(used) for s in _strokes(k, t, dataset, bench)]
    load, torque = _noise(used, dataset, bench)
    gains = dataset.constants.get("gain_uncertainty")
    cable, pair = bench.cables[0], len(bench.cables) > 1
    taut = cable.pretension * bench.joint_radius * pair
    doubt = math.inf if gains is None else math.sqrt(2.0) * gains.value
    law = SceneLaw(cable.friction * cable.wrap, taut)
    found = fit_loss(strokes, load, law, doubt, seed)
    mode = describe_mode(known, motor_angle=False)
    no_scene = f"{NO_SCENE_PREFIX}: without the motor's angle no cable can be played."
    if found.refused:
        reason = f"{capitalise(found.refused)}."
        baseline, problems = Baseline({}, (reason,)), (reason, no_scene)
        refusal = Diagnosis("fix-data", f"{DATA_PREFIX}: {found.refused}.")
        refusal = replace(refusal, baseline=baseline, problems=problems)
        return replace(refusal, instruments=mode)
    noise = math.hypot(load, torque)
    before, after = found.scene_error / noise, found.error / noise
    ties = () if before <= Limit.max_misfit else _ties(found)
    friction = () if pair else _friction(found, bench)
    kind: Verdict = "tie" if ties else "none"
    far = before > Limit.max_misfit and after > Limit.max_misfit
    if far and not (ties or friction):
        kind = "unknown"
    return Diagnosis(
        kind,
        _statement(found, before, after, pair, gains),
        ties=ties,
        baseline=Baseline(
            found.values, tuple(f"{capitalise(each)}." for each in found.undetermined)
        ),
        deviating=friction if kind == "none" else (),
        remaining=after,
        instruments=mode,
        problems=(no_scene,),
        question="Record the motor's angle as well, to find stretch, play and "
        "pretension and to distinguish the effects.",
    )


def _strokes(place: int, trial: Trial, dataset: Dataset, bench: Bench) -> list[Stroke]:
    band = compared_band(trial.rate)
    ratio = bench.joint_radius / bench.motor_radius
    inertia = dataset.constants.get("rotor_inertia", Constant(0.0)).value
    known = dataset.noise.get(JOINT_ANGLE)
    noise = velocity_noise(known.deviation if known else 0.0, trial.step)
    motor, joint = trial.motor_torque, trial.joint_torque
    assert motor is not None
    assert joint is not None
    found = []
    for part in trial.segments:
        signals = np.array([trial.joint_angle[part], motor[part], joint[part]])
        angle, driving, torque = low_pass(signals, band, trial.rate)
        arm = ratio * bench.share(angle)
        turning = velocity(velocity(angle, trial.step), trial.step)
        ideal = arm * (driving - inertia * arm * turning)
        found += strokes_of(place, angle, ideal, torque, trial.step, noise)
    return found


def _noise(trials: list[Trial], dataset: Dataset, bench: Bench) -> tuple[float, float]:
    rate = min((trial.rate for trial in trials), default=1.0)
    passed = math.sqrt(min(1.0, 2.0 * compared_band(rate) / rate))
    known = [dataset.noise.get(name) for name in (MOTOR_TORQUE, JOINT_TORQUE)]
    motor, joint = (each.deviation if each else 0.0 for each in known)
    ratio = bench.joint_radius / bench.motor_radius
    return passed * ratio * motor, max(passed * joint, 1e-9)


def _ties(found: LossFit) -> tuple[tuple[str, ...], ...]:
    """Return groups of effects that may cause a loss beyond the scene's friction."""
    values, least = found.values, Limit.min_share * found.load
    ties = []
    loss = values.get("load_independent_loss")
    if loss and loss.ci95[0] - found.scene["load_independent_loss"] > least:
        ties.append(("load_independent_friction", "drive_friction"))
    if "drag" in values and values["drag"].ci95[0] * found.speed > least:
        ties.append(("viscous_friction", "grease_drag"))
    total = values.get("total_loss")
    if total and not total.holds(found.scene.get("total_loss", math.nan)):
        ties.append(("friction", "load_independent_friction"))
    excess = values.get("breakaway_excess")
    if excess and excess.ci95[0] > Limit.min_excess:
        ties.append(("stribeck_friction", "dwell_dependent_stiction"))
    return tuple(ties)


def _friction(found: LossFit, bench: Bench) -> tuple[Deviating, ...]:
    """Return the single cable's friction as deviating if unlike the scene's, or ()."""
    exponent, cable = found.values.get("friction_exponent"), bench.cables[0]
    given = cable.friction
    if exponent is None or cable.wrap == 0.0 or given == 0.0:
        return ()
    low, high = (each / cable.wrap for each in exponent.ci95)
    tuned = Estimate(exponent.value / cable.wrap, "1", (low, high))
    off = abs(tuned.value - given)
    if tuned.holds(given) or off < Limit.min_friction_change * given:
        return ()
    statement = (
        f"friction is {format_estimate(tuned)} with the wrap of the scene, where "
        f"{format_number(given)} is given; correct one of them."
    )
    deviations = off / max(0.5 * (high - low) / Limit.sigmas, 1e-12)
    return (Deviating("friction", given, tuned, deviations, statement),)


def _statement(
    found: LossFit, before: float, after: float, pair: bool, gains: Constant | None
) -> str:
    values = found.values
    said = {name: format_estimate(value) for name, value in values.items()}
    text = [
        f"While the cable slides, the joint torque is {format_number(before)} times "
        "the noise off the friction of the scene."
    ]
    if (exponent := values.get("friction_exponent")) is not None:
        share = format_share(-math.expm1(-exponent.value))
        stated = format_number(found.scene["friction_exponent"])
        text.append(
            f"The loss that grows with the load is {share} of the torque that drives: "
            f"exponent mu theta {said['friction_exponent']}, {stated} by the scene. "
            f"With exact gains it is {said['exponent_driving']} where the motor drives "
            f"the load and {said['exponent_driven']} where the load drives the motor."
        )
        if gains is not None:
            doubt = 2.0 * math.sqrt(2.0) * gains.value
            low, high = values["gain"].ci95
            if low > 1.0 + doubt or high < 1.0 - doubt:
                text.append(
                    "The directions differ by more than the declared gains allow, so "
                    "friction is asymmetric or the torque constant is wrong."
                )
    if (loss := values.get("load_independent_loss")) is not None:
        own = found.scene.get("load_independent_loss", 0.0)
        stated = format_number(own, loss.ci95[1] - loss.ci95[0])
        text.append(
            "The loss that does not depend on the load is "
            f"{said['load_independent_loss']} N m at the joint, {stated} by the scene."
        )
    if "total_loss" in values:
        text.append(
            f"At this load {said['total_loss']} N m are lost at the joint in either "
            f"direction, {format_number(found.scene['total_loss'])} by the scene; how "
            "much of it grows with the load, these data cannot show."
        )
    if "drag" in values:
        text.append(f"With speed the loss grows by {said['drag']} N m s/rad.")
    if (excess := values.get("breakaway_excess")) is not None:
        seen = "No break-away loss is seen"
        if excess.ci95[0] > Limit.min_excess:
            seen = (
                f"{format_number(found.breakaway_at)} rad after a reversal it is "
                f"larger than while sliding by {said['breakaway_excess']} of it"
            )
        steady = format_number(found.settling)
        text.append(f"{seen}; from {steady} rad after a reversal the loss is steady.")
    if pair:
        text.append(
            "In a pair of taut cables pretension turns friction into a loss that does "
            "not depend on the load."
        )
    if math.isfinite(after):
        text.append(f"With this law {format_number(after)} times the noise is left.")
    if after > Limit.max_explained_error:
        text.append("Something else acts as well.")
    return " ".join(text)
