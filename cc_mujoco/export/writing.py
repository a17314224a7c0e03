"""The folder of an exported controller, written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco import files
from cc_mujoco.compiled import bitcode
from cc_mujoco.export import entries, sources
from cc_mujoco.export.laws import ExportPlan
from cc_mujoco.export.machine import Target, emit

HEADER, OBJECT = "cc_controller.h", "cc_controller.o"
TEXTS = ("cc_parameters.c", "cc_example.c", "CMakeLists.txt")
FILES = (HEADER, OBJECT, *TEXTS, files.WRITTEN)
"""Files that a folder holds."""


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a controller may be written to a folder.

    Raises:
        CableError: It may not.
    """
    told = _told(Path(folder))
    files.require_ours(folder, FILES, lambda _: told.startswith(sources.MARK))
    files.require_signed(folder, (HEADER, OBJECT, *TEXTS))


def _told(folder: Path) -> str:
    """The header of an earlier export; empty without one."""
    try:
        return (folder / HEADER).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def write(
    folder: str | os.PathLike[str], plan: ExportPlan, target: Target, what: str
) -> None:
    """Compile a controller and write it with all that C needs.

    Args:
        folder: Where; what an earlier export left there is replaced unless a user
            changed it.
        plan: The controller.
        target: The machine.
        what: Of which controller, for what scene and machine; stands in the header.

    Raises:
        CableError: It cannot be compiled for that machine, or not be written there.
    """
    require_ours(folder)
    law = plan.law
    functions = {
        one.name: one
        for entry, signature in (
            (law.set_parameters, entries.INIT), (law.step, entries.STEP),
        )
        for one in bitcode(entry.__name__, entry, signature)
    }  # fmt: skip
    assembly = sources.interface(
        plan, target.bits, law.set_parameters.__name__, law.step.__name__
    )
    compiled = emit(target, assembly, functions.values())
    texts = sources.parameters(plan), sources.example(plan), sources.CMAKE
    with files.replacing_folder(folder) as partial:
        (partial / OBJECT).write_bytes(compiled)
        names = HEADER, *TEXTS
        for name, text in zip(names, (sources.header(plan, what), *texts), strict=True):
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        files.sign(partial, [path.name for path in partial.iterdir()])
