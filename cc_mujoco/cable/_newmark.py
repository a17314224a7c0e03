"""Limits of the step of ends that look ahead, see `plugin/_implicit_ends.py`.

The plugin and the kernels of mujoco_warp share them.
"""

IMPLICIT_LIMIT = 1.0
"""Square of step times frequency, in `qpos0`, above which an end may look ahead."""
STABILITY_LIMIT = 2.5
"""Square of step times frequency up to which looking ahead changes nothing."""
VELOCITY_GAIN = 0.25
"""Weight of the velocity of an end, over the square of s beta."""
