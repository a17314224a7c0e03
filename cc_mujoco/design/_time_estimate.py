"""Time that a study takes with controllers that Python steps, from a short sample."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from time import perf_counter

from cc_mujoco.control import CONTROLLERS
from cc_mujoco.design._evaluation import episodes
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._study_spec import DEFAULT_CONTROLLERS
from cc_mujoco.device import Plant
from cc_mujoco.simulation._compiled_batch import LAWS
from cc_mujoco.simulation._rollout import attended, play

SAMPLE_TIME = 0.1
"""Simulated time of a sample [s]."""
SAMPLE_DESIGNS = 8
"""Most designs of a sample, which are played together as those of the study are."""
LONG_WAIT = 20.0
"""Estimated time from which on it is stated [s]."""


def wait_sentences(plan: Plan, threads: int) -> Iterator[str]:
    """Yield that slow controllers are timed, then how long each takes if that is long.

    Of a search nothing is known in advance. 0 `threads` means one per processor.
    """
    slow = [
        law
        for law in plan.protocol.controllers
        if CONTROLLERS.get(law) not in LAWS  # policies and users' laws, too
    ]
    if not slow or not plan.designs:
        return
    yield f"timing {', '.join(slow)} for an estimate"
    (fast,) = DEFAULT_CONTROLLERS
    cases = len(plan.designs) * len(plan.protocol.across.cases)
    share = cases / (threads or os.cpu_count() or 1)
    usual = _seconds_per_design(plan, fast)
    for law in slow:
        each = _seconds_per_design(plan, law)
        if each * share > LONG_WAIT:
            yield (
                f"{law} takes about {_rough(each * share)} for {len(plan.designs)} "
                f"designs; {fast} is {each / usual:.0f} times faster."
            )


def _seconds_per_design(plan: Plan, law: str) -> float:
    """Return the time that one design takes with a controller [s]."""
    protocol = dataclasses.replace(plan.protocol, controllers=(law,))
    designs = [plan.designs[row] for row in plan.batches[0][:SAMPLE_DESIGNS]]
    values = [{**design, **protocol.across.cases[0]} for design in designs]
    models = [attended(Plant(protocol.device, own)) for own in values]
    played = [one for _, own, one in episodes(protocol, protocol.device) if own]
    if not played:
        return 0.0
    sample = dataclasses.replace(played[0], duration=SAMPLE_TIME)
    play(sample, models)  # compiles
    start = perf_counter()
    play(sample, models)
    spent = (perf_counter() - start) / (SAMPLE_TIME * len(models))
    return spent * sum(one.duration for one in played)


def _rough(seconds: float) -> str:
    for unit, size in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} seconds"
