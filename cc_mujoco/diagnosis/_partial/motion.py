"""Dead zone, lag and ratio of a joint behind its motor, where no torque is known.

Robots that only command and measure positions show how the joint follows. With the
motor angle u, scaled by the ratio of the radii, the joint angle is

    q(t) = (1 + c) mean_k P[u; h (1 + k g)](t - d) + constant of the trial

where P is play of half width h, k is -1, 0 and 1, and d the lag. With g = 0 the joint
sets off at once after a reversal. A larger g spreads that over a range, as a sum of
play operators does (Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989). A
loose joint has a dead zone, and so has a cable that stretches against friction: only a
torque distinguishes them.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Parameter
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis import _phrases as words
from cc_mujoco.diagnosis._rig.records import compared_band, low_pass, shift_signal
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Baseline, Diagnosis, Verdict
from cc_mujoco.diagnosis.effects._effect import follow_with_play
from cc_mujoco.errors import CableError
from cc_mujoco.estimation import _least_squares as least_squares
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from cc_mujoco.native import FloatArray

_WHAT_TELLS = (
    "Record a torque at either end, or load the joint with a known spring or weight "
    "and declare it in [rig], to distinguish the effects."
)
_PARAMETERS = (
    Parameter("dead_zone", "rad", "range within which the joint does not follow", 0.0),
    Parameter("dead_zone_spread", "1", "range over which it sets off", 0.0, 1.0),
    Parameter(
        "lag",
        "s",
        "time by which the joint follows late",
        -Limit.max_lag,
        Limit.max_lag,
    ),
    Parameter("ratio_change", "1", "deviation of the ratio from that of the pulleys"),
)


class _Stretch(NamedTuple):
    trial: int  # number of its trial
    motor: FloatArray  # angle scaled to the joint's (samples,) [rad]
    joint: FloatArray  # angle (samples,) [rad]
    step: float  # time between samples [s]
    counts: NDArray[np.bool_]  # samples that are compared


def diagnose_motion(dataset: Dataset, bench: Bench) -> Diagnosis:
    """Return a diagnosis: how the joint follows the motor, and what stays unknown."""
    if bench.led:
        raise CableError(
            f"scene {bench.path} has a cable whose path its joint moves, which takes a "
            "torque to diagnose; record one, or declare a load in [rig]"
        )
    noise = _noise(dataset, bench)
    stretches = _stretches(dataset, bench)
    start = _start(stretches)
    stretches = [_counted(each, start[0]) for each in stretches]
    if sum(int(each.counts.sum()) for each in stretches) < Limit.motion_min_samples:
        raise CableError(
            f"in {dataset.path or 'these trials'} the motor moves less than "
            f"{Limit.range_over_play:g} times the dead zone of the joint, about "
            f"{start[0]:.2g} rad; record larger motions"
        )
    # A clock may be off by half a sample, which is no lag.
    clock = 0.5 * max(each.step for each in stretches)
    speed = rms([np.gradient(s.motor, s.step) for s in stretches])
    size = rms([s.motor - float(np.mean(s.motor)) for s in stretches])
    scales = (noise, 0.1, noise / max(speed, 1e-9), noise / max(size, 1e-9))
    pairs = zip(_PARAMETERS, scales, strict=True)
    free = tuple(Tuned(p, 0.0, size, p.low / size, p.high / size) for p, size in pairs)

    def residuals(x: FloatArray) -> list[FloatArray]:
        values = [p.value(place) for p, place in zip(free, x, strict=True)]
        return [each / noise for each in _errors(stretches, values) if each.size]

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate(residuals(x))

    def jacobian(x: FloatArray) -> FloatArray:
        steps = {k: 0.5 if x[k] + 0.5 < free[k].high else -0.5 for k in range(x.size)}
        columns = least_squares.differences(
            lambda there: [residual(there)], x, steps, [residual(x)]
        )
        return np.array([columns[k][0] for k in range(x.size)]).T

    begin = np.array(start) / scales
    best = min(
        (
            least_squares.fit(residual, jacobian, free, begin * keep, tolerance=1e-4)
            for keep in ([1, 0, 1, 1], [0, 0, 1, 1], [1, 0, 0, 1])
        ),
        key=lambda found: found.cost,
    )
    rigid = least_squares.fit(
        lambda x: residual(np.array([0.0, 0.0, 0.0, x[0]])),
        lambda x: jacobian(np.array([0.0, 0.0, 0.0, x[0]]))[:, 3:],
        free[3:],
        [start[3] / scales[3]],
    )
    known = least_squares.covariance(jacobian(best.x), residuals(best.x))
    spread = np.sqrt(np.diag(known))
    places = zip(free, best.x.tolist(), spread.tolist(), strict=True)
    values = {each[0].name: least_squares.estimate(*each) for each in places}
    samples = residual(best.x).size
    before, after = (np.sqrt(2.0 * f.cost / samples).item() for f in (rigid, best))
    zone, lag = values["dead_zone"], values["lag"]
    stands = zone.ci95[0] > noise
    late = min(lag.ci95) > clock or max(lag.ci95) < -clock
    alike = ("backlash", "end_compliance"), ("sensor_delay", "viscous_friction")
    ties = tuple(itertools.compress(alike, (stands, late)))
    kind: Verdict = "tie" if ties else "unknown"
    if before <= Limit.max_misfit:
        kind, ties = "none", ()
    return Diagnosis(
        kind,
        _statement(kind, values, (stands, late), before, after),
        ties=ties,
        baseline=Baseline(values, ()),
        remaining=after,
        instruments=words.describe_mode(dataset.instruments),
        problems=(f"{words.NO_SCENE_PREFIX}: no torque shows what is in the cables.",),
        question=_WHAT_TELLS if ties else "",
    )


def _noise(dataset: Dataset, bench: Bench) -> float:
    """Return the noise of joint less motor angle after the low-pass [rad]."""
    rate = float(min(trial.rate for trial in dataset.trials))
    passed = min(1.0, 2.0 * compared_band(rate) / rate)
    known = [dataset.noise.get(name) for name in (JOINT_ANGLE, MOTOR_ANGLE)]
    joint, motor = (each.deviation if each else 0.0 for each in known)
    whole = float(np.hypot(joint, bench.motor_radius / bench.joint_radius * motor))
    return max(whole * math.sqrt(passed), 1e-9)


def _stretches(dataset: Dataset, bench: Bench) -> list[_Stretch]:
    ratio = bench.motor_radius / bench.joint_radius
    found = []
    for place, trial in enumerate(dataset.trials):
        band = compared_band(trial.rate)
        for part in trial.segments:
            angles = np.array([trial.motor_angle[part], trial.joint_angle[part]])
            motor, joint = low_pass(angles, band, trial.rate)
            counts = np.ones(motor.size, dtype=bool)
            turned = bench.turned(joint)
            found.append(_Stretch(place, ratio * motor, turned, trial.step, counts))
    return found


def _start(stretches: Sequence[_Stretch]) -> tuple[float, float, float, float]:
    rows, wanted = [], []
    for own in stretches:
        speed = np.gradient(own.motor, own.step)
        moves = np.abs(speed) > 0.2 * np.sqrt(np.mean(speed**2))
        columns = np.array([-0.5 * np.sign(speed), -speed, own.motor])[:, moves]
        rows.append(columns - columns.mean(axis=1, keepdims=True))
        gap = (own.joint - own.motor)[moves]
        wanted.append(gap - gap.mean())
    table, gaps = np.concatenate(rows, axis=1).T, np.concatenate(wanted)
    zone, lag, change = np.linalg.lstsq(table, gaps, rcond=1e-9)[0].tolist()
    return max(zone, 0.0), 0.0, min(max(lag, -Limit.max_lag), Limit.max_lag), change


def _counted(stretch: _Stretch, play: float) -> _Stretch:
    """Return a stretch that counts from where the motor has clearly left the play."""
    motor = stretch.motor
    reach = np.maximum.accumulate(motor) - np.minimum.accumulate(motor)
    counts = reach > Limit.range_over_play * play
    counts[: round(Limit.max_lag / stretch.step)] = False
    return stretch._replace(counts=counts)


def _errors(stretches: Sequence[_Stretch], values: Sequence[float]) -> list[FloatArray]:
    zone, spread, lag, change = values
    errors = []
    for own in stretches:
        late = shift_signal(own.motor, -lag / own.step)
        widths = [0.5 * zone * (1.0 + k * spread) for k in (-1.0, 0.0, 1.0)]
        followed = np.mean([follow_with_play(late, width) for width in widths], axis=0)
        errors.append((own.joint - (1.0 + change) * followed)[own.counts])
    whole = {}
    for trial in {own.trial for own in stretches}:
        pairs = zip(stretches, errors, strict=True)
        parts = np.concatenate([e for own, e in pairs if own.trial == trial])
        whole[trial] = parts.mean() if parts.size else 0.0
    return [e - whole[own.trial] for own, e in zip(stretches, errors, strict=True)]


def rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _statement(
    kind: Verdict, values: dict[str, Estimate], sure: tuple[bool, bool],
    before: float, after: float,
) -> str:  # fmt: skip
    off = (
        f"The joint is {words.format_number(before)} times the noise off a rigid drive"
    )
    if kind == "none":
        return f"{off}: these data show neither a dead zone nor a lag."
    stands, late = sure
    seen = ("a dead zone", "dead_zone", stands), ("a lag", "lag", late)
    sizes = [(what, values[name]) for what, name, there in seen if there]
    found = [f"{what} of {words.format_estimate(e, f' {e.unit}')}" for what, e in sizes]
    left = f"{words.format_number(after)} times the noise is left."
    if not found:
        return f"{off}, and neither a dead zone nor a lag explains it; {left}"
    text = f"{off}. It has {' and '.join(found)}; with that {left}"
    if stands:
        low, high = values["dead_zone_spread"].ci95
        if high < 0.5:
            text += " After a reversal the joint sets off at once."
        elif low > 0.5:
            text += (
                " After a reversal the joint sets off gradually, which a loose joint "
                "alone does not."
            )
        text += (
            " Without a torque or a known load, play cannot be distinguished from a "
            "cable that stretches against friction."
        )
    if late:
        text += (
            " A late sensor cannot be distinguished from friction that grows with "
            "speed."
        )
    if after > Limit.max_explained_error:
        text += " Something else moves the joint as well."
    return text
