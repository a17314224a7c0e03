"""Motors that a design may name: figures of data sheets.

    MOTORS["maxon_353297"].continuous_torque        # [N m]

Torque and inertia are those of the rotor, before a gear.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Motor:
    """A motor by its data sheet; NaN where that is silent."""

    name: str = ""
    resistance: float = math.nan  # of the winding at 25 degC, at its terminals [ohm]
    torque_constant: float = math.nan  # torque of the rotor per current [N m/A]
    continuous_torque: float = math.nan  # that the rotor can give for ever [N m]
    mass: float = math.nan  # without a gear [kg]
    rotor_inertia: float = math.nan  # inertia of the rotor [kg m^2]
    source: str = ""


_PITTMAN = "cdn.shopify.com/s/files/1/0568/0716/2056/files/Ametek_Pittman"

MOTORS: dict[str, Motor] = {
    motor.name: motor
    for motor in (
        Motor(
            "maxon_353297", 0.365, 0.123, 0.8, 2.1, 1.34e-4,
            "maxon DC motor of 65 mm, order number 353297, 48 V; its data sheet as on "
            "pastebin.com/7kFwyXJK",
        ),
        # Their sheets have k and k / sqrt(R).
        Motor(
            "pittman_14204s004", (3.06e-2 / 6.09e-2) ** 2, 3.06e-2, 0.18, 1.083, 2.6e-5,
            f"Ametek Pittman 14204S004, data sheet, {_PITTMAN}_14204S004.pdf",
        ),
        Motor(
            "pittman_9233s013", (3.73e-2 / 1.88e-2) ** 2, 3.73e-2, 3.3e-2, 0.252,
            3.2e-6, f"Ametek Pittman 9233S013, data sheet, {_PITTMAN}_9233S013.pdf",
        ),
    )
}  # fmt: skip
"""Every motor by name."""
