"""The folder of an exported controller in C, written whole or not at all."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cc_mujoco._utils import atomic_io
from cc_mujoco.cable._layout import STATE_HEADER, state_size
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.export._controllers import AxisPlan, ExportPlan
from cc_mujoco.export._joint_torques import own_readings
from cc_mujoco.export._ros2_control import CMAKE_BLOCK, ROS2_FILES, ros2_texts
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary, literal
from cc_mujoco.native._kinds import python_function

HEADER_FILE = "cc_controller.h"
SOURCE_FILES = ("cc_controller.c", "cc_parameters.c")
"""Files that are compiled into a user's program."""
TEXT_FILES = ("cc_native.h", "cc_example.c", "CMakeLists.txt", "README.md")
EXPORT_FILES = (HEADER_FILE, *SOURCE_FILES, *TEXT_FILES, atomic_io.MANIFEST)
"""Files that a folder holds; the manifest is the last."""


HEADER_MARK = "/* Written by cc-mujoco export: "
"""First words of the header."""

_READING_MEANINGS = {
    "motor_angle_rad": "angle of the motor; of a round pulley only its changes matter",
    "joint_angle_rad": "angle of the joint, from its encoder; likewise",
    "motor_velocity_rad_s": "its velocity",
    "joint_velocity_rad_s": "velocity of the joint, from its encoder",
    "winding_angle_rad": "angle at which a pulley of the arm in the neutral pose would "
    "wind the cables; likewise",
    "winding_velocity_rad_s": "velocity at which a pulley of the neutral arm would "
    "wind the cables",
    "leverage_ratio": "arm of the cables at the joint over that of the neutral pose",
    "joint_torque_nm": "measured torque of the cables on the joint",
    "desired_torque_nm": "torque that the cables shall put into the joint",
}


_POLICY_MEANINGS = {
    "motor_angle_rad": "angle of the motor, 0 where it is in the scene",
    "joint_angle_rad": "angle of the joint, 0 where it is in the scene",
    "phase_sine": "sine of the phase of the gait",
    "phase_cosine": "its cosine",
    "reference_angle_rad": "angle that the task commands",
}
"""Meanings of the readings of a policy, where they differ."""


def readme(plan: ExportPlan, what: str, notes: Sequence[str]) -> str:
    """Return the page of the folder; arguments as of `header`."""
    listed = "\n".join(f"- {note}" for note in notes)
    return f"""# {what}

`cc_controller_step` every {plan.period:g} s gives the torque of every motor. See
`cc_controller.h` for readings and parameters, and `cc_example.c` for a program.

- memory: {8 * plan.memory_size} bytes
{listed}

```sh
cmake -S . -B build && cmake --build build
```
"""


def header(plan: ExportPlan, what: str, notes: Sequence[str] = ()) -> str:
    places = []  # two of the last torque in the memory, -1 where none is kept
    for start, axis in zip(plan.starts, plan.axes, strict=False):
        first, second = [*(start + k for k in axis.tables.given), -1, -1][:2]
        places.append(f"{{{first}, {second}}}")
    given = ", ".join(places)
    comments = "".join(f"/* {note}. */\n" for note in notes)
    readings = "\n".join(
        f"    double {name}; /* {meaning} */"
        for axis in plan.axes
        for name, meaning in zip(axis.seen, _meanings(axis), strict=True)
    )
    indices = ""
    for field in plan.fields:
        unit = "-" if field.unit == "1" else field.unit
        meaning = f"{field.meaning} [{unit}]".replace("*/", "* /")
        least = "above 0" if 0.0 < field.low < 1e-300 else f"{field.low:g}"
        indices += f"    CC_{field.name.upper()}, /* {meaning}, {least} to "
        indices += f"{field.high:g} */\n"
    axes = "".join(
        f"CC_AXIS_{name.upper()} = {place}, "
        for place, name in enumerate(plan.names)
        if name
    )
    return f"""{HEADER_MARK}{what}. */
{comments}#ifndef CC_CONTROLLER_H
#define CC_CONTROLLER_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define CC_CONTROLLER_DOUBLES {plan.memory_size}
#define CC_CONTROLLER_PARAMETERS {len(plan.fields)}

/* All that a controller keeps. It is yours: static, on the stack or on the heap, with
 * the alignment of a double. Nothing is allocated, locked, printed or thrown; there is
 * no global state, so that threads may step controllers of their own. It holds no
 * pointers and may be copied. */
typedef struct {{
    double number[CC_CONTROLLER_DOUBLES];
}} cc_controller;

/* Axes, each with a motor. */
enum {{ {axes}CC_AXES = {len(plan.axes)} }};

/* What is measured once a period, in SI units and with the signs of the scene. */
typedef struct {{
{readings}
}} cc_readings;

/* Places of the parameters: meaning [unit], range. */
enum {{
{indices}}};

/* The parameters of the scene; pass a copy with other numbers in it if you like. */
extern const double cc_controller_parameters[CC_CONTROLLER_PARAMETERS];

/* sizeof(cc_controller), of the library that is linked. */
size_t cc_controller_size(void);

/* Begin. Returns 0, or 1 + the place of the first parameter that is out of its range
 * or contradicts another; then nothing is written. */
int cc_controller_init(cc_controller *controller, const double *parameters);

/* Take other parameters from the next step on, and go on from the present state.
 * Returns as cc_controller_init; of parameters that cannot be none is taken. Call it
 * between two steps, from the thread that takes them. */
int cc_controller_set_parameters(cc_controller *controller, const double *parameters);

/* Forget the past: the next step begins an episode, at rest in the pretension. */
void cc_controller_reset(cc_controller *controller);

/* Torques of the motors (CC_AXES) [N m] until the next reading, within their limits.
 * The guard rides through a reading that is no number, infinite or beyond
 * {guard.MAX_READING:g} of its unit, for {1e3 * guard.RIDE_TIME:g} ms; then it stops.
 * Returns 0, or 1 + the place of such a reading at which no guard looks: then all
 * torques are 0 and the state stays as it was. */
int cc_controller_step(cc_controller *controller, const cc_readings *readings,
                       double *torques);

/* Tell, after a step, what the motors got (CC_AXES) instead of these torques, where a
 * limit of yours (of rate, a soft start) allowed no more. What is no number, or beyond
 * {guard.MAX_READING:g} N m, is not heard. */
static inline void cc_controller_given(cc_controller *controller, const double *torques)
{{
    static const int place[CC_AXES][2] = {{{given}}};
    for (int i = 0; i < CC_AXES; i++)
        for (int k = 0; k < 2; k++)
            if (place[i][k] >= 0 && torques[i] <= {guard.MAX_READING:.1f} &&
                torques[i] >= {-guard.MAX_READING:.1f})
                controller->number[place[i][k]] = torques[i];
}}
{_observer_functions(plan)}
#ifdef __cplusplus
}}
#endif
#endif
"""


def _meanings(axis: AxisPlan) -> Iterator[str]:
    known = _READING_MEANINGS
    if axis.law.is_policy:
        known = known | _POLICY_MEANINGS
    for name in axis.columns:
        yield known[name]
    for _, cable, node in axis.tension_readings:
        yield f"tension of {cable} at node {node}, from its sensor [N]"
    for name in axis.other_columns:
        yield known.get(name, "torque at that joint per torque of this motor")


def _observer_functions(plan: ExportPlan) -> str:
    cables = [cable for axis in plan.axes for cable in axis.cables]
    if not cables:
        return ""
    first: list[int] = []
    joints: list[int] = []
    for start, axis in zip(plan.starts, plan.axes, strict=False):
        joints.append(start + law_steps.JOINT_ANGLE if axis.cables else -1)
        if not axis.cables:
            continue
        state = start + axis.tables.states + STATE_HEADER
        width = state_size(max(axis.tables.shape[1 : 1 + len(axis.cables)]))
        first += (state + k * width for k in range(len(axis.cables)))
    names = ", ".join(f"CC_CABLE_{name.upper()} = {k}" for k, name in enumerate(cables))
    nodes = _number_lines(
        1 + segments
        for axis in plan.axes
        for segments in axis.tables.shape[1 : 1 + len(axis.cables)]
    )
    return f"""
/* What the observer finds after a step. */
enum {{ {names}, CC_CABLES = {len(cables)} }};

/* Nodes of a cable, from the motor to the joint. */
static inline int cc_controller_nodes(int cable)
{{
    static const int nodes[CC_CABLES] = {{{nodes}}};
    return nodes[cable];
}}

/* Their tensions [N]; a negative one is slack: the cable carries nothing there. */
static inline const double *cc_controller_tensions(const cc_controller *controller,
                                                   int cable)
{{
    static const int first[CC_CABLES] = {{{_number_lines(first)}}};
    return controller->number + first[cable];
}}

/* Angle of the joint of an axis since the first step [rad]; 0 without a model. */
static inline double cc_controller_joint_angle(const cc_controller *controller,
                                               int axis)
{{
    static const int place[CC_AXES] = {{{_number_lines(joints)}}};
    return place[axis] < 0 ? 0.0 : controller->number[place[axis]];
}}
"""


def _number_lines(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def parameters(plan: ExportPlan) -> str:
    rows = ""
    for field in plan.fields:
        value = repr(float(field.value)).replace("inf", "INFINITY")
        unit = "-" if field.unit == "1" else field.unit
        rows += f"    [CC_{field.name.upper()}] = {value}, /* {unit} */\n"
    return f"""#include <math.h>

#include "cc_controller.h"

const double cc_controller_parameters[CC_CONTROLLER_PARAMETERS] = {{
{rows}}};
"""


def example(plan: ExportPlan) -> str:
    """Return a program that reads measurements and writes torques."""
    seen = plan.seen
    names = ",".join(seen)
    numbers = ",".join("%lf" for _ in seen)
    arguments = ", ".join(f"&r.{name}" for name in seen)
    motors = [f"{name}_" if name else "" for name in plan.names]
    torques = ",".join(f"{motor}motor_torque_nm" for motor in motors)
    return f"""/* Torques of recorded readings: cc_example < readings.csv
 *
 * One line per period: {names}
 * In a real-time loop the call of cc_controller_step stands between reading the sensors
 * and setting the currents of the motors; nothing else of this file does. */
#include <stdio.h>
#include <string.h>

#include "cc_controller.h"

static cc_controller controller;

int main(void)
{{
    char line[{max(512, 40 * len(seen))}];
    int end = 0;
    cc_readings r;
    double torques[CC_AXES];
    int wrong = cc_controller_init(&controller, cc_controller_parameters);
    if (wrong) {{
        fprintf(stderr, "parameter %d cannot be %.17g\\n", wrong - 1,
                cc_controller_parameters[wrong - 1]);
        return 2;
    }}
    if (!fgets(line, sizeof line, stdin)) {{
        fprintf(stderr, "no header on standard input\\n");
        return 2;
    }}
    line[strcspn(line, "\\r\\n")] = 0;
    if (strcmp(line, "{names}")) {{
        fprintf(stderr, "the header must be {names}\\n");
        return 2;
    }}
    puts("{torques}");
    for (long row = 2; fgets(line, sizeof line, stdin); row++) {{
        int count = sscanf(line, "{numbers} %n", {arguments}, &end);
        if (count != {len(seen)} || line[end]) {{
            fprintf(stderr, "line %ld has not just {len(seen)} numbers\\n", row);
            return 2;
        }}
        if (cc_controller_step(&controller, &r, torques))
            fprintf(stderr, "line %ld has a reading that cannot be\\n", row);
        for (int i = 0; i < CC_AXES; i++)
            printf("%.17g%c", torques[i], i + 1 < CC_AXES ? ',' : '\\n');
    }}
    return 0;
}}
"""


CMAKE_TEXT = """cmake_minimum_required(VERSION 3.13)
project(cc_controller C)

add_library(cc_controller STATIC cc_controller.c cc_parameters.c)
target_include_directories(cc_controller PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
if(NOT MSVC)
  # No contraction of a product and a sum: every machine gives the same bits.
  target_compile_options(cc_controller PRIVATE -O2 -ffp-contract=off)
endif()
set_target_properties(cc_controller PROPERTIES C_STANDARD 99
                      POSITION_INDEPENDENT_CODE ON)
if(NOT WIN32)
  target_link_libraries(cc_controller PUBLIC m)
endif()

add_executable(cc_example cc_example.c)
set_target_properties(cc_example PROPERTIES C_STANDARD 99)
target_link_libraries(cc_example PRIVATE cc_controller)
"""


def controller_source(plan: ExportPlan, what: str) -> str:
    """Return the C99 source of the controller, without included files.

    The functions of the header call those of each axis in turn. Memory, parameters and
    readings of the axes lie one behind the other, and those that `own_readings` needs
    are behind the memory of the last.
    """
    library = CLibrary({}, native_library.PACKAGE.parent)

    def called(function: Callable[..., Any], *arguments: str, depth: int = 8) -> str:
        plain = python_function(function)
        assert plain is not None
        listed = (",\n" + " " * depth).join(arguments)
        return f"{library.require(plain).name}(\n{' ' * depth}{listed});"

    lines = [
        _table("double", "least", [field.low for field in plan.fields]),
        _table("double", "most", [field.high for field in plan.fields]),
        _table("int64_t", "guarded", plan.guarded),
    ]
    if plan.torques.changes:
        lines.append(_table("int64_t", "shape", plan.torques.shape))
        lines.append(_table("double", "tables", plan.torques.tables))
    for k, axis in enumerate(plan.axes):
        lines.append(_table("int64_t", f"shape{k}", axis.tables.shape))
        lines.append(_table("double", f"tables{k}", axis.tables.numbers))
    memories = [
        _view("Reals", f"memory + {first}", end - first)
        for first, end in itertools.pairwise(plan.starts)
    ]
    shapes = [
        _view("Ints", f"shape{k}", len(axis.tables.shape))
        for k, axis in enumerate(plan.axes)
    ]
    lines.append("""
size_t cc_controller_size(void) { return sizeof(cc_controller); }

int cc_controller_set_parameters(
    cc_controller *controller, const double *given)
{
    double *memory = controller->number;
    int64_t wrong = 0;""")
    counts = [len(axis.fields) for axis in plan.axes]
    starts = list(itertools.accumulate(counts, initial=0))
    # All are looked at before those of one axis are taken.
    for axis, first, count, shape in zip(
        plan.axes, starts, counts, shapes, strict=False
    ):
        own = [
            _view("Reals", f"{name} + {first}", count)
            for name in ("given", "least", "most")
        ]
        gains = str(len(axis.law.gains))
        checked = called(law_steps.wrong_parameters, shape, *own, gains)
        lines.append(f"    wrong = {checked}")
        lines.append(
            f"    if (wrong != 0) {{\n        return (int)(wrong + {first});\n    }}"
        )
    for axis, first, count, shape, memory in zip(
        plan.axes, starts, counts, shapes, memories, strict=False
    ):
        own = [memory, shape, _view("Reals", f"given + {first}", count)]
        lines.append(f"    {called(axis.law.store_parameters, *own)}")
    restarts = "".join(
        f"    controller->number[{start + law_steps.FIRST_STEP}] = 1.0;\n"
        for start in plan.starts[:-1]
    )
    lines.append(f"""    return 0;
}}

void cc_controller_reset(cc_controller *controller)
{{
{restarts}}}

int cc_controller_init(cc_controller *controller, const double *given)
{{
    const int wrong = cc_controller_set_parameters(controller, given);
    if (wrong == 0) {{
        cc_controller_reset(controller);
    }}
    return wrong;
}}

int cc_controller_step(cc_controller *controller,
                       const cc_readings *readings, double *torques)
{{
    double *memory = controller->number;
    double seen[sizeof(cc_readings) / sizeof(double)];
    memcpy(seen, readings, sizeof seen);""")
    # An impossible reading of any axis is refused before a state changes.
    count, start = len(plan.seen), plan.starts[-1]
    given, guarded = _view("Reals", "seen", count), _view("Ints", "guarded", count)
    check = called(law_steps.impossible, given, str(count), guarded)
    lines.append(f"    int64_t wrong = {check}")
    if plan.torques.changes:
        own = [
            _view("Reals", f"memory + {start}", plan.memory_size - start),
            _view("Ints", "shape", len(plan.torques.shape)),
            _view("Reals", "tables", len(plan.torques.tables)),
            given,
        ]
        lines.append(f"""    if (wrong == 0) {{
        {called(own_readings, *own, depth=12)}
        memcpy(seen, memory + {start}, sizeof seen);
        /* It may be over an arm of 0. */
        wrong = {check}
    }}""")
    none = "".join(f"        torques[{k}] = 0.0;\n" for k in range(len(plan.axes)))
    lines.append(f"    if (wrong != 0) {{\n{none}        return (int)wrong;\n    }}")
    counts = [len(axis.seen) for axis in plan.axes]
    starts = list(itertools.accumulate(counts, initial=0))
    for k, (axis, first, count) in enumerate(
        zip(plan.axes, starts, counts, strict=False)
    ):
        numbers = _view("Reals", f"tables{k}", len(axis.tables.numbers))
        own = [
            memories[k],
            shapes[k],
            numbers,
            _view("Reals", f"seen + {first}", count),
        ]
        data = f"(LawData){{{', '.join(own)}}}"
        lines.append(f"    torques[{k}] = {called(axis.law.step, data)}")
    lines.append("    return 0;\n}")
    return (
        f'/* {what}. */\n#include "cc_controller.h"\n\n#include "cc_native.h"\n\n'
        f"{library.text()}\n" + "\n".join(lines) + "\n"
    )


def _view(kind: str, place: str, count: int) -> str:
    """Return an array of C's functions, of a constant or a part of a memory."""
    element = {"Reals": "double", "Ints": "int64_t"}[kind]
    place = place.removesuffix(" + 0")
    if " " in place:
        place = f"({place})"
    return f"({kind}){{({element} *){place}, {count}}}"


def _table(kind: str, name: str, numbers: Sequence[float]) -> str:
    """Return C text of a constant array, bit for bit; one zero if it is empty."""
    cells = [
        str(n) if kind == "int64_t" else literal(float(n)).text for n in numbers
    ] or ["0"]
    rows = [", ".join(cells[i : i + 8]) for i in range(0, len(cells), 8)]
    return f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(rows) + "\n};"


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a controller may be written to a folder."""
    names = (*ROS2_FILES, *EXPORT_FILES)
    try:
        text = Path(folder, HEADER_FILE).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):  # there is no earlier one
        text = ""
    atomic_io.require_ours(folder, lambda _: text.startswith(HEADER_MARK))
    atomic_io.require_unmodified(folder, names[:-1])


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
        folder: Folder to write to; an earlier export is replaced unless a user
            changed it.
        plan: The controller.
        what: Controller and scene in words, for the header.
        notes: Further lines of the header.
        ros2_control: Whether to write a package of ROS 2 around it.

    Raises:
        CableError: It cannot be written there.
    """
    require_ours(folder)
    texts = {
        HEADER_FILE: header(plan, what, notes),
        "cc_controller.c": controller_source(plan, what),
        "cc_native.h": (native_library.PACKAGE / "native/native.h").read_text(),
        "cc_parameters.c": parameters(plan),
        "cc_example.c": example(plan),
        "CMakeLists.txt": CMAKE_TEXT,
        "README.md": readme(plan, what, notes),
    }
    if ros2_control:
        texts |= ros2_texts(plan)
        texts["CMakeLists.txt"] += CMAKE_BLOCK
    with atomic_io.replacing_folder(folder) as partial:
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        atomic_io.write_manifest(partial, [path.name for path in partial.iterdir()])
