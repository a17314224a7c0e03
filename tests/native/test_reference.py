"""The functions in C give the bits of the same functions run by Python."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cable.terms_on import TERMS_ON
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import packed_parameters, rest_state
from cc_mujoco.native._functions import FUNCTIONS
from thesis._experiments.solver import CABLE

STEPS = 12


def states(terms: dict[str, float]) -> np.ndarray:
    """Return the states of a short cable that both ends move."""
    cable = CABLE.replace(segments=5, **terms)
    prm, state = packed_parameters(cable), rest_state(cable)
    work = np.zeros(kernel.work_size(5))
    found = [state]
    for k in range(STEPS):
        new = np.zeros_like(state)
        proximal, distal = 2e-3 * np.sin(0.7 * k), 1e-3 * np.sin(0.4 * k)
        kernel.step(
            prm, 5, found[-1], kernel.POSITION, proximal, kernel.POSITION, distal,
            1e-3, new, work,
        )  # fmt: skip
        found.append(new)
    return np.array(found)


@pytest.fixture
def python() -> Iterator[None]:
    """Have Python run all functions that are called in C otherwise."""
    kept = [(one, one._entry) for one in FUNCTIONS]
    for one, _ in kept:
        one._entry = one.py_func
    yield
    for one, entry in kept:
        one._entry = entry


RIGHT = {name: states(terms) for name, terms in TERMS_ON.items()}


@pytest.mark.parametrize("name", TERMS_ON)
def test_kernel_has_the_bits_of_python(name: str, python: None) -> None:
    assert np.array_equal(states(TERMS_ON[name]), RIGHT[name])
