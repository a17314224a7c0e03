"""Sampling of video frames, and plots of an episode over time: lines and panels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.metrics._metric import Key
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report._figures import BLUE, DASH_PATTERN, GREEN, ORANGE, SKY
from cc_mujoco.simulation._episode_log import AxisLog, EpisodeLog

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FRAME_RATE = 30  # frames per simulated second [1/s]
MAX_SAMPLES = 60_000
"""Most samples that a recording, page or figure plots: else every k-th one."""


def frame_slices(count: int, most: int = 1800) -> Iterator[slice]:
    """Yield slices of at most `most` frames that cover `count`, to bound memory."""
    for start in range(0, count, most):
        yield slice(start, start + most)


def frame_samples(time: Array, rate: float = FRAME_RATE) -> NDArray[np.intp]:
    """Return the samples nearest to frames at `rate` [1/s], for one at least."""
    count = max(1, round(float(time[-1] - time[0]) * rate))
    wanted = time[0] + np.arange(count) / rate
    after = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    if len(time) == 1:
        return np.zeros(1, dtype=np.intp)
    later = wanted - time[after - 1] > time[after] - wanted
    return np.asarray(np.where(later, after, after - 1), dtype=np.intp)


def frame_rate(time: Array, rate: float, most: int) -> float:
    """Return the frame rate [1/s]: `rate`, or lower to have at most `most` frames."""
    return min(rate, most / max(float(time[-1] - time[0]), 1e-9))


class PlotLine(NamedTuple):
    label: str
    values: Array  # values of all samples (T,), in the unit of its panel
    color: str
    dashed: bool = False


def draw_lines(axes: Axes, time: Array, lines: Iterable[PlotLine], **look: Any) -> None:
    for line in lines:
        own: Any = {"linestyle": (0, DASH_PATTERN) if line.dashed else "-"} | look
        axes.plot(time, line.values, label=line.label, color=line.color, **own)


class Panel(NamedTuple):
    title: str
    unit: str
    lines: tuple[PlotLine, ...]


def torques(log: EpisodeLog) -> list[Panel]:
    """Return panels of each axis: desired and delivered joint torque, motor torque."""
    panels = []
    for axis, own in log.each_axis():
        delivered = PlotLine("delivered", own["joint_torque_nm"], BLUE)
        desired = PlotLine("desired", own["desired_torque_nm"], ORANGE, dashed=True)
        motor = PlotLine("motor", own["motor_torque_nm"], GREEN)
        of = f", {axis}" if axis else ""
        panels.append(Panel(f"Joint torque{of}", "N m", (delivered, desired)))
        panels.append(Panel(f"Motor torque{of}", "N m", (motor,)))
    return panels


def angles(log: EpisodeLog) -> list[Panel]:
    """Return a panel per axis of the angles of joint, wearer's target and motor."""
    return [
        Panel(f"Angle, {axis}" if axis else "Angle", "deg", axis_angles(own))
        for axis, own in log.each_axis()
    ]


def axis_angles(log: EpisodeLog | AxisLog) -> tuple[PlotLine, ...]:
    """Return lines of an axis's angles [deg]: motor at the joint, joint, target."""
    ratio = log.metadata.get(Key.RATIO)
    motor = np.degrees(log["motor_angle_rad"]) * (1.0 if ratio is None else ratio)
    label = "motor" if ratio is None else "motor, referred to the joint"
    joint, aim = (np.degrees(log[f"{x}_angle_rad"]) for x in ("joint", "reference"))
    return (
        PlotLine(label, motor, GREEN),
        PlotLine("joint", joint, BLUE),
        PlotLine("wearer aims for", aim, ORANGE, dashed=True),
    )


def tensions(log: EpisodeLog) -> list[Panel]:
    panels = []
    for cable in log.cables:
        motor = PlotLine("motor end", log[f"tension_{cable}_proximal_n"], BLUE)
        joint = PlotLine("joint end", log[f"tension_{cable}_distal_n"], SKY)
        panels.append(Panel(f"Tension, {cable}", "N", (motor, joint)))
    return panels


def highest_tension(log: EpisodeLog) -> float:
    """Return the highest node tension of all cables [N], at least 1e-9."""
    columns = (log.pieces(f"tension_{cable}_nodes_n") for cable in log.cables)
    peaks = (float(rows.max()) for column in columns for rows in column)
    return max(peaks, default=0.0) or 1e-9
