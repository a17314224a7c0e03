"""Files run no code: a module that only a file names is not imported."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco import cli
from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import with_provenance
from cc_mujoco._workers.local_executor import run_here
from cc_mujoco.assets import scene_path
from cc_mujoco.benchmark._results import _digest
from cc_mujoco.cli._parsing import commands
from cc_mujoco.device import load_device
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import read_settings
from cc_mujoco.metrics import METRICS
from cc_mujoco.viz import _episode_files
from hardware.peers import NOWHERE, toml
from jobs import NamesAllowed

PLANTED = """
from pathlib import Path
Path("ran").touch()
"""
MADE = """
from cc_mujoco.human import Hold, TRAJECTORIES
make, hold = TRAJECTORIES["sine"], Hold(1.0)
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a folder with `evil.py`, which leaves the file `ran` when imported."""
    known = dict(METRICS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_episode_files, "write_summary", lambda path, _: path.touch())
    monkeypatch.setattr(user_code, "_allowed_names", set())
    for name in ("evil", "good"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    Path("evil.py").write_text(PLANTED + MADE)
    yield tmp_path
    for name in METRICS.keys() - known.keys():
        del METRICS[name]


def device(key: str) -> str:
    """Return a copy of the wrist of which the description names code."""
    Path("x.xml").write_text(scene_path("wrist").read_text())
    table = "[axis]\n" if key == "task" else ""
    Path("x.device.toml").write_text(f'{table}{key} = "evil:make"\n')
    return "x.xml"


def study(key: str) -> list[str]:
    protocol: dict[str, Any] = {
        "scene": "wrist",
        "timestep": 1e-3,
        "duration": 0.1,
        "seed": 0,
        "trajectory": "sine",
        "task": "spring",
        "controllers": ["pi"],
        "metrics": ["rms_torque_error"],
        "own": {},
    }
    planted = {"controllers": ["evil:make"], "own": {"worst": "evil:make"}}
    protocol[key] = planted.get(key, "evil:make")
    Path("study").mkdir()
    about = {"protocol": protocol, "variables": ["friction"]}
    Path("study", "study.json").write_text(json.dumps(about))
    columns = {"design": [0, 1], "friction": [0.1, 0.2], "rms_torque_error": [1.0, 2.0]}
    pq.write_table(pa.table(columns), "study/table.parquet")
    return ["whatif-show", "study", "0"]


def verdict() -> list[str]:
    Path("bench.xml").write_text("<mujoco/>")
    digest = hashlib.sha256(b"<mujoco/>").hexdigest()
    provenance = {
        "data": {},
        "folder": "..",
        "several_files": [],
        "scene": {"path": "bench.xml", "sha256": digest},
        "dataset": {"path": None, "sha256": None},
        "effects": ["evil.py:make"],
    }
    Path("out").mkdir()
    Path("out", "verdict.json").write_text(json.dumps({"provenance": provenance}))
    Path("trial.csv").write_text("time_s\n0\n")
    return ["diagnose", "trial.csv", "--continue", "out", "--out", "new"]


def results(law: str = "evil:make", scene: str = "wrist") -> list[str]:
    columns = {"scene": ["x"], "condition": ["plain"], "controller": [law]}
    about: dict[str, Any] = {
        "suite": "generic",
        "conditions": {},
        "devices": {"x": scene},
        "durations": {},
        "made_by": {},
    }
    table = pa.table({**columns, "seed": [0]})
    about["digest"] = _digest(table, about)
    pq.write_table(with_provenance(table, about), "results.parquet")
    return ["benchmark", "--verify", "results.parquet", "--rows", "1"]


def rig(old: str, new: str) -> list[str]:
    text = toml(NOWHERE)
    assert old in text
    Path("rig.toml").write_text(text.replace(old, new))
    return ["run", "--rig", "rig.toml", "--out", "run", "--controller", "pi"]


PLAY = ["--duration", "0.05", "--out", "played"]
WHATIF = ["--vary", "friction=0.1,0.2", "--duration", "1.5", "--out", "study"]
BENCHMARK = ["--controllers", "pi", "--seeds", "1", "--duration", "1.5", "--out", "b"]

REFUSED: dict[str, Callable[[], list[str]]] = {
    **{
        f"{command} {key}": lambda key=key, words=words: [
            word.replace("SCENE", device(key)) for word in words
        ]
        for key in ("trajectory", "task")
        for command, words in {
            "play": ["play", "SCENE", *PLAY],
            "whatif": ["whatif", "SCENE", *WHATIF],
            "benchmark": ["benchmark", "SCENE", *BENCHMARK],
        }.items()
    },
    **{f"study {key}": lambda key=key: study(key)
       for key in ("trajectory", "task", "controllers", "own")},
    "study against": lambda: [*study("own"), "--against", "1"],
    "verdict effects": verdict,
    "results controller": results,
    "results by axis": lambda: results("hip=evil:make,ankle=pi"),
    "rig class": lambda: rig(NOWHERE, 'class = "evil:make"'),
    "rig task": lambda: rig("torque = 0.5", 'name = "evil:make"'),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_code_that_only_a_file_names_is_refused_in_one_sentence(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(REFUSED[kind]()) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    name = "evil.py:make" if "verdict" in kind else "evil:make"
    assert f"names code, '{name}'" in said and f"--allow {name}" in said
    files = {"study": "study.json", "verdict": "verdict.json", "rig": "rig.toml"}
    files["results"] = "results.parquet"
    assert files.get(kind.split()[0], "x.device.toml") in said
    assert "evil" not in sys.modules and not Path("ran").exists()


@pytest.mark.parametrize(
    "kind", ["play trajectory", "study controllers", "verdict effects", "rig class"]
)
def test_code_that_the_call_names_as_well_is_imported(kind: str) -> None:
    name = "evil.py:make" if "verdict" in kind else "evil:make"
    cli.main([*REFUSED[kind](), "--allow", name])
    assert Path("ran").exists()


def test_code_that_a_file_names_and_the_call_replaces_is_not_imported() -> None:
    scene = device("trajectory")
    assert cli.main(["play", scene, *PLAY, "--trajectory", "sine"]) == 0
    assert cli.main(["device", scene]) == cli.main(["list", scene]) == 0
    assert not Path("ran").exists()
    assert cli.main(["play", scene, *PLAY, "--trajectory", "evil:make"]) == 0
    assert Path("ran").exists()


def test_python_allows_code_by_an_argument() -> None:
    scene = device("trajectory")
    with pytest.raises(CableError, match=r"x.device.toml, trajectory names code"):
        gymnasium.make("cc_mujoco/Device-v1", device=scene)
    copy = pickle.dumps(load_device(scene, allow="evil:make"))
    user_code._allowed_names.clear()
    env = gymnasium.make("cc_mujoco/Device-v1", device=pickle.loads(copy))
    assert Path("ran").exists()
    env.close()
    rig(NOWHERE, 'class = "evil:missing"')
    with pytest.raises(CableError, match="has no class 'missing'"):
        read_settings("rig.toml", allow=["evil:missing"]).connect()


def test_workers_may_import_what_the_call_allows_and_nothing_of_the_folder() -> None:
    for name in ("pickle", "random", "struct", "tempfile"):
        Path(f"{name}.py").write_text(PLANTED)
    user_code.allow("evil:make")
    found = dict(run_here(NamesAllowed(), {0: 0.0, 1: 0.0}, count=2, processes=True))
    assert found == {0: ("evil:make",), 1: ("evil:make",)}
    assert not Path("ran").exists()


def test_a_command_takes_no_module_from_the_folder(here: Path) -> None:
    for name in ("numpy", "rerun", "sitecustomize", "tqdm", "tyro", "usercustomize"):
        Path(f"{name}.py").write_text(PLANTED)
    Path("matplotlibrc").write_text("backend: module://evil\n")
    place = here / "bin"
    place.mkdir()
    # As the script that an installation makes.
    script = "import sys\nfrom cc_mujoco.cli import main\nsys.exit(main())\n"
    (place / "cc-mujoco").write_text(script)
    words = [sys.executable, str(place / "cc-mujoco"), "play", "wrist", *PLAY]
    package = str(Path(cli.__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": package}
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert not Path("ran").exists()


class Payload:
    """Object whose pickle leaves the file `ran` when it is loaded."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("ran"),)


@pytest.mark.parametrize(
    "words",
    [
        *(["diagnose", "wrist", f"FILE.{ending}", "--out", "o"]
          for ending in ("csv", "parquet", "mat", "h5", "mcap", "npy", "npz", "pkl")),
        ["diagnose", "wrist", "data.csv", "--dataset", "FILE.toml", "--out", "o"],
        *(["play", "wrist", "--trajectory", f"FILE.{ending}"]
          for ending in ("csv", "mot", "parquet", "sto")),
        ["play", "wrist", "--task", "FILE.csv"],
        ["play", "wrist", "--controller", "FILE.safetensors"],
        ["play", "wrist", "--replay", "FILE.csv"],
        ["play", "wrist", "--replay", "FILE.parquet"],
        ["play", "FILE.xml"],
        ["play", "FILE.toml"],
        ["tendons", "FILE.xml"],
        ["calibrate", "wrist", "--trial", "FILE.csv", "--out", "o"],
        ["calibrate", "wrist", "--trial", "FILE.mat", "--out", "o"],
        ["whatif", "--designs", "FILE.csv"],
        ["whatif", "--designs", "FILE.toml"],
        ["whatif", "--vary", "friction=1,2", "--costs", "FILE.csv", "--metric", "cost"],
        ["benchmark", "--verify", "FILE.parquet"],
        ["benchmark", "--compare", "FILE.parquet", "FILE.parquet"],
        ["run", "--rig", "FILE.toml", "--out", "o"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_no_file_is_unpickled(words: list[str]) -> None:
    Path("data.csv").write_text("time_s,motor_angle_rad\n0,0\n")
    for word in words:
        if word.startswith("FILE."):
            Path(word).write_bytes(pickle.dumps(Payload()))
    assert cli.main(words) == 2
    assert not Path("ran").exists()


PIECES = st.sampled_from(["evil", "make", ":", ",", "=", " ", ".py", "hip", "'", "x"])


@given(st.lists(PIECES, max_size=9).map("".join), st.booleans())
def test_no_part_of_a_refused_text_can_be_imported(text: str, deferred: bool) -> None:
    try:
        found = user_code.named_in_file(text, "x.toml", "task", deferred=deferred)
    except CableError:
        return
    parts = [found, *found.split(","), *found.replace("=", ",").split(",")]
    for part in parts:
        with pytest.raises(CableError):
            user_code.named_object("task", part.strip(), "object")
    assert "evil" not in sys.modules and not Path("ran").exists()
    assert user_code.without_mark(found) == text


def test_every_command_that_imports_code_takes_allow(
    capsys: pytest.CaptureFixture[str],
) -> None:
    able = {"play", "diagnose", "whatif", "whatif-show", "benchmark", "export", "run"}
    for command in commands():
        with pytest.raises(SystemExit):
            cli.main([command, "--help"])
        assert ("--allow" in capsys.readouterr().out) == (command in able), command


ENDS = """
import sys
from cc_mujoco.human import Task, Trajectory
from cc_mujoco.metrics import Metric

def end(*_):
    sys.exit(0)

class Ends(Task):
    torque = end

class Moves(Trajectory):
    _motion = end

class Rig:
    __init__ = end

class Lag:
    needs = "a motion"
    parameters = signals = end

def law(drive):
    return end

task, trajectory = Ends(), Moves()
metric = Metric("mine", "1", "ends", end)
"""
LAST = ["--duration", "0.05", "--out", "played"]


@pytest.mark.parametrize("at_import", [False, True])
@pytest.mark.parametrize(
    "words",
    [
        ["play", "wrist", "--controller", "ends:law", *LAST],
        ["play", "wrist", "--controller", "ends:end", *LAST],
        ["play", "wrist", "--controller", "ends.py:law", *LAST],
        ["play", "wrist", "--task", "ends:task", *LAST],
        ["play", "wrist", "--task", "ends:end", *LAST],
        ["play", "wrist", "--trajectory", "ends:trajectory", *LAST],
        ["play", "wrist", "--metric", "ends:metric", *LAST],
        ["whatif", "--vary", "loops=1", "--metric", "ends:metric", "--controllers",
         "none", *LAST],
        pytest.param(
            ["benchmark", "wrist", "--controllers", "ends:law", "--seeds", "1",
             "--conditions", "zero-torque", "--duration", "1.1", "--out", "played"],
            marks=pytest.mark.study,
        ),
        ["diagnose", "bench", "x.csv", "--effects", "ends:Lag", "--out", "played"],
        ["run", "--rig", "rig.toml", "--controller", "pi", "--out", "played",
         "--allow", "ends:Rig"],
    ],
    ids=lambda words: " ".join(words[:7]),
)  # fmt: skip
def test_the_end_of_the_interpreter_in_code_of_the_user_is_an_error(
    words: list[str], at_import: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    sys.modules.pop("ends", None)
    ends = "raise SystemExit" if at_import else ""
    Path("ends.py").write_text(f"{ends}\n{ENDS}")
    Path("x.csv").write_text("time_s\n0\n")
    rig(NOWHERE, 'class = "ends:Rig"')
    assert cli.main(words) not in (0, None)
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("cc-mujoco: ") and "ends.py, line " in said
    assert not Path("played", "log.parquet").exists()
