"""Translation of the compiled functions of `cc_mujoco.cable` to Warp.

    library = translate([kernel.step, pack.initialize], Known())
    print(library.source)

The physics is written once, for C. Arithmetic keeps its order, so that in float64 both
give the same bits unless a step calls exp, log or pow.
"""

import ast
import math
import types
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native._fold import Known, is_number
from cc_mujoco.native._front import ReadFunction, Writer, name_of, read
from cc_mujoco.native._kinds import python_function

_BUILTINS: dict[Any, str] = {
    abs: "wp.abs", min: "wp.min", max: "wp.max", float: "Real", int: "wp.int32",
    range: "range", np.isfinite: "wp.isfinite", np.sign: "sign_of",
    math.exp: "wp.exp", math.log: "wp.log", math.sqrt: "wp.sqrt", math.cos: "wp.cos",
    math.sin: "wp.sin", math.isfinite: "wp.isfinite", math.expm1: "expm1",
    math.log1p: "log1p", math.atan2: "wp.atan2",
}  # fmt: skip
_TYPES: dict[Any, str] = {
    NDArray[np.float64]: "wp.array(dtype=Real)", float: "Real", int: "wp.int32",
    bool: "wp.bool",
}  # fmt: skip


@dataclass(frozen=True)
class WarpSource:
    """Functions translated to Warp.

    Attributes:
        source: Python source, which needs `wp`, `Real` and `warp/prelude.txt`.
        names: name in the source of each function, by module, dot and name.
    """

    source: str
    names: dict[str, str]


def translate(functions: Iterable[Any], known: Known) -> WarpSource:
    library = _Library(known)
    for function in functions:
        library.require(function)
    return library.text()


def _is_record(found: Any) -> bool:
    return isinstance(found, type) and hasattr(found, "_fields")


class _Library:
    def __init__(self, known: Known) -> None:
        self._known = known
        self._sources: dict[types.FunctionType, ReadFunction] = {}
        self._text: dict[str, str] = {}
        self._records: dict[str, Any] = {}
        self._literals: dict[str, str] = {}
        self._names: dict[str, str] = {}

    def text(self) -> WarpSource:
        literals = [
            f"{name} = wp.constant(Real({value}))"
            for value, name in self._literals.items()
        ]
        records = [
            f"@wp.struct\nclass {name}:\n"
            + "".join(
                f"    {field}: {_TYPES[hint]}\n"
                for field, hint in get_type_hints(record).items()
            )
            for name, record in self._records.items()
        ]
        parts = ["\n".join(literals), *records, *self._text.values()]
        return WarpSource("\n\n".join(parts), self._names)

    def require(self, found: Any) -> str:
        """Return the name of a function in Warp; translate it if it is new."""
        function = python_function(found)
        assert function is not None
        name = name_of(function)
        if name not in self._text:
            self._text[name] = _WarpWriter(self, self._read(function)).text(name)
            module = function.__module__.rpartition(".")[2]
            self._names[f"{module}.{function.__name__}"] = name
        return name

    def record(self, found: Any) -> str:
        name = name_of(found)
        self._records[name] = found
        return name

    def literal(self, value: float) -> str:
        text = repr(float(value)) if math.isfinite(value) else "float('inf')"
        text = text if value != -math.inf else "-float('inf')"
        return self._literals.setdefault(text, f"C{len(self._literals)}")

    def _read(self, function: types.FunctionType) -> ReadFunction:
        if function not in self._sources:
            source = read(function, self._known, self._constant_result)
            self._sources[function] = source
        return self._sources[function]

    def _constant_result(self, found: Any) -> ast.Constant | None:
        function = python_function(found)
        if function is None:
            return None
        body = self._read(function).node.body
        only = body[0] if len(body) == 1 else None
        if isinstance(only, ast.Return) and isinstance(only.value, ast.Constant):
            return only.value
        return None


class _WarpWriter(Writer):
    def __init__(self, library: _Library, source: ReadFunction) -> None:
        super().__init__(source)
        self._library = library

    def text(self, name: str) -> str:
        arguments = ", ".join(
            f"{a.arg}: {self._annotation(a)}" for a in self.source.node.args.args
        )
        self.block(self.source.node.body)
        return f"@wp.func\ndef {name}({arguments}):\n" + "\n".join(self.lines)

    def _annotation(self, argument: ast.arg) -> str:
        assert argument.annotation is not None
        found = self.scope.lookup(argument.annotation)
        if found in _TYPES:
            return _TYPES[found]
        if _is_record(found):
            return self._library.record(found)
        written = ast.unparse(argument.annotation)
        raise self.source.refusal(argument, f"an argument of the type `{written}`")

    def block(self, body: list[ast.stmt]) -> None:
        super().block(body or [ast.Pass()])

    def visit_If(self, node: ast.If) -> None:
        self.emit(f"if {self.visit(node.test)}:")
        self.block(node.body)
        if node.orelse:
            self.emit("else:")
            self.block(node.orelse)

    def visit_For(self, node: ast.For) -> None:
        self.emit(f"for {ast.unparse(node.target)} in {self.visit(node.iter)}:")
        self.block(node.body)

    def visit_While(self, node: ast.While) -> None:
        self.emit(f"while {self.visit(node.test)}:")
        self.block(node.body)

    def visit_Return(self, node: ast.Return) -> None:
        value = node.value
        if value is None:
            self.emit("return")
        elif isinstance(value, ast.Tuple):
            self.emit(f"return {', '.join(map(self.visit, value.elts))}")
        else:
            self.emit(f"return {self._initial(value)}")

    def visit_Expr(self, node: ast.Expr) -> None:
        self.emit(self.visit(node.value))

    def visit_Pass(self, node: ast.stmt) -> None:
        self.emit(ast.unparse(node))

    visit_Break = visit_Continue = visit_Pass

    def visit_Assign(self, node: ast.Assign) -> None:
        target, value = node.targets[0], node.value
        if isinstance(target, ast.Tuple):
            names = ", ".join(ast.unparse(part) for part in target.elts)
            self.emit(f"{names} = {self.visit(value)}")
            return
        text = self._initial(value)
        if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            if target.slice.lower or target.slice.upper:
                raise self.refuse(target, "a part of an array that is assigned")
            self.emit(f"fill({self.visit(target.value)}, {text})")
        else:
            self.emit(f"{self.visit(target)} = {text}")

    def _initial(self, node: ast.expr) -> str:
        """Return an assigned value, typed so that Warp lets its name change."""
        text = str(self.visit(node))
        if isinstance(node, ast.Constant):
            kind = {bool: "wp.bool", int: "wp.int32"}.get(type(node.value), "variable")
            return f"{kind}({text})"
        return text

    def visit_Constant(self, node: ast.Constant) -> str:
        if isinstance(node.value, float):
            return self._library.literal(node.value)
        return repr(node.value)

    def visit_Name(self, node: ast.Name) -> str:
        return node.id

    def visit_Attribute(self, node: ast.Attribute) -> str:
        found = self.scope.lookup(node)
        if is_number(found):
            return self.visit_Constant(ast.Constant(found))
        return f"{self.visit(node.value)}.{node.attr}"

    def visit_UnaryOp(self, node: ast.UnaryOp) -> str:
        sign = {ast.Not: "not ", ast.USub: "-"}[type(node.op)]
        return f"({sign}{self.visit(node.operand)})"

    def visit_BoolOp(self, node: ast.BoolOp) -> str:
        word = " and " if isinstance(node.op, ast.And) else " or "
        return f"({word.join(map(self.visit, node.values))})"

    def visit_IfExp(self, node: ast.IfExp) -> str:
        body, other = self.visit(node.body), self.visit(node.orelse)
        return f"({body} if {self.visit(node.test)} else {other})"

    def visit_Compare(self, node: ast.Compare) -> str:
        sides = [node.left, *node.comparators]
        parts = [
            f"{self.visit(a)} {_sign(op)} {self.visit(b)}"
            for op, a, b in zip(node.ops, sides, sides[1:], strict=False)
        ]
        return f"({' and '.join(parts)})"

    def visit_BinOp(self, node: ast.BinOp) -> str:
        left, right = self.visit(node.left), node.right
        if not isinstance(node.op, ast.Pow):
            sign = _sign(node.op)
            return f"({left} {sign} {self.visit(right)})"
        if isinstance(right, ast.Constant) and right.value == 2:
            return f"square({left})"
        return f"wp.pow({left}, {self.visit(right)})"

    def visit_Subscript(self, node: ast.Subscript) -> str:
        owner = self.visit(node.value)
        if not isinstance(node.slice, ast.Slice):
            return f"{owner}[{self.visit(node.slice)}]"
        if node.slice.step is not None:
            raise self.source.refusal(node, f"the step of `{ast.unparse(node)}`")
        lower, upper = node.slice.lower, node.slice.upper
        start = self.visit(lower) if lower else "0"
        stop = self.visit(upper) if upper else f"{owner}.shape[0]"
        return f"cut({owner}, {start}, {stop})"

    def visit_Call(self, node: ast.Call) -> str:
        found = self.scope.lookup(node.func)
        given = [self.visit(each) for each in node.args]
        if found in (min, max):
            whole = str(given[0])
            for further in given[1:]:
                whole = f"{_BUILTINS[found]}({whole}, {further})"
            return whole
        if isinstance(found, types.FunctionType) or python_function(found):
            name = self._library.require(found)
        elif _is_record(found):
            name = self._library.record(found)
        elif found in _BUILTINS:
            name = _BUILTINS[found]
        else:
            what = f"a call of `{ast.unparse(node.func)}`"
            raise self.source.refusal(node, what)
        return f"{name}({', '.join(given)})"


def _sign(op: ast.operator | ast.cmpop) -> str:
    a, node = ast.Name("a"), ast.expr()
    if isinstance(op, ast.cmpop):
        node = ast.Compare(a, [op], [a])
    else:
        node = ast.BinOp(a, op, a)
    return ast.unparse(node)[2:-2]
