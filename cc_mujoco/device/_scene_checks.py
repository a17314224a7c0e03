"""Preparation of a scene for a device: root, names, and what it cannot mean."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.device._description import ASSUMED, FREE_ROOTS, GIVEN, DescriptionReader
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._spec import error_sentence


def compile_scene(spec: mujoco.MjSpec, scene: str) -> mujoco.MjModel:
    """Return the model of a scene, which can still be changed afterwards."""
    try:
        # A copy, as elements of what was compiled cannot all be taken out later.
        return spec.copy().compile()
    except ValueError as error:
        reason = error_sentence(error)
        raise CableError(f"scene {scene} does not compile: {reason}") from None


def names_of(elements: Iterable[Any]) -> list[str]:
    """Return the names of elements, as far as they have one."""
    return [element.name for element in elements if element.name]


def hold_root(spec: mujoco.MjSpec, table: Table, read: DescriptionReader) -> None:
    """Take the free joints out, unless the description lets them be free."""
    choice = table.choice("root", FREE_ROOTS)
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        return
    read.note("root", ASSUMED if choice is None else GIVEN)
    if choice == "free":
        return
    if choice is None:
        warnings.warn(
            f"device {table.where}: the body on free joint {free[0].name!r} is held "
            'where it is; root = "free" or "held" in the description says which.',
            CableWarning,
            stacklevel=2,
        )
    # Episodes begin in the neutral pose; keyframes count the coordinates of the root.
    for element in [*spec.keys, *free]:
        spec.delete(element)


def require_targets(spec: mujoco.MjSpec, scene: str) -> None:
    """Refuse an end of a cable on a joint or a tendon that is not there."""
    kinds = {
        mujoco.mjtTrn.mjTRN_JOINT: ("joint", spec.joints),
        mujoco.mjtTrn.mjTRN_TENDON: ("tendon", spec.tendons),
    }
    for actuator in spec.actuators:
        if actuator.plugin.plugin_name != PLUGIN or actuator.trntype not in kinds:
            continue
        kind, elements = kinds[actuator.trntype]
        names = names_of(elements)
        if actuator.target not in names:
            where = f"{kind} of cable {actuator.plugin.name!r} in scene {scene}"
            raise CableError.unknown(where, str(actuator.target), names)


def warn_of_degrees(model: mujoco.MjModel, scene: str) -> None:
    """Warn of the range of a hinge that looks like degrees."""
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    for joint in np.flatnonzero(hinges).tolist():
        low, high = model.jnt_range[joint].tolist()
        # So wide a range looks like degrees.
        if high - low > 6.0 * math.pi and not _is_drum(model, joint):
            warnings.warn(
                f"scene {scene}: joint {model.joint(joint).name!r} has a range of "
                f"{low:g} to {high:g} rad; if these are degrees, `angle` in <compiler> "
                "must be degree.",
                CableWarning,
                stacklevel=2,
            )


def _is_drum(model: mujoco.MjModel, joint: int) -> bool:
    """Return whether a motor other than a cable and a spring turns a joint."""
    on = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_trnid[:, 0] == joint
    )
    free = (model.actuator_plugin < 0) & (
        model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
    )
    return bool((on & free).any())


def name_parts(spec: mujoco.MjSpec) -> None:
    """Name what a device has to find again: actuators and joints without a name."""
    taken = {*names_of(spec.actuators)}
    for place, joint in enumerate(spec.joints):
        if not joint.name:
            joint.name = f"joint_{place}"
    for actuator in spec.actuators:
        if not actuator.name:
            base = actuator.plugin.name or "actuator"
            name = f"{base}_{actuator.target}"
            while name in taken:
                name += "_"
            actuator.name = name
            taken.add(name)
