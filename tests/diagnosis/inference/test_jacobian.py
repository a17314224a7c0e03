"""Derivatives that fits share are those of what they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.fitting import Problem, fit
from cc_mujoco.diagnosis.inference.jacobian import Jacobian
from cc_mujoco.diagnosis.inference.plant import OFFSETS, Plant, Values, tuned
from cc_mujoco.diagnosis.inference.records import Record, prepare
from cc_mujoco.estimation.least_squares import Tuned
from diagnosis.recorded import BENCH, dataset


class Recorded(NamedTuple):
    records: tuple[Record, ...]
    counts: list[NDArray[np.bool_]]
    free: tuple[Tuned, ...]


@cache
def recorded() -> Recorded:
    """Not made where tests are only collected, which every worker does."""
    records = prepare(dataset(duration=3.0), BENCH)[0]
    counts = [record.counts for record in records]
    return Recorded(records, counts, tuned(BENCH, records, {}))


@dataclass(frozen=True)
class Counted(Plant):
    """A plant that notes what it simulates."""

    played: tuple[list[Values], ...] = ([],)

    def simulate(
        self,
        values: Values,
        effects: Sequence[str] = (),
        only: Sequence[int] | None = None,
    ) -> list[FloatArray]:
        self.played[0].append(values)
        return super().simulate(values, effects, only)


def problem(plant: Plant) -> Problem:
    flat = tuple(np.full(r.measured.shape, 0.05) for r in recorded().records)
    return Problem(plant, recorded().free, (), flat, flat, 0.2)


def test_derivatives_are_differences_of_the_residual() -> None:
    records, counts, free = recorded()
    one = problem(Plant(BENCH, records, 8))
    x = np.zeros(len(free))
    found = Jacobian(one).jacobian(x, counts)
    here = one.residual(x, counts)
    for index, parameter in enumerate(free):
        step = 1e-3 if parameter.factor else 0.02
        moved = x.copy()
        moved[index] += step
        column = (one.residual(moved, counts) - here) / step
        # Friction's corners make differences depend on the step.
        exact = parameter.name in OFFSETS
        apart = np.linalg.norm(found[:, index] - column) / np.linalg.norm(column)
        assert apart < (0.02 if exact else 0.3), parameter.name


def test_what_only_a_torque_sensor_shows_needs_no_simulation() -> None:
    records, counts, free = recorded()
    plant = Counted(BENCH, records, 8, 1, ([],))
    Jacobian(problem(plant)).jacobian(np.zeros(len(free)), counts)
    sensors = sum("torque" in parameter.name for parameter in free)
    assert sensors == 4
    assert len(plant.played[0]) == 1 + len(free) - sensors


def test_fits_of_one_neighbourhood_share_their_derivatives() -> None:
    records, counts, free = recorded()
    plant = Counted(BENCH, records, 8, 1, ([],))
    one = problem(plant)
    slopes = Jacobian(one)
    first = fit(one, np.zeros(len(free)), counts, slopes=slopes)
    alone = len(plant.played[0])
    again = fit(one, first.x, counts, slopes=slopes)
    assert len(plant.played[0]) - alone < 0.5 * alone
    assert again.cost == pytest.approx(first.cost, rel=1e-2)
