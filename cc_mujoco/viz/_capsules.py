"""Cables as capsules of a MuJoCo scene, coloured by the tension inside.

capsules = Capsules(model, ("flexor", "extensor"), 80.0)
mujoco.mj_fwdPosition(model, data)
capsules.add(scene, data, {"flexor": tension, "extensor": tension})
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.viz._cable_lines import cable_lines
from cc_mujoco.viz._conduit3d import tension_colors
from cc_mujoco.viz._tendon3d import ROPE_COLOR, is_uncolored

Array = NDArray[np.float64]

SHADE, EMISSION = 0.72, 0.25
"""Material of coloured cables: lit, their colours come near those of the scale."""

HIDDEN_TENDON_GROUP = mujoco.mjNGROUP - 1


class Capsules:
    """The cables of a model."""

    def __init__(
        self, model: mujoco.MjModel, cables: Iterable[str], highest: float
    ) -> None:
        """Take their measures, hide their tendons in the model, and colour the others.

        The model is changed in place; `highest` is the tension of the brightest colour
        [N].
        """
        self.highest = highest
        """Tension of the brightest colour [N]."""
        self._model = model
        self._lines = cable_lines(model, cables)
        for line in self._lines:
            if isinstance(line.source, int):
                # MuJoCo draws what is transparent, but this group only on request.
                model.tendon_group[line.source] = HIDDEN_TENDON_GROUP
        for tendon in range(model.ntendon):
            if is_uncolored(model, tendon):
                model.tendon_rgba[tendon] = ROPE_COLOR

    def add(
        self,
        scene: mujoco.MjvScene,
        data: mujoco.MjData,
        tensions: Mapping[str, Array] | None = None,
    ) -> None:
        """Add them to a scene that has room for all of them.

        The pose is up to date as by `mj_fwdPosition`. `tensions` are those at the nodes
        of each cable (n,) [N]; grey without.
        """
        for line in self._lines:
            points = line.points(self._model, data)
            shown = np.zeros(len(points) - 1)
            if tensions is not None:
                shown = line.tensions(tensions[line.cable])
            colors = tension_colors(shown, self.highest).astype(np.float32)
            colors *= SHADE / 255.0
            colors[:, 3] = 1.0
            # Colours need more room than the line of the scene.
            _add(scene, points, colors, 1.4 * line.radius)


def _add(
    scene: mujoco.MjvScene, points: Array, colors: NDArray[np.float32], radius: float
) -> None:
    shape, none = mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3)
    for color, start, end in zip(colors, points[:-1], points[1:], strict=True):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, shape, none, none, np.zeros(9), color)
        mujoco.mjv_connector(geom, shape, radius, start, end)
        geom.emission, geom.specular = EMISSION, 0.1
        scene.ngeom += 1
