"""The MJCF scenes and example data that ship with the package.

Example:
    >>> import mujoco
    >>> import cc_mujoco
    >>> from cc_mujoco.assets import scene_path
    >>> model = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))

`import cc_mujoco` registers the plugin that the scenes ask for.
"""

from __future__ import annotations

from pathlib import Path

from cc_mujoco.errors import look_up

__all__ = ["SCENES", "scene_path"]

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
