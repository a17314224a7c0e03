"""Translation of compiled functions to C99.

    library = CLibrary({}, root)
    library.export("cc_step", kernel.step)
    print(library.text())

Each function is translated once, by its syntax tree and annotations; what it calls is
translated with it. Arithmetic keeps its order, so that C, compiled without contraction,
gives the bits of Python. Code outside the subset is an error with file and line.
"""

import ast
import ctypes
import math
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native._fold import Known, is_number
from cc_mujoco.native._front import Writer, name_of, read, refusal
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
    Memory,
    Scalar,
    Structure,
    UnknownTypeError,
    holds_array,
    interrupted,
    python_function,
    record_of,
    short_name,
    signature_of,
    tuple_of,
)  # fmt: skip

ATOM, UNARY, _PRODUCT, _SUM, _SHIFT, _COMPARE, _BITS, _AND, _OR, _CHOICE = range(
    10, 0, -1
)
"""Precedences of operators in C, highest first; casts are unary."""
_OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", _SUM), ast.Sub: ("-", _SUM), ast.Mult: ("*", _PRODUCT),
    ast.Div: ("/", _PRODUCT), ast.BitAnd: ("&", _BITS), ast.BitOr: ("|", _BITS),
    ast.BitXor: ("^", _BITS), ast.LShift: ("<<", _SHIFT), ast.RShift: (">>", _SHIFT),
}  # fmt: skip
_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">",
    ast.GtE: ">=",
}  # fmt: skip
KnownCall = tuple[str, tuple[Kind, ...], Kind]
"""Call of a function that is not compiled: name in C, or format of the call, with the
precedence of its argument in each field; types of arguments and result."""
_CALLS: dict[Any, KnownCall] = {
    interrupted: ("cc_interrupted", (INT,), BOOL),
} | {
    getattr(module, name): (name, (REAL, REAL), REAL)
    for module in (math, np)
    for name in (
        "exp", "log", "sqrt", "cos", "sin", "tan", "acos", "asin", "atan", "atan2",
        "expm1", "log1p", "hypot", "sinh", "cosh", "tanh", "asinh", "copysign", "fabs",
        "rint", "fmod",
    )
    if hasattr(module, name)
} | {
    np.arctan2: ("atan2", (REAL, REAL), REAL), np.arctan: ("atan", (REAL,), REAL),
    np.arccos: ("acos", (REAL,), REAL), np.sign: ("cc_sign", (REAL,), REAL),
    np.floor: ("floor", (REAL,), REAL), np.ceil: ("ceil", (REAL,), REAL),
    math.floor: ("floor_int", (REAL,), INT), math.ceil: ("ceil_int", (REAL,), INT),
    round: ("round_int", (REAL,), INT), np.float32: ("cc_single", (REAL,), REAL),
    math.ldexp: ("cc_ldexp", (REAL, INT), REAL),
    np.argmin: ("cc_argmin", (Array(REAL),), INT),
    np.isfinite: ("is_finite", (REAL,), BOOL), np.isnan: ("is_nan", (REAL,), BOOL),
    math.isfinite: ("is_finite", (REAL,), BOOL), np.isinf: ("is_inf", (REAL,), BOOL),
    math.isnan: ("is_nan", (REAL,), BOOL), math.isinf: ("is_inf", (REAL,), BOOL),
}  # fmt: skip
"""Calls of functions of Python and NumPy, by C's own or `native.h`."""
_RESERVED = frozenset(
    "auto bool break case char const continue default do double else enum extern "
    "false float for goto if inline int long register restrict return short signed "
    "sizeof static struct switch true typedef union unsigned void volatile while "
    "near far main exp log sqrt cos sin tan acos asin atan floor ceil fabs pow gamma "
    "j0 j1 jn y0 y1 yn index remainder significand scalb drem round trunc".split()
)


@dataclass(frozen=True)
class Value:
    """Expression in C, with its type and precedence."""

    text: str  # its text
    kind: Kind  # its type
    rank: int = ATOM  # precedence of its outermost operator
    number: Any = None  # its number if it is a literal, else None
    name: str = ""  # its name if it is a constant, else empty
    table: str = ""  # address of the first element of an array constant or in memory
    dims: tuple[str, ...] = ()  # sizes of an array in memory, empty if not known

    def at(self, rank: int) -> str:
        """Return the text as an operand of an operator of precedence `rank`."""
        return self.text if self.rank >= rank else f"({self.text})"

    def __format__(self, rank: str) -> str:
        """Return the text as an operand in a format string, `rank` as its format."""
        return self.at(int(rank or 0))


@dataclass
class Function:
    """Function translated to C."""

    name: str  # name in C
    signature: FunctionTypes  # types of arguments and result
    text: str = ""  # definition in C
    # Array arguments, or fields of arguments with a dot, that it may write.
    writes: set[str] = field(default_factory=set)
    # Function called, place, and arrays of this function in each of its arguments.
    calls: list[tuple[types.FunctionType, ast.Call, dict[str, set[str]]]] = field(
        default_factory=list
    )


class CLibrary:
    """Set of functions translated to C, each once."""

    is_dual = False  # whether numbers carry a derivative

    def __init__(self, known: Mapping[Any, KnownCall], root: Path) -> None:
        """Begin a library; `known` calls come on top, `root` is the sources' folder."""
        self.known, self.root = {**_CALLS, **known}, root
        self._functions: dict[types.FunctionType, Function] = {}
        self._records: dict[str, str] = {}
        self._tables: dict[tuple[bytes, str], tuple[str, str]] = {}
        self._constants: dict[str, str] = {}
        self._waiting: list[types.FunctionType] = []
        self.exports: dict[str, str] = {}

    def export(self, symbol: str, function: types.FunctionType) -> None:
        """Translate a function and export it from the library as `symbol`."""
        found = self.require(function)
        kinds = found.signature.arguments
        result = found.signature.result
        calls = "" if result == NOTHING else "return "
        self.exports[symbol] = (
            f"CC_EXPORT {self.head(symbol, found.signature)}\n{{\n"
            f"    {calls}{found.name}({', '.join(map(c_name, kinds))});\n}}\n"
        )

    def require(self, function: types.FunctionType) -> Function:
        """Return a function, queued for translation with all that it calls."""
        known = self._functions.get(function)
        if known is None:
            try:
                signature = signature_of(function)
            except UnknownTypeError as error:
                raise refusal(function, None, f"the type {error}") from None
            name = name_of(function)
            taken = {f.name for f in self._functions.values()}
            name = name + "_" if name in taken else name
            known = self._functions[function] = Function(name, signature)
            self._waiting.append(function)
        return known

    def translate(self) -> list[Function]:
        errors = []
        while self._waiting:
            function = self._waiting.pop()
            try:
                self.write(function, self._functions[function])
            except CableError as error:
                errors.append(str(error))
        if errors:
            raise CableError("\n".join(sorted(errors)))
        order: dict[types.FunctionType, bool] = {}
        for function in self._functions:
            if function not in order:
                self._put(function, order)
        return [self._functions[function] for function in order]

    def write(self, function: types.FunctionType, as_: Function) -> None:
        FunctionWriter(self, function, as_).write()

    def _put(self, function: types.FunctionType, order: dict[Any, bool]) -> None:
        """Order a function behind those that it calls, and add their writes to its."""
        one = self._functions[function]
        order[function] = False
        for callee, node, given in one.calls:
            if callee not in order:
                self._put(callee, order)
            elif not order[callee]:
                raise refusal(function, node, "a call that ends in the function itself")
            for written in self._functions[callee].writes:
                name, dot, part = written.partition(".")
                one.writes |= {f"{path}{dot}{part}" for path in given[name]}
        order[function] = True
        order[function] = order.pop(function)

    def type(self, kind: Kind) -> str:
        """Return the C type of a kind; declare it if it is a structure."""
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

    def head(self, name: str, signature: FunctionTypes) -> str:
        given = [f"{self.type(k)} {c_name(n)}" for n, k in signature.arguments.items()]
        head = f"{self.type(signature.result)} {name}({', '.join(given) or 'void'})"
        if len(head) > 80:
            return head.replace("(", "(\n    ", 1).replace(", ", ",\n    ")
        return head

    def constant(self, text: str, name: str) -> str:
        """Return the name of a macro for a number: `name`, with a suffix if taken."""
        text = f"({text})" if text[0] == "-" else text
        free = next(n for n in _names(name) if self._constants.get(n, text) == text)
        self._constants[free] = text
        return free

    def cell(self, found: Any) -> str:
        """Return the text of a number in a table of constants."""
        return literal(found).text

    def zero(self, kind: Kind) -> str:
        return "0" if isinstance(kind, Scalar) else "{0}"

    def table(self, found: np.ndarray[Any, Any], label: str) -> Value:
        element = NUMBERS[found.dtype.type]
        key = found.tobytes(), f"{element.c}{found.shape}"
        if key not in self._tables:
            taken = {name for name, _ in self._tables.values()}
            names = _names(f"TABLE_{label.lstrip('_').upper()}")
            name = next(each for each in names if each not in taken)
            cells = ", ".join(map(self.cell, found.ravel().tolist()))
            head = f"static const {self.type(element)} {name}[{max(found.size, 1)}]"
            self._tables[key] = name, f"{head} = {{{cells or 0}}};\n"
        name, kind = self._tables[key][0], Array(element, found.ndim)
        shape = ", ".join(map(str, found.shape))
        start = f"({self.type(element)} *){name}"
        text = f"({short_name(kind)}){{{start}, {shape}}}"
        return Value(text, kind, table=name)

    def text(self) -> str:
        return "\n".join([self.inner_text(), *self.exports.values()])

    def inner_text(self) -> str:
        functions = self.translate()
        tables = [text for _, text in self._tables.values()]
        texts = [function.text for function in functions]
        named = [f"#define {name} {text}" for name, text in self._constants.items()]
        return "\n".join([*named, "", *self._records.values(), *tables, *texts])


def _names(base: str) -> Iterator[str]:
    yield base
    yield from (f"{base}_{k}" for k in count(2))


def literal(found: Any) -> Value:
    if isinstance(found, bool):
        return Value("true" if found else "false", BOOL, ATOM, found)
    kind, text = REAL, repr(float(found))
    if isinstance(found, int | np.integer):
        kind, text = INT, str(int(found))
        text = f"INT64_C({text})" if abs(int(found)) >= 2**31 else text
    elif math.isnan(found):
        text = "NAN"
    elif math.isinf(found):
        text = "INFINITY" if found > 0 else "-INFINITY"
    return Value(text, kind, UNARY if text[0] == "-" else ATOM, found)


def c_name(name: str) -> str:
    """Return a name, with an underscore if it is reserved in C or its libraries."""
    return f"{name}_" if name in _RESERVED else name


def _wide(kind: Kind) -> Kind:
    """Return the C type of a variable for a value: small integers are widened."""
    return INT if kind in (BYTE, INT32, INT8) else kind


def _wider(a: Kind, b: Kind) -> Kind | None:
    """Return the C type that holds values of both types; None if there is none."""
    if a == b:
        return a
    if isinstance(a, Scalar) and isinstance(b, Scalar) and NOTHING not in (a, b):
        address = next((k for k in (a, b) if isinstance(k, Memory)), INT)
        return next((kind for kind in (REAL, WORD) if kind in (a, b)), address)
    return None


def _dims_of(value: Value) -> list[str]:
    assert isinstance(value.kind, Array)
    return list(value.dims) or [
        f"{value.at(ATOM)}.{name}"
        for name in ("n", "columns", "layers")[: value.kind.dims]
    ]


def _is_whole(node: ast.expr) -> bool:
    return isinstance(node, ast.Slice) and not (node.lower or node.upper or node.step)


def _variables(node: ast.AST, loops: frozenset[str] = frozenset()) -> Iterator[str]:
    if isinstance(node, ast.Name):
        if node.id not in loops or isinstance(node.ctx, ast.Store):
            yield node.id
    elif isinstance(node, ast.For):
        assert isinstance(node.target, ast.Name)
        if node.target.id in loops:
            yield node.target.id
        yield from _variables(node.iter, loops)
        for statement in node.body:
            yield from _variables(statement, loops | {node.target.id})
    else:
        for child in ast.iter_child_nodes(node):
            yield from _variables(child, loops)


class FunctionWriter(Writer):
    """Translation of one function to C, in rounds until its types are settled."""

    def __init__(
        self, library: CLibrary, function: types.FunctionType, as_: Function
    ) -> None:
        super().__init__(read(function, Known(), lambda found: None))
        self.library, self._as = library, as_
        self._arguments = as_.signature.arguments
        self._kinds: dict[str, Kind] = {}
        views = [n for n, kind in self._arguments.items() if holds_array(kind)]
        self._paths = {name: {name} for name in views}
        variables = set(_variables(self.source.node))
        self._variables = variables | self._arguments.keys()

    # Whole function

    def write(self) -> None:
        before: Any = None
        while before != (self._kinds, self._paths):
            before = dict(self._kinds), {n: set(p) for n, p in self._paths.items()}
            self.lines, self._count = [], 0
            self._storage: list[str] = []
            self._as.calls, self._as.writes = [], set()
            self.block(self.source.node.body)
        loaded = {
            n.id
            for n in ast.walk(self.source.node)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
        }
        local = [n for n in self._kinds if n in self._variables and n != "_"]
        variables = [
            f"    {self.library.type(self._kinds[n])} {c_name(n)} = "
            f"{self.library.zero(self._kinds[n])};"
            for n in local
        ]
        unused = [n for n in [*self._arguments, *local] if n not in loaded]
        silence = [f"    (void){c_name(n)};" for n in unused]
        inlined = hasattr(self.source.function, "inlined")
        head = self.library.head(self._as.name, self._as.signature)
        head = f"{'CC_ALWAYS_INLINE' if inlined else 'static'} {head}"
        body = [*variables, *self._storage, *silence, *self.lines]
        self._as.text = "\n".join([self._comment(), head, "{", *body, "}", ""])

    def _comment(self) -> str:
        code = self.source.function.__code__
        path = Path(code.co_filename)
        inside = path.is_relative_to(self.library.root)
        place = path.relative_to(self.library.root) if inside else Path(path.name)
        doc = self.source.doc.replace("*/", "* /")
        lines = [*doc.splitlines(), ""] if doc else []
        lines.append(f"{place.as_posix()}:{code.co_firstlineno}")
        return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"])

    # Values

    def _temporary(self, stem: str) -> str:
        self._count += 1
        return f"{stem}{self._count}_"

    def _kind(self, name: str) -> Kind | None:
        return self._arguments.get(name) or self._kinds.get(name)

    def _declare(self, name: str, kind: Kind, node: ast.AST) -> Kind:
        """Record the type of a variable, widened if needed, and return it."""
        present = self._kind(name)
        wider = _wider(_wide(present), _wide(kind)) if present else _wide(kind)
        is_given = name in self._arguments
        if wider is None or (is_given and wider != _wide(present or kind)):
            raise self.refuse(node, f"{name} changes its type to {kind}")
        if not is_given:
            self._kinds[name] = wider
        return wider

    def as_kind(self, value: Value, kind: Kind, node: ast.AST) -> Value:
        if value.kind == kind:
            return value
        scalars = isinstance(kind, Scalar) and isinstance(value.kind, Scalar)
        if not scalars or NOTHING in (kind, value.kind):
            what = f"{short_name(value.kind)} where {short_name(kind)} is due"
            raise self.refuse(node, what)
        if kind == BOOL:
            return Value(f"{value.at(_COMPARE + 1)} != 0", BOOL, _COMPARE)
        if kind == REAL and value.number is not None and not value.name:
            return literal(float(value.number))
        return Value(f"({self.library.type(kind)}){value.at(UNARY)}", kind, UNARY)

    def _typed(self, node: ast.expr, kind: Kind) -> Value:
        """Return an expression converted to a type; a tuple field by field."""
        if isinstance(node, ast.Tuple) and isinstance(kind, Structure):
            if len(node.elts) == len(kind.fields):
                pairs = zip(node.elts, kind.fields, strict=True)
                parts = [self._typed(part, each) for part, (_, each) in pairs]
                return self._record(parts, node, kind)
        return self.as_kind(self.visit(node), kind, node)

    def _record(
        self, parts: list[Value], node: ast.AST, kind: Structure | None = None
    ) -> Value:
        """Return a C structure of these values, by default of their own types."""
        kind = kind or tuple_of(tuple(_wide(part.kind) for part in parts))
        text = ", ".join(
            f".{c_name(name)} = {self.as_kind(part, each, node).text}"
            for part, (name, each) in zip(parts, kind.fields, strict=True)
        )
        return Value(f"({self.library.type(kind)}){{{text}}}", kind)

    def plain(self, value: Value) -> Value:
        """Return a value as a plain number, for comparisons and decisions."""
        return value

    def _truth(self, node: ast.expr) -> Value:
        return self.plain(self._scalar(node, "the truth of an array"))

    def _scalar(self, node: ast.expr, what: str) -> Value:
        value: Value = self.visit(node)
        if not isinstance(value.kind, Scalar):
            raise self.refuse(node, what)
        return value

    # Arrays of arguments that are written

    def _paths_of(self, node: ast.expr) -> set[str]:
        """Return the arguments, or their fields, that an expression may view."""
        if isinstance(node, ast.Name):
            return self._paths.get(node.id, set())
        if isinstance(node, ast.Attribute):
            return {p if "." in p or not p else f"{p}.{node.attr}"
                    for p in self._paths_of(node.value)}  # fmt: skip
        if isinstance(node, ast.Subscript):
            return self._paths_of(node.value)
        parts = [node.body, node.orelse] if isinstance(node, ast.IfExp) else []
        parts += getattr(node, "args", []) + getattr(node, "elts", [])
        return {path for part in parts for path in self._paths_of(part)}

    # Statements

    def visit_If(self, node: ast.If) -> None:
        other: list[ast.stmt] = [node]
        head = "if"
        while len(other) == 1 and isinstance(one := other[0], ast.If):
            self._begin(head, one)
            head, other = "} else if", one.orelse
        if other:
            self.emit("} else {")
            self.block(other)
        self.emit("}")

    def visit_While(self, node: ast.While) -> None:
        self._begin("while", node)
        self.emit("}")

    def _begin(self, head: str, node: ast.If | ast.While) -> None:
        test = self._truth(node.test).text
        self.emit(f"{head} ({test}) {{")
        self.block(node.body)

    def visit_For(self, node: ast.For) -> None:
        call = node.iter
        if not isinstance(call, ast.Call) or self.scope.lookup(call.func) is not range:
            raise self.refuse(node, "a loop that is not over a range")
        assert isinstance(node.target, ast.Name)
        name, bounds = node.target.id, [self._typed(each, INT) for each in call.args]
        start = bounds[0].text if len(bounds) > 1 else "0"
        stop, step = bounds[min(len(bounds), 2) - 1], 1
        if len(bounds) > 2:
            step = bounds[2].number
        if not step:
            raise self.refuse(node, "a step that is no number")
        is_variable = name in self._variables or name == "_"
        counter = self._temporary("k") if is_variable else c_name(name)
        first = f"int64_t {counter} = {start}"
        if not self._is_steady(call.args[min(len(bounds), 2) - 1], node.body):
            end = self._temporary("end")
            first, stop = f"{first}, {end} = {stop.text}", Value(end, INT)
        test = f"{counter} {'>' if step < 0 else '<'} {stop.at(_COMPARE + 1)}"
        sign = {1: "++", -1: "--"}.get(step, f" += {step}")
        self.emit(f"for ({first}; {test}; {counter}{sign}) {{")
        if not is_variable:
            self._kinds[name] = INT
        elif name != "_":
            self._declare(name, INT, node)
            self.emit(f"    {c_name(name)} = {counter};")
        self.block(node.body)
        self.emit("}")

    def _is_steady(self, node: ast.expr, body: list[ast.stmt]) -> bool:
        stored = {
            n.id
            for n in ast.walk(ast.Module(body, []))
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        return not any(
            isinstance(n, ast.Call)
            or (isinstance(n, ast.Name) and n.id in stored)
            or (isinstance(n, ast.Name) and isinstance(self._kind(n.id), Memory))
            or (isinstance(n, ast.Subscript) and not _is_shape(n.value))
            for n in ast.walk(node)
        )

    def visit_Return(self, node: ast.Return) -> None:
        empty = node.value is None or getattr(node.value, "value", 0) is None
        if empty or node.value is None:
            self.emit("return;")
            return
        result = self._as.signature.result
        if holds_array(result) and "" in self._paths_of(node.value):
            raise self.refuse(node, "an array of its own that is returned")
        self.emit(f"return {self._typed(node.value, result).text};")

    def visit_Expr(self, node: ast.Expr) -> None:
        value: Value = self.visit(node.value)
        self.emit(f"{'' if value.kind == NOTHING else '(void)'}{value.text};")

    def visit_Break(self, node: ast.stmt) -> None:
        self.emit(f"{ast.unparse(node)};")

    visit_Continue = visit_Break

    def visit_Assign(self, node: ast.Assign) -> None:
        target, given = node.targets[0], node.value
        if isinstance(target, ast.Tuple):
            self._unpack(target, given)
        elif not isinstance(target, ast.Name):
            self._store(target, given)
        elif not self._allocate(target.id, given):
            kind = self._kind(target.id)
            is_record = isinstance(kind, Structure)
            value = self._typed(given, kind) if kind and is_record else None
            self._set(target.id, value or self.visit(given), given)

    def _set(self, name: str, value: Value, node: ast.expr) -> None:
        kind = self._declare(name, value.kind, node)
        if holds_array(kind):
            self._paths.setdefault(name, set()).update(self._paths_of(node))
        self.emit(f"{c_name(name)} = {self.as_kind(value, kind, node).text};")

    def _unpack(self, target: ast.Tuple, given: ast.expr) -> None:
        value: Value = self.visit(given)
        kind = value.kind
        if not isinstance(kind, Structure):
            raise self.refuse(given, "unpacking what is no tuple")
        if not value.text.isidentifier():
            name = self._temporary("t")
            self.emit(f"const {self.library.type(kind)} {name} = {value.text};")
            value = replace(value, text=name)
        for one, (part, each) in zip(target.elts, kind.fields, strict=True):
            assert isinstance(one, ast.Name)
            if one.id != "_":
                item = Value(f"{value.text}.{c_name(part)}", each)
                self._set(one.id, item, given)

    def _allocate(self, name: str, call: ast.expr) -> bool:
        maker = self.scope.lookup(call.func) if isinstance(call, ast.Call) else None
        if maker is not np.empty and maker is not np.zeros:
            return False
        assert isinstance(call, ast.Call)
        shape, element = call.args[0], REAL
        if len(call.args) > 1:
            element = NUMBERS[self.scope.lookup(call.args[1])]
        dims = shape.elts if isinstance(shape, ast.Tuple) else [shape]
        if not all(isinstance(each, ast.Constant) for each in dims):
            what = "an array whose size is no constant; have the caller give it"
            raise self.refuse(call, what)
        sizes = [self._typed(each, INT).text for each in dims]
        kind, place = Array(element, len(sizes)), self._temporary(name)
        self._declare(name, kind, call)
        self._paths.setdefault(name, set()).add("")
        cell = self.library.type(element)
        self._storage.append(f"    {cell} {place}[{' * '.join(sizes)}];")
        text = f"({self.library.type(kind)}){{{place}, {', '.join(sizes)}}}"
        self.emit(f"{c_name(name)} = {text};")
        if maker is np.zeros:
            self.emit(f"memset({place}, 0, sizeof {place});")
        return True

    def _store(self, target: ast.expr, given: ast.expr) -> None:
        if isinstance(target, ast.Attribute):
            place = self.visit_Attribute(target)
        elif isinstance(target, ast.Subscript):
            place = self.visit_Subscript(target)
            self._as.writes |= self._paths_of(target.value) - {""}
        else:
            raise self.refuse(target, "a target")
        if isinstance(place.kind, Array):
            name, source = short_name(place.kind), self.visit(given)
            if source.kind == place.kind:
                self.emit(f"copy_{name}({place.text}, {source.text});")
            else:
                value = self.as_kind(source, place.kind.element, given).text
                self.emit(f"fill_{name}({place.text}, {value});")
        else:
            self.emit(f"{place.text} = {self._typed(given, place.kind).text};")

    # Expressions

    def visit_Constant(self, node: ast.Constant) -> Value:
        return self._constant(node.value, node)

    def _constant(self, found: Any, node: ast.expr) -> Value:
        if isinstance(found, LoadedInt):
            return Value(found.c, INT)
        if is_number(found) or isinstance(found, np.floating | np.integer):
            value, name = literal(found), getattr(node, "named", "")
            if not name or not math.isfinite(found):
                return value
            text = self.library.constant(value.text, name)
            return replace(value, text=text, rank=ATOM, name=name)
        if isinstance(found, np.ndarray) and found.dtype.type in NUMBERS:
            label = "DATA" if isinstance(node, ast.Constant) else ast.unparse(node)
            return self.library.table(found, label.rpartition(".")[2])
        if isinstance(found, str):
            return self.library.table(np.frombuffer(found.encode(), np.uint8), "TEXT")
        if isinstance(found, tuple):
            parts = [self._constant(each, ast.Constant(each)) for each in found]
            is_named = hasattr(found, "_fields")
            whole = record_of(type(found)) if is_named else None
            return self._record(parts, node, whole)
        raise self.refuse(node, f"a constant of the type {type(found).__name__}")

    def visit_Name(self, node: ast.Name) -> Value:
        kind = self._kind(node.id)
        if kind is not None:
            return Value(c_name(node.id), kind)
        found = self.scope.lookup(node)
        if found is None:
            raise self.refuse(node, "an unknown name")
        return self._constant(found, node)

    def visit_Attribute(self, node: ast.Attribute) -> Value:
        found = self.scope.lookup(node)
        if found is not None:
            return self._constant(found, node)
        if node.attr == "data" and isinstance(node.value, ast.Attribute):
            owner = self.visit(node.value.value)
            self._as.writes |= self._paths_of(node.value.value) - {""}
            first = owner.table if owner.dims else f"{owner.text}.p"
            return Value(f"(int64_t)(intptr_t){first}", INT, UNARY)
        owner = self.visit(node.value)
        if isinstance(owner.kind, Memory):
            return self._field(owner, owner.kind, node)
        if isinstance(owner.kind, Structure):
            to = "->" if owner.kind.is_pointer else "."
            text = f"{owner.at(ATOM)}{to}{c_name(node.attr)}"
            return Value(text, owner.kind.kind_of(node.attr))
        if isinstance(owner.kind, Array) and node.attr == "size":
            rank = ATOM if owner.kind.dims == 1 else _PRODUCT
            return Value(" * ".join(_dims_of(owner)), INT, rank)
        raise self.refuse(node, "an attribute")

    def _field(self, owner: Value, kind: Memory, node: ast.Attribute) -> Value:
        """Return a field of a structure in memory: a number, array or structure."""
        fields: dict[str, Any] = {each[0]: each[1] for each in kind.layout._fields_}
        found, name = fields[node.attr], f"{kind.name}.{node.attr}"
        if issubclass(found, ctypes.Structure):
            return replace(owner, kind=replace(kind, name=name, layout=found))
        offset = self._constant(kind.place(name), node).text
        at = f"(intptr_t)({owner.at(_SUM)} + {offset})"
        if found in NUMBERS:
            element = NUMBERS[found]
            return Value(f"(*({element.c} *){at})", element)
        # An array behind a pointer has no size in the structure.
        sizes: tuple[str, ...] = (str(getattr(found, "_length_", "")),)
        to = found._type_
        if issubclass(to, ctypes.Structure):
            inner = Array(replace(kind, name=to.__name__, layout=to))
            return Value("", inner, table=f"*(int64_t *){at}", dims=sizes)
        if issubclass(to, ctypes.Array):
            sizes, to = (*sizes, str(to._length_)), to._type_
        array = Array(NUMBERS[to], len(sizes))
        if not sizes[0]:
            first = f"(*({array.element.c} *const *){at})"
            return Value("", array, table=first, dims=sizes)
        first = f"(({array.element.c} *){at})"
        return replace(self._view(array, [first, *sizes]), table=first, dims=sizes)

    def visit_Tuple(self, node: ast.Tuple) -> Value:
        return self._record([self.visit(each) for each in node.elts], node)

    def visit_IfExp(self, node: ast.IfExp) -> Value:
        body, other = self.visit(node.body), self.visit(node.orelse)
        kind = _wider(_wide(body.kind), _wide(other.kind))
        if kind is None:
            raise self.refuse(node, "two types")
        test = self._truth(node.test).at(_CHOICE + 1)
        body, other = (self.as_kind(each, kind, node) for each in (body, other))
        text = f"{test} ? {body.at(_CHOICE + 1)} : {other.at(_CHOICE)}"
        return Value(text, kind, _CHOICE)

    def visit_BoolOp(self, node: ast.BoolOp) -> Value:
        sign, rank = ("&&", _AND) if isinstance(node.op, ast.And) else ("||", _OR)
        # Clear of the warning on `&&` within `||`.
        texts = [self._truth(each).at(_AND + 1) for each in node.values]
        return Value(f" {sign} ".join(texts), BOOL, rank)

    def visit_Compare(self, node: ast.Compare) -> Value:
        sides = [
            self._scalar(each, "a comparison")
            for each in [node.left, *node.comparators]
        ]
        parts = []
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if type(op) not in _COMPARISONS:
                raise self.refuse(node, "a comparison")
            if REAL in (left.kind, right.kind):
                left, right = (self.as_kind(e, REAL, node) for e in (left, right))
            left, right = self.plain(left), self.plain(right)
            sign, least = _COMPARISONS[type(op)], _COMPARE + 1
            parts.append(f"{left.at(least)} {sign} {right.at(least)}")
        return Value(" && ".join(parts), BOOL, _COMPARE if len(parts) == 1 else _AND)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Value:
        value = self._scalar(node.operand, "arithmetic of arrays")
        if isinstance(node.op, ast.Not):
            return Value(f"!{self.plain(value).at(UNARY)}", BOOL, UNARY)
        if not isinstance(node.op, ast.USub):
            raise self.refuse(node, "an operator")
        return self.negative(value)

    def negative(self, value: Value) -> Value:
        kind, text = INT if value.kind == BOOL else _wide(value.kind), value.at(UNARY)
        return Value("-" + (f"({text})" if text[0] == "-" else text), kind, UNARY)

    def visit_BinOp(self, node: ast.BinOp) -> Value:
        left = self._scalar(node.left, "arithmetic of arrays")
        right = self._scalar(node.right, "arithmetic of arrays")
        kind: Kind = _wider(_wider(left.kind, right.kind) or INT, INT) or INT
        op = type(node.op)
        if op is ast.Pow:
            return self._power(node, left, right)
        kind = REAL if op is ast.Div else kind
        left, right = self.as_kind(left, kind, node), self.as_kind(right, kind, node)
        if op is ast.FloorDiv and kind == REAL:
            raise self.refuse(node, "a quotient rounded down; use math.floor")
        if op is ast.FloorDiv or op is ast.Mod:
            name = "floor_div" if op is ast.FloorDiv else "floor_mod"
            name += "_real" if kind == REAL else ""
            return Value(f"{name}({left.text}, {right.text})", kind)
        if op not in _OPERATORS:
            raise self.refuse(node, "an operator")
        return self.operation(op, kind, left, right)

    def operation(
        self, op: type[ast.operator], kind: Kind, left: Value, right: Value
    ) -> Value:
        sign, rank = _OPERATORS[op]
        least = rank if rank in (_SUM, _PRODUCT) else UNARY
        return Value(f"{left.at(least)} {sign} {right.at(least + 1)}", kind, rank)

    def _power(self, node: ast.BinOp, left: Value, right: Value) -> Value:
        if right.kind == INT and right.number == 2:
            name = "cc_square" if left.kind == REAL else "cc_square_int"
            return Value(f"{name}({left.text})", left.kind)
        if right.kind != REAL:
            raise self.refuse(node, "a power of an integer; multiply")
        return Value(f"pow({self.as_kind(left, REAL, node).text}, {right.text})", REAL)

    def visit_Subscript(self, node: ast.Subscript) -> Value:
        place = node.slice.value if isinstance(node.slice, ast.Constant) else None
        if _is_shape(node.value):
            assert isinstance(node.value, ast.Attribute)
            dims = _dims_of(self.visit(node.value.value))
            if not isinstance(place, int) or not 0 <= place < len(dims):
                raise self.refuse(node, "a shape of a FloatArray; say FloatMatrix")
            return Value(dims[place], INT)
        found = self.scope.lookup(node)
        if found is not None:
            return self._constant(found, node)
        owner = self.visit(node.value)
        if isinstance(owner.kind, Array):
            return self._element(node, owner, owner.kind)
        if not isinstance(owner.kind, Structure):
            raise self.refuse(node, "an index of a number")
        parts = [(f"{owner.at(ATOM)}.{c_name(n)}", k) for n, k in owner.kind.fields]
        if isinstance(place, int):
            return Value(*parts[place])
        known = self.scope.lookup(node.value)
        if isinstance(known, tuple):
            cells = [self._constant(each, ast.Constant(each)) for each in known]
            parts = [(cell.text, cell.kind) for cell in cells]
        if len({kind for _, kind in parts}) != 1:
            raise self.refuse(node, "a variable index of a tuple of several types")
        text = ", ".join(text for text, _ in parts)
        kind, at = parts[0][1], self._typed(node.slice, INT).text
        return Value(f"((const {self.library.type(kind)}[]){{{text}}})[{at}]", kind)

    def _element(self, node: ast.Subscript, owner: Value, kind: Array) -> Value:
        """Return an element of an array, or a view of part of it."""
        given = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        while len(given) > 1 and _is_whole(given[-1]):
            given = given[:-1]
        dims, last = _dims_of(owner), given[-1]
        if len(given) > kind.dims:
            raise self.refuse(node, "two indices of a FloatArray; say FloatMatrix")
        if any(isinstance(each, ast.Slice) for each in given[:-1]):
            raise self.refuse(node, "a view of a column; loop over the rows")
        terms = []
        for place, index in enumerate(given):
            first = index.lower if isinstance(index, ast.Slice) else index
            value = self._typed(first, INT) if first else literal(0)
            if value.number is not None and value.number < 0:
                raise self.refuse(node, "an index from the end; subtract from the size")
            rest = dims[place + 1 :]
            if value.number != 0:
                text = value.at(_PRODUCT if rest else _SUM)
                terms.append(" * ".join([text, *rest]))
        start = " + ".join(terms)
        shape = dims[len(given) :]
        if isinstance(last, ast.Slice):
            if last.step is not None:
                raise self.refuse(node, "a slice with a step")
            if _is_whole(last) and not start:
                return owner
            end = Value(dims[len(given) - 1], INT)
            end = self._typed(last.upper, INT) if last.upper else end
            if last.lower and value.number != 0:
                text = f"{end.at(_SUM)} - {value.at(_SUM + 1)}"
                end = Value(text, INT, _SUM)
            shape = [end.text, *shape]
        elif not shape and isinstance(kind.element, Memory):
            size = self._constant(kind.element.place(kind.element.name), node).text
            text = f"{owner.table} + {size} * ({start or '0'})"
            return Value(text, kind.element, _SUM)
        elif not shape:
            table = owner.table or f"{owner.at(ATOM)}.p"
            return Value(f"{table}[{start or '0'}]", kind.element)
        begin = owner.table if owner.dims else f"{owner.at(ATOM)}.p"
        begin += f" + {start}" if start else ""
        return self._view(Array(kind.element, len(shape)), [begin, *shape])

    def _view(self, kind: Kind, parts: list[str]) -> Value:
        return Value(f"({self.library.type(kind)}){{{', '.join(parts)}}}", kind)

    def visit_Call(self, node: ast.Call) -> Value:
        found = self.scope.lookup(node.func)
        if found is None:
            raise self.refuse(node, "a call")
        if found is len:
            return self._length(node)
        if isinstance(found, type) and hasattr(found, "_fields"):
            return self._typed(ast.Tuple(node.args, ast.Load()), record_of(found))
        function = python_function(found)
        views = getattr(function, "views", "")
        is_known = callable(found) and found in self.library.known
        if function is not None and not is_known and not views:
            return self._compiled_call(function, node)
        given = [self.visit(each) for each in node.args]
        if function is None or is_known:
            return self._known_call(found, given, node)
        result = signature_of(function).result
        if views == "memory":
            at, *sizes = (self.as_kind(value, INT, node) for value in given)
            c = self.library.type(result)
            if not isinstance(result, Array):
                return Value(f"(({c})(intptr_t){at.at(UNARY)})", result)
            start = f"({result.element.c} *)(intptr_t){at.at(UNARY)}"
            return self._view(result, [start, *(size.text for size in sizes)])
        first, *sizes = (self.as_kind(value, INT, node) for value in given[1:])
        start = f"{given[0].at(ATOM)}.p"
        start += "" if first.number == 0 else f" + {first.at(_SUM)}"
        return self._view(result, [start, *(size.text for size in sizes)])

    def _compiled_call(self, function: types.FunctionType, node: ast.Call) -> Value:
        callee = self.library.require(function)
        wanted = callee.signature.arguments
        if len(node.args) != len(wanted):
            raise self.refuse(node, "a default argument")
        texts = [
            self._typed(part, kind).text
            for part, kind in zip(node.args, wanted.values(), strict=True)
        ]
        views = map(self._paths_of, node.args)
        paths = {n: v - {""} for n, v in zip(wanted, views, strict=True)}
        self._as.calls.append((function, node, paths))
        return Value(f"{callee.name}({', '.join(texts)})", callee.signature.result)

    def _length(self, node: ast.Call) -> Value:
        known = self.scope.lookup(node.args[0])
        if isinstance(known, tuple | np.ndarray):
            return literal(len(known))
        value = self.visit(node.args[0])
        if isinstance(value.kind, Structure):
            return literal(len(value.kind.fields))
        return Value(_dims_of(value)[0], INT)

    def _known_call(self, found: Any, given: list[Value], node: ast.Call) -> Value:
        if callable(found) and found in self.library.known:
            text, wanted, result = self.library.known[found]
            pairs = zip(given, wanted, strict=False)
            values = [self.as_kind(value, kind, node) for value, kind in pairs]
            if "(" not in text:
                return Value(f"{text}({', '.join(v.text for v in values)})", result)
            return Value(text.format(*values), result, UNARY)
        if found in (min, max) and len(given) > 1:
            kind = REAL if any(value.kind == REAL for value in given) else INT
            texts = [self.as_kind(value, kind, node).text for value in given]
            whole = texts[0]
            for text in texts[1:]:
                suffix = "real" if kind == REAL else "int"
                whole = f"{found.__name__}_{suffix}({whole}, {text})"
            return Value(whole, kind)
        if found is abs:
            kind = REAL if given[0].kind == REAL else INT
            name = "fabs" if kind == REAL else "abs_int"
            return Value(f"{name}({self.as_kind(given[0], kind, node).text})", kind)
        if isinstance(found, type) and found in NUMBERS:
            return self.as_kind(given[0], NUMBERS[found], node)
        raise self.refuse(node, "a call of what is not compiled")


def _is_shape(node: ast.expr) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "shape"
