"""Suites of the benchmark: devices, conditions, and numbers of seeds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cc_mujoco import human
from cc_mujoco.assets import SCENES
from cc_mujoco.benchmark import _generic as generic
from cc_mujoco.benchmark import _plant as plants
from cc_mujoco.benchmark._bristles import can_have_chains
from cc_mujoco.benchmark._conditions import (
    DEFAULT_CONDITION,
    KNOWN,
    REFERENCES,
    STRUCTURE,
    TRANSMISSIONS,
    Condition,
    crossed_conditions,
    named_condition,
    varied_conditions,
)
from cc_mujoco.benchmark._faults import EVENTS, PLANT_EVENTS, safety_conditions
from cc_mujoco.benchmark._position import position_conditions
from cc_mujoco.cable import PATHS
from cc_mujoco.control import CONTROLLERS, POSITION_CONTROLLERS
from cc_mujoco.device import Axis, find_device
from cc_mujoco.device._device_files import is_device_file
from cc_mujoco.errors import CableError, look_up


def structure_conditions(scene: str) -> list[Condition]:
    """Return conditions whose plants have an effect that the controller's model lacks.

    The first is the ordinary one, without such an effect.
    """
    device, plain = find_device(scene), generic.plain_condition(scene)
    found = [named_condition(plain, "-".join(DEFAULT_CONDITION))]
    for name in plants.STRUCTURES:
        if name == plants.LAG_NAME or not plants.has_effect(device, name):
            continue  # instead of one lag `varied-lag` has a range
        changes: dict[str, object] = {"structure": name}
        if name == "tremor":
            parts = []
            for axis in device.description.axes:
                source, size = plain.trajectory, 0.05 * axis.reach
                source = generic.trajectory_of(source, axis.limb)
                parts.append(human.Tremor(source, axis.limb, size))
            changes["trajectory"] = generic.joint_trajectory(device.description, parts)
        found.append(named_condition(plain, STRUCTURE + name, **changes))
    return found


def known_conditions(scene: str) -> list[Condition]:
    first, *others = structure_conditions(scene)
    found = [first]
    for one in (one for one in others if one.structure in plants.EFFECTS):
        found += [one, named_condition(one, KNOWN + one.structure, known=True)]
    return found


def unseen_conditions(scene: str) -> list[Condition]:
    """Return conditions with effects beyond `v2`, events, and other equations.

    The first is the ordinary one, without any.
    """
    device, plain = find_device(scene), generic.plain_condition(scene)
    names = [n for n in plants.UNSEEN_EFFECTS if plants.has_effect(device, n)]
    names += [plants.BRISTLES] if can_have_chains(device) else []
    guided = all(cable.path == PATHS[0] for cable in device.cables.values())
    several = all(len(axis.cables) > 1 for axis in device.description.axes)
    names += [n for n in EVENTS if n not in PLANT_EVENTS]
    names += ["clamp-slips"] if guided else []
    names += ["cable-off"] if guided and several else []
    return [
        named_condition(plain, "-".join(DEFAULT_CONDITION)),
        *(named_condition(plain, STRUCTURE + n, structure=n) for n in names),
    ]


def _wrist() -> list[Condition]:
    plain = Condition("wrist", "", human.TRAJECTORIES["multisine"], human.Spring(2.5))
    return [*_single_changes(plain), *crossed_conditions(plain)]


def _ankle() -> list[Condition]:
    plain = Condition("ankle", "", human.TRAJECTORIES["walk"], human.TASKS["assist"])
    reversing = human.trajectory("reversals", _axis("ankle").reach)
    held = human.Hold(-15.0)
    still = named_condition(plain, "reversals", trajectory=reversing, task=held)
    common = [still if c.name == "reversals" else c for c in _single_changes(plain)]
    route = named_condition(plain, "moving-route", moving_route=True)
    return [*common, route, *crossed_conditions(plain)]


def _finger() -> list[Condition]:
    reach = human.trajectory("reach", _axis("finger").reach)
    plain = Condition("finger", "", reach, human.TASKS["hold"])
    return [
        named_condition(plain, f"{liner}-{DEFAULT_CONDITION[1]}", transmission=liner)
        for liner in TRANSMISSIONS
    ]


def _axis(scene: str) -> Axis:
    return find_device(scene).description.axis()


def _single_changes(plain: Condition) -> list[Condition]:
    jolted = human.Perturbed(plain.trajectory, _axis(plain.scene).joint)
    return [
        *varied_conditions(plain),
        named_condition(plain, "reversals", trajectory=human.TRAJECTORIES["reversals"]),
        named_condition(plain, "jolted", trajectory=jolted),
        named_condition(plain, "zero-torque", task=human.TASKS["transparent"]),
    ]


@dataclass(frozen=True)
class Suite:
    """Devices and conditions to simulate, and the number of seeds."""

    meaning: str
    scenes: tuple[str, ...]  # played unless some are named
    conditions: Callable[[str], list[Condition]]  # of a device
    seeds: int
    commands_angle: bool = False  # true if the task is an angle, not a torque

    @property
    def references(self) -> tuple[str, ...]:
        """References of its tables; () where an angle is commanded, not a torque."""
        return () if self.commands_angle else tuple(REFERENCES)

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(POSITION_CONTROLLERS if self.commands_angle else CONTROLLERS)


_V1 = {"wrist": _wrist, "ankle": _ankle, "finger": _finger}


def _v1(scene: str) -> list[Condition]:
    if scene not in _V1 and (scene in SCENES or is_device_file(scene)):
        raise CableError(
            f"suite 'v1' has {', '.join(_V1)}, not {scene}: `--suite generic` plays it."
        )
    return look_up("scene", scene, _V1)()


SUITES = {
    "v1": Suite(
        "wrist and ankle in 18 and 19 conditions, finger in three",
        tuple(_V1),
        _v1,
        10,
    ),
    "generic": Suite(
        "any device in up to 24 conditions that follow from its description",
        tuple(name for name in SCENES if name != "endoscope"),  # it commands an angle
        generic.generic_conditions,
        10,
    ),
    "v2": Suite(
        "any device in up to 18 conditions with structure that no model has",
        ("wrist", "ankle", "finger", "exosuit"),
        structure_conditions,
        5,
    ),
    "v2-known": Suite(
        "the effects in cables of `v2`, each unknown and known to the model",
        ("wrist", "ankle", "finger", "exosuit"),
        known_conditions,
        5,
    ),
    "v3": Suite(
        "any device in up to 10 conditions with effects beyond v2, events, and cables "
        "by other equations",
        ("wrist", "ankle", "finger", "exosuit"),
        unseen_conditions,
        5,
    ),
    "safety": Suite(
        "any device whose sensors or strap fail, in up to 12 conditions",
        ("wrist", "ankle", "finger", "exosuit"),
        safety_conditions,
        5,
    ),
    "position": Suite(
        "a commanded angle in 8 conditions, with inverses of hysteresis",
        ("endoscope",),
        position_conditions,
        5,
        commands_angle=True,
    ),
}
"""Suites by name. A published one is never changed: a new one gets a new name."""


def default_suite(scenes: Sequence[str]) -> str:
    if scenes and all(map(_commands_angle, scenes)):
        return "position"
    return "generic" if any(map(is_device_file, scenes)) else "v1"


def _commands_angle(scene: str) -> bool:
    if scene not in SCENES and not is_device_file(scene):
        return False
    own = find_device(scene).description
    return all(human.task(a.task, own.limbs(a)).commands_angle for a in own.axes)
