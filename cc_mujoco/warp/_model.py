"""Ends of cables in a model, and checks for features that mujoco_warp cannot run."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import mujoco_warp as mjw
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._cable import BENDS, PATHS, Cable
from cc_mujoco.cable._route import Route
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class HeldCable:
    """Cable and the actuators that hold its ends, see `add_end`."""

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
        radius: signed radius on which a joint winds the cable [m], or the factor on a
            tendon's length; displacement is positive from the motor to the joint.
        joint: joint that holds the end.
        tendon: tendon that holds the end instead.

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
    transmission = getattr(mujoco.mjtTrn, f"mjTRN_{kind.upper()}")
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


def require_supported(integrator: int) -> None:
    """Require an integrator with which cables can run in mujoco_warp."""
    if integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise CableError(
            "cables in mujoco_warp take one evaluation a step; set the integrator to "
            "Euler or implicitfast, not RK4"
        )


def require_routes(cables: Mapping[str, Cable], routes: Mapping[str, Route]) -> None:
    """Require a route for each cable whose path is that of a tendon."""
    for name, cable in cables.items():
        for key, usual in (("bend", BENDS[0]), ("path", PATHS[0])):
            if name not in routes and getattr(cable, key) != usual:
                raise CableError(
                    f"cable {name!r}: {key}={getattr(cable, key)!r} needs the tendon "
                    "of a scene with the plugin; attach that scene, or use "
                    f"{key}={usual!r}"
                )


def require_plain(
    m: mjw.Model, model: mujoco.MjModel, actuators: NDArray[np.int32]
) -> None:
    kinds = m.actuator_biastype.numpy()
    user = int(mujoco.mjtBias.mjBIAS_USER)
    if kinds.size != model.actuator_plugin.size or np.any(kinds[actuators] != user):
        raise CableError(
            "this mujoco_warp model is not of the scene with its cables; make it of "
            "cc_mujoco.warp.without_plugin(spec).compile()"
        )


def require_shared_positions(m: mjw.Model) -> None:
    """Require that all worlds share the positions that determine paths in `qpos0`."""
    for name in (
        "qpos0", "body_pos", "body_quat", "jnt_pos", "jnt_axis", "site_pos", "geom_pos",
        "geom_quat", "geom_size",
    ):  # fmt: skip
        if getattr(m, name).shape[0] > 1:
            raise CableError(
                f"{name} of the mujoco_warp model differs from world to world, and "
                "cables are laid at rest on the path that the scene has in qpos0; "
                "attach them with rest_in_pose=True"
            )


def end_rate(
    model: mujoco.MjModel, prm: FloatArray, n: int, actuator: int, end: int
) -> float:
    """Return the squared frequency of an end (0, 1) alone on a held cable [1/s^2]."""
    target = model.actuator_trnid[actuator, 0]
    if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        dof = model.jnt_dofadr[target]
        mobility = model.dof_invweight0[dof]
        if model.dof_armature[dof] > 0.0:
            mobility = min(mobility, 1.0 / model.dof_armature[dof])
    else:
        mobility = model.tendon_invweight0[target]
    stiffness = kernel.end_stiffness(prm, n, end == 1)
    return float(mobility * model.actuator_gear[actuator, 0] ** 2 * stiffness)
