"""Cases in which every design is evaluated, such as a worn liner or other wearers.

    across = read_across({"wearer": "0.5,2", "friction": "0.08,0.16"}, "worst", device)
    across.cases                        # 4 of them
    across.of([3.0, 5.0, 4.0, 1.0], high=False)  # 5.0

A case changes variables of the scene, or the wearer's stiffness, in addition to a
design. Controllers are made anew for the plant of every case.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cc_mujoco._validation import require_dictionary
from cc_mujoco.design._designs import Range, grid, read_range, require_count
from cc_mujoco.design._whatif_options import Given
from cc_mujoco.device import Device, Nominal, Plant
from cc_mujoco.device._variables import CONFLICTS, VALUES, VARIABLES, Value, find, split
from cc_mujoco.errors import CableError, look_up

Case = dict[str, Value]

RANK_NAMES = {"worst": "worst", "p90": "90th percentile", "mean": "mean"}
"""Names, for readers, of the statistics that aggregate a metric over cases."""

LEAST_SUFFIX, MOST_SUFFIX, WORST_CASE_SUFFIX = "least", "most", "worst_case"
"""Behind `METRIC@`: the least and the greatest number, and the name of the worst case,
which is the first without a number where there is one."""


@dataclass(frozen=True)
class Across:
    """Cases of every design, and the aggregation of metrics over them."""

    levels: tuple[tuple[str, tuple[Value, ...]], ...] = ()  # names and their values
    rank: str = "worst"  # key of `RANK_NAMES`
    turned: tuple[str, ...] = ()  # metrics whose objective reverses their direction

    @property
    def several(self) -> bool:
        return bool(self.levels)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.levels)

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """All combinations of the levels, the last fastest; ({},) without levels."""
        return tuple(grid({name: Range(values) for name, values in self.levels}))

    def of(self, values: Sequence[float], high: bool) -> float:
        """Return a metric aggregated over the cases; NaN if one value is NaN.

        `rank` selects worst, mean or 90th percentile. The percentile is interpolated
        linearly and counts from the good end: if `high` is better, it is the 10th.
        """
        if len(values) == 1:
            return values[0]
        if self.rank == "mean":
            return float(np.mean(values))
        if self.rank == "p90":
            return float(np.quantile(values, 0.1 if high else 0.9))
        return float(np.min(values) if high else np.max(values))

    def worst(self, values: Sequence[float], high: bool) -> str:
        """Return the label of the worst case: the first NaN, else the extreme value."""
        place = np.argmin(values) if high else np.argmax(values)
        return self.label(self.cases[int(place)])

    @staticmethod
    def label(case: Mapping[str, object]) -> str:
        return ", ".join(f"{name}={format_short(v)}" for name, v in case.items())

    def aggregation(self) -> str:
        texts = [f"{n} {', '.join(map(format_short, v))}" for n, v in self.levels]
        many = f"{len(self.cases)} cases" if len(self.cases) > 1 else "1 case"
        return f"the {RANK_NAMES[self.rank]} over {many} ({'; '.join(texts)})"

    def check(self, device: Device, design: Mapping[str, object]) -> dict[str, Value]:
        """Return a design's values, checked by `Plant.check` in every case."""
        for name in design:  # a plant has more that may change
            find(name, device.cables, device.axis_cables)
        for case in self.cases:
            try:
                plant = Plant(device, {**design, **case})
                plant.check()
            except CableError as error:
                if not self.several:
                    raise
                raise CableError(f"in case {self.label(case)}, {error}") from None
        return {name: plant.values[name] for name in design}

    def layout(self, device: Device, design: Mapping[str, Value]) -> tuple[object, ...]:
        """Return a key that is equal for designs that one batch may contain."""
        return tuple(Plant(device, {**design, **c}).layout for c in self.cases)

    def require_disjoint(self, varied: Iterable[str]) -> None:
        for name in varied:
            for crossed in self.names:
                if name == crossed:
                    raise CableError(
                        f"variable {name!r} is both varied and crossed; a design sets "
                        "it, or a case does."
                    )
                if _set_same_parameter(name, crossed):
                    raise CableError(
                        f"variables {name!r}, which is varied, and {crossed!r}, which "
                        "is crossed, set the same thing; choose one of them."
                    )


def read_across(
    given: Mapping[str, Given] | None,
    rank: str | None,
    device: Nominal,
    turned: Iterable[str] = (),
) -> Across:
    """Return the cases in which designs are evaluated.

    `given` has the values of each variable, see `_designs.read_range`, and of `wearer`.
    `rank` is a key of `RANK_NAMES`, by default the worst. For `turned` see `Across`.
    """
    if rank is not None:
        look_up("rank", rank, RANK_NAMES)
    given = require_dictionary("across", given)
    if not given:
        if rank is not None:
            raise CableError(
                f"a rank, {rank!r}, needs cases to rank over, --across NAME=VALUES."
            )
        return Across()
    among = VARIABLES | {"wearer": VALUES["wearer"]}
    ranges = {n: read_range(n, v, device, among, "case") for n, v in given.items()}
    for name, values in ranges.items():
        if not values.levels:
            raise CableError(
                f"cases need to know how many values {name!r} takes; write "
                "low:high:count or a,b,c."
            )
    require_count(math.prod(len(values.levels) for values in ranges.values()))
    for one, other in itertools.combinations(ranges, 2):
        if _set_same_parameter(one, other):
            raise CableError(
                f"variables {one!r} and {other!r} set the same thing; cross one of "
                "them."
            )
    levels = tuple((name, values.levels) for name, values in ranges.items())
    return Across(levels, rank or "worst", tuple(turned))


def _set_same_parameter(name: str, other: str) -> bool:
    """Return whether two variables would set the same parameter of one cable."""
    (cable, own), (another, its) = split(name), split(other)
    if cable and another and cable != another:
        return False
    return own == its or any(own in group and its in group for group in CONFLICTS)


def format_short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
