"""From designs to rows of the table: build, play what the metrics need, measure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco.control import controller
from cc_mujoco.human import Wearer
from cc_mujoco.identity import made_by
from cc_mujoco.sensing import PERFECT
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.metrics import (
    METRICS,
    Row,
    measure_backdrive,
    measure_backlash,
    measure_bandwidth,
    measure_episode,
)
from cc_mujoco.whatif.protocol import (
    CHIRP_SHARE,
    CHIRP_TIME,
    CONTROL_PERIOD,
    SWING_TIME,
    SWINGS,
    Chirp,
    EpisodeProtocol,
    Hold,
    Swing,
)
from cc_mujoco.whatif.simulate import Episode, Rollout, play
from cc_mujoco.whatif.variables import Value
from cc_mujoco.workers import Tick

Design = dict[str, Value]


class Result(NamedTuple):
    """What became of one design."""

    metrics: dict[str, float]
    """NaN where it cannot be had."""
    failed: str
    """Why it failed in simulation; empty where it did not."""


def evaluate(
    protocol: EpisodeProtocol,
    designs: Sequence[Design],
    tick: Tick = lambda share: None,
) -> list[Result]:
    """Try designs of equal layout (numbers of segments) together.

    Args:
        protocol: how they are tried.
        designs: as `Builder.check` returns them.
        tick: called now and then with the share that is done; may raise to stop.

    Returns:
        One result per design, whatever becomes of the others.
    """
    builder = Builder(protocol.scene, protocol.timestep)
    models = [builder.model(design) for design in designs]
    found: list[dict[str, float]] = [{} for _ in designs]
    failed = [""] * len(designs)
    tests = episodes(protocol, builder)
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
        Result(
            {n: math.nan if why else row.get(n, math.nan) for n in protocol.metrics},
            why,
        )
        for row, why in zip(found, failed, strict=True)
    ]


def episodes(protocol: EpisodeProtocol, builder: Builder) -> dict[str, Episode]:
    """What has to be played for the metrics of a protocol, by test.

    Raises:
        CableError: the trajectory or the task cannot be played.
    """
    main = Episode(
        builder.device,
        protocol.trajectory,
        protocol.task,
        protocol.duration,
        protocol.frame_skip,
        protocol.seed,
        protocol.controller,
    )
    needed = {METRICS[name].test for name in protocol.metrics}
    found: dict[str, Episode] = {}
    if "episode" in needed:
        found["episode"] = main
    if "backdrive" in needed:
        unpowered = dataclasses.replace(main, task="transparent", controller=None)
        found["backdrive"] = unpowered
    if needed & {"backlash", "bandwidth"}:
        held, most, one_way = _held(main, builder.model({}))
        # A cable that only pulls swings between nothing and its most.
        share, bias = (0.5, 0.5) if one_way else (1.0, 0.0)
        if "backlash" in needed:
            found["backlash"] = dataclasses.replace(
                held,
                task=Swing(share * most, bias * most),
                duration=SWINGS * SWING_TIME,
                controller="none",
            )
        if "bandwidth" in needed:
            chirp = Chirp(CHIRP_SHARE * most, 2.5 * CHIRP_SHARE * bias * most)
            found["bandwidth"] = dataclasses.replace(
                held, task=chirp, duration=CHIRP_TIME
            )
    return found


def rehearse(protocol: EpisodeProtocol, builder: Builder) -> None:
    """Make all that a protocol needs, and play nothing.

    Raises:
        CableError: trajectory, task or controller cannot be used.
    """
    model = builder.model({})
    for episode in episodes(protocol, builder).values():
        exo = episode.exo(model)
        exo.author.write(np.random.default_rng(protocol.seed))
        controller(protocol.controller, PERFECT.equip(exo.drive))


@dataclass(frozen=True)
class Trial:
    """A protocol as a `workers.Job` whose pieces are designs of equal layout."""

    protocol: EpisodeProtocol

    def rehearse(self) -> None:
        """See `Job.rehearse`."""
        rehearse(self.protocol, Builder(self.protocol.scene, self.protocol.timestep))

    def made_by(self) -> dict[str, Any]:
        """See `Job.made_by`; a trajectory from a file goes with the protocol."""
        return made_by(self.protocol.controller)

    def size(self, piece: Sequence[Design]) -> int:
        """Number of designs."""
        return len(piece)

    def do(self, piece: Sequence[Design], tick: Tick) -> list[Result]:
        """Try designs; see `evaluate`."""
        return evaluate(self.protocol, piece, tick)


def _held(main: Episode, model: mujoco.MjModel) -> tuple[Episode, float, bool]:
    """The joint held at rest.

    Returns:
        The episode; the largest torque of the motor at the joint without friction, in
        the direction in which it pulls [Nm]; whether it only pulls. Both are those of
        the scene as it stands, which `model` is.
    """
    device = main.device(model)
    drive = device.drive(CONTROL_PERIOD)
    joint = model.joint(main.setup.joint)
    inertia = float(model.dof_M0[int(joint.dofadr[0])])
    wearer = Wearer.ideal(inertia, float(model.opt.timestep))
    held = dataclasses.replace(main, trajectory=Hold(), wearer=wearer)
    return held, drive.high * drive.ratio, drive.one_way


def _measure(
    test: str, played: Rollout, index: int, builder: Builder, design: Design
) -> dict[str, float]:
    row = Row(played, index, tuple(builder.cables))
    if test == "backdrive":
        return measure_backdrive(row)
    if test == "backlash":
        return measure_backlash(row)
    if test == "bandwidth":
        return measure_bandwidth(row)
    return measure_episode(row, builder.strength(design))


def _within(tick: Tick, start: float, part: float) -> Callable[[float], None]:
    return lambda share: tick(start + part * share)
