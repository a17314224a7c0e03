"""True parameters of devices, sampled by seed, which a controller does not know.

    drawn = sample_plants(condition, seeds=(0, 1))
    drawn[0].plant.cables["flexor"].friction      # of the plant
    effect_values(find_device("knee.xml"), "seals")
    # {'extensor.seal_proximal': 8.3, 'extensor.seal_distal': 8.3}

A condition and a seed are one plant, motion and noise for every controller, so that
controllers are compared in pairs. Conditions that differ only in model error share
their plants; all others draw independently of each other.

A plant may have an effect that its controller's model lacks. Its size is scaled to the
description of the device: its unit torque and velocity (`Axis.units`), the reach of its
motions and the moment arms of its cables.
"""

import dataclasses
import math
import re
import secrets
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cc_mujoco.benchmark._conditions import (
    TRANSMISSIONS,
    Condition,
    Liner,
    Together,
    clipped_normal,
    plant_key,
)
from cc_mujoco.cable import PATHS, Cable
from cc_mujoco.cable._cable import BENDS
from cc_mujoco.device import Device, DeviceModel, Plant, Value, find_device
from cc_mujoco.device._sensors import BIAS
from cc_mujoco.errors import CableError
from cc_mujoco.human import Disturbed, Trajectory, Walk
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._loop import Columns

SPREAD = {
    "friction": 0.15, "axial_stiffness": 0.1, "pretension": 0.2, "wrap": 0.1,
    "impedance": 0.2, "cadence": 0.03,
}  # fmt: skip
"""Relative standard deviations: of the cables of a plant around their nominal values,
of the wearer's impedance, and of a gait's period."""

LAG_NAME = "motor-lag"  # an effect that is in the motor and in no cable


class _Scale(NamedTuple):
    """Quantities of a cable to which the sizes of effects are proportional."""

    tension: float  # tension of the desired torque that counts as 1 [N]
    speed: float  # speed of the cable at the joint's velocity that counts as 1 [m/s]
    travel: float  # travel of the cable over the reach of named trajectories [m]
    length: float  # length of the cable [m]
    radius: float  # radius of the motor's pulley [m]


def _concentrated(own: _Scale, cable: Cable) -> dict[str, Value]:
    if cable.path != PATHS[0] or not cable.wrap:
        return {}  # the scene draws what bends an open cable
    straight, bent = 0.85 * cable.length, 0.15 * cable.length
    return {"conduit": f"{straight:.9g}:inf {bent:.9g}:{bent / cable.wrap:.9g}"}


EFFECTS: dict[str, Callable[[_Scale, Cable], dict[str, Value]]] = {
    "viscous": lambda own, cable: {
        "viscous_friction": 0.2 * own.tension / (own.speed * own.length)
    },
    "load-independent": lambda own, cable: {
        "load_independent_friction": 0.1 * own.tension / own.length
    },
    "seals": lambda own, cable: (
        {}  # nothing seals a cable that no conduit leads
        if cable.path == PATHS[1]
        else {"seal_proximal": 0.05 * own.tension, "seal_distal": 0.05 * own.tension}
    ),
    "presliding": lambda own, cable: {"bristle_length": 0.1 * own.travel},
    "stribeck": lambda own, cable: {
        "stribeck_friction": 0.5 * cable.friction,
        "stribeck_speed": 0.05 * own.speed,
    },
    "ageing": lambda own, cable: {
        "ageing_friction": 0.2 * cable.friction,
        "ageing_time": 0.1,
        "critical_slip_distance": 0.01 * own.travel,
    },
    "soft-ends": lambda own, cable: {
        name: 1.5 * getattr(cable, name) + 0.25 * own.length / cable.axial_stiffness
        for name in ("end_compliance", "proximal_compliance")
    },
    "eccentric": lambda own, cable: {"eccentricity": 0.05 * own.radius},
    "wrap-end": _concentrated,
    "route": lambda own, cable: (
        {"wrap_growth": 0.3 / own.travel} if cable.path == PATHS[0] else {}
    ),
}
"""Effects in a cable by the name of their condition.

The drag of `viscous` at the velocity that counts as 1 is a fifth of the tension that
counts as 1, that of `load-independent` and of both `seals` a tenth; `presliding` builds
friction up over a tenth of the travel of the cable. `stribeck` adds half of the
friction at rest, `ageing` a fifth with every factor e of rest. `soft-ends` make the
cable half as soft again, `eccentric` pulleys are out of centre by a twentieth of their
radius, `route` bends the conduit by 30 % more or less over the reach of the joint."""

UNSEEN_EFFECTS: dict[str, Callable[[_Scale, Cable], dict[str, Value]]] = {
    "clearance": lambda own, cable: (
        {"clearance": 3e-4, "seating_tension": 0.5 * own.tension}
        if cable.path == PATHS[0]
        else {}  # it has no conduit to lie in
    ),
    "soft-anchors": lambda own, cable: {
        "end_compliance": cable.end_compliance + own.length / cable.axial_stiffness,
        "end_hardening": 1.0 / own.tension,
        "end_loss": 0.3,
    },
}
"""Effects in a cable by the name of their condition in `v3`, of a size drawn between
half and one and a half of these.

A liner is 0.3 mm wider than its cable, as a rope of 0.6 mm in one of 0.9 mm, and taut
at half the tension that counts as 1. Webbing and skin at the joint, slack, are as soft
as the cable, twice as stiff at that tension, and lose 30 % of their work."""

BRISTLES = "bristles"  # cables by other equations, see `_bristles`

POSITION_EFFECTS: dict[str, Callable[[_Scale, Cable], dict[str, Value]]] = {
    "friction-doubled": lambda own, cable: {
        "friction": 2.0 * cable.friction,
        "static_friction": 2.0 * cable.static_friction,
    },
    "bends-halved": lambda own, cable: {"wrap": 0.5 * cable.wrap},
}
"""Further effects in a cable by the name of their condition in `position`."""

STRUCTURES = (
    *EFFECTS, LAG_NAME, "varied-lag", "motor-friction", "cogging", "late-commands",
    "rotor-inertia", "cuff", "tremor",
)  # fmt: skip
"""Every effect by name: those in cables, in motors, and in the wearer."""


@dataclass(frozen=True)
class Actuation:
    """Imperfections of the motor: command delay, and cogging torque by motor angle."""

    delay: int = 0  # control steps by which a command is late
    cogging: tuple[float, ...] = ()  # amplitude of the torque of every motor [N m]
    order: int = 1  # periods of that torque in a turn of the motor's pulley
    phase: float = 0.0  # phase of that torque at an angle of 0 [rad]

    @property
    def is_plain(self) -> bool:
        return not self.delay and not self.cogging


@lru_cache(maxsize=64)
def _scales(device: Device) -> dict[str, _Scale]:
    model = DeviceModel.of(device)
    found: dict[str, _Scale] = {}
    axes, drives = device.description.axes, model.drives(1.0)
    for axis, own, drive in zip(axes, model.axes, drives, strict=True):
        for name, one in zip(own.driven, drive.cables, strict=False):
            arm = abs(one.distal)
            found[name] = _Scale(
                axis.units["desired_torque_nm"] / arm,
                axis.units["joint_velocity_rad_s"] * arm,
                axis.reach * arm,
                device.cables[name].length,
                abs(one.proximal),
            )
    return found


@lru_cache(maxsize=64)
def effect_values(device: Device, name: str) -> dict[str, Value]:
    """Return the parameter values by which a device has an effect of `STRUCTURES`.

    They are {} for an effect outside cables, or that these cables cannot have.
    """
    return _cable_values(Plant(device), name)


def _cable_values(known: Plant, name: str) -> dict[str, Value]:
    device = known.scene
    effects = {**EFFECTS, **POSITION_EFFECTS, **UNSEEN_EFFECTS}
    if name not in effects:
        return {}
    found: dict[str, Value] = {}
    for cable, scale in _scales(device).items():
        own = effects[name](scale, known.cables[cable])
        found |= {f"{cable}.{key}": value for key, value in own.items()}
    return found


def hidden_effect(
    known: Plant, name: str, seed: int, random: np.random.Generator
) -> tuple[Device, dict[str, Value], Actuation]:
    """Return an effect of `STRUCTURES` (or "" for none), scaled to the plant `known`.

    It is the device (with a compliant cuff for that effect), values of plant
    parameters, and imperfections of the motor. Few discrete levels are assigned to
    seeds in turn; everything else is drawn from `random`.
    """
    device, axes = known.scene, known.description.axes
    values = _cable_values(known, name)
    if name in UNSEEN_EFFECTS:
        factor = random.uniform(0.5, 1.5)
        values = {key: factor * float(value) for key, value in values.items()}
    if name == "eccentric":
        phase = random.uniform(-math.pi, math.pi)
        for axis in axes:
            for side, cable in enumerate(axis.cables):
                if f"{cable}.eccentricity" in values:
                    values[f"{cable}.eccentricity_phase"] = phase + math.pi * (side % 2)
    if name == "route":
        for axis in axes:
            for cable in axis.cables:
                own = known.cables[cable]
                # The leg of a wearer who walks bends a conduit that its route draws.
                if "phase_sine" in axis.units and own.route and own.path == PATHS[0]:
                    values = {f"{cable}.bend": BENDS[1]}
    if values or name == "tremor":  # which is in the motion
        return device, values, Actuation()
    drives = DeviceModel.of(known).drives(1.0)
    pairs = zip(axes, drives, strict=True)
    unit = [abs(a.units["desired_torque_nm"] / drive.ratio) for a, drive in pairs]
    if name == "cogging":
        # A share of the torque that counts as 1, in 12 waves in a turn of the pulley.
        phase, size = random.uniform(-math.pi, math.pi), [0.05 * one for one in unit]
        return device, {}, Actuation(0, tuple(size), 12, phase)
    if name == "late-commands":
        return device, {}, Actuation(1 + seed % 3)  # 1 to 3 control steps, in turn
    if name == "cuff":
        return _cuffed(device), {}, Actuation()
    key, each = "", []
    if name in (LAG_NAME, "varied-lag"):
        most = 0.005  # time constant beside that of the scene [s]
        more = most if name == LAG_NAME else random.uniform(0.001, most)
        key, each = "motor_lag", [drive.motor_lag + more for drive in drives]
    elif name == "motor-friction":  # dry, as a share of the torque that counts as 1
        key, each = "motor_friction", [0.1 * size for size in unit]
    elif name == "rotor-inertia":
        factor = (0.6, 1.6)[seed % 2]  # over its assumed value, in turn
        inertias = [float(device.spec.joint(axis.drum).armature) for axis in axes]
        key, each = "rotor_inertia", [factor * inertia for inertia in inertias]
    sizes = zip(axes, each, strict=False)
    values = {f"{axis.name}.{key}": value for axis, value in sizes}
    return device, values, Actuation()


@lru_cache(maxsize=8)
def _cuffed(device: Device) -> Device:
    axis = device.description.axis()
    stiffness = 10.0 * axis.units["desired_torque_nm"] / axis.units["joint_angle_rad"]
    cuff = {"stiffness": stiffness, "damping": 0.01 * stiffness}  # 0.01 s
    return Device(device.name, device.timestep, axis={"cuff": cuff})


def has_effect(device: Device, name: str) -> bool:
    if name in EFFECTS or name in UNSEEN_EFFECTS:
        return bool(effect_values(device, name))
    if name == "cuff":
        one = len(device.description.axes) == 1
        return one and bool(device.wearers) and not device.description.axes[0].cuff
    return name != "tremor" or bool(device.wearers)


@dataclass(frozen=True)
class Draw:
    """A sampled plant, with the sensor bias and motor imperfections of its episode."""

    plant: Plant  # the device with its cables, wearer, delay and noise
    known: Plant  # plant as its controller may know it, without the errors of the model
    seed: int  # seed of its motion and noise, from the episode and its condition
    trajectory: Trajectory
    # Of the joint torque sensor, then of every tension sensor, of each axis, as a
    # multiple of the standard deviation of the device's noise.
    bias: tuple[tuple[float, ...], ...]
    actuation: Actuation = Actuation()  # effects between the controller and the motor


def sample_plants(
    condition: Condition, seeds: Sequence[int], key: str = ""
) -> list[Draw]:
    """Draw a condition's plants by seeds and the secret `key` of the run, if any."""
    device = find_device(condition.scene)
    return [_sample_plant(condition, seed, device, key) for seed in seeds]


def new_key() -> str:
    """Return a random secret key of a run, 32 hexadecimal digits."""
    return secrets.token_hex(16)


def require_key(key: str) -> None:
    if not re.fullmatch("([0-9a-f]{32})?", key):
        raise CableError(
            f"a key has 32 hexadecimal digits, as a results file has it, not {key!r}."
        )


def _own_seed(seed: int, place: int, key: str) -> int:
    """Return the random seed of an episode, of 128 bits with a key.

    With so many possible keys, known plants do not allow others to be predicted.
    """
    if not key:
        return int(np.random.SeedSequence([seed, place]).generate_state(1)[0])
    source = np.random.SeedSequence([seed, place, int(key, 16)])
    return int.from_bytes(source.generate_state(4).tobytes(), "little")


def _sample_plant(condition: Condition, seed: int, device: Device, key: str) -> Draw:
    place = zlib.crc32(f"{condition.label} {plant_key(condition.name)}".encode())
    own = _own_seed(seed, place, key)
    random = np.random.default_rng([own, 2])
    values: dict[str, Value] = {}
    for name, cable in device.cables.items():
        names = ("friction", "axial_stiffness", "pretension", "wrap")
        friction, stiffness, pretension, wrap = (
            1.0 + SPREAD[key] * clipped_normal(random) for key in names
        )
        unchanged = Liner(cable.friction, cable.static_friction)
        liner = TRANSMISSIONS.get(condition.transmission, unchanged)
        drawn: dict[str, Value] = {
            "friction": friction * liner.friction,
            "static_friction": friction * liner.static_friction,
            "axial_stiffness": stiffness * cable.axial_stiffness,
            "pretension": pretension * cable.pretension,
        }
        if cable.path == PATHS[0] and condition.moving_route:
            drawn["bend"] = BENDS[1]
        elif cable.path == PATHS[0]:
            drawn["wrap"] = wrap * cable.wrap
        values |= {f"{name}.{key}": value for key, value in drawn.items()}
    impedance = 1.0 + SPREAD["impedance"] * clipped_normal(random)
    if device.wearers:
        values["wearer"] = condition.impedance * impedance
    cadence = 1.0 + SPREAD["cadence"] * clipped_normal(random)
    low, high = condition.delay
    # In turns: of few seeds each delay has its share, as so much depends on it.
    values["delay"] = low + (seed + place) % (high - low + 1)
    values["noise"] = condition.noise
    # Tension sensors on a cable, see `Sensing.equip`
    sensors = [1 + 3 * len(axis.cables) for axis in device.description.axes]
    known = Plant(device, values)
    aside, level = np.random.default_rng([own, 4]), seed + place
    hidden = hidden_effect(known, condition.structure, level, aside)
    (changed, effect, actuation), plant = hidden, known
    if effect or changed is not device:
        found = values | effect
        for name in effect:  # which may bend a conduit otherwise
            bent, _, changed_key = name.rpartition(".")
            if changed_key in {"conduit", "bend"}:
                found.pop(f"{bent}.wrap", None)
        plant = Plant(changed, found)
    if condition.known:
        known = plant
    size = condition.noise * BIAS
    bias = [tuple(size * clipped_normal(random) for _ in range(n)) for n in sensors]
    trajectory = _with_period_factor(condition.trajectory, cadence)
    return Draw(plant, known, own, trajectory, tuple(bias), actuation)


def _with_period_factor(source: Trajectory, factor: float) -> Trajectory:
    if isinstance(source, Walk):
        return dataclasses.replace(source, period=factor * source.period)
    if isinstance(source, Together):
        parts = ((name, _with_period_factor(p, factor)) for name, p in source.parts)
        return Together(tuple(parts))
    if isinstance(source, Disturbed):
        base = _with_period_factor(source.base, factor)
        return dataclasses.replace(source, base=base)
    return source


class ActuationFaults:
    """Motors that alter the commanded torque; called by `Batch.actuate`."""

    def __init__(
        self, actuations: Sequence[Actuation], prefixes: Sequence[str]
    ) -> None:
        """Prepare for an actuation per device and the column prefix of each axis."""
        shape = len(actuations), len(prefixes)
        self._angles = [f"{prefix}motor_angle_rad" for prefix in prefixes]
        self._delay = np.array([one.delay for one in actuations])
        self._past = np.zeros((int(self._delay.max()) + 1, *shape))
        self._size = np.array([one.cogging or (0.0,) * shape[1] for one in actuations])
        self._order = np.array([[float(one.order)] for one in actuations])
        self._phase = np.array([[one.phase] for one in actuations])

    def __call__(self, step: int, columns: Columns, torque: Array) -> Array:
        """Return the motors' torque (devices, axes) [N m] for that commanded."""
        if step == 0:
            self._past[:] = 0.0
        shape = self._past.shape[1:]
        angle = np.stack([columns[name] for name in self._angles], axis=1)
        self._past = np.roll(self._past, 1, axis=0)
        self._past[0] = np.broadcast_to(np.reshape(torque, (-1, shape[1])), shape)
        late: Array = self._past[self._delay, np.arange(shape[0])]
        wave: Array = np.sin(self._order * angle + self._phase)
        return late + self._size * wave
