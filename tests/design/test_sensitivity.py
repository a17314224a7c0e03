"""Indices and effects of functions whose variance is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cc_mujoco.design import Plan, StudySpec, make_plan
from cc_mujoco.design._report import markdown, sobol_table
from cc_mujoco.design._report_text import RankedStudy
from cc_mujoco.design._sensitivity import sensitivity
from study_marks import study_unless

VARY = {"friction": "0:0.4:5", "pretension": "10:50:6", "loops": [1, 2, 3, 4]}
METRICS = ("efficiency",)


def _plan(samples: int | None = None) -> Plan:
    vary = {**VARY, "static_friction": 0.0}
    sampling = "grid" if samples is None else "lhs"
    return make_plan(
        StudySpec("wrist", vary, sampling=sampling, samples=samples, metrics=METRICS)
    )


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


DUMMIES = {
    "friction": "0:0.4:5",
    "pretension": "10:50:6",
    "motor_torque": "1:2:3",
    "rotor_inertia": "1e-5:2e-5:3",
    "motor_damping": "0:1e-4:3",
    "axial_stiffness": "4e3:6e3:3",
}


def _unit(plan: Plan) -> np.ndarray:
    """Variables from 0 to 1, (designs, variables)."""
    found = np.array([[float(d[name]) for name in DUMMIES] for d in plan.designs])
    ends = np.array([[float(t) for t in v.split(":")[:2]] for v in DUMMIES.values()])
    return np.asarray((found - ends[:, 0]) / (ends[:, 1] - ends[:, 0]))


def _ishigami(unit: np.ndarray) -> np.ndarray:
    a, b, c = np.pi * (2.0 * unit[:, :3].T - 1.0)
    return np.asarray(np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))


def _kinked(unit: np.ndarray) -> np.ndarray:
    a, b, c = unit[:, :3].T
    return np.asarray(np.maximum(a * (1.0 + b) - 0.6, 0.0) + 0.3 * np.exp(-3.0 * c))


KNOWN = {
    # Ishigami and Homma (1990) in closed form.
    _ishigami: ((0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)),
    # By 2^17 points of the function itself.
    _kinked: ((0.737, 0.120, 0.050), (0.829, 0.213, 0.050)),
}


@pytest.mark.parametrize(
    ("samples", "seed"),
    study_unless(lambda each: each[0] < 240, [(40, 1), (120, 1), (240, 0)]),
)
@pytest.mark.parametrize("function", KNOWN)
def test_known_indices_lie_in_their_intervals_and_dummies_have_none(
    function: Callable[[np.ndarray], np.ndarray], seed: int, samples: int
) -> None:
    plan = make_plan(
        StudySpec(
            "wrist",
            {**DUMMIES, "static_friction": 0.0},
            sampling="lhs",
            samples=samples,
            seed=seed,
            metrics=METRICS,
        )
    )
    y = function(_unit(plan))
    found = sensitivity(plan, pa.table({"efficiency": y}), "efficiency")
    if found is None:
        assert function is _ishigami and samples < 120  # too rough for so few
        return
    first, total = KNOWN[function]
    for told, errors, known in (
        (found.first, found.errors[0], first),
        (found.total, found.errors[1], total),
    ):
        for name, truth in zip(DUMMIES, (*known, 0.0, 0.0, 0.0), strict=True):
            assert told[name] == pytest.approx(truth, abs=2.0 * errors[name] + 0.005)
            assert told[name] == 0.0 or abs(told[name]) > errors[name]
        assert all(told[name] == 0.0 for name in list(DUMMIES)[3:])
    dummies = set(list(DUMMIES)[3:])
    assert not any(v for pair, v in found.pairs.items() if dummies & set(pair))
    if function is _kinked or samples == 240:
        assert found.surface is not None and found.surface.r_squared > 0.75
        assert min(found.total[name] for name in list(DUMMIES)[:2]) > 0.0


def test_noise_depends_on_nothing() -> None:
    plan = make_plan(
        StudySpec(
            "wrist",
            {**DUMMIES, "static_friction": 0.0},
            sampling="lhs",
            samples=100,
            metrics=METRICS,
        )
    )
    for seed in range(5):
        y = np.random.default_rng(seed).normal(size=100)
        found = sensitivity(plan, pa.table({"efficiency": y}), "efficiency")
        assert found is None or not any((*found.first.values(), *found.total.values()))


def _reported(plan: Plan, metric: pa.Table) -> str:
    """Return the ranking of a study with these results."""
    count = len(plan.designs)
    columns: dict[str, Any] = {"design": range(count), "failed": pa.nulls(count)}
    columns |= {name: [d[name] for d in plan.designs] for name in plan.varied}
    table = pa.table({**columns, "efficiency": metric["efficiency"]})
    return markdown(RankedStudy(plan, table))


def test_an_index_is_written_with_its_error_or_as_none() -> None:
    plan = _plan(samples=60)
    a, b, c = _scaled(plan)
    table = pa.table({"efficiency": 2.0 * a + b * c + 0.1 * a * b * np.abs(c)})
    found = sensitivity(plan, table, "efficiency")
    assert found is not None
    rows = sobol_table([found]).to_pylist()
    assert all(r["error"] > 0.0 for r in rows)
    assert all(r["share"] == 0.0 or abs(r["share"]) > r["error"] for r in rows)
    text = _reported(plan, table)
    assert "| - ± 0." in text and f"{found.total['friction']:.3f} ± 0." in text
    grid = _plan()
    table = pa.table({"efficiency": _scaled(grid)[0]})
    exact = sensitivity(grid, table, "efficiency")
    assert exact is not None and "±" not in _reported(grid, table)
    assert all(r["error"] == 0.0 for r in sobol_table([exact]).to_pylist())


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
