"""Indices and effects of functions whose variance is known in closed form."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from cc_mujoco.whatif.plan import Plan, make_plan
from cc_mujoco.whatif.sensitivity import sensitivity

VARY = {"friction": "0:0.4:5", "pretension": "10:50:6", "loops": [1, 2, 3, 4]}
METRICS = ("efficiency",)


def _plan(samples: int | None = None) -> Plan:
    vary = {**VARY, "static_friction": 0.0}
    sampling = "grid" if samples is None else "lhs"
    return make_plan("wrist", vary, sampling=sampling, samples=samples, metrics=METRICS)


def _scaled(plan: Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Variables from -1 to 1."""
    columns = [np.array([float(d[name]) for d in plan.designs]) for name in tuple(VARY)]
    middles, halves = (0.2, 30.0, 2.5), (0.2, 20.0, 1.5)
    a, b, c = ((x - m) / h for x, m, h in zip(columns, middles, halves, strict=True))
    return a, b, c


def test_a_full_grid_is_split_exactly() -> None:
    plan = _plan()
    a, b, c = _scaled(plan)
    y = 2.0 * a + b * c
    found = sensitivity(plan, pa.table({"efficiency": y}), "efficiency")
    assert found is not None and "exact" in found.how
    of_a, of_bc = 4.0 * np.var(a), np.var(b * c)
    assert found.first["friction"] == pytest.approx(of_a / (of_a + of_bc))
    assert found.first["pretension"] == pytest.approx(0.0, abs=1e-12)
    assert found.total["pretension"] == pytest.approx(of_bc / (of_a + of_bc))
    assert found.pairs["pretension", "loops"] == pytest.approx(of_bc / (of_a + of_bc))
    assert found.pairs["friction", "loops"] == pytest.approx(0.0, abs=1e-12)
    values, means = found.effects["friction"]
    assert means == pytest.approx(2.0 * (values - 0.2) / 0.2)


def test_a_surface_tells_what_the_grid_would() -> None:
    plan = _plan(samples=150)
    a, b, c = _scaled(plan)
    y = 2.0 * a + b * c
    found = sensitivity(plan, pa.table({"efficiency": y}), "efficiency")
    assert found is not None and found.surface is not None
    assert found.surface.r_squared > 0.98
    # Loops take four values alike, whose squares have a mean of 5/9.
    of_a, of_bc = 4.0 / 3.0, (1.0 / 3.0) * (5.0 / 9.0)
    share = of_bc / (of_a + of_bc)
    assert found.first["friction"] == pytest.approx(1.0 - share, abs=0.03)
    assert found.total["pretension"] == pytest.approx(share, abs=0.03)
    assert found.pairs["pretension", "loops"] == pytest.approx(share, abs=0.03)


def test_a_hole_in_the_grid_is_bridged_by_a_surface() -> None:
    plan = _plan()
    a, _, _ = _scaled(plan)
    y = [None if i == 7 else float(v) for i, v in enumerate(a)]
    found = sensitivity(plan, pa.table({"efficiency": pa.array(y)}), "efficiency")
    assert found is not None and found.surface is not None
    assert found.first["friction"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("values", [[1.0] * 120, [None] * 120])
def test_what_does_not_vary_depends_on_nothing(values: list[float | None]) -> None:
    table = pa.table({"efficiency": pa.array(values, pa.float64())})
    assert sensitivity(_plan(), table, "efficiency") is None
