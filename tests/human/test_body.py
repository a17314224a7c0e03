"""Wearers of another size: what goes with mass and leg length, and how."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.errors import CableError
from cc_mujoco.human import Body, Pace, Walk
from cc_mujoco.human._pace import MAX_SPEED, MEASURED_SPEED, MIN_SPEED

GRAVITY = 9.81
legs = st.floats(0.75, 1.05)


def test_the_wearer_of_the_scenes_changes_nothing() -> None:
    same = Body(Body.mass, Body.leg)
    assert (same.time, same.moment, same.longer, same.heavier) == (1.0, 1.0, 1.0, 1.0)
    assert Walk.at(1.3, same) == Walk.at(1.3)
    assert Walk.at(None) == Walk()


@given(mass=st.floats(40.0, 130.0), leg=legs, share=st.floats(0.0, 1.0))
def test_people_of_one_froude_number_walk_alike(
    mass: float, leg: float, share: float
) -> None:
    """Dimensionless speed, stride time and moment are those of the scenes' wearer."""
    there = MIN_SPEED + share * (MAX_SPEED - MIN_SPEED)
    body = Body(mass, leg)
    speed = min(max(there * body.time, MIN_SPEED * body.time), MAX_SPEED * body.time)
    try:
        walk = Walk.at(speed, body)
    except CableError:  # rounding, at an end
        return
    one = Walk.at(walk.speed)
    assert speed / math.sqrt(GRAVITY * leg) == pytest.approx(
        walk.speed / math.sqrt(GRAVITY * Body.leg)
    )
    assert walk.period * math.sqrt(GRAVITY / leg) == pytest.approx(
        one.period * math.sqrt(GRAVITY / Body.leg)
    )
    assert body.moment / (mass * leg) == pytest.approx(1.0 / (Body.mass * Body.leg))


def test_a_longer_leg_walks_slower_steps_through_the_same_angles() -> None:
    rng = np.random.default_rng(0)
    walk = Walk.at(None, Body(leg=1.05))
    one = Walk().sample(1.0 + 3 * Walk().period, 1e-3, rng)
    other = walk.sample(1.0 + 3 * walk.period, 1e-3, rng)
    assert walk.period == pytest.approx(Walk().period * math.sqrt(1.05 / Body.leg))
    assert np.abs(one.angle).max() == pytest.approx(np.abs(other.angle).max(), 1e-4)
    assert np.abs(one.velocity).max() > np.abs(other.velocity).max()
    assert Body(leg=1.05).pace() == Pace(MEASURED_SPEED)


def test_a_speed_that_such_legs_are_not_known_to_walk_is_refused() -> None:
    with pytest.raises(
        CableError, match=r"legs of 0\.75 m .* 1\.6 m/s; .*1\.438\] m/s"
    ):
        Walk.at(1.6, Body(leg=0.75))
    with pytest.raises(CableError, match="speed"):
        Walk.at(2.0)


@given(leg=legs)
def test_the_ends_of_speed_that_are_told_can_be_walked(leg: float) -> None:
    body = Body(leg=leg)
    if leg == Body.leg:
        return
    with pytest.raises(CableError) as caught:
        body.pace(3.0)
    told = re.search(r"\[(.*), (.*)\] m/s", str(caught.value))
    assert told is not None
    for end in told.groups():
        assert MIN_SPEED <= body.pace(float(end)).speed <= MAX_SPEED


@pytest.mark.parametrize("wrong", [{"mass": 20.0}, {"leg": 1.3}, {"mass": math.nan}])
def test_bodies_of_no_adult_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(CableError, match=next(iter(wrong))):
        Body(**wrong)


def test_segments_are_those_of_winter() -> None:
    """Thigh, and foot and leg of Table 4.1, whole leg 0.161 of the body."""
    assert sum(Body.SEGMENTS.values()) == pytest.approx(0.161)
