"""Friction that controllers expect against that of the cable itself, term by term."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cable.terms_on import TERMS_ON
from cc_mujoco.cable import Cable, Conduit
from cc_mujoco.cable._cable import TERMS
from cc_mujoco.control import CableModel
from cc_mujoco.control import _compensation as compensation
from control.devices import cable, pull_pull, single

PERIOD, SPEED = 1e-3, 0.05  # [s], of the cable at the motor [m/s]
GUIDED = [name for name, term in TERMS.items() if term.acts_on != "pulley"]
DRAG = [name for name in GUIDED if TERMS[name].acts_on == "drag"]
COEFFICIENT = [name for name in GUIDED if TERMS[name].acts_on == "coefficient"]


def on(name: str) -> dict[str, float]:
    """Return a term at the size of the first case that has it."""
    sized = {"friction": 0.2, "eccentricity": 2e-3, "ovality": 5e-4}
    cases = [{name: sized[name]}] if name in sized else list(TERMS_ON.values())
    return next(case for case in cases if name in case)


class Pair:
    """A cable driven at the motor and loaded at the joint, and the model of a law."""

    def __init__(self, own: Cable) -> None:
        drive = single()
        cables = (dataclasses.replace(drive.cables[0], cable=own),)
        self.model = CableModel(dataclasses.replace(drive, cables=cables))
        self.conduit, self.place = Conduit(own), 0.0

    def step(self, speed: float, pull: float, dt: float = PERIOD) -> None:
        """Tell the model of the cable as it is, and move the cable at the motor."""
        self.model.follow(-self.place, self.conduit.tension_distal)
        self.place += speed * dt
        self.conduit.step(dt, u_proximal=self.place, tension_distal=pull)

    def expected(self, speed: float, pull: float) -> tuple[float, float]:
        """Return the tensions at the motor that both laws expect of full slip [N]."""
        (one,) = self.model.models
        sense = 1.0 if speed < 0.0 else -1.0
        return (
            compensation.dynamic(one, -speed, pull),
            compensation.full_slip_torque(one, sense, -speed, pull),
        )


def slide(way: float, **terms: float) -> tuple[float, float, float]:
    """Return what both laws expect in steady slip, and the tension of the cable [N]."""
    both = Pair(cable(0.1).replace(**terms))
    for _ in range(600):
        both.step(way * SPEED, 20.0)
    assert (both.conduit.direction == way).all()
    return *both.expected(way * SPEED, 20.0), both.conduit.tension_proximal


@pytest.mark.parametrize("name", GUIDED)
def test_a_law_knows_the_friction_of_a_cable_that_slides(name: str) -> None:
    """To rounding; the gain of `dynamic` is a step old where friction varies."""
    for way in (1.0, -1.0):
        dynamic, slip, right = slide(way, **on(name))
        assert slip == pytest.approx(right, rel=1e-9)
        assert dynamic == pytest.approx(right, rel=1e-3)
        if TERMS[name].acts_on != "elasticity" and name != "static_friction":
            assert abs(right / slide(way)[2] - 1.0) > 1e-3


@pytest.mark.parametrize("name", COEFFICIENT)
def test_drag_adds_to_friction_as_in_the_cable(name: str) -> None:
    """Viscous drag is that of the joint's speed, while the stretch still changes."""
    for drag in DRAG:
        for way in (1.0, -1.0):
            dynamic, slip, right = slide(way, **on(name), **on(drag))
            exact = "rate" not in TERMS[drag].depends_on
            assert slip == pytest.approx(right, rel=1e-9 if exact else 5e-3)
            assert dynamic == pytest.approx(right, rel=5e-3)


def wind(way: float, **terms: float) -> tuple[float, float, float]:
    """Return what both laws expect of two sliding cables, and their torque [N m]."""
    drive, torque = pull_pull(), -1.0
    cables = tuple(
        dataclasses.replace(one, cable=one.cable.replace(**terms))
        for one in drive.cables
    )
    model, before = CableModel(dataclasses.replace(drive, cables=cables)), 0.0
    for i in range(600):
        before = model.joint[0]
        model.follow(way * SPEED / 0.1 * PERIOD * i, torque)
    (one,) = model.models
    assert np.abs(one.direction).tolist() == [1.0, 1.0]
    speed = (model.joint[0] - before) / PERIOD
    return (
        compensation.dynamic(one, speed, torque),
        compensation.full_slip_torque(one, way, speed, torque),
        model.motor_torque()[0],
    )


@pytest.mark.parametrize("name", TERMS)
def test_a_law_knows_the_tensions_of_two_cables_that_slide(name: str) -> None:
    """With a torque at the joint, and an elasticity that is not linear."""
    for way in (1.0, -1.0):
        *expected, right = wind(way, **on(name))
        assert expected == pytest.approx([right] * 2, abs=1e-3)


@pytest.mark.parametrize(
    "terms",
    (
        {"load_independent_friction": 5.0},
        {"seal_proximal": 12.0},
        {"grease_drag": 40.0},
        TERMS_ON["all"],
    ),
    ids=("load independent", "seal", "grease", "all"),
)
def test_a_law_knows_a_pull_that_drag_keeps_from_the_motor(
    terms: dict[str, float],
) -> None:
    """The cable paid out is slack at the motor; grease follows the speed of slip."""
    *expected, right = wind(-1.0, **terms)
    assert expected == pytest.approx([right] * 2, rel=1e-2)


@pytest.mark.parametrize("case", ("kinetic", "weakening", "ageing", "ageing at once"))
def test_a_law_knows_the_friction_of_a_cable_that_has_rested(case: str) -> None:
    """Ageing without a slip distance acts on contacts at rest only."""
    both = Pair(cable(0.1).replace(**TERMS_ON[case]))
    for _ in range(600):
        both.step(0.0, 12.0)
    for speed, pull in ((-SPEED, 20.0), (SPEED, 6.0)):
        slip = both.expected(speed, pull)[1]
        state = both.conduit._state.copy()
        both.conduit.step(1.0, u_proximal=speed, tension_distal=pull)
        assert abs(both.conduit.direction.sum()) == both.conduit.cable.segments
        assert slip == pytest.approx(both.conduit.tension_proximal, rel=1e-9)
        both.conduit._state[:] = state
