"""Front end of the compiler: syntax trees of functions, and the base of writers.

The tree is checked against the subset in `.github/CONTRIBUTING.md`, folded and lowered.
The statements that remain are an assignment to one target, or of a call to several
names, `if`, `while`, `for` over a range, `return`, `break`, `continue` and a call.
"""

import ast
import copy
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from cc_mujoco.errors import CableError
from cc_mujoco.native._fold import Known, Scope, fold
from cc_mujoco.native._kinds import tree_of

_NODES = (
    ast.Assign, ast.AugAssign, ast.AnnAssign, ast.If, ast.For, ast.While, ast.Return,
    ast.Break, ast.Continue, ast.Expr, ast.Pass, ast.BinOp, ast.UnaryOp, ast.BoolOp,
    ast.Compare, ast.IfExp, ast.Call, ast.Constant, ast.Name, ast.Attribute,
    ast.Subscript, ast.Slice, ast.Tuple,
)  # fmt: skip


@dataclass(frozen=True)
class ReadFunction:
    """Function read from its source, ready for a writer."""

    function: types.FunctionType  # the function as Python runs it
    node: ast.FunctionDef  # its syntax tree, folded and lowered
    scope: Scope  # its global names
    doc: str  # its docstring, empty if it has none

    def refusal(self, node: ast.AST, what: str) -> CableError:
        return refusal(self.function, node, what)


def refusal(function: Any, node: ast.AST | None, what: str) -> CableError:
    """Return the error for unsupported code, with the file and line of `node`."""
    code = function.__code__
    line = getattr(node, "lineno", code.co_firstlineno)
    return CableError(
        f"{code.co_filename}:{line}: {what} in {function.__name__} is outside the "
        "subset of compiled functions; use what .github/CONTRIBUTING.md lists"
    )


def read(
    function: types.FunctionType,
    known: Known,
    constant_result: Callable[[Any], ast.Constant | None],
) -> ReadFunction:
    node = tree_of(function)
    source = ReadFunction(
        function, node, Scope(function, node), ast.get_docstring(node) or ""
    )
    if source.doc:
        del node.body[0]
    for found in ast.walk(ast.Module(node.body, [])):
        wrong = isinstance(found, ast.stmt | ast.expr) and not isinstance(found, _NODES)
        if wrong or (isinstance(found, ast.For | ast.While) and found.orelse):
            raise source.refusal(found, f"`{ast.unparse(found).splitlines()[0]}`")
        if isinstance(found, ast.Call) and found.keywords:
            raise source.refusal(found, "an argument given by name")
    fold(node, source.scope, known, constant_result)
    node.body = _Lowering(source).block(node.body)
    return source


class _Lowering:
    """Lowering of a function's statements to those that writers support."""

    def __init__(self, source: ReadFunction) -> None:
        self._source, self._count = source, 0

    def block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        return [
            ast.fix_missing_locations(ast.copy_location(lowered, statement))
            for statement in body
            for lowered in self._lowered(statement)
        ]

    def _lowered(self, node: ast.stmt) -> Iterator[ast.stmt]:
        if isinstance(node, ast.AugAssign):
            whole = ast.BinOp(_loaded(node.target), node.op, node.value)
            yield _set(node.target, whole)
        elif isinstance(node, ast.Assign):
            yield from self._assignments(node.targets, node.value)
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Tuple):
            yield from self._loop_over(node, node.iter)
        elif not isinstance(node, ast.Pass):
            if isinstance(node, ast.If | ast.For | ast.While):
                node.body, node.orelse = self.block(node.body), self.block(node.orelse)
            yield node

    def _name(self) -> ast.Name:
        self._count += 1
        return ast.Name(f"tmp{self._count}", ast.Store())

    def _assignments(
        self, targets: list[ast.expr], value: ast.expr
    ) -> Iterator[ast.stmt]:
        target = targets[0]
        if len(targets) > 1:
            name = self._name()
            yield _set(name, value)
            yield from (_set(each, _loaded(name)) for each in targets)
        elif not isinstance(target, ast.Tuple):
            yield _set(target, value)
        elif isinstance(value, ast.Tuple):
            names = [self._name() for _ in value.elts]
            yield from map(_set, names, value.elts)
            yield from map(_set, target.elts, map(_loaded, names))
        else:
            parts = [
                part if isinstance(part, ast.Name) else self._name()
                for part in target.elts
            ]
            yield _set(ast.Tuple(list(parts), ast.Store()), value)
            for one, part in zip(target.elts, parts, strict=True):
                if one is not part:
                    yield _set(one, _loaded(part))

    def _loop_over(self, node: ast.For, items: ast.Tuple) -> Iterator[ast.stmt]:
        target = node.target
        targets = target.elts if isinstance(target, ast.Tuple) else [target]
        rows = [
            item.elts if isinstance(target, ast.Tuple) and isinstance(item, ast.Tuple)
            else [item] for item in items.elts
        ]  # fmt: skip
        place, stores = self._name(), []
        for one, cells in zip(targets, zip(*rows, strict=True), strict=True):
            name = self._name()
            yield _set(name, ast.Tuple(list(cells), ast.Load()))
            item = ast.Subscript(_loaded(name), _loaded(place), ast.Load())
            stores.append(_set(one, item))
        count = ast.Constant(len(rows))
        numbers = ast.Call(ast.Name("range", ast.Load()), [count], [])
        yield ast.For(place, numbers, stores + self.block(node.body), [])


def _set(target: ast.expr, value: ast.expr) -> ast.stmt:
    return ast.Assign([target], value)


def _loaded(target: ast.expr) -> ast.expr:
    node = copy.deepcopy(target)
    node.ctx = ast.Load()  # type: ignore[attr-defined]
    return node


class Writer(ast.NodeVisitor):
    """Base of translations of one function; a language adds a method for each node."""

    def __init__(self, source: ReadFunction) -> None:
        self.source, self.scope = source, source.scope
        self.lines: list[str] = []
        self.depth = 0

    def emit(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def block(self, body: list[ast.stmt]) -> None:
        self.depth += 1
        for statement in body:
            self.visit(statement)
        self.depth -= 1

    def refuse(self, node: ast.AST, what: str = "") -> CableError:
        text = ast.unparse(node).splitlines()[0][:80]
        return self.source.refusal(node, f"{what + ': ' if what else ''}`{text}`")

    def generic_visit(self, node: ast.AST) -> Any:
        raise self.refuse(node)


def name_of(function: Any) -> str:
    module = function.__module__.rpartition(".")[2].lstrip("_")
    return f"{module}_{function.__name__.lstrip('_')}"
