"""Four answers on an unknown effect: which end, which trials, growing with what, next.

They are all that these data show of an effect without a name, and what a person needs
to find it by hand.
"""

from __future__ import annotations

from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_share,
    plain_name,
)
from cc_mujoco.diagnosis._verdict import Diagnosis, TrialError
from cc_mujoco.report._html import list_words

CONCENTRATED_SHARE = 0.5
"""Share of the squared error beyond noise that the worst trials make together."""
_MAX_TRIALS = 3
_MAX_AXES = 2

MOTOR_ONLY = (
    "one trial with the cables off (`unhooked = true`): what is left then is the motor "
    "and its sensor"
)
JOINT_ONLY = (
    "one trial with the cables off and the joint moved by hand (`unhooked = true`): "
    "what is left then is the joint and its sensor"
)
CABLE_ALONE = (
    'one trial with the joint held fast (`locked = "joint"`) at the same tensions: if '
    "the error stays, it is in the cables or the motor, else at the joint"
)
BY_AXIS = {
    "acceleration": "strokes of one top speed, short and sudden, long and gentle",
    "travel": "strokes of 1, 10 and 50 % of the range around one angle",
    "direction": "slow strokes both ways with the same load in each",
    "speed": "the same motion at half and at twice the speed, both with little tension",
    "torque": "the same motion with no load and with twice the load",
    "tension": "the same motion at half and at twice the pretension",
    "pretension": "the same motion at half and at twice the pretension",
    "angle": "slow strokes over a tenth of the range, around two different angles",
    "order": "the first trial again, now and after an hour",
    "time": "one trial of several minutes at one speed, and the first trial again",
    "temperature": "the first trial again, cold and warm, with `temperature_c`",
    "rest": "one motion with rests of 1, 10 and 60 s before each stroke",
}
"""Trials that show alone what grows with a quantity, by a word of its name."""


def four_answers(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the questions on an unknown effect with their answers."""
    return [
        ("Which channel and end?", _which_end(diagnosis)),
        ("Which trials?", _which_trials(diagnosis)),
        ("Growing with what?", _growing_with(diagnosis)),
        ("What shows it alone?", capitalise(isolating_trial(diagnosis)) + "."),
    ]


def _which_end(diagnosis: Diagnosis) -> str:
    if not diagnosis.gap:
        return "No torque could be compared."
    after = bool(diagnosis.effects)
    sizes = {
        name: (gap.rmse_after if after else gap.rmse_before) / gap.noise_floor
        for name, gap in diagnosis.gap.items()
    }
    each = list_words(
        [f"{channel_name(name)} {size:.1f}" for name, size in sizes.items()]
    )
    most = max(sizes, key=lambda name: sizes[name])
    others = [size for name, size in sizes.items() if name != most]
    off = f"Errors over the noise floor: {each}."
    if not others or max(others) > 0.5 * sizes[most]:
        return f"{off} No single end has most of it."
    end = "motor" if most.startswith("motor") else "joint"
    return f"{off} It is mostly at the {end}'s end."


def _which_trials(diagnosis: Diagnosis) -> str:
    shares = _trial_shares(diagnosis)
    if len(shares) < 2:
        return "There is one trial only."
    ranked = sorted(shares.items(), key=lambda each: -each[1])
    worst = ranked[: min(_MAX_TRIALS, len(ranked) // 2)]
    words = list_words([f"{name} ({format_share(share)})" for name, share in worst])
    together = sum(share for _, share in worst)
    where = "Mostly" if together >= CONCENTRATED_SHARE else "All of them; most"
    return f"{where} in {words}; in brackets the share of the squared error."


def _trial_shares(diagnosis: Diagnosis) -> dict[str, float]:
    """Return the share of each trial in the squared error beyond noise."""

    def beyond(trial: TrialError) -> float:
        misfit = trial.misfit_after if diagnosis.effects else trial.misfit_before
        return max(misfit**2 - 1.0, 0.0)

    whole = sum(map(beyond, diagnosis.trials))
    if whole == 0.0:
        return {}
    return {trial.trial: beyond(trial) / whole for trial in diagnosis.trials}


def _growing_with(diagnosis: Diagnosis) -> str:
    found: dict[str, float] = {}
    for each in diagnosis.where:
        if each.axis != "channel":
            found.setdefault(each.axis, each.share_of_error)
    if not found:
        return "With nothing that was recorded, beyond chance."
    ranked = sorted(found.items(), key=lambda each: -each[1])[:_MAX_AXES]
    words = [
        f"{plain_name(axis)} ({format_share(share)} of the squared error)"
        for axis, share in ranked
    ]
    return capitalise(list_words(words)) + "."


def isolating_trial(diagnosis: Diagnosis) -> str:
    """Return the trial that shows an unknown effect alone, as a clause."""
    axes = [each.axis for each in diagnosis.where if each.axis != "channel"]
    for axis in axes[:1]:
        for word, trial in BY_AXIS.items():
            if word in axis:
                return trial
    sizes = {
        name: gap.rmse_before / gap.noise_floor for name, gap in diagnosis.gap.items()
    }
    if len(sizes) < 2:
        return CABLE_ALONE
    most, least = max(sizes.values()), min(sizes.values())
    if most < 2.0 * least:
        return CABLE_ALONE
    worst = max(sizes, key=lambda name: sizes[name])
    return MOTOR_ONLY if worst.startswith("motor") else JOINT_ONLY
