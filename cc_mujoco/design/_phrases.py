"""Names and numbers of a study, written for a reader."""

from __future__ import annotations

from collections.abc import Sequence

from cc_mujoco.design._protocol import known_metric
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX
from cc_mujoco.device._variables import VALUES, split

UNKNOWN_REASON = (
    "no variation, too few designs, or designs left out are not predicted by the others"
)
"""Why it may be unknown what a metric depends on."""


SLOPES_NOTE = (
    "How much each number changes at the best design for a tenth of a variable's range "
    "more, or over the neighbouring values where only some are allowed: by designs a "
    "fiftieth of the range to either side (column “tried”). Behind ± stands half the "
    "difference between the two sides; where it is as large as the change itself, the "
    "number bends there and the slope says little."
)
"""Explanation of the table of slopes."""
PRICES_NOTE = (
    "What moving by up to a tenth of every range should bring by these slopes (a "
    "linear program), the other objectives no worse, and what it brought when it was "
    "simulated: with the limits as they are, and with each relaxed by a tenth of its "
    "size. A shadow price is what one unit of a limit is worth; a limit that does not "
    "bind is worth nothing here. Where the simulated number is not better than now, "
    "the slopes promise too much; where it is better with the limits as they are, and "
    "keeps the rest, the best design was not yet the optimum. “Keeps the rest” allows "
    "another objective to be 1 % worse."
)
"""Explanation of the table of prices."""


def unit_of(name: str) -> str:
    name, _, of = name.partition("@")
    if of == WORST_CASE_SUFFIX:
        return ""
    thing = known_metric(name) or VALUES.get(split(name)[1])
    return "" if thing is None or thing.unit == "1" else thing.unit


def column_title(name: str) -> str:
    unit = unit_of(name)
    return f"{name} [{unit}]" if unit else name


def format_cell(value: object) -> str:
    """Return a value to three significant digits, `-` if there is none."""
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def plain_name(name: str) -> str:
    """Return a name as it is written in a sentence, that of an axis as `hip: ...`."""
    owner, own = split(name)
    text = own.replace("_", " ")
    return f"{owner}: {text}" if owner else text


def format_quantity(name: str, value: object) -> str:
    """Return a value with its unit, as it is written in a sentence."""
    unit, text = unit_of(name), format_cell(value)
    return f"{text} {unit}" if unit and value is not None else text


def index_text(share: float, error: float | None, form: str = ".3f") -> str:
    """Return an index as text, with its error unless it is exact."""
    if error is None:
        return f"{share:{form}}"
    return f"{share:{form}} ± {error:{form}}" if share else f"- ± {error:{form}}"


def describe_controllers(controllers: Sequence[str]) -> str:
    if len(controllers) == 1:
        return f"controller {controllers[0]}"
    names = ", ".join(controllers)
    return f"for each design the best by tracking of controllers {names}"
