"""Classes of physical causes that make the same torques at the same angles.

A verdict that names an effect, or a tuned parameter that deviates, means any of them.
Two effects with the same causes have them where the data do not decide between both.
"""

import csv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class CauseClass:
    """Physical causes for which an effect or a tuned parameter stands."""

    name: str  # id of the effect, or name of the parameter
    causes: tuple[str, ...]  # in words
    separated_by: str  # what distinguishes them


_TEXT = (Path(__file__).parents[1] / "causes.csv").read_text(encoding="utf-8")
CLASSES = {
    name: CauseClass(name, tuple(causes.split("; ")), how)
    for names, causes, how in [*csv.reader(_TEXT.splitlines())][1:]
    for name in names.split("; ")
}
"""Classes by id of an effect or name of a parameter."""
