"""Designs over several cases: what is told of them, kept, and refused."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco import cli
from cc_mujoco.control import CONTROLLERS, Controller
from cc_mujoco.design import (
    Execution,
    StudySpec,
    carry_out,
    make_plan,
    objective_costs,
    optimise,
    read_limits,
    study,
)
from cc_mujoco.design._evaluation import evaluate
from cc_mujoco.design._pareto import within_limits
from cc_mujoco.design._scenarios import Across
from cc_mujoco.design._show import show
from cc_mujoco.device import Plant
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.metrics import METRICS
from cc_mujoco.simulation import EpisodeLog

MEASURED = ("rms_torque_error", "slack_margin", "peak_tension", "efficiency")
SHORT: dict[str, Any] = {
    "duration": 0.1,
    "timestep": 1e-3,
    "controllers": ["pi"],
    "trajectory": "sine",
    "metrics": MEASURED,
    "threads": 1,
}
VARY: dict[str, Any] = {"motor_radius": [0.02, 0.03]}
ACROSS: dict[str, Any] = {"friction": [0.05, 0.15], "pretension": [10.0, 20.0]}


def numbers(table: pa.Table, name: str) -> Any:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


@pytest.fixture(scope="module")
def alone() -> list[tuple[str, pa.Table]]:
    """Return a separate study of each case."""
    found = []
    for values in itertools.product(*ACROSS.values()):
        case = dict(zip(ACROSS, values, strict=True))
        label = ", ".join(f"{name}={value:g}" for name, value in case.items())
        ranges = {name: [value] for name, value in case.items()}
        found.append((label, study("wrist", {**VARY, **ranges}, **SHORT)))
    return found


@pytest.fixture(scope="module")
def found() -> dict[str, pa.Table]:
    """Return a study over all cases for each rank."""
    return {
        rank: study("wrist", VARY, across=ACROSS, rank=rank, **SHORT)
        for rank in ("worst", "p90", "mean")
    }


@pytest.mark.parametrize("rank", ["worst", "p90", "mean"])
def test_a_table_is_the_aggregate_of_the_studies_of_its_cases_bit_for_bit(
    rank: str, alone: list[tuple[str, pa.Table]], found: dict[str, pa.Table]
) -> None:
    table = found[rank]
    assert table["failed"].null_count == len(table) == 2
    for name in MEASURED:
        high = METRICS[name].high
        each = np.stack([numbers(one, name) for _, one in alone], axis=-1)
        for row, values in enumerate(each):
            least, most = np.min(values), np.max(values)
            expected = {
                "worst": least if high else most,
                "p90": np.quantile(values, 0.1 if high else 0.9),
                "mean": np.mean(values),
            }[rank]
            columns = (name, f"{name}@least", f"{name}@most")
            told = [numbers(table, column)[row] for column in columns]
            assert np.array_equal(told, [expected, least, most], equal_nan=True)
            place = int(np.argmin(values) if high else np.argmax(values))
            assert table[f"{name}@worst_case"][row].as_py() == alone[place][0]
    for field in table.schema:
        assert field.metadata[b"meaning"]
    least, most = (numbers(table, f"peak_tension{of}") for of in ("@least", "@most"))
    assert len(set(least)) > 1 and np.all(least < most)


@given(
    values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=12),
    high=st.booleans(),
    rank=st.sampled_from(["worst", "p90", "mean"]),
)
def test_ranks_are_ordered_and_the_good_end_mirrors_the_bad(
    values: list[float], high: bool, rank: str
) -> None:
    across = Across((("friction", tuple(range(len(values)))),), rank)
    found = across.of(values, high)
    assert found == pytest.approx(-across.of([-v for v in values], not high))
    assert min(values) - 1e-6 <= found <= max(values) + 1e-6
    worst = Across(across.levels).of(values, high)
    assert worst == (min(values) if high else max(values))
    assert np.isnan(across.of([*values, np.nan], high))


def test_the_table_is_the_same_on_any_number_of_threads(
    found: dict[str, pa.Table],
) -> None:
    table = study("wrist", VARY, across=ACROSS, **{**SHORT, "threads": 2})
    assert table.equals(found["worst"], check_metadata=True)


def test_a_wearer_of_factor_one_is_that_of_the_scene_and_others_are_not() -> None:
    plain = study("wrist", {"pretension": [10.0]}, **SHORT)
    one, soft = (
        study("wrist", {"pretension": [10.0]}, across={"wearer": [w]}, **SHORT)
        for w in (1.0, 0.1)
    )
    assert one["peak_tension"].equals(plain["peak_tension"])
    assert not soft["peak_tension"].equals(plain["peak_tension"])
    assert Plant("wrist", {"wearer": 2.0}).wearers == {"wrist": Wearer(100.0, 1.6)}


def test_a_design_is_shown_in_its_worst_case_unless_another_is_asked_for(
    tmp_path: Path,
) -> None:
    cases = {"wearer": [0.2], "pretension": [5.0, 30.0]}
    table = study("wrist", VARY, across=cases, out=tmp_path, **SHORT)

    def error(log: EpisodeLog) -> float:
        return METRICS["rms_torque_error"].compute(log)

    log, _ = show(tmp_path, 1)
    assert error(log) == table["rms_torque_error"][1].as_py()
    told = table["rms_torque_error@worst_case"][1].as_py()
    variables = log.metadata["variables"]
    assert told == ", ".join(f"{name}={variables[name]:g}" for name in cases)
    other = cases["pretension"].index(variables["pretension"]) ^ 1
    least = table["rms_torque_error@least"][1].as_py()
    assert error(show(tmp_path, 1, case=other)[0]) == least < error(log)
    with pytest.raises(CableError, match="cases 0 to 1, not 2"):
        show(tmp_path, 1, case=2)


class _StopError(Exception):
    pass


def test_an_interrupted_study_goes_on_and_another_over_other_cases_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: dict[str, pa.Table]
) -> None:
    plan = make_plan(StudySpec("wrist", VARY, across=ACROSS, **_but("threads")))

    def stop(done: float) -> None:
        if done > 1.0:
            raise _StopError

    with pytest.raises(_StopError):
        carry_out(plan, tmp_path, Execution(threads=1), progress=stop)
    kept = len(list((tmp_path / "parts").iterdir()))
    assert 0 < kept < len(plan.batches)
    calls: list[int] = []
    monkeypatch.setattr(
        "cc_mujoco.design._evaluation.evaluate",
        lambda *arguments: calls.append(1) or evaluate(*arguments),
    )
    table = carry_out(plan, tmp_path, Execution(threads=1))
    assert len(calls) == len(plan.batches) - kept
    assert table.equals(found["worst"], check_metadata=True)
    for about, differs in (
        ({"across": {**ACROSS, "friction": [0.05]}}, "across"),
        ({"across": ACROSS, "rank": "mean"}, "rank"),
        ({}, "across"),
    ):
        with pytest.raises(CableError, match=f"differs in its {differs};"):
            study("wrist", VARY, out=tmp_path, **about, **SHORT)
    assert study("wrist", VARY, across=ACROSS, out=tmp_path, **SHORT).equals(table)


def _but(*names: str) -> dict[str, Any]:
    return {name: value for name, value in SHORT.items() if name not in names}


def test_a_case_in_which_a_design_fails_or_has_no_number_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:

    class Mad(Controller):
        """Gives no number where the motor is strong."""

        def reset(self, where: Any = None) -> None:
            """Nothing to forget."""

        def torque(self, observation: Any) -> Any:
            """Zero, or not a number."""
            mad = np.asarray(self.drive.high) > 0.5
            return np.where(mad, np.nan, 0.0 * observation["joint_angle_rad"])

    monkeypatch.setitem(CONTROLLERS, "mad", Mad)
    cases = {"motor_torque": [0.1, 1.0]}
    about = {**SHORT, "controllers": ["mad"]}
    (row,) = study("wrist", {"pretension": [10.0]}, across=cases, **about).to_pylist()
    assert row["failed"].startswith("in case motor_torque=1: controller 'mad' gave no")
    assert row["rms_torque_error"] is row["rms_torque_error@least"] is None
    assert row["rms_torque_error@worst_case"] is None
    across = Across((("friction", (0.1, 0.2, 0.3)),))
    assert np.isnan(across.of([1.0, np.nan, 3.0], high=False))
    for high in (False, True):
        assert across.worst([1.0, np.nan, 3.0], high) == "friction=0.2"


def test_of_several_controllers_one_is_chosen_for_all_cases() -> None:
    laws, cases = ["none", "pi"], {"friction": [0.02, 0.3]}
    about, vary = _but("controllers"), {"motor_torque": [1.0]}
    both = study("wrist", vary, across=cases, controllers=laws, **about)
    each = {
        law: study("wrist", vary, across=cases, controllers=[law], **about)
        for law in laws
    }
    for place, row in enumerate(both.to_pylist()):
        errors = {law: each[law]["rms_torque_error"][place].as_py() for law in laws}
        best = min(laws, key=lambda law: errors[law])
        alone = each[best].slice(place, 1).to_pylist()[0]
        assert row["controller"] == best
        assert {name: row[name] for name in alone} == alone
        for law in laws:
            assert row[f"rms_torque_error@{law}"] == errors[law]


def test_limits_hold_in_every_case_whatever_the_rank_and_goals_turn_the_worst(
    found: dict[str, pa.Table],
) -> None:
    about = {**_but("threads"), "metrics": ("peak_tension", "slack_margin")}
    goals = ["max:peak_tension"]
    plan = make_plan(StudySpec("wrist", VARY, across=ACROSS, objectives=goals, **about))
    table = carry_out(plan, execution=Execution(threads=1))
    assert table["peak_tension"].equals(table["peak_tension@least"])
    mean = found["mean"]
    least, middle = (numbers(mean, f"slack_margin{of}") for of in ("@least", ""))
    bound = (least.max() + middle.max()) / 2
    assert least.max() < bound < middle.max()
    text = [f"slack_margin>={bound}"]
    assert within_limits(mean, read_limits(text)).any()
    limits = read_limits(text, across=True)
    assert not within_limits(mean, limits).any()
    assert np.isnan(objective_costs(mean, plan.objectives, limits)).all()
    most = numbers(mean, "peak_tension@most")
    (limit,) = read_limits([f"peak_tension<={np.median(most)}"], across=True)
    assert within_limits(mean, [limit]).tolist() == (most <= limit.bound).tolist()


def test_a_search_goes_by_the_worst_case_and_goes_on(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    about = {**_but("metrics"), "across": {"friction": [0.05, 0.15]}, "rank": "mean"}
    vary = {"pretension": "5:300", "motor_radius": [0.02, 0.03]}
    asked = (vary, ["peak_tension"], ["slack_margin>=3"])

    def stop(done: float) -> None:
        if done > 9.0:
            raise _StopError

    kept = {**about, "evaluations": 10, "out": tmp_path}
    with pytest.raises(_StopError):
        optimise("wrist", *asked, progress=stop, **kept)
    assert list((tmp_path / "parts").iterdir())
    more = optimise("wrist", *asked, **kept)
    assert more.equals(optimise("wrist", *asked, **{**kept, "out": None}))
    with pytest.raises(CableError, match="differs in its rank;"):
        optimise("wrist", *asked, **{**kept, "rank": "p90"})
    assert any("in case friction=0.05" in (t or "") for t in more["failed"].to_pylist())
    good = more.filter(more["failed"].is_null())
    assert len(good) > 0
    pair = {
        f: study("wrist", designs=[
            {"pretension": p, "motor_radius": r, "friction": f}
            for p, r in zip(good["pretension"].to_pylist(),
                            good["motor_radius"].to_pylist(), strict=True)
        ], **SHORT)
        for f in (0.05, 0.15)
    }  # fmt: skip
    for place, value in enumerate(numbers(good, "peak_tension")):
        both = [numbers(pair[f], "peak_tension")[place] for f in pair]
        assert value == np.mean(both)


@pytest.mark.parametrize(
    ("about", "wrong"),
    [
        ({"across": {"frictoin": [0.1]}}, "unknown case 'frictoin': did you mean 'fri"),
        ({"across": {"gait_speed": [1.0]}}, "needs a wearer who walks, as in 'ankle'"),
        ({"across": {"pretension": [9.0]}}, "'pretension' is both varied and crossed"),
        ({"across": {"flexor.pretension": [9.0]}}, "varied, and 'flexor.pretension'"),
        ({"across": {"loops": [1], "wrap": [3]}}, "set the same thing; cross one"),
        ({"across": {"wearer": [0.0]}}, r"'wearer' must be .*\[0.001, 1000\], not 0"),
        ({"across": {"friction": "0.1:0.2"}}, "how many values 'friction' takes"),
        ({"across": {"friction": [0.1]}, "rank": "men"}, "unknown rank 'men': did you"),
        ({"rank": "mean"}, "needs cases to rank over"),
        ({"across": {"strength": [15.0, 50.0]}},
         r"design 1 .*: in case strength=15, the pretension of cable"),
    ],
)  # fmt: skip
def test_what_cannot_be_crossed_is_one_sentence(
    about: dict[str, Any], wrong: str
) -> None:
    vary = {**VARY, "pretension": [10.0, 20.0]}
    with pytest.raises(CableError, match=wrong) as error:
        make_plan(StudySpec("wrist", vary, **about, **_but("threads")))
    assert "\n" not in str(error.value)


def test_the_command_says_over_what_it_ranks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["whatif", "--vary", "pretension=10", "--metric", "slack_margin",
             "--metric", "peak_tension", "--objective", "peak_tension", "--duration",
             "0.1", "--trajectory", "sine", "--workers", "1"]  # fmt: skip
    cases = ["--across", "wearer=0.5,2", "--across", "friction=0.08,0.16"]
    limit = ["--subject-to", "slack_margin>=1"]
    assert cli.main([*words, *cases, *limit, "--out", "s"]) == 0
    told = "the worst over 4 cases (wearer 0.5, 2; friction 0.08, 0.16)"
    for name, column in (
        ("report.html", "peak tension, worst case"),
        ("ranking.md", "peak_tension@worst_case"),
    ):
        text = Path("s", name).read_text(encoding="utf-8")
        assert told in text and column in text
    assert "friction, from case to case" in Path("s", "report.html").read_text()
    capsys.readouterr()
    for wrong, why in (
        (["--across", "friction"], "across: 'friction' must be NAME=VALUES."),
        ([*cases, *cases], "across gives 'wearer' twice."),
        (["--across", "pretension=9"], "'pretension' is both varied and crossed"),
        (["--rank", "mean"], "'mean', needs cases to rank over"),
    ):
        assert cli.main([*words, *wrong, "--out", "t"]) == 2
        said = capsys.readouterr().err
        assert why in said and said.count("\n") == 1
    assert not Path("t").exists()
