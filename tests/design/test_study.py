"""Studies: the same table however they are run, interrupted or shown."""

from __future__ import annotations

import importlib
import math
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco import cli
from cc_mujoco.control import CONTROLLERS, Controller, Network, write_policy
from cc_mujoco.control._registry import batched_controller
from cc_mujoco.design import Execution, StudySpec, carry_out, make_plan, study
from cc_mujoco.design._evaluation import evaluate
from cc_mujoco.design._execution import wait_sentences
from cc_mujoco.design._protocol import DEFAULT_METRICS, missing_variables
from cc_mujoco.design._report_text import RankedStudy, controllers_out
from cc_mujoco.design._results_store import read_study, read_table
from cc_mujoco.design._show import show
from cc_mujoco.device import VARIABLES, Drive
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.human import Hold, Sine, read_trajectory, task
from cc_mujoco.metrics import METRICS
from cc_mujoco.simulation import EpisodeLog, simulate
from study_marks import study_but

UNASKED = tuple(
    name for name in DEFAULT_METRICS if not missing_variables(METRICS[name], ())
)
EPISODE = tuple(name for name in UNASKED if METRICS[name].test == "episode")
VARY = {
    "friction": "0.05:0.2:3",
    "motor_radius": [0.02, 0.03],
    "motor_torque": "0.05,1",
}
KNEE = str(Path(__file__).parents[2] / "scripts" / "examples" / "knee_exo.xml")
SHORT: dict[str, Any] = {"duration": 0.15, "metrics": EPISODE, "trajectory": "sine"}


def shows(log: EpisodeLog, table: pa.Table, row: int, name: str) -> bool:
    """Return whether a metric of a log is that of a row, bit for bit."""
    found, value = METRICS[name].compute(log), table[name][row].as_py()
    return found == value or (math.isnan(found) and value is None)


def test_a_row_is_the_recording_of_its_design_bit_for_bit(tmp_path: Path) -> None:
    table = study("wrist", VARY, out=tmp_path, **SHORT)
    for row in (0, 5, 11):
        log, model = show(tmp_path, row)
        assert all(shows(log, table, row, name) for name in EPISODE)
        assert log.metadata["variables"]["friction"] == table["friction"][row].as_py()
        assert abs(model.actuator("flexor_proximal").gear[0]) == pytest.approx(
            table["motor_radius"][row].as_py()
        )
        assert "flexor_route" in log.metadata["model_xml"]


@pytest.mark.parametrize("law", study_but(2, ["fused", "adaptive"]))
def test_controllers_that_sense_tension_are_shown_as_measured(
    law: str, tmp_path: Path
) -> None:
    vary = {"joint_radius": [0.09, 0.104], "friction": [0.02, 0.05]}
    table = study("wrist", {**vary, "static_friction": 0.0}, out=tmp_path,
                  controllers=[law], **SHORT)  # fmt: skip
    plain = study(
        "wrist", {**vary, "static_friction": 0.0}, controllers=["none"], **SHORT
    )
    log, _ = show(tmp_path, 2)
    assert shows(log, table, 2, "rms_torque_error")
    assert not table["rms_torque_error"].equals(plain["rms_torque_error"])


def test_an_ankle_is_shown_as_it_was_measured(tmp_path: Path) -> None:
    vary = {"joint_radius": [0.1, 0.13], "rotor_inertia": [0.005, 0.008]}
    table = study("ankle", vary, out=tmp_path, duration=0.15, metrics=EPISODE)
    log, _ = show(tmp_path, 3)
    assert shows(log, table, 3, "rms_torque_error")


def test_the_table_is_the_same_on_any_number_of_threads() -> None:
    vary = {"friction": "0.05:0.2:3", "segments": [5, 20], "loops": [1, 2]}
    tables = [study("wrist", vary, threads=n, **SHORT) for n in (1, 3)]
    assert len(tables[0]) == 12
    assert tables[1].equals(tables[0], check_metadata=True)


def test_a_motion_is_a_name_a_file_or_an_object(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("time_s,angle_deg\n0,0\n0.1,2\n0.2,4\n0.3,2\n")
    vary = {"friction": [0.05, 0.1]}
    given = {"metrics": ["rms_motor_torque"], "duration": 0.1}
    tables = [
        study("wrist", vary, trajectory=motion, **given)
        for motion in (path, read_trajectory(path))
    ]
    assert tables[0].equals(tables[1])
    sine = Sine(amplitude=0.2)
    folder = tmp_path / "runs"
    first = study("wrist", vary, trajectory=sine, out=folder, **given)
    again = study("wrist", vary, trajectory=Sine(0.2), out=folder, **given)
    assert first.equals(again) and not first.equals(tables[0])
    assert read_study(folder)["protocol"]["trajectory"] == repr(sine)
    with pytest.raises(CableError, match=r"a Python object, Sine\(.*a name, a table"):
        show(folder, 0)
    with pytest.raises(CableError, match="trajectory must be a name"):
        study("wrist", vary, trajectory=3, **given)


def test_a_task_is_a_text_a_table_or_an_object(tmp_path: Path) -> None:
    vary = {"friction": [0.05, 0.1]}
    given = {"metrics": ["rms_motor_torque"], "duration": 0.1, "trajectory": "sine"}
    path = tmp_path / "torque.csv"
    path.write_text("time_s,torque_nm\n0,0.3\n1,0.3\n")
    folder = tmp_path / "runs"
    texts = study("wrist", vary, task="hold:0.3", out=tmp_path / "text", **given)
    table = study("wrist", vary, task=path, out=folder, **given)
    thing = study("wrist", vary, task=Hold(0.3), out=tmp_path / "thing", **given)
    assert texts.equals(table) and texts.equals(thing)
    assert read_study(folder)["protocol"]["task"] == str(path)
    assert read_study(tmp_path / "thing")["protocol"]["task"] == "Hold(pull=0.3)"
    for name in (folder, tmp_path / "text"):
        log, _ = show(name, 0)
        assert np.all(log["desired_torque_nm"] == 0.3)
    with pytest.raises(CableError, match="plays a task that was given as a Python obj"):
        show(tmp_path / "thing", 0)
    with pytest.raises(CableError, match="differs in its task"):
        study("wrist", vary, task="hold:0.4", out=tmp_path / "text", **given)
    path.write_text("time_s,torque_nm\n0,0.3\n1,0.4\n")
    with pytest.raises(CableError, match=r"differs in .*torque\.csv"):
        study("wrist", vary, task=path, out=folder, **given)
    with pytest.raises(CableError, match="task must be a name"):
        study("wrist", vary, task=3, **given)


def test_the_files_of_a_users_task_make_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_pull.py").write_text(
        "from cc_mujoco.human import Task\n"
        "class Pull(Task):\n"
        "    of_phase = True\n"
        "    def torque(self, angle, velocity, phase):\n"
        "        return 0.0 * angle + 0.3\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    vary = {"friction": [0.05, 0.1]}
    given = {"metrics": ["rms_motor_torque"], "duration": 0.1, "trajectory": "sine"}
    named = make_plan(StudySpec("wrist", vary, task="my_pull:Pull", **given))
    thing = make_plan(
        StudySpec(
            "wrist", vary, task=importlib.import_module("my_pull").Pull(), **given
        )
    )
    wrapped = make_plan(StudySpec("wrist", vary, task=task("my_pull:Pull"), **given))
    for plan in (named, thing, wrapped):
        assert list(plan.made_by()["files"]) == ["my_pull.py"]
    assert named.describe()["protocol"]["task"] == "my_pull:Pull"
    assert thing.describe()["protocol"]["task"].startswith("Pull ")
    ours = study("wrist", vary, task="hold:0.3", **given)
    assert study("wrist", vary, task="my_pull:Pull", **given).equals(ours)


def test_a_design_is_the_same_in_any_company() -> None:
    plan = make_plan(StudySpec("wrist", VARY, **SHORT))
    together = evaluate(plan.protocol, plan.designs)
    for index in (0, 7):
        alone = evaluate(plan.protocol, [plan.designs[index]])
        assert np.array_equal(
            list(alone[0].metrics.values()),
            list(together[index].metrics.values()),
            equal_nan=True,
        )


def test_a_damaged_folder_is_mended_or_one_sentence(tmp_path: Path) -> None:
    plan = make_plan(StudySpec("wrist", {"friction": [0.1, 0.2]}, **SHORT))
    table = carry_out(plan, tmp_path)
    (tmp_path / "table.parquet").write_text("torn")
    for use in (lambda: carry_out(plan, tmp_path), lambda: show(tmp_path, 0)):
        with pytest.raises(CableError, match="delete it"):
            use()
    (tmp_path / "table.parquet").unlink()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "000000.parquet").write_text("torn")
    assert carry_out(plan, tmp_path).equals(table)
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(CableError, match="holds no study"):
        show(tmp_path, 0)


class _StopError(Exception):
    pass


def test_an_interrupted_study_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(StudySpec("wrist", VARY, **SHORT))
    expected = carry_out(plan)
    reached: list[float] = []

    def stop(done: float) -> None:
        reached.append(done)
        if done >= 5.0:
            raise _StopError

    with pytest.raises(_StopError):
        carry_out(plan, tmp_path, Execution(threads=1), progress=stop)
    parts = list((tmp_path / "parts").iterdir())
    assert 0 < len(parts) < len(plan.batches)
    assert not (tmp_path / "table.parquet").exists()
    with pytest.raises(CableError, match="not finished"):
        show(tmp_path, 0)

    calls = []
    real = evaluate
    monkeypatch.setattr(
        "cc_mujoco.design._evaluation.evaluate",
        lambda *arguments: calls.append(1) or real(*arguments),
    )
    resumed: list[float] = []
    table = carry_out(plan, tmp_path, progress=resumed.append)
    assert len(calls) == len(plan.batches) - len(parts)
    assert resumed[0] == sum(len(b) for b in plan.batches[: len(parts)])
    assert table.equals(expected)
    assert not (tmp_path / "parts").exists()
    calls.clear()
    assert carry_out(plan, tmp_path).equals(expected)
    assert not calls


def test_a_folder_keeps_one_study(tmp_path: Path) -> None:
    vary: dict[str, Any] = {"friction": [0.1], "pretension": [10.0, 20.0]}
    study("wrist", vary, out=tmp_path, **SHORT)
    turned = [dict(zip(vary, (0.1, p), strict=True)) for p in (10.0, 20.0, 30.0)]
    for changed, differing in (
        ({"vary": {**vary, "friction": [0.2]}}, "the values of friction"),
        ({"vary": {**vary, "friction": "0.1,0.2"}}, "the values of friction"),
        ({"vary": {"friction": 0.2, "pretension": 5}}, "of friction, pretension"),
        ({"vary": {"friction": [0.1]}}, "its variables"),
        ({"vary": None, "designs": turned}, "the values of pretension"),
        ({"seed": 1}, "its seed"),
    ):
        with pytest.raises(CableError, match=f"differs in.*{differing};"):
            study("wrist", out=tmp_path, **{"vary": vary, **SHORT, **changed})


@pytest.fixture
def gain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Return a function that sets the gain which the controller `gained:make` reads."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "gained", raising=False)
    Path("gained.py").write_text(
        "from pathlib import Path\n"
        "CC_MUJOCO_FILES = ('gain.txt',)\n"
        "def make(drive):\n"
        "    gain = float(Path('gain.txt').read_text())\n"
        "    return lambda seen: gain + 0.0 * seen['joint_angle_rad']\n"
    )
    return lambda value: Path("gain.txt").write_text(f"{value}") and None


OWN: dict[str, Any] = {
    "controllers": ["gained:make"],
    "out": "study",
    "trajectory": "sine",
    "duration": 0.3,
    "metrics": ("rms_torque_error",),
}


def test_rows_of_other_code_are_neither_taken_nor_lost(
    gain: Callable[[float], None],
) -> None:
    vary = {"friction": [0.1, 0.2]}
    gain(0.0)
    first = study("wrist", vary, **OWN)
    gain(0.2)
    with pytest.raises(CableError, match=r"differs in gain\.txt; --again replaces"):
        study("wrist", vary, **OWN)
    with pytest.raises(CableError, match=r"design 1 .* differs in gain\.txt"):
        show("study", 1, allow=("gained:make",))
    assert read_table(Path("study")).equals(first)
    again = study("wrist", vary, **OWN, again=True)
    assert again.equals(study("wrist", vary, **{**OWN, "out": None}))
    assert not again.equals(first)
    log, _ = show("study", 1, allow=("gained:make",))
    assert shows(log, again, 1, "rms_torque_error")


def test_beginning_again_may_be_interrupted(gain: Callable[[float], None]) -> None:
    vary = {"friction": [0.1, 0.2]}
    gain(0.0)
    first = study("wrist", vary, **OWN)
    gain(0.2)

    def stop(done: float) -> None:
        if done > 1.0:
            raise _StopError

    with pytest.raises(_StopError):
        study("wrist", vary, **OWN, again=True, threads=1, progress=stop)
    assert read_table(Path("study")).equals(first)
    begun: list[float] = []
    table = study("wrist", vary, **OWN, progress=begun.append)
    assert begun[0] == 1.0
    assert table.equals(study("wrist", vary, **{**OWN, "out": None}))
    gain(0.3)
    (Path("study") / "table.parquet").rename("aside")
    shutil.copytree("study", "other")
    with pytest.raises(_StopError):
        study("wrist", vary, **{**OWN, "out": "other"}, threads=1, progress=stop)
    gain(0.4)
    with pytest.raises(CableError, match=r"differs in gain\.txt; --again replaces"):
        study("wrist", vary, **{**OWN, "out": "other"})


def test_a_design_that_fails_is_a_row_with_the_reason(
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
    metrics = ("slack_margin", "reflected_torque")
    vary = {"motor_torque": [0.1, 1.0, 0.2]}
    table = study("wrist", vary, controllers=["mad"], duration=0.2, metrics=metrics)
    failed = table["failed"].to_pylist()
    assert failed[0] is failed[2] is None
    assert failed[1] == "controller 'mad' gave no finite torque at 0.000 s"
    assert table["reflected_torque"][1].as_py() is None
    alone = study("wrist", {"motor_torque": [0.1]}, controllers=["mad"], duration=0.2,
                  metrics=metrics)  # fmt: skip
    assert table.slice(0, 1).drop_columns("design").equals(alone.drop_columns("design"))


def test_of_several_controllers_a_design_has_that_which_tracks_best(
    tmp_path: Path,
) -> None:
    laws = "none", "pi"
    metrics = "peak_tension", "rms_torque_error", "reflected_torque"
    vary = {"friction": [0.02, 0.2], "motor_torque": [1.0]}
    about: dict[str, Any] = {**SHORT, "metrics": metrics}
    plan = make_plan(StudySpec("wrist", vary, controllers=laws, **about))

    def stop(done: float) -> None:
        if done >= 1.0:
            raise _StopError

    with pytest.raises(_StopError):
        carry_out(plan, tmp_path, Execution(threads=1), progress=stop)
    table = carry_out(plan, tmp_path)
    assert "reflected_torque@pi" not in table.column_names
    alone = {law: study("wrist", vary, controllers=[law], **about) for law in laws}
    for number, row in enumerate(table.to_pylist()):
        each = {law: alone[law].slice(number, 1).to_pylist()[0] for law in laws}
        best = min(laws, key=lambda law: each[law]["rms_torque_error"])
        assert row["controller"] == best
        assert [row[name] for name in metrics] == [each[best][n] for n in metrics]
        for law in laws:
            assert row[f"peak_tension@{law}"] == each[law]["peak_tension"]
    log, _ = show(tmp_path, 1)
    assert log.metadata["controller"] == table["controller"][1].as_py()
    assert shows(log, table, 1, "peak_tension")


def test_what_several_controllers_are_chosen_by_is_measured() -> None:
    about: dict[str, Any] = {"controllers": ("none", "pi"), "metrics": ["peak_tension"]}
    plan = make_plan(StudySpec("wrist", {"friction": [0.1]}, **about))
    assert plan.protocol.metrics == ("peak_tension", "rms_torque_error")


def test_a_controller_that_fails_is_out_and_why_is_told(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Broken(Controller):
        """Gives no number."""

        def reset(self, where: Any = None) -> None:
            """Nothing to forget."""

        def torque(self, observation: Any) -> Any:
            """Not a number."""
            return np.nan + 0.0 * observation["joint_angle_rad"]

    monkeypatch.setitem(CONTROLLERS, "broken", Broken)
    about: dict[str, Any] = {**SHORT, "metrics": ("peak_tension",)}
    table = study("wrist", {"friction": [0.1]}, controllers=["broken", "none"], **about)
    (row,) = table.to_pylist()
    assert row["controller"] == "none" and row["failed"] is None
    assert row["peak_tension@broken"] is None
    assert row["peak_tension"] == row["peak_tension@none"] > 0.0
    assert "'broken' gave no finite torque" in row["failed@broken"]
    assert row["failed@none"] is None
    spec = StudySpec("wrist", {"friction": [0.1]}, controllers=["broken", "none"])
    plan = make_plan(replace(spec, metrics=about["metrics"]))
    said = controllers_out(RankedStudy(plan, table))
    assert len(said) == 1
    assert said[0].startswith("Controller broken is out in 1 of 1 designs; the first: ")
    out = tmp_path / "kept"
    command = ["whatif", "--vary", "friction=0.1", "--metric", "peak_tension"]
    command += ["--duration", "0.2", "--controllers", "broken", "none"]
    assert cli.main([*command, "--out", str(out)]) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if "is out" in x]
    assert "'broken' gave no finite torque" in line
    for name in ("ranking.md", "report.html"):
        assert "Controller broken is out in 1 of 1" in (out / name).read_text()
    alone = study("wrist", {"friction": [0.1]}, controllers=["broken"], **about)
    assert "'broken' gave no finite torque" in alone["failed"][0].as_py()
    assert "failed@broken" not in alone.column_names


def test_a_folder_keeps_one_list_of_designs(tmp_path: Path) -> None:
    names = ("friction", "pretension")
    pairs = ((0.1, 10.0), (0.2, 20.0), (0.1, 20.0))
    listed = [dict(zip(names, pair, strict=True)) for pair in pairs]
    study("wrist", designs=listed[:2], out=tmp_path, **SHORT)
    with pytest.raises(CableError, match="differs in its designs;"):
        study("wrist", designs=listed, out=tmp_path, **SHORT)


def test_a_list_that_has_a_design_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("friction,loops\n0.1,1\n0.2,1\n0.10,1.0\n")
    with pytest.raises(CableError, match=r"designs 0 and 2 .*the same, friction=0\.1"):
        make_plan(StudySpec("wrist", designs=tmp_path / "list.csv"))


def test_controllers_that_need_a_drive_each_get_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Scalar(Controller):
        """Works with the numbers of one device only."""

        def __init__(self, drive: Drive) -> None:
            super().__init__(drive)
            self.gain = math.sqrt(drive.high)

        def reset(self, where: Any = None) -> None:
            """Nothing to forget."""

        def torque(self, observation: Any) -> Any:
            """Proportional to the angle."""
            return self.gain * observation["joint_angle_rad"]

    monkeypatch.setitem(CONTROLLERS, "scalar", Scalar)
    drives = [Drive(5.0, -high, high, 1e-3) for high in (1.0, 4.0, 9.0)]
    laws = batched_controller("scalar", [[drive] for drive in drives], ("",))
    seen = {name: np.ones(3) for name in MEASURED_COLUMNS}
    assert laws.torque(seen).tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("scene", study_but(2, ["wrist", "ankle"]))
def test_a_saved_policy_drives_designs_as_their_environments(
    scene: str, tmp_path: Path
) -> None:
    drive = gymnasium.make("cc_mujoco/Device-v1", device=scene).unwrapped.exo.drive  # type: ignore[attr-defined]
    observed = drive.observed
    size = observed.frame
    weights = np.array([[0.3, -0.5, 0.2, -0.1, 0.8, 0.4, 0.1, -0.1]])[:, :size]
    still = np.zeros(size), np.ones(size)
    network = Network((weights,), (np.zeros(1),), "identity", False, *still)
    law = str(tmp_path / "policy.safetensors")
    write_policy(law, network, observed)
    folder, vary = tmp_path / "study", {"motor_torque": [0.5, 4.0]}
    about: dict[str, Any] = {**SHORT, "trajectory": "sine", "controllers": [law]}
    table = study(scene, vary, out=folder, **about)
    for row in range(2):
        log, _ = show(folder, row)
        assert shows(log, table, row, "rms_torque_error")
        # What the policy saw, worked out from the log; each acts in the step after.
        joint, desired = log["joint_angle_rad"], log["desired_torque_nm"]
        seen = [
            log["motor_angle_rad"] / observed.ratio - joint,
            log["motor_velocity_rad_s"] / observed.ratio,
            joint,
            log["joint_velocity_rad_s"],
            desired - log["joint_torque_nm"],
            desired,
            *(log[name] for name in observed.columns[6:]),
        ]
        frames = np.clip(np.array(seen).T / observed.units, -10.0, 10.0)
        share = np.clip(frames @ weights[0], -1.0, 1.0)
        assert np.abs(log["motor_torque_nm"][1:]).max() == pytest.approx(
            np.abs(share[:-1]).max() * table["motor_torque"][row].as_py(), rel=1e-5
        )


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_every_controller_drives_different_designs_as_each_alone(name: str) -> None:
    vary = {"motor_radius": [0.02, 0.03]}
    plan = make_plan(
        StudySpec("wrist", vary, controllers=[name], **{**SHORT, "duration": 0.06})
    )
    together = evaluate(plan.protocol, plan.designs)
    for design, result in zip(plan.designs, together, strict=True):
        (alone,) = evaluate(plan.protocol, [design])
        assert np.array_equal(
            list(alone.metrics.values()), list(result.metrics.values()), equal_nan=True
        )


@pytest.mark.parametrize(
    ("name", "vary"),
    [
        # No two designs have one controller.
        *study_but(
            2, [(name, {"motor_radius": [0.02, 0.03]}) for name in sorted(CONTROLLERS)]
        ),
        # All designs have one controller.
        *((name, {"rotor_inertia": [0.005, 0.008]}) for name in ("pi", "predictive")),
    ],
)
def test_a_task_of_the_phase_alone_is_asked_of_every_design(
    name: str, vary: dict[str, Any]
) -> None:
    plan = make_plan(
        StudySpec(
            "ankle",
            vary,
            controllers=[name],
            duration=0.05,
            task="assist",
            metrics=("rms_torque_error", "peak_motor_power"),
        )
    )
    together = evaluate(plan.protocol, plan.designs)
    alone = [evaluate(plan.protocol, [design])[0] for design in plan.designs]
    assert together == alone


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"trajectory": "swep"}, "did you mean 'sweep'"),
        ({"task": "tunel"}, "did you mean 'tunnel'"),
        ({"controllers": ["pid"]}, "did you mean 'pi'"),
        ({"controllers": ["pi", "pid"]}, "did you mean 'pi'"),
        ({"controllers": ["pi", "pi"]}, "'pi' is given twice"),
        ({"controllers": []}, "needs a controller"),
        ({"controllers": "pi"}, "list of texts"),
        ({"metrics": "slack_margin"}, "metrics must be a list of texts"),
        ({"vary": [("friction", [0.1])]}, "vary must be a dictionary"),
        ({"across": [("friction", [0.1])]}, "across must be a dictionary"),
        ({"vary": None, "designs": {"friction": 0.1}}, "a file or a list"),
        ({"vary": None, "designs": ["friction"]}, "design 0 must be a dictionary"),
        ({"sampling": "lhs", "samples": 2.5}, "must be whole, not 2.5"),
        ({"metrics": ["efficency"]}, "did you mean 'efficiency'"),
        ({"timestep": 0.0003}, "must be a whole number of time steps of 0.3 ms"),
        ({"duration": 0.0}, "duration"),
        ({"seed": -1}, "seed"),
        ({"sampling": "random"}, "sampling"),
        ({"sampling": "lhs"}, "number of samples"),
        ({"designs": [{"friction": 0.1}]}, "both `vary`"),
        ({"scheduler": "nowhere"}, "no Dask scheduler|needs Dask"),
        ({"vary": {"friction": "1.5:2.5:3"}}, r"design 1 .*\(2 of 3 are impossible\)"),
    ],
)
def test_an_impossible_study_is_one_sentence(
    changes: dict[str, Any], wrong: str
) -> None:
    arguments: dict[str, Any] = {"vary": {"friction": [0.1]}, **SHORT, **changes}
    with pytest.raises(CableError, match=wrong) as error:
        study("wrist", **arguments)
    assert "\n" not in str(error.value)


def test_the_table_says_what_its_columns_are() -> None:
    table = study("wrist", designs=[{"friction": 0.1}], controllers=["none"],
                  duration=0.1, timestep=1e-3)  # fmt: skip
    assert table.column_names == ["design", "friction", *UNASKED, "failed"]
    for field in table.schema:
        assert field.metadata[b"meaning"]
    unit = table.schema.field("peak_motor_power").metadata[b"unit"]
    assert unit == METRICS["peak_motor_power"].unit.encode()
    assert table.schema.field("reflected_torque").type == pa.float64()
    assert not set(METRICS) & set(VARIABLES)


@pytest.mark.parametrize("drag", [0.0, 200.0])
def test_a_design_that_pulls_harder_than_is_safe_has_failed(drag: float) -> None:
    """As in the benchmark; it was ranked by its metrics."""
    vary = {"load_independent_friction": [drag]}
    plan = make_plan(
        StudySpec(
            "ankle",
            vary,
            controllers=["none"],
            duration=1.3,
            metrics=("rms_torque_error",),
        )
    )
    (result,) = evaluate(plan.protocol, plan.designs)
    if drag:
        assert result.failed.startswith("the joint torque exceeds the safe 60 N m at ")
    else:
        assert result.failed == ""
    assert math.isnan(result.metrics["rms_torque_error"]) == bool(result.failed)


@settings(max_examples=5, deadline=None)
@given(demand=st.floats(8.0, 30.0))
def test_the_assumed_safe_torque_of_a_design_is_that_of_its_task(demand: float) -> None:
    """As in `play`; a task above the limit of the device's own task failed."""
    spec = StudySpec(
        KNEE,
        {"friction": [0.05]},
        task=f"hold:{demand}",
        duration=0.5,
        metrics=("rms_torque_error", "peak_over_safe", "peak_joint_torque"),
    )
    plan = make_plan(spec)
    (result,) = evaluate(plan.protocol, plan.designs)
    assert result.failed == ""
    with_task = simulate(KNEE, "pi_tuned", task=f"hold:{demand}", duration=0.1)
    safe = with_task.metadata["safe_torque"]
    assert safe >= 1.9 * demand  # two digits
    found = result.metrics
    assert found["peak_over_safe"] * safe == pytest.approx(found["peak_joint_torque"])


def test_a_long_wait_is_estimated_before_it_begins() -> None:
    vary = {"friction": "0.05:0.3:400"}
    plan = make_plan(StudySpec("wrist", vary, controllers=["pi_tuned", "predictive"]))
    said = wait_sentences(plan, 1)
    assert next(said) == "timing predictive for an estimate"
    (sentence,) = said
    assert re.fullmatch(
        r"predictive takes about \d+ (minutes|hours) for 400 designs; "
        r"pi_tuned is \d+ times faster\.",
        sentence,
    )
    assert not [*wait_sentences(make_plan(StudySpec("wrist", vary)), 1)]


def test_a_scale_of_what_is_off_is_no_variable() -> None:
    vary: dict[str, Any] = {"seating_tension": [2.0, 6.0]}
    with pytest.raises(CableError, match="no effect: clearance is 0; vary it, too"):
        make_plan(StudySpec("wrist", vary))
    assert make_plan(StudySpec("wrist", vary | {"clearance": 1e-4})).designs


def test_clearance_and_soft_ends_are_variables() -> None:
    """Both widen the loop of the transmission; pretension takes clearance up."""
    given: dict[str, Any] = {
        "duration": 2.0, "metrics": ("twist_backlash",), "trajectory": "sine",
        "task": "spring:1", "controllers": ("none",),
    }  # fmt: skip
    vary = {"clearance": [0.0, 1e-3], "pretension": [6.0, 18.0]}
    loops = study("wrist", vary, **given)["twist_backlash"].to_pylist()
    low, high = loops[2] - loops[0], loops[3] - loops[1]
    assert low > high > 0.0
    soft = {"end_compliance": [1e-4], "end_hardening": [0.02], "end_loss": [0.0, 0.4]}
    kept, lost = study("wrist", soft, **given)["twist_backlash"].to_pylist()
    assert lost > 1.1 * kept
