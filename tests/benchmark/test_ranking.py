"""Ranks say no more than the seeds do; results of two runs rank together."""

from __future__ import annotations

import dataclasses
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.benchmark import (
    REFERENCES,
    SCORES,
    SUITES,
    BenchmarkPlan,
    Cell,
    CellResult,
    normalise_errors,
    rank_controllers,
)
from cc_mujoco.benchmark import _page as drawing
from cc_mujoco.benchmark._page import CAPTIONS, write
from cc_mujoco.benchmark._ranking import mean_interval
from cc_mujoco.benchmark._report import (
    best_sentence,
    comparison,
    definitions,
    device_tables,
    next_command,
    summary,
)
from cc_mujoco.benchmark._results import (
    by_device,
    join_results,
    read_results,
    write_results,
)
from cc_mujoco.benchmark._runner import require_ours
from cc_mujoco.errors import CableError
from cc_mujoco.report import figure
from cc_mujoco.report._markdown import table

SEEDS = 6
MAKERS = {"versions": {}, "sources": "one", "files": {}}


def noisy(mean: float, seed: int, conditions: int = 5) -> np.ndarray:
    """Errors around a mean, all parts of which but a tenth are common to a seed."""
    common = np.random.default_rng(0).normal(size=(conditions, SEEDS))
    own = np.random.default_rng(seed).normal(size=(conditions, SEEDS))
    return mean + 0.2 * common + 0.02 * own


def test_pairs_tell_what_intervals_of_each_do_not() -> None:
    errors = {"near": noisy(0.55, 1), "best": noisy(0.5, 2), "twin": noisy(0.5, 3)}
    places = {place.name: place for place in rank_controllers(errors)}
    assert places["near"].low < places["best"].high
    assert "near" in places["best"].better_than
    assert places["best"].better_than == places["twin"].better_than == ("near",)
    assert [(p.first, p.last) for p in rank_controllers(errors)] == [
        (1, 2),
        (1, 2),
        (3, 3),
    ]


def test_intervals_are_as_wide_as_seeds_make_them() -> None:
    random, covered, shared = np.random.default_rng(4), [], []
    plants = ["one", "one", "two"]
    for _ in range(2000):
        values = random.normal(size=(3, 4))
        found = mean_interval(values)
        covered.append(found.low < 0.0 < found.high)
        common = values[[0, 0, 2]]
        found = mean_interval(common, plants)
        shared.append(found.low < 0.0 < found.high)
    assert 0.95 <= np.mean(covered) <= 0.995
    assert 0.94 <= np.mean(shared) <= 0.995
    assert math.isnan(mean_interval(values[:, :1]).low)


@pytest.mark.parametrize("seeds", [2, 3, 10])
def test_twins_are_rarely_better_than_each_other(seeds: int) -> None:
    random, claims = np.random.default_rng(seeds), 0
    for _ in range(200):
        errors = {name: random.normal(1.0, 0.1, size=(2, seeds)) for name in "abcde"}
        claims += any(place.better_than for place in rank_controllers(errors))
    assert claims <= 20  # 5 % of 200, and its spread


def column(*errors: float) -> np.ndarray:
    """Return errors of one axis, (seeds, 1)."""
    return np.array(errors)[:, None]


def test_the_error_of_a_device_is_the_mean_over_its_axes() -> None:
    rms = {
        "none": {"a": np.array([[1.0, 10.0], [3.0, 30.0]])},
        "mine": {"a": np.array([[1.0, 60.0], [math.nan, 2.0]])},
    }
    found = normalise_errors(rms)
    assert found["none"].tolist() == [[0.5, 1.5]]
    assert found["mine"].tolist() == [[0.5 * (0.5 + 3.0), 0.5 * (10.0 + 0.1)]]


def test_an_error_is_a_multiple_of_that_without_compensation() -> None:
    rms = {
        "none": {"a": column(1.0, 3.0), "b": column(10.0, math.nan)},
        "mine": {"a": column(1.0, math.nan), "b": column(5.0, 500.0)},
    }
    found = normalise_errors(rms)
    assert found["none"].tolist() == [[0.5, 1.5], [1.0, 10.0]]
    assert found["mine"].tolist() == [
        [0.5, 10.0],
        [0.5, 10.0],
    ]


def fake(laws: dict[str, float], scene: str = "wrist") -> list[tuple[Cell, CellResult]]:
    """Made-up results: errors around a mean."""
    results = []
    plants = {"plant_friction": [[0.1, 0.1]] * SEEDS, "failure": [""] * SEEDS}
    for row, condition in enumerate(SUITES["v1"].conditions(scene)[-9:]):
        for law, mean in laws.items():
            scores = {s.name: np.full(SEEDS, 0.25) for s in SCORES}
            scores["rms_torque_error"] = noisy(mean, len(law), 9)[row]
            cell = Cell(condition, law, tuple(range(SEEDS)))
            results.append((cell, CellResult(scores, plants)))
    return results


LAWS = {**dict.fromkeys(REFERENCES, 2.0), "none": 1.0, "pi": 0.8, "model": 0.5}


def test_tables_have_every_row_and_say_what_it_is() -> None:
    results = fake(LAWS)
    tables = device_tables(by_device(results)[0], "model")
    parts = [summary(results, "model")]
    parts += [f"{head}\n\n{table(*cells)}" for head, cells in tables]
    text = "\n\n".join([*parts, definitions(results)])
    for name, row in REFERENCES.items():
        assert f"| *{name}* | " in text and f"- *{name}*: {row.meaning}" in text
    for score in SCORES:
        assert f"- `{score.name}` [{score.unit}]: {score.meaning}" in text
    ranks = text.partition("for all pairs at once:")[2].partition("Normalised")[0]
    assert "| 1 | `model` | 0." in ranks and "less `model`" in ranks
    assert "`none`, `pi` |" in ranks and "unplugged" not in ranks
    unit = np.mean(noisy(1.0, len("none"), 9)[4])
    assert f"| ordinary-rough | {unit:.3g} N m | 2." in text


@pytest.mark.parametrize(
    ("errors", "sentence"),
    [
        (
            {"pi": 0.8, "model": 0.5},
            r"`model` wins at wrist with an error of 0\.\d+ \(`pi`: 0\.8",
        ),
        (
            {"other": 0.5, "model": 0.5},
            r"`other` has the least error at wrist, (0\.5\d*), not significantly below "
            r"`model` \(\1\)",
        ),
        (
            dict.fromkeys("abcde", 0.5),
            r"`a` has the least error at wrist, 0\.5\d*, not significantly below "
            "4 others",
        ),
        ({}, "`none` has the least error at wrist, 1"),
    ],
)
def test_the_first_sentence_names_who_wins_or_all_that_may_be_as_good(
    errors: dict[str, float], sentence: str
) -> None:
    found = best_sentence(fake({"none": 1.0, **errors}))
    assert re.match(sentence, found), found
    assert found.endswith("(error of `none` is 1; 6 seeds).")


def test_the_page_opens_with_the_winner_and_is_written_again_until_a_user_edits_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for stem in CAPTIONS:
        monkeypatch.setattr(drawing, stem, lambda *_: figure(1.0, 1.0))
    laws = {**LAWS, "<b>": 0.6}
    plan = BenchmarkPlan(("pi", "model"), scenes=("wrist",))
    for seeds in (1, SEEDS):
        few = [
            (
                dataclasses.replace(c, seeds=c.seeds[:seeds]),
                dataclasses.replace(r, plants={"failure": [""] * seeds}),
            )
            for c, r in fake(laws)
        ]
        write(tmp_path, plan, few)
    text = (tmp_path / "report.html").read_text("utf-8")
    header = text.partition("<header>")[2].partition("</header>")[0]
    assert "<code>model</code> wins at wrist with an error of 0." in header
    assert "6 seeds" in header and header.count("<img") == 1
    assert f"<code>{next_command(fake(laws))}</code>" in header
    assert "<code>&lt;b&gt;</code>" in text and "<b></code>" not in text
    assert text.count("<img") == len(CAPTIONS)
    for row in REFERENCES.values():
        assert row.meaning.partition("`")[0] in text
    (tmp_path / "cells").mkdir()
    shutil.copy(tmp_path / "results.parquet", tmp_path / "cells")
    (tmp_path / "report.html").write_text("mine")
    with pytest.raises(CableError, match="html is not as an earlier run"):
        require_ours(tmp_path)


def test_files_of_results_rank_together(tmp_path: Path) -> None:
    paths = tmp_path / "a.parquet", tmp_path / "b.parquet"
    write_results(paths[0], fake(LAWS), "v1", MAKERS)
    other = {**dict.fromkeys(REFERENCES, 2.0), "none": 1.0, "pi": 0.7, "mine:m": 0.4}
    write_results(paths[1], fake(other), "v1", MAKERS | {"sources": "two"})
    errors, differing = join_results(*map(read_results, paths))
    assert differing == ["the sources of cc_mujoco"]
    assert list(errors["wrist"]) == ["none", "pi (a)", "pi (b)", "model", "mine:m"]
    text = comparison(errors, differing)
    assert "differs in the sources" in text and "| 1 | `mine:m` | 0.4" in text
    again, nothing = join_results(*map(read_results, (paths[0], paths[0])))
    assert list(again["wrist"]) == ["none", "pi", "model"] and nothing == []


def test_results_of_other_conditions_are_not_compared(tmp_path: Path) -> None:
    kinds = [fake(LAWS), fake(LAWS)[: 5 * len(LAWS)], fake(LAWS, "ankle")]
    shorter = [
        (dataclasses.replace(c, seeds=c.seeds[:2]), dataclasses.replace(
            r, scores={n: v[:2] for n, v in r.scores.items()}))
        for c, r in kinds[0]
    ]  # fmt: skip
    paths = []
    for number, kind in enumerate([*kinds, shorter]):
        paths.append(tmp_path / f"{number}.parquet")
        write_results(paths[-1], kind, "v1", MAKERS)
    whys = {1: "not the same", 2: "nothing to compare", 3: "the seeds"}
    for other, why in whys.items():
        with pytest.raises(CableError, match=why):
            join_results(read_results(paths[0]), read_results(paths[other]))
    (tmp_path / "x.parquet").write_text("mine")
    with pytest.raises(CableError, match="no Parquet file"):
        read_results(tmp_path / "x.parquet")
