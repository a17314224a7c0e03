"""Measured trials in SI units, and the rig they were measured on.

    >>> from cc_mujoco.diagnosis._loading import load
    >>> dataset, findings = load(["data"])              # doctest: +SKIP
    >>> for trial in dataset.trials:                    # doctest: +SKIP
    ...     for part in trial.segments:
    ...         print(trial.name, trial.time[part], trial.motor_torque[part])

Positive motor rotation pulls the joint positive. The motor torque is what the motor
puts into its pulley, the joint torque what the transmission puts into the joint: motor
power less joint power is stored or dissipated, and over a closed cycle never negative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._channels import TORQUES
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.native import FloatArray as FloatArray

Instrument = Literal["torque sensor", "load cells", "motor current", "known load"]


class Instruments(NamedTuple):
    """Sources of the torques at either end, in all trials of a dataset.

    A torque sensor shows the torque that passes through it; load cells only the cables'
    pull; a motor's current the motor's torque, its own friction included; a known load,
    by its motion, the torque on the joint. A torque without a source (None) is not
    compared, and effects that need it are not named.
    """

    motor: Instrument | None = "torque sensor"
    joint: Instrument | None = "torque sensor"

    @property
    def rows(self) -> tuple[int, ...]:
        """Return the torques that are compared: 0 (the motor's), 1 (the joint's)."""
        return tuple(row for row, each in enumerate(self) if each is not None)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the torques that are compared."""
        return tuple(TORQUES[row] for row in self.rows)


TORQUE_SENSORS = Instruments()


Split = Literal["train", "test"]
Locked = Literal["motor", "joint"]


class Constant(NamedTuple):
    """A constant of the rig in SI units, and its standard deviation (0: exact)."""

    value: float
    uncertainty: float = 0.0


class Noise(NamedTuple):
    """Sensor noise of a channel, in its SI unit.

    Attributes:
        deviation: standard deviation of the sensor noise, quantisation included.
        resolution: quantisation step, 0 if the readings show none.
        source: source of the deviation: `declared`, from `holds` (stretches without
            motion) or from `differences` of neighbouring samples.
    """

    deviation: float
    resolution: float
    source: Literal["declared", "holds", "differences"]


@dataclass(frozen=True)
class TrialFacts:
    """Declarations of `dataset.toml` for one trial.

    Attributes:
        split: permitted use of the trial; None leaves it to the program.
        repeat_of: name of the trial that this one repeats.
        pretension: pretension of the cables at rest [N].
        unhooked: True if the cables were taken off, so that they connect nothing.
        known_motor_torque: torque that the motor puts into its pulley to hold a known
            weight there [N m].
        known_joint_torque: torque that a known weight in place of the cable puts into
            the joint [N m].
        swapped: True if the two torque sensors had changed places.
        load_cell: channel of a load cell in one cable (`tension_<cable>_proximal_n`),
            which is compared in place of the torque at that end; "" without one.
        temperature: temperature of the rig [degC].
        locked: the side that was held fast, so that its angle is constant.
        tilt: angle by which the rig was turned about the joint's axis, positive as the
            joint is [rad].
        occasion: name of the day or session; trials of one occasion share friction,
            pretension, offsets and clocks. "" where there is one occasion.
        valid: stretches of time that count (from, to) [s]; None is all.
        notes: remarks for a human reader.
    """

    split: Split | None = None
    repeat_of: str | None = None
    pretension: float | None = None
    unhooked: bool = False
    known_motor_torque: float = 0.0
    known_joint_torque: float = 0.0
    swapped: bool = False
    load_cell: str = ""
    temperature: float | None = None
    locked: Locked | None = None
    tilt: float | None = None
    occasion: str = ""
    valid: tuple[tuple[float, float], ...] | None = None
    notes: str = ""


@dataclass(frozen=True)
class Trial:
    """One recording. Arrays have one entry per sample and are finite in segments.

    Attributes:
        name: file name without suffix, with as many folders as make it unique.
        time: (samples,) [s], as recorded.
        motor_angle: (samples,) [rad]; (0,) if it is not measured.
        motor_torque: (samples,) [N m], motor into its pulley; None if it is not known.
        joint_angle: (samples,) [rad].
        joint_torque: (samples,) [N m], transmission into joint; None if it is not
            known.
        segments: valid stretches in order, each sampled at `step` without a gap.
        step: time between samples [s].
        tensions: (samples,) [N] each, by channel (`tension_<cable>_proximal_n`).
        others: (samples,) [rad] each, of other joints that move cables, by channel
            (`<joint>_angle_rad`).
        temperature: (samples,) [degC], or None.
        motor_current: (samples,) [A], or None.
        facts: facts stated in `dataset.toml`.
        path: the file.
        sha256: SHA-256 of the file's bytes, hexadecimal.
        labels: by channel, the name of its column in the file.
        paths: by channel, its file if that is not `path`.
        digits: by channel, the quantisation step of the raw readings, 0 if they show
            none. A channel without an entry was not resampled.
        columns: (samples,) each, of further columns requested by effects, by name, as
            they are in the file.
    """

    name: str
    time: FloatArray
    motor_angle: FloatArray
    motor_torque: FloatArray | None
    joint_angle: FloatArray
    joint_torque: FloatArray | None
    segments: tuple[slice, ...]
    step: float
    tensions: Mapping[str, FloatArray] = field(default_factory=dict)
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    temperature: FloatArray | None = None
    facts: TrialFacts = field(default_factory=TrialFacts)
    path: str = ""
    sha256: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    paths: Mapping[str, str] = field(default_factory=dict)
    motor_current: FloatArray | None = None
    digits: Mapping[str, float] = field(default_factory=dict)
    columns: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return 1.0 / self.step

    @property
    def samples(self) -> int:
        """Number of valid samples."""
        return sum(part.stop - part.start for part in self.segments)

    @property
    def duration(self) -> float:
        """Time in valid segments [s]."""
        return self.samples * self.step

    @property
    def _signals(self) -> dict[str, FloatArray]:
        signals = {
            channels.MOTOR_ANGLE: self.motor_angle if self.motor_angle.size else None,
            channels.MOTOR_TORQUE: self.motor_torque,
            channels.JOINT_ANGLE: self.joint_angle,
            channels.JOINT_TORQUE: self.joint_torque,
            **self.tensions,
            **self.others,
            channels.MOTOR_CURRENT: self.motor_current,
            channels.TEMPERATURE: self.temperature,
        }
        return {name: value for name, value in signals.items() if value is not None}

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels, time aside."""
        return tuple(self._signals)

    def channel(self, name: str) -> FloatArray:
        """Return a channel's samples, such as `joint_torque_nm`; raise `CableError`."""
        if name == channels.TIME:
            return self.time
        return look_up("channel", name, self._signals)

    @property
    def ends_held(self) -> bool:
        """Return whether motor and joint angle are the same column of the file.

        Both cable ends are then fixed, and the drum or the conduit moves along the
        cable.
        """
        motor, joint = (self.labels.get(name) for name in channels.ANGLES)
        places = {self.paths.get(name, self.path) for name in channels.ANGLES}
        return motor is not None and motor == joint and len(places) == 1

    def column(self, channel: str) -> str:
        """Return the text `FILE, column NAME` of a channel, for messages."""
        path = self.paths.get(channel, self.path)
        return f"{path}, column {self.labels.get(channel, channel)}"


@dataclass(frozen=True)
class Dataset:
    """Trials of one rig.

    Attributes:
        trials: trials in the order of their files; those that could not be read are
            missing.
        constants: known constants of the rig by name (see `RIG_CONSTANTS`), SI.
        noise: sensor noise by channel.
        name: name of the data.
        notes: remarks for a human reader.
        instruments: sources of both torques, the same in all trials.
        path: the `dataset.toml`, empty if there is none.
        sha256: SHA-256 of its bytes.
    """

    trials: tuple[Trial, ...]
    constants: Mapping[str, Constant] = field(default_factory=dict)
    noise: Mapping[str, Noise] = field(default_factory=dict)
    name: str = ""
    notes: str = ""
    path: str = ""
    sha256: str = ""
    instruments: Instruments = TORQUE_SENSORS

    @property
    def has_motor_angle(self) -> bool:
        """Return whether every trial has a motor angle."""
        return all(trial.motor_angle.size for trial in self.trials)

    @property
    def ends_held(self) -> bool:
        """Return whether `Trial.ends_held` is true of all trials."""
        return bool(self.trials) and all(trial.ends_held for trial in self.trials)

    def trial(self, name: str) -> Trial:
        """Return the trial of that name; raise `CableError` if there is none."""
        for trial in self.trials:
            if trial.name == name:
                return trial
        raise CableError.unknown("trial", name, (trial.name for trial in self.trials))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that all trials have, as the first orders them."""
        rest = [set(trial.channels) for trial in self.trials[1:]]
        first = self.trials[0].channels if self.trials else ()
        return tuple(name for name in first if all(name in other for other in rest))
