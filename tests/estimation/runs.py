"""Cables replayed for the online estimators, also with a parameter that drifts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import Cable, Section, replay
from cc_mujoco.estimation._tension_slope import next_run

DT = 0.01
CABLE = Cable(
    friction=0.21,
    axial_stiffness=4000.0,
    pretension=40.0,
    conduit=(Section(2.0, 0.28),),
    segments=10,
)


class Run(NamedTuple):
    """A replay: displacements of the ends, tensions of nodes, slip of segments."""

    proximal: np.ndarray
    distal: np.ndarray
    tension: np.ndarray
    direction: np.ndarray


def moving_runs(direction: np.ndarray) -> Iterator[tuple[int, int, float]]:
    """First and last node, and slip, of every part that slips one way."""
    sign, at = np.array(direction, dtype=float), 0
    while at < sign.size:
        first, last, end = next_run(sign, at)
        if first < last:
            yield first, last, float(sign[at])
        at = end


def strokes(seconds: float, proximal: float = 0.03, distal: float = 0.02) -> np.ndarray:
    """Both ends to and fro in 4 s, (2, samples) [m]."""
    time = np.arange(0.0, seconds, DT)
    return np.outer([proximal, distal], -np.sin(0.5 * np.pi * time))


def pulls(seconds: float, depth: float = 0.012) -> np.ndarray:
    """Proximal end pulled and let go in 4 s, distal end locked, (2, samples) [m]."""
    time = np.arange(0.0, seconds, DT)
    return np.outer([-depth, 0.0], 0.5 * (1.0 - np.cos(0.5 * np.pi * time)))


def played(cable: Cable, motion: np.ndarray) -> Run:
    """Return a run of a cable with constant parameters."""
    proximal, distal = motion
    run = replay(cable, DT, u_proximal=proximal, u_distal=distal, profile=True)
    assert run.tension is not None and run.direction is not None
    return Run(proximal, distal, run.tension, run.direction)


def drifting(cable: Cable, motion: np.ndarray, name: str, values: np.ndarray) -> Run:
    """Return a run in which a parameter takes these values in equal periods."""
    tension, direction = [], []
    last: np.ndarray | None = None
    edges = np.linspace(0, motion.shape[1], values.size + 1).astype(int)
    for first, end, value in zip(edges[:-1], edges[1:], values, strict=True):
        before = max(first - 1, 0)
        run = replay(
            cable.replace(**{name: float(value)}),
            DT,
            u_proximal=motion[0, before:end],
            u_distal=motion[1, before:end],
            initial_tension=last,
            profile=True,
        )
        assert run.tension is not None and run.direction is not None
        tension.append(run.tension[first - before :])
        direction.append(run.direction[first - before :])
        last = run.tension[-1]
    return Run(*motion, np.concatenate(tension), np.concatenate(direction))


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
