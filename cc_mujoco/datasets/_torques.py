"""Motor and joint torques from load cells, motor current or a known load.

All trials of a dataset use the same instrument: the first of torque sensor, load cells
and current that every trial has. A sensor at the joint measures all cables that pull
there, but a diagnosis simulates those of one axis. The torque of the others follows
from their measured tensions along the paths of the scene, and is subtracted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets import _load_cells as load_cells
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._clock import SampledTrack
from cc_mujoco.datasets._coupled_route import PullingCable, pulling_torque
from cc_mujoco.datasets._data_findings import DataFinding, error, errors, warning
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._smoothing import SIGMAS_PER_MEDIAN, velocity
from cc_mujoco.datasets._trials import (
    Constant,
    FloatArray,
    Instrument,
    Instruments,
    Noise,
    Trial,
)
from cc_mujoco.report._html import list_words


def add_derived_torques(
    trials: Sequence[Trial], file: DatasetFile, bench: Bench | None
) -> tuple[list[Trial], Instruments, list[DataFinding]]:
    found: list[Instrument | None] = []
    findings: list[DataFinding] = []
    made = list(trials)
    for torque in channels.TORQUES:
        instrument, problems = _instrument(torque, trials, file, bench)
        findings += problems
        if instrument == "load cells" and bench is not None:
            pulls = [load_cells.pull_torque(trial, torque, bench) for trial in made]
            pairs = zip(made, pulls, strict=True)
            made = [_with_torque(trial, torque, *pull) for trial, pull in pairs]
        elif instrument == "motor current":
            made = [_with_current_torque(trial, file.rig) for trial in made]
        elif instrument != "torque sensor":
            made = [_with_torque(trial, torque, None) for trial in made]
        found.append(instrument)
        if instrument != "torque sensor" and made and not problems:
            message = f"{torque} of {'every trial' if len(made) > 1 else made[0].name}"
            if instrument is None:
                message += " is not measured."
            else:
                source = "the motion of the joint, declared in [rig]"
                source = made[0].labels.get(torque, source)
                names = {"motor current": "the motor's current"}
                names["known load"] = "a known load"
                instead = names.get(instrument, instrument)
                message += f" follows from {instead}: {source}."
            findings.append(warning(message))
    instruments = Instruments(*found)
    if trials and not instruments.rows and not errors(findings):
        findings.append(warning("Only the motion of joint and motor is compared."))
    return made, instruments, findings


def expected_instruments(file: DatasetFile, bench: Bench) -> Instruments:
    """Return the instruments that a `dataset.toml` declares, before any data exist.

    A torque's table means a sensor, as does none of these; tables of the load cells of
    all cables at one end mean load cells; a torque constant a current; a load in
    `[rig]` a known load.
    """
    found: list[Instrument | None] = []
    for torque, end in load_cells.END_OF_TORQUE.items():
        measured = file.source(torque).measured
        pulls = load_cells.has_declared_cells(file, end, bench)
        motor = torque == channels.MOTOR_TORQUE
        instrument: Instrument | None = "torque sensor" if measured else None
        if torque in file.columns and measured:
            instrument = "torque sensor"
        elif pulls:
            instrument = "load cells"
        elif motor and "torque_constant" in file.rig:
            instrument = "motor current"
        elif not motor and file.has_known_load:
            instrument = "known load"
        found.append(instrument)
    return Instruments(*found)


def derived_noise(
    noise: Mapping[str, Noise],
    instruments: Instruments,
    constants: Mapping[str, Constant],
    bench: Bench | None,
) -> dict[str, Noise]:
    found: dict[str, Noise] = {}
    for torque, instrument in zip(channels.TORQUES, instruments, strict=True):
        if instrument == "load cells" and bench is not None:
            end = load_cells.END_OF_TORQUE[torque]
            parts = [noise[n] for n in noise if load_cells.is_cell_at_end(n, end)]
            size = load_cells.torque_radius(torque, bench)
        elif instrument == "motor current":
            parts = [noise[n] for n in noise if n == channels.MOTOR_CURRENT]
            size = _torque_per_current(constants)
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
    if not file.source(torque).measured or not trials:
        if torque == channels.JOINT_TORQUE and file.has_known_load:
            return "known load", []
        return None, []
    if all(torque in trial.channels for trial in trials):
        return "torque sensor", load_cells.compare_with_sensor(torque, trials, bench)
    if all(load_cells.cells_at_end(torque, trial) for trial in trials):
        return load_cells.check_cells(torque, trials, bench)
    motor = torque == channels.MOTOR_TORQUE
    if motor and all(trial.motor_current is not None for trial in trials):
        if "torque_constant" in file.rig:
            return "motor current", []
        message = (
            f"{trials[0].column(channels.MOTOR_CURRENT)} is a torque only by the "
            "motor's torque constant; declare [rig] torque_constant in N m/A."
        )
        return None, [error(message, trials[0].name, channels.MOTOR_CURRENT)]
    if not motor and file.has_known_load:
        return "known load", []
    lacking = next(t for t in trials if torque not in t.channels)
    message = (
        f"{lacking.path} has no {torque}, and nothing that all trials have stands in "
        f"for it; leave it out, or declare [columns.{torque}] measured = false."
    )
    return None, [error(message, lacking.name, torque)]


def _torque_per_current(constants: Mapping[str, Constant]) -> float:
    """Return the frictionless torque at the motor's pulley per current [N m/A]."""
    gear = constants.get("gear_ratio", Constant(1.0)).value
    return constants["torque_constant"].value * gear


def _with_current_torque(trial: Trial, constants: Mapping[str, Constant]) -> Trial:
    """Return the trial with a motor torque computed from the motor current.

    The gear's efficiency divides or multiplies the torque, depending on whether the
    cable drives the motor or the motor the cable. Without a motor angle the joint's
    gives the direction of motion.
    """
    current = trial.motor_current
    assert current is not None
    share = constants.get("gear_efficiency", Constant(1.0)).value
    angle = trial.motor_angle if trial.motor_angle.size else trial.joint_angle
    speed = velocity(angle, trial.step, trial.segments)
    with np.errstate(invalid="ignore"):
        lost: FloatArray = np.where(current * speed >= 0.0, share, 1.0 / share)
    made = _torque_per_current(constants) * current * lost
    return _with_torque(trial, channels.MOTOR_TORQUE, made, [channels.MOTOR_CURRENT])


def _with_torque(
    trial: Trial, torque: str, values: FloatArray | None, parts: Sequence[str] = ()
) -> Trial:
    label = " and ".join(trial.labels.get(name, name) for name in parts)
    labels = {**trial.labels, torque: label} if parts else trial.labels
    if torque == channels.MOTOR_TORQUE:
        return replace(trial, labels=labels, motor_torque=values)
    return replace(trial, labels=labels, joint_torque=values)


@dataclass
class OtherAxes:
    """Torques of other axes' cables at the joint of a bench, and their uncertainty."""

    bench: Bench  # bench of the axis that is diagnosed
    # variances by trial of what friction leaves open in the torques that were taken off
    # [N^2 m^2]
    doubts: list[float] = field(default_factory=list)
    # variances by trial of the noise of their tensions [N^2 m^2]
    scatter: list[float] = field(default_factory=list)

    def take_off(self, recording: Recording, track: SampledTrack) -> None:
        """Subtract the torque of other axes' cables from the joint torque, in place.

        The tensions of these cables are then removed from `track`.
        """
        if channels.JOINT_TORQUE in track.values:
            for cable in self.bench.pulled_by:
                self._take_off(cable, recording, track)
        for name in self.bench.strangers:
            for end in ("proximal", "distal"):
                track.values.pop(f"tension_{name}_{end}_n", None)

    def _take_off(
        self, cable: PullingCable, recording: Recording, track: SampledTrack
    ) -> None:
        bench, values = self.bench, track.values
        names = [f"tension_{cable.name}_{end}_n" for end in ("proximal", "distal")]
        there = [name for name in names if name in values]
        what = f"cable {cable.name} of another axis pulls at joint {bench.joint!r}, too"
        if not there:
            message = (
                f"{recording.path}: {what}, and its torque is part of "
                f"{recording.column(channels.JOINT_TORQUE)}; record its tension "
                f"({' and '.join(names)}), take it off the rig and out of the scene, "
                f"or declare [columns.{channels.JOINT_TORQUE}] measured = false."
            )
            finding = error(message, recording.name, channels.JOINT_TORQUE)
            recording.findings.append(finding)
            return
        rows = 100  # from the pose of the scene to the first sample
        lead = np.linspace(0.0, 1.0, rows + 1)[:-1]

        def led(name: str) -> FloatArray:
            signal = values[name]
            known = np.flatnonzero(np.isfinite(signal))
            filled = np.interp(np.arange(signal.size), known, signal[known])
            return np.concatenate([lead * filled[0], filled])

        proximal, distal = (
            np.concatenate([np.full(rows, values[name][0]), values[name]])
            if name in values
            else None
            for name in names
        )
        low, high = (
            bound[rows:]
            for bound in pulling_torque(
                bench.coupled,
                cable,
                led(channels.JOINT_ANGLE),
                {joint: led(channels.other_angle(joint)) for joint in cable.others},
                proximal,
                distal,
            )
        )
        taken, doubt = 0.5 * (low + high), 0.5 * (high - low)
        values[channels.JOINT_TORQUE] = values[channels.JOINT_TORQUE] - taken
        self.doubts.append(float(np.nanmean(doubt**2)))
        rough = np.nanmedian(np.abs(np.diff(taken, 3)))
        self.scatter.append(float(SIGMAS_PER_MEDIAN**2 * rough**2 / 20.0))
        size = float(np.sqrt(np.nanmean(taken**2)))
        message = (
            f"{recording.path}: {what}; its torque there by {list_words(there)}, "
            f"{size:.2g} N m RMS, is taken off column "
            f"{recording.labels.get(channels.JOINT_TORQUE, channels.JOINT_TORQUE)}"
        )
        unsure = float(np.sqrt(self.doubts[-1]))
        if unsure > 1e-6 * size:
            message += (
                f", known to {unsure:.2g} N m RMS by the friction of the scene, which "
                "counts as noise"
            )
        finding = warning(f"{message}.", recording.name, channels.JOINT_TORQUE)
        recording.findings.append(finding)

    def noise(self, known: Noise, passed: float) -> Noise:
        """Return the noise of the joint torque, including the subtracted torques.

        Uncertain friction gives an error of low frequency, which passes the low-pass
        filter of a fit; `passed` is the fraction of white-noise variance that this
        filter passes.
        """
        if not self.doubts:
            return known
        variance = known.deviation**2 + float(np.mean(self.doubts)) / passed
        if known.source == "declared":  # of the joint's sensor alone
            variance += float(np.mean(self.scatter))
        return known._replace(deviation=variance**0.5)
