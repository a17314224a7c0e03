"""All scripted trajectories by name.

    >>> from cc_mujoco.human import trajectory
    >>> trajectory("sweep")
    Sweep(amplitude=0.4, move=1.0, hold=0.5)
    >>> trajectory("sweep", limit=0.3).amplitude       # made to fit an ankle
    0.3

Defaults suit a wrist, except those of `walk`, which is an ankle's. Parameters are
changed with `dataclasses.replace`; the promises that all keep are in `motion`.
"""

from __future__ import annotations

from dataclasses import replace

from cc_mujoco.errors import look_up
from cc_mujoco.human._excitation import Chirp, Multisine, Sine
from cc_mujoco.human._motion import Scripted
from cc_mujoco.human._point_to_point import Ramp, Reach, Reversals, Sweep
from cc_mujoco.human._walking import Walk

TRAJECTORIES: dict[str, Scripted] = {
    "sweep": Sweep(),
    "ramp": Ramp(),
    "sine": Sine(),
    "chirp": Chirp(),
    "multisine": Multisine(),
    "reach": Reach(),
    "reversals": Reversals(),
    "walk": Walk(),
}
"""Every scripted trajectory with its default parameters."""


def trajectory(name: str, limit: float | None = None) -> Scripted:
    """Look a trajectory up, scaled down to a joint's range if need be.

    Args:
        name: A key of `TRAJECTORIES`.
        limit: Largest absolute angle of the joint [rad]; none by default.

    Returns:
        The trajectory; its amplitude is the default one or `limit`, whichever is less.

    Raises:
        CableError: If there is no such trajectory; names the nearest and all others.
    """
    found = look_up("trajectory", name, TRAJECTORIES)
    if limit is None or found.amplitude <= limit:
        return found
    return replace(found, amplitude=limit)
