"""The textile of the rigs: its loop, and two makes that agree about it."""

from __future__ import annotations

import numpy as np
import pytest
from rare_effects import session_of

from rig import soft_anchor
from rig.nominal import make_rig

COMPLIANCE, SERIES = 8e-5, 1e5


def pulled(tensions: np.ndarray) -> tuple[np.ndarray, float]:
    """Return stretches of textile that a line pulls to these tensions [N], and heat."""
    state, found, heat = soft_anchor.fabric(COMPLIANCE, 0.0)[0], [], 0.0
    whole = 0.0
    for tension in tensions:
        step = 4e-3
        for _ in range(40):  # bisection on the stretch of line and textile
            now, _, x = soft_anchor.series(COMPLIANCE, state, SERIES, whole)
            step *= 0.5
            whole += step if now < tension else -step
        before = state.copy()
        soft_anchor.slide(COMPLIANCE, state, x)
        slid = np.abs(state - before)[soft_anchor.STUCK :]
        heat += float(slid @ soft_anchor.SHARE) * spring_of(x)
        found.append(x)
    return np.array(found), heat


def spring_of(x: float) -> float:
    y = x / COMPLIANCE
    return float(y + y**3 / soft_anchor.HARD**2)


def test_a_large_cycle_loses_what_its_fibres_rub() -> None:
    up = np.linspace(0.5, 200.0, 400)
    x, heat = pulled(np.concatenate([up, up[::-1]]))
    paid, returned = np.trapezoid(up, x[:400]), -np.trapezoid(up[::-1], x[400:])
    assert paid - returned == pytest.approx(heat, rel=0.02)
    held = soft_anchor.SHARE.sum()
    assert 0.08 < 1.0 - returned / paid < 2.0 * held / (1.0 + held)
    assert all(
        t <= spring_of(each) * (1.0 + held) * (1.0 + 1e-6)
        for t, each in zip(up, x[:400], strict=True)
    )


def test_two_makes_show_the_same_textile() -> None:
    names = "motor_torque_nm", "joint_torque_nm"
    shown = []
    for make in ("bristles", "guides"):
        trial = session_of("soft_anchor", make_rig(820, make=make))[0][0]
        shown.append(np.stack([trial[name] for name in names]))
    size = np.std(shown[0], axis=1)
    assert np.all(np.std(shown[1] - shown[0], axis=1) < 0.03 * size)
