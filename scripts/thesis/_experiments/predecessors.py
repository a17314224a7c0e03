"""Chapter 1: the models that came before, and what each can show.

All models get the same cable and the same motions (`find_capabilities`). The thesis
describes in words what they lack (1.5); here each model is tested. Parameters that a
model has beyond those of a cable are chosen: bristles of 20 um, 10 lumped masses of a
0.75 mm rope, and the hysteresis of Do fitted to the first motion that is drawn.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from thesis._outcome import Finding, rms
from thesis.predecessors._capabilities import (
    CABLE,
    CAPABILITY_TESTS,
    DT,
    SPRING,
    Capability,
    find_capabilities,
    onset_pull,
)
from thesis.predecessors._models import (
    Answer,
    BristleChain,
    Distributed,
    LuGreChain,
    LumpedMasses,
    ModifiedBoucWen,
    Motion,
    PassiveDistributed,
    PublishedModel,
    StaticCapstan,
)

REFERENCE_SEGMENTS = 200  # segments of the model that the others are compared with


class _Judged(NamedTuple):
    """One model: what it can show, how far off it is, what it costs."""

    findings: dict[str, Capability]  # answer to every question
    answer: Answer  # to the drawn motion
    moving: float  # RMS error of the output tension while the output moves [N]
    starting: float  # the same while only part of the cable moves [N]
    friction: tuple[float, float]  # both for the difference of the two tensions [N]
    cost: float  # time of a step, in units of ours with the same spring

    def shows(self, *questions: str) -> bool:
        """Return whether the model passes all of these capability tests."""
        return all(self.findings[question].able for question in questions)


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
        find_capabilities(model), answer, rms(distal[moves]), rms(distal[~moves]),
        (rms(lost[moves]), rms(lost[~moves])), cost(model, motion) / unit,
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
        LuGreChain(CABLE),
        ModifiedBoucWen.fitted(CABLE, Motion(DT, stroke, SPRING), seen),
        PassiveDistributed(CABLE),
        ours,
    )
    return _claims({type(one): judge(one, motion, truth, unit) for one in models})


def _claims(found: dict[type[PublishedModel], _Judged]) -> tuple[Finding, ...]:
    capstan, kaneko, do = (
        found[kind] for kind in (StaticCapstan, LumpedMasses, ModifiedBoucWen)
    )
    dahl, lugre = found[BristleChain], found[LuGreChain]
    ours, before = found[Distributed], found[PassiveDistributed]
    lacking = (
        "partial motion", "changing curvature", "non-spring environment",
        "non-uniform pretension",
    )  # fmt: skip
    palli = dahl.shows("partial motion") and lugre.shows("partial motion")
    palli_lacks = not dahl.shows("slack") and not dahl.shows("changing curvature")
    moving, starting = do.friction
    do_tracks = "agrees" if moving < 0.5 * starting else "in part"
    same = np.max(
        np.abs(np.subtract(ours.answer.tension_distal, before.answer.tension_distal))
    )
    passive = before.shows("partial motion", "slack", "non-uniform pretension")
    refused = not before.shows("motion from both ends")
    bidirectional = any(
        judged.shows("motion from both ends")
        for kind, judged in found.items()
        if kind is not Distributed
    )
    costs = ", ".join(
        f"{kind.name.partition(',')[0]} {judged.cost:.2g}"
        for kind, judged in found.items()
        if kind not in (Distributed, LuGreChain)
    )
    return (
        Finding(
            f"output tension {capstan.moving:.1f} N off while it moves and "
            f"{capstan.starting:.1f} N while part of the cable moves",
            "disagrees" if capstan.shows("partial motion") else "agrees",
        ),
        Finding(
            "; ".join(
                kaneko.findings[name].result
                for name in ("partial motion", "slack", "creates no energy")
            ),
            "disagrees" if any(map(kaneko.shows, lacking)) else "agrees",
        ),
        Finding(
            f"partial motion appears; output {dahl.moving:.1g} N off in motion (LuGre "
            f"{lugre.moving:.1g} N); slack: {dahl.findings['slack'].result}",
            "agrees" if palli and palli_lacks else "in part",
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
            f"ours answers {sum(f.able for f in ours.findings.values())} of "
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
            f"all compiled, {CABLE.segments} segments, spring at the output, one run",
            timed=True,
        ),
    )
