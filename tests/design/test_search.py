"""Searches: the same designs however they are run, limits kept, asked for rightly."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco import cli
from cc_mujoco.design import (
    Execution,
    Plan,
    StudySpec,
    make_plan,
    objective_costs,
    optimise,
    pareto_rows,
    read_limits,
    read_objectives,
    study,
)
from cc_mujoco.design._execution import search
from cc_mujoco.design._pareto import MetricLimit, within_limits
from cc_mujoco.design._plan import GENERATION
from cc_mujoco.design._results_store import read_table
from cc_mujoco.design._show import show
from cc_mujoco.errors import CableError
from cc_mujoco.human import Walk
from cc_mujoco.human._pace import MEASURED_SPEED

VARY: dict[str, Any] = {
    "friction": "0.02:0.2",
    "pretension": "2:60:log",
    "motor_radius": [0.03, 0.02],
}
GOALS, LIMITS = ["peak_tension", "rms_torque_error"], ["slack_margin>=20"]
SHORT: dict[str, Any] = {
    "duration": 0.15, "trajectory": "sine", "controllers": ["pi"],
}  # fmt: skip
MORE = GENERATION + 8


def sought(
    scene: str,
    vary: dict[str, Any],
    objectives: Sequence[str],
    subject_to: Sequence[str] = (),
    **fields: Any,
) -> Plan:
    """Return the plan of a search."""
    about = {"evaluations": 400, **fields, "objectives": objectives}
    return make_plan(StudySpec(scene, vary, subject_to=subject_to, **about))


@pytest.fixture(scope="module")
def found() -> pa.Table:
    return optimise("wrist", VARY, GOALS, LIMITS, evaluations=MORE, threads=1, **SHORT)


def test_an_interrupted_search_goes_on_to_the_same_table(
    found: pa.Table, tmp_path: Path
) -> None:
    def stop(done: float) -> None:
        if done > GENERATION:
            raise KeyboardInterrupt

    asked = {**SHORT, "evaluations": MORE, "out": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        optimise("wrist", VARY, GOALS, LIMITS, progress=stop, **asked)
    parts = {p: p.stat().st_mtime_ns for p in (tmp_path / "parts").iterdir()}
    assert parts and not (tmp_path / "table.parquet").exists()
    table = optimise("wrist", VARY, GOALS, LIMITS, **asked)
    assert table.equals(found)
    assert (
        parts.items()
        <= {p: p.stat().st_mtime_ns for p in (tmp_path / "parts").iterdir()}.items()
    )
    log, _ = show(tmp_path, MORE - 1)
    row = table.slice(MORE - 1, 1).to_pylist()[0]
    assert log.metadata["variables"]["friction"] == row["friction"]


def test_a_search_goes_on_beyond_a_generation_that_was_cut_short(
    tmp_path: Path,
) -> None:
    about = ("wrist", VARY, GOALS, LIMITS)
    optimise(*about, evaluations=3, out=tmp_path, **SHORT)
    more = optimise(*about, evaluations=5, out=tmp_path, **SHORT)
    assert more.equals(optimise(*about, evaluations=5, **SHORT))


def test_a_finished_search_that_is_asked_for_fewer_designs_stays_whole(
    tmp_path: Path,
) -> None:
    about = ("wrist", VARY, GOALS, LIMITS)
    whole = optimise(*about, evaluations=3, out=tmp_path, **SHORT)
    plan = sought(*about, evaluations=2, **SHORT)
    said: list[str] = []
    _, table = search(plan, tmp_path, say=said.append)
    assert table.equals(whole) and read_table(tmp_path).equals(whole)
    assert len(said) == 1 and "All 3 designs kept" in said[0] and "the 2 " in said[0]
    fewer = optimise(*about, evaluations=2, out=tmp_path, again=True, **SHORT)
    assert fewer.equals(whole.slice(0, 2)) and len(read_table(tmp_path)) == 2


def test_a_search_with_more_designs_goes_on_with_an_earlier_one(
    found: pa.Table, tmp_path: Path
) -> None:
    asked = {**SHORT, "out": tmp_path}
    few = optimise("wrist", VARY, GOALS, LIMITS, evaluations=GENERATION, **asked)
    kept = list((tmp_path / "parts").iterdir())
    more = optimise("wrist", VARY, GOALS, LIMITS, evaluations=MORE, **asked)
    assert set(kept) < set((tmp_path / "parts").iterdir())
    assert more.equals(found) and more.slice(0, GENERATION).equals(few)
    with pytest.raises(CableError, match="differs in its subject_to"):
        optimise("wrist", VARY, GOALS, ["slack_margin>=3"], evaluations=MORE, **asked)
    other = {**VARY, "friction": "0.02:0.3"}
    with pytest.raises(CableError, match="differs in the values of friction;"):
        optimise("wrist", other, GOALS, LIMITS, evaluations=MORE, **asked)


def test_later_designs_are_better_and_keep_the_limits(found: pa.Table) -> None:
    """The first generation is random."""
    goals, limits = read_objectives(GOALS), read_limits(LIMITS)
    assert set(found["motor_radius"].to_pylist()) <= {0.02, 0.03}
    kept = within_limits(found, limits)
    assert np.mean(kept[GENERATION:]) > np.mean(kept[:GENERATION])
    best = pareto_rows(objective_costs(found, goals, limits))
    assert best.any() and kept[best].all()


def hypervolume(cost: np.ndarray, reference: np.ndarray) -> float:
    """Return the area that costs (designs, 2) dominate below the `reference`."""
    inside = cost[(cost < reference).all(axis=1)]
    inside = inside[np.argsort(inside[:, 0])]
    floor = np.minimum.accumulate(np.append(reference[1], inside[:, 1]))
    return float(np.sum((reference[0] - inside[:, 0]) * -np.diff(floor)))


@pytest.mark.study
def test_a_search_finds_the_front_of_a_grid_with_a_twentieth_of_its_designs() -> None:
    """Areas are those below the grid's worst of the front, a tenth further out."""
    ends = {"motor_radius": "0.01:0.05", "joint_radius": "0.05:0.2"}
    ends["pretension"] = "2:40"
    goals, limits = ["rms_torque_error", "peak_motor_torque"], ["slack_margin>=1"]
    how: dict[str, Any] = {"duration": 1.0, "controllers": ["none"]}

    def front(table: pa.Table) -> np.ndarray:
        cost = objective_costs(table, read_objectives(goals), read_limits(limits))
        return cost[pareto_rows(cost)]

    levels = {name: f"{span}:22" for name, span in ends.items()}
    grid = front(study("wrist", levels, metrics=[*goals, "slack_margin"], **how))
    reference = grid.max(axis=0) + 0.1 * np.ptp(grid, axis=0)
    whole = hypervolume(grid, reference)
    table = optimise("wrist", ends, goals, limits, evaluations=532, **how)
    assert hypervolume(front(table), reference) > whole


def test_what_is_impossible_is_a_row_that_says_so() -> None:
    table = optimise(
        "wrist",
        {"strength": "20:60", "pretension": "10:50"},
        ["peak_tension"],
        evaluations=GENERATION,
        **SHORT,
    )
    weak = np.array(table["pretension"]) >= np.array(table["strength"])
    assert weak.any() and not weak.all()
    for failed, peak, why in zip(
        weak,
        table["peak_tension"].to_pylist(),
        table["failed"].to_pylist(),
        strict=True,
    ):
        assert (peak is None) == failed
        assert failed == bool(why and "must be below the breaking load" in why)


@given(
    bound=st.floats(-1e6, 1e6).map(lambda x: float(f"{x:g}")),
    least=st.booleans(),
    value=st.floats(-1e6, 1e6),
)
def test_a_limit_is_read_as_it_is_written_and_exceeded_beyond_it(
    bound: float, least: bool, value: float
) -> None:
    limit = MetricLimit("peak_tension", bound, least)
    assert read_limits([limit.text]) == (limit,)
    beyond = limit.beyond({"peak_tension": value})
    assert (beyond <= 0.0) == (value >= bound if least else value <= bound)
    table = pa.table({"peak_tension": [value, float("nan")]})
    assert within_limits(table, [limit]).tolist() == [beyond <= 0.0, False]


def test_what_a_search_cannot_do_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for goals, limits, said in (
        ([], [], "1 to 4 objectives, not 0"),
        (["torque_error"], [], "did you mean 'rms_torque_error'"),
        (GOALS, ["slack_margin>1"], "METRIC>=NUMBER"),
        (GOALS, ["slack_margin>=nan"], "METRIC>=NUMBER"),
        (GOALS, ["slackness<=1"], "unknown metric"),
    ):
        with pytest.raises(CableError, match=said):
            sought("wrist", VARY, goals, limits)
    for words in ({"objectives": "slack_margin"}, {"subject_to": LIMITS[0]}):
        (name,) = words
        with pytest.raises(CableError, match=f"{name} must be a list of texts"):
            sought("wrist", VARY, **{"objectives": GOALS, **words})
    with pytest.raises(CableError, match="something to vary"):
        sought("wrist", {}, GOALS)
    for none in (0, -1):
        with pytest.raises(CableError, match=f"at least 1 design, not {none}"):
            sought("wrist", VARY, GOALS, evaluations=none)
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(CableError, match=r"pip install 'cc_mujoco\[search\]'"):
        sought("wrist", VARY, GOALS)


@pytest.mark.usefixtures("undrawn")
def test_the_command_searches_and_says_what_keeps_the_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["whatif", "--vary", "friction=0.02:0.2", "--trajectory", "sine"]
    words += ["--duration", "0.15", "--objective", "peak_tension", "--out"]
    words += [str(tmp_path / "runs"), "--optimise", "8"]
    assert cli.main([*words, "--subject-to", "slack_margin<=-1"]) == 0
    assert "0 keep the limits\nNo design is good enough." in capsys.readouterr().out
    ranking = (tmp_path / "runs" / "ranking.md").read_text()
    assert "slack_margin<=-1; 0 of 8 keep them" in ranking
    words[-1] = "1"
    words += ["--subject-to", "slack_margin<=-1"]
    for again, told in (
        ((), "All 8 designs kept"),
        (["--again"], "1 design, 0 of which"),
    ):
        assert cli.main([*words, *again]) == 0
        assert told in capsys.readouterr().out
    assert cli.main([*words, "--samples", "3"]) == 2
    assert "--optimise chooses the designs itself" in capsys.readouterr().err


def test_strides_that_an_episode_is_too_short_for_are_refused_at_once() -> None:
    """Who walks slowest decides, of designs as of cases."""
    goals = ["wearer_work"]
    for vary, more, speed in (
        ({"friction": "0.05:0.2"}, {}, MEASURED_SPEED),
        ({"gait_speed": "0.8:1.6"}, {}, 0.8),
        ({"gait_speed": [1.2, 0.8]}, {}, 0.8),
        ({"friction": "0.05:0.2"}, {"across": {"gait_speed": "0.8,1.6"}}, 0.8),
    ):
        # Half of a start of 1 s counts as walked, and the first stride is left out.
        end = 0.5 + 2.0 * Walk.at(speed).period
        with pytest.raises(CableError, match="whole strides") as error:
            sought("ankle", vary, goals, duration=end - 0.01, **more)
        assert f"{end + 1e-3:.4g} s after" in str(error.value)
        sought("ankle", vary, goals, duration=end + 0.01, **more)
    with pytest.raises(CableError, match="whole strides"):
        make_plan(StudySpec("ankle", {"friction": "0.1"}, metrics=goals, duration=2.9))


@pytest.mark.parametrize("speed", [0.8, 1.03, 1.6])
def test_an_episode_just_as_long_as_is_asked_for_has_a_stride(speed: float) -> None:
    about: dict[str, Any] = {"metrics": ["peak_assistance"], "timestep": 1e-3}
    about |= {"controllers": ["none"], "threads": 1}
    with pytest.raises(CableError) as error:
        study("ankle", {"gait_speed": speed}, duration=1.0, **about)
    end = float(re.findall(r"ends ([\d.]+) s", str(error.value))[0])
    table = study("ankle", {"gait_speed": speed}, duration=end + 2e-3, **about)
    assert table["peak_assistance"].null_count == 0


@pytest.mark.parametrize("seed", range(2))
def test_no_design_is_tried_twice_and_all_of_a_few_are(seed: int) -> None:
    plan = sought(
        "wrist",
        {"loops": [1, 2, 3], "material": ["steel_ptfe", "steel_steel"]},
        ["rms_torque_error"],
        evaluations=9,
        seed=seed,
        **SHORT,
    )
    said: list[str] = []
    plan, table = search(plan, execution=Execution(threads=1), say=said.append)
    assert len({(d["loops"], d["material"]) for d in plan.designs}) == 6
    assert table.num_rows == 6
    assert "The ranges have 6 designs" in said[0]


def test_a_search_says_early_that_an_objective_has_no_number() -> None:
    vary, goals = {"friction": "0.05:0.2"}, ["efficiency"]
    plan = sought("wrist", vary, goals, evaluations=4, task="transparent", **SHORT)
    said: list[str] = []
    search(plan, execution=Execution(threads=1), say=said.append)
    (sentence,) = said
    assert "None of the first 4 designs has a number for efficiency" in sentence
