"""Level walking as a few harmonics: joint angles and the assistance of a soft exosuit.

    >>> from cc_mujoco.human._gait import GAIT_ANGLES, assistance
    >>> round(GAIT_ANGLES["ankle"](0.5), 2)          # rad, dorsiflexed before push-off
    0.23
    >>> round(assistance(0.1), 2), round(assistance(0.52), 1)
    (0.0, 1.0)

The gait cycle runs from one heel strike (phase 0) to the next of the same leg. Angles
are in the convention of the data: ankle positive in dorsiflexion, knee negative in
flexion, hip positive in flexion. `gait.csv` states the source and the fit errors.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cc_mujoco.human._pace import Real


@dataclass(frozen=True)
class Harmonics:
    """A smooth function of the phase with period 1.

    f(p) = sum over k of a_k cos(2 pi k p) + b_k sin(2 pi k p), k = 0 .. n.
    """

    coefficients: tuple[tuple[float, float], ...]  # pairs (a_k, b_k), from k = 0

    def __call__(self, phase: Real) -> Real:
        """Evaluate f, elementwise; scalars and arrays give the same bits."""
        turn = 2 * np.pi * phase
        cosine, sine = np.cos(turn), np.sin(turn)
        if not isinstance(turn, np.ndarray):
            cosine, sine = float(cosine), float(sine)
        # Horner's rule on the real part of sum (a_k - i b_k) z^k with z = exp(i turn).
        # In real arithmetic, because complex products round differently in vectors.
        last_a, last_b = self.coefficients[-1]
        real, imaginary = last_a + 0 * cosine, -last_b + 0 * cosine
        for a, b in reversed(self.coefficients[:-1]):
            before = real
            real = before * cosine - imaginary * sine + a
            imaginary = before * sine + imaginary * cosine - b
        return real

    def derivative(self) -> Harmonics:
        pairs = enumerate(self.coefficients)
        turned = ((2 * np.pi * k * b, -2 * np.pi * k * a) for k, (a, b) in pairs)
        return Harmonics(tuple(turned))


def _read_profiles() -> dict[str, Harmonics]:
    pairs: dict[str, list[tuple[float, float]]] = {}
    with Path(__file__).with_name("gait.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if line[0] != "#"):
            pair = float(row["cosine"]), float(row["sine"])
            pairs.setdefault(row["profile"], []).append(pair)
    return {name: Harmonics(tuple(own)) for name, own in pairs.items()}


_PROFILES = _read_profiles()

GAIT_ANGLES = {name: _PROFILES[name] for name in ("ankle", "knee", "hip")}
"""Joint angles [rad] over the gait cycle."""

GAIT_MOMENTS = {name: _PROFILES[f"{name}_moment"] for name in GAIT_ANGLES}
"""Moments of the muscles about the joints over the gait cycle [N m], of the same walk,
positive as the angles are: that of the ankle is negative in plantarflexion."""

GAIT_PERIOD = 1.23
"""Duration of a gait cycle of the measured walk [s], as `scripts/fit_gait.py` prints
it."""


def assistance(phase: Real) -> Real:
    """Return the plantarflexion assistance by the fraction of the gait cycle [-].

    It is a fraction of its peak [-], elementwise, and the square of a harmonic series,
    hence smooth and never negative: at most 0.01 where the source has none.
    """
    root = _PROFILES["assistance_root"](phase)
    return root * root
