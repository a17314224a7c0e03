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
    """Sensor noise of a channel, in its SI unit."""

    deviation: float  # standard deviation of the sensor noise, quantisation included
    resolution: float  # quantisation step, 0 if the readings show none
    # Source of the deviation: `declared`, from `holds` (stretches without motion) or
    # from `differences` of neighbouring samples
    source: Literal["declared", "holds", "differences"]


@dataclass(frozen=True)
class TrialFacts:
    """Declarations of `dataset.toml` for one trial."""

    split: Split | None = None  # permitted use; None leaves it to the program
    repeat_of: str | None = None  # name of the trial that this one repeats
    pretension: float | None = None  # pretension of the cables at rest [N]
    exclude: bool = False  # True if the trial is to be left out
    unhooked: bool = False  # True if the cables were taken off and connect nothing
    # Torque that the motor puts into its pulley to hold a known weight there [N m]
    known_motor_torque: float = 0.0
    # Torque that a known weight in place of the cable puts into the joint [N m]
    known_joint_torque: float = 0.0
    swapped: bool = False  # True if the two torque sensors had changed places
    # Channel of a load cell in one cable (`tension_<cable>_proximal_n`), which is
    # compared in place of the torque at that end; "" without one
    load_cell: str = ""
    temperature: float | None = None  # temperature of the rig [degC]
    locked: Locked | None = None  # side that was held fast, at a constant angle
    # Turn of the rig about the joint's axis, positive as the joint is [rad]
    tilt: float | None = None
    # Name of the day or session; trials of one occasion share friction, pretension,
    # offsets and clocks; "" where there is one occasion
    occasion: str = ""
    # Stretches of time that count (from, to) [s]; None is all
    valid: tuple[tuple[float, float], ...] | None = None
    notes: str = ""  # remarks for a human reader


@dataclass(frozen=True)
class Trial:
    """One recording. Arrays have one entry per sample and are finite in segments."""

    name: str  # file name without suffix, with as many folders as make it unique
    time: FloatArray  # (samples,) [s], as recorded
    motor_angle: FloatArray  # (samples,) [rad]; (0,) if it is not measured
    motor_torque: FloatArray | None  # (samples,) [N m], into the pulley, if known
    joint_angle: FloatArray  # (samples,) [rad]
    joint_torque: FloatArray | None  # (samples,) [N m], into the joint, if known
    segments: tuple[slice, ...]  # valid stretches in order, each without a gap
    step: float  # time between samples [s]
    # (samples,) [N] each, by channel (`tension_<cable>_proximal_n`)
    tensions: Mapping[str, FloatArray] = field(default_factory=dict)
    # (samples,) [rad] each, of other joints that move cables, by channel
    # (`<joint>_angle_rad`)
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    temperature: FloatArray | None = None  # (samples,) [degC], or None
    facts: TrialFacts = field(default_factory=TrialFacts)  # of `dataset.toml`
    path: str = ""  # the file
    sha256: str = ""  # SHA-256 of the file's bytes, hexadecimal
    labels: Mapping[str, str] = field(default_factory=dict)  # columns by channel
    paths: Mapping[str, str] = field(default_factory=dict)  # files besides `path`
    motor_current: FloatArray | None = None  # (samples,) [A], or None
    # By channel, the quantisation step of the raw readings, 0 if they show none. A
    # channel without an entry was not resampled
    digits: Mapping[str, float] = field(default_factory=dict)
    # (samples,) each, of further columns that effects take, as they are in the file
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
    """Trials of one rig."""

    # Trials in the order of their files; those that could not be read are missing
    trials: tuple[Trial, ...]
    # Known constants of the rig by name (see `RIG_CONSTANTS`), SI
    constants: Mapping[str, Constant] = field(default_factory=dict)
    noise: Mapping[str, Noise] = field(default_factory=dict)  # sensor noise by channel
    name: str = ""  # name of the data
    notes: str = ""  # remarks for a human reader
    path: str = ""  # the `dataset.toml`, empty if there is none
    sha256: str = ""  # SHA-256 of its bytes
    # Sources of both torques, the same in all trials
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
