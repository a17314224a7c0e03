"""Files next to the controller in C: header, parameters, example, CMake file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from cc_mujoco.cable._layout import STATE_HEADER
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.export._controllers import AxisPlan, ExportPlan

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
    comments = "".join(f"/* {note}. */\n" for note in notes)
    readings = "\n".join(
        f"    double {name}; /* {meaning} */"
        for axis in plan.axes
        for name, meaning in zip(axis.seen, _meanings(axis), strict=True)
    )
    indices = "\n".join(
        f"    CC_{field.name.upper()}, /* "
        f"{_describe_parameter(field.meaning, field.unit)}, "
        f"{_span_text(field.low, field.high)} */"
        for field in plan.fields
    )
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
    static const int place[CC_AXES][2] = {{{_given_places(plan)}}};
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


def _given_places(plan: ExportPlan) -> str:
    """Return two places of every last torque in the memory, -1 where none is kept."""
    rows = (
        [start + place for place in axis.tables.given] + [-1, -1]
        for start, axis in zip(plan.starts, plan.axes, strict=False)
    )
    return ", ".join(f"{{{_number_lines(row[:2])}}}" for row in rows)


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
        _, _, state, new, _, _ = axis.tables.places
        width = (new - state) // len(axis.cables)
        places = range(start + state + STATE_HEADER, start + new, width)
        first += places[: len(axis.cables)]
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


def _describe_parameter(meaning: str, unit: str) -> str:
    return f"{meaning} [{'-' if unit == '1' else unit}]".replace("*/", "* /")


def _span_text(low: float, high: float) -> str:
    least = "above 0" if 0.0 < low < 1e-300 else f"{low:g}"
    return f"{least} to {high:g}"


def parameters(plan: ExportPlan) -> str:
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
