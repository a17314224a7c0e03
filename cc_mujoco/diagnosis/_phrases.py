"""Words and numbers of the report: names of verdicts, effects, channels, intervals."""

import math
from collections.abc import Callable, Iterable

from cc_mujoco.datasets._trials import Instruments
from cc_mujoco.diagnosis._verdict import Diagnosis, Gap
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._causes import CauseClass
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.report._html import list_words

TORQUE_UNIT = "N m"
SIGN_NOTE = (
    "Errors are measured minus simulated: positive where the rig shows more torque "
    "than the simulation."
)
"""Explanation of the sign of an error."""
MINUS = "\N{MINUS SIGN}"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

VERDICT_MEANINGS = {
    "named": "The model lacked what is named here. With it, the simulation comes "
    "closer to data that were not used to find it.",
    "none": "What is left of the error looks like noise. This holds for the motions "
    "and loads in the data.",
    "unknown": "No known effect brings the error down to the noise; one that is added "
    "stands in for what is really there. "
    "Where the error lies is the best hint at what it is.",
    "tie": "Each of these explains the data as well as the other, so naming one would "
    "be a guess.",
    "fix-data": "Nothing is concluded until then: a fault of the data would be taken "
    "for a missing effect.",
    "fix-numerics": "Nothing is concluded until then: an error of the numerics would "
    "be taken for a missing effect.",
}
"""Explanation of each verdict for a first-time reader."""

DATA_PREFIX = "The data must be put right first"
"""Headline of a diagnosis whose data allow no conclusion, and its first words."""
NO_SCENE_PREFIX = "scene.xml cannot be written"
"""First words of the problem that gives the reason."""
NOT_IN_SCENE_PREFIX = "scene.xml does not contain"
"""First words of the problem that names an effect missing in the written scene."""


def effect_name(effect: str) -> str:
    """Return the title of an effect; of an unknown one its id, with spaces."""
    return EFFECTS[effect].title if effect in EFFECTS else plain_name(effect)


def effect_names(effects: Iterable[str], last: str = "and") -> str:
    """Return the titles of several effects as a list in a sentence."""
    return list_words(map(effect_name, effects), last)


def class_statement(each: CauseClass) -> str:
    causes = f"{capitalise(effect_name(each.name))}: {list_words(each.causes, 'or')}"
    return f"{causes}. Torques do not distinguish them; this does: {each.separated_by}."


def plain_name(name: str) -> str:
    base, _, occasion = name.partition("@")
    text = base.replace("_", " ")
    return f"{text} on {occasion}, relative to the last occasion" if occasion else text


def channel_name(name: str) -> str:
    """Return the name of a channel: without its unit, `motor torque`."""
    return plain_name(name.removesuffix("_nm"))


def capitalise(text: str) -> str:
    """Return a sentence that begins with a capital, or as it is with a file or name."""
    first = text.partition(" ")[0].rstrip(",:;.")
    if any(sign in first for sign in "/\\._"):
        return text
    return text[:1].upper() + text[1:]


PROPOSAL_FOLLOWS = "The trial that would separate them is worked out next."
NO_TRIAL = "No trial within the limits of the data"


def continue_command(trials: str, folder: str, out: str) -> str:
    """Return the command that repeats the diagnosis in `folder` with more trials."""
    return f"cc-mujoco diagnose {trials} --continue {folder} --out {out}"


def format_odds(probability: float) -> str:
    """Return a probability as odds out of 100, "80:20"; never as certain."""
    percent = min(max(round(100.0 * probability), 1), 99)
    return f"{percent}:{100 - percent}"


def headline(diagnosis: Diagnosis) -> str:
    kind, tied = diagnosis.verdict, {name for tie in diagnosis.ties for name in tie}
    named = [effect_name(e.id) for e in diagnosis.missing if e.id not in tied]
    if kind in ("named", "tie"):
        if kind == "tie":
            named += [f"either {effect_names(tie, 'or')}" for tie in diagnosis.ties]
        remains = ""
        if math.isfinite(left := diagnosis.remaining):
            remains = f"; the remaining error is {left:.1f} times the noise floor"
        return f"Missing: {list_words(named)}{remains}"
    if kind == "unknown":
        if diagnosis.interrupted:
            return (
                "Something is missing, but the search was stopped before all was tried"
            )
        if diagnosis.question:
            return "Something is missing, or one trial was recorded differently"
        if diagnosis.effects:
            return "Something is missing that the known effects explain only in part"
    if kind == "none" and diagnosis.deviating:
        off = list_words([plain_name(each.parameter) for each in diagnosis.deviating])
        return f"Nothing else is missing, but {off} is not what the scene says"
    if kind == "none" and diagnosis.events:
        return "Nothing else is missing, but something happened once"
    return {
        "none": "Nothing is missing that these data could show",
        "unknown": "Something is missing, and no known effect takes it to the noise",
        "fix-data": DATA_PREFIX,
        "fix-numerics": "The numerics of the simulation must be put right first",
    }[kind]


def tried_sentence(diagnosis: Diagnosis) -> str:
    """Return a sentence on how many effects were searched; "" without a search."""
    if not diagnosis.runner_ups:
        return ""
    count = len({each.id for step in diagnosis.runner_ups for each in step})
    done = f"the {count} most promising were refitted"
    if count < 2:
        done = "the most promising one was refitted"
    if not count:
        done = "none was refitted, since to first order none takes enough of it"
    return f"All effects that these data can show were compared with the error; {done}."


def format_share(value: float) -> str:
    """Return a fraction in percent, or `not determined` if it is not finite."""
    if not math.isfinite(value):
        return "not determined"
    # 99.7 % must not become 100 %.
    digits = 1 if 0.99 <= value < 1.0 else 0
    return f"{_with_true_minus(f'{100 * value:.{digits}f}')} %"


def format_signed(value: float) -> str:
    """Return a number with its sign, to three digits or integers."""
    return f"{'+' if value > 0.0 else ''}{format_number(value)}"


def format_number(value: float, spread: float = math.nan) -> str:
    """Return a number with two digits of its `spread`; without, with three digits."""
    if not math.isfinite(value):
        if math.isnan(value):
            return "not determined"
        return "∞" if value > 0 else f"{MINUS}∞"
    known = math.isfinite(spread) and spread > 0
    places = _decimal_places(spread, 2) if known else _decimal_places(value, 3)
    size = max(abs(value), spread if known else 0.0)
    if size and not 1e-4 <= size < 1e6:
        power = math.floor(math.log10(size))
        shown = f"{value / 10.0**power:.{max(0, places + power)}f}"
        return f"{_with_true_minus(shown)}·10{str(power).translate(_SUPERSCRIPTS)}"
    return _with_true_minus(f"{value:.{max(0, places)}f}")


def format_size(name: str, value: float, unit: str) -> str:
    """Return the size of a parameter with its name and unit."""
    return f"{plain_name(name)} {format_number(value)} {unit}".removesuffix(" 1")


def format_interval(value: Estimate) -> str:
    """Return the 95 % interval of a fitted number, without its unit."""
    low, high = value.ci95
    if math.isnan(low) or math.isnan(high):
        return "not determined"
    return f"{format_number(low, high - low)} to {format_number(high, high - low)}"


def format_fitted(value: Estimate) -> str:
    """Return a fitted number, without its unit, as precisely as its interval allows."""
    low, high = value.ci95
    return format_number(value.value, high - low)


def format_estimate(value: Estimate, unit: str = "") -> str:
    """Return a fitted number, a unit and its 95 % interval."""
    return f"{format_fitted(value)}{unit} (95 %: {format_interval(value)})"


def gap_sentence(name: str, gap: Gap) -> str:
    sizes = gap.rmse_before, gap.rmse_after, gap.noise_floor
    before, after, floor = (
        f"{format_number(value, gap.noise_floor)} {TORQUE_UNIT}" for value in sizes
    )
    title = capitalise(channel_name(name))
    if not (math.isfinite(gap.rmse_before) and math.isfinite(gap.rmse_after)):
        return f"{title}: the error could not be determined."
    start = f"{title}: the weighted RMS error"
    ground = f"the noise floor is {floor}"
    if gap.rmse_after == gap.rmse_before:
        return f"{start} is {before}; {ground}."
    change = "falls" if gap.rmse_after < gap.rmse_before else "rises"
    text = f"{start} {change} from {before} to {after}; {ground}"
    if not math.isfinite(gap.gap_closed):
        return f"{text}; there is no gap above it to close."
    # Below the floor, which is an estimate, there is no more to close.
    closed, low, high = (min(value, 1.0) for value in (gap.gap_closed, *gap.ci95))
    within = ""
    if math.isfinite(low) and math.isfinite(high):
        within = f" (95 % interval {format_share(low)} to {format_share(high)})"
    return f"{text}; {format_share(closed)} of the RMS error above it is gone{within}."


def _decimal_places(value: float, digits: int) -> int:
    return digits - 1 - math.floor(math.log10(abs(value))) if value else digits - 1


def _with_true_minus(text: str) -> str:
    """Return a number's text with a typographic minus sign, and none before zero."""
    if not text.startswith("-"):
        return text
    return text[1:] if not text.strip("-0.") else MINUS + text[1:]


Progress = Callable[[float, str], None]


def no_progress(share: float, doing: str) -> None:
    """Ignore the progress."""


def part_of(progress: Progress, start: float, length: float) -> Progress:
    """Return a callback that maps 0 to 1 to a part of the progress of another."""
    return lambda share, doing: progress(start + length * share, doing)


_ENDS_HELD = (
    "Forces at both ends, ends held while drum or conduit moves. These data can show "
    "friction by load, speed, direction and rest, its differences between the ends, "
    "and stretch and play where the motion reverses. They cannot show pulleys, their "
    "ratio and eccentricity, or anything at a motor or a joint. Pretension is known "
    "only as the mean tension."
)
_ANGLES_ONLY = (
    "Angles only, with a declared load. These data can show play, lag, the stretch as "
    "a whole, and friction as far as the joint stays behind the motor. They cannot "
    "show where it stretches: soft ends look like less pretension or a softer cable. "
    "Nor can they show the torque of a motor, or a force more exactly than the load is "
    "declared."
)
_MOTION_ONLY = (
    "Angles only, without a torque or a known load. These data can show a dead zone, a "
    "lag, and the ratio of the drive. They cannot show what makes them (play, stretch "
    "against friction, drag, a late sensor), nor any friction, stiffness or pretension."
)
_NO_MOTOR_ANGLE = (
    "Torques at both ends without the motor's angle. While the whole cable slides, "
    "these data can show its loss by direction and load, a drag, and a break-away loss "
    "after reversals. They cannot show stretch, play, slack or pretension, where the "
    "loss arises, or anything that depends on the motor's angle. The loss of motor and "
    "gear is part of it where the torque follows from a current or a command."
)
_ARM_BY_PAIRS = (
    "The moment arm at the joint follows from angle pairs. These data cannot tell an "
    "error of the pairs from an eccentric pulley or a wrap that grows with the angle."
)
_MOTOR = {
    None: "The motor's torque is not measured. The joint's torque can show friction, "
    "stretch and play. It cannot show what acts between motor and cable (cogging, "
    "inertia, seals at that end), or tell friction in the cable from a difference of "
    "pretension.",
    "motor current": "The motor's torque follows from its current. Friction and drag "
    "of motor and gear are fitted, so these data cannot show seals, or a part of the "
    "drag in the conduit of the same size.",
    "load cells": "At the motor the tension is measured. These data cannot show "
    "cogging or inertia of the motor.",
}
"""Statement by the instrument of the motor's torque."""
_JOINT = {
    None: "The joint's torque is not measured. The motor's torque can show friction, "
    "stretch and play. It cannot show what acts at the joint (gravity, springs, "
    "inertia, seals at that end), or on which side of the cable a loss occurs.",
    "known load": "The joint's torque follows from its motion and the declared load. "
    "These data cannot tell a load that differs from its declaration from a spring or "
    "an inertia that is missing.",
    "load cells": "At the joint the tension is measured. These data cannot show "
    "gravity, springs or inertia at the joint.",
}
"""Statement by the instrument of the joint's torque."""


def describe_mode(
    instruments: Instruments,
    ends_held: bool = False,
    arm_by_pairs: bool = False,
    motor_angle: bool = True,
) -> str:
    """Return what the instruments can and cannot show; "" for two torque sensors."""
    if not motor_angle:
        return _NO_MOTOR_ANGLE
    if ends_held:
        return _ENDS_HELD
    if not instruments.rows:
        return _MOTION_ONLY
    found = [_MOTOR.get(instruments.motor, ""), _JOINT.get(instruments.joint, "")]
    if instruments == Instruments(None, "known load"):
        found = [_ANGLES_ONLY]
    if arm_by_pairs:
        found.append(_ARM_BY_PAIRS)
    return " ".join(each for each in found if each)
