"""Torques that the scene, as it is given, does not foretell by far: units and signs.

A rig whose readings are in another unit can still be fitted, with another pretension,
friction and stiffness, and what is named then is worth nothing.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.diagnosis.data.channels import TORQUE
from cc_mujoco.diagnosis.inference.plant import Plant
from cc_mujoco.diagnosis.wording import capital, channel, number
from cc_mujoco.page import listed

ALIKE = 0.8
"""Correlation from which on measured and simulated torque differ in size only."""
NEAR = 1.3
"""Factor up to which a scene may be off in torque, and a unit or a sign still shows."""
PUSHES = 0.95
"""Share of the samples in which a cable pushes from which on it is a sign."""


def misread(plant: Plant) -> str:
    """Why the torques cannot be what they say by this scene; else empty.

    A generic scene may be off by any factor; only one that a unit makes is told.

    Args:
        plant: of the scene as it is given, with what is known of the rig.
    """
    told: list[str] = []
    units: set[str] = set()
    for row, name in enumerate(plant.instruments.channels):
        if plant.instruments[plant.instruments.rows[row]] != "torque sensor":
            continue
        times = _times(plant, row)
        if _pushes(plant, row) or (times is not None and _near(-times)):
            told.append(f"the {channel(name)} is the negative of")
        elif times is None:
            continue
        elif other := [u for u, si in TORQUE.factors.items() if _near(times * si)]:
            if "Nm" not in other:
                told.append(f"the {channel(name)} is {number(times)} times")
                units.update(other)
    if not told:
        return ""
    guess = f"; readings in {listed(sorted(units), 'or')} would be" if units else ""
    return capital(
        f"{listed(told)} what the scene foretells before anything is tuned{guess}. "
        "Declare unit or sign of the columns in dataset.toml, or put pretension, "
        "friction and pulleys of the scene right."
    )


def _times(plant: Plant, row: int) -> float | None:
    """Measured over simulated torque while the cable slides; None if not alike."""
    measured, simulated = [], []
    for record, torque in zip(plant.records, plant.simulate({}), strict=True):
        used = record.free
        if np.count_nonzero(used) < 2:
            continue
        measured.append(record.measured[row, used] - record.measured[row, used].mean())
        simulated.append(torque[row, used] - torque[row, used].mean())
    if not measured:
        return None
    one, other = np.concatenate(measured), np.concatenate(simulated)
    scale = math.sqrt(float(one @ one) * float(other @ other))
    if not scale > 0.0 or abs(float(one @ other)) < ALIKE * scale:
        return None
    return math.copysign(
        math.sqrt(float(one @ one) / float(other @ other)), float(one @ other)
    )


def _pushes(plant: Plant, row: int) -> bool:
    """Whether a lone cable would have to push nearly all the time."""
    if len(plant.bench.cables) > 1:
        return False
    measured, simulated = [], []
    for record, torque in zip(plant.records, plant.simulate({}), strict=True):
        measured.append(record.measured[row, record.free])
        simulated.append(torque[row, record.free])
    side = float(np.sign(np.concatenate(simulated).sum()))
    return bool(np.mean(side * np.concatenate(measured) < 0.0) > PUSHES)


def _near(times: float) -> bool:
    return 1.0 / NEAR < times < NEAR
