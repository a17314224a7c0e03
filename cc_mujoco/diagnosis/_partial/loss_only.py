"""Diagnosis without a motor angle: loss by direction and load, as on a dynamometer.

No cable can be played through the scene, so no effect is named. The torque at both ends
shows how much is lost while the whole cable slides; the scene states how much friction
alone would take.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, JOINT_TORQUE, MOTOR_TORQUE
from cc_mujoco.datasets._smoothing import velocity, velocity_noise
from cc_mujoco.datasets._trials import Constant, Dataset, Trial
from cc_mujoco.diagnosis._partial.measurement_mode import describe_mode
from cc_mujoco.diagnosis._partial.transmission_loss import (
    LossFit,
    SceneLaw,
    Stroke,
    fit_loss,
    strokes_of,
)
from cc_mujoco.diagnosis._phrases import (
    DATA_PREFIX,
    NO_SCENE_PREFIX,
    capitalise,
    format_fitted,
    format_interval,
    format_number,
    format_share,
)
from cc_mujoco.diagnosis._rig.lowpass import compared_band, low_pass
from cc_mujoco.diagnosis._search.acceptance import MAX_EXPLAINED_ERROR, Thresholds
from cc_mujoco.diagnosis._verdict import Baseline, Diagnosis, Strayed, Verdict
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import Estimate

LOAD_INDEPENDENT_TIE = ("load_independent_friction", "drive_friction")
"""Causes of a loss that does not depend on the load; the second is not in a cable."""
CONSTANT_LOAD_TIE = ("friction", "load_independent_friction")
"""Causes of a loss at one load; the first is a parameter of the scene."""
DRAG_TIE = ("viscous_friction", "grease_drag")
"""Effects that make a loss grow with speed."""
BREAKAWAY_TIE = ("stribeck_friction", "dwell_dependent_stiction")
"""Effects that make the loss larger after a reversal than while sliding."""
_MIN_SHARE = 0.02
"""Loss, over the usual load, from which it counts."""
_MIN_EXCESS = 0.05
"""Break-away loss, over that of sliding, from which it counts."""
_MIN_FRICTION_CHANGE = 0.1
"""Relative deviation of friction from the scene that is reported."""
_WHAT_TELLS = (
    "Record the motor's angle as well, to find stretch, play and pretension and to "
    "distinguish the effects."
)


def diagnose_loss(dataset: Dataset, bench: Bench, seed: int = 0) -> Diagnosis:
    """Return the loss by direction and load, and what these data cannot show.

    Args:
        dataset: trials with both torques and the joint's angle.
        bench: rig as the scene has it, with what is known of it.
        seed: of the bootstrap.

    Raises:
        CableError: a torque is missing, the joint moves the cables by their path, or
            there are several occasions.
    """
    where = dataset.path or "these trials"
    if bench.led or bench.others:
        raise CableError(
            f"scene {bench.path} has a cable whose path its joint moves, which takes "
            "the motor's angle to diagnose; record it"
        )
    if dataset.instruments.motor is None or dataset.instruments.joint in (
        None,
        "known load",
    ):
        raise CableError(
            f"in {where} the motor's angle is not measured and a torque is not either; "
            "record the torque at both ends (a current will do at the motor)"
        )
    if len({trial.facts.occasion for trial in dataset.trials}) > 1:
        raise CableError(
            f"{where} has several occasions, which take the motor's angle to compare; "
            "diagnose each by itself"
        )
    used = [trial for trial in dataset.trials if _as_usual(trial)]
    strokes = [s for k, t in enumerate(used) for s in _strokes(k, t, dataset, bench)]
    load, torque = _noise(used, dataset, bench)
    known = dataset.constants.get("gain_uncertainty")
    cable = bench.cables[0]
    pair = len(bench.cables) > 1
    law = SceneLaw(
        cable.friction * cable.wrap, cable.pretension * bench.joint_radius * pair
    )
    doubt = math.inf if known is None else math.sqrt(2.0) * known.value
    found = fit_loss(strokes, load, law, doubt, seed)
    mode = describe_mode(dataset.instruments, motor_angle=False)
    no_scene = f"{NO_SCENE_PREFIX}: without the motor's angle no cable can be played."
    if found.refused:
        reason = f"{capitalise(found.refused)}."
        return Diagnosis(
            "fix-data",
            f"{DATA_PREFIX}: {found.refused}.",
            baseline=Baseline({}, (reason,)),
            problems=(reason, no_scene),
            instruments=mode,
        )
    noise = math.hypot(load, torque)
    before, after = found.scene_error / noise, found.error / noise
    ties = () if before <= Thresholds().misfit else _ties(found)
    friction = () if pair else _friction(found, bench)
    kind: Verdict = "none"
    if ties:
        kind = "tie"
    elif before > Thresholds().misfit and not friction:
        kind = "unknown" if after > Thresholds().misfit else "none"
    return Diagnosis(
        kind,
        _statement(found, before, after, pair, dataset.constants),
        ties=ties,
        baseline=Baseline(
            found.values, tuple(f"{capitalise(each)}." for each in found.undetermined)
        ),
        strayed=friction if kind == "none" else (),
        remaining=after,
        instruments=mode,
        problems=(no_scene,),
        question=_WHAT_TELLS,
    )


def _as_usual(trial: Trial) -> bool:
    """Return whether cables and sensors of a trial are in their usual places."""
    facts = trial.facts
    return not (
        facts.unhooked
        or facts.swapped
        or facts.load_cell
        or facts.known_joint_torque
        or facts.known_motor_torque
    )


def _strokes(place: int, trial: Trial, dataset: Dataset, bench: Bench) -> list[Stroke]:
    """Return the strokes of a trial, all signals through the same low-pass."""
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


def _noise(
    trials: Sequence[Trial], dataset: Dataset, bench: Bench
) -> tuple[float, float]:
    """Return the noise of the torque without loss and of the joint's [N m]."""
    rate = min((trial.rate for trial in trials), default=1.0)
    passed = math.sqrt(min(1.0, 2.0 * compared_band(rate) / rate))
    motor, joint = (
        dataset.noise[name].deviation if name in dataset.noise else 0.0
        for name in (MOTOR_TORQUE, JOINT_TORQUE)
    )
    ratio = bench.joint_radius / bench.motor_radius
    return passed * ratio * motor, max(passed * joint, 1e-9)


def _ties(found: LossFit) -> tuple[tuple[str, ...], ...]:
    """Return the groups of effects that make what is beyond the scene's friction."""
    values, least = found.values, _MIN_SHARE * found.load
    ties = []
    loss = values.get("load_independent_loss")
    if loss and loss.ci95[0] - found.scene["load_independent_loss"] > least:
        ties.append(LOAD_INDEPENDENT_TIE)
    if "drag" in values and values["drag"].ci95[0] * found.speed > least:
        ties.append(DRAG_TIE)
    total = values.get("total_loss")
    if total and not total.holds(found.scene.get("total_loss", math.nan)):
        ties.append(CONSTANT_LOAD_TIE)
    excess = values.get("breakaway_excess")
    if excess and excess.ci95[0] > _MIN_EXCESS:
        ties.append(BREAKAWAY_TIE)
    return tuple(ties)


def _friction(found: LossFit, bench: Bench) -> tuple[Strayed, ...]:
    """Return the friction of a single cable, if it is not that of the scene."""
    exponent = found.values.get("friction_exponent")
    cable = bench.cables[0]
    if exponent is None or cable.wrap == 0.0 or cable.friction == 0.0:
        return ()
    low, high = (each / cable.wrap for each in exponent.ci95)
    tuned = Estimate(exponent.value / cable.wrap, "1", (low, high))
    off = tuned.value - cable.friction
    if tuned.holds(cable.friction) or abs(off) < _MIN_FRICTION_CHANGE * cable.friction:
        return ()
    statement = (
        f"friction is {format_fitted(tuned)} (95 %: {format_interval(tuned)}) with the "
        f"wrap of the scene, where {format_number(cable.friction)} is given; correct "
        "one of them."
    )
    deviations = abs(off) / max(0.5 * (high - low) / 1.96, 1e-12)
    return (Strayed("friction", cable.friction, tuned, deviations, statement),)


def _statement(
    found: LossFit,
    before: float,
    after: float,
    pair: bool,
    constants: Mapping[str, Constant],
) -> str:
    """Return the finding in sentences."""
    values = found.values
    text = [
        f"While the cable slides, the joint torque is {format_number(before)} times "
        "the noise off the friction of the scene."
    ]
    if (exponent := values.get("friction_exponent")) is not None:
        share = -math.expm1(-exponent.value)
        text.append(
            f"The loss that grows with the load is {format_share(share)} of the torque "
            f"that drives: exponent mu theta {_with_interval(exponent)}, "
            f"{format_number(found.scene['friction_exponent'])} by the scene."
        )
        driving, driven = values["exponent_driving"], values["exponent_driven"]
        text.append(
            f"With exact gains it is {_with_interval(driving)} where the motor drives "
            f"the load and {_with_interval(driven)} where the load drives the motor."
        )
        if "gain_uncertainty" in constants:
            doubt = 2.0 * math.sqrt(2.0) * constants["gain_uncertainty"].value
            low, high = values["gain"].ci95
            if low > 1.0 + doubt or high < 1.0 - doubt:
                text.append(
                    "The directions differ by more than the declared gains allow, so "
                    "friction is asymmetric or the torque constant is wrong."
                )
    if (loss := values.get("load_independent_loss")) is not None:
        stated = found.scene.get("load_independent_loss", 0.0)
        text.append(
            f"The loss that does not depend on the load is {_with_interval(loss)} N m "
            f"at the joint, {format_number(stated, loss.ci95[1] - loss.ci95[0])} by "
            "the scene."
        )
    if (total := values.get("total_loss")) is not None:
        text.append(
            f"At this load {_with_interval(total)} N m are lost at the joint in either "
            f"direction, {format_number(found.scene['total_loss'])} by the scene; how "
            "much of it grows with the load, these data cannot show."
        )
    if (drag := values.get("drag")) is not None:
        text.append(f"With speed the loss grows by {_with_interval(drag)} N m s/rad.")
    if (excess := values.get("breakaway_excess")) is not None:
        text.append(_breakaway_sentence(excess, found))
    if pair:
        text.append(
            "In a pair of taut cables pretension turns friction into a loss that does "
            "not depend on the load."
        )
    if math.isfinite(after):
        text.append(f"With this law {format_number(after)} times the noise is left.")
    if after > MAX_EXPLAINED_ERROR:
        text.append("Something else acts as well.")
    return " ".join(text)


def _breakaway_sentence(excess: Estimate, found: LossFit) -> str:
    """Describe the loss after a reversal."""
    settles = (
        f"from {format_number(found.settling)} rad after a reversal the loss is steady"
    )
    if excess.ci95[0] <= _MIN_EXCESS:
        return f"No break-away loss is seen; {settles}."
    return (
        f"{format_number(found.breakaway_at)} rad after a reversal it is larger than "
        f"while sliding by {_with_interval(excess)} of it; {settles}."
    )


def _with_interval(value: Estimate) -> str:
    """Return a number with its interval."""
    return f"{format_fitted(value)} (95 %: {format_interval(value)})"
