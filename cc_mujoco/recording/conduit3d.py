"""Conduits as coloured lines: the tension at each place along the route, over time."""

from __future__ import annotations

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cc_mujoco import engine
from cc_mujoco.recording.scene3d import TIMELINE, WORLD

Array = NDArray[np.float64]

SLACK_COLOR = np.array([150, 150, 150, 255], dtype=np.uint8)


def conduit_points(
    model: mujoco.MjModel, cable: str, qpos: Array, shares: Array
) -> Array:
    """Return where places along a cable, as its nodes, lie in space.

    Args:
        model: Compiled model.
        cable: Name of a cable that has a route.
        qpos: Generalized coordinates of the frames (T, nq).
        shares: Of the length of the route, from the motor end, 0 to 1 (P,).

    Returns:
        Points (T, P, 3) in metres, from the motor end to the joint end.
    """
    points = np.empty((len(qpos), len(shares), 3))
    data = mujoco.MjData(model)
    for frame, coordinates in enumerate(qpos):
        data.qpos[:] = coordinates
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        points[frame] = resample(engine.route(model, data, cable), shares)
    return points


def resample(polyline: Array, shares: Array) -> Array:
    """Return points at shares (P,) of the length of a polyline, as (P, 3)."""
    steps = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = shares * along[-1]
    axes = [np.interp(wanted, along, polyline[:, axis]) for axis in range(3)]
    return np.stack(axes, axis=1)


def tension_colors(tension: Array, highest: float) -> NDArray[np.uint8]:
    """Return RGBA colours of tensions; what is slack is grey.

    Args:
        tension: Tensions, any shape, N.
        highest: Tension of the brightest colour, N.
    """
    import matplotlib

    colormap = matplotlib.colormaps["viridis"]
    scaled = np.clip(tension / max(highest, 1e-9), 0.0, 1.0)
    colors = np.asarray(colormap(scaled, bytes=True), dtype=np.uint8)
    colors[tension <= 0.0] = SLACK_COLOR
    return colors


def log_conduit(
    rec: rr.RecordingStream,
    cable: str,
    time: Array,
    points: Array,
    tension: Array,
    highest: float,
    radius: float,
) -> None:
    """Log one conduit as a line whose segments carry the colour of their tension.

    Args:
        rec: Open recording.
        cable: Name of the cable.
        time: Times of the frames (T,), s.
        points: Places of the nodes (T, n+1, 3), m.
        tension: Tensions at the nodes (T, n+1), N.
        highest: Tension of the brightest colour, N.
        radius: Radius of the line, m.
    """
    path = rr.new_entity_path([WORLD, "conduit", cable])
    index = [rr.TimeColumn(TIMELINE, duration=time)]
    frames, count = len(time), points.shape[1] - 1
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).astype(np.float32)
    middle = 0.5 * (tension[:, :-1] + tension[:, 1:])
    colors = tension_colors(middle, highest).reshape(-1, 4)
    colored = rr.LineStrips3D.columns(colors=colors).partition([count] * frames)
    rec.log(path, rr.LineStrips3D.from_fields(radii=[radius]), static=True)
    if np.allclose(points, points[0], rtol=0.0, atol=1e-6):
        # A conduit that stays where it is: only its colours change.
        rec.log(path, rr.LineStrips3D.from_fields(strips=segments[0]), static=True)
        rec.send_columns(path, index, [*colored])
    else:
        strips = rr.LineStrips3D.columns(strips=segments.reshape(-1, 2, 3))
        moved = strips.partition([count] * frames)
        rec.send_columns(path, index, [*moved, *colored])
