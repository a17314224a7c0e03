"""The folder of an exported controller, written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.compilation import bitcode
from cc_mujoco.export import _c_source as c_source
from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._ros2_control import CMAKE_BLOCK, ROS2_FILES, ros2_texts
from cc_mujoco.export._targets import Target, emit

HEADER_FILE, OBJECT_FILE = "cc_controller.h", "cc_controller.o"
TEXT_FILES = ("cc_parameters.c", "cc_example.c", "CMakeLists.txt")
EXPORT_FILES = (HEADER_FILE, OBJECT_FILE, *TEXT_FILES, atomic_io.MANIFEST)
"""Files that a folder holds, of a device with one axis."""


def export_files(axis: str = "", ros2_control: bool = False) -> tuple[str, ...]:
    """Return the files that a folder holds; the manifest is the last.

    Args:
        axis: Name of the axis, of a device with several.
        ros2_control: Whether it is a package of ROS 2.
    """
    names = (*ROS2_FILES, *EXPORT_FILES) if ros2_control else EXPORT_FILES
    return tuple(c_source.renamed(name, axis) for name in names)


def require_ours(folder: str | os.PathLike[str], axis: str = "") -> None:
    """Find out, before long work, whether a controller may be written to a folder.

    Args:
        folder: Where.
        axis: Name of the axis, of a device with several.

    Raises:
        CableError: It may not.
    """
    names = export_files(axis, ros2_control=True)
    header = _existing_header(Path(folder) / c_source.renamed(HEADER_FILE, axis))
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
    require_ours(folder, plan.axis)
    law = plan.law
    functions = {
        one.name: one
        for entry, signature in (
            (law.set_parameters, entry_points.INIT_SIGNATURE),
            (law.step, entry_points.STEP_SIGNATURE),
        )
        for one in bitcode(entry.__name__, entry, signature)
    }
    assembly = c_source.interface(
        plan, target.bits, law.set_parameters.__name__, law.step.__name__
    )
    assembly = c_source.renamed(assembly, plan.axis)
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
        object_file = partial / c_source.renamed(OBJECT_FILE, plan.axis)
        object_file.write_bytes(compiled)
        for name, text in texts.items():
            path = partial / c_source.renamed(name, plan.axis)
            text = c_source.renamed(text, plan.axis)
            path.write_text(text, encoding="utf-8", newline="\n")
        atomic_io.write_manifest(partial, [path.name for path in partial.iterdir()])
