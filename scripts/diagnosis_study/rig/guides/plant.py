"""The physics of a rig with guides as the numbers that the integrator takes.

The value that switches a hidden thing off is its default, always 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.nominal import Rig

Array = NDArray[np.float64]

GUIDES = 36
"""Rings per cable that the cable is bent over, between straight pieces."""
UNEVEN = 0.15
"""How far bends and pieces differ from their mean, relative."""


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    # --- the bench -----------------------------------------------------------
    motor_radius: float
    joint_radius: float
    bend: Array
    """Of every guide (2, guides) [rad]."""
    piece: Array
    """Stiffness of every piece (2, guides + 1) [N/m]."""
    piece_share: Array
    """Length of every piece over that of the cable (2, guides + 1)."""
    friction: Array
    """(2,) coefficient."""
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    yield_travel: float = 5e-7
    """Travel over which a contact comes to sliding [m]."""
    reference_tension: float = 80.0

    # --- friction ------------------------------------------------------------
    dashpot: float = 0.0
    """Force per speed, one cable [N s/m]; guides near the motor have more of it."""
    stick_excess: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    stick_speed: float = 0.03
    lean: float = 0.0
    """Excess of friction while cable a goes to the motor, relative."""
    wiper: float = 0.0
    """Friction of the wipers of one cable, that needs no load [N]."""
    adhesion: float = 0.0
    """Loss of friction coefficient from no tension to much, relative."""
    bonding: float = 0.0
    """Growth of friction in a long rest, relative."""
    bonding_time: float = 0.4
    bonding_slip: float = 1e-4
    flexing: float = 0.0
    """Wrap gained per joint angle at the joint's end of the conduit."""
    running_in: float = 0.0
    """Change of friction over long travel, relative."""
    running_travel: float = 1.0

    # --- elasticity and geometry ------------------------------------------------
    settling: float = 0.0
    """Part of the pretension that is lost in the end."""
    settling_time: float = 0.3
    sag: float = 0.0
    """Stretch over which a cable comes from slack to taut [m]."""
    anchor: float = 0.0
    """Compliance of the anchorage at the joint, one cable [m/N]."""
    anchor_time: float = 2e-3
    """Its damping over its stiffness [s]."""
    offcentre: float = 0.0
    """Distance of the motor pulley's axis from its middle [m]."""
    offcentre_phase: float = 0.0
    play: float = 0.0
    """Full gap between joint pulley and handle [rad]."""
    stop_stiffness: float = 2e3
    stop_damping: float = 0.5
    hub_inertia: float = 2.5e-4

    # --- loads on the shafts ----------------------------------------------------
    detent: float = 0.0
    """Torque of the motor's poles, a wave of parabolas [Nm]."""
    detent_order: float = 14.0
    detent_phase: float = 0.0
    gear_inertia: float = 0.0
    """Between torque sensor and motor pulley [kg m^2]."""
    unbalance: float = 0.0
    """Of the joint pulley, m g l [Nm]."""
    unbalance_phase: float = 0.0
    strap: float = 0.0
    """Elastic strap over the joint pulley [Nm/rad], a little stiffer when stretched."""
    strap_rest: float = 0.0
    flywheel: float = 0.0
    """Extra inertia of the joint pulley [kg m^2]."""

    # --- what no library should know ----------------------------------------------
    notches: float = 0.0
    """Force of a notched ring near the middle of cable a [N]."""
    notch_pitch: float = 6e-3
    rubbing: float = 0.0
    """Friction of a cable by the other's tension over the reference, relative."""
    snapping: float = 0.0
    """Length that the conduit of cable a gives when it snaps over [m]."""
    snap_tension: float = 100.0
    bearing: float = 0.0
    """Friction of the joint pulley's bearing, that no sensor sees [Nm]."""


def plant_of(rig: Rig) -> Plant:
    """The plant of a rig in which nothing is hidden.

    Bends and pieces are drawn from the rig's seed; their sums are the rig's.
    """
    random = np.random.default_rng([rig.seed, 0x6D1])

    def drawn(count: int, whole: float) -> Array:
        parts = 1.0 + UNEVEN * random.uniform(-1.0, 1.0, (2, count))
        return np.asarray(whole * parts / parts.sum(axis=1, keepdims=True))

    # The first and the last guide are half a piece from the ends.
    length = drawn(GUIDES + 1, rig.length)
    length[:, [0, -1]] *= 0.5
    length *= rig.length / length.sum(axis=1, keepdims=True)
    return Plant(
        rig.motor_radius,
        rig.joint_radius,
        drawn(GUIDES, rig.wrap),
        rig.axial_stiffness / length,
        length / rig.length,
        np.array([rig.friction_a, rig.friction_b]),
        rig.joint_inertia,
        rig.joint_damping,
        rig.rotor_inertia,
    )
