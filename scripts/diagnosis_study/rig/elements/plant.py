"""Physics of a rig of finite elements: the constants of the integrator.

Every hidden effect is off at its default, 0. Imperfections that no builder can avoid (a
compliant shaft, a gear, an amplifier with a torque limit) are sampled from the rig's
seed and are no effects.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix
from rig.nominal import Rig

Array = NDArray[np.float64]

ELEMENTS = 40
"""Elements per cable, with a node between two."""
FINER = 0.7
"""Length per node at the ends over the mean length per node."""
SWAY = 0.25
"""Largest relative amplitude of the curvature of a conduit about its mean: one and a
half waves along it, at random phase."""


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    # --- the bench -----------------------------------------------------------
    motor_radius: float
    joint_radius: float
    stiffness: FloatMatrix
    """Stiffness of every element (2, elements) [N/m]."""
    mass: FloatMatrix
    """Mass at every inner node (2, elements - 1) [kg]."""
    bend: FloatMatrix
    """Bend of the conduit at every inner node (2, elements - 1) [rad]."""
    middle: FloatArray
    """Position of the inner nodes, 0 at the motor to 1 at the joint (elements - 1,)."""
    friction: FloatArray
    """Coefficient of friction (2,)."""
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    strand_time: float = 1e-5
    """Damping of the strand over its stiffness [s]."""
    yielding: FloatMatrix = np.full((2, 1), 8e-7)
    """Deflection at which a contact slides (2, 1 or elements - 1) [m]."""
    reference_tension: float = 80.0

    # --- what no builder gets rid of -------------------------------------------
    shaft: float = 0.0
    """Compliance between motor and its pulley [rad/(N m)]."""
    shaft_time: float = 1e-3
    """Damping of the shaft over its stiffness [s]."""
    teeth: float = 0.0
    """Amplitude of the transmission error of the gear [rad]."""
    teeth_order: float = 40.0
    teeth_phase: float = 0.0
    amplifier: float = 1e6
    """Torque limit of the motor [N m]."""

    # --- friction ------------------------------------------------------------
    grease: float = 0.0
    """Force per speed of a slow cable [N s/m]; more of it towards the joint."""
    grease_thins: float = 1e9
    """Speed at which the grease has half its viscosity [m/s]."""
    striction: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    striction_speed: float = 0.01
    nap: float = 0.0
    """Relative excess of friction of cable a against the nap of its liner."""
    tight: float = 0.0
    """Load-independent friction of one cable in a tight liner [N]."""
    polish: float = 0.0
    """Loss of friction coefficient per tension over the reference, relative."""
    creep: float = 0.0
    """Growth of static friction in a second of rest, relative."""
    creep_power: float = 0.3
    creep_slip: float = 5e-5
    leaning: float = 0.0
    """Wrap gained per joint angle, over the half of the conduit next the joint."""
    warming: float = 0.0
    """Change of friction from cold to warm, relative."""
    warming_time: float = 4.0

    # --- elasticity and geometry ------------------------------------------------
    relaxing: float = 0.0
    """Fraction of the pretension that is lost eventually."""
    toe: float = 0.0
    """Relative deficit in stiffness of a slack strand, in [0, 1)."""
    toe_tension: float = 40.0
    ferrule: float = 0.0
    """Compliance of the fastening of cable a at the motor [m/N]."""
    ferrule_time: float = 3e-3
    offcentre: float = 0.0
    """Eccentricity of the motor pulley over its radius; its ovality is half of it."""
    offcentre_phase: float = 0.0
    oval_phase: float = 0.0
    play: float = 0.0
    """Full gap between joint pulley and handle [rad]."""
    contact: float = 1e6
    """Stiffness of the flanks in contact: torque per angle to the power 3/2 [N m]."""
    contact_loss: float = 1.5
    """Damping of the contact over its torque, per speed [s/rad]."""
    hub_inertia: float = 2.5e-4

    # --- loads on the shafts ----------------------------------------------------
    slots: float = 0.0
    """Amplitude of the cogging torque [N m]; a third of it at three times the order."""
    slots_order: float = 14.0
    slots_phase: float = 0.0
    drum: float = 0.0
    """Inertia between torque sensor and motor pulley [kg m^2]."""
    unbalance: float = 0.0
    """Unbalance of the joint pulley, m g l [N m]."""
    unbalance_phase: float = 0.0
    band: float = 0.0
    """Stiffness of a softening rubber band at the joint [N m/rad]."""
    band_rest: float = 0.0
    disc: float = 0.0
    """Extra inertia of the joint pulley [kg m^2]."""

    # --- what no library should know ----------------------------------------------
    worn: float = 0.0
    """Relative amplitude of the friction coefficient along the travel of the cable."""
    worn_pitch: float = 0.02
    worn_phase: float = 0.0
    felt: float = 0.0
    """Stiffness of a band at the joint with play of its own [N m/rad]."""
    felt_play: float = 0.15
    putty: float = 0.0
    """Stiffness of a band at the joint that relaxes [N m/rad]."""
    putty_time: float = 0.5


def plant_of(rig: Rig, elements: int = ELEMENTS) -> Plant:
    """Return the plant of a rig without a hidden effect.

    Args:
        rig: the rig; curvature, shaft, gear and amplifier are sampled from its seed.
        elements: elements per cable.
    """
    random = np.random.default_rng([rig.seed, 0xE1E])
    border = np.linspace(0.0, 1.0, elements)
    # Short parts at the ends, where the torques are read; a node in the middle of each.
    border -= (1.0 - FINER) / (2.0 * math.pi) * np.sin(2.0 * math.pi * border)
    node = 0.5 * (border[:-1] + border[1:])
    length = np.diff(np.concatenate([[0.0], node, [1.0]]))
    bend = np.stack([rig.wrap * _swaying(border, random) for _ in range(2)])
    return Plant(
        rig.motor_radius,
        rig.joint_radius,
        np.tile(rig.axial_stiffness / (length * rig.length), (2, 1)),
        np.tile(rig.line_density * rig.length * np.diff(border), (2, 1)),
        bend,
        node,
        np.array([rig.friction_a, rig.friction_b]),
        rig.joint_inertia,
        rig.joint_damping,
        rig.rotor_inertia,
        **_lived_with(random),
    )


def _swaying(border: Array, random: Generator) -> Array:
    """Return each inner node's share of the bend, for a curvature with random waves."""
    phase = random.uniform(-math.pi, math.pi)
    size = SWAY * random.uniform(0.3, 1.0)
    turn = 3.0 * math.pi

    def till(s: Array) -> Array:
        return s - size / turn * (np.cos(turn * s + phase) - math.cos(phase))

    part = np.diff(till(border))
    return np.asarray(part / part.sum())


def _lived_with(random: Generator) -> dict[str, float]:
    """Sample unavoidable imperfections: each is present with probability one half."""
    has_shaft, has_gear, has_limit = random.random(3) < 0.5
    stiff, teeth, limit = random.uniform([1.2e4, 1e-5, 7.0], [4e4, 4e-5, 12.0])
    phase = random.uniform(-math.pi, math.pi)
    order = float(random.integers(24, 61))
    found = {"teeth_order": order, "teeth_phase": phase}
    if has_shaft:
        found["shaft"] = 1.0 / stiff
    if has_gear:
        found["teeth"] = teeth
    if has_limit:
        found["amplifier"] = limit
    return found
