"""Draw a device at work, its cables by tension: the pictures of the pages.

    MUJOCO_GL=egl python scripts/figures/draw_picture.py envs/wrist_handle.png
    MUJOCO_GL=egl python scripts/figures/draw_picture.py --scene exosuit exosuit.png
    MUJOCO_GL=egl python scripts/figures/draw_picture.py --scene knee.xml knee.png

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

from cc_mujoco import plugin, simulate
from cc_mujoco.report import figure_path, save
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import conduit_points, conduit_shares, tension_colors

PIECES = 160  # short cylinders that a conduit is drawn with

PLAYED = {"wrist": ("spring", 3.4, 0.007), "exosuit": ({"hip": "swing"}, 2.42, 0.006)}
"""Task, time at which tension runs through the cables [s], radius of a cable [m]."""
OTHER = (None, 1.4, 0.008)  # task, time and radius of any other device


def episode(scene: str) -> tuple[mujoco.MjModel, EpisodeLog]:
    """Play until the picture is taken."""
    task, seconds, _ = PLAYED.get(scene, OTHER)
    law = "pi_tuned" if scene in PLAYED else "none"
    env = gymnasium.make("cc_mujoco/Device-v1", device=scene, duration=seconds)
    return env.unwrapped.model, simulate(scene, law, task=task, duration=seconds)


def parts(
    model: mujoco.MjModel, cable: str, tension: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ends of parts of a cable's line as shares of it, and tensions of each."""
    shares = conduit_shares(model, cable)
    if shares.size > tension.size:
        return shares, tension
    fine = np.linspace(0.0, 1.0, PIECES + 1)
    return fine, np.interp(np.linspace(0.0, 1.0, PIECES), shares, tension)


def photograph(
    model: mujoco.MjModel, log: EpisodeLog, radius: float
) -> NDArray[np.uint8]:
    """Render the last sample, with cables coloured by the tension inside."""
    data = mujoco.MjData(model)
    data.qpos[:] = log["qpos"][-1]
    mujoco.mj_fwdPosition(model, data)
    with mujoco.Renderer(model, 720, 1280) as renderer:
        # Without a camera of its own, the scene is seen as the viewer opens it.
        renderer.update_scene(data, camera="overview" if model.ncam else -1)
        scene = renderer.scene
        for cable in plugin.cables(model):
            shares, tension = parts(model, cable, log[f"tension_{cable}_nodes_n"][-1])
            points = conduit_points(model, cable, log["qpos"][-1:], shares)[0]
            colors = tension_colors(tension, highest(log))
            for j, color in enumerate(colors):
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(
                    geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3),
                    np.zeros(9), color.astype(np.float32) / 255.0,
                )  # fmt: skip
                mujoco.mjv_connector(
                    geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, points[j],
                    points[j + 1],
                )  # fmt: skip
                geom.emission = 0.4
                scene.ngeom += 1
        return renderer.render().copy()


def highest(log: EpisodeLog) -> float:
    """Return the largest tension of the episode [N]."""
    return max(float(log[f"tension_{c}_nodes_n"].max()) for c in log.cables)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=figure_path)
    parser.add_argument("--scene", default="wrist", help="device: name or file")
    options = parser.parse_args()
    model, log = episode(options.scene)
    figure = Figure(figsize=(9.6, 5.4), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(photograph(model, log, PLAYED.get(options.scene, OTHER)[2]))
    axes.set_axis_off()
    scale = figure.add_axes((0.9, 0.12, 0.016, 0.5))
    colors = colormaps["viridis"]
    image = axes.imshow(
        np.zeros((1, 1)), cmap=colors, norm=Normalize(0.0, highest(log)), visible=False
    )
    figure.colorbar(image, cax=scale, label="tension [N]")
    axes.set(xlim=(0, 1280), ylim=(720, 0))
    save(options.out, figure, dpi=110)


if __name__ == "__main__":
    main()
