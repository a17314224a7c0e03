"""Constant folding of compiled functions, which removes terms that are off.

A function of `cc_mujoco.cable` asks at run time which terms a cable has. On a GPU the
answer is compiled in: entries of `prm` and `values` with a known value are replaced by
it, and branches that it decides are removed. The order of all other operations stays.
"""

import ast
import copy
import operator
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cc_mujoco.native._kinds import LoadedInt

_FOLDED: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt,
    ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
}  # fmt: skip


@dataclass(frozen=True)
class Known:
    """Values that are known at compile time.

    Attributes:
        packed: entries of packed parameters, by index.
        arguments: arguments of functions, by name.
        constants: values that replace those of constants of modules, by name.
    """

    packed: Mapping[int, float] = field(default_factory=dict)
    arguments: Mapping[str, int] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)


class Scope:
    """Global names that one function uses, and the objects they refer to."""

    def __init__(self, function: types.FunctionType, node: ast.FunctionDef) -> None:
        self._globals = function.__globals__
        self._local = {a.arg for a in node.args.args}
        for found in ast.walk(node):
            if isinstance(found, ast.Name) and isinstance(found.ctx, ast.Store):
                self._local.add(found.id)

    def full_name(self, node: ast.expr, name: str) -> str:
        """Return the name of a constant, qualified by the module it is used from."""
        owner = self.lookup(node.value) if isinstance(node, ast.Attribute) else None
        module = getattr(owner, "__name__", self._globals["__name__"])
        return f"{module.rpartition('.')[2].strip('_')}_{name.strip('_')}".upper()

    def lookup(self, node: ast.expr) -> Any:
        """Return the global object that an expression names, or None."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name) and node.id not in self._local:
            builtin = self._globals["__builtins__"]
            names = builtin if isinstance(builtin, dict) else vars(builtin)
            return self._globals.get(node.id, names.get(node.id))
        if isinstance(node, ast.Attribute):
            return getattr(self.lookup(node.value), node.attr, None)
        if isinstance(node, ast.Subscript):
            owner, index = self.lookup(node.value), self.lookup(node.slice)
            if isinstance(owner, tuple) and isinstance(index, int):
                return owner[index]
        return None


def _separate(node: ast.Assign) -> list[ast.stmt] | None:
    """Return `a = c` and `b = d` for `a, b = c, d`; None if `d` depends on `a`."""
    target, value = node.targets[0], node.value
    if not isinstance(target, ast.Tuple) or not isinstance(value, ast.Tuple):
        return None
    written: set[str] = set()
    parts: list[ast.stmt] = []
    for one, given in zip(target.elts, value.elts, strict=True):
        read = [given, one.slice] if isinstance(one, ast.Subscript) else [given]
        names = {n.id for e in read for n in ast.walk(e) if isinstance(n, ast.Name)}
        if names & written:
            return None
        owner = one.value if isinstance(one, ast.Subscript) else one
        written.add(ast.unparse(owner))
        parts.append(ast.Assign(targets=[one], value=given, lineno=node.lineno))
    return parts


def is_number(found: Any) -> bool:
    return isinstance(found, bool | int | float) and not isinstance(found, LoadedInt)


def fold(
    node: ast.FunctionDef,
    scope: Scope,
    known: Known,
    constant_result: Callable[[Any], ast.Constant | None],
) -> ast.FunctionDef:
    """Fold constants in a function, in place, until nothing changes.

    `known` are values known at compile time. `constant_result` returns the constant
    that another function always returns, or None.
    """
    names = {a.arg for a in node.args.args}
    constants = {
        name: ast.Constant(value)
        for name, value in known.arguments.items()
        if name in names
    }
    while True:
        folder = _Folder(scope, known, constants, constant_result)
        node.body = folder.statements(node.body)
        found = _single_constants(node, names)
        if found.keys() <= constants.keys():
            return node
        constants = constants | found


def _single_constants(
    node: ast.FunctionDef, parameters: set[str]
) -> dict[str, ast.Constant]:
    stores: dict[str, int] = {}
    values: dict[str, ast.Constant] = {}
    for found in ast.walk(node):
        if isinstance(found, ast.Name) and isinstance(found.ctx, ast.Store):
            stores[found.id] = stores.get(found.id, 0) + 1
        if isinstance(found, ast.Assign) and isinstance(found.value, ast.Constant):
            for target in found.targets:
                if isinstance(target, ast.Name):
                    values[target.id] = found.value
    return {
        name: value
        for name, value in values.items()
        if stores[name] == 1 and name not in parameters
    }


def _jumps(body: list[ast.stmt]) -> bool:
    """Return whether the body of a loop has a break or a continue of that loop."""
    return any(
        isinstance(one, ast.Break | ast.Continue)
        or (isinstance(one, ast.If) and _jumps([*one.body, *one.orelse]))
        for one in body
    )


@dataclass
class _Folder(ast.NodeTransformer):
    _scope: Scope
    _known: Known
    _constants: Mapping[str, ast.Constant]
    _constant_result: Callable[[Any], ast.Constant | None]

    def statements(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """Fold a block of statements; drop those behind a return, break or continue."""
        folded: list[ast.stmt] = []
        for statement in body:
            result = self.visit(statement)
            if result is not None:
                folded += result if isinstance(result, list) else [result]
            if folded and isinstance(folded[-1], ast.Return | ast.Break | ast.Continue):
                break
        return folded

    def visit_Assign(self, node: ast.Assign) -> Any:
        parts = _separate(node)
        if parts is not None:
            return self.statements(parts)
        node.value = self.visit(node.value)
        node.targets = [self.visit(target) for target in node.targets]
        names = [t.id if isinstance(t, ast.Name) else "" for t in node.targets]
        return None if all(name in self._constants for name in names) else node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> Any:
        assert node.value is not None
        plain = ast.Assign(targets=[node.target], value=node.value)
        return self.visit_Assign(ast.copy_location(plain, node))

    def visit_If(self, node: ast.If) -> Any:
        node.test = self.visit(node.test)
        if isinstance(node.test, ast.Constant):
            return self.statements(node.body if node.test.value else node.orelse)
        node.body = self.statements(node.body)
        node.orelse = self.statements(node.orelse)
        return node if node.body or node.orelse else None

    def visit_For(self, node: ast.For) -> Any:
        items = self._scope.lookup(node.iter)
        if isinstance(items, tuple) and not _jumps(node.body):
            return self._unroll(node, items)
        node.iter = self.visit(node.iter)
        node.body = self.statements(node.body)
        return node if node.body else None

    def visit_While(self, node: ast.While) -> Any:
        node.test = self.visit(node.test)
        node.body = self.statements(node.body)
        return node

    def _unroll(self, node: ast.For, items: tuple[Any, ...]) -> list[ast.stmt]:
        target = node.target
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        repeated: list[ast.stmt] = []
        for item in items:
            entries = item if isinstance(item, tuple) else (item,)
            given = {
                name.id: ast.Constant(value)
                for name, value in zip(names, entries, strict=True)
                if isinstance(name, ast.Name)
            }
            inner = replace(self, _constants={**self._constants, **given})
            repeated += inner.statements(copy.deepcopy(node.body))
        return repeated

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if isinstance(node.ctx, ast.Load):
            if node.id in self._constants:
                return self._constants[node.id]
            return self._number(node)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        return self._number(node)

    def _number(self, node: ast.expr) -> ast.expr:
        found = self._scope.lookup(node)
        if hasattr(found, "value") and hasattr(found, "name"):
            found = found.value  # of an enumerator
        if not is_number(found):
            return node
        name = node.attr if isinstance(node, ast.Attribute) else ast.unparse(node)
        constant = ast.Constant(self._known.constants.get(name, found))
        constant.named = self._scope.full_name(node, name)  # type: ignore[attr-defined]
        return ast.copy_location(constant, node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        node.value, node.slice = self.visit(node.value), self.visit(node.slice)
        item = self._scope.lookup(node)
        if is_number(item):
            return ast.Constant(item)
        if (
            isinstance(node.ctx, ast.Load)
            and isinstance(node.value, ast.Name)
            # Arrays that begin with the scalar parameters, see `_layout.py`
            and node.value.id in ("prm", "values")
            and isinstance(node.slice, ast.Constant)
        ):
            place: Any = node.slice.value
            if place in self._known.packed:
                return ast.Constant(self._known.packed[place])
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        sides = [node.left, *node.comparators]
        if not all(isinstance(side, ast.Constant) for side in sides):
            return node
        values = [side.value for side in sides if isinstance(side, ast.Constant)]
        pairs = zip(node.ops, values, values[1:], strict=False)
        return ast.Constant(all(_FOLDED[type(op)](a, b) for op, a, b in pairs))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        self.generic_visit(node)
        decides = isinstance(node.op, ast.Or)
        left: list[ast.expr] = []
        for value in node.values:
            if not isinstance(value, ast.Constant):
                left.append(value)
            elif bool(value.value) is decides:
                # The operands before it have no side effects.
                return ast.Constant(decides)
        if not left:
            return ast.Constant(not decides)
        if len(left) == 1:
            return left[0]
        node.values = left
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.operand, ast.Constant):
            value: Any = node.operand.value
            if isinstance(node.op, ast.Not):
                return ast.Constant(not value)
            if isinstance(node.op, ast.USub) and is_number(value):
                return ast.Constant(-value)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        left, right, kind = node.left, node.right, type(node.op)
        if (
            isinstance(left, ast.Constant)
            and isinstance(right, ast.Constant)
            and kind in _FOLDED
        ):
            return ast.Constant(_FOLDED[kind](left.value, right.value))
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.test, ast.Constant):
            return node.body if node.test.value else node.orelse
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        function = self._scope.lookup(node.func)
        if function is isinstance:  # numbers, in compiled code
            return ast.Constant(False)
        if function in (float, int) and isinstance(node.args[0], ast.Constant):
            return ast.Constant(function(node.args[0].value))
        return self._constant_result(function) or node
