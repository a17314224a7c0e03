"""C99 out of compiled functions.

    library = CLibrary()
    library.export("cc_step", kernel.step)
    print(library.text())

Each function is translated once, by its syntax tree and its annotations; what it calls
is translated with it. Arithmetic keeps its order, so that C, compiled without
contraction, gives the bits of Python. What leaves the subset is refused with its place.
"""

from __future__ import annotations

import ast
import math
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native._fold import Known, Scope, fold, is_number
from cc_mujoco.native._kinds import (
    BOOL,
    BYTE,
    INT,
    INT8,
    INT32,
    NOTHING,
    NUMBERS,
    REAL,
    WORD,
    Array,
    FunctionTypes,
    Kind,
    LoadedInt,
    Scalar,
    Structure,
    UnknownTypeError,
    python_function,
    record_of,
    short_name,
    signature_of,
    tree_of,
    tuple_of,
)  # fmt: skip

_ATOM, _UNARY, _PRODUCT, _SUM, _SHIFT, _COMPARE, _BITS, _AND, _OR, _CHOICE = range(
    10, 0, -1
)
UNARY = _UNARY
"""Rank of a unary operator or a cast, for functions that are written by hand."""
DIMENSIONS = "n", "columns", "layers"
"""Fields of an array's structure in C that hold its sizes."""
_OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", _SUM), ast.Sub: ("-", _SUM), ast.Mult: ("*", _PRODUCT),
    ast.Div: ("/", _PRODUCT), ast.BitAnd: ("&", _BITS), ast.BitOr: ("|", _BITS),
    ast.BitXor: ("^", _BITS), ast.LShift: ("<<", _SHIFT), ast.RShift: (">>", _SHIFT),
}  # fmt: skip
_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">",
    ast.GtE: ">=",
}  # fmt: skip
_MATH = {
    getattr(module, name): name
    for module in (math, np)
    for name in (
        "exp", "log", "sqrt", "cos", "sin", "tan", "acos", "asin", "atan", "atan2",
        "expm1", "log1p", "hypot", "sinh", "cosh", "tanh", "asinh", "copysign", "fabs",
        "rint", "fmod",
    )
    if hasattr(module, name)
}  # fmt: skip
_MATH.update({np.arctan2: "atan2", np.arctan: "atan", np.arccos: "acos"})
_TO_INT = {math.floor: "floor", math.ceil: "ceil", round: "rint"}
_TESTS = {
    np.isfinite: "isfinite", math.isfinite: "isfinite", np.isnan: "isnan",
    math.isnan: "isnan", np.isinf: "isinf", math.isinf: "isinf",
}  # fmt: skip
_MAKERS = (np.empty, np.zeros, np.ones, np.full)
_RESERVED = frozenset(
    "auto bool break case char const continue default do double else enum extern "
    "false float for goto if inline int long register restrict return short signed "
    "sizeof static struct switch true typedef union unsigned void volatile while "
    "near far main exp log sqrt cos sin tan acos asin atan floor ceil fabs pow gamma "
    "j0 j1 jn y0 y1 yn index remainder significand scalb drem round trunc".split()
)


Intrinsic = Callable[[Any, ast.Call, list[Any]], Any]
"""A function that is written in C by hand: from the writer, the node of a call and its
arguments it returns the value of the call."""
Intrinsics = dict[int, Intrinsic]
"""These functions by their `id`."""


@dataclass(frozen=True)
class Value:
    """An expression in C.

    Attributes:
        text: its text.
        kind: its type.
        rank: how tightly its outermost operator binds.
        table: name of the constant array that it is a view of.
    """

    text: str
    kind: Kind
    rank: int = _ATOM
    table: str = ""

    def at(self, rank: int) -> str:
        """Return the text as an operand of an operator of this rank."""
        return self.text if self.rank >= rank else f"({self.text})"


@dataclass(frozen=True)
class Function:
    """A translated function."""

    name: str
    signature: FunctionTypes
    text: str = ""


class CLibrary:
    """Functions in C, each once.

    Attributes:
        root: folder of the sources, for the places in comments.
    """

    def __init__(self, intrinsics: Intrinsics, root: Path) -> None:
        """Begin with functions that are written otherwise, by their objects."""
        self.intrinsics, self.root = intrinsics, root
        self._functions: dict[types.FunctionType, Function] = {}
        self._records: dict[str, str] = {}
        self._tables: dict[tuple[bytes, str], tuple[str, str]] = {}
        self._waiting: list[types.FunctionType] = []
        self._done: list[Function] = []
        self._exports: list[str] = []

    def export(self, symbol: str, function: types.FunctionType) -> None:
        """Translate a function and give it a name that is seen outside."""
        found = self.require(function)
        kinds = found.signature.arguments
        given = ", ".join(f"{self.type(kind)} {c_name(n)}" for n, kind in kinds.items())
        result = found.signature.result
        calls = "" if result == NOTHING else "return "
        self._exports.append(
            f"CC_EXPORT {self.type(result)} {symbol}({given or 'void'})\n{{\n"
            f"    {calls}{found.name}({', '.join(map(c_name, kinds))});\n}}\n"
        )

    def require(self, function: types.FunctionType) -> Function:
        """Return a function, which will be translated with all that it calls.

        Raises:
            CableError: it leaves the subset.
        """
        known = self._functions.get(function)
        if known is None:
            try:
                signature = signature_of(function)
            except UnknownTypeError as error:
                raise refusal(function, None, f"the type {error}") from None
            module = function.__module__.rpartition(".")[2].lstrip("_")
            name = f"{module}_{function.__name__.lstrip('_')}"
            taken = {f.name for f in self._functions.values()}
            name = name + "_" if name in taken else name
            known = self._functions[function] = Function(name, signature)
            self._waiting.append(function)
        return known

    def translate(self) -> None:
        """Translate what is required, and all that it calls.

        Raises:
            CableError: it leaves the subset; one line for each place found.
        """
        errors = []
        while self._waiting:
            function = self._waiting.pop()
            known = self._functions[function]
            try:
                text = _Writer(self, function, known).text()
            except CableError as error:
                errors.append(str(error))
            else:
                self._done.append(replace(known, text=text))
        if errors:
            raise CableError("\n".join(sorted(errors)))

    def type(self, kind: Kind) -> str:
        """Return the C type; a structure is declared with it."""
        if isinstance(kind, Scalar):
            return kind.c
        if isinstance(kind, Structure) and kind.name not in self._records:
            fields = "\n".join(
                f"    {self.type(each)} {c_name(name)};" for name, each in kind.fields
            )
            self._records[kind.name] = f"typedef struct {{\n{fields}\n}} {kind.name};\n"
        if isinstance(kind, Structure) and kind.is_pointer:
            return f"{kind.name} *"
        return short_name(kind)

    def table(self, found: np.ndarray[Any, Any], label: str) -> Value:
        """Return a constant array."""
        element = NUMBERS[found.dtype.type]
        key = found.tobytes(), f"{element.c}{found.shape}"
        if key not in self._tables:
            taken = {name for name, _ in self._tables.values()}
            name = base = f"TABLE_{label.lstrip('_').upper()}"
            count = 1
            while name in taken:
                count += 1
                name = f"{base}_{count}"
            cells = ", ".join(literal(each).text for each in found.ravel().tolist())
            head = f"static const {element.c} {name}[{max(found.size, 1)}]"
            text = f"{head} = {{{cells}}};\n"
            self._tables[key] = name, text
        name, kind = self._tables[key][0], Array(element, found.ndim)
        shape = ", ".join(map(str, found.shape))
        text = f"({short_name(kind)}){{({element.c} *){name}, {shape}}}"
        return Value(text, kind, table=name)

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(self._done)

    def text(self) -> str:
        """Return the text of the library."""
        self.translate()
        return "\n".join(
            [
                *self._records.values(),
                *(text for _, text in self._tables.values()),
                *(_prototype(f.text) for f in self._done),
                "",
                *(f.text for f in self._done),
                *self._exports,
            ]
        )


def _prototype(text: str) -> str:
    head = text[text.index("static ") :]
    return head[: head.index("\n{")] + ";"


def refusal(function: Any, node: ast.AST | None, what: str) -> CableError:
    """Return the error for a place outside the subset."""
    code = function.__code__
    line = getattr(node, "lineno", code.co_firstlineno)
    return CableError(
        f"{code.co_filename}:{line}: {what} in {function.__name__} is outside the "
        "subset that becomes C; use what cable/README.md lists"
    )


def literal(found: Any) -> Value:
    """Return a number in C."""
    if isinstance(found, bool):
        return Value("true" if found else "false", BOOL)
    if isinstance(found, int | np.integer):
        text = str(int(found))
        if abs(int(found)) >= 2**31:
            text = f"INT64_C({text})"
        return Value(text, INT, _ATOM if found >= 0 else _UNARY)
    if math.isnan(found):
        return Value("NAN", REAL)
    if math.isinf(found):
        return Value("INFINITY" if found > 0 else "-INFINITY", REAL, _UNARY)
    return Value(repr(float(found)), REAL, _ATOM if found >= 0 else _UNARY)


def c_name(name: str) -> str:
    """Return a name that C and its libraries have not taken."""
    return f"{name}_" if name in _RESERVED else name


def _is_scalar(kind: Kind) -> bool:
    return isinstance(kind, Scalar)


def _wide(kind: Kind) -> Kind:
    """Return the type of a variable for a value: small integers become wide."""
    return INT if kind in (BYTE, INT32, INT8) else kind


def _stored_names(body: Iterable[ast.stmt]) -> set[str]:
    """Return the names that a block stores."""
    return {
        n.id
        for s in body
        for n in ast.walk(s)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }


class _Writer:
    """Text of one function."""

    def __init__(
        self, library: CLibrary, function: types.FunctionType, as_: Function
    ) -> None:
        self.library, self._function, self._as = library, function, as_
        self._arguments = as_.signature.arguments
        self._node = tree_of(function)
        self._scope = Scope(function, self._node)
        self._doc = ast.get_docstring(self._node)
        self._node.body = [s for s in self._node.body if not _is_docstring(s)]
        fold(self._node, self._scope, Known(), lambda found: None)
        self._kinds: dict[str, Kind] = {}
        self._loop_local = self._find_loop_local()

    # Whole function

    def text(self) -> str:
        """Return the function in C."""
        while True:
            before = dict(self._kinds)
            self._lines: list[str] = []
            self._storage: list[str] = []
            self._owned: set[str] = set()
            self._temporaries = 0
            self._block(self._node.body, 1)
            if self._kinds == before:
                break
        result = self.library.type(self._as.signature.result)
        given = ", ".join(
            f"{self.library.type(kind)} {c_name(name)}"
            for name, kind in self._arguments.items()
        )
        head = f"static {result} {self._as.name}({given or 'void'})"
        if len(head) > 88:
            head = head.replace("(", "(\n    ", 1).replace(", ", ",\n    ")
        variables = [
            f"    {self.library.type(kind)} {c_name(name)} = {_zero(kind)};"
            for name, kind in self._kinds.items()
            if name not in {*self._arguments, *self._loop_local, "_"}
        ]
        used = {n.id for n in ast.walk(self._node) if isinstance(n, ast.Name)}
        loaded = {
            n.id
            for n in ast.walk(self._node)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
        }
        unused = [n for n in self._arguments if n not in used]
        unused += [n for n in self._kinds if n not in loaded and n != "_"]
        unused += [n for n in self._arguments if n in used and n not in loaded]
        silence = [
            f"    (void){c_name(n)};" for n in unused if n not in self._loop_local
        ]
        body = [*variables, *self._storage, *silence, *self._lines]
        return "\n".join([self._comment(), head, "{", *(b for b in body if b), "}", ""])

    def _comment(self) -> str:
        code = self._function.__code__
        try:
            place = Path(code.co_filename).relative_to(self.library.root)
        except ValueError:
            place = Path(Path(code.co_filename).name)
        lines = [f"{place.as_posix()}:{code.co_firstlineno}"]
        if self._doc:
            lines = [*self._doc.replace("*/", "* /").splitlines(), "", *lines]
        return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"])

    def _find_loop_local(self) -> set[str]:
        """Return the names that live in loops over a range alone."""
        inside: dict[str, int] = {}
        total: dict[str, int] = {}
        spoilt: set[str] = set()
        for found in ast.walk(self._node):
            if isinstance(found, ast.Name):
                total[found.id] = total.get(found.id, 0) + 1
            if isinstance(found, ast.For) and isinstance(found.target, ast.Name):
                name = found.target.id
                stores = loads = 0
                for s in found.body:
                    for n in ast.walk(s):
                        if isinstance(n, ast.Name) and n.id == name:
                            loads += 1
                            stores += isinstance(n.ctx, ast.Store)
                if stores or not self._is_range(found.iter):
                    spoilt.add(name)
                inside[name] = inside.get(name, 0) + loads + 1
        return {
            name
            for name, count in inside.items()
            if count == total[name]
            and name not in spoilt
            and name not in self._arguments
        }

    def _is_range(self, node: ast.expr) -> bool:
        return isinstance(node, ast.Call) and self._scope.lookup(node.func) is range

    def refuse(self, node: ast.AST, what: str = "") -> CableError:
        text = ast.unparse(node).splitlines()[0][:80]
        return refusal(self._function, node, f"{what + ': ' if what else ''}`{text}`")

    # Helpers

    def _emit(self, depth: int, text: str) -> None:
        self._lines.append("    " * depth + text)

    def _temporary(self, stem: str = "t") -> str:
        self._temporaries += 1
        return f"{stem}{self._temporaries}_"

    def _kind(self, name: str) -> Kind | None:
        return self._arguments.get(name) or self._kinds.get(name)

    def _declare(self, name: str, kind: Kind, node: ast.AST) -> Kind:
        """Note the type of a variable; return the one that it has."""
        kind = _wide(kind)
        present = self._kind(name)
        if present is not None:
            present = _wide(present)
        if present is None or present == kind:
            if name not in self._arguments:
                self._kinds[name] = kind
            return kind
        wider = _wider(present, kind)
        if wider is None or (name in self._arguments and wider != present):
            raise self.refuse(node, f"{name} changes its type to {kind}")
        if name not in self._arguments:
            self._kinds[name] = wider
        return wider

    def as_kind(self, value: Value, kind: Kind, node: ast.AST) -> Value:
        """Return a value converted to a type."""
        if value.kind == kind:
            return value
        if isinstance(kind, Scalar) and isinstance(value.kind, Scalar):
            if value.kind == NOTHING or kind == NOTHING:
                raise self.refuse(node, "a value of nothing")
            if kind == BOOL:
                return Value(f"{value.at(_COMPARE + 1)} != 0", BOOL, _COMPARE)
            if kind == REAL and value.kind == INT and _is_plain_int(value.text):
                plain = _plain(value.text)
                return Value(f"{plain}.0{value.text[len(plain) :]}", REAL, value.rank)
            return Value(f"({kind.c}){value.at(_UNARY)}", kind, _UNARY)
        if (
            isinstance(kind, Structure)
            and isinstance(value.kind, Structure)
            and len(kind.fields) == len(value.kind.fields)
        ):
            return self._convert_record(value, kind, node)
        raise self.refuse(
            node, f"{short_name(value.kind)} where {short_name(kind)} is due"
        )

    def _convert_record(self, value: Value, kind: Structure, node: ast.AST) -> Value:
        assert isinstance(value.kind, Structure)
        name = value.text
        if not name.isidentifier():
            raise self.refuse(node, f"{value.kind.name} where {kind.name} is due")
        parts = [
            self.as_kind(Value(f"{name}.{c_name(field)}", given), wanted, node).text
            for (field, given), (_, wanted) in zip(
                value.kind.fields, kind.fields, strict=True
            )
        ]
        return Value(f"({self.library.type(kind)}){{{', '.join(parts)}}}", kind)

    def _hold(self, value: Value, depth: int) -> Value:
        """Keep a value in a constant of its own; return that."""
        if value.text.isidentifier():
            return value
        name = self._temporary()
        self._emit(
            depth, f"const {self.library.type(value.kind)} {name} = {value.text};"
        )
        return Value(name, value.kind)

    # Statements

    def _block(self, body: list[ast.stmt], depth: int) -> None:
        for statement in body:
            self._statement(statement, depth)

    def _statement(self, node: ast.stmt, depth: int) -> None:
        if isinstance(node, ast.Assign):
            self._assign(node.targets, node.value, depth)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            self._assign([node.target], node.value, depth)
        elif isinstance(node, ast.AugAssign):
            self._augment(node, depth)
        elif isinstance(node, ast.If):
            self._emit(depth, f"if ({self._condition(node.test)}) {{")
            self._block(node.body, depth + 1)
            self._otherwise(node.orelse, depth)
            self._emit(depth, "}")
        elif isinstance(node, ast.While) and not node.orelse:
            self._emit(depth, f"while ({self._condition(node.test)}) {{")
            self._loop_body(node.body, depth)
        elif isinstance(node, ast.For) and not node.orelse:
            self._for(node, depth)
        elif isinstance(node, ast.Return):
            self._return(node, depth)
        elif isinstance(node, ast.Expr):
            value = self.expression(node.value)
            void = "" if value.kind == NOTHING else "(void)"
            self._emit(depth, f"{void}{value.text};")
        elif isinstance(node, ast.Break):
            self._emit(depth, "break;")
        elif isinstance(node, ast.Continue):
            self._emit(depth, "continue;")
        elif not isinstance(node, ast.Pass):
            raise self.refuse(node)

    def _otherwise(self, body: list[ast.stmt], depth: int) -> None:
        while len(body) == 1 and isinstance(body[0], ast.If):
            at = len(self._lines)
            test = self._condition(body[0].test)
            if len(self._lines) > at:  # it needs statements of its own
                del self._lines[at:]
                break
            self._emit(depth, f"}} else if ({test}) {{")
            self._block(body[0].body, depth + 1)
            body = body[0].orelse
        if body:
            self._emit(depth, "} else {")
            self._block(body, depth + 1)

    def _loop_body(self, body: list[ast.stmt], depth: int) -> None:
        self._block(body, depth + 1)
        self._emit(depth, "}")

    def _augment(self, node: ast.AugAssign, depth: int) -> None:
        load = ast.parse(ast.unparse(node.target), mode="eval").body
        for part in ast.walk(load):
            ast.copy_location(part, node)
        sum_ = ast.copy_location(ast.BinOp(load, node.op, node.value), node)
        self._assign([node.target], sum_, depth)

    def _for(self, node: ast.For, depth: int) -> None:
        if isinstance(node.target, ast.Name) and self._is_range(node.iter):
            assert isinstance(node.iter, ast.Call)
            self._count(node, node.iter, depth)
            return
        targets = (
            node.target.elts if isinstance(node.target, ast.Tuple) else [node.target]
        )
        counter, rows = self._temporary("k"), []
        if isinstance(node.iter, ast.Tuple):
            for item in node.iter.elts:
                cells = item.elts if isinstance(item, ast.Tuple) else [item]
                if len(cells) != len(targets):
                    raise self.refuse(node)
                rows.append([self.expression(cell) for cell in cells])
            size = str(len(rows))
        self._emit(depth, "{")
        stores: list[tuple[ast.expr, Value]] = []
        if rows:
            for i, target in enumerate(targets):
                kind = _wide(rows[0][i].kind)
                for row in rows:
                    wider = _wider(kind, _wide(row[i].kind))
                    if wider is None:
                        raise self.refuse(node, "a loop over different types")
                    kind = wider
                cells_text = ", ".join(
                    self.as_kind(row[i], kind, node).text for row in rows
                )
                name = self._temporary("items")
                c = self.library.type(kind)
                self._emit(depth + 1, f"const {c} {name}[] = {{{cells_text}}};")
                stores.append((target, Value(f"{name}[{counter}]", kind)))
        else:
            value = self.expression(node.iter)
            if not isinstance(value.kind, Array) or value.kind.dims != 1:
                raise self.refuse(node, "a loop")
            element = value.kind.element
            value = self._hold(value, depth + 1)
            size = f"{value.text}.n"
            stores = [(targets[0], Value(f"{value.text}.p[{counter}]", element))]
        head = f"for (int64_t {counter} = 0; {counter} < {size}; {counter}++) {{"
        self._emit(depth + 1, head)
        for target, item_value in stores:
            self._store(target, item_value, depth + 2)
        self._loop_body(node.body, depth + 1)
        self._emit(depth, "}")

    def _count(self, node: ast.For, call: ast.Call, depth: int) -> None:
        assert isinstance(node.target, ast.Name)
        given = [self.as_kind(self.expression(a), INT, a) for a in call.args]
        start = given[0].text if len(given) > 1 else "0"
        stop = given[1] if len(given) > 1 else given[0]
        step = _plain(given[2].text) if len(given) > 2 else "1"
        if not step.lstrip("-").isdigit():
            raise self.refuse(node, "a step that is no number")
        name = node.target.id
        local = name in self._loop_local
        counter = c_name(name) if local and name != "_" else self._temporary("k")
        stop_node = call.args[1] if len(call.args) > 1 else call.args[0]
        first = f"int64_t {counter} = {start}"
        if not self._is_steady(stop_node, node.body):
            end = self._temporary("end")
            first += f", {end} = {stop.text}"
            stop = Value(end, INT)
        sign = ">" if step.startswith("-") else "<"
        change = {"1": f"{counter}++", "-1": f"{counter}--"}.get(
            step, f"{counter} += {step}"
        )
        test = f"{counter} {sign} {stop.at(_COMPARE + 1)}"
        self._emit(depth, f"for ({first}; {test}; {change}) {{")
        if local:
            self._kinds[name] = INT
        else:
            self._store(node.target, Value(counter, INT), depth + 1)
        self._loop_body(node.body, depth)

    def _is_steady(self, node: ast.expr, body: list[ast.stmt]) -> bool:
        """Return whether an expression keeps its value while a loop runs."""
        stored = _stored_names(body)
        for found in ast.walk(node):
            if isinstance(found, ast.Call):
                return False
            if isinstance(found, ast.Name) and found.id in stored:
                return False
            if isinstance(found, ast.Subscript) and not ast.unparse(
                found.value
            ).endswith(".shape"):
                return False
        return True

    def _return(self, node: ast.Return, depth: int) -> None:
        result = self._as.signature.result
        empty = node.value is None or (
            isinstance(node.value, ast.Constant) and node.value.value is None
        )
        text = ""
        if not empty:
            assert node.value is not None
            names = {n.id for n in ast.walk(node.value) if isinstance(n, ast.Name)}
            if isinstance(result, Array) and names & self._owned:
                raise self.refuse(node, "an array of its own that is returned")
            value = self._wanted(node.value, result)
            if isinstance(result, Structure) and value.kind != result:
                value = self._hold(value, depth)
            text = self.as_kind(value, result, node).text
        self._emit(depth, f"return {text};" if text else "return;")

    def _wanted(self, node: ast.expr, kind: Kind) -> Value:
        """Return an expression that is to become a type; tuples field by field."""
        if (
            isinstance(node, ast.Tuple)
            and isinstance(kind, Structure)
            and len(node.elts) == len(kind.fields)
        ):
            parts = [
                self.as_kind(self._wanted(part, each), each, part).text
                for part, (_, each) in zip(node.elts, kind.fields, strict=True)
            ]
            return Value(f"({self.library.type(kind)}){{{', '.join(parts)}}}", kind)
        return self.expression(node)

    def _assign(self, targets: list[ast.expr], value: ast.expr, depth: int) -> None:
        target = targets[0]
        if len(targets) == 1 and not isinstance(target, ast.Tuple):
            if isinstance(target, ast.Name) and isinstance(value, ast.Call):
                if self._allocate(target.id, value, depth):
                    return
            kind = self._kind(target.id) if isinstance(target, ast.Name) else None
            given = self._wanted(value, kind) if kind else self.expression(value)
            self._store(target, given, depth)
            return
        if (
            len(targets) == 1
            and isinstance(target, ast.Tuple)
            and isinstance(value, ast.Tuple)
        ):
            if any(self._is_maker(part) for part in value.elts):
                for one, part in zip(target.elts, value.elts, strict=True):
                    self._assign([one], part, depth)
                return
            self._assign_together(target.elts, value.elts, depth)
            return
        given = self._hold(self.expression(value), depth)
        for each in targets:
            if isinstance(each, ast.Tuple):
                self._unpack(each, given, depth)
            else:
                self._store(each, given, depth)

    def _assign_together(
        self, targets: list[ast.expr], values: list[ast.expr], depth: int
    ) -> None:
        """Assign several values, each read before any is written."""
        given = [self.expression(each) for each in values]
        written: set[str] = set()
        for i, (one, value) in enumerate(zip(targets, values, strict=True)):
            del one
            names = {n.id for n in ast.walk(value) if isinstance(n, ast.Name)}
            if names & written or isinstance(targets[i], ast.Subscript):
                given = [
                    each if _is_number_text(each.text) else self._hold_copy(each, depth)
                    for each in given
                ]
                break
            target = targets[i]
            if isinstance(target, ast.Name):
                written.add(target.id)
        for one, each in zip(targets, given, strict=True):
            self._store(one, each, depth)

    def _hold_copy(self, value: Value, depth: int) -> Value:
        name = self._temporary()
        kind = _wide(value.kind)
        c = self.library.type(kind)
        self._emit(depth, f"const {c} {name} = {value.text};")
        return Value(name, kind)

    def _unpack(self, target: ast.Tuple, value: Value, depth: int) -> None:
        if isinstance(value.kind, Structure):
            parts = [
                Value(f"{value.text}.{c_name(name)}", kind)
                for name, kind in value.kind.fields
            ]
        elif isinstance(value.kind, Array) and value.kind.dims == 1:
            parts = [
                Value(f"{value.text}.p[{i}]", value.kind.element)
                for i in range(len(target.elts))
            ]
        else:
            raise self.refuse(target, "unpacking")
        for one, part in zip(target.elts, parts, strict=True):
            self._store(one, part, depth)

    def _is_maker(self, node: ast.expr) -> bool:
        if not isinstance(node, ast.Call):
            return False
        found = self._scope.lookup(node.func)
        return _hashable(found) and found in _MAKERS

    def _allocate(self, name: str, call: ast.Call, depth: int) -> bool:
        """Make a local array; return whether the call makes one."""
        if not self._is_maker(call):
            return False
        maker = self._scope.lookup(call.func)
        element = REAL
        if len(call.args) > 1 and maker is not np.full:
            element = NUMBERS[self._scope.lookup(call.args[1])]
        shape = call.args[0]
        dims = shape.elts if isinstance(shape, ast.Tuple) else [shape]
        if not all(isinstance(d, ast.Constant) for d in dims):
            raise self.refuse(
                call, "an array whose size is no constant; have the caller give it"
            )
        sizes = [self.expression(d).text for d in dims]
        kind = Array(element, len(sizes))
        self._declare(name, kind, call)
        size = " * ".join(sizes)
        place = self._temporary(name)
        self._storage.append(f"    {element.c} {place}[{size}];")
        own = c_name(name)
        c = self.library.type(kind)
        self._emit(depth, f"{own} = ({c}){{{place}, {', '.join(sizes)}}};")
        if maker is np.zeros:
            self._emit(
                depth, f"memset({own}.p, 0, sizeof({element.c}) * (size_t)({size}));"
            )
        elif maker is not np.empty:
            fill = literal(1) if maker is np.ones else self.expression(call.args[1])
            value = self.as_kind(fill, element, call)
            self._emit(depth, f"{_fill_of(kind)}({own}, {value.text});")
        self._owned.add(name)
        return True

    def _store(self, target: ast.expr, value: Value, depth: int) -> None:
        if isinstance(target, ast.Name):
            if target.id == "_":
                self._emit(depth, f"(void)({value.text});")
                return
            kind = self._declare(target.id, value.kind, target)
            if isinstance(kind, Structure) and value.kind != kind:
                value = self._hold(value, depth)
            if value.text in self._owned:
                self._owned.add(target.id)
            text = self.as_kind(value, kind, target).text
            self._emit(depth, f"{c_name(target.id)} = {text};")
            return
        if isinstance(target, ast.Attribute):
            place = self._attribute(target)
            text = self.as_kind(value, place.kind, target).text
            self._emit(depth, f"{place.text} = {text};")
            return
        if not isinstance(target, ast.Subscript):
            raise self.refuse(target, "a target")
        place = self._subscript(target)
        if isinstance(place.kind, Array):
            if isinstance(value.kind, Array):
                if value.kind != place.kind or value.kind.dims != 1:
                    raise self.refuse(target, "an array that is assigned")
                self._emit(
                    depth, f"{_copy_of(place.kind)}({place.text}, {value.text});"
                )
                return
            given = self.as_kind(value, place.kind.element, target)
            self._emit(depth, f"{_fill_of(place.kind)}({place.text}, {given.text});")
            return
        kind = self._element_kind(target)
        self._emit(depth, f"{place.text} = {self.as_kind(value, kind, target).text};")

    def _element_kind(self, target: ast.Subscript) -> Kind:
        owner = self.expression(target.value)
        if isinstance(owner.kind, Array):
            return owner.kind.element
        raise self.refuse(target, "a target")

    # Expressions

    def _condition(self, node: ast.expr) -> str:
        value = self.expression(node)
        if not _is_scalar(value.kind):
            raise self.refuse(node, "the truth of an array")
        return value.text

    def _constant(self, found: Any, node: ast.expr) -> Value:
        if isinstance(found, LoadedInt):
            return Value(found.c, INT)
        if is_number(found) or isinstance(found, np.floating | np.integer):
            value = literal(found)
            named = getattr(node, "named", None)
            if named:
                return replace(value, text=f"{value.text} /* {named} */")
            return value
        if isinstance(found, np.ndarray) and found.dtype.type in NUMBERS:
            label = "DATA" if isinstance(node, ast.Constant) else ast.unparse(node)
            return self.library.table(found, label.rpartition(".")[2])
        if isinstance(found, tuple):
            parts = [self._constant(each, ast.Constant(each)) for each in found]
            kind = (
                record_of(type(found))
                if hasattr(found, "_fields")
                else tuple_of(tuple(part.kind for part in parts))
            )
            given = ", ".join(
                self.as_kind(part, each, node).text
                for part, (_, each) in zip(parts, kind.fields, strict=True)
            )
            return Value(f"({self.library.type(kind)}){{{given}}}", kind)
        raise self.refuse(node, f"a constant of the type {type(found).__name__}")

    def expression(self, node: ast.expr) -> Value:
        if isinstance(node, ast.Constant):
            return self._constant(node.value, node)
        if isinstance(node, ast.Name):
            kind = self._kind(node.id)
            if kind is not None:
                return Value(c_name(node.id), kind)
            found = self._scope.lookup(node)
            if found is None:
                raise self.refuse(node, "an unknown name")
            return self._constant(found, node)
        if isinstance(node, ast.Attribute):
            return self._attribute(node)
        if isinstance(node, ast.Subscript):
            return self._subscript(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.BinOp):
            return self._binary(node)
        if isinstance(node, ast.UnaryOp):
            return self._unary(node)
        if isinstance(node, ast.BoolOp):
            is_and = isinstance(node.op, ast.And)
            rank = _AND if is_and else _OR
            parts = [self.expression(each) for each in node.values]
            # Clear of the warning on `&&` within `||`.
            texts = [part.at(rank + 1 if is_and else _AND + 1) for part in parts]
            return Value((" && " if is_and else " || ").join(texts), BOOL, rank)
        if isinstance(node, ast.Compare):
            return self._comparison(node)
        if isinstance(node, ast.IfExp):
            body, other = self.expression(node.body), self.expression(node.orelse)
            kind = _wider(_wide(body.kind), _wide(other.kind))
            if kind is None:
                raise self.refuse(node, "two types")
            test = self.expression(node.test).at(_CHOICE + 1)
            body, other = (
                self.as_kind(body, kind, node),
                self.as_kind(other, kind, node),
            )
            text = f"{test} ? {body.at(_CHOICE + 1)} : {other.at(_CHOICE)}"
            return Value(text, kind, _CHOICE)
        if isinstance(node, ast.Tuple):
            parts = [self.expression(each) for each in node.elts]
            record = tuple_of(tuple(_wide(part.kind) for part in parts))
            given = ", ".join(
                self.as_kind(part, each, node).text
                for part, (_, each) in zip(parts, record.fields, strict=True)
            )
            return Value(f"({self.library.type(record)}){{{given}}}", record)
        raise self.refuse(node, "an expression")

    def _attribute(self, node: ast.Attribute) -> Value:
        found = self._scope.lookup(node)
        if found is not None:
            return self._constant(found, node)
        if node.attr == "data" and isinstance(node.value, ast.Attribute):
            owner = self.expression(node.value.value)
            return Value(f"(int64_t)(intptr_t){owner.text}.p", INT, _UNARY)
        owner = self.expression(node.value)
        if isinstance(owner.kind, Structure):
            to = "->" if owner.kind.is_pointer else "."
            text = f"{owner.at(_ATOM)}{to}{c_name(node.attr)}"
            return Value(text, owner.kind.kind_of(node.attr))
        if isinstance(owner.kind, Array) and node.attr == "size":
            return Value(
                _size_of(owner), INT, _ATOM if owner.kind.dims == 1 else _PRODUCT
            )
        raise self.refuse(node, "an attribute")

    def _comparison(self, node: ast.Compare) -> Value:
        sides = [self.expression(each) for each in [node.left, *node.comparators]]
        if not all(_is_scalar(side.kind) for side in sides):
            raise self.refuse(node, "a comparison")
        parts = []
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if type(op) not in _COMPARISONS:
                raise self.refuse(node, "a comparison")
            if REAL in (left.kind, right.kind):
                left, right = (self.as_kind(e, REAL, node) for e in (left, right))
            parts.append(
                f"{left.at(_COMPARE + 1)} {_COMPARISONS[type(op)]} "
                f"{right.at(_COMPARE + 1)}"
            )
        if len(parts) == 1:
            return Value(parts[0], BOOL, _COMPARE)
        return Value(" && ".join(parts), BOOL, _AND)

    def _unary(self, node: ast.UnaryOp) -> Value:
        value = self.expression(node.operand)
        if not _is_scalar(value.kind):
            raise self.refuse(node, "arithmetic of arrays")
        if isinstance(node.op, ast.Not):
            return Value(f"!{value.at(_UNARY)}", BOOL, _UNARY)
        kind = INT if value.kind == BOOL else _wide(value.kind)
        sign = {ast.Invert: "~", ast.USub: "-", ast.UAdd: "+"}[type(node.op)]
        text = value.at(_UNARY)
        return Value(sign + (f"({text})" if text[0] == sign else text), kind, _UNARY)

    def _binary(self, node: ast.BinOp) -> Value:
        left, right = self.expression(node.left), self.expression(node.right)
        if not (_is_scalar(left.kind) and _is_scalar(right.kind)):
            raise self.refuse(node, "arithmetic of arrays")
        kind: Kind = INT
        if REAL in (left.kind, right.kind):
            kind = REAL
        elif WORD in (left.kind, right.kind):
            kind = WORD
        op = type(node.op)
        if op is ast.Pow:
            return self._power(node, left, right)
        if op is ast.Div:
            kind = REAL
        left, right = self.as_kind(left, kind, node), self.as_kind(right, kind, node)
        if op is ast.FloorDiv:
            if kind == REAL:
                quotient = f"{left.at(_PRODUCT)} / {right.at(_PRODUCT + 1)}"
                return Value(f"floor({quotient})", REAL)
            return Value(f"floor_div({left.text}, {right.text})", kind)
        if op is ast.Mod:
            name = "floor_mod_real" if kind == REAL else "floor_mod"
            return Value(f"{name}({left.text}, {right.text})", kind)
        if op not in _OPERATORS:
            raise self.refuse(node, "an operator")
        sign, rank = _OPERATORS[op]
        least = rank if rank in (_SUM, _PRODUCT) else _UNARY
        text = f"{left.at(least)} {sign} {right.at(least + 1)}"
        return Value(text, kind, rank)

    def _power(self, node: ast.BinOp, left: Value, right: Value) -> Value:
        exponent = node.right.value if isinstance(node.right, ast.Constant) else None
        if exponent == 2 and isinstance(exponent, int):
            name = "cc_square" if left.kind == REAL else "cc_square_int"
            return Value(f"{name}({left.text})", left.kind)
        if right.kind == INT:
            raise self.refuse(node, "a power of an integer; multiply")
        if REAL in (left.kind, right.kind):
            given = [self.as_kind(each, REAL, node).text for each in (left, right)]
            return Value(f"pow({', '.join(given)})", REAL)
        raise self.refuse(node, "a power of integers")

    def _index(self, node: ast.expr, size: str) -> Value:
        value = self.as_kind(self.expression(node), INT, node)
        if value.text.startswith("-"):
            return Value(f"{size} - {value.text[1:]}", INT, _SUM)
        return value

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            owner = self.expression(node.value.value)
            place = _place(node.slice)
            if isinstance(owner.kind, Array) and 0 <= place < owner.kind.dims:
                return Value(_dims_of(owner)[place], INT)
            raise self.refuse(node, "a shape of a FloatArray; say FloatMatrix")
        found = self._scope.lookup(node)
        if found is not None:
            return self._constant(found, node)
        owner = self.expression(node.value)
        if isinstance(owner.kind, Structure):
            place = _place(node.slice)
            if place >= 0:
                field, kind = owner.kind.fields[place]
                return Value(f"{owner.at(_ATOM)}.{c_name(field)}", kind)
            return self._choice(node, owner, owner.kind)
        if not isinstance(owner.kind, Array):
            raise self.refuse(node, "an index of a number")
        return self._element(node, owner, owner.kind)

    def _choice(self, node: ast.Subscript, owner: Value, kind: Structure) -> Value:
        """Return an entry of a tuple, all of one type, at a variable place."""
        kinds = {each for _, each in kind.fields}
        known = self._scope.lookup(node.value)
        if len(kinds) != 1:
            raise self.refuse(node, "a variable index of a tuple of several types")
        if isinstance(known, tuple):
            parts = [self._constant(each, ast.Constant(each)).text for each in known]
        else:
            parts = [f"{owner.at(_ATOM)}.{c_name(name)}" for name, _ in kind.fields]
        item = kinds.pop()
        place = self.as_kind(self.expression(node.slice), INT, node).text
        cells = f"(const {self.library.type(item)}[]){{{', '.join(parts)}}}"
        return Value(f"({cells})[{place}]", item)

    def _element(self, node: ast.Subscript, owner: Value, kind: Array) -> Value:
        """Return an element of an array, or a view of its first dimensions."""
        given = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        while len(given) > 1 and _is_whole(given[-1]):
            given = given[:-1]
        dims, array = _dims_of(owner), owner.at(_ATOM)
        if len(given) > kind.dims:
            raise self.refuse(node, "two indices of a FloatArray; say FloatMatrix")
        if any(isinstance(each, ast.Slice) for each in given[:-1]):
            raise self.refuse(node, "a view of a column; loop over the rows")
        if _is_whole(given[0]) and len(given) == 1:
            return owner
        offset, last = "", given[-1]
        for place, (index, size) in enumerate(zip(given, dims, strict=False)):
            if isinstance(index, ast.Slice):
                break
            value = self._index(index, size)
            rest = dims[place + 1 :]
            if value.text != "0" or not (offset or rest):
                text = value.at(_PRODUCT) if rest else value.at(_SUM)
                term = " * ".join([text, *rest])
                offset = f"{offset} + {term}" if offset else term
        if isinstance(last, ast.Slice):
            return self._slice(node, owner, kind, len(given) - 1, offset)
        if len(given) == kind.dims:
            if owner.table:
                return Value(f"{owner.table}[{offset}]", kind.element)
            return Value(f"{array}.p[{offset or '0'}]", kind.element)
        view = Array(kind.element, kind.dims - len(given))
        start = f"{array}.p + {offset}" if offset else f"{array}.p"
        shape = ", ".join(dims[len(given) :])
        return Value(f"({short_name(view)}){{{start}, {shape}}}", view)

    def _slice(
        self, node: ast.Subscript, owner: Value, kind: Array, place: int, offset: str
    ) -> Value:
        """Return a view of a part of one dimension, after `place` indices."""
        part = (
            node.slice.elts[place] if isinstance(node.slice, ast.Tuple) else node.slice
        )
        assert isinstance(part, ast.Slice)
        if part.step is not None:
            raise self.refuse(node, "a slice with a step")
        dims, array = _dims_of(owner)[place:], owner.at(_ATOM)
        low = self._index(part.lower, dims[0]) if part.lower else Value("0", INT)
        high = self._index(part.upper, dims[0]) if part.upper else Value(dims[0], INT)
        count = high.text
        if low.text != "0":
            text = low.at(_PRODUCT) if dims[1:] else low.at(_SUM)
            term = " * ".join([text, *dims[1:]])
            offset = f"{offset} + {term}" if offset else term
            count = f"{high.at(_SUM)} - {low.at(_SUM + 1)}"
        start = f"{array}.p + {offset}" if offset else f"{array}.p"
        view = Array(kind.element, kind.dims - place)
        shape = ", ".join([count, *dims[1:]])
        return Value(f"({short_name(view)}){{{start}, {shape}}}", view)

    def _call(self, node: ast.Call) -> Value:
        found = self._scope.lookup(node.func)
        if node.keywords:
            raise self.refuse(node, "an argument given by name")
        if found is None:
            raise self.refuse(node, "a call")
        if found is len:
            return self._length(node)
        special = self.library.intrinsics.get(id(found))
        given = self._arguments_of(node)
        if special is not None:
            return cast("Value", special(self, node, given))
        known = self._known_call(found, given, node)
        if known is not None:
            return known
        if isinstance(found, type) and hasattr(found, "_fields"):
            record = record_of(found)
            parts = ", ".join(
                f".{c_name(field)} = {self.as_kind(value, kind, node).text}"
                for value, (field, kind) in zip(given, record.fields, strict=True)
            )
            return Value(f"({self.library.type(record)}){{{parts}}}", record)
        function = python_function(found)
        if function is None:
            raise self.refuse(node, "a call of what is not compiled")
        if hasattr(function, "reinterprets"):
            return self._reinterpret(signature_of(function).result, given, node)
        if hasattr(function, "reinterprets_part"):
            return self._part(signature_of(function).result, given, node)
        callee = self.library.require(function)
        wanted = callee.signature.arguments
        if len(given) != len(wanted):
            raise self.refuse(node, "a default argument")
        texts = []
        for value, (name, kind) in zip(given, wanted.items(), strict=True):
            if isinstance(kind, Array) and value.kind != kind:
                raise self.refuse(
                    node,
                    f"{short_name(value.kind)} for `{name}: {short_name(kind)}`",
                )
            texts.append(self.as_kind(value, kind, node).text)
        return Value(f"{callee.name}({', '.join(texts)})", callee.signature.result)

    def _reinterpret(self, kind: Kind, given: list[Value], node: ast.Call) -> Value:
        """Return what lies at an address as a type."""
        texts = [self.as_kind(value, INT, node) for value in given]
        address = f"(intptr_t){texts[0].at(_UNARY)}"
        c = self.library.type(kind)
        if not isinstance(kind, Array):
            return Value(f"(({c}){address})", kind)
        sizes = ", ".join(text.text for text in texts[1:])
        return Value(f"({c}){{({kind.element.c} *){address}, {sizes}}}", kind)

    def _part(self, kind: Kind, given: list[Value], node: ast.Call) -> Value:
        """Return a part of an array in a shape."""
        first, *sizes = (self.as_kind(value, INT, node) for value in given[1:])
        place = f"{given[0].at(_ATOM)}.p"
        if first.text != "0":
            place = f"{place} + {first.at(_SUM)}"
        shape = ", ".join(size.text for size in sizes)
        return Value(f"({self.library.type(kind)}){{{place}, {shape}}}", kind)

    def _arguments_of(self, node: ast.Call) -> list[Value]:
        given: list[Value] = []
        for each in node.args:
            if isinstance(each, ast.Starred):
                value = self.expression(each.value)
                if not isinstance(value.kind, Structure):
                    raise self.refuse(node, "a star")
                given += [
                    Value(f"{value.at(_ATOM)}.{c_name(name)}", kind)
                    for name, kind in value.kind.fields
                ]
            elif (
                _hashable(found := self._scope.lookup(each))
                and found in NUMBERS
                and isinstance(found, type)
            ):
                given.append(Value(NUMBERS[found].c, NOTHING))
            else:
                given.append(self.expression(each))
        return given

    def _length(self, node: ast.Call) -> Value:
        known = self._scope.lookup(node.args[0])
        if isinstance(known, tuple | np.ndarray):
            return literal(len(known))
        value = self.expression(node.args[0])
        if isinstance(value.kind, Array):
            return Value(_dims_of(value)[0], INT)
        assert isinstance(value.kind, Structure)
        return literal(len(value.kind.fields))

    def _known_call(
        self, found: Any, given: list[Value], node: ast.Call
    ) -> Value | None:
        """Return the call of a function of Python or NumPy, None of another."""
        if not _hashable(found):
            return None
        kinds = [value.kind for value in given]
        real = [
            self.as_kind(value, REAL, node).text if value.kind in _NUMERIC else ""
            for value in given
        ]
        if found in (min, max, np.minimum, np.maximum):
            name = "min" if found in (min, np.minimum) else "max"
            kind = REAL if REAL in kinds or found in (np.minimum, np.maximum) else INT
            if len(given) < 2:
                raise self.refuse(node, "the least of an array")
            texts = [self.as_kind(value, kind, node).text for value in given]
            whole = texts[0]
            for text in texts[1:]:
                whole = f"{name}_{'real' if kind == REAL else 'int'}({whole}, {text})"
            return Value(whole, kind)
        if found is abs:
            if kinds[0] == REAL:
                return Value(f"fabs({given[0].text})", REAL)
            return Value(f"abs_int({given[0].text})", INT)
        if found in (float, np.float64):
            return self.as_kind(given[0], REAL, node)
        if found in (int, np.int64, np.intp):
            return self.as_kind(given[0], INT, node)
        if isinstance(found, type) and found in NUMBERS:
            return self.as_kind(given[0], NUMBERS[found], node)
        if found is np.sign:
            return Value(f"cc_sign({real[0]})", REAL)
        if found in (np.floor, np.ceil):
            return Value(f"{found.__name__}({real[0]})", REAL)
        if found in (np.argmin, np.argmax):
            return Value(f"cc_{found.__name__}({given[0].text})", INT)
        if found in _TO_INT:
            return Value(f"(int64_t){_TO_INT[found]}({real[0]})", INT, _UNARY)
        if found in _TESTS:
            return Value(f"{_TESTS[found]}({real[0]}) != 0", BOOL, _COMPARE)
        if found is np.float32:
            return Value(f"(float){given[0].at(_UNARY)}", Scalar("float"), _UNARY)
        if found is math.ldexp:
            exponent = self.as_kind(given[1], INT, node)
            return Value(f"ldexp({real[0]}, (int){exponent.at(_UNARY)})", REAL)
        if found in _MATH:
            return Value(f"{_MATH[found]}({', '.join(real)})", REAL)
        return None


_NUMERIC = (REAL, INT, BOOL, BYTE, INT32, INT8, WORD)


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _hashable(found: Any) -> bool:
    try:
        hash(found)
    except TypeError:
        return False
    return found is not None


def _plain(text: str) -> str:
    """Return a number without the comment that names it."""
    return text.partition(" /*")[0]


def _is_plain_int(text: str) -> bool:
    return _plain(text).lstrip("-").isdigit()


def _is_number_text(text: str) -> bool:
    return text.lstrip("-").replace(".", "").replace("e", "").isdigit()


def _zero(kind: Kind) -> str:
    if kind == REAL:
        return "0.0"
    if kind == BOOL:
        return "false"
    return "0" if isinstance(kind, Scalar) else "{0}"


def _dims_of(value: Value) -> list[str]:
    assert isinstance(value.kind, Array)
    owner = value.at(_ATOM)
    return [f"{owner}.{name}" for name in DIMENSIONS[: value.kind.dims]]


def _place(node: ast.expr) -> int:
    """Return a constant index, -1 where it is none."""
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, int) else -1


def _is_whole(node: ast.expr) -> bool:
    return isinstance(node, ast.Slice) and not (node.lower or node.upper or node.step)


def _size_of(value: Value) -> str:
    return " * ".join(_dims_of(value))


def _fill_of(kind: Array) -> str:
    return f"fill_{short_name(kind)}"


def _copy_of(kind: Array) -> str:
    return f"copy_{short_name(kind)}"


def _wider(a: Kind, b: Kind) -> Kind | None:
    """Return the type that holds values of two types, None where there is none."""
    if a == b:
        return a
    if isinstance(a, Scalar) and isinstance(b, Scalar) and NOTHING not in (a, b):
        for kind in (REAL, WORD, INT):
            if kind in (a, b):
                return kind
        return INT
    if (
        isinstance(a, Structure)
        and isinstance(b, Structure)
        and a.name.startswith("Tuple_")
    ):
        pairs = zip(a.fields, b.fields, strict=False)
        kinds = [_wider(x, y) for (_, x), (_, y) in pairs]
        if len(a.fields) == len(b.fields) and None not in kinds:
            return tuple_of(tuple(k for k in kinds if k is not None))
    return None
