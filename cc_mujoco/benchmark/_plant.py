"""True parameters of devices, sampled by seed, which a controller does not know.

    drawn = draw(condition, seeds=(0, 1))
    drawn[0].plant.cables["flexor"].friction      # of the plant
    Belief(0.1).of(drawn[0].plant.cables["flexor"], random)     # of the controller

A condition and a seed are one plant, one motion and one noise for every controller, so
that controllers are compared in pairs. Conditions that differ only in the error of the
model share their plants; all others draw independently of each other.
"""

from __future__ import annotations

import dataclasses
import re
import secrets
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import require_parameter
from cc_mujoco.benchmark._actuation import PLAIN, Actuation
from cc_mujoco.benchmark._conditions import (
    TRANSMISSIONS,
    Condition,
    Liner,
    Together,
    plant_key,
)
from cc_mujoco.benchmark._structure import hidden_effect
from cc_mujoco.cable import Cable
from cc_mujoco.cable._cable import BENDS, PATHS
from cc_mujoco.device import Device, Plant, find_device
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._sensors import BIAS
from cc_mujoco.device._variables import Value
from cc_mujoco.errors import CableError
from cc_mujoco.human import Disturbed, Trajectory, Walk

MAX_SIGMAS = 3.0
"""Draws are clipped beyond this many standard deviations."""

CABLE_SPREAD = {
    "friction": 0.15,
    "axial_stiffness": 0.1,
    "pretension": 0.2,
    "wrap": 0.1,
}
"""Relative standard deviations of the cables of a plant around their nominal values."""

IMPEDANCE_SPREAD, CADENCE_SPREAD = 0.2, 0.03
"""Relative standard deviations of the wearer's impedance and of a gait's period."""

KEY_BYTES = 16
"""Length of the secret key of a run."""

SENSORS_PER_CABLE = 3
"""Tension sensors on a cable, see `Sensing.equip`."""


@dataclass(frozen=True)
class Draw:
    """Sampled plant with the bias and actuation of its episode."""

    plant: Plant
    """The device with its cables, wearer, delay and noise."""
    known: Plant
    """Plant as its controller may know it, without the errors of the model."""
    seed: int
    """Seed of its motion and noise, from the episode and its condition."""
    trajectory: Trajectory
    bias: tuple[tuple[float, ...], ...]
    """Bias of the joint torque sensor, then of every tension sensor, of each axis, as a
    multiple of the standard deviation of the device's noise."""
    actuation: Actuation = PLAIN
    """Effects between the controller and the motor."""


@dataclass(frozen=True)
class Belief:
    """Standard deviations of the relative errors of a controller's parameters."""

    error: float = 0.1
    """Error of both friction coefficients, axial stiffness and pretension."""
    bias: float = 0.0
    """Relative error of friction that is the same for all, added to the draw."""

    def __post_init__(self) -> None:
        require_parameter(self, "error", 0.0, 0.3, "")
        require_parameter(self, "bias", -0.9, 5.0, "")

    def of(self, cable: Cable, random: np.random.Generator) -> Cable:
        """Return a cable as the controller assumes it; its route is known."""
        friction, stiffness, pretension = (
            self.error * _clipped_normal(random) for _ in range(3)
        )
        factor = max(1.0 + self.bias + friction, 0.05)
        return cable.replace(
            friction=factor * cable.friction,
            static_friction=factor * cable.static_friction,
            axial_stiffness=(1.0 + stiffness) * cable.axial_stiffness,
            pretension=(1.0 + pretension) * cable.pretension,
        )


def sample_plants(
    condition: Condition, seeds: Sequence[int], key: str = ""
) -> list[Draw]:
    """Draw the plants of a condition, one for each seed.

    `key` is the secret of the run, see `new_key`; none by default.
    """
    device = find_device(condition.scene)
    return [_sample_plant(condition, seed, device, key) for seed in seeds]


def new_key() -> str:
    """Return a new secret key of a run, `KEY_BYTES` as hexadecimal digits."""
    return secrets.token_hex(KEY_BYTES)


def require_key(key: str) -> None:
    if not re.fullmatch(f"([0-9a-f]{{{2 * KEY_BYTES}}})?", key):
        raise CableError(
            f"a key has {2 * KEY_BYTES} hexadecimal digits, as a results file has it, "
            f"not {key!r}."
        )


def _own_seed(seed: int, place: int, key: str) -> int:
    """Return the seed of an episode, of 128 bits where there is a key.

    A plant reveals nothing of other plants, as so many seeds cannot be tried.
    """
    if not key:
        return int(np.random.SeedSequence([seed, place]).generate_state(1)[0])
    source = np.random.SeedSequence([seed, place, int(key, 16)])
    return int.from_bytes(source.generate_state(KEY_BYTES // 4).tobytes(), "little")


def _sample_plant(condition: Condition, seed: int, device: Device, key: str) -> Draw:
    place = zlib.crc32(f"{condition.label} {plant_key(condition.name)}".encode())
    own = _own_seed(seed, place, key)
    random = np.random.default_rng([own, 2])
    values: dict[str, Value] = {}
    for name, cable in device.cables.items():
        factors = {
            n: 1.0 + s * _clipped_normal(random) for n, s in CABLE_SPREAD.items()
        }
        unchanged = Liner(cable.friction, cable.static_friction)
        liner = TRANSMISSIONS.get(condition.transmission, unchanged)
        drawn: dict[str, Value] = {
            "friction": factors["friction"] * liner.friction,
            "static_friction": factors["friction"] * liner.static_friction,
            "axial_stiffness": factors["axial_stiffness"] * cable.axial_stiffness,
            "pretension": factors["pretension"] * cable.pretension,
        }
        if cable.path == PATHS[0] and condition.moving_route:
            drawn["bend"] = BENDS[1]
        elif cable.path == PATHS[0]:
            drawn["wrap"] = factors["wrap"] * cable.wrap
        values |= {f"{name}.{key}": value for key, value in drawn.items()}
    impedance = 1.0 + IMPEDANCE_SPREAD * _clipped_normal(random)
    if device.wearers:
        values["wearer"] = condition.impedance * impedance
    source = condition.trajectory
    cadence = 1.0 + CADENCE_SPREAD * _clipped_normal(random)
    low, high = condition.delay
    # In turns: of few seeds each delay has its share, as so much depends on it.
    values["delay"] = low + (seed + place) % (high - low + 1)
    values["noise"] = condition.noise
    sensors = [
        1 + SENSORS_PER_CABLE * len(axis.cables) for axis in device.description.axes
    ]
    known = Plant(device, values)
    aside = np.random.default_rng([own, 4])
    hidden = hidden_effect(known, condition.structure, seed + place, aside)
    plant = known
    if hidden.values or hidden.device is not device:
        plant = Plant(hidden.device, _with_effect(values, hidden.values))
    return Draw(
        plant=plant,
        known=plant if condition.known else known,
        seed=own,
        trajectory=_with_period_factor(source, cadence),
        bias=tuple(
            tuple(condition.noise * BIAS * _clipped_normal(random) for _ in range(own))
            for own in sensors
        ),
        actuation=hidden.actuation,
    )


def _with_effect(
    values: dict[str, Value], effect: dict[str, Value]
) -> dict[str, Value]:
    """Return values with those of an effect, which may bend a conduit otherwise."""
    found = values | effect
    for name in effect:
        cable, _, key = name.rpartition(".")
        if key in {"conduit", "bend"}:
            found.pop(f"{cable}.wrap", None)
    return found


def believed_drives(
    drives: Sequence[Drive],
    driven: Sequence[Sequence[str]],
    draws: Sequence[Draw],
    beliefs: Sequence[Belief],
) -> list[tuple[Drive, ...]]:
    """Return the drives of each plant with the cables that its controller believes.

    The drives, of every axis of the device, give the arms of the cables; `driven` are
    the names of the cables that each motor winds; there are a draw and a belief per
    device.
    """
    found: list[tuple[Drive, ...]] = []
    for drawn, belief in zip(draws, beliefs, strict=True):
        random = np.random.default_rng([drawn.seed, 3])
        cables = drawn.known.cables
        own = []
        for drive, names in zip(drives, driven, strict=True):
            known = tuple(
                CableDrive(belief.of(cables[name], random), s.proximal, s.distal)
                for name, s in zip(names, drive.cables, strict=True)
            )
            own.append(dataclasses.replace(drive, cables=known))
        found.append(tuple(own))
    return found


def _with_period_factor(source: Trajectory, factor: float) -> Trajectory:
    """Return a gait with its period scaled, also inside another trajectory."""
    if isinstance(source, Walk):
        return dataclasses.replace(source, period=factor * source.period)
    if isinstance(source, Together):
        parts = tuple(
            (joint, _with_period_factor(part, factor)) for joint, part in source.parts
        )
        return Together(parts)
    if isinstance(source, Disturbed):
        return dataclasses.replace(
            source, base=_with_period_factor(source.base, factor)
        )
    return source


def _clipped_normal(random: np.random.Generator) -> float:
    return float(min(max(random.normal(), -MAX_SIGMAS), MAX_SIGMAS))
