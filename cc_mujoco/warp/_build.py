"""Warp functions of a cable, built for a precision and the terms in use."""

from __future__ import annotations

import hashlib
import linecache
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from cc_mujoco.native._warp import translate
from cc_mujoco.warp._variants import (
    FUNCTIONS,
    GUIDED,
    PATH_FUNCTIONS,
    Paths,
    known_values,
)

PRELUDE = '''
@wp.func_native("""
wp::array_t<ELEMENT> part = whole;
part.data = (ELEMENT*)((char*)whole.data + wp::int64(start) * whole.strides[0]);
part.shape[0] = stop - start;
return part;
""")
def cut(
    whole: wp.array(dtype=Real), start: wp.int32, stop: wp.int32
) -> wp.array(dtype=Real):
    ...


@wp.func
def variable(x: Real):
    return x


@wp.func
def fill(row: wp.array(dtype=Real), value: Real):
    for i in range(row.shape[0]):
        row[i] = value


@wp.func
def fill(row: wp.array(dtype=Real), source: wp.array(dtype=Real)):
    for i in range(row.shape[0]):
        row[i] = source[i]


@wp.func
def square(x: Real):
    return x * x


@wp.func
def sign_of(x: Real):
    if x > Real(0.0):
        return Real(1.0)
    if x < Real(0.0):
        return Real(-1.0)
    return x


@wp.func
def expm1(x: Real):
    grown = wp.exp(x)
    if grown == Real(1.0):
        return x
    if grown - Real(1.0) == Real(-1.0):
        return Real(-1.0)
    return (grown - Real(1.0)) * (x / wp.log(grown))


@wp.func
def log1p(x: Real):
    grown = Real(1.0) + x
    if grown == Real(1.0):
        return x
    return wp.log(grown) * (x / (grown - Real(1.0)))
'''
"""Source of these functions for an element type `Real`.

`variable` makes a variable of a constant: Warp 1.19 gives both one place in memory,
and what changes the variable would change the constant. `cut` returns a view of part
of an array whose elements may lie apart. Warp's library for processors lacks `expm1`
and `log1p`; these are Kahan's forms.
"""


_ELEMENTS = {wp.float32: "wp::float32", wp.float64: "wp::float64"}


@lru_cache(maxsize=32)
def functions(
    real: Any, terms: frozenset[str], yields: bool, paths: Paths = GUIDED
) -> SimpleNamespace:
    """Return the Warp functions for cables by name.

    `real` is `wp.float32` or `wp.float64`. Of `terms` those of some parameters may be
    on; the others are off in every cable and world, and nothing of them is compiled.
    With `yields` ends may give way within a step, see `_pack.expect_yielding`. Those of
    `PATH_FUNCTIONS` are there where a tendon leads one of the cables.
    """
    wanted = FUNCTIONS + PATH_FUNCTIONS if paths.led else FUNCTIONS
    library = translate(wanted, known_values(terms, yields, real is wp.float32, paths))
    source = f"{PRELUDE.replace('ELEMENT', _ELEMENTS[real])}\n\n{library.source}"
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    namespace = _run(source, f"cc_mujoco_{real.__name__}_{digest}", real)
    return SimpleNamespace(
        **{name.split(".")[1]: namespace[own] for name, own in library.names.items()}
    )


def _run(source: str, name: str, real: Any) -> dict[str, Any]:
    """Run generated source so that Warp finds its text; return its names."""
    file = f"<{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(True), file)
    namespace: dict[str, Any] = {"wp": wp, "Real": real, "__name__": name}
    exec(compile(source, file, "exec", dont_inherit=True), namespace)
    return namespace
