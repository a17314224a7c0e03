"""Nominal values of the rig family, and one rig sampled from it.

The bench: two Bowden cables in pull-pull between a motor pulley and a joint pulley of
the same radius, so that cable travel of one turn at either end can be compared by eye.
Two metres of conduit bend through half a turn in all, mu times wrap is 0.38. A 1.5 mm
steel strand with its conduit gives EA = 50 kN, hence 25 N/mm per cable and 125 N m/rad
between the pulleys: at 80 N of pretension friction (about 2 N m) winds the pair up by
15 mrad, two hundred counts of the encoders, while the lowest mode of the handle stays
at 40 Hz, well below half the sampling rate of 500 Hz.

`NOMINAL` is the designer's rig. Every constant of a built one deviates by a few
percent, by an amount sampled from its seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rig:
    """Constants of one built rig; the a-cable pulls the joint positive.

    Units: metres, newtons, kilograms, seconds, radians. By default those of the
    designer: both cables are equal, gravity does no work, and only the damping of the
    joint is viscous.
    """

    seed: int = 0
    motor_radius: float = 0.05
    joint_radius: float = 0.05
    length: float = 2.0
    wrap: float = math.pi
    axial_stiffness: float = 50e3
    friction_a: float = 0.12
    friction_b: float = 0.12
    pretension: float = 80.0
    line_density: float = 0.012
    joint_inertia: float = 2e-3
    joint_damping: float = 0.05
    rotor_inertia: float = 3e-4
    motor_torque_offset: float = 0.0
    joint_torque_offset: float = 0.0
    motor_angle_offset: float = 0.0
    joint_angle_offset: float = 0.0
    joint_clock_offset: float = 0.0
    """Lag of the sampling of the joint's channels behind their time stamps [s].

    It is less than half a sample.
    """
    make: str = "bristles"
    """Name of the model whose equations the rig follows, see `makes.MAKES`."""


NOMINAL = Rig()
_BUILT = {
    # turned, and checked against the encoders
    "motor_radius": 2e-4, "joint_radius": 2e-4, "length": 0.0, "wrap": 0.03,
    "axial_stiffness": 0.05, "pretension": 0.02, "line_density": 0.05,
    "joint_inertia": 0.01, "joint_damping": 0.1, "rotor_inertia": 0.03,
}  # fmt: skip
"""Standard deviation of truth / nominal - 1, cut at two of them."""
_OFFSETS = {
    "motor_torque_offset": 0.02, "joint_torque_offset": 0.02,
    "motor_angle_offset": 0.002, "joint_angle_offset": 0.002,
    "joint_clock_offset": 0.0004,
}  # fmt: skip
"""Standard deviation (SI) of what is nominally zero, cut at two of them as well."""


def make_rig(seed: int, spread: float = 1.0, make: str = "bristles") -> Rig:
    """Return the rig that `seed` built.

    It deviates from nominal by `spread` times the usual few percent; 0 is the nominal
    rig without offsets.
    """
    rng = np.random.default_rng([seed, 0x816])

    def deviate() -> float:
        return spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))

    values = {
        name: getattr(NOMINAL, name) * (1 + sd * deviate())
        for name, sd in _BUILT.items()
    }
    friction = NOMINAL.friction_a * (1 + 0.06 * deviate())
    mismatch = 0.005 * deviate()
    values["friction_a"] = friction * (1 + mismatch)
    values["friction_b"] = friction * (1 - mismatch)
    values |= {name: sd * deviate() for name, sd in _OFFSETS.items()}
    return Rig(seed=seed, make=make, **values)
