"""An earlier diagnosis is continued with its own data, or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cli._parsing import parse
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.diagnosis._phrases import continue_command
from cc_mujoco.diagnosis._propose.experiment import CataloguedTrial, trial_table
from cc_mujoco.diagnosis._report.output import VERDICT_FILE, Earlier, write_proposed
from cc_mujoco.diagnosis._verdict import NextExperiment
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._references import add_trial_facts, read_plan


@pytest.fixture
def diagnosed(tmp_path: Path) -> Path:
    """Return the folder of a diagnosis of two trials with its provenance."""
    texts = {"a.csv": "1", "b.csv": "2", "bench.xml": "<m/>", "dataset.toml": ""}
    told = {}
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        told[name] = hashlib.sha256(text.encode()).hexdigest()

    def both(name: str) -> dict[str, str]:
        return {"path": str(tmp_path / name), "sha256": told[name]}

    data = {str(tmp_path / name): told[name] for name in ("a.csv", "b.csv")}
    out = tmp_path / "out"
    out.mkdir()
    provenance = {
        "data": data,
        "folder": "..",
        "several_files": [],
        "scene": both("bench.xml"),
        "dataset": both("dataset.toml"),
    }
    (out / VERDICT_FILE).write_text(
        json.dumps({"provenance": provenance}), encoding="utf-8"
    )
    return out


def test_it_is_found_with_everything_it_was_made_from(diagnosed: Path) -> None:
    earlier = Earlier.of(diagnosed)
    assert [path.name for path in earlier.data] == ["a.csv", "b.csv"]
    assert earlier.scene.name == "bench.xml"
    assert earlier.dataset is not None
    assert earlier.dataset.name == "dataset.toml"


def test_files_are_found_from_another_folder(
    diagnosed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (diagnosed / VERDICT_FILE).read_text(encoding="utf-8")
    text = text.replace(f"{tmp_path}{os.sep}", "")
    (diagnosed / VERDICT_FILE).write_text(text, encoding="utf-8")
    for here, folder in ((tmp_path, "out"), (tmp_path / "out", ".")):
        monkeypatch.chdir(here)
        found = Earlier.of(folder)
        for path in (*found.data, found.scene, found.dataset):
            assert path is not None
            assert path.resolve().parent == tmp_path.resolve()
    monkeypatch.chdir(tmp_path)
    assert Earlier.of("out").data == (Path("a.csv"), Path("b.csv"))


@pytest.mark.parametrize("name", ["b.csv", "bench.xml", "dataset.toml"])
def test_what_has_changed_or_gone_is_told(diagnosed: Path, name: str) -> None:
    file = diagnosed.parent / name
    file.write_text("other", encoding="utf-8")
    with pytest.raises(CableError, match=f"{name} has changed since"):
        Earlier.of(diagnosed)
    file.unlink()
    with pytest.raises(CableError, match=f"{name}, which .* names, is not there"):
        Earlier.of(diagnosed)


def test_trials_of_several_files_are_diagnosed_anew(diagnosed: Path) -> None:
    verdict = diagnosed / VERDICT_FILE
    said = json.loads(verdict.read_text(encoding="utf-8"))
    said["provenance"]["several_files"] = ["a.csv"]
    verdict.write_text(json.dumps(said), encoding="utf-8")
    with pytest.raises(CableError, match=r"several files each \(a.csv\)"):
        Earlier.of(diagnosed)


def test_a_folder_without_a_diagnosis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="holds no diagnosis that can be continued"):
        Earlier.of(tmp_path)
    (tmp_path / VERDICT_FILE).write_text("[]", encoding="utf-8")
    with pytest.raises(CableError, match="holds no diagnosis that can be continued"):
        Earlier.of(tmp_path)


def test_what_is_known_of_new_trials_is_not_passed_over(
    diagnosed: Path, tmp_path: Path
) -> None:
    new = tmp_path / "new"
    new.mkdir()
    (new / "c.csv").write_text("3", encoding="utf-8")
    earlier = Earlier.of(diagnosed)
    assert earlier.with_more([new]) == earlier.dataset
    assert earlier.with_more([tmp_path / "a.csv"]) == earlier.dataset
    (new / "dataset.toml").write_text("[trials.c]\ntilt = 1.57", encoding="utf-8")
    with pytest.raises(CableError, match="one file that speaks of all trials"):
        earlier.with_more([new])
    with pytest.raises(CableError, match="none of the earlier trials"):
        earlier._replace(dataset=None).with_more([new])


def test_a_proposed_trial_is_played_and_continued(
    diagnosed: Path, tmp_path: Path
) -> None:
    """Its folder is a plan of one trial, whose facts come back with the recording."""
    still = np.zeros(200)
    motion = CataloguedTrial("cables off", still, still, 0.0, tilt=1.5)
    facts = tuple(trial_table("trial_03", motion, 0.0))
    planned = NextExperiment("cables off", ("a", "b"), "", ("trial_03",), facts)
    known = tmp_path / "dataset.toml"
    known.write_text("[trials.a]\npretension = 9\n", encoding="utf-8")
    folder = diagnosed / planned.folder
    longer = replace(planned, trials=("trial_03", "trial_04"))
    write_proposed(folder, longer, [motion, motion], "")
    write_proposed(folder, planned, [motion], str(known))
    (trial,) = read_plan(folder)
    assert (trial.name, trial.notes) == ("trial_03", "cables off")
    told = read_dataset_file(folder / "dataset.toml").facts
    assert told["a"] == {"pretension": 9.0}
    assert told["trial_03"] == {"unhooked": True, "tilt": 1.5, "notes": "cables off"}
    verdict = json.loads((diagnosed / VERDICT_FILE).read_text(encoding="utf-8"))
    verdict["next_experiment"] = {"trials": ["trial_03"]}
    empty = hashlib.sha256(known.read_bytes()).hexdigest()
    verdict["provenance"]["dataset"]["sha256"] = empty
    (diagnosed / VERDICT_FILE).write_text(json.dumps(verdict), encoding="utf-8")
    earlier = Earlier.of(diagnosed)
    new = tmp_path / "new"
    new.mkdir()
    (new / "trial_03.csv").write_text("4", encoding="utf-8")
    assert earlier.with_more([new]) == folder / "dataset.toml"
    add_trial_facts(folder, "trial_03", new, 0.0)
    assert earlier.with_more([new]) == folder / "dataset.toml"
    own = new / "dataset.toml"
    text = own.read_text(encoding="utf-8").replace("tilt = 1.5", "tilt = 1.4")
    own.write_text(text, encoding="utf-8")
    with pytest.raises(CableError, match="one file that speaks of all trials"):
        earlier.with_more([new])


def test_the_command_that_continues_a_diagnosis_is_accepted() -> None:
    words = shlex.split(continue_command("trial_09.csv", "runs/a", "runs/b"))
    command: Any = parse(words[0], words[1:])
    assert (command.out, command.earlier) == (Path("runs/b"), Path("runs/a"))
    assert command.words == (Path("trial_09.csv"),)
