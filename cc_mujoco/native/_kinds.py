"""Types of values in compiled functions, read from annotations.

A type is the same for every call: `float`, `int`, `bool`, an array of one or two
dimensions, or a named tuple or tuple of these.
"""

import ast
import ctypes
import inspect
import textwrap
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

FloatMatrix = Annotated[npt.NDArray[np.float64], 2]
"""Contiguous matrix of floats; an array without this mark has one dimension."""
FloatCube = Annotated[npt.NDArray[np.float64], 3]
"""Contiguous array of floats of three dimensions."""
IntMatrix = Annotated[npt.NDArray[np.int64], 2]
ByteMatrix = Annotated[npt.NDArray[np.int8], 2]
"""Contiguous matrices of integers."""


@dataclass(frozen=True)
class Scalar:
    """Number type, by its name in C."""

    c: str


@dataclass(frozen=True)
class Memory(Scalar):
    """Address of a structure, whose fields are read and written in place."""

    name: str  # name of the structure, with which the paths of its fields begin
    layout: type[ctypes.Structure] = field(compare=False)  # its type for `ctypes`
    # Function from the path of a field to its offset, or from a name to a size [bytes].
    place: Callable[[str], int] = field(compare=False)


@dataclass(frozen=True)
class Array:
    """A contiguous array of numbers in C's order."""

    element: Scalar
    dims: int = 1


@dataclass(frozen=True)
class Structure:
    """Named tuple or tuple; fields of a tuple are `f0`, `f1` and so on.

    A structured type of NumPy is accessed through a pointer.
    """

    name: str
    fields: "tuple[tuple[str, Kind], ...]"
    is_pointer: bool = False

    def kind_of(self, field: str) -> "Kind":
        return dict(self.fields)[field]


Kind = Scalar | Array | Structure


def holds_array(kind: Kind) -> bool:
    """Return whether values of a type hold arrays, views of memory owned elsewhere."""
    if isinstance(kind, Structure):
        return any(holds_array(each) for _, each in kind.fields)
    return isinstance(kind, Array)


REAL, INT, BOOL, NOTHING, BYTE, INT32, WORD, INT8 = map(
    Scalar, "double int64_t bool void uint8_t int32_t uint64_t int8_t".split()
)
CInt = Annotated[int, INT32]
"""Argument or result of a function for C that is an `int` there."""
NUMBERS: dict[Any, Scalar] = {
    float: REAL, np.float64: REAL, int: INT, np.int64: INT, np.intp: INT, bool: BOOL,
    np.bool_: BOOL, np.uint8: BYTE, np.int32: INT32, np.uint64: WORD, np.int8: INT8,
    None: NOTHING, type(None): NOTHING, ctypes.c_double: REAL, ctypes.c_int: INT32,
    ctypes.c_int64: INT, ctypes.c_size_t: INT, ctypes.c_uint8: BYTE,
    ctypes.c_bool: BYTE, ctypes.c_char: BYTE,
}  # fmt: skip
_SHORT = {
    REAL: "Real", INT: "Int", BOOL: "Bool", BYTE: "Byte", INT32: "Int32", WORD: "Word",
    INT8: "Int8",
}  # fmt: skip


class LoadedInt(int):
    """Integer that differs between processes, so that it cannot be a constant."""

    c: str  # expression by which C reads its value when it runs


def dtype_of(kind: Scalar) -> np.dtype[Any]:
    return np.dtype(kind.c.removesuffix("_t"))


class UnknownTypeError(Exception):
    """Annotation that is no type of compiled functions."""


def tuple_of(kinds: tuple[Kind, ...]) -> Structure:
    name = "Tuple_" + "_".join(short_name(kind) for kind in kinds)
    return Structure(name, tuple((f"f{i}", kind) for i, kind in enumerate(kinds)))


def short_name(kind: Kind) -> str:
    """Return the name of a type in C, without the star of a pointer."""
    if isinstance(kind, Scalar):
        return _SHORT[INT if isinstance(kind, Memory) else kind]
    if isinstance(kind, Structure):
        return kind.name
    return _SHORT[kind.element] + {1: "s", 2: "Matrix", 3: "Cube"}[kind.dims]


def kind_of(annotation: Any) -> Kind:
    if isinstance(annotation, typing.TypeVar):
        annotation = (annotation.__constraints__ or (annotation.__bound__,))[0]
    dims = 1
    if typing.get_origin(annotation) is Annotated:
        annotation, mark = typing.get_args(annotation)
        if isinstance(mark, tuple):  # of a row of a structured array: its name, dtype
            name, layout = mark
            fields = tuple((each, NUMBERS[layout[each].type]) for each in layout.names)
            return Structure(name, fields, is_pointer=True)
        if not isinstance(mark, int):
            return mark  # type: ignore[no-any-return]
        dims = mark
    if isinstance(annotation, typing.Hashable) and annotation in NUMBERS:
        return NUMBERS[annotation]
    origin, given = typing.get_origin(annotation), typing.get_args(annotation)
    if hasattr(origin, "__value__"):  # as `NDArray` from NumPy 2.5 on
        return kind_of(Annotated[origin.__value__[given], dims])
    if origin is np.ndarray:
        element = typing.get_args(given[1])[0]
        if element in NUMBERS:
            return Array(NUMBERS[element], dims)
    if origin is tuple:
        return tuple_of(tuple(kind_of(each) for each in given))
    if isinstance(annotation, type) and hasattr(annotation, "_fields"):
        return record_of(annotation)
    raise UnknownTypeError(str(annotation))


_records: dict[str, type] = {}  # named tuples by the names of their types in C


def record_of(found: type) -> Structure:
    try:
        hints = typing.get_type_hints(found, include_extras=True)
    except NameError as error:
        raise UnknownTypeError(f"{error} in {found.__name__}") from None
    fields = tuple((name, kind_of(hints[name])) for name in found._fields)  # type: ignore[attr-defined]
    name = found.__name__.lstrip("_")
    if _records.setdefault(name, found) is not found:
        module = found.__module__.rpartition(".")[2].title().replace("_", "")
        name = module + name
    return Structure(name, fields)


@dataclass(frozen=True)
class FunctionTypes:
    arguments: dict[str, Kind]
    result: Kind


def signature_of(function: types.FunctionType) -> FunctionTypes:
    try:
        hints = typing.get_type_hints(function, include_extras=True)
    except NameError as error:
        raise UnknownTypeError(str(error)) from None
    kinds = {}
    for name in [*inspect.signature(function).parameters, "return"]:
        if name not in hints:
            raise UnknownTypeError(f"of `{name}`, which has no annotation")
        kinds[name] = kind_of(hints[name])
    result = kinds.pop("return")
    return FunctionTypes(kinds, result)


def interrupted(step: int) -> bool:
    """Return whether a loop should end; C asks Python at every 16384th `step`."""
    return False


def python_function(found: Any) -> types.FunctionType | None:
    """Return a Python function, also that of a compiled one; None of other objects."""
    found = getattr(found, "py_func", found)
    if not isinstance(found, types.FunctionType) or found.__module__[:6] == "numpy.":
        return None
    return found


def tree_of(function: Callable[..., Any]) -> ast.FunctionDef:
    lines, first = inspect.getsourcelines(function)
    node = ast.parse(textwrap.dedent("".join(lines))).body[0]
    assert isinstance(node, ast.FunctionDef)
    return ast.increment_lineno(node, first - 1)
