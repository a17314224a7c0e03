"""The folder of an exported controller, written whole or not at all."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cc_mujoco._utils import atomic_io
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.export import _c_source as c_source
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._joint_torques import own_readings
from cc_mujoco.export._ros2_control import CMAKE_BLOCK, ROS2_FILES, ros2_texts
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary, literal
from cc_mujoco.native._kinds import python_function


def controller_source(plan: ExportPlan, what: str) -> str:
    """Return the controller as C99, without what it includes."""
    library = CLibrary({}, native_library.PACKAGE.parent)
    writer = _Interface(plan, library)
    text = "\n".join(writer.lines())
    functions = library.text()
    return (
        f'/* {what}. */\n#include "cc_controller.h"\n\n#include "cc_native.h"\n\n'
        f"{functions}\n{text}\n"
    )


class _Interface:
    """Writer of the C functions of the header, which call those of each axis in turn.

    Memory, parameters and readings of the axes lie one behind the other, and those that
    `own_readings` needs are behind the memory of the last.
    """

    def __init__(self, plan: ExportPlan, library: CLibrary) -> None:
        self._plan, self._library = plan, library

    def lines(self) -> Iterator[str]:
        """Return the lines of the constants and of the functions of the header."""
        yield from self._constants()
        yield "size_t cc_controller_size(void) { return sizeof(cc_controller); }\n"
        yield from self._set_parameters()
        yield from self._reset()
        yield "int cc_controller_init(cc_controller *controller, const double *given)"
        yield "{"
        yield "    const int wrong = cc_controller_set_parameters(controller, given);"
        yield "    if (wrong == 0) {"
        yield "        cc_controller_reset(controller);"
        yield "    }"
        yield "    return wrong;"
        yield "}\n"
        yield from self._step()

    def _name(self, function: Callable[..., Any]) -> str:
        plain = python_function(function)
        assert plain is not None
        return self._library.require(plain).name

    def _constants(self) -> Iterator[str]:
        plan = self._plan
        yield _table("double", "least", [field.low for field in plan.fields])
        yield _table("double", "most", [field.high for field in plan.fields])
        yield _table("int64_t", "guarded", plan.guarded)
        if plan.torques.changes:
            yield _table("int64_t", "shape", plan.torques.shape)
            yield _table("double", "tables", plan.torques.tables)
        for k, axis in enumerate(plan.axes):
            yield _table("int64_t", f"shape{k}", axis.tables.shape)
            yield _table("double", f"tables{k}", axis.tables.numbers)
        yield ""

    def _set_parameters(self) -> Iterator[str]:
        """Refuse what is wrong in any axis before parameters of one are taken."""
        plan = self._plan
        yield "int cc_controller_set_parameters("
        yield "    cc_controller *controller, const double *given)"
        yield "{"
        yield "    double *memory = controller->number;"
        yield "    int64_t wrong = 0;"
        starts = _starts([len(axis.fields) for axis in plan.axes])
        for k, first in enumerate(starts):
            axis = plan.axes[k]
            count = len(axis.fields)
            arguments = [
                _view("Ints", f"shape{k}", len(axis.tables.shape)),
                *(
                    _view("Reals", f"{name} + {first}", count)
                    for name in ("given", "least", "most")
                ),
            ]
            yield f"    wrong = {self._name(law_steps.wrong_parameters)}("
            yield f"        {_joined([*arguments, str(len(axis.law.gains))])});"
            yield "    if (wrong != 0) {"
            yield f"        return (int)(wrong + {first});"
            yield "    }"
        for k, first in enumerate(starts):
            axis = plan.axes[k]
            yield f"    {self._name(axis.law.store_parameters)}("
            arguments = [
                self._memory(k),
                _view("Ints", f"shape{k}", len(axis.tables.shape)),
                _view("Reals", f"given + {first}", len(axis.fields)),
            ]
            yield f"        {_joined(arguments)});"
        yield "    return 0;"
        yield "}\n"

    def _memory(self, axis: int) -> str:
        plan = self._plan
        end = [*plan.starts, plan.memory_size][axis + 1]
        return _view("Reals", f"memory + {plan.starts[axis]}", end - plan.starts[axis])

    def _reset(self) -> Iterator[str]:
        yield "void cc_controller_reset(cc_controller *controller)"
        yield "{"
        for k in range(len(self._plan.axes)):
            place = self._plan.starts[k] + law_steps.FIRST_STEP
            yield f"    controller->number[{place}] = 1.0;"
        yield "}\n"

    def _step(self) -> Iterator[str]:
        """Refuse an impossible reading of any axis before a state changes."""
        plan = self._plan
        count = len(plan.seen)
        impossible = self._name(law_steps.impossible)
        guarded = _view("Ints", "guarded", len(plan.guarded))
        yield "int cc_controller_step(cc_controller *controller,"
        yield "                       const cc_readings *readings, double *torques)"
        yield "{"
        yield "    double *memory = controller->number;"
        yield "    double seen[sizeof(cc_readings) / sizeof(double)];"
        yield "    memcpy(seen, readings, sizeof seen);"
        check = f"{impossible}({_view('Reals', 'seen', count)}, {count}, {guarded})"
        yield f"    int64_t wrong = {check};"
        if plan.torques.changes:
            start = plan.starts[-1]
            own = _view("Reals", f"memory + {start}", plan.memory_size - start)
            arguments = [
                own,
                _view("Ints", "shape", len(plan.torques.shape)),
                _view("Reals", "tables", len(plan.torques.tables)),
                _view("Reals", "seen", count),
            ]
            yield "    if (wrong == 0) {"
            yield f"        {self._name(own_readings)}("
            yield f"            {_joined(arguments, 12)});"
            yield f"        memcpy(seen, memory + {start}, sizeof seen);"
            yield "        /* It may be over an arm of 0. */"
            yield f"        wrong = {check};"
            yield "    }"
        yield "    if (wrong != 0) {"
        for k in range(len(plan.axes)):
            yield f"        torques[{k}] = 0.0;"
        yield "        return (int)wrong;"
        yield "    }"
        for k, first in enumerate(_starts([len(axis.seen) for axis in plan.axes])):
            axis = plan.axes[k]
            arguments = [
                self._memory(k),
                _view("Ints", f"shape{k}", len(axis.tables.shape)),
                _view("Reals", f"tables{k}", len(axis.tables.numbers)),
                _view("Reals", f"seen + {first}", len(axis.seen)),
            ]
            yield f"    torques[{k}] = {self._name(axis.law.step)}("
            yield f"        {_joined(arguments)});"
        yield "    return 0;"
        yield "}"


def _view(kind: str, place: str, count: int) -> str:
    """Return an array of C's functions, of a constant or a part of a memory."""
    element = {"Reals": "double", "Ints": "int64_t"}[kind]
    place = place.removesuffix(" + 0")
    if " " in place:
        place = f"({place})"
    return f"({kind}){{({element} *){place}, {count}}}"


def _joined(arguments: Sequence[str], depth: int = 8) -> str:
    return (",\n" + " " * depth).join(arguments)


def _starts(sizes: Sequence[int]) -> list[int]:
    """Return where each of several parts begins."""
    return list(itertools.accumulate(sizes, initial=0))[:-1]


def _table(kind: str, name: str, numbers: Sequence[float]) -> str:
    """Return a constant array, of the same bits; of one zero where it is empty."""
    cells = [
        str(n) if kind == "int64_t" else literal(float(n)).text for n in numbers
    ] or ["0"]
    rows = [", ".join(cells[i : i + 8]) for i in range(0, len(cells), 8)]
    return f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(rows) + "\n};"


HEADER_FILE = "cc_controller.h"
SOURCE_FILES = ("cc_controller.c", "cc_parameters.c")
"""Files that are compiled into a user's program."""
TEXT_FILES = ("cc_native.h", "cc_example.c", "CMakeLists.txt", "README.md")
EXPORT_FILES = (HEADER_FILE, *SOURCE_FILES, *TEXT_FILES, atomic_io.MANIFEST)
"""Files that a folder holds; the manifest is the last."""


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a controller may be written to a folder."""
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
