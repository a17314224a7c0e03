"""Torques that no sensor shows directly: from load cells, a current, a known load.

All trials of a dataset are taken alike: of a torque sensor, load cells and a current
the first that every trial has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cc_mujoco.diagnosis.data import cells, channels
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.dataset_file import LOAD, DatasetFile
from cc_mujoco.diagnosis.data.findings import DataFinding, error, errors, warning
from cc_mujoco.diagnosis.data.instruments import Instrument, Instruments
from cc_mujoco.diagnosis.data.smoothing import velocity
from cc_mujoco.diagnosis.data.trials import Constant, FloatArray, Noise, Trial

_WORDS: dict[Instrument, str] = {
    "load cells": "load cells",
    "motor current": "the motor's current",
    "known load": "a known load",
}


def completed(
    trials: Sequence[Trial], file: DatasetFile, bench: Bench | None
) -> tuple[list[Trial], Instruments, list[DataFinding]]:
    """Give trials the torques that follow from something else.

    Args:
        trials: as read.
        file: with the constants of motor and load.
        bench: of the scene; without one load cells stay what they are.

    Returns:
        The trials, what their torques are known from, and what was noticed.
    """
    found: list[Instrument | None] = []
    findings: list[DataFinding] = []
    made = list(trials)
    for torque in channels.TORQUES:
        instrument, told = _instrument(torque, trials, file, bench)
        findings += told
        if instrument == "load cells" and bench is not None:
            made = [
                _with(trial, torque, *cells.pull_torque(trial, torque, bench))
                for trial in made
            ]
        elif instrument == "motor current":
            made = [_driven(trial, file.rig) for trial in made]
        elif instrument != "torque sensor":
            made = [_with(trial, torque, None) for trial in made]
        found.append(instrument)
        if instrument != "torque sensor" and made and not told:
            findings.append(warning(_said(torque, instrument, made)))
    instruments = Instruments(*found)
    if trials and not instruments.rows and not errors(findings):
        told_both = (
            "Neither torque is measured, and no load is declared in [rig]; a diagnosis "
            "compares at least one of the two."
        )
        findings.append(error(told_both))
    return made, instruments, findings


def expected(file: DatasetFile, bench: Bench) -> Instruments:
    """Return what the torques will be known from, as declared before any data.

    A table of a torque's column means a sensor, tables of the load cells of all cables
    at one end mean these, a torque constant a current, and a load in `[rig]` that load.

    Raises:
        CableError: cells are declared of no cable of the scene, or not of all.
    """
    found: list[Instrument | None] = []
    for torque, end in cells.ENDS.items():
        measured = file.source(torque).measured
        pulls = cells.declared(file, end, bench)
        motor = torque == channels.MOTOR_TORQUE
        instrument: Instrument | None = "torque sensor" if measured else None
        if torque in file.columns and measured:
            instrument = "torque sensor"
        elif pulls:
            instrument = "load cells"
        elif motor and "torque_constant" in file.rig:
            instrument = "motor current"
        elif not motor and _loaded(file):
            instrument = "known load"
        found.append(instrument)
    return Instruments(*found)


def derived_noise(
    noise: Mapping[str, Noise],
    instruments: Instruments,
    constants: Mapping[str, Constant],
    bench: Bench | None,
) -> dict[str, Noise]:
    """Noise of torques by that of the channels that they are made of."""
    found: dict[str, Noise] = {}
    for torque, instrument in zip(channels.TORQUES, instruments, strict=True):
        if instrument == "load cells" and bench is not None:
            parts = [noise[n] for n in noise if cells.is_end(n, cells.ENDS[torque])]
            size = cells.radius(torque, bench)
        elif instrument == "motor current":
            parts = [noise[n] for n in noise if n == channels.MOTOR_CURRENT]
            size = _constant(constants)
        else:
            continue
        if not parts:  # nothing is declared yet
            continue
        found[torque] = Noise(
            size * float(np.sqrt(sum(part.deviation**2 for part in parts))),
            size * max(part.resolution for part in parts),
            parts[0].source,
        )
    return found


def _instrument(
    torque: str, trials: Sequence[Trial], file: DatasetFile, bench: Bench | None
) -> tuple[Instrument | None, list[DataFinding]]:
    """Return what a torque is known from in all trials."""
    if not file.source(torque).measured or not trials:
        if torque == channels.JOINT_TORQUE and _loaded(file):
            return "known load", []
        return None, []
    if all(torque in trial.channels for trial in trials):
        return "torque sensor", cells.beside(torque, trials, bench)
    if all(cells.at_end(torque, trial) for trial in trials):
        return cells.judged(torque, trials, bench)
    motor = torque == channels.MOTOR_TORQUE
    if motor and all(trial.motor_current is not None for trial in trials):
        if "torque_constant" in file.rig:
            return "motor current", []
        told = (
            f"{trials[0].column(channels.MOTOR_CURRENT)} is a torque only by the "
            "motor's torque constant; declare [rig] torque_constant in N m/A."
        )
        return None, [error(told, trials[0].name, channels.MOTOR_CURRENT)]
    if not motor and _loaded(file):
        return "known load", []
    lacking = next(t for t in trials if torque not in t.channels)
    told = (
        f"{lacking.path} has no {torque}, and nothing that all trials have stands in "
        f"for it; leave it out, or declare [columns.{torque}] measured = false."
    )
    return None, [error(told, lacking.name, torque)]


def _said(torque: str, instrument: Instrument | None, trials: Sequence[Trial]) -> str:
    """Return what a torque is known from, for the report."""
    where = "every trial" if len(trials) > 1 else trials[0].name
    if instrument is None:
        return f"{torque} of {where} is not measured, so only the other is compared."
    made = trials[0].labels.get(torque, "the motion of the joint, declared in [rig]")
    return f"{torque} of {where} follows from {_WORDS[instrument]}: {made}."


def _loaded(file: DatasetFile) -> bool:
    return any(name in file.rig for name in LOAD)


def _constant(constants: Mapping[str, Constant]) -> float:
    """Torque of the motor's pulley per current, friction aside [Nm/A]."""
    gear = constants.get("gear_ratio", Constant(1.0)).value
    return constants["torque_constant"].value * gear


def _driven(trial: Trial, constants: Mapping[str, Constant]) -> Trial:
    """A trial with the torque of its motor's current.

    What teeth and bearings take under load is lost on the way to the cable, or on the
    way back where the cable drives the motor.
    """
    current = trial.motor_current
    assert current is not None
    share = constants.get("gear_efficiency", Constant(1.0)).value
    speed = velocity(trial.motor_angle, trial.step, trial.segments)
    with np.errstate(invalid="ignore"):
        lost: FloatArray = np.where(current * speed >= 0.0, share, 1.0 / share)
    made = _constant(constants) * current * lost
    return _with(trial, channels.MOTOR_TORQUE, made, [channels.MOTOR_CURRENT])


def _with(
    trial: Trial, torque: str, values: FloatArray | None, parts: Sequence[str] = ()
) -> Trial:
    """A trial with this torque, made of these channels."""
    label = " and ".join(trial.labels.get(name, name) for name in parts)
    labels = {**trial.labels, torque: label} if parts else trial.labels
    if torque == channels.MOTOR_TORQUE:
        return replace(trial, labels=labels, motor_torque=values)
    return replace(trial, labels=labels, joint_torque=values)
