"""Compiled functions that kernels call, and what is known before they run."""

from __future__ import annotations

from typing import Any

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _pack as pack
from cc_mujoco.cable._parameters import PARAMETERS, TERMS
from cc_mujoco.warp._fold import Known

FUNCTIONS: tuple[Any, ...] = (
    kernel.step, kernel.begin_step, kernel.solve_step, kernel.finish_step,
    pack.initialize, pack.pack_mesh, pack.expect_yielding, nodes.end_stiffness,
    eccentric.wound_length, eccentric.lever_ratio,
)  # fmt: skip
"""Compiled functions that kernels call."""

_SINGLE_PRECISION = {"LIMIT_TOLERANCE": 1e-6, "_ROUNDING": 1e-6}
"""Tolerances of rounding in single precision."""


def known_values(terms: frozenset[str], yields: bool, single: bool) -> Known:
    """Return what is known of guided cables with fixed bends before any step.

    Args:
        terms: parameters whose terms may be on.
        yields: whether ends may give way within a step, see `_pack.expect_yielding`.
        single: whether numbers are of single precision.
    """
    packed = {law.INDEX[name]: 0.0 for name in TERMS if name not in terms}
    values = [packed.get(place, 1.0) for place, _ in enumerate(PARAMETERS)]
    packed |= {at.BENDS_CHANGE: 0.0, at.PATH_LENGTHENS: 0.0, at.CARRY_ENERGY: 0.0}
    # They depend on which terms are on, not on their sizes.
    constant: Any = law.is_constant_coulomb
    dependent: Any = law.is_state_dependent
    if constant.py_func(values):
        packed[at.CONSTANT_COULOMB] = 1.0
    if not dependent.py_func(values):
        packed[at.STATE_DEPENDENT] = 0.0
    if not yields:
        packed |= {at.YIELD_PROXIMAL: 0.0, at.YIELD_DISTAL: 0.0}
    kinds = {"proximal_kind": kernel.POSITION, "distal_kind": kernel.POSITION}
    return Known(packed, kinds, _SINGLE_PRECISION if single else {})
