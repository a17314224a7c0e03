"""Chapter 1: the models that came before, and what each can show.

All models get the same cable and the same motions. The thesis describes in words what
they lack (1.5); here each model is tested. Every question is a motion whose right
answer is known without any model here: from the capstan law, from the length of the
cable, or from the balance of energy. A model that refuses the motion is not able, and
neither is one that answers it wrong. Parameters that a model has beyond those of a
cable are chosen: bristles of 20 um, 10 lumped masses of a 0.75 mm rope, and the
hysteresis of Do fitted to the first strokes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cc_mujoco.cable import Cable, Section
from cc_mujoco.native import FloatArray
from thesis._outcome import Finding, rms
from thesis._predecessors import (
    Answer,
    BristleChain,
    Distributed,
    LumpedMasses,
    ModifiedBoucWen,
    Motion,
    PassiveDistributed,
    PublishedModel,
    StaticCapstan,
)

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


Capability = tuple[bool, str]
"""Verdict on a model, true where its answer was right, and the result in words."""


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
    return (bool(able), result)


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
    return wrong < MAX_RELATIVE_ERROR, result.format(*got, *right)


def slack(model: PublishedModel) -> Capability:
    """Test that a cable pushed in beyond its stretch has tension 0, not below."""
    cable = model.cable
    give = cable.pretension * cable.length / cable.axial_stiffness
    push = 1.3 * (give + cable.pretension / SPRING)
    answer = model.answer(Motion(DT, ramp(push), SPRING))
    least = min(answer.tension_proximal.min(), answer.tension_distal.min())
    last = max(abs(answer.tension_proximal[-1]), abs(answer.tension_distal[-1]))
    able = least > -1e-9 and last < 1e-6
    return (bool(able), f"least tension {least:.1f} N")


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
    return (bool(able), result.format(math.exp(angle)))


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
    return (bool(1.0 / slack < ratio < most * slack), result)


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
    return worst > -_ROUNDING, result


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
        name: (False, "") if field in model.refuses else question(model)
        for name, (question, field) in CAPABILITY_TESTS.items()
    }


REFERENCE_SEGMENTS = 200  # segments of the model that the others are compared with


class _Judged(NamedTuple):
    """One model: what it can show, how far off it is, what it costs."""

    name: str
    findings: dict[str, Capability]  # answer to every question
    answer: Answer  # to the drawn motion
    moving: float  # RMS error of the output tension while the output moves [N]
    starting: float  # the same while only part of the cable moves [N]
    friction: tuple[float, float]  # both for the difference of the two tensions [N]
    cost: float  # time of a step, in units of ours with the same spring

    def shows(self, *questions: str) -> bool:
        """Return whether the model passes all of these capability tests."""
        return all(self.findings[question][0] for question in questions)


def strokes() -> Motion:
    """Return strokes of the motor that shrink, 8 s, against a spring."""
    at = np.arange(0.0, 8.0, DT)
    size = onset_pull(CABLE) * np.interp(at, [0.0, 2.0, 8.0], [2.5, 2.5, 0.8])
    return Motion(DT, -size * np.sin(np.pi * at), SPRING)


def judge(model: PublishedModel, motion: Motion, truth: Answer, unit: float) -> _Judged:
    """Test, compare and time a model; `unit` is the time of the kernel's step [s]."""
    answer = model.answer(motion)
    distal = answer.tension_distal - truth.tension_distal
    lost = answer.tension_proximal - truth.tension_proximal - distal
    moves = np.abs(np.gradient(truth.u_distal)) > 1e-9
    return _Judged(
        model.name, find_capabilities(model), answer, rms(distal[moves]),
        rms(distal[~moves]), (rms(lost[moves]), rms(lost[~moves])),
        cost(model, motion) / unit,
    )  # fmt: skip


def cost(model: PublishedModel, motion: Motion) -> float:
    """Return the time of one step, best of five, compiled beforehand [s]."""
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        model.answer(motion)
        best = min(best, time.perf_counter() - begin)
    return best / motion.proximal.size


def run() -> tuple[Finding, ...]:
    motion = strokes()
    truth = Distributed(CABLE.replace(segments=REFERENCE_SEGMENTS)).answer(motion)
    ours = Distributed(CABLE)
    ours.answer(motion)
    unit = cost(ours, motion)
    first = slice(0, round(2.0 / DT))  # what Do's model is fitted to
    stroke, seen = motion.proximal[first], Answer(*(part[first] for part in truth))
    models = (
        StaticCapstan(CABLE),
        LumpedMasses(CABLE),
        BristleChain(CABLE),
        ModifiedBoucWen.fitted(CABLE, Motion(DT, stroke, SPRING), seen),
        PassiveDistributed(CABLE),
        ours,
    )
    return _claims(*(judge(one, motion, truth, unit) for one in models))


def _claims(
    capstan: _Judged, kaneko: _Judged, dahl: _Judged, do: _Judged, before: _Judged,
    ours: _Judged,
) -> tuple[Finding, ...]:  # fmt: skip
    lacking = (
        "partial motion", "changing curvature", "non-spring environment",
        "non-uniform pretension",
    )  # fmt: skip
    palli_lacks = not dahl.shows("slack") and not dahl.shows("changing curvature")
    moving, starting = do.friction
    do_tracks = "agrees" if moving < 0.5 * starting else "in part"
    same = np.max(
        np.abs(np.subtract(ours.answer.tension_distal, before.answer.tension_distal))
    )
    passive = before.shows("partial motion", "slack", "non-uniform pretension")
    refused = not before.shows("motion from both ends")
    others = capstan, kaneko, dahl, do, before
    bidirectional = any(judged.shows("motion from both ends") for judged in others)
    costs = ", ".join(f"{one.name.partition(',')[0]} {one.cost:.2g}" for one in others)
    return (
        Finding(
            f"output tension {capstan.moving:.1f} N off while it moves and "
            f"{capstan.starting:.1f} N while part of the cable moves",
            "disagrees" if capstan.shows("partial motion") else "agrees",
        ),
        Finding(
            "; ".join(
                kaneko.findings[name][1]
                for name in ("partial motion", "slack", "creates no energy")
            ),
            "disagrees" if any(map(kaneko.shows, lacking)) else "agrees",
        ),
        Finding(
            f"partial motion appears; output {dahl.moving:.1g} N off in motion; slack: "
            f"{dahl.findings['slack'][1]}",
            "agrees" if dahl.shows("partial motion") and palli_lacks else "in part",
        ),
        Finding(
            f"fitted to the first stroke, friction is {moving:.1f} N off in motion and "
            f"{starting:.1f} N in partial motion; the output {do.moving:.1f} and "
            f"{do.starting:.1f} N",
            "disagrees" if do.shows("partial motion") else do_tracks,
        ),
        Finding(
            f"output tension within {same:.1g} N of ours on a spring; takes no output "
            "that someone moves, and does not slip where bends open",
            "agrees" if passive and refused and same < 0.1 else "disagrees",
        ),
        Finding(
            f"ours answers {sum(able for able, _ in ours.findings.values())} of "
            f"{len(CAPABILITY_TESTS)} questions right",
            "agrees"
            if ours.shows(*CAPABILITY_TESTS) and not bidirectional
            else "in part",
            "a chain of bristles passes motion from both ends, too, without slack"
            if bidirectional
            else "answers known from capstan law, length and energy balance",
        ),
        Finding(
            f"time of a step, ours is 1: {costs}",
            "agrees" if before.cost > 1.5 else "disagrees",
            f"{CABLE.segments} segments, spring at the output, one run; Kaneko's loop "
            "is interpreted, the others are compiled or in NumPy",
            timed=True,
        ),
    )
