"""Load cells on the cables: their torque, and its comparison with a torque sensor."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._data_findings import DataFinding, doubt, error, warning
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._trials import FloatArray, Instrument, Trial
from cc_mujoco.errors import CableError
from cc_mujoco.report._html import list_words

END_OF_TORQUE = {channels.MOTOR_TORQUE: "proximal", channels.JOINT_TORQUE: "distal"}


def check_cells(
    torque: str, trials: Sequence[Trial], bench: Bench | None
) -> tuple[Instrument | None, list[DataFinding]]:
    cells = [cells_at_end(torque, trial) for trial in trials]
    first = trials[0]
    if bench is None:
        message = (
            f"{first.column(cells[0][0])} is no {torque} without a scene, which has "
            "the pulleys and knows which cable pulls which way."
        )
        return None, [warning(message, first.name, cells[0][0])]
    wanted = _cell_names(END_OF_TORQUE[torque], bench)
    for trial, own in zip(trials, cells, strict=True):
        missing = [names[0] for names in wanted if not set(names) & set(own)]
        if missing:
            message = (
                f"{trial.path} has no {missing[0]}; one cable of a pair does not tell "
                "the torque of both: measure the other one too, or declare "
                f"[columns.{torque}] measured = false."
            )
            return None, [error(message, trial.name, missing[0])]
        for name in own:
            pull = trial.tensions[name]
            if np.nanmean(pull) < -0.05 * np.nanmax(np.abs(pull)):
                message = (
                    f"{trial.column(name)} is negative on average, and a cable cannot "
                    f"push; declare [columns.{name}] sign = -1, or its offset."
                )
                return None, [error(message, trial.name, name)]
    return "load cells", []


def _cell_names(end: str, bench: Bench) -> list[tuple[str, ...]]:
    alone = (f"tension_{end}_n",) if len(bench.names) == 1 else ()
    return [(f"tension_{name}_{end}_n", *alone) for name in bench.names]


def has_declared_cells(file: DatasetFile, end: str, bench: Bench) -> bool:
    wanted = _cell_names(end, bench)
    given = [name for name in file.columns if is_cell_at_end(name, end)]
    for name in given:
        if not any(name in names for names in wanted):
            every = [one for names in wanted for one in names]
            raise CableError.unknown("load cell", name, every)
    lacking = [names[0] for names in wanted if not set(names) & set(given)]
    torque = next(torque for torque, own in END_OF_TORQUE.items() if own == end)
    if len(given) == 1 and lacking and file.source(torque).measured:
        return False  # one cell beside a torque sensor, see `TrialFacts.load_cell`
    if given and lacking:
        raise CableError(
            f"of the load cells at the {end} ends only {', '.join(given)} is declared; "
            f"a torque takes those of all cables, {', '.join(lacking)} as well."
        )
    return bool(given)


def is_cell_at_end(name: str, end: str) -> bool:
    return channels.is_tension(name) and channels.cable_end(name)[1] == end


class SingleCell(NamedTuple):
    """Load cell in one cable, which replaces the torque at that end in a comparison."""

    row: int  # 0 at the motor, 1 at the joint
    cable: int  # index of the cable, the agonist first
    # torque per tension [m]: the radius there, negative for the antagonist
    factor: float
    rest: float  # tension that counts as none, that of the trial at rest [N]

    @classmethod
    def of(cls, channel: str, bench: Bench, pretension: float | None) -> "SingleCell":
        """Return the load cell of a channel such as `tension_agonist_distal_n`.

        The trial's pretension is in newtons; None or 0 is that of the scene.
        """
        for row, (torque, end) in enumerate(END_OF_TORQUE.items()):
            for cable, names in enumerate(_cell_names(end, bench)):
                if channel in names:
                    radius = torque_radius(torque, bench)
                    rest = bench.cables[0].pretension if not pretension else pretension
                    return cls(row, cable, -radius if cable else radius, rest)
        ends = END_OF_TORQUE.values()
        every = [names[0] for end in ends for names in _cell_names(end, bench)]
        raise CableError.unknown("load cell", channel, every)

    def torque(self, tension: FloatArray) -> FloatArray:
        """Return the torque [N m] of the tension (samples,) [N] beyond that at rest."""
        return np.asarray(self.factor * (tension - self.rest))


def torque_radius(torque: str, bench: Bench) -> float:
    """Return the radius of the pulley at the end of the channel `torque` [m]."""
    motor = torque == channels.MOTOR_TORQUE
    return bench.motor_radius if motor else bench.joint_radius


def pull_torque(
    trial: Trial, torque: str, bench: Bench
) -> tuple[FloatArray, list[str]]:
    """Return the torque of the load cells at one end [N m], and their channels."""
    names = [
        next(name for name in known if name in trial.tensions)
        for known in _cell_names(END_OF_TORQUE[torque], bench)
    ]
    pulls = [trial.tensions[name] for name in names]
    net = pulls[0] - pulls[1] if len(pulls) == 2 else pulls[0]
    return torque_radius(torque, bench) * net, names


def cells_at_end(torque: str, trial: Trial) -> list[str]:
    end = END_OF_TORQUE[torque]
    return [name for name in trial.tensions if is_cell_at_end(name, end)]


def compare_with_sensor(
    torque: str, trials: Sequence[Trial], bench: Bench | None
) -> list[DataFinding]:
    end = END_OF_TORQUE[torque]
    having = [t for t in trials if not is_cell_at_end(t.facts.load_cell, end)]
    having = [trial for trial in having if cells_at_end(torque, trial)]
    if not having:
        return []
    sensor = having[0].labels.get(torque, torque)
    names = cells_at_end(torque, having[0])
    cells = list_words([having[0].labels.get(name, name) for name in names])
    message = f"Beside {sensor} there are {cells}: the diagnosis compares the former"
    _, wrong = check_cells(torque, having, bench)
    # The joint feels pieces of a path, and these may not be the last one.
    passes = torque == channels.JOINT_TORQUE and bench is not None and bench.others
    if bench is None or wrong or passes:
        return [warning(f"{message}, the load cells not.", channel=torque)]
    shown = np.concatenate([trial.channel(torque) for trial in having])
    pulls = []
    for trial in having:
        pull, _ = pull_torque(trial, torque, bench)
        if torque == channels.JOINT_TORQUE and bench.lever is not None:
            pull = pull * bench.lever.share(trial.joint_angle)
        pulls.append(pull)
    made = np.concatenate(pulls)
    known = np.isfinite(shown) & np.isfinite(made)
    if len(set(shown[known].tolist())) < 2:  # another finding says so
        return []
    shown, made = shown[known], made[known]
    size = float(np.sqrt(np.mean(shown**2)))
    deviation = float(np.sqrt(np.mean((made - shown) ** 2)))
    if deviation <= 0.05 * size:
        return [warning(f"{message}, with which the load cells agree.", channel=torque)]
    gain, offset = np.polyfit(shown, made, 1)
    offset = 0.0 if abs(offset) < 1e-9 * size else offset
    message += (
        f", and the load cells contradict it: on their pulley they make {gain:.3g} "
        f"times its torque and {offset:+.2g} N m ({deviation:.2g} N m RMS off, of "
        f"{size:.2g}); check signs, offsets and units of both, and the pulley's radius."
    )
    return [doubt(message, channel=torque)]
