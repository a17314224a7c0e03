"""Values of a description, with their origins: given, from the scene, assumed."""

from __future__ import annotations

import math

from cc_mujoco._utils.toml_table import Table

GIVEN, SCENE, ASSUMED = "given", "scene", "assumed"
"""Origins of a property."""


class DescriptionReader:
    """Values of a file, or defaults, whose origins are recorded."""

    def __init__(self) -> None:
        self.sources: dict[str, str] = {}

    def note(self, key: str, origin: str) -> None:
        self.sources[key] = origin

    def number(
        self,
        table: Table,
        key: str,
        default: float,
        origin: str,
        *,
        low: float = 0.0,
        high: float = math.inf,
        label: str = "",
    ) -> float:
        """Return a number of a table, or a default of some origin."""
        given = table.number(key, low)
        if given is not None and given > high:
            raise table.wrong(key, f"at most {high:.4g}, in SI units and radians")
        self.note(label + key, origin if given is None else GIVEN)
        return default if given is None else given


def rounded(value: float, digits: int = 2) -> float:
    """Return a number with few digits."""
    return float(f"{value:.{digits}g}")
