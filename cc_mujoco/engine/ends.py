"""What a plugin instance is attached to: its two ends and its route, checked compiled.

The first actuator of an instance (in the order of the model) is the proximal end, the
second the distal end.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit

from cc_mujoco.engine import fields
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import Bytes, append, append_integer

_TRN_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_TRN_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_FIXED_TENDON = int(mujoco.mjtWrap.mjWRAP_JOINT)

_COUNT = constant("it is used by ")
_COUNT_END = constant(
    " actuators; it must be used by two, first the proximal and then the distal end"
)
_ACTUATOR = constant("its actuator '")
_TRANSMISSION = constant(
    "' has the wrong transmission; it must be a hinge or slide `joint` or a spatial "
    "`tendon`"
)
_GEAR = constant("' has gear 0; it must be the signed pulley radius in metres")


@njit(nogil=True)
def find(model: int, instance: int) -> tuple[int, int, int]:
    """Count the actuators of an instance.

    Returns:
        Their number, and the first and the second of them (-1: none).
    """
    count, first, second = 0, -1, -1
    for actuator in range(fields.actuators(model)):
        if fields.integer(model, fields.ACTUATOR_PLUGIN, actuator) == instance:
            if count == 0:
                first = actuator
            elif count == 1:
                second = actuator
            count += 1
    return count, first, second


@njit(nogil=True)
def output(model: int, actuator: int) -> int:
    """Index of an actuator in `actuator_length` and `actuator_force`."""
    return fields.integer(model, fields.ACTUATOR_OUTADR, actuator)


@njit(nogil=True)
def _fits(model: int, actuator: int) -> bool:
    kind = fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator)
    target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    if kind == _TRN_JOINT:
        joint = fields.integer(model, fields.JNT_TYPE, target)
        return joint == _SLIDE or joint == _HINGE
    return kind == _TRN_TENDON and spatial(model, target)


@njit(nogil=True)
def spatial(model: int, tendon: int) -> bool:
    """Whether a tendon is a spatial one."""
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    return fields.integer(model, fields.WRAP_TYPE, start) != _FIXED_TENDON


@njit(nogil=True)
def explain(message: Bytes, used: int, model: int, instance: int) -> int:
    """Add why the ends of an instance cannot be used; nothing where they can.

    Returns:
        The new length.
    """
    count, first, second = find(model, instance)
    if count != 2:
        used = append(message, used, _COUNT)
        used = append_integer(message, used, count)
        return append(message, used, _COUNT_END)
    for actuator in (first, second):
        fits = _fits(model, actuator)
        gear = fields.real(model, fields.ACTUATOR_GEAR, 6 * output(model, actuator))
        if not fits or gear == 0.0:
            used = append(message, used, _ACTUATOR)
            used = append(message, used, fields.actuator_name(model, actuator))
            return append(message, used, _GEAR if fits else _TRANSMISSION)
    return used


@njit(nogil=True)
def has_route(model: int, instance: int, route: Bytes) -> bool:
    """Whether the model has the spatial tendon that an instance names as its route.

    The rule is that of `reading.route_tendon`.
    """
    name = fields.plugin_name(model, instance)
    for tendon in range(fields.tendons(model)):
        if not spatial(model, tendon):
            continue
        candidate = fields.tendon_name(model, tendon)
        for prefix in range(candidate.size - route.size + 1):
            suffix = candidate.size - route.size - prefix
            inside = candidate[prefix : prefix + route.size]
            if (
                prefix + suffix <= name.size
                and np.array_equal(inside, route)
                and np.array_equal(candidate[:prefix], name[:prefix])
                and np.array_equal(
                    candidate[candidate.size - suffix :], name[name.size - suffix :]
                )
            ):
                return True
    return False
