"""Physics of a rig with guides: the constants of the integrator.

Every hidden effect is off at its default, 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix
from rig.nominal import Rig

Array = NDArray[np.float64]

GUIDES = 36
"""Guide rings per cable, which bend it between straight pieces."""
UNEVEN = 0.15
"""Largest relative deviation of bends and pieces from their mean."""


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    # --- the bench -----------------------------------------------------------
    motor_radius: float
    joint_radius: float
    bend: FloatMatrix
    """Bend at every guide (2, guides) [rad]."""
    piece: FloatMatrix
    """Stiffness of every piece (2, guides + 1) [N/m]."""
    piece_share: FloatMatrix
    """Length of every piece over that of the cable (2, guides + 1)."""
    friction: FloatArray
    """Coefficient of friction (2,)."""
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    yield_travel: float = 5e-7
    """Travel of a contact up to sliding [m]."""
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
    """Load-independent friction of the wipers of one cable [N]."""
    adhesion: float = 0.0
    """Relative loss of the friction coefficient from low to high tension."""
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
    """Fraction of the pretension that is lost eventually."""
    settling_time: float = 0.3
    sag: float = 0.0
    """Stretch of a cable from slack to taut [m]."""
    anchor: float = 0.0
    """Compliance of the anchorage at the joint, one cable [m/N]."""
    anchor_time: float = 2e-3
    """Damping of the anchorage over its stiffness [s]."""
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
    """Torque of the motor's poles, a wave of parabolas [N m]."""
    detent_order: float = 14.0
    detent_phase: float = 0.0
    gear_inertia: float = 0.0
    """Inertia between torque sensor and motor pulley [kg m^2]."""
    unbalance: float = 0.0
    """Unbalance of the joint pulley, m g l [N m]."""
    unbalance_phase: float = 0.0
    strap: float = 0.0
    """Stiffness of a strap over the joint pulley [N m/rad], rising with its stretch."""
    strap_rest: float = 0.0
    bearing: float = 0.0
    """Friction of the joint pulley's bearing [N m]."""
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
    catch: float = 0.0
    """Largest torque of a ball that the joint pulley catches at one angle [N m]."""
    catch_angle: float = 0.0
    catch_width: float = 0.08


def plant_of(rig: Rig) -> Plant:
    """Return the plant of a rig without a hidden effect.

    Bends and pieces are sampled from the rig's seed; their sums are the rig's.
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
