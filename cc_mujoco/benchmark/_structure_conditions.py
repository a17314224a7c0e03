"""Conditions of the suite `v2`: plants with structure that no controller's model has.

structure_conditions("wrist")
"""

from __future__ import annotations

from cc_mujoco.benchmark._conditions import (
    DEFAULT_CONDITION,
    KNOWN,
    STRUCTURE,
    Condition,
    named_condition,
)
from cc_mujoco.benchmark._generic import (
    joint_trajectory,
    plain_condition,
    trajectory_of,
)
from cc_mujoco.benchmark._structure import (
    EFFECTS,
    LAG_NAME,
    STRUCTURES,
    TREMOR_SHARE,
    has_effect,
)
from cc_mujoco.device import DeviceModel, Plant, find_device
from cc_mujoco.human import Tremor


def structure_conditions(scene: str) -> list[Condition]:
    """Return the conditions of a device with structure that its controller lacks.

    The first is the ordinary one, in which the model lacks nothing.

    Raises:
        CableError: As `generic_conditions`.
    """
    device = find_device(scene)
    model = DeviceModel(device.description, Plant(device).model())
    plain, _ = plain_condition(scene, model)
    found = [named_condition(plain, "-".join(DEFAULT_CONDITION))]
    for name in STRUCTURES:
        if name == LAG_NAME or not has_effect(device, name):
            continue  # instead of one lag `varied-lag` has a range
        changes: dict[str, object] = {"structure": name}
        if name == "tremor":
            parts = [
                Tremor(
                    trajectory_of(plain.trajectory, axis.limb),
                    axis.limb,
                    TREMOR_SHARE * axis.reach,
                )
                for axis in device.description.axes
            ]
            changes["trajectory"] = joint_trajectory(device.description, parts)
        found.append(named_condition(plain, STRUCTURE + name, **changes))
    return found


def known_conditions(scene: str) -> list[Condition]:
    """Return the conditions with an effect in the cable, unknown and known.

    Raises:
        CableError: As `generic_conditions`.
    """
    found = structure_conditions(scene)
    pairs = [
        (one, named_condition(one, KNOWN + one.structure, known=True))
        for one in found
        if one.structure in EFFECTS
    ]
    return [found[0], *(one for pair in pairs for one in pair)]
