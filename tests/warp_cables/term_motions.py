"""Random cables of every term, moved by the native kernel and by that of Warp."""

# Warp reads the annotations of its kernels, so they are not postponed here.

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from cable.random_cables import CABLES, cable_of, motion_of
from cc_mujoco.cable import Cable
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.warp._build import functions

DT = 1e-3
NUMPY = {wp.float32: np.float32, wp.float64: np.float64}


@dataclass(frozen=True)
class Runs:
    """Packed cables with the motions of their ends.

    Attributes:
        terms: term of each cable.
        segments: of each cable.
        prm: packed parameters, a row for each cable.
        state: rest states, likewise.
        proximal: displacement of the proximal ends (cables, samples) [m].
        distal: the same of the distal ends [m].
    """

    terms: list[str]
    segments: list[int]
    prm: np.ndarray
    state: np.ndarray
    proximal: np.ndarray
    distal: np.ndarray


def random_runs(each: int, samples: int, seed: int = 5, terms: Any = CABLES) -> Runs:
    """Return `each` random cables of every term with random motions.

    Positions are single-precision numbers, so that both precisions get the same.
    """
    cables: list[Cable] = []
    named, moved = [], []
    for term in terms:
        rng = np.random.default_rng(seed)
        while named.count(term) < each:
            cable = cable_of(rng, term)
            proximal, distal = motion_of(rng, cable, samples, DT)
            if not np.ptp(distal - proximal):
                continue  # nothing strains it
            cables.append(cable)
            named.append(term)
            moved.append((proximal, distal))
    ends = np.array(moved, np.float32).astype(float)
    most = max(cable.segments for cable in cables)
    prm = np.zeros((len(cables), kernel.parameter_size(most)))
    state = np.zeros((len(cables), kernel.state_size(most)))
    for i, cable in enumerate(cables):
        own = packed_parameters(cable)
        prm[i, : own.size] = own
        kernel.initialize(prm[i], cable.segments, *ends[i, :, 0], state[i])
    segments = [cable.segments for cable in cables]
    return Runs(named, segments, prm, state, ends[:, 0], ends[:, 1])


def by_native(runs: Runs) -> np.ndarray:
    """Return the tensions of both ends, (cables, samples, 2) [N]; below 0 if slack."""
    tensions = np.zeros((*runs.proximal.shape, 2))
    for i, n in enumerate(runs.segments):
        prm, state = runs.prm[i].copy(), runs.state[i].copy()
        after, work = state.copy(), np.zeros(kernel.work_size(n))
        for k, (u, v) in enumerate(zip(runs.proximal[i], runs.distal[i], strict=True)):
            status = kernel.step(
                prm, n, state, kernel.POSITION, u, kernel.POSITION, v, DT, after, work
            )
            assert status == kernel.OK
            state, after = after, state
            tensions[i, k] = at.tensions(state, n)[0], at.tensions(state, n)[n]
    return tensions


def by_warp(
    runs: Runs, real: Any, terms: frozenset[str], optimise: bool = False
) -> np.ndarray:
    """Return the same, computed by the kernel for these terms.

    Without `optimise` it compiles in a third of the time and takes 20 times as long.
    """
    step = functions(real, terms, False).step
    level = 2 if optimise else 0
    options: Any = {"fuse_fp": False, "max_unroll": 1, "optimization_level": level}

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def move(
        segments: wp.array(dtype=int),
        prm: wp.array2d(dtype=real),
        proximal: wp.array2d(dtype=real),
        distal: wp.array2d(dtype=real),
        dt: real,
        state: wp.array3d(dtype=real),
        work: wp.array2d(dtype=real),
        tensions: wp.array3d(dtype=real),
    ):
        i = wp.tid()
        now, n = int(0), segments[i]
        for k in range(proximal.shape[1]):
            step(
                prm[i], n, state[now, i], 0, proximal[i, k], 0, distal[i, k], dt,
                state[1 - now, i], work[i],
            )  # fmt: skip
            now = 1 - now
            tensions[i, k, 0] = state[now, i][at.STATE_HEADER]
            tensions[i, k, 1] = state[now, i][at.STATE_HEADER + n]

    def array(values: np.ndarray) -> Any:
        return wp.array(values.astype(NUMPY[real]), dtype=real)

    count = len(runs.segments)
    tensions = wp.zeros((*runs.proximal.shape, 2), dtype=real)
    work = wp.zeros((count, kernel.work_size(max(runs.segments))), dtype=real)
    state = np.stack([runs.state, np.zeros_like(runs.state)])
    inputs = [
        wp.array(runs.segments, dtype=int), array(runs.prm), array(runs.proximal),
        array(runs.distal), real(DT), array(state), work,
    ]  # fmt: skip
    wp.launch(move, dim=count, inputs=inputs, outputs=[tensions])
    return np.asarray(tensions.numpy(), float)


def errors(found: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the errors of the tensions by the largest of the motion, as `found`."""
    largest = np.abs(right).max(axis=(1, 2), keepdims=True)
    return (np.maximum(found, 0.0) - np.maximum(right, 0.0)) / largest
