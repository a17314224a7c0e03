"""The decorators of compiled functions."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import update_wrapper
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding  # type: ignore[import-untyped]
import llvmlite.ir as ir  # type: ignore[import-untyped]
import numba
import numpy as np
from numba import cfunc, njit
from numba.core import cgutils, codegen, compiler, errors, event
from numba.extending import intrinsic
from numpy.typing import NDArray

from cc_mujoco._utils.code_stamp import stamp_compiled_code

types: Any = numba.types
"""Numba's types; calling one makes a signature, which its annotations do not tell."""

FloatArray = NDArray[np.float64]
"""Array type of compiled functions; one-dimensional and contiguous unless stated."""
INTEGER, REAL, REALS = types.int64, types.float64, types.float64[::1]
"""Types of single numbers and of that array, for the signatures of `exported`."""

Function = TypeVar("Function", bound=Callable[..., Any])

stamp_compiled_code(Path(__file__).parents[1])

_NOTICE = "cc_mujoco: compiling; this happens once and takes a few minutes\n"
_UNCACHED_NOTICE = (
    "cc_mujoco: compiling, minutes, at every start: Numba may keep what it compiles "
    "neither beside the sources in {root} nor in the cache folder of this user; set "
    "NUMBA_CACHE_DIR to a folder that may be written\n"
)
_NOTICE_DELAY = 6.0
"""Time that is compiled without a word [s]."""
_NOTICE_INTERVAL = 30.0
"""Time after which a line tells that it goes on [s]."""


class _NoEnvironment:
    """Stand-in for a code generator that would note the Python side of a function."""

    def set_env(self, name: str, env: Any) -> None:
        """Note nothing: no function of an `_InlinedLibrary` has a Python side."""


class _InlinedLibrary(codegen.JITCodeLibrary):
    """Code of a function that others compile into themselves.

    They optimise it there, so it is not optimised here and never becomes machine code:
    a quarter of the time that compiling takes.
    """

    codegen = _NoEnvironment()

    def _optimize_final_module(self) -> None:
        """Leave that to the callers."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, as of a function without machine code."""
        return 0


class _InlinedCompiler(compiler.Compiler):
    """Numba's compiler, with an `_InlinedLibrary` for its result."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)  # type: ignore[no-untyped-call]
        state, make = self.state, cast("Callable[..., Any]", _InlinedLibrary)
        state.library = make(state.targetctx.codegen(), "inlined")
        state.library.enable_object_caching()


def internal(function: Function) -> Function:
    """Compile for other compiled code alone, whose cache entry covers it.

    Without what Python would call, a small function compiles in half the time.
    """
    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "forceinline": True,
        "pipeline_class": _InlinedCompiler,
    }
    return cast("Function", _share_specialisations(njit(**options)(function)))


def compiled(function: Function) -> Function:
    """Compile for use from Python and from other compiled code, without the GIL."""
    options: dict[str, Any] = {
        "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
    }  # fmt: skip
    try:
        return cast(
            "Function", _share_specialisations(njit(cache=True, **options)(function))
        )
    except RuntimeError:  # Numba finds no folder that it may write its cache to
        _notice.is_kept = False
        return cast("Function", _share_specialisations(njit(**options)(function)))


def _share_specialisations(dispatcher: Any) -> Any:
    """Make compiled callers share specialisations: 0, 1 and n are one type."""
    specialise = dispatcher.get_call_template

    def call_template(args: Any, kws: Any) -> Any:
        return specialise([_widest_types(given) for given in args], kws)

    dispatcher.get_call_template = call_template
    return dispatcher


def _widest_types(given: Any) -> Any:
    """Return the type to compile for: one for all integers, known or not."""
    given = types.unliteral(given)
    return INTEGER if isinstance(given, types.Integer) else given


class _Notice(event.Listener):
    """Notice that compiling takes long, and lines that tell that it goes on.

    What Numba finds in its cache it does not compile, however slow the machine is.
    """

    def __init__(self) -> None:
        self._depth, self._start_time, self._compile_time = 0, 0.0, 0.0
        self._due = _NOTICE_DELAY
        self._timer: threading.Timer | None = None
        self.is_kept = True
        """True if Numba keeps what it compiles."""

    def on_start(self, event: Any) -> None:
        """Begin to wait, where nothing else is being compiled."""
        if not _is_ours(event):
            return
        self._depth += 1
        if self._depth == 1:
            self._start_time = time.monotonic()
            left = max(self._due - self._compile_time, 0.0)
            self._timer = threading.Timer(left, self._tell)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        """Wait no more."""
        if not _is_ours(event):
            return
        self._depth -= 1
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._compile_time += time.monotonic() - self._start_time

    def _tell(self) -> None:
        """Write what is due, the notice first."""
        if sys.stderr is None:
            return
        text = _NOTICE if self.is_kept else _UNCACHED_NOTICE
        if self._due > _NOTICE_DELAY:
            text = f"cc_mujoco: still compiling, after {self._due:.0f} s\n"
        sys.stderr.write(text.format(root=Path(__file__).parents[1]))
        self._due += _NOTICE_INTERVAL


def _is_ours(event: Any) -> bool:
    return str(event.data["module"]).startswith("cc_mujoco")


_notice = _Notice()
event.register("numba:run_pass", _notice)  # type: ignore[no-untyped-call]

_EXPORTED: dict[str, Any] = {}
"""Signatures of exported functions, by what they are called in compiled code."""


def exported(signature: Any) -> Callable[[Function], Function]:
    """Compile at once for a signature, as `compiled`, but never into a caller.

    Numba compiles all that a function calls into it, again in each caller of a caller.
    These are called by name instead; a name stays good in a cache, an address does not.
    """

    def decorate(function: Function) -> Function:
        name = f"{function.__module__}.{function.__qualname__} {signature}"
        try:
            code = cfunc(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:
            _notice.is_kept = False
            code = cfunc(signature, error_model="numpy")(function)
        llvmlite.binding.add_symbol(name, code.address)
        _EXPORTED[name] = signature, code  # the code lives as long as its name

        def call(*given: Any) -> Any:
            return _call_by_name(name, given)

        call.__name__, call.__qualname__ = function.__name__, function.__qualname__
        bound = compiled(cast("Function", call))
        return cast("Function", update_wrapper(bound, function))

    return decorate


@dataclass(frozen=True)
class Bitcode:
    """LLVM bitcode of a function and of the functions compiled into it."""

    name: str
    """Name in the compiled code of other modules."""
    symbol: str
    """Name in its own compiled code."""
    content: bytes


def bitcode(name: str, function: Any, signature: Any) -> list[Bitcode]:
    """Return the bitcode of a function callable from C and of every exported function.

    Args:
        name: Name of the function in the bitcode.
        function: The Python function.
        signature: Signature that it is compiled for.
    """
    try:
        code = cfunc(signature, cache=True, error_model="numpy")(function)
    except RuntimeError:
        code = cfunc(signature, error_model="numpy")(function)
    return bitcode_of({name: code})


def bitcode_of(codes: Mapping[str, Any]) -> list[Bitcode]:
    """Return the bitcode of functions callable from C, and of every exported function.

    Args:
        codes: What Numba compiled, by its name in the bitcode.
    """
    exported = {name: code for name, (_, code) in _EXPORTED.items()}
    # What Numba read from its cache has no other form than the one meant for linking.
    return [
        Bitcode(name, code.native_name, _module(code).as_bitcode())
        for name, code in {**codes, **exported}.items()
    ]


def _module(code: Any) -> Any:
    return code._library._get_module_for_linking()


def _without_owner(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Return an array of a Numba type without the owner of its memory."""
    view = context.make_array(kind)(context, builder, array)
    view.meminfo = view.meminfo.type(None)
    return view._getvalue()


@intrinsic(prefer_literal=True)
def _call_symbol(context: Any, name: Any, given: Any) -> Any:
    if not isinstance(name, types.StringLiteral):
        return None
    signature, _ = _EXPORTED[name.literal_value]
    for wanted, type_ in zip(signature.args, given.types, strict=True):
        if isinstance(wanted, types.Array) and not (
            isinstance(type_, types.Array)
            and (type_.dtype, type_.ndim, type_.layout)
            == (wanted.dtype, wanted.ndim, wanted.layout)
        ):
            raise errors.TypingError(
                f"{name.literal_value} takes {wanted} where it is given {type_}"
            )

    def codegen(context: Any, builder: Any, called: Any, args: Any) -> Any:
        values = []
        for i, wanted in enumerate(signature.args):
            value = builder.extract_value(args[1], i)
            if isinstance(wanted, types.Array):
                # The caller keeps what it lends: counting references, atomically at
                # every view, would take three times as long as the function itself.
                value = _without_owner(context, builder, wanted, value)
            else:
                value = context.cast(builder, value, given.types[i], wanted)
            values.append(value)
        kind = ir.FunctionType(
            context.get_value_type(signature.return_type),
            [context.get_value_type(wanted) for wanted in signature.args],
        )
        declare: Any = cgutils.get_or_insert_function
        callee = declare(builder.module, kind, name.literal_value)
        return builder.call(callee, values)

    return signature.return_type(name, given), codegen


_call_by_name: Any = _call_symbol


@intrinsic
def _borrow(context: Any, given: Any) -> Any:
    def codegen(context: Any, builder: Any, called: Any, args: Any) -> Any:
        return _without_owner(context, builder, given, args[0])

    return given(given), codegen


borrow = cast("Callable[[FloatArray], FloatArray]", _borrow)
"""Return an argument of a function as an array whose views count no references.

Its caller keeps it. Counting calls a function at every view, even where the array has
no owner, and that was a quarter of the time of a step of a cable.
"""
