"""Removal of the elements of a scene that do not affect its physics.

Sites along conduits, tendons through them and bodies at rest only draw, but can take
half the time of a step. Without them a simulation gives the same bits where the scene
states its inertias, else the same numbers within rounding.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable
from typing import Any

import mujoco

from cc_mujoco.cable._cable import BENDS, PATHS, Cable
from cc_mujoco.plugin import PLUGIN

_ALWAYS_INFERRED = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE

Names = dict[mujoco.mjtObj, set[str]]  # names of elements by their type


def strip(whole: mujoco.MjSpec, kept: Collection[str] = ()) -> mujoco.MjSpec:
    """Return a copy with only the elements that affect the physics.

    Bodies whose inertia follows from their geoms get it stated. Geoms that can collide
    remain if contacts are enabled. So does everything that actuators, tendons with a
    force, equality constraints, flexes and other plugins refer to, and the tendons in
    `kept`, see `route_tendons`.
    """
    spec = whole.copy()
    if any(a.gaintype == mujoco.mjtGain.mjGAIN_MUSCLE for a in spec.actuators):
        # The compiler finds the length ranges of muscles by simulation.
        ranges = whole.copy().compile().actuator_lengthrange
        for actuator, found in zip(spec.actuators, ranges, strict=True):
            if found[0] < found[1]:
                actuator.lengthrange = found
    disabled = mujoco.mjtDisableBit
    none = disabled.mjDSBL_CONTACT.value | disabled.mjDSBL_CONSTRAINT.value
    collides = not int(spec.option.disableflags) & none
    if not collides:
        for pair in [*spec.pairs, *spec.excludes]:
            spec.delete(pair)
    for sensor in list(spec.sensors):
        if sensor.type != mujoco.mjtSensor.mjSENS_PLUGIN:
            spec.delete(sensor)
    configured = _configured_names(spec)
    for tendon in list(spec.tendons):
        if tendon.name not in {*configured, *kept} and not _pulls(spec, tendon):
            spec.delete(tendon)
    needed = _needed_names(spec)
    for names in needed.values():
        names |= configured
    _state_inertias(spec, needed, collides)
    for geom in list(spec.geoms):
        if not _needs(spec, geom, needed, collides):
            spec.delete(geom)
    for kind, elements in (
        (mujoco.mjtObj.mjOBJ_SITE, spec.sites),
        (mujoco.mjtObj.mjOBJ_CAMERA, spec.cameras),
    ):
        for element in list(elements):
            if element.name not in needed[kind]:
                spec.delete(element)
    for drawn in [*spec.tendons, *spec.geoms, *spec.sites, *spec.flexes]:
        drawn.material = ""
    _delete_assets(spec)
    for body in reversed(spec.bodies[1:]):  # children before their parents
        parts = [body.joints, body.bodies, body.geoms, body.sites, body.cameras]
        weighs = body.explicitinertial and (body.mass > 0.0 or not _moves(body))
        named = body.name in needed[mujoco.mjtObj.mjOBJ_BODY]
        if not (any(parts) or weighs or named or body.mocap or body.plugin.active):
            spec.delete(body)
    if not (collides and spec.geoms) and not spec.equalities and not spec.flexes:
        spec.memory = _arena_bytes(spec)
    # Compiled as it is, it would still look for the material of a tendon. What refers
    # to a deleted element is not copied, and the scene would move without it.
    copied = spec.copy()
    return copied if _counts(copied) == _counts(spec) else whole.copy()


def route_tendons(cables: Iterable[Cable]) -> tuple[str, ...]:
    """Return the tendons that bend or guide a cable, which the physics needs."""
    plain = BENDS[0], PATHS[0]
    return tuple(one.route for one in cables if (one.bend, one.path) != plain)


def reserve_memory(spec: mujoco.MjSpec, cables: Iterable[Cable]) -> None:
    """Add arena memory for the work on the cables to a stripped scene."""
    if spec.memory >= 0:  # else MuJoCo decides, and gives plenty
        segments = [cable.segments for cable in cables]
        # For the plugin's work on a segment, for each cable and two more: twice what it
        # needs at least.
        spec.memory += 64 * (len(segments) + 2) * sum(segments)


def remaining_cable(spec: mujoco.MjSpec, cable: Cable) -> Cable:
    """Return the cable without its route if the stripped scene lacks that tendon."""
    return cable if spec.tendon(cable.route) else cable.replace(route="")


def _counts(spec: mujoco.MjSpec) -> list[int]:
    """Return how many elements there are of each type a copy may drop."""
    elements = [spec.joints, spec.actuators, spec.tendons, spec.equalities, spec.keys]
    elements += [spec.pairs, spec.excludes, spec.sensors, spec.flexes, spec.plugins]
    return [len(found) for found in elements]


def _state_inertias(spec: mujoco.MjSpec, needed: Names, collides: bool) -> None:
    """State the inertia of each moving body that is about to lose geoms."""
    if spec.compiler.inertiafromgeom == _ALWAYS_INFERRED:
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        for body in spec.bodies[1:]:
            if body.geoms and not _infers_always(body):  # forget what is stated
                body.explicitinertial = False
                body.mass, body.inertia = 0.0, [0.0] * 3
                body.ipos, body.iquat = [math.nan, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
                body.fullinertia = [math.nan] + [0.0] * 5
                body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    for body in spec.bodies[1:]:
        if not body.explicitinertial and _moves(body):
            if not all(_needs(spec, geom, needed, collides) for geom in body.geoms):
                spec.adopt_inertial(body)


def _infers_always(body: Any) -> bool:
    """Return whether MuJoCo infers a body's inertia from geoms, even a stated one."""
    return bool(body.compiler.inertiafromgeom == _ALWAYS_INFERRED)


def _moves(body: Any) -> bool:
    while body is not None:
        if body.joints:
            return True
        body = body.parent
    return False


def _needs(spec: mujoco.MjSpec, geom: Any, needed: Names, collides: bool) -> bool:
    """Return whether the physics needs a geom for more than its body's inertia."""
    body = geom.parent
    if body.plugin.active or (_moves(body) and _infers_always(body)):
        return True
    touches = collides and (geom.contype != 0 or geom.conaffinity != 0)
    medium = spec.option.density > 0.0 or spec.option.viscosity > 0.0
    named = geom.name in needed[mujoco.mjtObj.mjOBJ_GEOM]
    return bool(touches or (medium and geom.fluid_ellipsoid) or named)


def _pulls(spec: mujoco.MjSpec, tendon: Any) -> bool:
    """Return whether a tendon has a force, or an actuator or equality refers to it."""
    limited = tendon.limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        tendon.limited == mujoco.mjtLimited.mjLIMITED_AUTO
        and tendon.range[0] < tendon.range[1]
    )
    own = [*tendon.stiffness, *tendon.damping, tendon.frictionloss, tendon.armature]
    kind = mujoco.mjtTrn.mjTRN_TENDON
    users = [actuator.target for actuator in spec.actuators if actuator.trntype == kind]
    for equality in spec.equalities:
        if equality.type == mujoco.mjtEq.mjEQ_TENDON:
            users += [equality.name1, equality.name2]
    return limited or any(own) or tendon.name in users


def _configured_names(spec: mujoco.MjSpec) -> set[str]:
    """Return every word in the configurations of plugins other than cables."""
    others = [plugin for plugin in spec.plugins if plugin.plugin_name != PLUGIN]
    texts = [text for plugin in others for text in dict(plugin.config).values()]
    return {word for text in texts for word in text.split()}


def _needed_names(spec: mujoco.MjSpec) -> Names:
    """Return the names, by type, to which the remaining elements refer."""
    body, site, geom = (
        mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_GEOM
    )  # fmt: skip
    needed: Names = defaultdict(set)
    passed = {
        mujoco.mjtWrap.mjWRAP_SITE: site,
        mujoco.mjtWrap.mjWRAP_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
    }
    for wrap in (wrap for tendon in spec.tendons for wrap in tendon.path):
        if wrap.target is not None:
            needed[passed.get(wrap.type, geom)].add(wrap.target.name)
        if wrap.sidesite is not None:
            needed[site].add(wrap.sidesite.name)
    for actuator in spec.actuators:
        needed[site] |= {actuator.refsite, actuator.slidersite}
        if actuator.trntype == mujoco.mjtTrn.mjTRN_BODY:
            needed[body].add(actuator.target)
        else:
            needed[site].add(actuator.target)
    for equality in spec.equalities:
        if equality.objtype in (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE):
            needed[equality.objtype] |= {equality.name1, equality.name2}
    for pair in spec.pairs:
        needed[geom] |= {pair.geomname1, pair.geomname2}
    for exclude in spec.excludes:
        needed[body] |= {exclude.bodyname1, exclude.bodyname2}
    for flex in spec.flexes:
        needed[body] |= {*flex.nodebody, *flex.vertbody}
    for sensor in spec.sensors:
        ends = (sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)
        for kind, name in ends:
            needed[body if kind == mujoco.mjtObj.mjOBJ_XBODY else kind].add(name)
    for kind in (body, site, geom, mujoco.mjtObj.mjOBJ_CAMERA):
        needed[kind].discard("")
    return needed


def _delete_assets(spec: mujoco.MjSpec) -> None:
    drawn = [*spec.lights, *spec.skins, *spec.materials, *spec.textures, *spec.tuples]
    meshes = {geom.meshname for geom in spec.geoms}
    fields = {geom.hfieldname for geom in spec.geoms}
    drawn += [mesh for mesh in spec.meshes if mesh.name not in meshes]
    drawn += [field for field in spec.hfields if field.name not in fields]
    for thing in drawn:
        spec.delete(thing)


def _arena_bytes(spec: mujoco.MjSpec) -> int:
    """Return the size of the arena [B]: four times the need of joints and tendons.

    MuJoCo's default arena of 13 MB would leave holes in the heap whenever a batch of
    simulations ends, so that memory would grow with the number of designs.
    """
    most = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}
    dofs = sum(most.get(joint.type, 1) for joint in spec.joints)
    rows = 2 * (dofs + len(spec.tendons))
    return max(1 << 16, 4 * 8 * (rows * (dofs + 40) + 26 * dofs**2))
