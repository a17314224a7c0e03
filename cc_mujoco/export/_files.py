"""The folder of an exported controller, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from cc_mujoco._utils import atomic_io
from cc_mujoco.export import _c_source as c_source
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._interface import controller_source
from cc_mujoco.export._ros2_control import CMAKE_BLOCK, ROS2_FILES, ros2_texts
from cc_mujoco.native import _library as native_library

HEADER_FILE = "cc_controller.h"
SOURCE_FILES = ("cc_controller.c", "cc_parameters.c")
"""Files that are compiled into a user's program."""
TEXT_FILES = ("cc_native.h", "cc_example.c", "CMakeLists.txt", "README.md")
EXPORT_FILES = (HEADER_FILE, *SOURCE_FILES, *TEXT_FILES, atomic_io.MANIFEST)
"""Files that a folder holds; the manifest is the last."""


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a controller may be written to a folder.

    Args:
        folder: Where.

    Raises:
        CableError: It may not.
    """
    names = (*ROS2_FILES, *EXPORT_FILES)
    header = _existing_header(Path(folder) / HEADER_FILE)
    atomic_io.require_ours(folder, lambda _: header.startswith(c_source.HEADER_MARK))
    atomic_io.require_unmodified(folder, names[:-1])


def _existing_header(path: Path) -> str:
    """Return the header of an earlier export; empty without one."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def write(
    folder: str | os.PathLike[str],
    plan: ExportPlan,
    what: str,
    notes: Sequence[str] = (),
    *,
    ros2_control: bool = False,
) -> None:
    """Write a controller as C99, with all that a C compiler needs.

    Args:
        folder: Where; what an earlier export left there is replaced unless a user
            changed it.
        plan: The controller.
        what: Of which controller, for what scene; stands in the header.
        notes: What is known of it, a line each; likewise.
        ros2_control: Whether to write a package of ROS 2 around it.

    Raises:
        CableError: It cannot be written there.
    """
    require_ours(folder)
    texts = {
        HEADER_FILE: c_source.header(plan, what, notes),
        "cc_controller.c": controller_source(plan, what),
        "cc_native.h": (native_library.PACKAGE / "native/native.h").read_text(),
        "cc_parameters.c": c_source.parameters(plan),
        "cc_example.c": c_source.example(plan),
        "CMakeLists.txt": c_source.CMAKE_TEXT,
        "README.md": c_source.readme(plan, what, notes),
    }
    if ros2_control:
        texts |= ros2_texts(plan)
        texts["CMakeLists.txt"] += CMAKE_BLOCK
    with atomic_io.replacing_folder(folder) as partial:
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        atomic_io.write_manifest(partial, [path.name for path in partial.iterdir()])
