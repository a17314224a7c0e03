"""Motors that a design may name: figures of data sheets.

    MOTORS["maxon_353297"].continuous_torque        # [N m]

Torque is that of the rotor, before a gear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Motor:
    """A motor by its data sheet, NaN where unknown."""

    name: str = ""
    resistance: float = math.nan
    """Resistance of the winding between its terminals, at 25 degC [ohm]."""
    torque_constant: float = math.nan
    """Torque of the rotor per current [N m/A]."""
    continuous_torque: float = math.nan
    """Torque of the rotor that it can give for ever [N m]."""
    mass: float = math.nan
    """Without a gear [kg]."""
    rotor_inertia: float = math.nan
    """Inertia of the rotor [kg m^2]."""
    source: str = ""


MOTORS: dict[str, Motor] = {
    motor.name: motor
    for motor in (
        Motor(
            "maxon_353297",
            resistance=0.365,
            torque_constant=0.123,
            continuous_torque=0.8,
            mass=2.1,
            rotor_inertia=1.34e-4,
            source="maxon DC motor of 65 mm, order number 353297, 48 V; its data sheet "
            "as on pastebin.com/7kFwyXJK",
        ),
        Motor(
            "pittman_14204s004",
            # The sheet has k and k / sqrt(R).
            resistance=(3.06e-2 / 6.09e-2) ** 2,
            torque_constant=3.06e-2,
            continuous_torque=0.18,
            mass=1.083,
            rotor_inertia=2.6e-5,
            source="Ametek Pittman 14204S004, data sheet, "
            "cdn.shopify.com/s/files/1/0568/0716/2056/files/"
            "Ametek_Pittman_14204S004.pdf",
        ),
        Motor(
            "pittman_9233s013",
            resistance=(3.73e-2 / 1.88e-2) ** 2,
            torque_constant=3.73e-2,
            continuous_torque=3.3e-2,
            mass=0.252,
            rotor_inertia=3.2e-6,
            source="Ametek Pittman 9233S013, data sheet, "
            "cdn.shopify.com/s/files/1/0568/0716/2056/files/"
            "Ametek_Pittman_9233S013.pdf",
        ),
    )
}
"""Every motor by name."""
