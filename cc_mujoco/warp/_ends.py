"""Ends of cables: actuators whose force the cable gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class HeldCable:
    """A cable and the actuators that hold its ends, see `add_end`."""

    cable: Cable
    """Cable in a conduit whose bends stay."""
    proximal: str | int
    """Name or index of the actuator at the motor's end."""
    distal: str | int
    """Name or index of the actuator at the joint's end."""


def add_end(
    spec: mujoco.MjSpec,
    name: str,
    radius: float,
    *,
    joint: str | None = None,
    tendon: str | None = None,
) -> mujoco.MjsActuator:
    """Add an actuator that holds an end of a cable; its force is 0 until `attach`.

    Args:
        spec: specification to change.
        name: name of the actuator.
        radius: signed radius on which a joint winds the cable [m], or the factor of the
            length of a tendon; a cable moves positive from the motor to the joint.
        joint: joint that holds the end.
        tendon: spatial tendon that holds the end instead.

    Raises:
        CableError: neither or both are given, they are not in the specification, or
            the radius is 0.
    """
    if (joint is None) == (tendon is None):
        raise CableError(f"end {name!r} needs either a joint or a tendon")
    if not (np.isfinite(radius) and radius != 0.0):
        raise CableError(
            f"end {name!r}: radius {radius!r} must be a signed length in metres, not 0"
        )
    kind, target = ("joint", joint) if tendon is None else ("tendon", tendon)
    names = [element.name for element in getattr(spec, f"{kind}s")]
    if target not in names:
        raise CableError.unknown(kind, str(target), names)
    transmission = mujoco.mjtTrn.mjTRN_JOINT
    if tendon is not None:
        transmission = mujoco.mjtTrn.mjTRN_TENDON
    end = spec.add_actuator(name=name, target=target, trntype=transmission)
    end.gear = [radius, 0, 0, 0, 0, 0]
    end.dyntype = mujoco.mjtDyn.mjDYN_NONE
    end.ctrllimited = end.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
    force_of_callback(end)
    return end


def force_of_callback(end: mujoco.MjsActuator) -> None:
    end.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    end.gainprm[0] = 0.0
    end.biastype = mujoco.mjtBias.mjBIAS_USER


def actuators_of(
    model: mujoco.MjModel, cables: Mapping[str, HeldCable]
) -> NDArray[np.int32]:
    names = [model.actuator(i).name for i in range(model.nu)]

    def index(end: str | int) -> int:
        if isinstance(end, int) and 0 <= end < model.nu:
            return end
        if end not in names:
            raise CableError.unknown("actuator", str(end), names)
        return names.index(end)

    found = [[index(held.proximal), index(held.distal)] for held in cables.values()]
    return np.array(found, np.int32)
