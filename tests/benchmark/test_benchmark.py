"""The benchmark: drawn plants, references, and that runs repeat and resume."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest

from cc_mujoco.benchmark import (
    REFERENCES,
    SUITES,
    Belief,
    BenchmarkPlan,
    Cell,
    Condition,
    _runner,
    _user_entry,
    batch_groups,
    play,
    play_group,
    run,
)
from cc_mujoco.benchmark import _page as drawing
from cc_mujoco.benchmark._cell import CUT_SHARE, prepare_episodes
from cc_mujoco.benchmark._conditions import MODEL_ERRORS, TRANSMISSIONS
from cc_mujoco.benchmark._page import CAPTIONS, pareto, write
from cc_mujoco.benchmark._plant import sample_plants
from cc_mujoco.benchmark._report import cut_sentences, device_tables, summary
from cc_mujoco.benchmark._results import by_device, read_results
from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.human import Hold, Spring
from cc_mujoco.report import figure
from study_marks import study_but

WRIST = {
    condition.name: dataclasses.replace(condition, duration=1.05)
    for condition in SUITES["v1"].conditions("wrist")
}
USUAL = WRIST["ordinary-rough"]
SHORT = BenchmarkPlan(
    ("none",),
    scenes=("wrist",),
    conditions=("ordinary-rough",),
    seeds=1,
    duration=1.05,
)


def test_the_suite_crosses_what_depends_and_varies_the_rest_one_at_a_time() -> None:
    for scene in SUITES["v1"].scenes:
        conditions = SUITES["v1"].conditions(scene)
        names = [condition.name for condition in conditions]
        assert len(set(names)) == len(names)
        (usual,) = (condition for condition in conditions if condition.usual)
        for condition in conditions:
            differing = {
                field.name
                for field in dataclasses.fields(Condition)
                if getattr(condition, field.name) != getattr(usual, field.name)
            } - {"name"}
            alone = differing <= {"trajectory", "task"} or len(differing) == 1
            assert alone or differing <= {"transmission", "error"}
    crossed = {f"{t}-{e}" for t in TRANSMISSIONS for e in MODEL_ERRORS}
    assert crossed <= set(WRIST)


WRONG = "benchmark.entries:wrong"


def test_a_seed_and_a_condition_are_one_plant_whoever_else_is_drawn() -> None:
    first, second = sample_plants(USUAL, (3, 5))
    (again,) = sample_plants(USUAL, (5,))
    assert second == again
    flexors = first.plant.cables["flexor"], second.plant.cables["flexor"]
    assert len({*flexors, second.plant.cables["extensor"]}) == 3
    assert first.plant.wearers != second.plant.wearers
    assert first.bias != second.bias
    other = sample_plants(WRIST["delay-long"], (3,))[0]
    assert 3 <= other.plant.delay <= 5 and other.plant.cables != first.plant.cables
    (exact,) = sample_plants(WRIST["ordinary-exact"], (3,))
    assert exact == first
    many = sample_plants(USUAL, range(60))
    friction = [drawn.plant.cables["flexor"].friction for drawn in many]
    assert np.mean(friction) == pytest.approx(0.1, rel=0.1)
    assert np.std(friction) == pytest.approx(0.015, rel=0.3)
    assert {drawn.plant.delay for drawn in many} == {1, 2}


def test_a_belief_is_wrong_by_its_error_and_without_one_right() -> None:
    cable = Cable(friction=0.2, static_friction=0.6)
    random = np.random.default_rng(0)
    assert Belief(0.0).of(cable, random) == cable
    wrong = [Belief(0.1).of(cable, random).friction / 0.2 for _ in range(300)]
    assert np.std(wrong) == pytest.approx(0.1, rel=0.15)
    biased = Belief(0.0, bias=0.5).of(cable, random)
    assert biased.friction == pytest.approx(0.3)
    assert biased.static_friction == pytest.approx(0.9)


def test_cells_played_together_give_what_each_gives_alone() -> None:
    names = ("delay-long", "noise-loud", "wearer-soft")
    cells = [
        Cell(dataclasses.replace(WRIST[name], duration=1.1), "stiction", (0, 1))
        for name in names
    ]
    assert [len(group) for group in batch_groups(cells)] == [3]
    group = play_group(cells)
    alone = play(dataclasses.replace(cells[1], seeds=(1,)))
    for name, values in alone.scores.items():
        assert np.array_equal(values, group[1].scores[name][1:], equal_nan=True)
    for name, drawn in alone.plants.items():
        assert drawn == group[1].plants[name][1:]


def test_a_cell_is_the_episode_of_the_environment_on_its_plant() -> None:
    cell = Cell(WRIST["delay-none"], "none", (4,))
    found = play(cell).scores["rms_torque_error"]
    (drawn,) = sample_plants(cell.condition, cell.seeds)
    plant = drawn.plant
    env: Any = gymnasium.make(
        "cc_mujoco/WristHandle-v1",
        disable_env_checker=True,
        trajectory=drawn.trajectory,
        task=cell.condition.task,
        duration=1.05,
        model=plant.model(whole=True),
    ).unwrapped
    _, info = env.reset(seed=drawn.seed)
    assert float(env.drive.cables[0].cable.friction) == plant.cables["flexor"].friction
    errors = []
    for step in range(1051):
        errors.append(info["joint_torque_nm"] - info["desired_torque_nm"])
        if step < 1050:
            # Encoders of the benchmark do not come into it: the task is known.
            torque = np.clip(info["desired_torque_nm"] / env.drive.ratio, -1.0, 1.0)
            *_, info = env.step(env.action(torque))
    assert np.sqrt(np.mean(np.square(errors[500:]))) == pytest.approx(found[0])


@pytest.fixture(scope="module")
def usual() -> dict[str, Any]:
    """Return one usual episode of each reference, and of `none`, by name."""
    names = (*REFERENCES, "none")
    return {name: play(Cell(USUAL, name, (0,))) for name in names}


def test_references_give_the_scores_a_scale(usual: dict[str, Any]) -> None:
    error, effort = {}, {}
    for name, played in usual.items():
        assert played.scores["failed"][0] == 0.0
        error[name] = played.scores["rms_torque_error"][0]
        effort[name] = played.scores["rms_motor_torque"][0]
        if name == "unplugged":
            assert played.scores["slack_under_load"][0] == 0.0
            made = prepare_episodes([Cell(USUAL, name, (0,))])
            names = "desired_torque_nm", "joint_torque_nm"
            rows = made.batch.play(made.law, made.sensors.measure, names)
            asked = rows[names[0]][500:]
            assert np.abs(rows[names[1]]).max() < 1e-4
            assert error[name] == pytest.approx(np.sqrt(np.mean(asked**2)), rel=0.02)
        if name == "perfect-model":
            for key in ("friction", "axial_stiffness", "pretension"):
                assert played.plants[f"believed_{key}"] == played.plants[f"plant_{key}"]
    assert effort["unplugged"] == effort["motor-off"] == 0.0 < effort["none"]
    assert error["ideal-transmission"] < 0.1 * error["none"]
    assert len({*error.values()}) == len(usual)


@pytest.mark.parametrize(
    ("scene", "law"),
    study_but(
        4,
        [
            ("ankle", "predictive"),  # whose damper follows from the stiffness
            ("wrist", "pi_tuned"),
            ("wrist", "inverse"),
            ("wrist", "lqg"),
        ],
    ),
)
def test_a_plant_has_the_same_controller_in_any_company(scene: str, law: str) -> None:
    conditions = {one.name: one for one in SUITES["v1"].conditions(scene)}
    cells = [
        Cell(dataclasses.replace(conditions[name], duration=1.1), law, (0, 1))
        for name in ("wearer-stiff", "good-bad")
    ]
    assert batch_groups(cells) == [cells]
    for cell, together in zip(cells, play_group(cells), strict=True):
        alone = play(dataclasses.replace(cell, seeds=cell.seeds[1:]))
        for name, values in alone.scores.items():
            assert np.array_equal(values, together.scores[name][1:], equal_nan=True)


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BenchmarkPlan:
    """Return a plan of a user's controller that reads its gain from a file."""
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "helper"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    blank = figure(1.0, 1.0)
    for stem in CAPTIONS:
        monkeypatch.setattr(drawing, stem, lambda *_: blank)
    Path("helper.py").write_text(
        "from pathlib import Path\nCC_MUJOCO_FILES = ('gain.toml',)\n"
        "def gain():\n    return float(Path('gain.toml').read_text())\n"
    )
    Path("mine.py").write_text(
        "import helper\n"
        "def make(drive):\n"
        "    gain = helper.gain()\n"
        "    return lambda seen: gain * seen['desired_torque_nm']\n"
    )
    Path("gain.toml").write_text("0.0")
    return dataclasses.replace(SHORT, controllers=("mine:make",))


@pytest.mark.usefixtures("undrawn")
def test_a_run_resumes_and_replays_other_code(
    mine: BenchmarkPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_runner, "time_steps", lambda _: (1e-6, 2e-6))
    tables, kept, errors, said = [], [], [], []
    for gain in ("0.0", "0.0", "0.2"):
        Path("gain.toml").write_text(gain)
        counts: list[float] = []
        results = run(mine, "a", workers=1, progress=counts.append, say=said.append)
        kept.append(counts[0])
        errors.append(float(results[-1][1].scores["rms_torque_error"][0]))
        write("a", mine, results, "none")
        table = pq.read_table(Path("a", "results.parquet"))
        times = [n for n in table.column_names if n.startswith("step_")]
        assert len(times) == 2
        tables.append(repr(table.drop_columns(times).to_pylist()))
    assert kept == [0.0, 6.0, 5.0]
    assert errors[0] == errors[1] != errors[2]
    assert tables[0] == tables[1] != tables[2]
    again = "cells kept; --again runs them anew."
    assert said == [
        f"6 of 6 {again}",
        f"5 of 6 {again} Earlier cells are replaced: they differ in gain.toml.",
    ]
    found, about = read_results("a/results.parquet")
    assert list(found["wrist"]) == [*REFERENCES, "none", "mine:make"]
    assert about["suite"] == "v1" and about["machine"]["processors"] >= 1
    assert "gain.toml" in about["made_by"]["files"]
    assert "Spring(stiffness=2.5)" in about["conditions"]["wrist ordinary-rough"]


@pytest.mark.study
def test_a_run_is_the_same_in_two_processes(mine: BenchmarkPlan) -> None:
    here, there = (run(mine, folder, workers=n) for folder, n in (("a", 1), ("b", 2)))
    for (one, found), (other, same) in zip(here, there, strict=True):
        assert one == other
        for name, values in found.scores.items():
            assert np.array_equal(values, same.scores[name], equal_nan=True)


def test_a_controller_that_gives_no_number_fails_and_a_wrong_shape_is_refused() -> None:
    short = Cell(USUAL, WRONG, (0, 1))
    assert play(short).scores["failed"].tolist() == [1.0, 1.0]
    for name, why in (
        ("wide", r"'benchmark\.entries:wide' gave torques of shape \(2, 17\)"),
        (
            "curious",
            r"raised KeyError in .*entries\.py, line \d+: 'tension_flexor.*; unknown",
        ),
        ("ending", "wrist ordinary-rough, seeds 0, 1: .* process, with exit code 7"),
    ):
        with pytest.raises(CableError, match=why):
            play(dataclasses.replace(short, controller=f"benchmark.entries:{name}"))


def test_a_report_says_what_share_of_torques_was_cut() -> None:
    cell = Cell(USUAL, "benchmark.entries:strong", (0, 1))
    result = play(cell)
    assert result.plants[CUT_SHARE] == pytest.approx([0.5, 0.5], abs=1e-3)
    assert CUT_SHARE not in play(dataclasses.replace(cell, controller="pi")).plants
    (sentence,) = cut_sentences([(cell, result)])
    assert "entries:strong` commanded more than the motor gives in 50 %" in sentence


@pytest.mark.parametrize(
    ("name", "what"), [("endless", "`torque`"), ("unmade", "its function")]
)
def test_an_entry_that_hangs_is_named(
    name: str, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = Cell(USUAL, f"benchmark.entries:{name}", (0,))
    play(dataclasses.replace(cell, controller="benchmark.entries:strong"))
    monkeypatch.setattr(_user_entry, "ANSWER_TIME", 5.0)
    with pytest.raises(CableError, match=rf"{name}' hangs.*{what} did not return"):
        play(cell)


@pytest.mark.filterwarnings("error")
def test_a_report_says_which_controller_gave_no_number(usual: dict[str, Any]) -> None:
    results = [(Cell(USUAL, name, (0,)), played) for name, played in usual.items()]
    results.append((cell := Cell(USUAL, WRONG, (0,)), play(cell)))
    tables = f"{summary(results)} {device_tables(by_device(results)[0], 'none')}"
    assert "entries:wrong` ended 1 of 1 episodes early; the first: wrist " in tables
    assert "ordinary-rough, seed 0: controller 'benchmark.entries:wrong' gave" in tables
    assert "nan" not in tables
    pareto(*by_device(results))


def test_what_cannot_be_played_is_refused() -> None:
    about = USUAL.trajectory, Spring()
    for arguments, why in (
        (("elbow", "", *about), "unknown device"),
        (("wrist", "", *about, "oily"), "unknown transmission"),
        (("wrist", "", *about, "good", "awful"), "unknown error"),
        (("wrist", "", *about, "good", "bad", 1.0, (2, 1)), "delay"),
    ):
        with pytest.raises(CableError, match=why):
            Condition(*arguments)
    with pytest.raises(CableError, match="duration"):
        dataclasses.replace(USUAL, duration=0.5)
    with pytest.raises(CableError, match="seed"):
        Cell(USUAL, "pi", ())
    for changes, why in (
        ({"controllers": ()}, "at least one controller"),
        ({"controllers": ("unplugged",)}, "is a reference"),
        ({"controllers": ("runs/p.safetensors", "runs_p.safetensors")}, "same files"),
        ({"suite": "v0"}, "unknown suite"),
        ({"conditions": ("rain",)}, "unknown condition"),
        ({"seeds": 1001}, "1 to 1,000 seeds"),
        ({"first_seed": -1}, "first seed must be 0 to"),
    ):
        with pytest.raises(CableError, match=why):
            dataclasses.replace(SHORT, **changes).cells()
    twice = dataclasses.replace(SHORT, controllers=("pi", "pi"))
    assert len(twice.cells()) == len(REFERENCES) + 2
    with pytest.raises(CableError, match="unknown controller"):
        dataclasses.replace(SHORT, controllers=("pid",)).rehearse()


def test_a_hand_that_reverses_at_the_ankle_is_asked_to_hold() -> None:
    named = {c.name: c for c in SUITES["v1"].conditions("ankle")}
    assert isinstance(named["reversals"].task, Hold)
    (drawn,) = sample_plants(named["moving-route"], (0,))
    assert drawn.plant.cables["plantarflexor"].bend == "route"
