"""Every line that a Rerun recording of an episode plots."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.metrics._metric import RATIO, driven_cables
from cc_mujoco.simulation._episode_log import EpisodeLog

# Okabe and Ito's colours, as in the summary figure.
BLUE, ORANGE, GREEN, PURPLE = 0x0072B2FF, 0xD55E00FF, 0x009E73FF, 0xCC79A7FF
SKY, YELLOW = 0x56B4E9FF, 0xE69F00FF

SERIES = (
    ("torque/joint", "delivered", "joint_torque_nm", BLUE),
    ("torque/desired", "desired", "desired_torque_nm", ORANGE),
    ("torque/motor", "motor", "motor_torque_nm", GREEN),
    ("torque/wearer", "wearer", "wearer_torque_nm", PURPLE),
    ("angle/joint", "joint", "joint_angle_rad", BLUE),
    ("angle/reference", "wearer aims for", "reference_angle_rad", ORANGE),
    ("angle/motor", "motor", "motor_angle_rad", GREEN),
)
# No spaces in paths: Rerun shows them with a backslash before.
CABLE_SERIES = (
    ("tension/{}/motor_end", "tension_{}_proximal_n", 0),
    ("tension/{}/joint_end", "tension_{}_distal_n", 1),
    ("moving/{}", "moving_{}_fraction", 0),
)
CABLE_COLORS = ((BLUE, SKY), (ORANGE, YELLOW), (GREEN, PURPLE))
"""Motor end and joint end of the first, second, ... cable of an axis."""


class Series(NamedTuple):
    """One line of a plot."""

    path: tuple[str, ...]
    name: str
    values: NDArray[np.float64]
    """Values of all samples (T,)."""
    color: int


def plotted_series(log: EpisodeLog) -> Iterator[Series]:
    for axis, own in log.each_axis():
        ratio = own.metadata.get(RATIO)
        for path, name, column, color in SERIES:
            values = own[column]
            if column.endswith("_rad"):
                values = np.degrees(values)
            if column == "motor_angle_rad" and ratio is not None:
                # Beside it a joint that turns a tenth as far would seem to rest.
                name, values = f"{name}, at the joint", ratio * values
            kind, line = path.split("/")
            yield Series((kind, *([axis] if axis else []), line), name, values, color)
    places = {cable: number for number, cable in enumerate(log.cables)}
    if log.axes:  # the plots of each show its own cables
        for _, own in log.each_axis():
            places |= {cable: n for n, cable in enumerate(driven_cables(own))}
    for cable in log.cables:
        colors = CABLE_COLORS[places[cable] % len(CABLE_COLORS)]
        for path, column, shade in CABLE_SERIES:
            parts = tuple(part.format(cable) for part in path.split("/"))
            name = ", ".join(parts[1:]).replace("_", " ")
            yield Series(parts, name, log[column.format(cable)], colors[shade])
