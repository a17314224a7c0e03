"""Load cells on the cables: the torque that they make, and what they say beside one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cc_mujoco.diagnosis.data import channels
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.dataset_file import DatasetFile
from cc_mujoco.diagnosis.data.findings import DataFinding, doubt, error, warning
from cc_mujoco.diagnosis.data.instruments import Instrument
from cc_mujoco.diagnosis.data.trials import FloatArray, Trial
from cc_mujoco.errors import CableError
from cc_mujoco.page import listed

ENDS = {channels.MOTOR_TORQUE: "proximal", channels.JOINT_TORQUE: "distal"}
_PULLS = 0.05
"""Share of its largest reading by which a load cell may show a push on average."""
_APART = 0.05
"""Difference of a torque and that of its cells, over its RMS, which is told."""


def judged(
    torque: str, trials: Sequence[Trial], bench: Bench | None
) -> tuple[Instrument | None, list[DataFinding]]:
    """Load cells of all cables at one end, or what is wrong with them."""
    cells = [at_end(torque, trial) for trial in trials]
    first = trials[0]
    if bench is None:
        told = (
            f"{first.column(cells[0][0])} is no {torque} without a scene, which has "
            "the pulleys and knows which cable pulls which way."
        )
        return None, [warning(told, first.name, cells[0][0])]
    wanted = _channels(ENDS[torque], bench)
    for trial, own in zip(trials, cells, strict=True):
        missing = [names[0] for names in wanted if not set(names) & set(own)]
        if missing:
            strange = [n for n in own if not any(n in names for names in wanted)]
            told = f"{trial.path} has no {missing[0]}"
            if strange:
                told += (
                    f", only {', '.join(strange)}; call the cables as the scene does, "
                    f"or say which is which: [columns.{missing[0]}] "
                    f"name = '{trial.labels.get(strange[0], strange[0])}'."
                )
            else:
                told += (
                    "; one cable of a pair does not tell the torque of both: measure "
                    f"the other one too, or declare [columns.{torque}] measured = "
                    "false."
                )
            return None, [error(told, trial.name, missing[0])]
        for name in own:
            pull = trial.tensions[name]
            if np.nanmean(pull) < -_PULLS * np.nanmax(np.abs(pull)):
                told = (
                    f"{trial.column(name)} is negative on average, and a cable cannot "
                    f"push; declare [columns.{name}] sign = -1, or its offset."
                )
                return None, [error(told, trial.name, name)]
    return "load cells", []


def _channels(end: str, bench: Bench) -> list[tuple[str, ...]]:
    """Names that the load cells of every cable may have, the agonist's first."""
    alone = (f"tension_{end}_n",) if len(bench.names) == 1 else ()
    return [(f"tension_{name}_{end}_n", *alone) for name in bench.names]


def declared(file: DatasetFile, end: str, bench: Bench) -> bool:
    """Return whether load cells of all cables at one end are declared."""
    wanted = _channels(end, bench)
    given = [name for name in file.columns if is_end(name, end)]
    for name in given:
        if not any(name in names for names in wanted):
            every = [one for names in wanted for one in names]
            raise CableError.unknown("load cell", name, every)
    lacking = [names[0] for names in wanted if not set(names) & set(given)]
    if given and lacking:
        raise CableError(
            f"of the load cells at the {end} ends only {', '.join(given)} is declared; "
            f"a torque takes those of all cables, {', '.join(lacking)} as well."
        )
    return bool(given)


def is_end(name: str, end: str) -> bool:
    """Return whether a channel is a load cell at an end of a cable."""
    return channels.is_tension(name) and channels.cable_end(name)[1] == end


def radius(torque: str, bench: Bench) -> float:
    """Return the pulley's radius at a torque, or the lever's arm at 0 [m]."""
    motor = torque == channels.MOTOR_TORQUE
    return bench.motor_radius if motor else bench.joint_radius


def pull_torque(
    trial: Trial, torque: str, bench: Bench
) -> tuple[FloatArray, list[str]]:
    """Return the net torque of the cells over the pulley [Nm], and their names."""
    names = [
        next(name for name in known if name in trial.tensions)
        for known in _channels(ENDS[torque], bench)
    ]
    pulls = [trial.tensions[name] for name in names]
    net = pulls[0] - pulls[1] if len(pulls) == 2 else pulls[0]
    return radius(torque, bench) * net, names


def at_end(torque: str, trial: Trial) -> list[str]:
    """Load cells of a trial at the end where this torque acts."""
    return [name for name in trial.tensions if is_end(name, ENDS[torque])]


def beside(
    torque: str, trials: Sequence[Trial], bench: Bench | None
) -> list[DataFinding]:
    """Return what cells say that nobody asks, as a torque sensor is at the same end."""
    having = [trial for trial in trials if at_end(torque, trial)]
    if not having:
        return []
    sensor = having[0].labels.get(torque, torque)
    cells = listed([having[0].labels.get(n, n) for n in at_end(torque, having[0])])
    told = f"Beside {sensor} there are {cells}: the diagnosis compares the former"
    _, wrong = judged(torque, having, bench)
    if bench is None or wrong:
        return [warning(f"{told}, the load cells not.", channel=torque)]
    shown = np.concatenate([trial.channel(torque) for trial in having])
    made = np.concatenate([_there(trial, torque, bench) for trial in having])
    known = np.isfinite(shown) & np.isfinite(made)
    shown, made = shown[known], made[known]
    size = float(np.sqrt(np.mean(shown**2)))
    apart = float(np.sqrt(np.mean((made - shown) ** 2)))
    if apart <= _APART * size:
        return [warning(f"{told}, with which the load cells agree.", channel=torque)]
    gain, offset = np.polyfit(shown, made, 1)
    offset = 0.0 if abs(offset) < 1e-9 * size else offset
    told += (
        f", and the load cells contradict it: on their pulley they make {gain:.3g} "
        f"times its torque and {offset:+.2g} N m ({apart:.2g} N m RMS apart, of "
        f"{size:.2g}); check signs, offsets and units of both, and the pulley's radius."
    )
    return [doubt(told, channel=torque)]


def _there(trial: Trial, torque: str, bench: Bench) -> FloatArray:
    """Torque of the cells, on a lever by its arm (samples,) [Nm]."""
    made, _ = pull_torque(trial, torque, bench)
    if torque == channels.JOINT_TORQUE and bench.lever is not None:
        made = made * bench.lever.share(trial.joint_angle)
    return made
