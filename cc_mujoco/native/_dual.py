"""Derivatives by forward mode: the same functions in C over dual numbers.

    (play,) = entries(_play)
    play(prm, ...)    # arrays of float64 with a last axis of value and derivative

A number in C is then a value and its derivative by one parameter (`dual.h`). Values
alone decide where control goes, so they have the bits of the plain code.
"""

import ast
import platform
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import ATOM, UNARY, CLibrary, FunctionWriter, Value, literal
from cc_mujoco.native._c99 import Function as CFunction
from cc_mujoco.native._entries import program_text
from cc_mujoco.native._kinds import REAL, Kind, Scalar, python_function


def slope(x: float) -> float:
    """Return the derivative of a dual number, as a plain number."""
    return 0.0


def with_slope(x: float, derivative: float) -> float:
    """Return a dual number with the value of `x` and this derivative."""
    return x


class DualLibrary(CLibrary):
    """Set of functions translated to C over dual numbers."""

    is_dual = True

    def write(self, function: types.FunctionType, as_: CFunction) -> None:
        _DualWriter(self, function, as_).write()

    def type(self, kind: Kind) -> str:
        return "CcReal" if kind == REAL else super().type(kind)

    def zero(self, kind: Kind) -> str:
        return "{0}" if kind == REAL else super().zero(kind)

    def cell(self, found: Any) -> str:
        text = super().cell(found)
        return f"{{{text}, 0.0}}" if literal(found).kind == REAL else text


class _DualWriter(FunctionWriter):
    def plain(self, value: Value) -> Value:
        if value.kind != REAL:
            return value
        return Value(f"{value.at(ATOM)}.v", REAL, number=value.number)

    def as_kind(self, value: Value, kind: Kind, node: ast.AST) -> Value:
        if value.kind == kind or not isinstance(value.kind, Scalar):
            return super().as_kind(value, kind, node)
        if kind != REAL:
            return super().as_kind(self.plain(value), kind, node)
        text = f"(double){value.at(UNARY)}"
        return Value(f"dual({text})", REAL, number=value.number)

    def _constant(self, found: Any, node: ast.expr) -> Value:
        value = super()._constant(found, node)
        if value.kind != REAL:
            return value
        return Value(f"dual({value.text})", REAL, number=value.number)

    def negative(self, value: Value) -> Value:
        if value.kind != REAL:
            return super().negative(value)
        return Value(f"dual_neg({value.text})", REAL)

    def operation(
        self, op: type[ast.operator], kind: Kind, left: Value, right: Value
    ) -> Value:
        if kind != REAL:
            return super().operation(op, kind, left, right)
        name = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}[op]
        return Value(f"dual_{name}({left.text}, {right.text})", REAL)


@cache
def entries(*functions: Callable[..., None]) -> list[Callable[..., None]]:
    """Return functions as Python calls them with dual numbers, compiled once.

    Their arrays of floats have one more axis, the last, of value and derivative; their
    other numbers have derivative 0. The library is named after the first.
    """
    name = f"lib{functions[0].__module__.replace('.', '_')}"
    name = f"{name}-{native_library.digest()[:20]}-{platform.machine().lower()}"
    path = native_library.keep(name, lambda place: build(place, functions))
    found = native_library.methods(native_library.load(path))
    return [found[function.__name__] for function in functions]


def build(place: Path, functions: tuple[Callable[..., None], ...]) -> Path:
    known = {
        slope: ("dual_slope", (REAL,), REAL),
        with_slope: ("dual_with_slope", (REAL, REAL), REAL),
    }
    library = DualLibrary(known, native_library.PACKAGE.parent)
    plain = (cast("types.FunctionType", python_function(each)) for each in functions)
    called = {each.__name__: library.require(each) for each in plain}
    source = place / "cc_mujoco_dual.c"
    source.write_text(f"#define CC_DUAL\n{program_text(library, called, 'dual.h')}")
    return native_library.compile_library(place / native_library.CARRIED.name, source)
