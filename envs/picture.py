"""Pictures of a device, for `render_mode="rgb_array"`."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError

CAMERA = "overview"
"""Camera of the scene that looks on."""

SIZE = (480, 854)
"""Height and width [pixels]."""


class Camera:
    """Makes pictures of poses; needs OpenGL (`MUJOCO_GL=egl` without a display)."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Open a renderer."""
        self._model = model
        # Its own data, so that looking does not touch the simulation.
        self._data = mujoco.MjData(model)
        self._renderer = mujoco.Renderer(model, *SIZE)

    def picture(self, qpos: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Take a picture, (height, width, 3), of a pose (nq,)."""
        self._data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self._model, self._data)
        self._renderer.update_scene(self._data, camera=CAMERA)
        picture: NDArray[np.uint8] = self._renderer.render()
        return picture.copy()

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def check_mode(mode: str | None, modes: Sequence[str]) -> None:
    """Refuse a render mode that does not exist.

    Raises:
        CableError: If `mode` is neither None nor one of `modes`.
    """
    if mode is not None and mode not in modes:
        raise CableError.unknown("render mode", str(mode), modes)
