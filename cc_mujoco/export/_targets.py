"""Compilation of the library's own functions to an object file of any machine.

    emit(TARGETS["aarch64"], interface, entries)      # bytes of an object file

Numba keeps LLVM's bitcode of what it compiles. The bitcode of all that a controller
needs is linked, optimised again and compiled for the target, with nothing in between
that could compute otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import llvmlite.binding as llvm  # type: ignore[import-untyped]

from cc_mujoco._utils.compilation import Bitcode
from cc_mujoco.errors import CableError

LIBM = frozenset(
    "acos asin atan atan2 ceil copysign cos cosh exp exp2 expm1 fabs floor fmax fmin "
    "fmod frexp hypot ldexp log log10 log1p log2 pow rint round sin sinh sqrt tan tanh "
    "trunc".split()
)
"""Functions of C's library of mathematics that may remain to be linked."""


@dataclass(frozen=True)
class Target:
    """A machine to compile for."""

    triple: str
    """Target triple of LLVM; empty is the machine that this runs on."""
    processor: str
    features: str
    meaning: str
    bits: int = 64
    """Bits of a pointer."""


TARGETS = {
    "host": Target("", "", "", "the kind of machine that exports, any model of it"),
    "aarch64": Target(
        "aarch64-unknown-linux-gnu", "generic", "", "64-bit ARM, Linux or bare metal"
    ),
    "armv7": Target(
        "armv7-unknown-linux-gnueabihf",
        "generic",
        "+vfp3d16,-neon",
        "32-bit ARM with a floating-point unit (VFPv3, hard-float ABI)",
        32,
    ),
}
"""Targets that `--target` takes."""


def emit(
    target: Target,
    interface: str,
    functions: Iterable[Bitcode],
    runtime: str | None = None,
    provided: frozenset[str] = LIBM,
    visible: frozenset[str] = frozenset(),
    passes: int = 2,
) -> bytes:
    """Compile an interface in C with all the functions that it calls.

    Args:
        target: The machine.
        interface: LLVM assembly of what C sees; all else becomes invisible.
        functions: What it calls by name, and what these call.
        runtime: LLVM assembly that takes the place of Numba's runtime; by default one
            for functions that allocate nothing.
        provided: Functions that may remain to be linked.
        visible: What else C sees.
        passes: Times that all is optimised. The first finds that no error of a
            controller can be raised, the second gains from that; the plugin, which
            raises its own, gains nothing.

    Returns:
        An object file.

    Raises:
        CableError: This LLVM has no such target, or what it would give needs more than
            C's library of mathematics.
    """
    # What Numba has set up for this machine is no target of another.
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = _machine(target)
    program = llvm.parse_assembly(interface)
    seen = visible | {
        function.name for function in program.functions if not function.is_declaration
    }
    modules = [
        llvm.parse_assembly(runtime or _NO_REFERENCES),
        *_named_modules(functions),
    ]
    for module in [program, *modules]:
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
    for module in modules:
        program.link_in(module)
    for value in [*program.functions, *program.global_variables]:
        own = value.name not in seen and not value.name.startswith("llvm.")
        if own and not value.is_declaration:
            value.linkage = "internal"
    program.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    builder = llvm.create_pass_builder(machine, options)
    for _ in range(passes):
        builder.getModulePassManager().run(program, builder)
    _require_self_contained(program, provided)
    if target.bits == 32:
        _require_numbers_only(program)
    return bytes(machine.emit_object(program))


_NO_REFERENCES = """
define void @NRT_incref(ptr %0) alwaysinline { ret void }
define void @NRT_decref(ptr %0) alwaysinline { ret void }
"""
"""Numba counts references to arrays that it allocated; here the caller owns all."""


def _named_modules(functions: Iterable[Bitcode]) -> list[Any]:
    """Return the LLVM modules of functions, each exported under its public name."""
    modules = []
    for function in functions:
        module = llvm.parse_bitcode(function.content)
        entry = module.get_function(function.symbol)
        entry.name, entry.linkage = function.name, "external"
        modules.append(module)
    return modules


def _require_self_contained(program: Any, provided: frozenset[str]) -> None:
    names = {function.name for function in program.functions if function.is_declaration}
    other = {
        name for name in names - provided
        if not name.startswith("llvm.") or name.startswith("llvm.x86")
    }  # fmt: skip
    if other:
        raise CableError(
            f"the compiled code needs {', '.join(sorted(other))}, which is not "
            "there without Python."
        )


def _require_numbers_only(program: Any) -> None:
    """Refuse pointers in memory: places in it were laid out for 64 bits.

    Numba writes null where a function returns nothing, which nobody reads.
    """
    if re.search(r"\b(load|store) (<\d+ x )?ptr\b(?! null)", str(program)):
        raise CableError(
            "the compiled controller keeps pointers in memory, laid out for a machine "
            "of 64 bits; export it for host or aarch64."
        )


def _machine(target: Target) -> Any:
    triple = target.triple or llvm.get_process_triple()
    try:
        found = llvm.Target.from_triple(triple)
    except RuntimeError:
        raise CableError(
            f"this build of LLVM cannot compile for {triple}; export on a machine of "
            "that kind with --target host."
        ) from None
    return found.create_target_machine(
        cpu=target.processor,
        features=target.features,
        opt=3,
        reloc="pic",
        codemodel="default",
    )
