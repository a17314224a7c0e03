"""Random cables, term by term, and random motions of their ends."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable._cable import MAX_LENGTH, MAX_WRAP

CABLES = {
    "coulomb": lambda r: {},
    "load_independent": lambda r: {"load_independent_friction": 10 ** r.uniform(-2, 2)},
    "seals": lambda r: {
        "seal_proximal": 10 ** r.uniform(-2, 1.5) * (r.random() < 0.6),
        "seal_distal": 10 ** r.uniform(-2, 1.5) * (r.random() < 0.6),
    },
    "static": lambda r: {"static_friction": r.uniform(1.0, 1.6)},
    "static_memory": lambda r: {
        "static_friction": r.uniform(1.0, 1.6),
        "critical_slip_distance": 10 ** r.uniform(-4, -2),
    },
    "viscous": lambda r: {"viscous_friction": 10 ** r.uniform(0, 4)},
    "grease": lambda r: {
        "grease_drag": 10 ** r.uniform(-1, 2),
        "grease_exponent": r.uniform(0.2, 1.0),
    },
    "stribeck": lambda r: {
        "stribeck_friction": r.uniform(0.01, 0.15),
        "stribeck_speed": 10 ** r.uniform(-3, -1),
        "stribeck_exponent": r.choice((1.0, 2.0)),
        "stribeck_tail": r.uniform(0.0, 1.0) * (r.random() < 0.5),
        "critical_slip_distance": 10 ** r.uniform(-4, -2) * (r.random() < 0.5),
    },
    "asymmetric": lambda r: {"friction_asymmetry": r.uniform(-0.5, 0.5)},
    "presliding": lambda r: {"bristle_length": 10 ** r.uniform(-5, -3)},
    "tension_dependent": lambda r: {
        "tension_exponent": r.uniform(-0.3, 0.3),
        "pretension": r.uniform(1.0, 50.0),
    },
    "ageing": lambda r: {
        "ageing_friction": r.uniform(0.005, 0.03),
        "ageing_time": 0.1,
        "critical_slip_distance": 10 ** r.uniform(-4, -2) * (r.random() < 0.7),
    },
    "drift": lambda r: {"friction_drift": r.uniform(-0.3, 0.3)},
    "heating": lambda r: {"friction_heating": r.uniform(-0.05, 0.05)},
    "bedding": lambda r: {
        "bedding_strain": 10 ** r.uniform(-5, -2),
        "bedding_tension": 10 ** r.uniform(0, 2),
    },
    "clearance": lambda r: {
        "clearance": 10 ** r.uniform(-5, -2),
        "seating_tension": 10 ** r.uniform(0, 2),
    },
    "stress_relaxation": lambda r: {
        "stress_relaxation": r.uniform(0.0, 0.5),
        "relaxation_time": r.uniform(0.1, 3),
    },
    "clamps": lambda r: {
        "clamp_creep_proximal": 10 ** r.uniform(-6, -2) * (r.random() < 0.7),
        "clamp_creep_distal": 10 ** r.uniform(-6, -2) * (r.random() < 0.7),
        "clamp_force": r.uniform(0.0, 30.0),
    },
    "end_compliance": lambda r: {
        "end_compliance": 10 ** r.uniform(-6, -4),
        "proximal_compliance": 10 ** r.uniform(-6, -4),
    },
    "soft_anchors": lambda r: {
        "end_compliance": 10 ** r.uniform(-6, -3),
        "end_hardening": 10 ** r.uniform(-3, 0) * (r.random() < 0.7),
        "end_loss": r.uniform(0.0, 0.6) * (r.random() < 0.7),
        "proximal_compliance": 10 ** r.uniform(-6, -3),
        "proximal_hardening": 10 ** r.uniform(-3, 0) * (r.random() < 0.7),
        "proximal_loss": r.uniform(0.0, 0.6) * (r.random() < 0.7),
    },
    "configuration_dependent": lambda r: {
        "wrap_growth": r.uniform(-20, 20),
        "wrap_reach": r.uniform(0.1, 1.0),
    },
}
"""Parameters that switch a term on; static friction as a multiple of kinetic."""


def sections(tightest: float = 1e-6) -> st.SearchStrategy[Section]:
    """Sections that are allowed, straight ones among them.

    Args:
        tightest: smallest bend radius [m].
    """
    length = st.floats(1e-6, MAX_LENGTH)
    radius = st.floats(tightest, 1e6) | st.just(math.inf)
    return st.builds(
        lambda bent, over: Section(min(bent, 0.999 * MAX_WRAP * over), over),
        length,
        radius,
    )


def cable_of(rng: np.random.Generator, term: str = "coulomb") -> Cable:
    """Return a random cable of straight and bent sections, friction x wrap 0.1 to 3."""
    length = 10 ** rng.uniform(math.log10(0.15), math.log10(3.0))
    count = int(rng.integers(1, 6))
    parts = rng.dirichlet(np.ones(count)) * length
    friction = rng.uniform(0.02, 0.4)
    wrap = 10 ** rng.uniform(-1.0, math.log10(3.0)) / friction
    bent = rng.random(count) < 0.6
    bent[rng.integers(count)] = True
    angles = rng.dirichlet(np.ones(count)) * bent
    angles = np.minimum(angles * wrap / angles.sum(), 0.999 * MAX_WRAP)
    values = {
        "axial_stiffness": 10 ** rng.uniform(3, 5),
        "pretension": rng.choice([0.0, 1.0, 10.0, 50.0, 100.0]) * rng.uniform(0.5, 1.0),
        "friction": friction,
        "segments": int(rng.integers(4, 61)),
    } | CABLES[term](rng)
    if "static_friction" in values:
        values["static_friction"] *= friction
    conduit = tuple(
        Section(float(part), float(part / angle) if angle > 1e-6 else math.inf)
        for part, angle in zip(parts, angles, strict=True)
    )
    return Cable(conduit=conduit, **values)


def motion_of(
    rng: np.random.Generator, cable: Cable, samples: int = 600, dt: float = 1e-3
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of both ends [m]: two sines each, from slack to hundreds of N."""
    time = np.arange(samples) * dt
    size = 10 ** rng.uniform(0.0, 2.7) * cable.length / cable.axial_stiffness

    def end():
        waves = [
            rng.normal() * np.sin(2 * np.pi * rng.uniform(0.3, 4.0) * time + phase)
            for phase in rng.uniform(0.0, 6.0, 2)
        ]
        moved = sum(waves)
        return (moved - moved[0]) * size * rng.choice([0.0, 0.05, 1.0, 1.0])

    return end(), end()


def turned_around(cable: Cable) -> Cable:
    """Return the same cable with its ends exchanged."""
    return cable.replace(
        conduit=cable.conduit[::-1],
        seal_proximal=cable.seal_distal,
        seal_distal=cable.seal_proximal,
        proximal_compliance=cable.end_compliance,
        end_compliance=cable.proximal_compliance,
        end_hardening=cable.proximal_hardening,
        proximal_hardening=cable.end_hardening,
        end_loss=cable.proximal_loss,
        proximal_loss=cable.end_loss,
        clamp_creep_proximal=cable.clamp_creep_distal,
        clamp_creep_distal=cable.clamp_creep_proximal,
        friction_asymmetry=-cable.friction_asymmetry,
    )
