"""Functions that C calls, as LLVM assembly around the compiled functions of each axis.

The compiled functions have their names in Python; `_entry_points` says what they take.
Memory, parameters and readings of the axes lie one behind the other, and those that
`_joint_torques` needs are behind the memory of the last.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence

from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._joint_torques import own_readings

_NAN = "0x7FF8000000000000"


def interface(plan: ExportPlan, bits: int) -> str:
    """Return the LLVM assembly of the functions of the header.

    Args:
        plan: What is exported.
        bits: Of a pointer of the machine.
    """
    lines = [
        *_constants(plan),
        *sorted(_declarations(plan)),
        f"define i{bits} @cc_controller_size() {{",
        f"  ret i{bits} {8 * plan.memory_size}",
        "}",
        *_set_parameters(plan),
        "define i32 @cc_controller_init(ptr %memory, ptr %given) {",
        "  %wrong = call i32 @cc_controller_set_parameters(ptr %memory, ptr %given)",
        "  %fine = icmp eq i32 %wrong, 0",
        "  br i1 %fine, label %begin, label %end",
        "begin:",
        "  call void @cc_controller_reset(ptr %memory)",
        "  br label %end",
        "end:",
        "  ret i32 %wrong",
        "}",
        *_reset(plan),
        *_step(plan),
    ]
    return "\n".join(lines)


def _constants(plan: ExportPlan) -> Iterator[str]:
    yield _numbers("least", [field.low for field in plan.fields])
    yield _numbers("most", [field.high for field in plan.fields])
    yield _whole_numbers("shape", plan.torques.shape)
    yield _whole_numbers("guarded", plan.guarded)
    yield _numbers("tables", plan.torques.tables)
    for k, axis in enumerate(plan.axes):
        yield _whole_numbers(f"shape{k}", axis.shape)
        yield _numbers(f"tables{k}", axis.tables)


def _declarations(plan: ExportPlan) -> set[str]:
    found = {f"declare i64 @{entry_points.are_possible.__name__}(ptr, i64, ptr)"}
    if plan.torques.changes:
        found.add(f"declare void @{own_readings.__name__}(ptr, ptr, ptr, ptr)")
    for axis in plan.axes:
        law = axis.law
        found |= {
            f"declare i64 @{law.wrong_parameters.__name__}(ptr, ptr, ptr, ptr)",
            f"declare void @{law.store_parameters.__name__}(ptr, ptr, ptr)",
            f"declare double @{law.step.__name__}(ptr, ptr, ptr, ptr)",
        }
    return found


def _set_parameters(plan: ExportPlan) -> Iterator[str]:
    """Refuse what is wrong in any axis before parameters of one are taken."""
    yield "define i32 @cc_controller_set_parameters(ptr %memory, ptr %given) {"
    for k, first in enumerate(_starts([len(axis.fields) for axis in plan.axes])):
        yield _place(f"given{k}", "%given", first)
        yield _place(f"least{k}", "@least", first)
        yield _place(f"most{k}", "@most", first)
        function = plan.axes[k].law.wrong_parameters.__name__
        arguments = f"ptr @shape{k}, ptr %given{k}, ptr %least{k}, ptr %most{k}"
        yield f"  %wrong{k} = call i64 @{function}({arguments})"
        yield f"  %fine{k} = icmp eq i64 %wrong{k}, 0"
        yield f"  br i1 %fine{k}, label %next{k}, label %refuse{k}"
        yield f"refuse{k}:"
        yield f"  %place{k} = add i64 %wrong{k}, {first}"
        yield f"  %narrow{k} = trunc i64 %place{k} to i32"
        yield f"  ret i32 %narrow{k}"
        yield f"next{k}:"
    for k, axis in enumerate(plan.axes):
        yield _place(f"memory{k}", "%memory", plan.starts[k])
        function = axis.law.store_parameters.__name__
        arguments = f"ptr %memory{k}, ptr @shape{k}, ptr %given{k}"
        yield f"  call void @{function}({arguments})"
    yield "  ret i32 0"
    yield "}"


def _reset(plan: ExportPlan) -> Iterator[str]:
    yield "define void @cc_controller_reset(ptr %memory) {"
    for k in range(len(plan.axes)):
        yield _place(f"first{k}", "%memory", plan.starts[k] + entry_points.FIRST_STEP)
        yield f"  store double 1.0, ptr %first{k}"
    yield "  ret void"
    yield "}"


def _step(plan: ExportPlan) -> Iterator[str]:
    """Refuse an impossible reading of any axis before a state changes."""
    yield "define void @cc_controller_step(ptr %memory, ptr %readings, ptr %torques) {"
    for k in range(len(plan.axes)):
        yield _place(f"out{k}", "%torques", k)
    yield from _require_possible("readings", len(plan.seen))
    yield "refuse:"
    for k in range(len(plan.axes)):
        yield f"  store double {_NAN}, ptr %out{k}"
    yield "  ret void"
    yield "readings_are_possible:"
    readings = "%readings"
    if plan.torques.changes:
        readings = "%own"
        yield _place("own", "%memory", plan.starts[-1])
        arguments = "ptr %own, ptr @shape, ptr @tables, ptr %readings"
        yield f"  call void @{own_readings.__name__}({arguments})"
        yield from _require_possible("own", len(plan.seen))  # over an arm of 0
        yield "own_are_possible:"
    for k, first in enumerate(_starts([len(axis.seen) for axis in plan.axes])):
        yield _place(f"memory{k}", "%memory", plan.starts[k])
        yield _place(f"read{k}", readings, first)
        function = plan.axes[k].law.step.__name__
        arguments = f"ptr %memory{k}, ptr @shape{k}, ptr @tables{k}, ptr %read{k}"
        yield f"  %torque{k} = call double @{function}({arguments})"
        yield f"  store double %torque{k}, ptr %out{k}"
    yield "  ret void"
    yield "}"


def _require_possible(name: str, count: int) -> Iterator[str]:
    """Branch to `NAME_are_possible`, or to `refuse` for an impossible reading."""
    function = entry_points.are_possible.__name__
    arguments = f"ptr %{name}, i64 {count}, ptr @guarded"
    yield f"  %{name}_possible = call i64 @{function}({arguments})"
    yield f"  %{name}_fine = icmp ne i64 %{name}_possible, 0"
    yield f"  br i1 %{name}_fine, label %{name}_are_possible, label %refuse"


def _starts(sizes: Sequence[int]) -> list[int]:
    """Return where each of several parts begins."""
    return list(itertools.accumulate(sizes, initial=0))[:-1]


def _place(name: str, pointer: str, place: int) -> str:
    """Return the assembly of a pointer to a number behind another pointer."""
    return f"  %{name} = getelementptr double, ptr {pointer}, i64 {place}"


def _whole_numbers(name: str, numbers: Sequence[int]) -> str:
    """Return the assembly of a constant array of integers."""
    values = ", ".join(f"i64 {number}" for number in numbers)
    return f"@{name} = private constant [{len(numbers)} x i64] [{values}]"


def _numbers(name: str, numbers: Sequence[float]) -> str:
    """Return the assembly of a constant array of real numbers, bit for bit."""
    bits = [struct.unpack("<Q", struct.pack("<d", number))[0] for number in numbers]
    values = ", ".join(f"double 0x{number:016X}" for number in bits)
    return f"@{name} = private constant [{len(numbers)} x double] [{values}]"
