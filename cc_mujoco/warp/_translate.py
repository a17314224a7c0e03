"""Warp functions out of the compiled functions of `cc_mujoco.cable`.

    library = translate([kernel.step, pack.initialize], Known())
    print(library.source)

The physics is written once, for C. Every function that the given ones call is
translated by its syntax tree, in the common subset that `cable/README.md` defines; what
leaves the subset is refused with its place. Arithmetic keeps its order, so that in
float64 both give the same bits unless a step calls exp, log or pow.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
import types
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native._fold import Known, Scope, fold, is_number

_BUILTINS: dict[Any, str] = {
    abs: "wp.abs", min: "wp.min", max: "wp.max", float: "Real", int: "wp.int32",
    range: "range", np.isfinite: "wp.isfinite", np.sign: "sign_of",
    math.exp: "wp.exp", math.log: "wp.log", math.sqrt: "wp.sqrt", math.cos: "wp.cos",
    math.sin: "wp.sin", math.isfinite: "wp.isfinite", math.expm1: "expm1",
    math.log1p: "log1p", math.atan2: "wp.atan2",
}  # fmt: skip
_ANNOTATIONS = {
    "FloatArray": "wp.array(dtype=Real)", "float": "Real", "int": "wp.int32",
    "bool": "wp.bool",
}  # fmt: skip
_STATEMENTS = (
    ast.Assign, ast.AugAssign, ast.AnnAssign, ast.If, ast.For, ast.While, ast.Return,
    ast.Break, ast.Continue, ast.Expr, ast.Pass,
)  # fmt: skip
_EXPRESSIONS = (
    ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call, ast.Constant,
    ast.Name, ast.Attribute, ast.Subscript, ast.Slice, ast.Tuple,
)  # fmt: skip
_CONTAINERS = (ast.FunctionDef, ast.arguments, ast.arg)


@dataclass(frozen=True)
class WarpSource:
    """Source of Warp functions.

    Attributes:
        source: Python source; it expects `wp`, `Real`, and the functions of
            `_runtime.py` in its namespace.
        names: name in it of each translated function, by module and name.
    """

    source: str
    names: dict[str, str]


def translate(functions: Iterable[Any], known: Known) -> WarpSource:
    """Translate compiled functions and all that they call.

    Args:
        functions: compiled functions.
        known: values that are the same in every call, to be folded.

    Raises:
        CableError: a function leaves the common subset, with file and line.
    """
    translator = _Translator(known)
    for function in functions:
        translator.require(function)
    return translator.library()


def python_function(found: Any) -> types.FunctionType | None:
    """Return the Python function of a compiled one; None of anything else."""
    function = getattr(found, "py_func", None)
    if function is not None:
        function = getattr(found, "__wrapped__", function)  # of `exported`
    return function if isinstance(function, types.FunctionType) else None


def _is_record(found: Any) -> bool:
    """Return whether an object is a class of named tuples."""
    return isinstance(found, type) and hasattr(found, "_fields")


def _name_of(function: Any) -> str:
    module = function.__module__.rpartition(".")[2].lstrip("_")
    return f"{module}_{function.__name__.lstrip('_')}"


class _Translator:
    """Translation of functions, each once."""

    def __init__(self, known: Known) -> None:
        self._known = known
        self._folded: dict[types.FunctionType, tuple[ast.FunctionDef, Scope]] = {}
        self._text: dict[str, str] = {}
        self._records: dict[str, Any] = {}
        self._literals: dict[str, str] = {}
        self.names: dict[str, str] = {}

    def library(self) -> WarpSource:
        """Return what has been translated so far."""
        literals = [
            f"{name} = wp.constant(Real({value}))"
            for value, name in self._literals.items()
        ]
        records = [
            f"@wp.struct\nclass {name}:\n"
            + "".join(f"    {field}: Real\n" for field in record._fields)
            for name, record in self._records.items()
        ]
        return WarpSource(
            "\n\n".join(["\n".join(literals), *records, *self._text.values()]),
            self.names,
        )

    def require(self, found: Any) -> str:
        """Translate a function unless that is done; return its name."""
        function = python_function(found)
        assert function is not None
        name = _name_of(function)
        if name not in self._text:
            node, scope = self._fold(function)
            text = _Writer(self, function, node, scope).text(name)
            self._text[name] = text
            module = function.__module__.rpartition(".")[2]
            self.names[f"{module}.{function.__name__}"] = name
        return name

    def record(self, found: Any) -> str:
        """Return the name of the structure for a named tuple."""
        name = f"{_name_of(found)}"
        self._records[name] = found
        return name

    def literal(self, value: float) -> str:
        """Return the name of the constant for a float."""
        text = repr(float(value)) if math.isfinite(value) else "float('inf')"
        text = text if value != -math.inf else "-float('inf')"
        return self._literals.setdefault(text, f"C{len(self._literals)}")

    def _fold(self, function: types.FunctionType) -> tuple[ast.FunctionDef, Scope]:
        if function not in self._folded:
            source = textwrap.dedent(inspect.getsource(function))
            node = ast.parse(source).body[0]
            assert isinstance(node, ast.FunctionDef)
            require_subset(function, node)
            scope = Scope(function, node)
            node.body = [s for s in node.body if not _is_docstring(s)]
            fold(node, scope, self._known, self._constant_result)
            self._folded[function] = node, scope
        return self._folded[function]

    def _constant_result(self, found: Any) -> ast.Constant | None:
        """Return what a compiled function always returns, else None."""
        function = python_function(found)
        if function is None:
            return None
        body = self._fold(function)[0].body
        only = body[0] if len(body) == 1 else None
        if isinstance(only, ast.Return) and isinstance(only.value, ast.Constant):
            return only.value
        return None


def require_subset(function: types.FunctionType, node: ast.FunctionDef) -> None:
    """Refuse syntax that the common subset has not.

    Raises:
        CableError: with file and line.
    """
    for found in ast.walk(ast.Module(node.body, [])):
        if isinstance(found, ast.stmt):
            fits = isinstance(found, _STATEMENTS)
        elif isinstance(found, ast.expr):
            fits = isinstance(found, _EXPRESSIONS)
        else:
            continue
        if not fits:
            raise refusal(function, found, f"`{ast.unparse(found)}`")


def refusal(function: types.FunctionType, node: Any, what: str) -> CableError:
    """Return the error for a place outside the common subset."""
    code = function.__code__
    line = code.co_firstlineno + getattr(node, "lineno", 1) - 1
    return CableError(
        f"{code.co_filename}:{line}: {what} in {function.__name__} is outside the "
        "common subset of C and Warp; use what cable/README.md lists"
    )


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


class _Writer:
    """Text of one function."""

    def __init__(
        self,
        translator: _Translator,
        function: types.FunctionType,
        node: ast.FunctionDef,
        scope: Scope,
    ) -> None:
        self._translator, self._function = translator, function
        self._node, self._scope = node, scope
        self._lines: list[str] = []
        self._temporaries = 0

    def text(self, name: str) -> str:
        """Return the function as a Warp function of this name."""
        arguments = ", ".join(
            f"{a.arg}: {self._annotation(a)}" for a in self._node.args.args
        )
        self._block(self._node.body or [ast.Pass()], 1)
        return f"@wp.func\ndef {name}({arguments}):\n" + "\n".join(self._lines)

    def _refuse(self, node: ast.AST, what: str) -> CableError:
        return refusal(self._function, node, what)

    def _annotation(self, argument: ast.arg) -> str:
        assert argument.annotation is not None
        written = ast.unparse(argument.annotation)
        if written in _ANNOTATIONS:
            return _ANNOTATIONS[written]
        found = self._scope.lookup(argument.annotation)
        if _is_record(found):
            return self._translator.record(found)
        raise self._refuse(argument, f"an argument of the type `{written}`")

    def _emit(self, depth: int, text: str) -> None:
        self._lines.append("    " * depth + text)

    def _temporary(self) -> str:
        self._temporaries += 1
        return f"tmp{self._temporaries}"

    def _block(self, body: list[ast.stmt], depth: int) -> None:
        if not body:
            self._emit(depth, "pass")
        for statement in body:
            self._statement(statement, depth)

    def _statement(self, node: ast.stmt, depth: int) -> None:
        if isinstance(node, ast.Assign):
            self._assign(node, depth)
        elif isinstance(node, ast.AugAssign):
            changed = ast.BinOp(_loaded(node.target), node.op, node.value)
            self._store(node.target, self._expression(changed), depth)
        elif isinstance(node, ast.If):
            self._emit(depth, f"if {self._expression(node.test)}:")
            self._block(node.body, depth + 1)
            if node.orelse:
                self._emit(depth, "else:")
                self._block(node.orelse, depth + 1)
        elif isinstance(node, ast.For):
            head = f"for {ast.unparse(node.target)} in {self._expression(node.iter)}:"
            self._emit(depth, head)
            self._block(node.body, depth + 1)
        elif isinstance(node, ast.While):
            self._emit(depth, f"while {self._expression(node.test)}:")
            self._block(node.body, depth + 1)
        elif isinstance(node, ast.Return):
            value = node.value
            if value is None:
                self._emit(depth, "return")
            elif isinstance(value, ast.Tuple):
                parts = ", ".join(self._expression(part) for part in value.elts)
                self._emit(depth, f"return {parts}")
            else:
                self._emit(depth, f"return {self._initial(value)}")
        elif isinstance(node, ast.Expr):
            self._emit(depth, self._expression(node.value))
        else:
            self._emit(depth, ast.unparse(node))

    def _assign(self, node: ast.Assign, depth: int) -> None:
        value = node.value
        if len(node.targets) > 1:
            name = self._temporary()
            self._emit(depth, f"{name} = {self._initial(value)}")
            for target in node.targets:
                self._store(target, name, depth)
            return
        target = node.targets[0]
        if not isinstance(target, ast.Tuple):
            self._store(target, self._initial(value), depth)
            return
        if not isinstance(value, ast.Tuple):
            names = [
                part.id if isinstance(part, ast.Name) else self._temporary()
                for part in target.elts
            ]
            self._emit(depth, f"{', '.join(names)} = {self._expression(value)}")
            for part, name in zip(target.elts, names, strict=True):
                if not isinstance(part, ast.Name):
                    self._store(part, name, depth)
            return
        names = [self._temporary() for _ in value.elts]
        for name, given in zip(names, value.elts, strict=True):
            self._emit(depth, f"{name} = {self._initial(given)}")
        for name, part in zip(names, target.elts, strict=True):
            self._store(part, name, depth)

    def _store(self, target: ast.expr, value: str, depth: int) -> None:
        if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            if target.slice.lower or target.slice.upper:
                raise self._refuse(target, "a part of an array that is assigned")
            whole = self._expression(target.value)
            self._emit(depth, f"fill({whole}, {value})")
            return
        self._emit(depth, f"{self._expression(target)} = {value}")

    def _initial(self, node: ast.expr) -> str:
        """Return an expression that may become a variable."""
        if isinstance(node, ast.Constant):
            if isinstance(node.value, bool):
                return f"wp.bool({node.value})"
            if isinstance(node.value, int):
                return f"wp.int32({node.value})"
            return f"variable({self._expression(node)})"
        return self._expression(node)

    def _expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            if isinstance(node.value, float):
                return self._translator.literal(node.value)
            return repr(node.value)
        if isinstance(node, ast.Name):
            return node.id
        if isinstance(node, ast.Attribute):
            found = self._scope.lookup(node)
            if is_number(found):
                return self._expression(ast.Constant(found))
            return f"{self._expression(node.value)}.{node.attr}"
        if isinstance(node, ast.Subscript):
            return self._subscript(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.BinOp):
            return self._binary(node)
        if isinstance(node, ast.UnaryOp):
            sign = {ast.Not: "not ", ast.USub: "-"}[type(node.op)]
            return f"({sign}{self._expression(node.operand)})"
        if isinstance(node, ast.BoolOp):
            word = " and " if isinstance(node.op, ast.And) else " or "
            return f"({word.join(self._expression(part) for part in node.values)})"
        if isinstance(node, ast.Compare):
            return self._comparison(node)
        if isinstance(node, ast.IfExp):
            body, other = self._expression(node.body), self._expression(node.orelse)
            return f"({body} if {self._expression(node.test)} else {other})"
        raise self._refuse(node, f"`{ast.unparse(node)}`")

    def _comparison(self, node: ast.Compare) -> str:
        sides = [node.left, *node.comparators]
        marks = [
            ast.unparse(ast.Compare(ast.Name("a"), [op], [ast.Name("a")]))[2:-2]
            for op in node.ops
        ]
        parts = [
            f"{self._expression(a)} {mark} {self._expression(b)}"
            for mark, a, b in zip(marks, sides, sides[1:], strict=False)
        ]
        return f"({' and '.join(parts)})"

    def _binary(self, node: ast.BinOp) -> str:
        left = self._expression(node.left)
        if isinstance(node.op, ast.Pow):
            exponent = node.right
            if isinstance(exponent, ast.Constant) and exponent.value == 2:
                return f"square({left})"
            return f"wp.pow({left}, {self._expression(exponent)})"
        sign = ast.unparse(ast.BinOp(ast.Name("a"), node.op, ast.Name("a")))[2:-2]
        return f"({left} {sign} {self._expression(node.right)})"

    def _subscript(self, node: ast.Subscript) -> str:
        owner = self._expression(node.value)
        if not isinstance(node.slice, ast.Slice):
            return f"{owner}[{self._expression(node.slice)}]"
        if node.slice.step is not None:
            raise self._refuse(node, f"the step of `{ast.unparse(node)}`")
        lower, upper = node.slice.lower, node.slice.upper
        start = self._expression(lower) if lower else "0"
        stop = self._expression(upper) if upper else f"{owner}.shape[0]"
        return f"cut({owner}, {start}, {stop})"

    def _call(self, node: ast.Call) -> str:
        if node.keywords:
            raise self._refuse(node, "an argument given by name")
        found = self._scope.lookup(node.func)
        arguments = [self._expression(given) for given in node.args]
        if found in (min, max):
            return _nested(_BUILTINS[found], arguments)
        try:
            name = _BUILTINS.get(found)
        except TypeError:
            name = None
        if name is None and _is_record(found):
            name = self._translator.record(found)
        if name is None and python_function(found) is not None:
            name = self._translator.require(found)
        if name is None:
            raise self._refuse(node, f"a call of `{ast.unparse(node.func)}`")
        return f"{name}({', '.join(arguments)})"


def _nested(name: str, arguments: list[str]) -> str:
    """Return a function of two arguments, applied to several in their order."""
    whole = arguments[0]
    for further in arguments[1:]:
        whole = f"{name}({whole}, {further})"
    return whole


def _loaded(target: ast.expr) -> ast.expr:
    """Return the expression that reads what a target writes."""
    node = ast.parse(ast.unparse(target), mode="eval").body
    return ast.copy_location(node, target)
