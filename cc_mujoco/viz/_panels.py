"""Plots over time next to a moving scene: torques, angles, tensions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.metrics._metric import RATIO
from cc_mujoco.report._figures import BLUE, GREEN, ORANGE, SKY
from cc_mujoco.simulation._episode_log import AxisLog, EpisodeLog

Array = NDArray[np.float64]


class PlotLine(NamedTuple):
    label: str
    values: Array
    """Values of all samples (T,), in the unit of its panel."""
    color: str
    dashed: bool = False


class Panel(NamedTuple):
    title: str
    unit: str
    lines: tuple[PlotLine, ...]


def torques(log: EpisodeLog) -> list[Panel]:
    """Return the torque at the joint, as desired and as delivered, and at the motor."""
    panels = []
    for axis, own in log.each_axis():
        joint = (
            PlotLine("delivered", own["joint_torque_nm"], BLUE),
            PlotLine("desired", own["desired_torque_nm"], ORANGE, dashed=True),
        )
        motor = (PlotLine("motor", own["motor_torque_nm"], GREEN),)
        of = f", {axis}" if axis else ""
        panels += [
            Panel(f"Joint torque{of}", "N m", joint),
            Panel(f"Motor torque{of}", "N m", motor),
        ]
    return panels


def angles(log: EpisodeLog) -> list[Panel]:
    """Return the angles of every axis: joint, the wearer's target and motor."""
    panels = []
    for axis, own in log.each_axis():
        of = f", {axis}" if axis else ""
        panels.append(Panel(f"Angle{of}", "deg", axis_angles(own)))
    return panels


def axis_angles(log: EpisodeLog | AxisLog) -> tuple[PlotLine, ...]:
    """Return the angles of the joint, the wearer's target and the motor of an axis."""
    ratio = log.metadata.get(RATIO)
    motor = np.degrees(log["motor_angle_rad"]) * (1.0 if ratio is None else ratio)
    label = "motor" if ratio is None else "motor, referred to the joint"
    return (
        PlotLine(label, motor, GREEN),
        PlotLine("joint", np.degrees(log["joint_angle_rad"]), BLUE),
        PlotLine(
            "wearer aims for",
            np.degrees(log["reference_angle_rad"]),
            ORANGE,
            dashed=True,
        ),
    )


def tensions(log: EpisodeLog) -> list[Panel]:
    return [
        Panel(
            f"Tension, {cable}",
            "N",
            (
                PlotLine("motor end", log[f"tension_{cable}_proximal_n"], BLUE),
                PlotLine("joint end", log[f"tension_{cable}_distal_n"], SKY),
            ),
        )
        for cable in log.cables
    ]


def highest_tension(log: EpisodeLog) -> float:
    """Return the highest tension in any cable, above 0, for a scale of colours [N]."""
    columns = (log.pieces(f"tension_{cable}_nodes_n") for cable in log.cables)
    peaks = (float(rows.max()) for column in columns for rows in column)
    return max(peaks, default=0.0) or 1e-9
