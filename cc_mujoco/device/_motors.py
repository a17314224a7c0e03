"""Motors that a design may name: figures of data sheets.

    MOTORS["maxon_353297"].continuous_torque        # [N m]

Torque and inertia are those of the rotor, before a gear.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cc_mujoco._utils.csv_files import read_sheet


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


def _motors() -> Iterator[Motor]:
    for row in read_sheet(Path(__file__).with_name("motors.csv")).rows:
        name, *figures, source = row.cells
        ohm, per_ampere, continuous, mass, inertia = map(float, figures)
        yield Motor(name, ohm, per_ampere, continuous, mass, inertia, source)


MOTORS: dict[str, Motor] = {motor.name: motor for motor in _motors()}
"""Every motor by name."""
