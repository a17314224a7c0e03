"""Constants of implicit cable ends, see `plugin/_implicit_ends.py`.

The plugin and the kernels of mujoco_warp share them.
"""

from typing import NamedTuple


class Newmark(NamedTuple):
    """Limits of (h w)^2, with time step h and frequency w of an end, and damping."""

    implicit_limit: float = 1.0  # (h w)^2 in `qpos0` above which an end is implicit
    stability_limit: float = 2.5  # s, (h w)^2 up to which beta is 0
    velocity_gain: float = 0.25  # alpha / (s beta)^2


NEWMARK, NEWMARK_RK4 = Newmark(), Newmark(0.3, 5.8, 0.0)
