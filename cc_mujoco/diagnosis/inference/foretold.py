"""Torques that the scene, as it is given, does not foretell by far: units and signs.

A rig whose readings are in another unit can still be fitted, with another pretension,
friction and stiffness, and what is named then is worth nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cc_mujoco.compiled import FloatArray
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
    played = plant.simulate({})
    for row, name in enumerate(plant.instruments.channels):
        if plant.instruments[plant.instruments.rows[row]] != "torque sensor":
            continue
        measured, simulated = _compared(plant, played, row)
        times = _times(measured, simulated)
        alone = len(plant.bench.cables) == 1
        if (alone and _pushes(measured, simulated)) or (
            times is not None and _near(-times)
        ):
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


def _compared(
    plant: Plant, played: Sequence[FloatArray], row: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Measured and simulated torque of every record that has samples to compare."""
    kept = [
        (record.measured[row, record.free], torque[row, record.free])
        for record, torque in zip(plant.records, played, strict=True)
        if np.count_nonzero(record.free) > 1
    ]
    return [measured for measured, _ in kept], [simulated for _, simulated in kept]


def _times(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> float | None:
    """Measured over simulated torque while the cable slides; None if not alike."""
    if not measured:
        return None
    one = np.concatenate([torque - torque.mean() for torque in measured])
    other = np.concatenate([torque - torque.mean() for torque in simulated])
    scale = math.sqrt(float(one @ one) * float(other @ other))
    if not scale > 0.0 or abs(float(one @ other)) < ALIKE * scale:
        return None
    return math.copysign(
        math.sqrt(float(one @ one) / float(other @ other)), float(one @ other)
    )


def _pushes(measured: Sequence[FloatArray], simulated: Sequence[FloatArray]) -> bool:
    """Whether a lone cable would have to push nearly all the time."""
    if not measured:
        return False
    side = float(np.sign(np.concatenate(simulated).sum()))
    return bool(np.mean(side * np.concatenate(measured) < 0.0) > PUSHES)


def _near(times: float) -> bool:
    return 1.0 / NEAR < times < NEAR
