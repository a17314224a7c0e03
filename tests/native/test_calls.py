"""Calls of compiled functions from Python: arrays are taken as they are, or refused."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cable import _conduit as conduit
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable import packed_parameters, rest_state
from cc_mujoco.cable._cable import Cable

CABLE = Cable(axial_stiffness=1e4, pretension=10.0, friction=0.1, segments=3)
N = CABLE.segments


def frozen(values: Any) -> np.ndarray:
    made = np.array(values)
    made.flags.writeable = False
    return made


def advanced(state: np.ndarray, new: np.ndarray) -> np.ndarray:
    work = np.empty(kernel.work_size(N))
    kernel.advance(packed_parameters(CABLE), N, state, 1e-3, 0.0, 1e-3, new, work)
    return new


def test_an_array_that_is_only_read_may_be_frozen() -> None:
    prm, state = frozen(packed_parameters(CABLE)), frozen(rest_state(CABLE))
    assert kernel.stored_energy(prm, N, state) > 0.0
    given = frozen(prm.astype(">f8"))
    assert kernel.stored_energy(given, N, state) == kernel.stored_energy(prm, N, state)


@pytest.mark.parametrize("order", ["=f8", ">f8"])
def test_a_frozen_array_is_not_written(order: str) -> None:
    state = rest_state(CABLE)
    new = frozen(np.zeros(state.size, order))
    with pytest.raises(TypeError, match=r"`new_state` must be .* that can be written"):
        advanced(state, new)
    assert not new.any()


def test_a_frozen_field_is_not_written() -> None:
    prm = frozen(packed_parameters(CABLE)[None])
    cables = stepper.make_cables((CABLE,), (1.0,), (1.0,))._replace(prm=prm)
    state, work = rest_state(CABLE)[None], np.empty(kernel.work_size(N))
    with pytest.raises(TypeError, match=r"`cables.prm` must be .* that can be written"):
        stepper.move(cables, state, 1e-3, 0.0, 1e-3, state.copy(), work)


def test_what_is_written_to_a_copy_is_copied_back() -> None:
    state = rest_state(CABLE)
    apart = np.zeros(2 * state.size)[::2]
    assert np.array_equal(advanced(state, apart), advanced(state, np.zeros(state.size)))


@pytest.mark.parametrize("given", [1.0, [1.0, 2.0], np.float64(1.0), np.array(1.0)])
def test_what_is_no_array_is_refused(given: Any) -> None:
    with pytest.raises(TypeError, match="`prm` must be a contiguous array of float64"):
        nodes.end_stiffness(given, N, True)


def test_another_number_of_dimensions_is_refused() -> None:
    with pytest.raises(TypeError, match="of 1 dimension"):
        nodes.end_stiffness(packed_parameters(CABLE)[None], N, True)


@pytest.mark.parametrize("change", [list, np.array, lambda given: given[:-1], str])
def test_what_is_no_tuple_of_all_fields_is_refused(change: Any) -> None:
    """An array of rows would be taken for arrays that it has not."""
    cables = stepper.make_cables((CABLE,), (1.0,), (1.0,))
    state, work = rest_state(CABLE)[None], np.empty(kernel.work_size(N))
    given = change(tuple(cables)) if change is not np.array else np.zeros((20, 20))
    with pytest.raises(TypeError, match="`cables` must be a tuple with all of its f"):
        stepper.move(given, state, 1e-3, 0.0, 1e-3, state.copy(), work)


def test_a_signal_ends_a_long_call() -> None:
    samples = 3_000_000  # seconds of computing, as the cable moves all the time
    rest, moved = np.zeros(samples), 1e-3 * np.sin(0.01 * np.arange(samples))
    out = np.full((8, samples), np.nan)
    prm, state = packed_parameters(CABLE), rest_state(CABLE)
    none = np.empty((0, N + 1)), np.empty((0, N), np.int8)
    work = np.empty(kernel.work_size(N))
    ends = kernel.POSITION, moved, kernel.POSITION, rest
    kept = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            conduit._play(prm, N, state, *ends, 1e-3, state.copy(), work, out, *none)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, kept)
    assert np.isnan(out[0, -1])
