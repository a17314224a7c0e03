"""`dataset.toml`: what it says, and sentences for what it cannot say."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.datasets import TrialFacts
from cc_mujoco.datasets import _dataset_file as dataset_file
from cc_mujoco.datasets._dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.diagnosis import load
from cc_mujoco.diagnosis._checks.content import repeat_scatter
from cc_mujoco.errors import CableError
from diagnosis.bench import recording, write
from shared_folder import SHARED

# The first of three occasions.
DAVINCI = sorted((SHARED / "data" / "davinci").glob("tool4_freq*.csv"))
STUDY = Path(__file__).parents[2] / "scripts" / "diagnosis_study"
DAVINCI_TOML = STUDY / "davinci.toml"


def parsed(folder: Path, text: str) -> DatasetFile:
    path = folder / "dataset.toml"
    path.write_text(text, encoding="utf-8")
    return read_dataset_file(path)


def test_the_example_of_the_documentation(tmp_path: Path) -> None:
    example = Path(dataset_file.__file__).with_name("dataset.toml")
    file = read_dataset_file(example)
    angle = file.source("motor_angle_rad")
    assert (angle.name, angle.unit, angle.sign) == ("theta_m", "deg", -1.0)
    assert angle.scale == 0.087890625
    assert (angle.offset, angle.delay, angle.clock) == (2048.0, 0.004, "t_encoder")
    assert (angle.noise, angle.resolution) == (1.5, 1.0)
    assert file.rig["motor_radius"] == pytest.approx(Constant(0.02, 1e-4))
    assert file.rig["joint_radius"] == Constant(0.104, 0.0)
    assert file.facts_of(Path("x/run_7.csv")) == TrialFacts(
        split="test",
        repeat_of="run_3",
        pretension=12.0,
        temperature=23.5,
        locked="joint",
        tilt=1.57,
        valid=((0.5, 12.0),),
        occasion="March",
        exclude=True,
        unhooked=True,
        known_joint_torque=2.0,
        known_motor_torque=2.0,
        swapped=True,
        notes="operator sneezed at the end",
    )
    assert file.facts_of(Path("run_8.parquet")) == TrialFacts(
        pretension=12.0, load_cell="tension_agonist_distal_n"
    )
    assert file.facts_of(Path("run_9.parquet")) == TrialFacts(pretension=12.0)
    assert file.facts_of(Path("walk.csv")) == TrialFacts()
    assert file.name == "wrist rig, March" and len(file.sha256) == 64


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[column.time_s]", "key 'column' in .*dataset.toml: did you mean 'columns'"),
        ("[columns.motor_angle]", "did you mean 'motor_angle_rad'"),
        ("[columns.motor_angle_rad]\nunits = 'deg'", "'units' .*did you mean 'unit'"),
        ("[columns.motor_angle_rad]\nunit = 'Nm'", "unknown unit 'Nm' in"),
        ("[columns.motor_torque_nm]\nsign = 2", "sign must be 1 or -1, not 2"),
        ("[columns.motor_torque_nm]\ndelay = 4", "delay must be at most 2 s .*not 4"),
        ("[columns.motor_torque_nm]\ndelay = '4 ms'", "delay must be a finite number"),
        ("[columns.motor_torque_nm]\nnoise = -1", "noise must be .* at least 0"),
        ("[columns.motor_torque_nm]\noffset = nan", "offset must be a finite number"),
        (f"[rig]\nfriction = 1{'0' * 400}", "value must be a finite number"),
        ("[trials.a]\nsplit = 'select'", "unknown split"),
        ("[trials.a]\ntilt = 90", "tilt must be an angle in radians.* not 90"),
        ("[columns.motor_torque_nm]\nname = 3", "name must be a text in quotes"),
        ("[columns.valid]\nsign = -1", r"'sign' in .*\[columns.valid\]"),
        ("[columns.time_s]\ndelay = 1", r"'delay' in .*\[columns.time_s\]"),
        ("columns = 3", r"columns must be a table, written as \[columns\]"),
        ("[trials]\nrun_1 = 'test'", r"run_1 must be a table"),
        ("[rig]\nmotor_radus = 1", "did you mean 'motor_radius'"),
        ("[rig]\nload_damping = {value = 0, uncertainty = 1}", "more than 0 where"),
        (
            "[rig]\ngear_ratio = {value = 5, uncertainty = 1}",
            "takes this constant for exact",
        ),
        ("[rig]\nmotor_radius = '2 cm'", "value must be a finite number"),
        ("[rig]\nmotor_radius = {unit = 'mm'}", "needs a `value`"),
        ("[rig]\nmotor_radius = {value = 2, unit = 'in'}", "unknown unit"),
        (
            "[rig]\nfriction = true",
            "value must be a finite number of at least 0, not True",
        ),
        ("[trials.a]\nsplit = 'training'", "unknown split .* did you mean 'train'"),
        ("[trials.a]\nvalid = [1, 2]", "valid must be a list of"),
        ("[trials.a]\nvalid = [[2, 1]]", "valid must be a list of"),
        ("[trials.a]\npretension = -3", "pretension must be more than 0"),
        ("[trials.a]\nlocked = 'both'", "unknown locked"),
        ("[trials.a]\nrepeats = 'b'", "unknown key"),
        ("[trials.a]\nload_cell = 'left'", "load_cell must be a channel such as"),
        (
            "[trials.a]\nload_cell = 'tension_a_distal_n'\nunhooked = true",
            "pull at no `load_cell`",
        ),
        ("name = [", "is not a TOML file"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    tmp_path: Path, text: str, sentence: str
) -> None:
    with pytest.raises(CableError, match=sentence) as error:
        parsed(tmp_path, text)
    assert "dataset.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_or_not_text(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="cannot read"):
        read_dataset_file(tmp_path / "none.toml")
    with pytest.raises(CableError, match="cannot read"):
        read_dataset_file(tmp_path)
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CableError, match="not a TOML file"):
        read_dataset_file(tmp_path / "x.toml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[trials.run_9]\nsplit = 'test'", r"\[trials\] 'run_9': did you mean 'run_"),
        ("[trials.run_1]\nrepeat_of = 'run_1'", "cannot repeat itself"),
        ("[trials.'run_*']\nrepeat_of = 'run_1'", "cannot repeat itself"),
    ],
)
def test_trials_that_are_not_there(tmp_path: Path, text: str, sentence: str) -> None:
    file = parsed(tmp_path, text)
    with pytest.raises(CableError, match=sentence):
        file.check_trials({Path("run_1.csv"): "run_1", Path("run_2.csv"): "run_2"})


FOLDER = """
[trials."run_*"]
pretension = 12
[trials.run_2]
repeat_of = "run_1.csv"
[trials."more/walk"]
temperature = 20
"""


def test_trials_of_the_folder_that_were_not_given_need_not_be_there(
    tmp_path: Path,
) -> None:
    (tmp_path / "more").mkdir()
    for name in ("run_1", "run_2", "more/walk"):
        write(tmp_path / f"{name}.csv", recording(1.0, seed=len(name)))
    toml = tmp_path / "dataset.toml"
    toml.write_text(FOLDER, encoding="utf-8")
    dataset, _ = load(tmp_path / "run_2.csv")
    assert dataset.trials[0].facts == TrialFacts(pretension=12.0, repeat_of="run_1")
    # What is said of a trial does not hang on which others are given, either.
    dataset, _ = load(tmp_path / "more" / "walk.csv", toml)
    assert dataset.trials[0].facts == TrialFacts(temperature=20.0)
    toml.write_text("[trials.run_7]", encoding="utf-8")
    with pytest.raises(CableError, match=r"\[trials\] 'run_7': did you mean 'run_"):
        load(tmp_path / "run_2.csv")


def test_part_of_a_dataset_may_lack_what_its_trials_repeat(tmp_path: Path) -> None:
    for name in ("run_2", "run_3"):
        write(tmp_path / f"{name}.csv", recording(1.0))
    toml = tmp_path / "dataset.toml"
    toml.write_text("[trials.'run_*']\nrepeat_of = 'run_1'", encoding="utf-8")
    _, findings = load([tmp_path / "run_2.csv"])
    said = [f.statement for f in findings if "repeat_of" in f.statement]
    assert len(said) == 1 and "no trial 'run_1'" in said[0] and "run_3" in said[0]
    assert all(finding.severity == "warning" for finding in findings)


@settings(max_examples=20)
@given(
    sign=st.sampled_from((1, -1)),
    offset=st.floats(-50.0, 50.0),
    unit=st.sampled_from(("rad", "deg", "rev", "mrad")),
)
def test_value_is_sign_times_reading_less_offset(
    tmp_path_factory: pytest.TempPathFactory, sign: int, offset: float, unit: str
) -> None:
    folder = tmp_path_factory.mktemp("data")
    turn = {"rad": 2 * math.pi, "deg": 360.0, "rev": 1.0, "mrad": 2e3 * math.pi}[unit]
    columns = recording(1.0)
    truth = columns.pop("motor_angle_rad")
    columns["theta"] = sign * truth * turn / (2.0 * math.pi) + offset
    write(folder / "run.csv", columns)
    text = f"[columns.motor_angle_rad]\nname='theta'\nunit='{unit}'\nsign={sign}\n"
    (folder / "dataset.toml").write_text(f"{text}offset={offset!r}")
    dataset, _ = load(folder)
    assert dataset.trials[0].motor_angle == pytest.approx(truth, abs=2e-6)


@pytest.mark.shared
def test_measured_data_load_and_their_signs_are_right() -> None:
    dataset, findings = load(DAVINCI, DAVINCI_TOML)
    assert [f for f in findings if f.severity == "error"] == []
    assert len(dataset.trials) == 15
    assert dataset.trial("tool4_freq0_load2").facts.split == "test"
    assert dataset.trial("tool4_freq2_load8").facts.split == "test"
    assert dataset.trial("tool4_freq0_load8").facts.split is None
    for trial in dataset.trials:
        assert trial.rate == pytest.approx(200.0)
        slope = float(trial.joint_angle[:] @ (trial.motor_angle - 0.5))
        assert slope > 0.0
    assert 5e-4 < repeat_scatter(dataset.trials, ("motor_torque_nm",)).deviation < 5e-3


@pytest.mark.shared
def test_measured_data_with_signs_as_recorded_are_found_out() -> None:
    _, findings = load(DAVINCI)
    (found,) = [f for f in findings if f.severity == "error"]
    assert re.search("invert motor_torque_nm and joint_angle_rad", found.statement)
    assert "14 other files" in found.statement
