"""Features of a motion: direction, travel since a reversal, rests."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.signals import Signals, held

DT, RADIUS = 0.004, 0.05


def test_rest_keeps_the_direction_of_the_last_motion(there_and_back: Signals) -> None:
    direction = there_and_back.direction
    assert direction[100] == direction[350] == 1.0
    assert direction[600] == -1.0
    assert direction[900] == 1.0


def test_travel_starts_anew_where_the_motion_turns(there_and_back: Signals) -> None:
    travel = there_and_back.travel
    assert travel[550] == pytest.approx(RADIUS * 0.4, abs=RADIUS * 0.01)
    assert travel[800] == pytest.approx(RADIUS * 0.4, abs=RADIUS * 0.01)


def test_a_rest_is_remembered_while_the_next_motion_lasts(
    there_and_back: Signals,
) -> None:
    assert there_and_back.rested[100] == 0.0
    assert there_and_back.rested[600] == pytest.approx(0.8, abs=2 * DT)
    # A turn without a pause is no rest.
    assert there_and_back.rested[900] == pytest.approx(0.8, abs=2 * DT)
    assert there_and_back.since_rest[900] == pytest.approx(RADIUS * 1.8, rel=0.01)


def test_speed_is_that_of_the_rim(there_and_back: Signals) -> None:
    assert there_and_back.speed[100] == pytest.approx(RADIUS)


def test_what_is_held_is_the_first_value_until_one_is_taken() -> None:
    values = np.array([3.0, 4.0, 5.0, 6.0])
    taken = np.array([False, False, True, False])
    np.testing.assert_array_equal(held(values, taken), [3.0, 3.0, 5.0, 5.0])
