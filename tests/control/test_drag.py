"""Friction that needs no tension: what one cable pulls too much cannot be paid out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import tensions
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._cable_model import joint_spring
from cc_mujoco.control._controller import motor_limits
from control.devices import single
from control.friction_terms import DRAG, LARGE, SHARES, designs, play, sized

DT, LIMITS = 0.003, motor_limits(single())


@given(
    term=st.sampled_from(DRAG),
    share=st.floats(1e-3, 1.0),
    moved=st.floats(-2e-3, 2e-3),
    wanted=st.floats(0.0, 30.0),
)
def test_a_cable_is_paid_out_to_the_nearest_torque_that_can_be_reached(
    term: str, share: float, moved: float, wanted: float
) -> None:
    """And no further; the state that is left is that of the angle."""
    (own,) = single().cables
    cable = own.cable.replace(**sized(LARGE[term], share))
    cables = stepper.make_cables([cable], [own.proximal], [own.distal])
    start = stepper.rest_states(cables, 0.0, 0.0)
    new, leapt = np.zeros_like(start), np.zeros_like(start)
    work, tolerance = stepper.scratch(cables), 0.01
    spring = joint_spring([dataclasses.replace(own, cable=cable)], LIMITS)
    rise = spring[guard.STIFFNESS]

    def pull(paid: float) -> float:
        stepper.move(cables, start, -paid, moved, DT, leapt, work)
        return max(float(tensions(leapt[0], cable.segments)[-1]), 0.0)

    search = rollout.MotorSearch(
        cables, start, new, leapt, work, np.zeros(1), DT, rise, tolerance, 0.0, False
    )
    found = -rollout.find_motor_angle(search, 0.0, -1.0, moved, moved, wanted)
    assert found >= 0.0
    left = pull(found)
    if found > 0.0:
        assert max(float(tensions(new[0], cable.segments)[-1]), 0.0) == left
    reached = [pull(paid) for paid in np.linspace(0.0, 0.05, 101)]
    if pull(0.0) > wanted:
        best = min(one for one in reached if one >= wanted - tolerance) - wanted
        assert abs(left - wanted) <= best + 0.02 * left + 3.0 * tolerance
        # No slack at the motor, up to what the tolerance is of the end's stiffness.
        assert float(tensions(new[0], cable.segments)[0]) > -1.0
    else:
        assert found == 0.0


@pytest.mark.parametrize("term", DRAG)
def test_slack_at_the_motor_leaves_the_pull_of_known_drag_as_it_is(term: str) -> None:
    """It is paid out further by what the slack stretches the cable by."""
    (own,) = single().cables
    cable = own.cable.replace(**sized(LARGE[term], 0.1))
    cables = stepper.make_cables([cable], [own.proximal], [own.distal])
    start = stepper.rest_states(cables, 0.0, 0.0)
    new, leapt = np.zeros_like(start), np.zeros_like(start)
    work, tolerance, slack = stepper.scratch(cables), 0.01, 2.0
    spring = joint_spring([dataclasses.replace(own, cable=cable)], LIMITS)
    rise = spring[guard.STIFFNESS]

    def left(slack: float) -> tuple[float, float]:
        search = rollout.MotorSearch(
            cables, start, new, leapt, work, np.zeros(1), DT, rise, tolerance, slack,
            False,
        )  # fmt: skip
        found = rollout.find_motor_angle(search, 0.0, -1.0, 0.0, 0.0, 0.0)
        return -found, float(tensions(new[0], cable.segments)[-1])

    (taut, pull), (paid, left_pull) = left(0.0), left(slack)
    assert pull > 1.0
    assert left_pull == pytest.approx(pull, abs=tolerance)
    assert paid - taut == pytest.approx(slack / rise, rel=0.02)


def test_a_drag_that_is_known_leaves_no_more_than_it_has_to() -> None:
    """The motor stood still, and a walking ankle was pulled with 90 N m."""
    cases = designs("ankle", ["load-independent"], [0.02])
    (row,) = play("ankle", "predictive", cases, True, 1.7)
    assert row.passed
    assert row.rms_error < 0.5


def test_a_drag_that_is_not_known_is_not_paid_out_for_without_an_end() -> None:
    """It was: the error was 3.9 N m, and 2.9 of a controller that knows the seals."""
    cases = designs("ankle", ["seals"], [1.0])
    (row,) = play("ankle", "predictive", cases, False, 2.2)
    assert row.passed
    assert row.rms_error < 3.3


def test_a_drag_is_added_to_what_is_fed_forward_and_not_multiplied() -> None:
    """As part of the gain it pulled the ankle with 44 N m, where 30 were desired."""
    (row,) = play("ankle", "model", designs("ankle", ["seals"], [1.0]), True, 1.3)
    assert row.passed


@pytest.mark.study
@pytest.mark.parametrize("scene", ("wrist", "ankle", "finger"))
@pytest.mark.parametrize("law", [law for law in CONTROLLERS if law != "none"])
def test_no_friction_makes_a_controller_unsafe(scene: str, law: str) -> None:
    """Unless friction alone does.

    Nearer than that to the desired torque only controllers stay that know friction: the
    others make up for it late, and add it to the desired torque once the motion turns.
    """
    cases = designs(scene, list(LARGE), SHARES)
    for known in (True, False):
        for row in play(scene, law, cases, known, 3.0):
            assert row.stayed_safe, row
