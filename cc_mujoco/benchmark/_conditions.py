"""Conditions that a suite plays, each of which differs from the ordinary one.

    SUITES["v1"].conditions("wrist")

Transmission and error of the model are crossed, as the one says how much depends on the
other. All else is varied one at a time from the ordinary condition: a full cross of the
levels here would be some thousand conditions for each device.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cc_mujoco.assets import SCENES
from cc_mujoco.device import find_device
from cc_mujoco.device._description import ENDING, Axis, Description
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import (
    TASKS,
    TRAJECTORIES,
    Hold,
    Perturbed,
    Spring,
    Task,
    Trajectory,
    Walk,
    trajectory,
)


class _Liner(NamedTuple):
    """Friction coefficients of a cable in what leads it."""

    friction: float
    """Kinetic [-]."""
    static_friction: float
    """Break-away, across a segment as in the thesis [-]."""


TRANSMISSIONS = {
    "good": _Liner(0.05, 0.06),
    "ordinary": _Liner(0.10, 0.15),
    "table22": _Liner(0.21, 0.63),
}
"""A good liner and an ordinary one (assumed), and that of Table 2.2 of the thesis."""

MODEL_ERRORS = {"exact": 0.0, "rough": 0.1, "bad": 0.3}
"""Standard deviations of the relative errors of what a controller believes."""

DEFAULT_CONDITION = "ordinary", "rough"
"""Transmission and error of the condition that all others differ from."""


@dataclass(frozen=True)
class Condition:
    """Condition that all seeds of a cell have in common."""

    scene: str
    """Name or file of the device."""
    name: str
    trajectory: Trajectory
    """Motion of the wearer at all axes."""
    task: Task | tuple[Task, ...]
    """Task of all axes, or of each."""
    transmission: str = DEFAULT_CONDITION[0]
    """A key of `TRANSMISSIONS`."""
    error: str = DEFAULT_CONDITION[1]
    """A key of `MODEL_ERRORS`."""
    impedance: float = 1.0
    """Impedance of the wearer, as a multiple of the scene's."""
    delay: tuple[int, int] = (1, 2)
    """Least and most control steps by which measurements are late."""
    noise: float = 1.0
    """Noise of all sensors and their biases, as a multiple of the device's."""
    moving_route: bool = False
    """True if the conduit bends as the leg moves."""
    duration: float = 4.0
    """Length of an episode [s]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        axes = find_device(self.scene).description.axes
        if isinstance(self.task, tuple) and len(self.task) != len(axes):
            raise CableError(
                f"{self.scene} has {len(axes)} axes; a condition needs one task, or "
                f"one for each, not {len(self.task)}."
            )
        look_up("transmission", self.transmission, TRANSMISSIONS)
        look_up("error", self.error, MODEL_ERRORS)
        if not self.duration > MIN_DURATION:
            raise CableError(
                f"duration must be above {MIN_DURATION:g} s, not {self.duration!r}."
            )
        low, high = self.delay
        if not 0 <= low <= high <= 1000:
            raise CableError(f"delay must be 0 to 1000 steps, not {self.delay!r}.")

    @property
    def label(self) -> str:
        """Name of the device in tables: that of its file without folder and ending."""
        return device_label(self.scene)

    @property
    def text(self) -> str:
        """Text that is equal for equal conditions, wherever the file of a device is."""
        return repr(self).replace(repr(self.scene), repr(self.label), 1)

    def tasks(self, description: Description) -> dict[str, Task]:
        """Return the task of every axis by its name."""
        axes = description.axes
        tasks = self.task if isinstance(self.task, tuple) else (self.task,) * len(axes)
        return {axis.name: task for axis, task in zip(axes, tasks, strict=True)}

    @property
    def usual(self) -> bool:
        """Return whether this is the condition that the others differ from."""
        return self.name == "-".join(DEFAULT_CONDITION)


def device_label(scene: str) -> str:
    """Return the name of a device in tables, without folder and ending."""
    if scene in SCENES:
        return scene
    name = Path(scene).name
    return name.removesuffix(ENDING).removesuffix(".toml").removesuffix(".xml")


def is_walk(source: Trajectory) -> bool:
    """Return whether a trajectory is a walk, jolted or not."""
    while isinstance(source, Perturbed):
        source = source.base
    return isinstance(source, Walk)


def plant_key(name: str) -> str:
    """Return the key that samples the plants of a condition, by the condition's name.

    Errors of the model meet the same plants; all other conditions have their own.
    """
    liner, _, error = name.partition("-")
    return liner if liner in TRANSMISSIONS and error in MODEL_ERRORS else name


MIN_DURATION = 1.0
"""Length that an episode must exceed, whose first half is not scored [s]."""


def _wrist() -> list[Condition]:
    plain = Condition("wrist", "", TRAJECTORIES["multisine"], Spring(2.5))
    return [*_single_changes(plain), *_crossed_conditions(plain)]


def _ankle() -> list[Condition]:
    plain = Condition("ankle", "", TRAJECTORIES["walk"], TASKS["assist"])
    reversing = trajectory("reversals", _axis("ankle").reach)
    still = _named_condition(plain, "reversals", trajectory=reversing, task=Hold(-15.0))
    common = [still if c.name == "reversals" else c for c in _single_changes(plain)]
    route = _named_condition(plain, "moving-route", moving_route=True)
    return [*common, route, *_crossed_conditions(plain)]


def _finger() -> list[Condition]:
    reach = trajectory("reach", _axis("finger").reach)
    return _liner_conditions(Condition("finger", "", reach, TASKS["hold"]))


def _axis(scene: str) -> Axis:
    return find_device(scene).description.axis()


def _single_changes(plain: Condition) -> list[Condition]:
    """Return the conditions that change one thing at a time."""
    joint = _axis(plain.scene).joint
    return [
        _named_condition(plain, "delay-none", delay=(0, 0)),
        _named_condition(plain, "delay-long", delay=(3, 5)),
        _named_condition(plain, "noise-none", noise=0.0),
        _named_condition(plain, "noise-loud", noise=5.0),
        _named_condition(plain, "wearer-soft", impedance=0.3),
        _named_condition(plain, "wearer-stiff", impedance=3.0),
        _named_condition(plain, "reversals", trajectory=TRAJECTORIES["reversals"]),
        _named_condition(
            plain, "jolted", trajectory=Perturbed(plain.trajectory, joint)
        ),
        _named_condition(plain, "zero-torque", task=TASKS["transparent"]),
    ]


def _crossed_conditions(plain: Condition) -> list[Condition]:
    return [
        _named_condition(plain, f"{liner}-{error}", transmission=liner, error=error)
        for liner in TRANSMISSIONS
        for error in MODEL_ERRORS
    ]


def _liner_conditions(plain: Condition) -> list[Condition]:
    return [
        _named_condition(plain, f"{liner}-{DEFAULT_CONDITION[1]}", transmission=liner)
        for liner in TRANSMISSIONS
    ]


def _named_condition(plain: Condition, name: str, **changes: object) -> Condition:
    return dataclasses.replace(plain, name=name, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Suite:
    """Conditions that are played, and the number of seeds."""

    meaning: str
    makers: dict[str, Callable[[], list[Condition]]]
    """Devices and their conditions."""
    seeds: int
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Devices that the suite cannot have any more, and the reason."""

    def conditions(self, scene: str) -> list[Condition]:
        """Return all conditions of a device.

        Raises:
            CableError: If the suite has no such device.
        """
        if scene in self.left_out:
            raise CableError(
                f"the suite has {scene!r} no more: {self.left_out[scene]}; "
                "`--suite generic` plays it."
            )
        return look_up("scene", scene, self.makers)()


SUITES = {
    "v1": Suite(
        "wrist and ankle in 18 and 19 conditions, finger in three",
        {"wrist": _wrist, "ankle": _ankle, "finger": _finger},
        10,
        {
            "exosuit": "the motor at its heel followed the gait by itself, and is an "
            "axis with a controller now"
        },
    ),
}
"""A suite that has been published is never changed: a new one gets a new name."""
