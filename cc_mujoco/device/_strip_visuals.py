"""A scene without the parts that do not affect the physics.

The scenes are drawn with care, and most of a step of theirs goes into things that only
draw: sites along the conduits, the tendons through them, bodies that do not move.
Without them a simulation moves the same, bit for bit, in half the time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

import mujoco

from cc_mujoco.cable._parameters import BENDS, PATHS, Cable

ARENA_BYTES = 1 << 16
"""Arena of a bare model [byte]; the scenes make a handful of constraints at most, which
take a hundredth of it. With more, the allocator would be left with holes as large as an
arena whenever a batch of simulations ends, and a study would grow with its designs."""


def strip(whole: mujoco.MjSpec, kept: Collection[str] = ()) -> mujoco.MjSpec:
    """Return a copy with only joints, inertias, actuators and the tendons they need.

    Args:
        whole: the scene; inertias are stated and nothing collides.
        kept: tendons to keep in addition to those of actuators, see `route_tendons`.
    """
    spec = whole.copy()
    spec.memory = ARENA_BYTES
    tendons = {*kept}
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            tendons.add(actuator.target)
    for tendon in list(spec.tendons):
        if tendon.name not in tendons:
            spec.delete(tendon)
        else:
            tendon.material = ""
    wraps = [wrap for tendon in spec.tendons for wrap in tendon.path]
    needed = {wrap.target.name for wrap in wraps if wrap.target is not None}
    needed |= {wrap.sidesite.name for wrap in wraps if wrap.sidesite is not None}
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for thing in [*spec.geoms, *spec.sites]:
        if not thing.name or thing.name not in needed:
            spec.delete(thing)
        else:
            thing.material = ""
    for thing in [*spec.cameras, *spec.lights, *spec.materials, *spec.textures]:
        spec.delete(thing)
    for body in reversed(spec.bodies[1:]):  # children before their parents
        parts = [body.joints, body.bodies, body.geoms, body.sites]
        if not any(parts) and not body.explicitinertial:
            spec.delete(body)
    # Compiled as it is, it would still look for the material of a tendon.
    return spec.copy()


def route_tendons(cables: Iterable[Cable]) -> tuple[str, ...]:
    """Return the tendons that bend or guide a cable, which the physics needs."""
    return tuple(
        cable.route
        for cable in cables
        if cable.bend != BENDS[0] or cable.path != PATHS[0]
    )


def remaining_cable(spec: mujoco.MjSpec, cable: Cable) -> Cable:
    """Return a cable as it is in a stripped scene, which may have lost its tendon."""
    return cable if spec.tendon(cable.route) else cable.replace(route="")
