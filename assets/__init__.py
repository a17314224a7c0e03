"""The MJCF scenes and example data that ship with the package.

Example:
    >>> import mujoco
    >>> import cc_mujoco
    >>> from cc_mujoco.assets import scene_path
    >>> model = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))

`import cc_mujoco` registers the plugin that the scenes ask for.
"""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco.errors import look_up

__all__ = ["POLICIES", "SCENES", "policy_file", "scene_path"]

SCENES: dict[str, str] = {
    "wrist": "wrist_handle.xml",
    "ankle": "ankle_exo.xml",
    "bench": "bench.xml",
    "finger": "tendon_finger.xml",
    "exosuit": "exosuit.xml",
    "bilateral": "exosuit_bilateral.xml",
    "hand": "tendon_hand.xml",
    "endoscope": "endoscope.xml",
}
"""File of each scene, by the name that `scene_path` and the command line take."""

POLICIES = tuple(
    f"{name}.safetensors" for name in ("wrist", "ankle", "finger", "exosuit")
)
"""Policies that ship with the package, for the devices of these names."""


def policy_file(name: str | os.PathLike[str]) -> Path:
    """Return a policy's file: the given one, or else that of `POLICIES`."""
    path = Path(name)
    if str(name) in POLICIES and not path.exists():
        path = Path(__file__).resolve().parent / "policies" / path
    return path


def scene_path(name: str) -> Path:
    """Find the MJCF file of a scene.

    Args:
        name: A key of `SCENES`.

    Returns:
        The path of the file, absolute.

    Raises:
        CableError: If there is no scene of that name.
    """
    return Path(__file__).resolve().parent / look_up("scene", name, SCENES)
