"""Decorators of functions that become C.

    @compiled
    def advance(prm: FloatArray, n: int, ...) -> bool: ...

Python calls such a function in the native library. `function.py_func` is the same
function run by Python, the reference: it gives the same bits.
"""

import hashlib
import inspect
import platform
import types
import typing
from collections.abc import Callable
from functools import cache, update_wrapper
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary
from cc_mujoco.native._entries import program_text
from cc_mujoco.native._kinds import (
    Array,
    Kind,
    Structure,
    dtype_of,
    signature_of,
)  # fmt: skip


@cache
def own_entries(
    functions: tuple[tuple[str, types.FunctionType], ...],
) -> dict[str, Callable[..., Any]]:
    first = functions[0][1]
    made = CLibrary({}, Path(first.__code__.co_filename).parent)
    called = {key: made.require(function) for key, function in functions}
    text = program_text(made, called)
    code = f"{native_library.FLAGS}{platform.machine()}{text}".encode()
    module = first.__module__.replace(".", "_")
    name = f"lib{module}-{hashlib.sha256(code).hexdigest()[:20]}"

    def build(place: Path) -> Path:
        source = place / "cc_mujoco.c"
        source.write_text(text)
        return native_library.compile_library(
            place / native_library.CARRIED.name, source
        )

    path = native_library.keep(name, build)
    return native_library.methods(native_library.load(path))


Function = TypeVar("Function", bound=Callable[..., Any])

FUNCTIONS: "list[NativeFunction]" = []  # all declared ones, in order


class NativeFunction:
    """Python function that is compiled by way of C.

    Attributes:
        py_func: the function as Python runs it.
        key: name in the library.
        symbol: name of a callback in the library, empty for other functions.
        is_entry: whether Python calls it in the library.
    """

    def __init__(
        self, function: types.FunctionType, is_entry: bool, symbol: str = ""
    ) -> None:
        """Declare a function; nothing is compiled before the first call."""
        self.py_func, self.symbol, self.is_entry = function, symbol, is_entry
        self.key = f"{function.__module__}.{function.__name__}"
        self._entry: Callable[..., Any] = self._load if is_entry else function
        update_wrapper(cast("Callable[..., Any]", self), function)
        FUNCTIONS.append(self)

    def __call__(self, *given: Any, **named: Any) -> Any:
        """Call the function in the library; copy arrays that do not fit, and back."""
        if named:
            bound = inspect.signature(self.py_func).bind(*given, **named)
            bound.apply_defaults()
            given = bound.args
        try:
            return self._entry(*given)
        except TypeError:
            if self._entry is self.py_func:
                raise
        kinds = signature_of(self.py_func).arguments.values()
        if len(kinds) != len(given):
            return self._entry(*given)
        copies: list[tuple[Any, Any]] = []
        pairs = zip(given, kinds, strict=True)
        result = self._entry(*[_fit(each, kind, copies) for each, kind in pairs])
        for original, copy in copies:
            original[...] = copy
        return result

    def __get__(self, owner: Any, kind: Any = None) -> Any:
        return self if owner is None else types.MethodType(self, owner)

    def _load(self, *given: Any) -> Any:
        if self.key.startswith("cc_mujoco."):
            found = native_library.entries().get(self.key)
        else:
            module = self.py_func.__module__
            found = own_entries(
                tuple(
                    (each.key, each.py_func)
                    for each in FUNCTIONS
                    if each.is_entry and each.py_func.__module__ == module
                )
            ).get(self.key)
        self._entry = found or self.py_func
        hint = typing.get_type_hints(self.py_func).get("return")
        if isinstance(hint, type) and hasattr(hint, "_fields"):
            inner, make = self._entry, hint
            if inner is not self.py_func:
                self._entry = lambda *each: make(*inner(*each))
        return self._entry(*given)


def _fit(given: Any, kind: Kind, copies: list[tuple[Any, Any]]) -> Any:
    """Return an argument as C takes it; append copied arrays to `copies`."""
    if isinstance(kind, Structure):
        if not isinstance(given, tuple) or len(given) != len(kind.fields):
            return given  # the library refuses it
        return tuple(
            _fit(each, wanted, copies)
            for each, (_, wanted) in zip(given, kind.fields, strict=True)
        )
    if not isinstance(kind, Array) or getattr(given, "ndim", 0) != kind.dims:
        return given  # an array is due: the library refuses it
    copy = np.ascontiguousarray(given, dtype=dtype_of(kind.element))
    if copy is not given:
        copy.flags.writeable = given.flags.writeable
        if copy.flags.writeable:
            copies.append((given, copy))
    return copy


def compiled(function: Function) -> Function:
    """Declare a function that is compiled, for Python and other compiled functions."""
    return cast("Function", NativeFunction(cast("types.FunctionType", function), True))


def internal(function: Function) -> Function:
    """Declare a function that is compiled, for other compiled functions only."""
    return cast("Function", NativeFunction(cast("types.FunctionType", function), False))


def inlined(function: Function) -> Function:
    """Declare an `internal` function, short and often called, that C always inlines."""
    vars(function)["inlined"] = True
    return internal(function)


def callback(function: Function) -> Function:
    """Declare a compiled function that C calls, by `cc_mujoco_` and its name."""
    plain = cast("types.FunctionType", function)
    symbol = f"cc_mujoco_{plain.__name__.lstrip('_')}"
    return cast("Function", NativeFunction(plain, False, symbol))


def reinterpret(function: Function) -> Function:
    """Mark a function that returns the memory at an address as a type, without a copy.

    Its arguments are the address and, for an array, its size in each dimension.
    """
    vars(function)["views"] = "memory"
    return function


def reinterpret_part(function: Function) -> Function:
    """Mark a function that returns part of an array in another shape, without a copy.

    Its arguments are the array, the index of its first number and its dimensions.
    """
    vars(function)["views"] = "array"
    return function
