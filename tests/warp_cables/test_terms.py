"""The kernel on Warp against the same functions in C, term by term."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("warp")

import warp as wp

from cable.random_cables import CABLES
from cc_mujoco.cable._cable import TERMS
from warp_cables.term_motions import Runs, by_native, by_warp, errors, random_runs

GUIDED_TERMS = frozenset(
    name for name, term in TERMS.items() if term.acts_on != "pulley"
)
LIBRARY_FUNCTIONS = (
    "static_memory", "viscous", "grease", "stribeck", "tension_dependent", "ageing",
    "drift", "heating", "stress_relaxation",
)  # fmt: skip
"""Terms whose step calls exp, log or pow, which two libraries may round differently."""
ITERATED = ("soft_anchors",)
"""Those whose rounding decides which of some rounds is good to 1e-5, too."""
SINGLE_STEPS = {"stribeck": 1e-2}
"""Largest RMS error of long motions where the onset of slip depends on single steps."""


@pytest.fixture(scope="module")
def runs() -> Runs:
    return random_runs(each=3, samples=200)


@pytest.fixture(scope="module")
def right(runs: Runs) -> np.ndarray:
    return by_native(runs)


def largest_error(term: str) -> float:
    """Return the largest error of a tension in double precision."""
    if term in ITERATED:
        return 1e-5
    return 1e-10 if term in LIBRARY_FUNCTIONS else 0.0


def test_double_precision_has_the_bits_of_c(runs, right):
    found = errors(by_warp(runs, wp.float64, GUIDED_TERMS), right)
    for term, off in zip(runs.terms, np.abs(found).max(axis=(1, 2)), strict=True):
        assert off <= largest_error(term), term
    assert set(runs.terms) == set(CABLES)


@pytest.mark.study
def test_single_precision_is_right_to_a_thousandth(runs, right):
    found = errors(by_warp(runs, wp.float32, GUIDED_TERMS), right)
    check_single_precision(runs, found, {})


def check_single_precision(
    runs: Runs, found: np.ndarray, exceptions: dict[str, float]
) -> None:
    rms = np.sqrt((found**2).mean(axis=(1, 2)))
    for term in dict.fromkeys(runs.terms):
        own = [off for off, name in zip(rms, runs.terms, strict=True) if name == term]
        assert np.median(own) < 1e-5, term
        assert np.max(own) < exceptions.get(term, 1e-3), term


@pytest.mark.study
@pytest.mark.parametrize("term", CABLES)
def test_a_kernel_of_one_term_is_that_of_all(term):
    runs = random_runs(each=12, samples=600, terms=[term])
    right = by_native(runs)
    draws = [CABLES[term](np.random.default_rng(seed)) for seed in range(9)]
    used = {"friction"} | {n for n in TERMS if any(draw.get(n) for draw in draws)}
    double = errors(by_warp(runs, wp.float64, frozenset(used), True), right)
    assert np.abs(double).max() <= largest_error(term)
    single = errors(by_warp(runs, wp.float32, frozenset(used), True), right)
    check_single_precision(runs, single, SINGLE_STEPS)


@pytest.mark.study
def test_a_million_steps_stay_numbers():
    for seed in range(60):  # a thousand steps of a cable of each of 18 terms
        runs = random_runs(each=1, samples=1000, seed=seed)
        assert np.isfinite(by_warp(runs, wp.float32, GUIDED_TERMS, True)).all()
