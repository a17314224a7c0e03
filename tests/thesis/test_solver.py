"""The three solvers solve the same thing, and their order in cost is not in doubt."""

from __future__ import annotations

from thesis._experiments.solver import costs


def test_kernel_is_faster_than_enumeration_and_that_than_fsolve() -> None:
    found = costs(20, steps=20, general_steps=1)
    assert 20.0 * found.kernel < found.enumeration
    assert 3.0 * found.enumeration < found.fsolve
    # And says the same of the motion that is timed.
    assert found.apart < 1e-3
