"""Conditions of a suite, each a variation of the ordinary one, and references.

    SUITES["v1"].conditions("wrist")

Cable friction and model error interact, so all their combinations are conditions.
Everything else varies one at a time from the ordinary condition, as a full cross would
be some thousand conditions for each device.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco import human
from cc_mujoco._validation import require_parameter
from cc_mujoco.cable import Cable
from cc_mujoco.device import UNPLUGGED, Value, find_device
from cc_mujoco.device._description import Description, device_label
from cc_mujoco.errors import CableError, look_up


class Liner(NamedTuple):
    friction: float  # kinetic [-]
    static_friction: float  # break-away, across a segment as in the thesis [-]


TRANSMISSIONS = {
    "good": Liner(0.05, 0.06),  # assumed
    "ordinary": Liner(0.10, 0.15),  # assumed
    "table22": Liner(0.21, 0.63),  # Table 2.2 of the thesis
}
OWN_LINER = "own"  # transmission with the friction of the scene

# Standard deviations of the relative errors of a controller's parameters
MODEL_ERRORS = {"exact": 0.0, "rough": 0.1, "bad": 0.3}

# Transmission and error of the condition that all others differ from
DEFAULT_CONDITION = "ordinary", "rough"

STRUCTURE, KNOWN, STALE, FITTED_ANEW = "structure-", "known-", "-stale", "-fitted"
"""Prefixes of the names of conditions with an effect that the controller does not know,
and with the same that it knows. Suffixes of those of the suite `position`, by the trial
that fits the controllers: one on the scene, or one on the plant itself."""

WARM_UP = 0.5  # time at the start of an episode that has no score [s]


@dataclass(frozen=True)
class Together(human.Trajectory):
    parts: tuple[tuple[str, human.Trajectory], ...]  # joints and their trajectories

    def _motion(
        self, time: NDArray[np.float64], duration: float, rng: np.random.Generator
    ) -> human.Motion:
        step = float(time[1] - time[0])
        others: dict[str, human.Motion] = {}
        own: dict[str, human.Motion] = {}
        for joint, source in self.parts:
            motion = source.sample(duration, step, rng)
            others |= motion.companions
            moved = motion.companions.get(joint, motion)
            own[joint] = dataclasses.replace(moved, companions={})
        first = next(iter(own.values()))
        return dataclasses.replace(first, companions=others | own)


@dataclass(frozen=True)
class Condition:
    """Condition of an episode: device, motion, task, sensors, plant and model error."""

    scene: str  # name or file of the device
    name: str
    trajectory: human.Trajectory  # of the wearer at all axes
    task: human.Task | tuple[human.Task, ...]  # of all axes, or of each
    transmission: str = DEFAULT_CONDITION[0]  # key of `TRANSMISSIONS`, or `OWN_LINER`
    error: str = DEFAULT_CONDITION[1]  # a key of `MODEL_ERRORS`
    impedance: float = 1.0  # of the wearer, as a multiple of the scene's
    delay: tuple[int, int] = (1, 2)  # least and most, of measurements [control steps]
    noise: float = 1.0  # of all sensors and their biases, over the device's
    moving_route: bool = False  # true if the conduit bends as the leg moves
    structure: str = ""  # effect of the plant, unknown to the controller; see `_plant`
    known: bool = False  # true if its model has that effect, too; of a cable alone
    duration: float = 4.0  # length of an episode [s]

    def __post_init__(self) -> None:
        axes = find_device(self.scene).description.axes
        if isinstance(self.task, tuple) and len(self.task) != len(axes):
            raise CableError(
                f"{self.scene} has {len(axes)} axes; a condition needs one task, or "
                f"one for each, not {len(self.task)}."
            )
        look_up("transmission", self.transmission, {**TRANSMISSIONS, OWN_LINER: None})
        look_up("error", self.error, MODEL_ERRORS)
        if not self.duration > 2.0 * WARM_UP:
            raise CableError(
                f"duration must be more than {2.0 * WARM_UP:g} s, not "
                f"{self.duration:g} s: the first {WARM_UP:g} s have no score, and as "
                f"much must be left; take {3.0 * WARM_UP:g} s for a quick look."
            )
        low, high = self.delay
        if not 0 <= low <= high <= 1000:
            raise CableError(f"delay must be 0 to 1000 steps, not {self.delay!r}.")

    @property
    def label(self) -> str:
        """Name of the device in tables: its file without folder and suffix."""
        return device_label(self.scene)

    @property
    def text(self) -> str:
        """Text that is equal for equal conditions, in whatever folder the device is."""
        return repr(self).replace(repr(self.scene), repr(self.label), 1)

    def tasks(self, description: Description) -> dict[str, human.Task]:
        """Return the task by name of the axis."""
        axes = description.axes
        tasks = self.task if isinstance(self.task, tuple) else (self.task,) * len(axes)
        return {axis.name: task for axis, task in zip(axes, tasks, strict=True)}

    @property
    def usual(self) -> bool:
        """True for the ordinary condition, from which all others vary."""
        return self.name == "-".join(DEFAULT_CONDITION)


def is_walk(source: human.Trajectory) -> bool:
    while isinstance(source, human.Disturbed):
        source = source.base
    if isinstance(source, Together):
        return all(is_walk(part) for _, part in source.parts)
    return isinstance(source, human.Walk)


def plant_key(name: str) -> str:
    """Return the text that seeds the plants of the condition of this name.

    Conditions that differ only in what the controller knows share their plants.
    """
    if name.startswith(KNOWN):
        return STRUCTURE + name.removeprefix(KNOWN)
    for ending in (STALE, FITTED_ANEW):
        if name.endswith(ending):
            return name.removesuffix(ending)
    liner, _, error = name.partition("-")
    return liner if liner in TRANSMISSIONS and error in MODEL_ERRORS else name


def crossed_conditions(plain: Condition) -> list[Condition]:
    return [
        named_condition(plain, f"{liner}-{error}", transmission=liner, error=error)
        for liner in TRANSMISSIONS
        for error in MODEL_ERRORS
    ]


def varied_conditions(plain: Condition, has_wearer: bool = True) -> list[Condition]:
    """Return conditions of other sensor delay or noise or, if any, another wearer."""
    changes: dict[str, dict[str, object]] = {
        "delay-none": {"delay": (0, 0)},
        "delay-long": {"delay": (3, 5)},
        "noise-none": {"noise": 0.0},
        "noise-loud": {"noise": 5.0},
    }
    if has_wearer:
        changes |= {"wearer-soft": {"impedance": 0.3}}
        changes |= {"wearer-stiff": {"impedance": 3.0}}
    return [named_condition(plain, name, **own) for name, own in changes.items()]


def named_condition(plain: Condition, name: str, **changes: object) -> Condition:
    return dataclasses.replace(plain, name=name, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Belief:
    """Random relative errors of the cable parameters that a controller assumes."""

    error: float = 0.1  # of both friction coefficients, axial stiffness, pretension
    bias: float = 0.0  # of friction, the same for all, added to the draw

    def __post_init__(self) -> None:
        require_parameter(self, "error", 0.0, 0.3, "")
        require_parameter(self, "bias", -0.9, 5.0, "")

    def of(self, cable: Cable, random: np.random.Generator) -> Cable:
        """Return the cable with errors sampled from `random`, its route unchanged."""
        friction, stiffness, pretension = (
            self.error * clipped_normal(random) for _ in range(3)
        )
        factor = max(1.0 + self.bias + friction, 0.05)
        return cable.replace(
            friction=factor * cable.friction,
            static_friction=factor * cable.static_friction,
            axial_stiffness=(1.0 + stiffness) * cable.axial_stiffness,
            pretension=(1.0 + pretension) * cable.pretension,
        )


def clipped_normal(random: np.random.Generator) -> float:
    return float(min(max(random.normal(), -3.0), 3.0))


@dataclass(frozen=True)
class Reference:
    """A device or controller that no user enters, which gives errors a scale."""

    meaning: str
    controller: str | None = None  # without one the motor gives no torque
    changes: dict[str, Value] = field(default_factory=dict)  # to every cable
    ideal: bool = False  # true if the desired torque reaches the joint in any case
    belief: Belief | None = None  # that of the condition by default


SCALE_CONTROLLER = "none"  # whose mean error in a condition is an error of 1

REFERENCES = {
    "unplugged": Reference(
        "the device without its cables: the joint feels nothing", changes=UNPLUGGED
    ),
    "motor-off": Reference("the cables are there and the motor gives no torque"),
    "ideal-transmission": Reference(
        "what the motor can give of the desired torque, as late as it is measured, "
        "reaches the joint of the unplugged device",
        changes=UNPLUGGED,
        ideal=True,
    ),
    "perfect-model": Reference(
        "`stiction` that knows the cables as they are; sensors as usual",
        "stiction",
        belief=Belief(0.0),
    ),
}
"""Every reference by name; `none` is one too, and a controller."""
