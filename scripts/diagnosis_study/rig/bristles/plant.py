"""The physics of a rig as the numbers that the integrator takes.

`Plant` holds the constants of the bench and those of everything that may be hidden in
it. The value that switches a hidden thing off is its default, always 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatMatrix
from rig.nominal import Rig

BUMPS = 5
"""Number of places per cable at which the liner may be damaged."""


class Plant(NamedTuple):
    """All constants of the equations of motion; SI and radians."""

    # --- the bench -----------------------------------------------------------
    nodes: int
    motor_radius: float
    joint_radius: float
    length: float
    wrap: float
    axial_stiffness: float
    friction_a: float
    friction_b: float
    line_density: float
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    material_time: float = 1.5e-5
    """Kelvin-Voigt damping of the strand over its stiffness [s]."""
    presliding: float = 1e-6
    """Travel over which a contact comes to sliding at nominal tension [m]."""
    reference_tension: float = 80.0

    # --- friction ------------------------------------------------------------
    viscous: float = 0.0
    """Force per speed, one cable [N s/m]."""
    stribeck: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    stribeck_speed: float = 0.03
    stribeck_lag: float = 0.02
    """First-order lag of friction behind speed [s]: frictional memory."""
    asymmetry: float = 0.0
    """Excess of friction while the joint turns positive, relative."""
    load_free: float = 0.0
    """Friction of the end seals of one cable [N]."""
    tension_power: float = 0.0
    """Friction coefficient grows with tension to this power."""
    ageing: float = 0.0
    """Growth of static friction per e-fold of contact time, relative."""
    ageing_time: float = 0.05
    ageing_slip: float = 1e-4
    """Travel that renews a contact [m]."""
    wrap_slope: float = 0.0
    """Wrap gained per joint angle, in the third of the conduit next the joint."""
    heating: float = 0.0
    """Change of friction when warm, relative."""
    heating_energy: float = 8.0
    heating_time: float = 12.0
    bumps: float = 0.0
    """Excess of friction where the liner is damaged, relative."""
    bump_width: float = 0.004
    bump_places: FloatMatrix = np.zeros((2, BUMPS))

    # --- elasticity and geometry ------------------------------------------------
    pretension_loss: float = 0.0
    """Part of the pretension that is lost in the end [0..1)."""
    loss_time: float = 3.0
    stiffening: float = 0.0
    """Relative change of stiffness of cable a from slack to taut; cable b a third."""
    stiffening_tension: float = 40.0
    end_compliance: float = 0.0
    """Series compliance of the anchorage of one cable [m/N], most of it distal."""
    clamp_creep: float = 0.0
    """Speed at which a conduit slides in its clamp at the joint, per tension above
    `clamp_force` [m/(N s)]."""
    clamp_force: float = 0.0
    eccentricity: float = 0.0
    """First harmonic of the motor pulley's radius, relative; the second a quarter."""
    eccentric_phase: float = 0.0
    eccentric_phase_2: float = 0.0
    drum_growth: float = 0.0
    """Growth of the motor pulley's radius per angle that a cable is wound on, relative
    [1/rad]."""
    backlash: float = 0.0
    """Full gap between joint pulley and handle [rad]."""
    contact_stiffness: float = 2e4
    contact_damping: float = 1.5
    hub_inertia: float = 2.5e-4
    """Inertia of the joint pulley once it is a body of its own [kg m^2]."""
    grip_slip: float = 0.0
    """Slip of the cables on the motor pulley, speed per excess torque [rad/(N m s)]."""
    grip_limit: float = 4.0

    # --- loads on the shafts ----------------------------------------------------
    cogging: float = 0.0
    cogging_order: float = 14.0
    cogging_phase: float = 0.0
    motor_inertia: float = 0.0
    """Inertia between torque sensor and motor pulley [kg m^2]."""
    unbalance: float = 0.0
    """Unbalance of the joint pulley, m g l [N m]."""
    unbalance_phase: float = 0.0
    joint_stiffness: float = 0.0
    joint_stiffness_rest: float = 0.0
    extra_joint_inertia: float = 0.0
    mesh: float = 0.0
    """Ripple torque of a gear mesh at the joint [N m]."""
    mesh_order: float = 23.0
    mesh_phase: float = 0.0
    stop_stiffness: float = 0.0
    """Bumper that the joint pulley meets beyond `stop_angle` [N m/rad]."""
    stop_angle: float = 0.6


def plant_of(rig: Rig, nodes: int = 12) -> Plant:
    """Return the plant of a rig in which nothing is hidden."""
    return Plant(
        nodes=nodes,
        motor_radius=rig.motor_radius,
        joint_radius=rig.joint_radius,
        length=rig.length,
        wrap=rig.wrap,
        axial_stiffness=rig.axial_stiffness,
        friction_a=rig.friction_a,
        friction_b=rig.friction_b,
        line_density=rig.line_density,
        joint_inertia=rig.joint_inertia,
        joint_damping=rig.joint_damping,
        rotor_inertia=rig.rotor_inertia,
    )
