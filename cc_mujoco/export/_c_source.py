"""Source files next to the object file: C header, parameters, example, CMake file."""

from __future__ import annotations

import math
import re
import struct
import textwrap
from collections.abc import Iterable

from cc_mujoco.cable._layout import STATE_HEADER
from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export._controllers import ExportPlan

HEADER_MARK = "/* Written by cc-mujoco export: "
"""First words of the header."""

_READING_MEANINGS = {
    "motor_angle_rad": "angle of the motor; of a round pulley only its changes matter",
    "joint_angle_rad": "angle of the joint, from its encoder; likewise",
    "motor_velocity_rad_s": "its velocity",
    "joint_velocity_rad_s": "velocity of the joint, from its encoder",
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


def renamed(text: str, axis: str) -> str:
    """Return C, or the name of a file, with the name of an axis in all its names.

    So the controllers of several axes can be linked into one program: of axis `hip`,
    `cc_controller_step` is `cc_hip_controller_step`, and `CC_LOW` is `CC_HIP_LOW`.

    Args:
        text: With names that begin with `cc_` or `CC_`.
        axis: Name of the axis; with an empty one nothing changes.
    """
    if not axis:
        return text
    name = re.sub(r"\W", "_", axis, flags=re.ASCII)
    parts = {"cc": name, "CC": name.upper()}
    return re.sub(
        r"\b(cc|CC)_(?!mujoco)", lambda found: f"{found[0]}{parts[found[1]]}_", text
    )


def header(plan: ExportPlan, what: str) -> str:
    """Return the C header.

    Args:
        plan: What is exported.
        what: Of which controller, for what scene and machine.
    """
    meanings = _READING_MEANINGS
    if plan.policy is not None:
        meanings = meanings | _POLICY_MEANINGS
    described = [(name, meanings[name]) for name in plan.law.seen]
    described += [
        (name, f"tension of {cable} at node {node}, from its sensor [N]")
        for name, cable, node in plan.tension_readings
    ]
    readings = "\n".join(f"    double {name}; /* {what} */" for name, what in described)
    indices = "\n".join(
        f"    CC_{field.name.upper()}, /* "
        f"{_describe_parameter(field.meaning, field.unit)}, "
        f"{_span_text(field.low, field.high)} */"
        for field in plan.fields
    )
    return f"""{HEADER_MARK}{what}. */
#ifndef CC_CONTROLLER_H
#define CC_CONTROLLER_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define CC_CONTROLLER_DOUBLES {plan.places[-1]}
#define CC_CONTROLLER_PARAMETERS {len(plan.fields)}

/* All that a controller keeps. It is yours: static, on the stack or on the heap, with
 * the alignment of a double. Nothing is allocated, locked, printed or thrown; there is
 * no global state, so that threads may step controllers of their own. It holds no
 * pointers and may be copied. */
typedef struct {{
    double number[CC_CONTROLLER_DOUBLES];
}} cc_controller;

/* What is measured once a period (CC_PERIOD), in SI units and with the signs of the
 * scene. A controller with a model has round pulleys: of a cable on a lever or over
 * several joints tell it angle and velocity at which a pulley of the arm in the neutral
 * pose would wind it, and both torques over the ratio of the arm to that one. */
typedef struct {{
{readings}
}} cc_readings;

/* Places of the parameters: meaning [unit], range. */
enum {{
{indices}
}};

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

/* Motor torque [N m] until the next reading, within CC_LOW and CC_HIGH. It is not a
 * number where a reading that the controller uses is none, infinite or beyond
 * {entry_points.MAX_READING:g} of its unit; then the state stays as it was,
 * and what the motor does is yours to decide. */
double cc_controller_step(cc_controller *controller, const cc_readings *readings);
{_given_function(plan)}{_observer_functions(plan)}
#ifdef __cplusplus
}}
#endif
#endif
"""


def _given_function(plan: ExportPlan) -> str:
    if not plan.plans:
        return ""
    return f"""
/* Tell, after a step, what the motor got instead of the torque that was asked for,
 * where a limit of yours (of rate, a soft start) allowed no more. What is
 * infinite or no number is not heard. */
static inline void cc_controller_given(cc_controller *controller, double torque)
{{
    if (torque - torque == 0.0)
        controller->number[{plan.given}] = torque;
}}
"""


def _observer_functions(plan: ExportPlan) -> str:
    if not plan.cables:
        return ""
    _, _, state, new, _, _ = plan.places
    width = (new - state) // len(plan.cables)
    names = ", ".join(
        f"CC_CABLE_{cable.upper()} = {k}" for k, cable in enumerate(plan.cables)
    )
    first = [state + k * width + STATE_HEADER for k in range(len(plan.cables))]
    return f"""
/* What the observer finds after a step. */
enum {{ {names}, CC_CABLES = {len(plan.cables)} }};

/* Nodes of a cable, from the motor to the joint. */
static inline int cc_controller_nodes(int cable)
{{
    static const int nodes[CC_CABLES] = {{{
        _number_lines(n + 1 for n in plan.segments)
    }}};
    return nodes[cable];
}}

/* Their tensions [N]; a negative one is slack: the cable carries nothing there. */
static inline const double *cc_controller_tensions(const cc_controller *controller,
                                                   int cable)
{{
    static const int first[CC_CABLES] = {{{_number_lines(first)}}};
    return controller->number + first[cable];
}}

/* Angle of the joint since the first step [rad]. */
static inline double cc_controller_joint_angle(const cc_controller *controller)
{{
    return controller->number[{entry_points.JOINT_ANGLE}];
}}
"""


def _number_lines(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def _describe_parameter(meaning: str, unit: str) -> str:
    return f"{meaning} [{'-' if unit == '1' else unit}]".replace("*/", "* /")


def _span_text(low: float, high: float) -> str:
    least = "above 0" if 0.0 < low < 1e-300 else f"{low:g}"
    return f"{least} to {high:g}"


def parameters(plan: ExportPlan) -> str:
    """Return the parameters as a C array."""
    rows = "\n".join(
        f"    [CC_{field.name.upper()}] = {_c_literal(field.value)}, "
        f"/* {'-' if field.unit == '1' else field.unit} */"
        for field in plan.fields
    )
    return f"""#include <math.h>

#include "cc_controller.h"

const double cc_controller_parameters[CC_CONTROLLER_PARAMETERS] = {{
{rows}
}};
"""


def _c_literal(value: float) -> str:
    """Return a literal that C reads as the same bits."""
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value))


def example(plan: ExportPlan) -> str:
    """Return a program that reads measurements and writes torques."""
    seen = plan.seen
    names = ",".join(seen)
    numbers = ",".join("%lf" for _ in seen)
    arguments = ", ".join(f"&r.{name}" for name in seen)
    return f"""/* Torques of recorded readings: cc_example < readings.csv
 *
 * One line per period: {names}
 * In a real-time loop the call of cc_controller_step stands between reading the sensors
 * and setting the current of the motor; nothing else of this file does. */
#include <stdio.h>
#include <string.h>

#include "cc_controller.h"

static cc_controller controller;

int main(void)
{{
    char line[{max(512, 40 * len(seen))}];
    int end = 0;
    cc_readings r;
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
    puts("motor_torque_nm");
    for (long row = 2; fgets(line, sizeof line, stdin); row++) {{
        int count = sscanf(line, "{numbers} %n", {arguments}, &end);
        if (count != {len(seen)} || line[end]) {{
            fprintf(stderr, "line %ld has not just {len(seen)} numbers\\n", row);
            return 2;
        }}
        printf("%.17g\\n", cc_controller_step(&controller, &r));
    }}
    return 0;
}}
"""


CMAKE_TEXT = """cmake_minimum_required(VERSION 3.13)
project(cc_controller C)

add_library(cc_controller STATIC cc_parameters.c cc_controller.o)
set_source_files_properties(cc_controller.o PROPERTIES EXTERNAL_OBJECT TRUE)
target_include_directories(cc_controller PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
set_target_properties(cc_controller PROPERTIES C_STANDARD 99
                      POSITION_INDEPENDENT_CODE ON)
if(NOT WIN32)
  target_link_libraries(cc_controller PUBLIC m)
endif()

add_executable(cc_example cc_example.c)
set_target_properties(cc_example PROPERTIES C_STANDARD 99)
target_link_libraries(cc_example PRIVATE cc_controller)
"""


def interface(plan: ExportPlan, bits: int, set_parameters: str, step: str) -> str:
    """Return the LLVM assembly of the functions of the header.

    Args:
        plan: What is exported.
        bits: Of a pointer of the machine.
        set_parameters: Name of the compiled function of `entries` that takes them.
        step: Of the one that takes a step.
    """
    shape = ", ".join(f"i64 {count}" for count in plan.shape)
    count = len(plan.fields)
    least = _constants(field.low for field in plan.fields)
    most = _constants(field.high for field in plan.fields)
    tables = _constants(plan.tables)
    size = 8 * plan.places[-1]
    return textwrap.dedent(f"""
        @shape = private constant [{len(plan.shape)} x i64] [{shape}]
        @least = private constant [{count} x double] [{least}]
        @most = private constant [{count} x double] [{most}]
        @tables = private constant [{len(plan.tables)} x double] [{tables}]
        declare i64 @"{set_parameters}"(ptr, ptr, ptr, ptr, ptr)
        declare double @"{step}"(ptr, ptr, ptr, ptr)

        define i{bits} @cc_controller_size() {{
          ret i{bits} {size}
        }}
        define i32 @cc_controller_set_parameters(ptr %0, ptr %1) {{
          %3 = call i64 @"{set_parameters}"(
            ptr %0, ptr @shape, ptr %1, ptr @least, ptr @most)
          %4 = trunc i64 %3 to i32
          ret i32 %4
        }}
        define i32 @cc_controller_init(ptr %0, ptr %1) {{
          %3 = call i32 @cc_controller_set_parameters(ptr %0, ptr %1)
          %4 = icmp eq i32 %3, 0
          br i1 %4, label %begin, label %end
        begin:
          call void @cc_controller_reset(ptr %0)
          br label %end
        end:
          ret i32 %3
        }}
        define void @cc_controller_reset(ptr %0) {{
          %2 = getelementptr double, ptr %0, i64 {entry_points.FIRST_STEP}
          store double 1.0, ptr %2
          ret void
        }}
        define double @cc_controller_step(ptr %0, ptr %1) {{
          %3 = call double @"{step}"(
            ptr %0, ptr @shape, ptr @tables, ptr %1)
          ret double %3
        }}
        """)


def _constants(numbers: Iterable[float]) -> str:
    bits = [struct.unpack("<Q", struct.pack("<d", number))[0] for number in numbers]
    return ", ".join(f"double 0x{number:016X}" for number in bits)
