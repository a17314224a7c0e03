"""Cuff of a device: a spring and a damper between its frame and the limb."""

from __future__ import annotations

import dataclasses

import mujoco

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.device._description import Axis, Cuff
from cc_mujoco.errors import CableError
from cc_mujoco.plugin._spec import add_element


def add_cuff(
    spec: mujoco.MjSpec, model: mujoco.MjModel, axis: Axis, table: Table
) -> Axis:
    """Put the cables of an axis on a frame of its own, strapped to the limb.

    The scene `spec` gets a body, a hinge and a tendon by `stiffness`, `damping` and
    `inertia` of `table`; `model` is the scene as it was. Returns the axis with the
    frame's joint in place of the limb's. A cable that wraps around the limb itself is
    refused.
    """
    table.only("stiffness", "damping", "inertia")
    stiffness = table.number("stiffness", 1e-6)
    if stiffness is None:
        raise CableError(f"{table.where} needs `stiffness`, in N m/rad.")
    damping = table.number("damping", 0.0) or 0.0
    inertia = table.number("inertia", 1e-9)
    joint = model.joint(axis.joint)
    if inertia is None:
        inertia = 0.05 * float(model.dof_M0[joint.dofadr[0]])
    limb = model.body(int(model.jnt_bodyid[joint.id]))
    parent = spec.body(model.body(int(limb.parentid[0])).name)
    if model.body_jntnum[limb.id] != 1 or parent is None:
        raise CableError(
            f"{table.where}: joint {axis.joint!r} must be the only one of its body."
        )
    name = f"{axis.joint}_frame"
    if spec.body(name) is not None:
        raise CableError(
            f"{table.where}: the scene has a body {name!r} already, as of the cuff of "
            "another motor at that joint; a joint takes one cuff."
        )
    frame = parent.add_body(name=name, pos=limb.pos, quat=limb.quat)
    frame.explicitinertial = True
    # The hinge's armature is the inertia about the axis; MuJoCo needs a mass.
    frame.mass, frame.inertia = 1e-6, [1e-9, 1e-9, 1e-9]
    add_element(
        frame,
        "joint",
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=model.jnt_pos[joint.id],
        axis=model.jnt_axis[joint.id],
        ref=float(model.qpos0[joint.qposadr[0]]),
        armature=inertia,
    )
    _move_ends(spec, axis, limb.name, frame, table)
    tendon = f"{axis.joint}_cuff"
    strap = add_element(spec, "tendon", name=tendon)
    strap.wrap_joint(name, 1.0)
    strap.wrap_joint(axis.joint, -1.0)
    strap.stiffness[0], strap.damping[0] = stiffness, damping
    strap.springlength = [0.0, 0.0]
    cuff = Cuff(stiffness, damping, inertia, tendon)
    return dataclasses.replace(axis, joint=name, cuff=cuff)


def _move_ends(
    spec: mujoco.MjSpec, axis: Axis, limb: str, frame: mujoco.MjsBody, table: Table
) -> None:
    """Attach to the frame what the cables of an axis held of the limb."""
    tendons = set()
    for actuator in spec.actuators:
        if actuator.plugin.name not in axis.cables:
            continue
        if actuator.target == axis.joint:
            actuator.target = frame.name
        elif actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            tendons.add(actuator.target)
    moved: set[str] = set()
    for name in tendons:
        for wrap in spec.tendon(name).path:
            if wrap.target is None or wrap.target.parent.name != limb:
                continue
            if wrap.type != mujoco.mjtWrap.mjWRAP_SITE:
                raise CableError(
                    f"{table.where}: tendon {name!r} wraps around geom "
                    f"{wrap.target.name!r} of the limb; a cuff needs a frame that the "
                    "scene has itself."
                )
            moved.add(wrap.target.name)
    for name in moved:
        old = spec.site(name)
        place = old.pos.copy()
        old.name = f"{name}_limb"
        add_element(frame, "site", name=name, pos=place, size=old.size, group=old.group)
