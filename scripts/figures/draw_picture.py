"""Draw the picture of the front page: the wrist handle at work, conduits by tension.

    MUJOCO_GL=egl python scripts/figures/draw_picture.py envs/wrist_handle.png

Needs OpenGL; `egl` or `osmesa` do without a display.
"""

from __future__ import annotations

import argparse

import gymnasium
import mujoco
import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cc_mujoco import engine
from cc_mujoco.control import controller
from cc_mujoco.figures import figure_path, save
from cc_mujoco.recording import EpisodeLog
from cc_mujoco.recording.conduit3d import conduit_points, tension_colors
from cc_mujoco.recording.episode import play
from cc_mujoco.transmission.conduit import node_places

PIECES = 160
"""Short cylinders that a conduit is drawn with."""

SECONDS = 3.4
"""Into the sweep: the handle turns, tension runs through both cables."""


def episode() -> tuple[mujoco.MjModel, EpisodeLog]:
    """Play a sweep of the wrist handle."""
    env = gymnasium.make("cc_mujoco/WristHandle-v0", task="spring", duration=SECONDS)
    log = play(env, controller("pi", env.unwrapped.drive))
    return env.unwrapped.model, log


def photograph(model: mujoco.MjModel, log: EpisodeLog) -> NDArray[np.uint8]:
    """Render the last sample, with conduits coloured by the tension inside."""
    data = mujoco.MjData(model)
    data.qpos[:] = log["qpos"][-1]
    mujoco.mj_fwdPosition(model, data)
    with mujoco.Renderer(model, 720, 1280) as renderer:
        renderer.update_scene(data, camera="overview")
        scene = renderer.scene
        for cable in engine.cables(model):
            tension = log[f"tension_{cable}_nodes_n"][-1]
            pieces = np.linspace(0.0, 1.0, PIECES + 1)
            points = conduit_points(model, cable, log["qpos"][-1:], pieces)[0]
            middle = np.linspace(0.0, 1.0, PIECES)
            described = engine.from_mjcf(model)[cable]
            nodes = node_places(described) / described.length
            tension = np.interp(middle, nodes, tension)
            colors = tension_colors(tension, highest(log))
            for j, color in enumerate(colors):
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(
                    geom,
                    mujoco.mjtGeom.mjGEOM_CAPSULE,
                    np.zeros(3),
                    np.zeros(3),
                    np.zeros(9),
                    color.astype(np.float32) / 255.0,
                )
                mujoco.mjv_connector(
                    geom,
                    mujoco.mjtGeom.mjGEOM_CAPSULE,
                    0.007,
                    points[j],
                    points[j + 1],
                )
                geom.emission = 0.4
                scene.ngeom += 1
        return renderer.render().copy()


def highest(log: EpisodeLog) -> float:
    """Largest tension of the episode [N]."""
    cables = ("flexor", "extensor")
    return max(float(log[f"tension_{c}_nodes_n"].max()) for c in cables)


def main() -> None:
    """Draw and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=figure_path)
    out = parser.parse_args().out
    model, log = episode()
    figure = Figure(figsize=(9.6, 5.4), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(photograph(model, log))
    axes.set_axis_off()
    scale = figure.add_axes((0.9, 0.12, 0.016, 0.5))
    colors = colormaps["viridis"]
    image = axes.imshow(
        np.zeros((1, 1)), cmap=colors, norm=Normalize(0.0, highest(log)), visible=False
    )
    figure.colorbar(image, cax=scale, label="tension [N]")
    axes.set(xlim=(0, 1280), ylim=(720, 0))
    save(out, figure, dpi=110)


if __name__ == "__main__":
    main()
