"""Cases over which a design is judged: a liner that ages, wearers that differ.

    across = read_across({"wearer": "0.5,2", "friction": "0.08,0.16"}, "worst", cables)
    across.cases                        # 4 of them
    across.of([3.0, 5.0, 4.0, 1.0], high=False)  # 5.0

A case changes the plant beneath a design: variables of the scene, and how stiff the
wearer is. Controllers are made for what they drive, in every case anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cc_mujoco.checks import named
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.plant import Plant, Scene
from cc_mujoco.plant.variables import (
    CONFLICTS,
    VARIABLES,
    WEARER,
    Value,
    find,
    split,
)
from cc_mujoco.whatif.designs import Range, grid, read_range, require_count
from cc_mujoco.whatif.study_spec import Given

Case = dict[str, Value]

RANKS = {"worst": "worst", "p90": "90th percentile", "mean": "mean"}
"""Choices of a design's number among those of its cases, for a reader."""

LEAST, MOST, WORST_CASE = "least", "most", "worst_case"
"""Behind `METRIC@`: the least and the greatest number, and the name of the worst case,
which is the first without a number where there is one."""

_P90 = 0.9


@dataclass(frozen=True)
class Across:
    """The cases of every design, and what is made of its numbers in them."""

    levels: tuple[tuple[str, tuple[Value, ...]], ...] = ()
    """Names and their values; the cases are every combination, the last fastest."""
    rank: str = "worst"
    """Key of `RANKS`."""
    turned: tuple[str, ...] = ()
    """Metrics of which an objective asks for the other way than is usual."""

    @property
    def several(self) -> bool:
        """Return whether there are cases; else designs are judged as they stand."""
        return bool(self.levels)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables that are crossed."""
        return tuple(name for name, _ in self.levels)

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """Every case; one that changes nothing where there are none."""
        return tuple(grid({name: Range(values) for name, values in self.levels}))

    def of(self, values: Sequence[float], high: bool) -> float:
        """The number of a design from those in its cases; NaN where one is.

        The percentile is interpolated linearly, from the bad end: of a metric that
        should be high, it is the 10th.
        """
        if self.rank == "mean":
            return float(np.mean(values))
        if self.rank == "p90":
            return float(np.quantile(values, 1.0 - _P90 if high else _P90))
        return float(np.min(values) if high else np.max(values))

    def worst(self, values: Sequence[float], high: bool) -> str:
        """The name of the worst case; the first without a number where there is one."""
        place = np.argmin(values) if high else np.argmax(values)
        return self.label(self.cases[int(place)])

    def label(self, case: Mapping[str, Value]) -> str:
        """The name of a case."""
        return ", ".join(f"{name}={_short(value)}" for name, value in case.items())

    def told(self) -> str:
        """Describe for a reader what a number of a design is, and over which cases."""
        values = "; ".join(
            f"{name} {', '.join(map(_short, values))}" for name, values in self.levels
        )
        many = f"{len(self.cases)} cases" if len(self.cases) > 1 else "1 case"
        return f"the {RANKS[self.rank]} over {many} ({values})"

    def check(self, device: Scene, design: Mapping[str, object]) -> dict[str, Value]:
        """The design as it is used; see `Plant.check`.

        Raises:
            CableError: it is impossible, in one of the cases at least.
        """
        for name in design:  # a plant has more that may change
            find(name, device.cables)
        for case in self.cases:
            try:
                plant = Plant(device, {**design, **case})
                plant.check()
            except CableError as error:
                if not self.several:
                    raise
                raise CableError(f"in case {self.label(case)}, {error}") from None
        return {name: plant.values[name] for name in design}

    def layout(self, device: Scene, design: Mapping[str, Value]) -> tuple[object, ...]:
        """Equal for designs whose models can be in one batch, in every case."""
        return tuple(Plant(device, {**design, **c}).layout for c in self.cases)

    def require_apart(self, varied: Iterable[str]) -> None:
        """Refuse to cross what designs set.

        Raises:
            CableError: a name is both varied and crossed, or sets the same thing.
        """
        for name in varied:
            for crossed in self.names:
                if name == crossed:
                    raise CableError(
                        f"variable {name!r} is both varied and crossed; a design sets "
                        "it, or a case does."
                    )
                if _same_thing(name, crossed):
                    raise CableError(
                        f"variables {name!r}, which is varied, and {crossed!r}, which "
                        "is crossed, set the same thing; choose one of them."
                    )


def read_across(
    given: Mapping[str, Given] | None,
    rank: str | None,
    cables: Iterable[str],
    turned: Iterable[str] = (),
) -> Across:
    """Understand over which cases designs are judged.

    Args:
        given: values of each name, see `designs.read_range`; `wearer` besides.
        rank: key of `RANKS`; the worst by default.
        cables: the cables of the scene.
        turned: see `Across`.

    Raises:
        CableError: an unknown name or rank, values that cannot be, a range without a
            count, or a rank without cases.
    """
    if rank is not None:
        look_up("rank", rank, RANKS)
    given = named("across", given)
    if not given:
        if rank is not None:
            raise CableError(
                f"a rank, {rank!r}, needs cases to rank over, --across NAME=VALUES."
            )
        return Across()
    cables = tuple(cables)
    ranges = {name: _read(name, values, cables) for name, values in given.items()}
    for name, values in ranges.items():
        if not values.levels:
            raise CableError(
                f"cases need to know how many values {name!r} takes; write "
                "low:high:count or a,b,c."
            )
    require_count(math.prod(len(values.levels) for values in ranges.values()))
    names = list(ranges)
    for place, name in enumerate(names):
        for other in names[:place]:
            if _same_thing(name, other):
                raise CableError(
                    f"variables {other!r} and {name!r} set the same thing; cross one "
                    "of them."
                )
    levels = tuple((name, values.levels) for name, values in ranges.items())
    return Across(levels, rank or "worst", tuple(turned))


def _read(name: str, values: Given, cables: Sequence[str]) -> Range:
    variables = VARIABLES | {WEARER.name: WEARER}
    return read_range(name, values, cables, variables, "case")


def _same_thing(name: str, other: str) -> bool:
    """Return whether two names of variables set the same of one cable."""
    (cable, own), (another, its) = split(name), split(other)
    if cable and another and cable != another:
        return False
    return own == its or any(own in group and its in group for group in CONFLICTS)


def _short(value: Value) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
