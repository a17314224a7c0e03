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
from cc_mujoco.diagnosis.inference.plant import SimulatedRig, Values
from cc_mujoco.diagnosis.wording import capital, channel, number
from cc_mujoco.page import listed

ALIKE = 0.8
"""Correlation from which on measured and simulated torque differ in size only."""
NEAR = 1.3
"""Factor up to which a scene may be off in torque, and a unit or a sign still shows."""
OTHERWISE = 0.25
"""Squared error over that of the scene in another unit, from which on other values of
the scene are the explanation."""
PUSHES = 0.95
"""Share of the samples in which a cable pushes from which on it is a sign."""

_NONE: Values = {}


def misread(
    plant: SimulatedRig, start: SimulatedRig | None = None, values: Values = _NONE
) -> str:
    """Why the torques cannot be what they say by this scene; else empty.

    A generic scene may be off by any factor; only one that a unit makes is told, and
    only where no other friction, stiffness or pretension explains the readings.

    Args:
        plant: of the scene as it is given, with what is known of the rig.
        start: the plant with estimates in place of what the data contradict.
        values: that the estimates come with; empty where there are none.
    """
    told: list[str] = []
    units: set[str] = set()
    played = plant.simulate({})
    better = start.simulate(values) if start and values else None
    for row, name in enumerate(plant.instruments.channels):
        if plant.instruments[plant.instruments.rows[row]] != "torque sensor":
            continue
        measured, simulated = _compared(plant, played, row)
        times = _times(measured, simulated)
        if better is not None and _explained(
            measured, simulated, times, _compared(plant, better, row)[1]
        ):
            continue
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


def _explained(
    measured: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    times: float | None,
    better: Sequence[FloatArray],
) -> bool:
    """Return whether other values explain a torque better than the scene in a unit."""
    scaled = [(times or 0.0) * torque for torque in simulated]
    return _left(measured, better) < OTHERWISE * _left(measured, scaled)


def _left(measured: Sequence[FloatArray], simulated: Sequence[FloatArray]) -> float:
    """Return the sum of squares between two torques, their means aside."""
    return sum(
        float(np.sum((one - other - np.mean(one - other)) ** 2))
        for one, other in zip(measured, simulated, strict=True)
    )


def _compared(
    plant: SimulatedRig, played: Sequence[FloatArray], row: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Measured and simulated torque of every record that has samples to compare."""
    kept = [
        (record.measured[row, record.free], torque[row, record.free])
        for record, torque in zip(plant.records, played, strict=True)
        if np.count_nonzero(record.free) > 1 and not record.unhooked
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
    """Return whether a lone cable would have to push nearly all the time."""
    if not measured:
        return False
    side = float(np.sign(np.concatenate(simulated).sum()))
    return bool(np.mean(side * np.concatenate(measured) < 0.0) > PUSHES)


def _near(times: float) -> bool:
    return 1.0 / NEAR < times < NEAR
