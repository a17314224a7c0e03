"""Kernels fit into the registers of a GPU; Warp's compiler for it needs none."""

from __future__ import annotations

import pytest

pytest.importorskip("warp")

from benchmarks.check_registers import LIMIT, compiled_use

from cc_mujoco.warp._kernels import kernels


@pytest.mark.study
@pytest.mark.parametrize("implicit", [False, True])
def test_a_part_of_a_step_spills_nothing(implicit):
    own = kernels(frozenset(["friction", "load_independent_friction"]), implicit)
    for kernel in (own.fronts, own.graph, own.commit):
        use = compiled_use(kernel, 90)
        assert 32 <= use.registers <= LIMIT
        assert use.stack == 0
