"""Warp functions of a cable, built for a precision and the terms in use."""

from __future__ import annotations

import hashlib
import linecache
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from cc_mujoco.native._warp import translate
from cc_mujoco.warp._runtime import PRELUDE
from cc_mujoco.warp._variants import (
    FUNCTIONS,
    GUIDED,
    PATH_FUNCTIONS,
    Paths,
    known_values,
)

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
