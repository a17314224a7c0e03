"""One table of metrics: names, units, and metrics of the user beside it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.benchmark import SCORES
from cc_mujoco.design import optimise, study
from cc_mujoco.design._protocol import DEFAULT_METRICS, metric_of_designs
from cc_mujoco.design._results_store import read_study
from cc_mujoco.design._show import show
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import METRICS, ArrayLog, Metric, find_metric, measure
from cc_mujoco.metrics import _registry as registry
from cc_mujoco.viz._episode_files import EPISODE_METRICS

MINE = """
from cc_mujoco.metrics import Metric
PEAK = Metric("peak_angle", "rad", "largest angle", lambda log: {compute}, {better!r})
TAKEN = Metric("efficiency", "1", "x", len)
NAMELESS = Metric("peak angle", "rad", "x", len)
NUMBER = 3.0
"""
PEAK = "float(abs(log['joint_angle_rad']).max())"
SHORT: dict[str, Any] = {"duration": 0.15, "trajectory": "sine", "controllers": ["pi"]}
VARY = {"friction": [0.05, 0.1]}


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Work in a folder of its own, and forget the metrics of a test."""
    monkeypatch.chdir(tmp_path)
    before = dict(METRICS)
    yield
    METRICS.clear()
    METRICS.update(before)
    registry._origins.clear()


def module(name: str, compute: str = PEAK, better: str = "low") -> str:
    """Write a module with metrics; return its name."""
    Path(f"{name}.py").write_text(MINE.format(compute=compute, better=better))
    return name


def test_units_are_si_in_one_spelling_and_every_choice_is_of_the_table() -> None:
    for name, metric in METRICS.items():
        assert metric.name == name
        assert re.fullmatch(r"1|(N|m|s|kg|J|W|Hz|rad)( |\^|/|\w|\d)*", metric.unit)
        assert not re.search(r"Nm|ms|deg", metric.unit)
    assert {*EPISODE_METRICS, *DEFAULT_METRICS, *(s.name for s in SCORES)} <= set(
        METRICS
    )


def test_a_metric_of_every_log_is_the_same_in_a_what_if_and_of_its_recording() -> None:
    names = [
        name
        for name, m in METRICS.items()
        if m.test == "episode" and not m.per_cable and name != "failed"
        if not {*m.needs} - {"pull_pull"}
    ]
    found = study("wrist", VARY, metrics=names, out="study", **SHORT).to_pylist()
    log, _ = show("study", 1)
    for name in names:
        value = METRICS[name].compute(log)
        assert found[1][name] == value or math.isnan(value)


@pytest.mark.usefixtures("undrawn")
def test_a_metric_of_the_user_goes_wherever_one_of_the_table_goes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    name = f"{module('mine_a')}:PEAK"
    words = "play wrist --duration 0.1 --trajectory sine --out played --metric"
    assert cli.main([*words.split(), name]) == 0
    assert re.search(r"peak_angle +\S+ rad", capsys.readouterr().out)
    words = (
        "whatif --vary friction=0.05,0.1 --duration 0.15 --trajectory sine --out out"
    )
    more = ["--objective", f"min:{name}", "--subject-to", f"{name}<=0.9"]
    assert cli.main([*words.split(), "--metric", name, *more]) == 0
    assert "peak_angle" in Path("out", "ranking.md").read_text("utf-8")
    log, _ = show("out", 1)
    (found,) = measure(log, [METRICS["peak_angle"]]).values()
    assert found == float(np.max(np.abs(log["joint_angle_rad"])))
    assert cli.main(["whatif-show", "out", "1", "--against", "0"]) == 0
    assert "peak_angle [rad]" in capsys.readouterr().out


def test_a_metric_is_an_object_in_python() -> None:
    pytest.importorskip("optuna")
    most = Metric("reach", "rad", "x", lambda log: float(log["joint_angle_rad"].max()))
    about: dict[str, Any] = {**SHORT, "metrics": [most], "out": "study"}
    first = study("wrist", VARY, **about)
    assert study("wrist", VARY, **about).equals(first)
    log, _ = _shown_without("study")
    assert first["reach"][0].as_py() == most.compute(log)
    found = optimise("wrist", {"friction": "0.05:0.1"}, ["max:reach"], evaluations=2,
                     metrics=[most], **SHORT)  # fmt: skip
    assert found["reach"].null_count == 0
    other = Metric("reach", "rad", "x", lambda log: float(log["joint_angle_rad"].min()))
    with pytest.raises(CableError, match="metrics of the user"):
        study("wrist", VARY, **about | {"metrics": [other]})
    with pytest.raises(CableError, match="given as a Python object"):
        show("study", 0)


def _shown_without(folder: str) -> Any:
    """Return the log of design 0 of a study of the same designs without metrics."""
    study("wrist", VARY, metrics=["peak_tension"], out=f"{folder}-plain", **SHORT)
    return show(f"{folder}-plain", 0)


def test_a_metric_whose_module_has_changed_makes_a_table_anew() -> None:
    name = f"{module('mine_b')}:PEAK"
    about: dict[str, Any] = {**SHORT, "metrics": [name], "out": "study"}
    study("wrist", VARY, **about)
    assert read_study(Path("study"))["protocol"]["own"] == {"peak_angle": name}
    study("wrist", VARY, **about)
    from cc_mujoco._utils import provenance

    module("mine_b", compute="1.0")
    provenance._source_code.cache_clear()
    with pytest.raises(CableError, match=r"differs in mine_b\.py"):
        study("wrist", VARY, **about)


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        ("peak_tensoin", "did you mean 'peak_tension'"),
        ("no_such:PEAK", "there is no module 'no_such'"),
        ("mine_c:PAEK", "module 'mine_c' has no metric 'PAEK'"),
        ("mine_c:NUMBER", "must be a Metric(name, unit, meaning, compute), not 3.0"),
        ("mine_c:TAKEN", "is called 'efficiency'; it needs a name"),
        ("mine_c:NAMELESS", "is called 'peak angle'; it needs a name"),
        ("failed", "another column of that name"),
        ("slack_time_{cable}", "is of each cable"),
        (3, "must be a Metric(name, unit, meaning, compute), not 3"),
    ],
)
def test_what_is_no_metric_is_one_sentence(given: Any, wrong: str) -> None:
    module("mine_c")
    with pytest.raises(CableError, match=re.escape(wrong)) as error:
        metric_of_designs(given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("compute", "wrong"),
    [
        ("log['joint_angle']", "unknown column 'joint_angle': did you mean"),
        ("1 / 0", "metric 'peak_angle' raised ZeroDivisionError in .*mine_d.*line 3"),
        ("log['joint_angle_rad']", "not a number"),
        ("None", "gave None, not a number"),
    ],
)
def test_a_metric_that_cannot_be_computed_is_one_sentence(
    compute: str, wrong: str
) -> None:
    name = module(f"mine_d{abs(hash(compute))}", compute)
    with pytest.raises(CableError, match=wrong):
        study("wrist", VARY, metrics=[f"{name}:PEAK"], **SHORT)


def test_a_metric_without_a_direction_is_no_objective_by_itself() -> None:
    name = f"{module('mine_e', better='')}:PEAK"
    for given in (name, "torque_lag"):
        with pytest.raises(CableError, match="better neither high nor low; write min:"):
            optimise("wrist", {"friction": "0.05:0.1"}, [given], **SHORT)


def test_a_record_names_the_nearest_column() -> None:
    with pytest.raises(CableError, match="did you mean 'time_s'"):
        ArrayLog({"time_s": np.zeros(3)})["time"]
    assert find_metric(METRICS["efficiency"]) is METRICS["efficiency"]
