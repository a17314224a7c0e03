"""Warp functions of a cable, built for a precision and the terms in use."""

import hashlib
import linecache
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import warp as wp

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable import _pack as pack
from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.cable._cable import PARAMETERS, TERMS
from cc_mujoco.cable._route import Route
from cc_mujoco.native._fold import Known
from cc_mujoco.native._warp import translate

FUNCTIONS: tuple[Any, ...] = (
    kernel.step, kernel.step_of, kernel.begin_step, kernel.solve_step,
    kernel.finish_step, pack.initialize, pack.pack_mesh, pack.expect_yielding,
    nodes.end_stiffness, eccentric.wound_length, eccentric.lever_ratio,
)  # fmt: skip
"""Functions of `cc_mujoco.cable` that all kernels need."""
PATH_FUNCTIONS: tuple[Any, ...] = (
    geometry.bend, open_path.measure, open_path.keep_conduit, open_path.lay,
    open_path.contacts, open_path.save_path, open_path.pull_forces, pack.set_path,
    open_path.pack_reference, open_path.remember_bends, pack.expect_change,
    pack.rest_in, at.contact_length, at.tensions,
)  # fmt: skip
"""Functions of `cc_mujoco.cable` that kernels of cables guided by a tendon need too."""


class Paths(NamedTuple):
    """Facts about the paths of all cables that are known at compile time."""

    bends: float | None = 0.0  # `BENDS_CHANGE` of their parameters; None if it differs
    lengthens: float | None = 0.0  # `PATH_LENGTHENS`; None if it differs
    bent: bool = False  # True if a tendon bends the conduit of one of them

    @property
    def led(self) -> bool:
        """True if a tendon guides one of the cables."""
        return self.bends != 0.0


GUIDED = Paths()
"""`Paths` of cables that no tendon guides."""


def paths_of(segments: Iterable[int], routes: Iterable[Route | None]) -> Paths:
    given = list(zip(segments, routes, strict=True))
    bends = {0.0 if route is None else 1.0 for _, route in given}
    lengthens = {
        0.0 if route is None or route.guided == n else 1.0 for n, route in given
    }
    return Paths(
        bends.pop() if len(bends) == 1 else None,
        lengthens.pop() if len(lengthens) == 1 else None,
        any(route is not None and route.bends for _, route in given),
    )


def known_values(
    terms: frozenset[str], yields: bool, single: bool, paths: Paths = GUIDED
) -> Known:
    """Return values known at compile time, and float32 tolerances if `single`."""
    packed = {law.INDEX[name]: 0.0 for name in TERMS if name not in terms}
    values = [packed.get(place, 1.0) for place, _ in enumerate(PARAMETERS)]
    if paths.bends is not None:
        packed[at.BENDS_CHANGE] = paths.bends
    if paths.lengthens is not None:
        packed[at.PATH_LENGTHENS] = paths.lengthens
    # They depend on which terms are on, not on their sizes.
    constant: Any = law.is_constant_coulomb
    dependent: Any = law.is_state_dependent
    curved: Any = nodes.curvature
    if constant.py_func(values):
        packed[at.CONSTANT_COULOMB] = 1.0
    if not dependent.py_func(values):
        packed[at.STATE_DEPENDENT] = 0.0
    if curved.py_func(values) == 0.0:
        packed[at.CURVED] = 0.0
    if not yields:
        packed |= {at.YIELD_PROXIMAL: 0.0, at.YIELD_DISTAL: 0.0}
    kinds = {"proximal_kind": kernel.POSITION, "distal_kind": kernel.POSITION}
    names = ("LIMIT_TOLERANCE", "PATH_TOLERANCE", "_ROUNDING")
    rounding = {**dict.fromkeys(names, 1e-6), "_MIN_ARC_ANGLE": -1e-2}
    rounding["_EMPTY_LAYER"] = 1e-9
    return Known(packed, kinds, rounding if single else {})


@lru_cache(maxsize=32)
def functions(
    real: Any, terms: frozenset[str], yields: bool, paths: Paths = GUIDED
) -> SimpleNamespace:
    """Return the Warp functions of cables, by name.

    `real` is `wp.float32` or `wp.float64`. Only `terms` may be on; others are not
    compiled. With `yields`, ends may yield to their tension, see
    `_pack.expect_yielding`. `PATH_FUNCTIONS` are included if a tendon guides a cable.
    """
    wanted = FUNCTIONS + PATH_FUNCTIONS if paths.led else FUNCTIONS
    library = translate(wanted, known_values(terms, yields, real is wp.float32, paths))
    prelude = Path(__file__).with_name("prelude.txt").read_text()
    prelude = prelude.replace("ELEMENT", f"wp::{real.__name__}")
    source = f"{prelude}\n\n{library.source}"
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    name = f"cc_mujoco_{real.__name__}_{digest}"
    file = f"<{name}>"  # where Warp finds the text
    linecache.cache[file] = (len(source), None, source.splitlines(True), file)
    namespace: dict[str, Any] = {"wp": wp, "Real": real, "__name__": name}
    exec(compile(source, file, "exec", dont_inherit=True), namespace)
    return SimpleNamespace(
        **{name.split(".")[1]: namespace[own] for name, own in library.names.items()}
    )
