"""Wearer of a device: the actuators that move its joints."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.device._description import (
    SCENE,
    Axis,
    Cuff,
    Keys,
    rounded,
)
from cc_mujoco.device._moment_arm import Arms
from cc_mujoco.device._mover import Mover, joint_actuators
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.plugin._spec import add_element

EVERY = "*"
"""Name in `[wearer]` that stands for every joint that nothing else moves."""
WEARER_KEYS = ("actuator", "stiffness", "damping", "none")


def derive_movers(
    spec: mujoco.MjSpec, arms: Arms, axes: Sequence[Axis], keys: Keys
) -> dict[str, str]:
    """Return the actuators by which the wearer moves joints; adds those that lack."""
    model = arms.model
    driven = [axis.joint for axis in axes]
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()
    names = [*driven, *(model.joint(hinge).name for hinge in hinges)]
    drums = {axis.drum for axis in axes} - {*driven}
    joints = [name for name in dict.fromkeys(names) if name not in drums]
    wearers = keys.table.tables("wearer")
    for joint, own in wearers.items():
        own.only(*WEARER_KEYS)
        if joint not in (EVERY, *joints):
            raise CableError.unknown(f"joint of the body in {own.where}", joint, joints)
    every = wearers.get(EVERY)
    found: dict[str, str] = {}
    for joint in joints:
        one = wearers.get(joint)
        label = f"wearer.{joint}"
        existing = _springs(model, joint)
        if one is None and not existing and (joint in driven or every is not None):
            if joint in driven and _is_moved(arms, joint):
                keys.sources[label] = SCENE
                continue  # muscles or other actuators move the body by themselves
            one = every or Table(label, {})
        if one is None:
            if existing:
                found[joint] = existing[0]
                keys.sources[label] = SCENE
            continue
        keys.given(label, one.content or None, None)
        if one.content.get("none", False):
            if len(one.content) > 1:
                raise CableError(
                    f"{one.where}: with `none` nothing else goes, as nobody moves "
                    "that joint."
                )
            continue
        name = one.text("actuator")
        if name is not None and name not in existing:
            raise CableError.unknown(
                f"actuator in {one.where} (a position actuator at that joint)",
                name,
                existing,
            )
        name = name or next(iter(existing), "")
        stiffness, damping = one.number("stiffness", 1e-6), one.number("damping", 0)
        if not name:
            inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
            # Assumed: 25 rad/s, and a damping ratio of 0.7.
            if stiffness is None:
                stiffness = rounded(inertia * 25.0**2)
            if damping is None:
                damping = rounded(2.0 * 0.7 * math.sqrt(inertia * stiffness))
            name = f"wearer_{joint}"
            added = add_element(
                spec,
                "actuator",
                name=name,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                target=joint,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            )
            added.gainprm[0] = stiffness
            added.biasprm[:3] = (0.0, -stiffness, -damping)
        elif stiffness is not None or damping is not None:
            mover = Mover.of(model, name)
            own_stiffness, own_damping = dataclasses.astuple(mover.wearer)
            wearer = Wearer(
                own_stiffness if stiffness is None else stiffness,
                own_damping if damping is None else damping,
            )
            mover.impose(spec.actuator(name), wearer)
        found[joint] = name
    return found


def _springs(model: mujoco.MjModel, joint: str) -> list[str]:
    """Return the actuators that pull a joint to where their control says."""
    springs = (
        joint_actuators(model, model.joint(joint).id)
        & (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE)
        & (model.actuator_biasprm[:, 1] < 0.0)
        & (model.actuator_gainprm[:, 0] != 0.0)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
    )
    return [model.actuator(place).name for place in np.flatnonzero(springs).tolist()]


def _is_moved(arms: Arms, joint: str) -> bool:
    """Return whether actuators other than cables move a joint, such as muscles."""
    model = arms.model
    others = model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT
    reach = arms.most[model.actuator_outadr, model.joint(joint).dofadr[0]]
    return bool((others & (model.actuator_plugin < 0) & (reach > 1e-9)).any())


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
