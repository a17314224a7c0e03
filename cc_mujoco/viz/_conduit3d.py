"""Conduits as coloured lines: the tension at each place along the route, over time."""

from __future__ import annotations

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.cable._cable import PATHS
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.viz._scene3d import Branch

Array = NDArray[np.float64]

SLACK_COLOR = np.array([150, 150, 150, 255], dtype=np.uint8)


def conduit_shares(model: mujoco.MjModel, cable: str) -> Array:
    """Return how the line of a cable is divided, as shares of its route from 0 to 1.

    In a conduit a part of the line goes from one node to the next: (n+1,). Where the
    cable lies open a part is what a node stands for, a straight piece
    or some of an arc: (n+2,).
    """
    described = plugin.from_mjcf(model)[cable]
    if described.path == PATHS[0]:
        return node_places(described) / described.length
    reader = plugin.Reader(model, cable)
    nodes = described.segments + 1
    # Slack of a newton at one node alone goes as the length for which the node stands,
    # which the state of a cable at rest has.
    data = mujoco.MjData(model)
    plugin.settle(model, data)
    state = np.tile(data.plugin_state, (nodes, 1))
    state[:, reader.nodes] = -np.eye(nodes)
    along = np.concatenate([[0.0], np.cumsum(reader.read(state).slack)])
    return np.asarray(along / along[-1])


def node_shares(shares: Array, nodes: int) -> Array:
    """Return where along the line the nodes are that have tensions.

    Parts of a line in the open are what its `nodes` stand for.
    """
    return shares if shares.size == nodes else 0.5 * (shares[:-1] + shares[1:])


def fine_shares(shares: Array) -> Array:
    """Return these shares of a route, or 61 where fewer would cut its bends."""
    return shares if shares.size > 60 else np.linspace(0.0, 1.0, 61)


def part_tensions(shares: Array, fine: Array, tension: Array) -> Array:
    """Return the tension of each part of a line (..., P-1) [N].

    `shares` are those of `conduit_shares`, `fine` where the parts end, as shares of the
    route (P,), and `tension` is that at the nodes (..., n) [N].
    """
    nodes, middle = node_shares(shares, tension.shape[-1]), 0.5 * (fine[:-1] + fine[1:])
    low = np.clip(np.searchsorted(nodes, middle) - 1, 0, nodes.size - 2)
    share = np.clip((middle - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)
    return np.asarray((1.0 - share) * tension[..., low] + share * tension[..., low + 1])


def resample(polyline: Array, shares: Array) -> Array:
    """Return points at these shares (n,) of the length of a polyline (P, 3): (n, 3)."""
    steps = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = shares * along[-1]
    axes = [np.interp(wanted, along, polyline[:, axis]) for axis in range(3)]
    return np.stack(axes, axis=1)


def tension_colors(tension: Array, highest: float) -> NDArray[np.uint8]:
    """Return RGBA colours of tensions of any shape [N], grey where slack.

    `highest` is the tension of the brightest colour [N].
    """
    import matplotlib

    colormap = matplotlib.colormaps["viridis"]
    scaled = np.clip(tension / max(highest, 1e-9), 0.0, 1.0)
    colors = np.asarray(colormap(scaled, bytes=True), dtype=np.uint8)
    colors[tension <= 0.0] = SLACK_COLOR
    return colors


def log_conduit(
    rec: Branch, path: str, time: Array, ends: Array, colors: NDArray[np.uint8]
) -> None:
    """Log some frames of a line, at `time` (t,) [s].

    Its parts have ends (t, P, 3) [m] and colours (t, P-1, 4).
    """
    lengths = [ends.shape[1] - 1] * len(ends)
    own = rr.LineStrips3D.columns(colors=colors.reshape(-1, 4))
    columns = [*own.partition(lengths)]
    pairs = np.stack([ends[:, :-1], ends[:, 1:]], axis=2).astype(np.float32)
    if np.allclose(ends, ends[0], rtol=0.0, atol=1e-6):  # only its colours change
        strips = rr.LineStrips3D.columns(strips=pairs[0])
        rec.send_series(path, time[:1], [*strips.partition(lengths[:1])])
    else:
        strips = rr.LineStrips3D.columns(strips=pairs.reshape(-1, 2, 3))
        columns = [*strips.partition(lengths), *columns]
    rec.send_series(path, time, columns)
