"""Step limits of ends that predict their tension, see `plugin/_implicit_ends.py`.

The plugin and the kernels of mujoco_warp share them.
"""

from typing import NamedTuple


class Newmark(NamedTuple):
    """Limits of step times frequency, squared, and numerical damping."""

    implicit_limit: float = 1.0  # in `qpos0`, above which an end may look ahead
    stability_limit: float = 2.5  # up to which looking ahead changes nothing
    # Weight of the velocity of an end, over the square of s beta.
    velocity_gain: float = 0.25


NEWMARK, NEWMARK_RK4 = Newmark(), Newmark(0.3, 5.8, 0.0)
