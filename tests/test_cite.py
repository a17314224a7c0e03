"""`cc-mujoco cite`: it states what made the results, or one sentence."""

from __future__ import annotations

import hashlib
import json
import platform
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli
from cc_mujoco._utils.atomic_io import MANIFEST
from cc_mujoco.cli._cite import BIBTEX, Cite
from cc_mujoco.errors import CableError
from page_blocks import ROOT
from study_marks import study_unless

VERSIONS = (
    f"cc_mujoco {cc_mujoco.__version__}",
    f"mujoco {mujoco.__version__}",
    f"numpy {np.__version__}",
    f"Python {platform.python_version()}",
)
PLAY = ["play", "wrist", "--duration", "0.1", "--seed", "7", "--controller", "none"]
WHATIF = ["whatif", "wrist", "--vary", "friction=0.05,0.1", "--duration", "0.1"]
WHATIF += ["--controllers", "none", "--seed", "5"]
BENCHMARK = ["benchmark", "wrist", "--controllers", "none", "--seeds", "2"]
BENCHMARK += ["--duration", "1.5", "--conditions", "ordinary-exact"]
MADE = {
    "play": (PLAY, "7", "log.parquet", "metrics.json"),
    "whatif": (WHATIF, "5", "table.parquet", "report.html"),
    "benchmark": (BENCHMARK, "0, 1", "results.parquet", "report.html"),
}


def cited(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, list[str]]:
    """Return what is printed of a folder, by its first words."""
    capsys.readouterr()
    Cite(str(folder)).run()
    text = capsys.readouterr().out
    found: dict[str, list[str]] = {"bibtex": re.findall(r"^@\w+\{(\w+),$", text, re.M)}
    for line in text.partition("\n\n")[0].splitlines():
        kind, rest = line.split(maxsplit=1)
        found.setdefault(kind, []).append(rest)
    return found


@pytest.mark.parametrize("name", study_unless(lambda name: name == "play", MADE))
def test_it_states_versions_seeds_command_and_hashes(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    words, seeds, results, text = MADE[name]
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/cc-mujoco", *words, "--out", "r"])
    assert cli.main([*words, "--out", "r"]) == 0
    found = cited(Path("r"), capsys)
    assert found["command"] == [f"cc-mujoco {' '.join(words)} --out r"]
    assert set(VERSIONS) <= set(found["versions"][0].split(", "))
    assert found["seeds"] == [seeds]
    assert found["input"]
    assert found["bibtex"] == ["cc_mujoco", "borowski", "todorov2012"]
    digests = dict(line.split("  ") for line in found["result"])
    for file in (results, text):
        assert digests[file] == hashlib.sha256(Path("r", file).read_bytes()).hexdigest()
    with Path("r", text).open("a") as file:
        file.write(" ")
    found = cited(Path("r"), capsys)
    changed = [line for line in found["result"] if line.endswith(", changed since")]
    assert [line.split()[0] for line in changed] == [text]
    Path("r", text).unlink()
    assert f"{text}  deleted since" in cited(Path("r"), capsys)["result"]
    Path("r", MANIFEST).unlink()  # as of an interrupted run
    found = cited(Path("r"), capsys)
    assert found["command"] == ["not recorded"]
    assert found["versions"][0].endswith("Python not recorded")


def verdict(**changed: Any) -> dict[str, Any]:
    """Return the provenance of a verdict."""
    made = {"cc_mujoco": "0.2.0", "mujoco": "4.0.0", "python": "3.12.1"}
    found: dict[str, Any] = {
        "command": "cc-mujoco diagnose s.xml a.csv",
        "seed": 3,
        "scene": {"path": "s.xml", "sha256": "1a"},
        "data": {"a.csv": "2b"},
        "versions": made,
    }
    return {"provenance": found | changed}


def test_a_diagnosis_has_its_own_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "verdict.json").write_text(json.dumps(verdict()))
    found = cited(tmp_path, capsys)
    assert found["command"] == ["cc-mujoco diagnose s.xml a.csv"]
    assert found["versions"] == ["cc_mujoco 0.2.0, mujoco 4.0.0, Python 3.12.1"]
    assert found["seeds"] == ["3"]
    assert found["input"] == ["s.xml  1a", "a.csv  2b"]
    assert len(found["result"]) == 1
    text = verdict(command="cc-mujoco\nresult  \x1b[2Jx")
    (tmp_path / "verdict.json").write_text(json.dumps(text))
    assert cited(tmp_path, capsys)["command"] == ["cc-mujoco?result  ?[2Jx"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("verdict.json", b"{"),
        ("verdict.json", b"[]"),
        ("verdict.json", b"[" * 100_000),
        ("verdict.json", b"\xff\xfe"),
        ("verdict.json", json.dumps(verdict(versions=3)).encode()),
        ("verdict.json", json.dumps(verdict(data=[1])).encode()),
        ("verdict.json", json.dumps({"provenance": None}).encode()),
        ("log.parquet", b"PAR1"),
        ("results.parquet", b""),
    ],
)
def test_a_damaged_record_is_one_sentence(
    name: str, content: bytes, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CableError, match=re.escape(name)) as raised:
        Cite(str(tmp_path)).run()
    assert str(raised.value).endswith(".") and "\n" not in str(raised.value)


@pytest.mark.parametrize("line", ["made by: {", "made by: 3", "made by: [[1]]"])
def test_a_damaged_manifest_is_one_sentence(line: str, tmp_path: Path) -> None:
    (tmp_path / "verdict.json").write_text(json.dumps(verdict()))
    (tmp_path / MANIFEST).write_text(f"{line}\n")
    with pytest.raises(CableError, match=re.escape(MANIFEST)):
        Cite(str(tmp_path)).run()


def test_a_folder_without_a_record_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(CableError, match=r"has none of verdict\.json, .*diagnose\.$"):
        Cite(str(tmp_path)).run()
    with pytest.raises(CableError, match=r"is no folder; name one with results\.$"):
        Cite(str(tmp_path / "none")).run()


def test_the_references_are_those_of_the_citation_file() -> None:
    stated = (ROOT / "CITATION.cff").read_text("utf-8")
    titles = re.findall(r'title: "?(.*?)"?$', stated, re.M)
    years = re.findall(r"date-released: (\d{4})", stated)
    people = re.findall(r"(?:name|family-names|given-names): (.*)$", stated, re.M)
    assert len(titles) == 2 and years and people
    flat = BIBTEX.format(version="1")
    for words in (*titles, *years, *people):
        assert words in flat
