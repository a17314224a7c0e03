"""The folder of an exported controller, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.compilation import bitcode
from cc_mujoco.export import _c_source as c_source
from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export import _joint_torques as joint_torques
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._interface import interface
from cc_mujoco.export._ros2_control import CMAKE_BLOCK, ROS2_FILES, ros2_texts
from cc_mujoco.export._targets import Target, emit

HEADER_FILE, OBJECT_FILE = "cc_controller.h", "cc_controller.o"
TEXT_FILES = ("cc_parameters.c", "cc_example.c", "CMakeLists.txt")
EXPORT_FILES = (HEADER_FILE, OBJECT_FILE, *TEXT_FILES, atomic_io.MANIFEST)
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
    atomic_io.require_ours(
        folder, names, lambda _: header.startswith(c_source.HEADER_MARK)
    )
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
    target: Target,
    what: str,
    *,
    ros2_control: bool = False,
) -> None:
    """Compile a controller and write it with all that C needs.

    Args:
        folder: Where; what an earlier export left there is replaced unless a user
            changed it.
        plan: The controller.
        target: The machine.
        what: Of which controller, for what scene and machine; stands in the header.
        ros2_control: Whether to write a package of ROS 2 around it.

    Raises:
        CableError: It cannot be compiled for that machine, or not be written there.
    """
    require_ours(folder)
    functions = {
        one.name: one
        for entry, signature in _entries(plan)
        for one in bitcode(entry.__name__, entry, signature)
    }
    assembly = interface(plan, target.bits)
    compiled = emit(target, assembly, functions.values())
    texts = {
        HEADER_FILE: c_source.header(plan, what),
        "cc_parameters.c": c_source.parameters(plan),
        "cc_example.c": c_source.example(plan),
        "CMakeLists.txt": c_source.CMAKE_TEXT,
    }
    if ros2_control:
        texts |= ros2_texts(plan)
        texts["CMakeLists.txt"] += CMAKE_BLOCK
    with atomic_io.replacing_folder(folder) as partial:
        (partial / OBJECT_FILE).write_bytes(compiled)
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        atomic_io.write_manifest(partial, [path.name for path in partial.iterdir()])


def _entries(plan: ExportPlan) -> Iterator[tuple[Callable[..., Any], Any]]:
    """Return the functions that `_interface` calls, and their signatures."""
    yield entry_points.are_possible, entry_points.POSSIBLE_SIGNATURE
    if plan.torques.changes:
        yield joint_torques.own_readings, joint_torques.SIGNATURE
    for law in {axis.law.step: axis.law for axis in plan.axes}.values():
        yield law.wrong_parameters, entry_points.WRONG_SIGNATURE
        yield law.store_parameters, entry_points.STORE_SIGNATURE
        yield law.step, entry_points.STEP_SIGNATURE
