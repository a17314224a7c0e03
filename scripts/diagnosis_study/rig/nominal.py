"""Nominal values of the rig family, and one rig sampled from it.

The bench: two Bowden cables in pull-pull between a motor pulley and a joint pulley of
the same radius, so that cable travel of one turn at either end can be compared by eye.
Two metres of conduit bend through half a turn in all, mu times wrap is 0.38. A 1.5 mm
steel strand with its conduit gives EA = 50 kN, hence 25 N/mm per cable and 125 N m/rad
between the pulleys: at 80 N of pretension friction (about 2 N m) winds the pair up by
15 mrad, two hundred counts of the encoders, while the lowest mode of the handle stays
at 40 Hz, well below half the sampling rate of 500 Hz.

`NOMINAL` holds the designer's values. Every constant of a built rig deviates by a few
percent, by an amount sampled from its seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

NOMINAL: dict[str, float] = {
    "motor_pulley_radius_m": 0.05,
    "joint_pulley_radius_m": 0.05,
    "conduit_length_m": 2.0,
    "conduit_bend_radius_m": 2.0 / math.pi,
    "wrap_angle_rad": math.pi,
    "axial_stiffness_n": 50e3,
    "friction_1": 0.12,
    "pretension_n": 80.0,
    "line_density_kg_per_m": 0.012,
    "joint_inertia_kg_m2": 2e-3,
    "joint_damping_nm_s_per_rad": 0.05,
    "rotor_inertia_kg_m2": 3e-4,
}
"""Constants of the designer's scene, with the unit in the name. Both cables are
equal, gravity does no work, and only the damping of the joint is viscous."""


@dataclass(frozen=True)
class Rig:
    """Constants of one built rig; the a-cable pulls the joint positive.

    Units: metres, newtons, kilograms, seconds, radians.
    """

    seed: int
    motor_radius: float
    joint_radius: float
    length: float
    wrap: float
    axial_stiffness: float
    friction_a: float
    friction_b: float
    pretension: float
    line_density: float
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    motor_torque_offset: float
    joint_torque_offset: float
    motor_angle_offset: float
    joint_angle_offset: float
    joint_clock_offset: float
    """Lag of the sampling of the joint's channels behind their time stamps [s].

    It is less than half a sample.
    """
    make: str = "bristles"
    """Name of the model whose equations the rig follows, see `makes.MAKES`."""


_BUILT = {
    # turned, and checked against the encoders
    "motor_radius": ("motor_pulley_radius_m", 2e-4),
    "joint_radius": ("joint_pulley_radius_m", 2e-4),
    "length": ("conduit_length_m", 0.0),
    "wrap": ("wrap_angle_rad", 0.03),
    "axial_stiffness": ("axial_stiffness_n", 0.05),
    "pretension": ("pretension_n", 0.02),
    "line_density": ("line_density_kg_per_m", 0.05),
    "joint_inertia": ("joint_inertia_kg_m2", 0.01),
    "joint_damping": ("joint_damping_nm_s_per_rad", 0.1),
    "rotor_inertia": ("rotor_inertia_kg_m2", 0.03),
}
"""Nominal value, and standard deviation of truth / nominal - 1, cut at two of them."""
_OFFSETS = {
    "motor_torque_offset": 0.02,
    "joint_torque_offset": 0.02,
    "motor_angle_offset": 0.002,
    "joint_angle_offset": 0.002,
    "joint_clock_offset": 0.0004,
}
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
        name: NOMINAL[nominal] * (1 + sd * deviate())
        for name, (nominal, sd) in _BUILT.items()
    }
    friction = NOMINAL["friction_1"] * (1 + 0.06 * deviate())
    mismatch = 0.005 * deviate()
    values["friction_a"] = friction * (1 + mismatch)
    values["friction_b"] = friction * (1 - mismatch)
    values |= {name: sd * deviate() for name, sd in _OFFSETS.items()}
    assert set(values) == {field.name for field in fields(Rig)} - {"seed", "make"}
    return Rig(seed=seed, make=make, **values)
