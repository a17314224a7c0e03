"""Draw a device at work, its cables by tension.

    MUJOCO_GL=egl python scripts/figures/draw_picture.py --scene knee.xml knee.png

Needs OpenGL; `egl` or `osmesa` do without a display.
"""

from __future__ import annotations

import argparse

import gymnasium
import numpy as np
from figure_paths import figure_path
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from cc_mujoco import simulate
from cc_mujoco.report import TENSION_COLORS, figure, save
from cc_mujoco.viz import OffscreenRenderer, highest_tension

DURATION = 1.4  # time after which tension runs through the cables [s]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=figure_path)
    parser.add_argument("--scene", default="wrist", help="device: name or file")
    options = parser.parse_args()
    env = gymnasium.make("cc_mujoco/Device-v1", device=options.scene, duration=DURATION)
    log = simulate(options.scene, "none", duration=DURATION)
    qpos, highest = log["qpos"][-1:], highest_tension(log)
    tensions = {name: log[f"tension_{name}_nodes_n"][-1] for name in log.cables}
    with OffscreenRenderer(env.unwrapped.model, log.cables, highest, qpos) as stage:
        photograph = np.asarray(stage.picture(qpos[0], tensions))
    drawing = figure(9.6, 5.4)
    drawing.set_layout_engine("none")
    axes = drawing.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(photograph)
    axes.set_axis_off()
    scale = drawing.add_axes((0.9, 0.12, 0.016, 0.5))
    colors = ScalarMappable(Normalize(0.0, highest), TENSION_COLORS)
    drawing.colorbar(colors, cax=scale, label="tension [N]")
    save(options.out, drawing, dpi=110)


if __name__ == "__main__":
    main()
