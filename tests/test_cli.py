"""The command `cc-mujoco`: what it writes, what it says, how it fails."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli, viz
from cc_mujoco._utils import command_options
from cc_mujoco.assets import scene_path
from cc_mujoco.cli import _play as play
from cc_mujoco.cli._list import Listing
from cc_mujoco.cli._parsing import commands
from cc_mujoco.device import find_device
from cc_mujoco.export import EXPORTED
from cc_mujoco.metrics import Metric
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import EPISODE_FILES, _episode_files
from plugin.processes import processes
from study_marks import study_but

EXPORT = ["export", "--out", "x"]
ANKLE = str(scene_path("ankle"))

COMMANDS = {name: point.load() for name, point in commands().items()}
# Where the package was imported from; tests run in another folder. Output is buffered,
# as that of users is.
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[1])}
ENVIRONMENT["PYTHONUNBUFFERED"] = ""


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("scene", study_but(2, ["wrist", "ankle"]))
def test_play_leaves_four_files_and_says_how_to_open_them(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["play", scene, "--duration", "0.3", "--seed", "4"]) == 0
    said = capsys.readouterr()
    device = find_device(scene).description
    name = f"{scene}-{device.trajectory}-{device.axis().task}-pi_tuned-4-0.3s"
    out = tmp_path / "runs" / name
    assert sorted(path.name for path in out.iterdir()) == sorted(EPISODE_FILES)
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    assert f"rerun {Path('runs', out.name, 'recording.rrd')}" in said.out
    assert "peak_joint_torque" in said.out
    assert said.err == ""  # no progress bar, since this is no terminal

    log = EpisodeLog.read(out / "log.parquet")
    about = log.metadata
    assert (about["scene"], about["seed"], about["trajectory"]) == (
        scene,
        4,
        device.trajectory,
    )
    assert about["duration"] == 0.3
    assert log["time_s"][-1] == pytest.approx(0.3, abs=0.02)
    assert set(about["versions"]) >= {"cc_mujoco", "mujoco"}
    assert "<mujoco" in about["model_xml"]
    numbers = json.loads((out / "metrics.json").read_text())
    assert numbers["peak_joint_torque"]["unit"] == "N m"
    peak = float(np.max(np.abs(log["joint_torque_nm"])))
    assert numbers["peak_joint_torque"]["value"] == peak


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("scene", "law"),
    [
        ("wrist", "fused"),
        ("wrist", "adaptive"),
        *(
            pytest.param(scene, "fused", marks=pytest.mark.study)
            for scene in ("ankle", "finger")
        ),
    ],
)
def test_play_has_the_sensors_that_its_controllers_need(
    scene: str, law: str, tmp_path: Path
) -> None:
    words = ["play", scene, "--controller", law, "--duration", "0.05", "--out", "here"]
    assert cli.main(words) == 0
    about = EpisodeLog.read(tmp_path / "here" / "log.parquet").metadata
    assert about["controller"] == law
    assert about["sensing"] == find_device(scene).description.sensing.to_json()


@pytest.mark.usefixtures("undrawn")
def test_a_task_beyond_the_motor_is_played_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["play", "wrist", "--trajectory", "sine", "--duration"]
    beyond = ["1", "--task", "assist", "--out", str(tmp_path / "a")]
    assert cli.main([*words, *beyond]) == 0
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning.startswith("warning: assist: the task asks for -28.81 to 0 N m ")
    assert warning.endswith("the motor gives -5.2 to 5.2 N m even without friction.")
    within = ["0.1", "--task", "spring", "--out", str(tmp_path / "b")]
    assert cli.main([*words, *within]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("undrawn")
def test_equal_seeds_give_equal_logs(tmp_path: Path) -> None:
    words = ["play", "wrist", "--trajectory", "multisine", "--duration", "0.1"]
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert cli.main([*words, "--seed", seed, "--out", name]) == 0
    logs = [EpisodeLog.read(tmp_path / name / "log.parquet") for name in "abc"]
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]


@pytest.mark.usefixtures("undrawn")
def test_a_recorded_motion_can_be_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moment = np.linspace(0.0, 0.5, 251)
    rows = [f"{t},{0.2 * np.sin(t)}" for t in moment]
    Path("mine.csv").write_text("\n".join(["time_s,angle_rad", *rows]) + "\n")
    words = ["play", "wrist", "--trajectory", "mine.csv", "--duration", "0.3"]
    assert cli.main(words) == 0
    (kept,) = (tmp_path / "runs").glob("wrist-mine.csv-*-0-0.3s/log.parquet")
    log = EpisodeLog.read(kept)
    expected = 0.2 * np.sin(log["time_s"])
    assert log["reference_angle_rad"] == pytest.approx(expected, abs=1e-3)
    assert capsys.readouterr().err == ""
    words[-1] = "0.6"
    assert cli.main(words) == 0
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning.startswith("warning: mine.csv ends after 0.5 s; the joint is held")


@pytest.mark.usefixtures("undrawn")
def test_old_results_stay_until_new_ones_are_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["play", "wrist", "--duration", "0.1", "--out", "here"]
    assert cli.main(words) == 0
    (tmp_path / "here" / "notes.txt").write_text("mine")
    before = {p.name: p.read_bytes() for p in (tmp_path / "here").iterdir()}

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(_episode_files, "write_summary", interrupted)
        assert cli.main([*words, "--seed", "1"]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in (tmp_path / "here").iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["here"]

    assert cli.main([*words, "--seed", "1"]) == 0
    after = {p.name: p.read_bytes() for p in (tmp_path / "here").iterdir()}
    assert after["notes.txt"] == b"mine"
    assert after["log.parquet"] != before["log.parquet"]


def test_a_bar_in_a_pipe_is_a_line_for_each_state(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command_options, "PROGRESS_INTERVAL", 0.0)
    with command_options.progress_bar(2.0, "episode") as progress:
        for time in (1.0, 2.0):
            progress(time)
    shown = capsys.readouterr().err
    assert "\r" not in shown and shown.endswith("\n")
    lines = shown.splitlines()
    assert len(lines) > 2 and lines[-1].endswith("2.0 of 2.0 s")
    assert all(re.fullmatch(r"episode: .*\| \d\.0 of 2\.0 s", line) for line in lines)


@pytest.mark.parametrize("seconds", [1.5, 3.0, 11.0, 40.0])
def test_a_long_wait_in_a_pipe_is_said_within_seconds_and_not_too_often(
    seconds: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [100.0]
    monkeypatch.setattr("tqdm.std.time", lambda: now[0])
    monkeypatch.setattr(command_options, "perf_counter", lambda: now[0])
    said, seen = [], ""
    with command_options.progress_bar(seconds, "episode") as progress:
        for k in range(1, round(10 * seconds) + 1):
            now[0] = 100.0 + 0.1 * k
            progress(0.1 * k)
            if shown := capsys.readouterr().err:
                said.append(now[0] - 100.0)
                seen += shown
    seen += capsys.readouterr().err
    assert bool(said) is (seconds > 2.0)
    if said:
        assert 2.0 <= said[0] < 2.3 and min(np.diff(said), default=10.0) > 9.0
        assert seen.endswith(f"{seconds:.1f} of {seconds:.1f} s\n")
        assert len(seen.splitlines()) <= len(said) + 1


def test_a_diagnosis_says_what_it_does_however_little_of_the_whole_that_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def diagnose(*_: Any, progress: Any, **__: Any) -> None:
        for share, doing in ((0.2, "one"), (0.21, "two"), (0.21, "three")):
            progress(share, doing)
        raise cc_mujoco.errors.CableError("enough")

    monkeypatch.setattr(command_options, "PROGRESS_INTERVAL", 0.0)
    monkeypatch.setattr("cc_mujoco.diagnosis._diagnose.diagnose", diagnose)
    cli.main(["diagnose", "bench", str(tmp_path), "--out", "there"])
    shown = capsys.readouterr().err
    assert all(f"  {doing}\n" in shown for doing in ("one", "two", "three"))


PLAYING = """
# A test run started in the background hands down an ignored SIGINT.
import signal; signal.signal(signal.SIGINT, signal.default_int_handler)
import os, sys, threading
import gymnasium, tqdm
import cc_mujoco.plugin
from cc_mujoco import cli, simulation
from cc_mujoco.control import axes_controller
from cc_mujoco.viz import write_episode
simulate = simulation.simulate
def interrupted(*given, **named):
    threading.Timer(0.2, os.kill, (os.getpid(), NUMBER)).start()
    return simulate(*given, **named)
simulation.simulate = interrupted
"""
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143}


def test_signals_leave_nothing(tmp_path: Path) -> None:
    play = "sys.exit(cli.main(['play', 'wrist', '--duration', '5']))"
    scripts = {
        signal.Signals(number).name: f"NUMBER = {int(number)}\n{play}"
        for number in SIGNALS
    }
    ended = processes(PLAYING, scripts, tmp_path)
    for (code, said, folder), expected in zip(
        ended.values(), SIGNALS.values(), strict=True
    ):
        assert code == expected, said
        assert "Traceback" not in said
        assert {path.name for path in folder.iterdir()} == {"said", "code"}


def test_sentences_where_only_ascii_can_be_shown() -> None:
    ascii_only = ENVIRONMENT | {"PYTHONIOENCODING": "ascii"}
    done = command("play", "wrist", "--trajectry", "sine", env=ascii_only)
    assert done.returncode == 2
    assert "--trajectry, sine; did you mean --trajectory?" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["paly", "wrist"], "did you mean 'play'"),
        (["device"], "missing from cc-mujoco device: SCENE, an MJCF file"),
        (["export"], "or an MJCF file; --controller NAME, controller: none"),
        (["play", "wirst"], "did you mean 'wrist'"),
        (["play", "wrist", "--trajectory", "sien"], "did you mean 'sine'"),
        (["play", "wrist", "--task", "tunel"], "did you mean 'tunnel'"),
        (["play", "wrist", "--controller", "pid"], "did you mean 'pi'"),
        (["play", "wrist", "--trajectry", "sine"], "did you mean --trajectory"),
        (
            ["play", "wrist", "--duration", "long"],
            "--duration needs a number, not 'long'",
        ),
        (["benchmark", "--seeds", "x"], "--seeds needs a whole number, not 'x'"),
        (["benchmark", "--rows", "1.5"], "--rows needs a whole number, not '1.5'"),
        (["benchmark", "--compare", "a"], "--compare needs PATH PATH, not 'a'"),
        (["play", "wrist", "--duration", "-1"], "duration"),
        (["play", "wrist", "--duration", "nan"], "duration"),
        (["play", "wrist", "--seed", "-1"], "seed"),
        (["play", "wrist", "--trajectory", "no.csv"], "no.csv"),
        (["play", "wrist", "--out", "taken"], "is a file"),
        (["play"], "SCENE"),
        ([], ", ".join(COMMANDS)),
        (["play", "wrist", "--out", ""], "--out is empty"),
        (["play", "wrist", "--out="], "--out is empty"),
        (["benchmark", "wrist", "--seeds", "0"], "has 1 to 1,000 seeds, not 0"),
        (["play", "wrist", "--controller", " "], "--controller is empty"),
        (["play", ""], "a word is empty"),
        (["whatif", "--trajectory", "", "--vary", "loops=1,2"], "--trajectory is"),
        (["whatif", "--designs", ""], "--designs is empty"),
        (
            "whatif --vary loops=1,2 friction=0.1,0.2 --out x".split(),
            "each value needs its own option, --vary friction=0.1,0.2",
        ),
        (["diagnose", "", "x.csv", "--out", "x"], "a word is empty"),
        (["play", "\udcff.xml"], r"'\udcff.xml' is no UTF-8 text"),
        (["play", "wrist", "--out=\udcff"], r"no UTF-8 text"),
        (["benchmark", "--controllers", "pi", ""], "a word is empty"),
        ([*EXPORT, "wrsit", "--controller", "pi"], "did you mean 'wrist'"),
        ([*EXPORT, "wrist", "--controller", "pid"], "did you mean 'pi'"),
        (
            [*EXPORT, "wrist", "--controller", "fused"],
            "'fused' cannot be exported",
        ),
        (
            "export wrist --controller pi --out x --target onx".split(),
            "did you mean 'onnx'",
        ),
        (
            [*EXPORT, "wrist", "--controller", "pi", "--model", "no.xml"],
            "there is no file no.xml",
        ),
        ("export wrist --controller pi --out taken".split(), "is a file"),
        (
            [*EXPORT, "wrist", "--controller", "pi", "--model", ANKLE],
            "is no variant of the scene 'wrist'",
        ),
    ],
)
def test_bad_input_is_one_sentence(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("a file")
    assert cli.main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("cc-mujoco: ")
    assert said.err.count("\n") == 1
    assert says in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_list_shows_every_name_with_a_meaning(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from cc_mujoco.assets import SCENES as EVERY_SCENE
    from cc_mujoco.control import CONTROLLERS, POSITION_CONTROLLERS
    from cc_mujoco.device import MATERIALS, MOTORS, VARIABLES
    from cc_mujoco.diagnosis import EFFECTS
    from cc_mujoco.human import TASKS, TRAJECTORIES
    from cc_mujoco.metrics import METRICS

    laws = {*CONTROLLERS, *POSITION_CONTROLLERS, "decoupled_NAME"}
    played = {*EVERY_SCENE, *TRAJECTORIES, *TASKS, *laws}
    rows = {*VARIABLES, "OWNER.NAME", *MATERIALS, *MOTORS, *METRICS}
    assert cli.main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = " ".join(line for line in lines if line.startswith("  ")).split()
    assert {*names} == played | rows | {*EFFECTS}
    assert len(lines) <= 60
    assert max(map(len, lines)) <= 80
    assert cli.main(["list", "effects"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    entries = [line.split()[0] for line in lines if not line.startswith("   ")]
    assert (head, entries) == ("effects", list(EFFECTS))


def test_list_takes_a_part_of_a_name_or_of_a_meaning_or_a_device(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["list", "drum_w"]) == 0
    assert capsys.readouterr().out.split()[:2] == ["effects", "drum_winding"]
    assert cli.main(["list", "Kuhnen"]) == 0
    assert "prandtl_ishlinskii" in capsys.readouterr().out
    assert cli.main(["list", "extensor.friction"]) == 0
    assert "kinetic Coulomb coefficient" in capsys.readouterr().out
    assert cli.main(["list", "wrist"]) == 0
    assert "cables of wrist" in capsys.readouterr().out
    assert cli.main(["list", "rig.toml"]) == 0
    assert 'scene = "bench"' in capsys.readouterr().out
    assert cli.main(["list", "dataset.toml"]) == 0
    assert "[trials.run_7]" in capsys.readouterr().out
    assert cli.main(["list", "efects"]) == 2
    assert "effects" in capsys.readouterr().err
    assert cli.main(["list", "foo"]) == 2  # no foot
    assert cli.main(["list", "foot"]) == 0
    assert "fall" in capsys.readouterr().out


def command(*words: str, **how: Any) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    program = "import sys; from cc_mujoco import cli; sys.exit(cli.main())"
    settings = {"capture_output": True, "text": True, "env": ENVIRONMENT} | how
    return subprocess.run([sys.executable, "-c", program, *words], **settings)


HELP = """
import contextlib, io, json, sys
from cc_mujoco import cli
slow = {'matplotlib', 'mujoco', 'pyarrow', 'rerun', 'scipy', 'tqdm'}
found = {}
for words in WORDS:
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            cli.main([*words, '--help'])
    except SystemExit as stop:
        assert not stop.code
    loaded = sorted(slow & set(sys.modules))
    found[' '.join(words)] = {'said': said.getvalue(), 'loaded': loaded}
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def helps() -> dict[str, dict[str, Any]]:
    """By command, what its help says, and what had been loaded for it by then."""
    every = [[], *([name] for name in COMMANDS)]
    program = HELP.replace("WORDS", repr(every))
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT)
    assert done.returncode == 0, done.stderr
    found: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_reads_well_and_loads_nothing_that_takes_long(
    command: str, helps: dict[str, dict[str, Any]]
) -> None:
    said = helps[command]["said"]
    assert helps[command]["loaded"] == []
    assert "--help" in said
    for nonsense in ("None", "False", "default: )", "{None", "`module:function`"):
        assert nonsense not in said


def test_help_names_what_can_be_exported(helps: dict[str, dict[str, Any]]) -> None:
    words = set(re.findall(r"[\w-]+", helps["export"]["said"]))
    assert words >= {*EXPORTED, "c", "onnx"}


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"cc-mujoco {cc_mujoco.__version__}\n"


def test_a_reader_that_has_enough_ends_the_command_without_a_word() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = command("--help", capture_output=False, stdout=writer, stderr=-1)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def _code(words: list[str]) -> int:
    try:
        return cli.main(words)
    except SystemExit as stopped:
        return stopped.code


@pytest.mark.parametrize("stream", ["stdin", "stdout", "stderr"])
def test_a_closed_stream_changes_no_exit_code(
    stream: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python has None in its place."""
    lines = {"--version": 0, "--help": 0, "list": 0, "nonsense": 2}
    lines |= {f"{name} --nonsense": 2 for name in COMMANDS}
    lines |= {f"{name} --help": 0 for name in COMMANDS}
    for line, code in lines.items():
        monkeypatch.setattr(sys, stream, None)
        assert _code(line.split()) in (code, None), line
        getattr(sys, stream).close()


@pytest.mark.skipif(os.name == "nt", reason="its shell has no such words")
def test_a_shell_may_close_standard_output() -> None:
    program = "import sys; from cc_mujoco import cli; sys.exit(cli.main())"
    words = ["sh", "-c", 'exec "$0" -c "$1" --version >&-', sys.executable, program]
    done = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


NEEDED = {
    "export": ["wrist", "--controller", "pi", "--out", "x"],
    "run": ["--rig", "rig.toml", "--out", "x"],
    "whatif-show": ["study", "0"],
    "diagnose": ["wrist", "x.csv", "--out", "x"],
    **{name: ["wrist"] for name in ("device", "tendons", "play", "calibrate", "view")},
    "plugin": ["--out", "x"],
    "cite": ["runs"],
}
"""Words that a command needs."""


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_signal_ends_every_command_with_a_sentence_and_its_code(
    name: str,
    number: signal.Signals,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kind = COMMANDS[name]
    monkeypatch.setattr(kind, "run", lambda _: signal.raise_signal(number))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert cli.main([name, *NEEDED.get(name, ())]) == SIGNALS[number]
    finally:
        signal.signal(signal.SIGINT, before)
    said = capsys.readouterr().err
    left = getattr(kind, "interrupted", "nothing was written")
    assert said == f"cc-mujoco: interrupted, {left}.\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_finishes_in_spite_of_an_interruption_does_not_succeed(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def finishes(_: Any) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(COMMANDS[name], "run", finishes)
    assert cli.main([name, *NEEDED.get(name, ())]) == 143
    assert "the results are of what was done" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_the_end_of_the_interpreter_in_a_command_is_an_error(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(COMMANDS[name], "run", lambda _: sys.exit(0))
    assert cli.main([name, *NEEDED.get(name, ())]) == 2
    said = capsys.readouterr().err
    assert f"raised SystemExit in {__file__}, line " in said and said.count("\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="it cannot be deleted there")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_deleted_folder_is_one_sentence(
    name: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert cli.main([name, *NEEDED.get(name, ())]) == 2
    said = capsys.readouterr().err
    assert said == (
        "cc-mujoco: the current folder was deleted; change to one that is there.\n"
    )


@pytest.mark.parametrize("every", [8, pytest.param(1, marks=pytest.mark.study)])
@pytest.mark.parametrize("name", COMMANDS)
def test_only_options_of_the_command_are_proposed(
    name: str,
    every: int,
    helps: dict[str, dict[str, Any]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    def options(command: str) -> set[str]:
        return set(re.findall(r"--[a-z][\w-]+", helps[command]["said"]))

    first = list(COMMANDS).index(name) % every
    for option in sorted(set.union(*map(options, COMMANDS)))[first::every]:
        wrong = f"{option[:-1]}x{option[-1]}"
        assert cli.main([name, *NEEDED.get(name, ()), wrong]) == 2
        proposed = re.search(r"did you mean (--[\w-]+)", capsys.readouterr().err)
        assert proposed is None or proposed[1] in options(name)
    for old, new in {
        "--motion": "--trajectory",
        "--threads": "--workers",
        "--scene": "the first word, SCENE",
    }.items():
        assert cli.main([name, f"{old}=2"]) == cli.main([name, old, "2"]) == 2
        assert capsys.readouterr().err == 2 * f"cc-mujoco: {old} is now {new}.\n"


def test_old_metadata_in_the_folder_hides_no_command(tmp_path: Path) -> None:
    (tmp_path / "cc_mujoco.egg-info").mkdir()
    about = "Metadata-Version: 2.1\nName: cc_mujoco\nVersion: 0.1.0\n"
    (tmp_path / "cc_mujoco.egg-info" / "PKG-INFO").write_text(about)
    words = [sys.executable, "-m", "cc_mujoco.cli", "list", "tasks"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_command_takes_its_scene_first(
    helps: dict[str, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    first = {name: re.search(r"usage:[^\n]*", helps[name]["said"]) for name in COMMANDS}
    taking = {name for name, usage in first.items() if usage and "SCENE" in usage[0]}
    without = {"whatif-show", "plugin", "run", "list", "cite"}
    assert taking == set(COMMANDS) - without, (taking, first)


DEEP = {
    "toml": f"x = {'[' * 9999}{']' * 9999}",
    "json": f"{'[' * 99999}{']' * 99999}",
}


@pytest.mark.parametrize(
    "words",
    [
        ["play", "deep.toml"],
        ["play", "long.toml"],
        ["diagnose", "wrist", "x.csv", "--dataset", "deep.toml", "--out", "x"],
        ["diagnose", "x.csv", "--continue", ".", "--out", "x"],
        ["whatif", "--designs", "deep.toml"],
        ["whatif-show", ".", "0"],
        ["run", "--rig", "deep.toml", "--out", "x"],
        ["play", "wrist", "--controller", "deep.safetensors"],
    ],
    ids=" ".join,
)
def test_deep_files_are_one_sentence(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("x.csv").write_text("time_s\n0\n")
    Path("deep.toml").write_text(DEEP["toml"])
    Path("long.toml").write_text(f"{'.'.join(50_000 * 'a')} = 1")
    for name in ("verdict.json", "study.json"):
        Path(name).write_text(DEEP["json"])
    header = DEEP["json"].encode()
    content = len(header).to_bytes(8, "little") + header
    Path("deep.safetensors").write_bytes(content)
    assert cli.main(words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "Traceback" not in said


@pytest.mark.parametrize("name", COMMANDS)
def test_a_word_that_is_none_leads_to_the_help_of_its_command(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([name, "--nonsense"]) == 2
    assert capsys.readouterr().err.endswith(
        f"`cc-mujoco {name} --help` shows what works.\n"
    )
    assert cli.main(["--nonsense"]) == 2
    assert capsys.readouterr().err.endswith("`cc-mujoco --help` shows what works.\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device is full here")
def test_output_that_cannot_be_printed_is_one_sentence() -> None:
    with open("/dev/full", "w") as full:
        done = command("--version", capture_output=False, stdout=full, stderr=-1)
    assert done.returncode == 2
    assert done.stderr == (
        "cc-mujoco: cannot write standard output: no space is left.\n"
    )


def test_an_interrupted_import_is_an_interruption(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: Any) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:  # as Python 3.11 does in `__set_name__`
            raise RuntimeError("Error calling __set_name__") from None

    monkeypatch.setattr(Listing, "run", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert cli.main(["list"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    said = capsys.readouterr().err
    assert said == "cc-mujoco: interrupted, nothing was written.\n"


def test_signals_are_handled_before_anything_that_takes_long_is_imported() -> None:
    slow = ("gymnasium", "lazy_loader", "mujoco", "numpy", "scipy", "tyro")
    program = (
        "import sys; from cc_mujoco import cli\n"
        f"print(*(name for name in {slow!r} if name in sys.modules))"
    )
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT)
    assert (done.stdout.strip(), done.stderr) == ("lazy_loader", "")


@pytest.mark.parametrize("seconds", [0.15, 0.8])
def test_an_interruption_at_the_start_is_one_sentence(
    seconds: float, tmp_path: Path
) -> None:
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import sys; from cc_mujoco import cli; print('begun', flush=True)\n"
        "sys.exit(cli.main(['play', 'wrist', '--duration', '600']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=-1, stderr=-1, text=True,
        env=ENVIRONMENT,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "cc-mujoco: interrupted, nothing was written.\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)]
)
def test_a_signal_in_a_callback_from_c_is_not_lost(
    number: signal.Signals, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrived: list[int] = []

    @ctypes.CFUNCTYPE(None)
    def callback() -> None:
        arrived.append(1)
        signal.raise_signal(number)

    def called(self: Any) -> None:
        callback()
        late = time.monotonic() + 10.0
        while time.monotonic() < late:
            pass
        pytest.fail("the signal was lost")

    monkeypatch.setattr(Listing, "run", called)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert cli.main(["list"]) == code
    finally:
        signal.signal(signal.SIGINT, before)
    assert arrived == [1]


def test_a_signal_is_not_lost_while_another_is_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[threading.Timer] = []

    class Early(threading.Timer):
        """A timer that the first time fires before `start` returns."""

        def start(self) -> None:
            started.append(self)
            super().start()
            if len(started) == 1:
                self.join()

    monkeypatch.setattr(threading, "Timer", Early)
    test_a_signal_in_a_callback_from_c_is_not_lost(signal.SIGINT, 130, monkeypatch)
    assert len(started) == 2


RUNS = {
    "export": "export wrist --controller pi --no-check".split(),
    "export onnx": "export wrist --controller a.safetensors --target onnx".split(),
    "play": ["play", "wrist", "--duration", "0.1"],
    "benchmark": "benchmark wrist --controllers feedback --conditions ordinary-rough "
    "--seeds 1 --duration 1.2 --workers 1".split(),
    "whatif": "whatif --vary loops=1,2 --duration 0.1 --metric peak_tension".split(),
    "diagnose": ["diagnose", "bench", "data"],
    "diagnose plan": ["diagnose", "bench", "--plan"],
}
"""Commands that write a folder."""
FILES = {
    "calibrate": "calibrate wrist --out mine/file".split(),
    "device": "device wrist --out mine/file".split(),
    "plugin": "plugin --source --out mine".split(),
}
"""Commands that write files."""


def test_every_command_that_writes_is_tried_on_files_of_a_user() -> None:
    writes = {name for name, each in COMMANDS.items() if "out" in each.__annotations__}
    # Theirs are beside the study and the rig that they need.
    elsewhere = {"run", "whatif-show"}
    assert writes == {name.split()[0] for name in RUNS} | {*FILES} | elsewhere


@pytest.mark.parametrize("file", ["notes.txt", "log.parquet", "parts/mine", "link"])
@pytest.mark.parametrize("name", RUNS)
def test_no_command_writes_into_a_folder_of_a_user(
    name: str, file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine" / file
    path.parent.mkdir(parents=True)
    if file == "link":
        path.symlink_to("gone")
    else:
        path.write_text("mine")
    (tmp_path / "data").mkdir()
    assert cli.main([*RUNS[name], "--out", "mine"]) == 2
    said = capsys.readouterr().err
    assert (
        f"mine holds {path.relative_to(tmp_path / 'mine').parts[0]}, which no" in said
    )
    assert said.count("\n") == 1
    assert [p for p in tmp_path.rglob("*") if not p.is_dir()] == [path]
    assert file == "link" or path.read_text() == "mine"


@pytest.mark.parametrize("name", FILES)
def test_no_command_replaces_a_file_of_a_user(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine" / ("CMakeLists.txt" if name == "plugin" else "file")
    path.parent.mkdir()
    path.write_text("mine")
    assert cli.main(FILES[name]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [*path.parent.iterdir()] == [path] and path.read_text() == "mine"


@pytest.mark.usefixtures("undrawn", "unmeasured")
@pytest.mark.parametrize("name", ["export", "whatif"])
def test_a_command_runs_again_into_its_own_folder(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(2):
        assert cli.main([*RUNS[name], "--out", "runs"]) == 0


@pytest.mark.usefixtures("unmeasured")
def test_an_exported_controller_has_the_parameters_of_a_variant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_path("wrist").read_text("utf-8")
    assert scene.count('key="friction" value="0.21"') == 2
    variant = tmp_path / "variant.xml"
    variant.write_text(
        scene.replace('"friction" value="0.21"', '"friction" value="0.125"')
    )
    words = [
        *EXPORT,
        "wrist",
        "--controller",
        "model",
        "--model",
        variant.name,
        "--no-check",
    ]
    assert cli.main(words) == 0
    parameters = (tmp_path / "x" / "cc_parameters.c").read_text()
    for cable in ("FLEXOR", "EXTENSOR"):
        assert f"[CC_{cable}_FRICTION] = 0.125," in parameters
        assert f"[CC_{cable}_STATIC_FRICTION] = 0.63," in parameters


def test_a_file_that_cannot_grow_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    resource = pytest.importorskip("resource")
    write = viz.write_episode
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for most, file in ((1000, "log.parquet"), (400_000, "recording.rrd")):

        def limited(*given: Any, most: int = most, **asked: Any) -> Any:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
            try:
                return write(*given, **asked)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, before)

        monkeypatch.setattr(viz, "write_episode", limited)
        words = ["play", "wrist", "--duration", "0.3", "--out", "out"]
        assert cli.main(words) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert f"cannot write {tmp_path}/out/{file}: " in said
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["a file", "a link to nothing"])
def test_an_unwritable_folder_is_refused_before_the_simulation(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = tmp_path / "file"
    if kind == "a file":
        blocked.write_text("")
    else:
        blocked.symlink_to(tmp_path / "nothing")
    out = blocked / "run"
    assert cli.main(["play", "wrist", "--duration", "100000", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert (
        said == f"cc-mujoco: cannot write {out}: {blocked} is {kind}, and no folder.\n"
    )


def test_metrics_of_cables_stand_in_no_column_of_an_axis() -> None:
    units = {"hip.work": "J", "slack_cord": "s", "knee.work": "J", "slack_band": "s"}
    found = {Metric(n, u, "", len): k + 0.5 for k, (n, u) in enumerate(units.items())}
    names, work, blank, *cables = play._table(found, ("hip.", "knee."))
    assert names.split() == ["hip", "knee"]
    assert work.split() == ["work", "0.5", "2.5", "J"]
    assert blank == ""
    assert [line.split()[0] for line in cables] == ["slack_cord", "slack_band"]
