"""Capabilities of a cable model, found by tests of it.

    found = find_capabilities(BristleChain(CABLE))
    found["slack"].able, found["slack"].result

Every question is a motion whose right answer is known without any model here: from the
capstan law, from the length of the cable, or from the balance of energy. A model that
refuses the motion is not able, and neither is one that answers it wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cc_mujoco.cable import Cable, Section
from cc_mujoco.native import FloatArray
from thesis.predecessors._models import Answer, Motion, PublishedModel

DT = 1e-3
CABLE = Cable(
    axial_stiffness=4000.0, pretension=10.0, friction=0.2, static_friction=0.0,
    conduit=(Section(2.0, 0.4),), segments=20,
)  # fmt: skip
SPRING = 500.0  # stiffness at the output [N/m]
MAX_RELATIVE_ERROR = 0.05  # largest relative error of an answer that counts as right

_CYCLES, _HALF_CYCLE_SAMPLES = 30, 50
"""Cycles until the state repeats, and samples of half a cycle."""
_ROUNDING = 1e-3


class Capability(NamedTuple):
    able: bool  # whether the model gave the right answer
    result: str  # the result in a few words, empty where the model refuses


def front_pull(cable: Cable, tension: float) -> float:
    """Return the end displacement [m] at which its tension is `tension` [N].

    Behind the front the capstan law holds, ahead of it the pretension: u = T0 (e^a - 1
    - a) L / (mu theta EA) with e^a = T/T0.
    """
    a = math.log(tension / cable.pretension)
    per_angle = cable.length / (cable.axial_stiffness * cable.friction * cable.wrap)
    return cable.pretension * (math.expm1(a) - a) * per_angle


def onset_pull(cable: Cable) -> float:
    """Return the displacement of one end at which the other's tension changes [m]."""
    whole = math.exp(cable.friction * cable.wrap)
    return front_pull(cable, whole * cable.pretension)


def end_tension(cable: Cable, pull: float) -> float:
    """Return the end tension [N] at a displacement below `onset_pull` [m]."""
    top = cable.pretension * math.exp(cable.friction * cable.wrap)
    return float(brentq(lambda t: front_pull(cable, t) - pull, cable.pretension, top))


def ramp(*corners: float, steps: int = 400) -> FloatArray:
    """Return displacements (samples,) [m] from 0, linear between `corners`."""
    pieces = [
        np.linspace(a, b, steps + 1)[1:]
        for a, b in zip((0.0, *corners), corners, strict=False)
    ]
    return np.concatenate([[0.0], *pieces])


def partial_motion(model: PublishedModel) -> Capability:
    """Test that half of `onset_pull` leaves the output as it was, twice does not."""
    reach = onset_pull(model.cable)
    answer = model.answer(Motion(DT, ramp(-0.5 * reach, -2.0 * reach), SPRING))
    distal = answer.tension_distal - model.cable.pretension
    early = distal[400] / distal[-1]
    result = f"a quarter of a pull moves the output by {early:.0%}, right is 0%"
    able = abs(early) < MAX_RELATIVE_ERROR and distal[-1] > 0.1
    return Capability(bool(able), result)


def both_ends(model: PublishedModel) -> Capability:
    """Test that two fronts that have not met do not interact."""
    cable = model.cable
    reach = onset_pull(cable)
    pulls = 0.15 * reach, 0.05 * reach
    answer = model.answer(Motion(DT, ramp(-pulls[0]), moved=ramp(pulls[1])))
    return _compare(answer, [end_tension(cable, pull) for pull in pulls], cable)


def other_environment(model: PublishedModel) -> Capability:
    """Test that a wearer's small motion changes the output's tension only."""
    cable = model.cable
    pull = 0.5 * onset_pull(cable)
    answer = model.answer(Motion(DT, ramp(0.0), moved=ramp(pull)))
    return _compare(answer, [cable.pretension, end_tension(cable, pull)], cable)


def _compare(answer: Answer, right: list[float], cable: Cable) -> Capability:
    got = [float(answer.tension_proximal[-1]), float(answer.tension_distal[-1])]
    scale = max(right) - cable.pretension
    wrong = max(abs(g - r) for g, r in zip(got, right, strict=True)) / scale
    result = "{:.1f} and {:.1f} N at the ends, right is {:.1f} and {:.1f} N"
    return Capability(wrong < MAX_RELATIVE_ERROR, result.format(*got, *right))


def slack(model: PublishedModel) -> Capability:
    """Test that a cable pushed in beyond its stretch has tension 0, not below."""
    cable = model.cable
    give = cable.pretension * cable.length / cable.axial_stiffness
    push = 1.3 * (give + cable.pretension / SPRING)
    answer = model.answer(Motion(DT, ramp(push), SPRING))
    least = min(answer.tension_proximal.min(), answer.tension_distal.min())
    last = max(abs(answer.tension_proximal[-1]), abs(answer.tension_distal[-1]))
    able = least > -1e-9 and last < 1e-6
    return Capability(bool(able), f"least tension {least:.1f} N")


def uneven_pretension(model: PublishedModel) -> Capability:
    """Test that a cable starts with a given tension profile and keeps it."""
    cable = model.cable
    angle = cable.friction * cable.wrap
    profile = 20.0 * np.exp(-angle * np.linspace(0.0, 1.0, cable.segments + 1))
    pull = ramp(-0.5 * onset_pull(cable))
    answer = model.answer(Motion(DT, pull, SPRING, start=profile))
    start = answer.tension_proximal[0], answer.tension_distal[0]
    ratio = answer.tension_proximal[-1] / answer.tension_distal[-1]
    right = np.allclose(start, profile[[0, -1]], rtol=MAX_RELATIVE_ERROR)
    result = f"ratio of the tensions {ratio:.2f} in the next pull, right is {{:.2f}}"
    able = right and abs(ratio / math.exp(angle) - 1.0) < MAX_RELATIVE_ERROR
    return Capability(bool(able), result.format(math.exp(angle)))


def changing_bends(model: PublishedModel) -> Capability:
    """Check that opening bends under a pulled cable lower its friction, so it slips."""
    cable = model.cable
    pull = ramp(-2.0 * onset_pull(cable), -2.0 * onset_pull(cable))
    scale = np.concatenate([np.ones(401), np.linspace(1.0, 0.2, 400)])
    answer = model.answer(Motion(DT, pull, SPRING, factor=scale))
    ratio = answer.tension_proximal[-1] / answer.tension_distal[-1]
    most = math.exp(0.2 * cable.friction * cable.wrap)
    result = f"ratio of the tensions {ratio:.2f}, friction holds {most:.2f}"
    slack = 1.0 + MAX_RELATIVE_ERROR
    return Capability(bool(1.0 / slack < ratio < most * slack), result)


def no_energy(model: PublishedModel) -> Capability:
    """Check that friction takes energy and gives none in a cycle that became periodic.

    Cycles that still creep after the last round prove nothing: the cable may hold less
    energy than before.
    """
    reach = onset_pull(model.cable)
    worst = math.inf
    for size in (0.002, 0.02, 0.1, 0.5, 2.0):
        # A small cycle on top of a pull, and one about rest.
        for level in (0.0, -1.5 * reach):
            cycle = [level - size * reach, level + size * reach]
            pull = ramp(level, *(_CYCLES * cycle), steps=_HALF_CYCLE_SAMPLES)
            answer = model.answer(Motion(DT, pull, SPRING))
            worst = min(worst, _relative_loss(answer, pull, 2 * _HALF_CYCLE_SAMPLES))
    result = f"keeps {worst:.1%} of the work of the motor at least"
    if worst < -_ROUNDING:
        result = f"gives back up to {-worst:.0%} more than it got"
    return Capability(worst > -_ROUNDING, result)


def _relative_loss(answer: Answer, proximal: FloatArray, period: int) -> float:
    """Return the work lost in the last period, relative to that of the motor."""
    last = slice(-period - 1, None)
    for tension in (answer.tension_proximal, answer.tension_distal):
        if abs(tension[-1] - tension[-period - 1]) > 1e-5:  # N
            return math.inf
    pulled, drawn = -np.diff(proximal[last]), np.diff(answer.u_distal[last])
    near, far = answer.tension_proximal[last], answer.tension_distal[last]
    by_motor = 0.5 * (near[1:] + near[:-1]) * pulled
    by_spring = 0.5 * (far[1:] + far[:-1]) * drawn
    total = float(np.sum(by_motor) + np.sum(by_spring))
    return total / float(np.sum(np.abs(by_motor)))


CAPABILITY_TESTS: dict[str, tuple[Callable[[PublishedModel], Capability], str]] = {
    "partial motion": (partial_motion, ""),
    "motion from both ends": (both_ends, "moved"),
    "slack": (slack, ""),
    "non-uniform pretension": (uneven_pretension, "start"),
    "changing curvature": (changing_bends, "factor"),
    "non-spring environment": (other_environment, "moved"),
    "creates no energy": (no_energy, ""),
}
"""Tests, and the field of `Motion` that each needs a model to take."""


def find_capabilities(model: PublishedModel) -> dict[str, Capability]:
    """Run every test on a model; a refused test counts as failed."""
    return {
        name: Capability(False, "") if field in model.refuses else question(model)
        for name, (question, field) in CAPABILITY_TESTS.items()
    }
