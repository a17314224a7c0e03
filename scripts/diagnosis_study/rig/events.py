"""Recordings of a rig to which something happens once.

An event begins at a moment of one trial or between two trials, and lasts to the end of
that trial or of the session. What happens to the cable is simulated by the equations of
the rig; what happens to a sensor is done to its readings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray as Array
from rig.dataset import clean_dataset, make_trials
from rig.makes import MAKES
from rig.nominal import Rig
from rig.sensors import BASIC, CHANNELS, logged
from rig.trials import LEAD, RATE, Trial

Columns = dict[str, Array]
TORQUES = ("motor_torque_nm", "joint_torque_nm")


class Happening(NamedTuple):
    """Kind of an event (`KINDS`), and the trials that it concerns."""

    kind: str
    trial: int
    time: float  # 0 where it happened before the trial
    last: int  # last trial that it concerns


class Session(NamedTuple):
    """A rig, what it hides, and the trials of a session."""

    rig: Rig
    effects: Mapping[str, float]
    trials: list[Trial]
    seed: int

    def recorded(
        self, rig: Rig | None = None, trials: list[Trial] | None = None
    ) -> list[Columns]:
        """Return the recorded trials; some are simulated with another rig or motion."""
        own, every = rig or self.rig, trials or self.trials
        clean = clean_dataset(own, self.effects, every, self.seed)
        chain = MAKES[own.make].chain_of(own)
        seeds = [[self.seed, self.rig.seed, k] for k in range(len(every))]
        return [logged(c, chain, BASIC, s) for c, s in zip(clean, seeds, strict=True)]


Maker = Callable[[Session, list[Columns], Happening, float], list[Columns]]


def _later(data: Columns, at: Happening, place: int) -> Array:
    """Return the samples of a trial that come after the event (samples,)."""
    if not at.trial <= place <= at.last:
        return np.zeros(data["time_s"].size, dtype=bool)
    start = data["time_s"][0] + (at.time if place == at.trial else 0.0)
    return np.asarray(data["time_s"] >= start)


def _noise(name: str, size: int, seed: Sequence[int]) -> Array:
    column = next(c for c in CHANNELS.values() if c.column == name)
    values = column.noise * np.random.default_rng(seed).standard_normal(size)
    return np.asarray(column.resolution * np.round(values / column.resolution))


def _without_torque(names: Sequence[str]) -> Maker:
    def made(
        session: Session, data: list[Columns], at: Happening, size: float
    ) -> list[Columns]:
        for k, columns in enumerate(data):
            off = _later(columns, at, k)
            for row, name in enumerate(names):
                noise = _noise(name, int(off.sum()), [session.seed, k, row, 0xDEAD])
                columns[name][off] = size + noise
        return data

    return made


def _frozen(name: str) -> Maker:
    def made(
        session: Session, data: list[Columns], at: Happening, size: float
    ) -> list[Columns]:
        off = _later(data[at.trial], at, at.trial)
        held = data[at.trial][name][np.flatnonzero(off)[0]]
        for k, columns in enumerate(data):
            columns[name][_later(columns, at, k)] = held
        return data

    return made


def _gained(
    session: Session, data: list[Columns], at: Happening, size: float
) -> list[Columns]:
    for k, columns in enumerate(data):
        columns["joint_torque_nm"][_later(columns, at, k)] *= size
    return data


def _drifted(
    session: Session, data: list[Columns], at: Happening, size: float
) -> list[Columns]:
    for k, columns in enumerate(data):
        time, late = columns["time_s"] - columns["time_s"][0], _later(columns, at, k)
        along = (time - at.time) / (time[-1] - at.time) if k == at.trial else 1.0
        columns["joint_torque_nm"] += size * late * along
    return data


def _saturated(
    session: Session, data: list[Columns], at: Happening, size: float
) -> list[Columns]:
    torque = data[at.trial]["joint_torque_nm"]
    most = size * np.max(np.abs(torque))
    np.clip(torque, -most, most, out=torque)
    return data


def _zeroed(
    session: Session, data: list[Columns], at: Happening, size: float
) -> list[Columns]:
    for k, columns in enumerate(data):
        columns["motor_angle_rad"][_later(columns, at, k)] += size
    return data


def _slipped(
    session: Session, data: list[Columns], at: Happening, size: float
) -> list[Columns]:
    """Turn the pulley of the motor on its shaft by `size` [rad] within 20 ms."""
    trials = []
    for k, trial in enumerate(session.trials):
        command = trial.command.copy()
        start = LEAD + (at.time if k == at.trial else -2.0 * LEAD)
        along = (np.arange(len(command)) / RATE - start) / 0.02
        turned = size * np.clip(along, 0.0, 1.0)
        if not at.trial <= k <= at.last:
            turned[:] = 0.0
        command[:, 0] -= turned
        command[:, 1] -= np.gradient(turned, 1.0 / RATE)
        trials.append(replace(trial, command=command))
    found = session.recorded(trials=trials)
    for k, columns in enumerate(found):
        time = columns["time_s"] - columns["time_s"][0]
        start = at.time if k == at.trial else -LEAD
        if at.trial <= k <= at.last:
            turned = size * np.clip((time - start) / 0.02, 0.0, 1.0)
            columns["motor_angle_rad"] = columns["motor_angle_rad"] + turned
    return found


def _changed(**factors: float) -> Maker:
    def made(
        session: Session, data: list[Columns], at: Happening, size: float
    ) -> list[Columns]:
        values: Any = {
            n: getattr(session.rig, n) * factor**size for n, factor in factors.items()
        }
        other = session.recorded(replace(session.rig, **values))
        for k, columns in enumerate(data):
            off = _later(columns, at, k)
            for name in columns:
                columns[name][off] = other[k][name][off]
        return data

    return made


class Kind(NamedTuple):
    """A kind of event: its maker, its size, where it begins and how long it lasts."""

    make: Maker
    size: float
    within: bool  # begins in the middle of a trial
    lasting: bool  # concerns the trials after it


KINDS = {
    "cable_off": Kind(_without_torque(TORQUES), 0.01, True, False),
    "cable_off_for_good": Kind(_without_torque(TORQUES), 0.01, True, True),
    "slip": Kind(_slipped, 0.03, True, True),
    "slip_between": Kind(_slipped, 0.012, False, True),
    "zeroed_between": Kind(_zeroed, 0.02, False, True),
    "zeroed": Kind(_zeroed, 0.02, True, True),
    "dead": Kind(_without_torque(TORQUES[1:]), 0.02, True, True),
    "frozen": Kind(_frozen("joint_torque_nm"), 0.0, True, False),
    "gain": Kind(_gained, 0.8, True, True),
    "gain_between": Kind(_gained, 1.25, False, True),
    "friction": Kind(_changed(friction_a=0.65, friction_b=0.65), 1.0, False, True),
    "pretension": Kind(_changed(pretension=0.6), 1.0, False, True),
    "one_trial": Kind(_changed(pretension=0.5), 1.0, False, False),
    "devices": Kind(
        _changed(axial_stiffness=0.6, friction_a=1.5, friction_b=1.5), 1.0, False, True
    ),
    "drift": Kind(_drifted, 0.3, True, True),
    "saturated": Kind(_saturated, 0.8, False, False),
}
"""Kinds of events by name."""


def with_event(
    rig: Rig, effects: Mapping[str, float], trials: str, seed: int, name: str
) -> tuple[list[Columns], Happening | None]:
    """Return recorded trials, and what happened in them; "none" makes nothing happen.

    The seed draws the trial and the time. Trials without cables are not chosen.
    """
    session = Session(rig, effects, make_trials(trials, seed), seed)
    data = session.recorded()
    if name == "none":
        return data, None
    kind, random = KINDS[name], np.random.default_rng([seed, 0xE7E])
    usual = [k for k, t in enumerate(session.trials) if not (t.unhooked or t.tilt)]
    first = usual[int(random.integers(2, len(usual) - 2))]
    time = float(random.uniform(2.0, 6.0)) if kind.within else 0.0
    last = len(data) - 1 if kind.lasting else first
    happened = Happening(name, first, time, last)
    return kind.make(session, data, happened, kind.size), happened
