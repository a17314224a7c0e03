"""Words and numbers of the report: what a verdict, a channel or an interval is called.

    names = Names({"stribeck_friction": "Stribeck friction"})
    headline(diagnosis, names)   # "Missing: Stribeck friction"

Nothing here knows of HTML or of figures.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from cc_mujoco.diagnosis.verdict import Diagnosis, Gap
from cc_mujoco.estimation.least_squares import Estimate
from cc_mujoco.page import listed

TORQUE_UNIT = "N m"
SIGN = (
    "Errors are measured minus simulated: positive where the rig shows more torque "
    "than the simulation."
)
"""What the sign of an error means."""
MINUS = "\N{MINUS SIGN}"

MEANING = {
    "named": "The model lacked what is named here. With it, the simulation comes "
    "closer to data that were not used to find it.",
    "none": "What is left of the error looks like noise. This holds for the motions "
    "and loads in the data.",
    "unknown": "No known effect explains enough of the error; one that is added takes "
    "the place of what is really there. "
    "Where the error lies is the best hint at what it is.",
    "tie": "Each of these explains the data as well as the other, so naming one would "
    "be a guess.",
    "fix-data": "Nothing is concluded until then: a fault of the data would be taken "
    "for a missing effect.",
    "fix-numerics": "Nothing is concluded until then: an error of the numerics would "
    "be taken for a missing effect.",
}
"""What a verdict means to someone who sees one for the first time."""


NO_SCENE = "scene.xml cannot be written"
"""Beginning of the problem that says why."""
NOT_IN_SCENE = "scene.xml does not contain"
"""Beginning of the problem that names an effect that the written scene lacks."""


class Names:
    """Names of effect ids in sentences.

    Args:
        titles: id to name; an id that is not in it has its underscores replaced.
    """

    def __init__(self, titles: Mapping[str, str] | None = None) -> None:
        self._titles = dict(titles or {})

    def __call__(self, effect: str) -> str:
        """Name of one effect."""
        return self._titles.get(effect, plain(effect))

    def list(self, effects: Iterable[str], last: str = "and") -> str:
        """Names of several effects, as a sentence lists them."""
        return listed([self(effect) for effect in effects], last)


def plain(name: str) -> str:
    """Name of a parameter or a key with spaces for underscores."""
    return name.replace("_", " ")


def channel(name: str) -> str:
    """Return the name of a channel: without its unit, `motor torque`."""
    return plain(name.removesuffix("_nm"))


def capital(text: str) -> str:
    """Return the same with a capital first letter."""
    return text[:1].upper() + text[1:]


def headline(diagnosis: Diagnosis, names: Names) -> str:
    """The verdict as one line."""
    tied = {name for group in diagnosis.ties for name in group}
    named = [found.id for found in diagnosis.missing if found.id not in tied]
    remains = ""
    if math.isfinite(diagnosis.remaining):
        remains = f"; {diagnosis.remaining:.1f} times the noise remain"
    if diagnosis.verdict == "named":
        return f"Missing: {names.list(named)}{remains}"
    if diagnosis.verdict == "tie":
        rivals = [f"either {names.list(group, 'or')}" for group in diagnosis.ties]
        return f"Missing: {listed([*map(names, named), *rivals])}{remains}"
    if diagnosis.verdict == "unknown" and diagnosis.question:
        return "Something is missing, or one trial was recorded otherwise"
    if diagnosis.verdict == "unknown" and diagnosis.effects:
        return "Something is missing that the known effects explain only in part"
    if diagnosis.verdict == "none" and diagnosis.strayed:
        off = listed([plain(each.parameter) for each in diagnosis.strayed])
        return f"Nothing else is missing, but {off} is not what the scene says"
    return {
        "none": "Nothing is missing that these data could show",
        "unknown": "Something is missing, and it is none of the known effects",
        "fix-data": "The data must be put right first",
        "fix-numerics": "The numerics of the simulation must be put right first",
    }[diagnosis.verdict]


def tried(diagnosis: Diagnosis) -> str:
    """Return how many of the known effects were screened and refitted, as a sentence.

    It is empty where the search did not begin.
    """
    if not diagnosis.runner_ups:
        return ""
    refitted = {each.id for step in diagnosis.runner_ups for each in step}
    start = "All effects that these data can show were compared with the error; "
    if not refitted:
        return (
            f"{start}none was refitted, since to first order none takes enough of it."
        )
    count = len(refitted)
    return (
        f"{start}the {count} most promising were refitted."
        if count > 1
        else (f"{start}the most promising one was refitted.")
    )


def share(value: float) -> str:
    """A share of 1 in percent; an impossible one is `not determined`."""
    if not math.isfinite(value):
        return "not determined"
    # 99.7 % must not become all of it.
    digits = 1 if 0.99 <= value < 1.0 else 0
    return f"{_signed(f'{100 * value:.{digits}f}')} %"


def number(value: float, spread: float = math.nan) -> str:
    """A number with the digits it deserves.

    Args:
        value: to write.
        spread: width of its uncertainty, of which two digits are kept; without one the
            number has three significant digits.
    """
    if not math.isfinite(value):
        if math.isnan(value):
            return "not determined"
        return "∞" if value > 0 else f"{MINUS}∞"
    known = math.isfinite(spread) and spread > 0
    places = _places(spread, 2) if known else _places(value, 3)
    size = max(abs(value), spread if known else 0.0)
    if size and not 1e-4 <= size < 1e6:
        power = math.floor(math.log10(size))
        digits = max(0, places + power)
        return f"{_signed(f'{value / 10.0**power:.{digits}f}')}·10{_superscript(power)}"
    return _signed(f"{value:.{max(0, places)}f}")


def interval(value: Estimate) -> str:
    """The 95 % interval of a fitted number, without its unit."""
    low, high = value.ci95
    if math.isnan(low) or math.isnan(high):
        return "not determined"
    return f"{number(low, high - low)} to {number(high, high - low)}"


def fitted(value: Estimate) -> str:
    """A fitted number, without its unit, as precisely as its interval allows."""
    low, high = value.ci95
    return number(value.value, high - low)


def gap_sentence(name: str, gap: Gap) -> str:
    """Describe what became of the error of one channel on held-out data."""
    before, after, floor = (
        number(value, gap.noise_floor)
        for value in (gap.rmse_before, gap.rmse_after, gap.noise_floor)
    )
    if not math.isfinite(gap.rmse_before) or not math.isfinite(gap.rmse_after):
        return f"{capital(channel(name))}: the error could not be determined."
    start = f"{capital(channel(name))}: the weighted RMS error"
    ground = f"the noise floor is {floor} {TORQUE_UNIT}"
    if gap.rmse_after == gap.rmse_before:
        return f"{start} is {before} {TORQUE_UNIT}; {ground}."
    change = "falls" if gap.rmse_after < gap.rmse_before else "rises"
    text = f"{start} {change} from {before} {TORQUE_UNIT} to {after} {TORQUE_UNIT}; "
    if not math.isfinite(gap.gap_closed):
        return f"{text}{ground}; there is no gap above it to close."
    # Below the floor, which is an estimate, there is no more to close.
    closed, low, high = (min(value, 1.0) for value in (gap.gap_closed, *gap.ci95))
    within = ""
    if math.isfinite(low) and math.isfinite(high):
        within = f" (95 % interval {share(low)} to {share(high)})"
    return f"{text}{ground}; {share(closed)} of the gap is closed{within}."


def _places(value: float, digits: int) -> int:
    """Decimal places that leave this many significant digits."""
    return digits - 1 - math.floor(math.log10(abs(value))) if value else digits - 1


def _signed(text: str) -> str:
    """Return the same with a true minus sign, and none at all on a rounded zero."""
    if not text.startswith("-"):
        return text
    return text[1:] if not text.strip("-0.") else MINUS + text[1:]


def _superscript(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
