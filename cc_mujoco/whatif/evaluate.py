"""From designs to rows of the table: build, play what the metrics need, measure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco

from cc_mujoco.human import Wearer
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.metrics import (
    METRICS,
    Row,
    measure_backdrive,
    measure_bandwidth,
    measure_episode,
)
from cc_mujoco.whatif.simulate import Episode, Played, Tick, play
from cc_mujoco.whatif.trial import CHIRP_SHARE, CHIRP_TIME, Chirp, Hold, Trial
from cc_mujoco.whatif.variables import Value

Design = dict[str, Value]


class Result(NamedTuple):
    """What became of one design."""

    metrics: dict[str, float]
    """NaN where it cannot be had."""
    failed: str
    """Why it failed in simulation; empty where it did not."""


def evaluate(
    trial: Trial, designs: Sequence[Design], tick: Tick = lambda share: None
) -> list[Result]:
    """Try designs of equal layout (numbers of segments) together.

    Args:
        trial: how they are tried.
        designs: as `Builder.check` returns them.
        tick: called now and then with the share that is done; may raise to stop.

    Returns:
        One result per design, whatever becomes of the others.
    """
    builder = Builder(trial.scene, trial.timestep)
    models = [builder.model(design) for design in designs]
    found: list[dict[str, float]] = [{} for _ in designs]
    failed = [""] * len(designs)
    tests = episodes(trial, builder)
    total = sum(episode.duration for episode in tests.values())
    done = 0.0
    for test, episode in tests.items():
        start, part = done / total, episode.duration / total
        played = play(episode, models, tick=_within(tick, start, part))
        for index, why in enumerate(played.failed):
            if why:
                where = "" if test == "episode" else f"{test} test: "
                failed[index] = failed[index] or where + why
            else:
                found[index] |= _measure(test, played, index, builder, designs[index])
        done += episode.duration
    return [
        Result({n: math.nan if why else row.get(n, math.nan) for n in trial.metrics}, why)
        for row, why in zip(found, failed, strict=True)
    ]


def episodes(trial: Trial, builder: Builder) -> dict[str, Episode]:
    """What has to be played for the metrics of a trial, by test.

    Raises:
        CableError: the trajectory or the task cannot be played.
    """
    setup = builder.scene.cls.SETUP
    main = Episode(
        setup,
        trial.trajectory,
        trial.task,
        trial.duration,
        trial.frame_skip,
        trial.seed,
        trial.controller,
    )
    needed = {METRICS[name].test for name in trial.metrics}
    found: dict[str, Episode] = {}
    if "episode" in needed:
        found["episode"] = main
    if "backdrive" in needed:
        unpowered = dataclasses.replace(main, task="transparent", controller=None)
        found["backdrive"] = unpowered
    if "bandwidth" in needed:
        found["bandwidth"] = _held(main, builder.model({}))
    return found


def _held(main: Episode, model: mujoco.MjModel) -> Episode:
    """The bandwidth test; `model` is that of the scene as it stands."""
    setup = dataclasses.replace(main.setup, load=lambda: model)
    device = main.device(model)
    drive = device.drive(1e-3)
    amplitude = CHIRP_SHARE * drive.high * drive.ratio
    inertia = float(model.dof_M0[int(model.joint(setup.joint).dofadr[0])])
    return dataclasses.replace(
        main,
        trajectory=Hold(),
        task=Chirp(amplitude, 1.25 * amplitude if drive.one_way else 0.0),
        duration=CHIRP_TIME,
        wearer=Wearer.ideal(inertia, float(model.opt.timestep)),
    )


def _measure(
    test: str, played: Played, index: int, builder: Builder, design: Design
) -> dict[str, float]:
    row = Row(played, index, tuple(builder.cables))
    if test == "backdrive":
        return measure_backdrive(row)
    if test == "bandwidth":
        return measure_bandwidth(row)
    return measure_episode(row, builder.strength(design))


def _within(tick: Tick, start: float, part: float) -> Callable[[float], None]:
    return lambda share: tick(start + part * share)


