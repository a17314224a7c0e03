"""The three solvers solve the same thing, and their order in cost is not in doubt."""

from __future__ import annotations

from cc_mujoco.reproduce.experiments.solver import costs


def test_kernel_is_faster_than_enumeration_and_that_than_fsolve() -> None:
    found = costs(12, steps=20, general_steps=3)
    assert 20.0 * found.kernel < found.enumeration
    assert 3.0 * found.enumeration < found.fsolve


def test_kernel_and_enumeration_agree_on_the_motion_that_is_timed() -> None:
    assert costs(40, steps=20, general_steps=1).apart < 1e-3
