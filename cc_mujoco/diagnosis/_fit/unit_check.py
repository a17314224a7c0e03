"""Torques that the scene, as it is given, does not predict by far: units and signs.

A rig whose readings are in another unit can still be fitted, with another pretension,
friction and stiffness, and what is named then is worth nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cc_mujoco.datasets._channels import TORQUE
from cc_mujoco.diagnosis._phrases import capitalise, channel_name, format_number
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig, Values
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

MIN_CORRELATION = 0.8
"""Correlation from which on measured and simulated torque differ in size only."""
MAX_TORQUE_FACTOR = 1.3
"""Factor up to which a scene may be off in torque, and a unit or a sign still shows."""
ALTERNATIVE_ERROR_RATIO = 0.25
"""Squared error over that of the scene in another unit, from which on other values of
the scene are the explanation."""
PUSH_SHARE = 0.95
"""Share of the samples in which a cable pushes from which on it is a sign."""

_NO_VALUES: Values = {}


def unit_or_sign_error(
    plant: SimulatedRig, start: SimulatedRig | None = None, values: Values = _NO_VALUES
) -> str:
    """Return why the torques contradict this scene by unit or sign, or "".

    A generic scene may be off by any factor. Only the factor of a unit is reported, and
    only if no other friction, stiffness or pretension explains the readings.

    Args:
        plant: of the scene as it is given, with what is known of the rig.
        start: the plant with estimates in place of what the data contradict.
        values: that the estimates come with; empty where there are none.
    """
    contradictions: list[str] = []
    units: set[str] = set()
    played = plant.simulate({})
    better = start.simulate(values) if start and values else None
    for row, name in enumerate(plant.instruments.channels):
        if plant.instruments[plant.instruments.rows[row]] != "torque sensor":
            continue
        measured, simulated = _torque_pairs(plant, played, row)
        times = _torque_factor(measured, simulated)
        if better is not None and _other_values_explain(
            measured, simulated, times, _torque_pairs(plant, better, row)[1]
        ):
            continue
        alone = len(plant.bench.cables) == 1
        if (alone and _would_push(measured, simulated)) or (
            times is not None and _is_near_one(-times)
        ):
            contradictions.append(f"the {channel_name(name)} is the negative of")
        elif times is None:
            continue
        elif other := [
            u for u, si in TORQUE.factors.items() if _is_near_one(times * si)
        ]:
            if "Nm" not in other:
                contradictions.append(
                    f"the {channel_name(name)} is {format_number(times)} times"
                )
                units.update(other)
    if not contradictions:
        return ""
    guess = f"; readings in {list_words(sorted(units), 'or')} would be" if units else ""
    return capitalise(
        f"{list_words(contradictions)} what the scene predicts before anything is "
        f"tuned{guess}. Declare unit or sign of the columns in dataset.toml, or put "
        "pretension, friction and pulleys of the scene right."
    )


def _other_values_explain(
    measured: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    times: float | None,
    better: Sequence[FloatArray],
) -> bool:
    """Return whether other values explain a torque better than the scene in a unit."""
    scaled = [(times or 0.0) * torque for torque in simulated]
    return _residual_square(
        measured, better
    ) < ALTERNATIVE_ERROR_RATIO * _residual_square(measured, scaled)


def _residual_square(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> float:
    """Return the sum of squares between two torques, their means aside."""
    return sum(
        float(np.sum((one - other - np.mean(one - other)) ** 2))
        for one, other in zip(measured, simulated, strict=True)
    )


def _torque_pairs(
    plant: SimulatedRig, played: Sequence[FloatArray], row: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return measured and simulated torque of every record with valid samples."""
    kept = [
        (record.measured[row, record.free], torque[row, record.free])
        for record, torque in zip(plant.records, played, strict=True)
        if np.count_nonzero(record.free) > 1
        and not record.unhooked
        and record.load_cell is None
    ]
    return [measured for measured, _ in kept], [simulated for _, simulated in kept]


def _torque_factor(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> float | None:
    """Return measured over simulated torque during sliding, None if dissimilar."""
    if not measured:
        return None
    one = np.concatenate([torque - torque.mean() for torque in measured])
    other = np.concatenate([torque - torque.mean() for torque in simulated])
    scale = math.sqrt(float(one @ one) * float(other @ other))
    if not scale > 0.0 or abs(float(one @ other)) < MIN_CORRELATION * scale:
        return None
    return math.copysign(
        math.sqrt(float(one @ one) / float(other @ other)), float(one @ other)
    )


def _would_push(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> bool:
    """Return whether a lone cable would have to push nearly all the time."""
    if not measured:
        return False
    side = float(np.sign(np.concatenate(simulated).sum()))
    return bool(np.mean(side * np.concatenate(measured) < 0.0) > PUSH_SHARE)


def _is_near_one(times: float) -> bool:
    return 1.0 / MAX_TORQUE_FACTOR < times < MAX_TORQUE_FACTOR
