"""Channels with times of their own: topics in one table, several files per trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cc_mujoco.datasets import TrialFacts
from cc_mujoco.datasets._clock import SampledTrack, find_segments, sort_rows
from cc_mujoco.datasets._dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.datasets._reading import Recording, read
from cc_mujoco.datasets._trials import FloatArray
from cc_mujoco.diagnosis import load
from cc_mujoco.errors import CableError
from diagnosis.bench import recording, write

MOTOR = ("motor_angle_rad", "motor_torque_nm")
JOINT = ("joint_angle_rad", "joint_torque_nm")
Table = dict[str, FloatArray]


def smooth(channel: str, time: FloatArray) -> FloatArray:
    """Return a known motion, so that interpolated readings can be checked."""
    speed = 3.0 + len(channel) % 5
    value: FloatArray = np.sin(speed * time) + 0.1 * len(channel)
    return value


def sampled(names: tuple[str, ...], time: FloatArray) -> Table:
    return {"time_s": time} | {name: smooth(name, time) for name in names}


def laid(recorded: Recording, file: DatasetFile) -> SampledTrack:
    ordered = sort_rows(recorded)
    assert ordered is not None
    track, found = find_segments(ordered, TrialFacts(), file), recorded.findings
    assert track is not None and not [f for f in found if f.severity == "error"]
    return track


def true(track: SampledTrack, within: float) -> None:
    """All channels are at one time what they were."""
    for part in track.segments:
        for name in (*MOTOR, *JOINT):
            expected = smooth(name, track.time[part])
            assert track.values[name][part] == pytest.approx(expected, abs=within)


TOPICS = """
[columns.motor_angle_rad]
name = "/motor/position[0]"
[columns.motor_torque_nm]
name = "/motor/effort[0]"
[columns.joint_angle_rad]
name = "/joint_states/position[0]"
[columns.joint_torque_nm]
name = "/joint_states/effort[0]"
"""
TOPIC_NAMES = {
    "motor_angle_rad": "/motor/position[0]",
    "motor_torque_nm": "/motor/effort[0]",
    "joint_angle_rad": "/joint_states/position[0]",
    "joint_torque_nm": "/joint_states/effort[0]",
}


def topics(*tables: Table) -> dict[str, list[float | None]]:
    """One table of several topics: a row has the cells of one, the others are blank."""
    rows = sorted(
        (float(t), k, table) for table in tables for k, t in enumerate(table["time_s"])
    )
    columns: dict[str, list[float | None]] = {"__time": [t for t, _, _ in rows]}
    for name, called in TOPIC_NAMES.items():
        columns[called] = [
            float(table[name][k]) if name in table else None for _, k, table in rows
        ]
    return columns


def put(folder: Path, columns: dict[str, list[float | None]]) -> Path:
    top = ",".join(columns)
    rows = zip(*columns.values(), strict=True)
    cells = (",".join("" if c is None else repr(c) for c in row) for row in rows)
    path = folder / "bag.csv"
    path.write_text("\n".join([top, *cells]) + "\n")
    return path


def parsed(folder: Path, text: str) -> DatasetFile:
    (folder / "dataset.toml").write_text(text)
    return read_dataset_file(folder / "dataset.toml")


MOTOR_TIME = 1.7e9 + np.arange(0, 4000) / 1000
JOINT_TIME = 1.7e9 + 0.5003 + np.arange(0, 800) / 250


def test_blank_cells_of_other_topics_are_no_gaps(tmp_path: Path) -> None:
    path = put(tmp_path, topics(sampled(MOTOR, MOTOR_TIME), sampled(JOINT, JOINT_TIME)))
    file = parsed(tmp_path, TOPICS)
    recorded = read(path, file)
    assert "all are read at those of joint_" in recorded.remarks[0]
    track = laid(recorded, file)
    assert len(track.segments) == 1 and track.step == pytest.approx(0.004, rel=1e-4)
    assert len(track.time) == 800
    true(track, 1e-4)


def test_a_topic_may_have_a_clock_of_its_own(tmp_path: Path) -> None:
    table = topics(sampled(MOTOR, MOTOR_TIME), sampled(JOINT, JOINT_TIME))
    angle = table["/joint_states/position[0]"]
    table["/joint_states/stamp"] = [
        None if value is None else time
        for time, value in zip(table["__time"], angle, strict=True)
    ]
    # Messages arrive 20 ms late; the joint's have stamps, the motor's a known delay.
    late: list[float | None] = [t + 0.02 for t in table["__time"] if t is not None]
    path = put(tmp_path, {**table, "__time": late})
    text = TOPICS
    for channels, line in (
        (JOINT, "clock = '/joint_states/stamp'"),
        (MOTOR, "delay = 0.02"),
    ):
        for channel in channels:
            text = text.replace(f"[columns.{channel}]", f"[columns.{channel}]\n{line}")
    file = parsed(tmp_path, text)
    true(laid(read(path, file), file), 1e-4)


def test_a_topic_that_pauses_splits_the_trial(tmp_path: Path) -> None:
    motor = MOTOR_TIME[(MOTOR_TIME < 1.7e9 + 1.5) | (MOTOR_TIME > 1.7e9 + 1.8)]
    path = put(tmp_path, topics(sampled(MOTOR, motor), sampled(JOINT, JOINT_TIME)))
    file = parsed(tmp_path, TOPICS)
    track = laid(read(path, file), file)
    assert len(track.segments) == 2
    gap = track.time[track.segments[1].start] - track.time[track.segments[0].stop - 1]
    assert gap == pytest.approx(0.3, abs=0.01)
    true(track, 1e-4)


@pytest.mark.parametrize("between", [".", "/"])
def test_stamps_of_messages_are_times(tmp_path: Path, between: str) -> None:
    time = np.arange(500) / 500
    columns = sampled((*MOTOR, *JOINT), time)
    del columns["time_s"]
    stem = f"header{between}stamp"
    columns[f"{stem}{between}sec"] = np.full(500, 1_700_000_000.0)
    columns[f"{stem}{between}nanosec"] = np.round(1e9 * time)
    pq.write_table(pa.table(columns), tmp_path / "run.parquet")
    for text in ("", f"[columns.time_s]\nname = '{stem}'"):
        values = read(tmp_path / "run.parquet", parsed(tmp_path, text)).values
        assert values["time_s"] - 1.7e9 == pytest.approx(time, abs=3e-7)


def test_a_sensor_that_fails_is_no_topic(tmp_path: Path) -> None:
    columns = sampled((*MOTOR, *JOINT), np.arange(1000) / 500)
    columns["joint_angle_rad"][300:900] = np.nan
    pq.write_table(pa.table(columns), tmp_path / "run.parquet")
    recorded = read(tmp_path / "run.parquet", DatasetFile())
    assert recorded.remarks == [] and recorded.rows == 1000


FILES = """
[files."run_*"]
motor = "run_*_motor.csv"
joint = {{ file = "run_*_joint.csv", time = "t", unit = "ms"{offset} }}
"""


def logs(folder: Path, zero: float, name: str = "run_1") -> None:
    """Motor and joint logged apart, the joint's clock reading `zero` at zero."""
    write(folder / f"{name}_motor.csv", sampled(MOTOR, MOTOR_TIME - 1.7e9))
    joint = sampled(JOINT, JOINT_TIME - 1.7e9)
    joint = {"t": 1e3 * (joint.pop("time_s") + zero)} | joint
    write(folder / f"{name}_joint.csv", joint)


def test_motor_and_joint_in_files_of_their_own(tmp_path: Path) -> None:
    logs(tmp_path, 7.0)
    write(tmp_path / "walk.csv", recording(4.0))
    text = FILES.format(offset=", offset = 7000") + '[trials.run_1]\nsplit = "test"'
    parsed(tmp_path, text)
    dataset, findings = load(tmp_path)
    assert [trial.name for trial in dataset.trials] == ["run_1", "walk"]
    trial = dataset.trial("run_1")
    assert trial.facts.split == "test"
    assert trial.rate == pytest.approx(250.0) and trial.samples == 800
    for name in (*MOTOR, *JOINT):
        truth = smooth(name, trial.time)
        assert trial.channel(name) == pytest.approx(truth, abs=1e-4)
        assert f"run_1_{name[:5]}.csv, column {name}" in trial.column(name)
    assert "run_1_joint.csv, column t" in trial.column("time_s")
    assert any("only 0.5003 to" in f.statement for f in findings)


def test_what_is_said_of_trials_in_several_files_need_not_be_given(
    tmp_path: Path,
) -> None:
    logs(tmp_path, 0.0)
    logs(tmp_path, 0.0, "run_2")
    text = FILES.format(offset=", offset = 0") + "[trials.run_2]\npretension = 3"
    parsed(tmp_path, text)
    first = [tmp_path / f"run_1_{side}.csv" for side in ("motor", "joint")]
    dataset, _ = load(first)
    assert [trial.name for trial in dataset.trials] == ["run_1"]
    with pytest.raises(CableError, match=r"run_1_joint.csv, the joint of 'run_1', was"):
        load(first[:1])


@pytest.mark.parametrize(
    ("zero", "offset", "sentence"),
    [
        (-0.4, "", "all begin at about 0 s, perhaps each at the start of its own"),
        (1.7e9, "", "they share no time: give the offset between their clocks"),
    ],
)
def test_clocks_of_unknown_zeros_are_one_sentence(
    tmp_path: Path, zero: float, offset: str, sentence: str
) -> None:
    logs(tmp_path, zero)
    parsed(tmp_path, FILES.format(offset=offset))
    dataset, findings = load(tmp_path)
    (found,) = [f for f in findings if f.severity == "error"]
    assert sentence in found.statement and "\n" not in found.statement
    assert dataset.trials == ()


def test_columns_that_two_files_have_are_called_by_both_names(tmp_path: Path) -> None:
    logs(tmp_path, 0.0)
    for side in ("motor", "joint"):
        path = tmp_path / f"run_1_{side}.csv"
        path.write_text(path.read_text().replace(f"{side}_angle_rad", "angle"))
    text = FILES.format(offset=", offset = 0")
    for side in ("motor", "joint"):
        name = "angle"
        text += f"\n[columns.{side}_angle_rad]\nname = '{name}'"
    parsed(tmp_path, text)
    _, findings = load(tmp_path)
    assert any("has motor.angle and joint.angle; say" in f.statement for f in findings)
    for side in ("motor", "joint"):
        text = text.replace(
            f"{side}_angle_rad]\nname = 'angle'",
            f"{side}_angle_rad]\nname = '{side}.angle'",
        )
    parsed(tmp_path, text)
    (trial,) = load(tmp_path)[0].trials
    for name in (*MOTOR, *JOINT):
        assert trial.channel(name) == pytest.approx(smooth(name, trial.time), abs=1e-4)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[files.a]\nmotor = 'm.csv'", "must name two files or more"),
        ("[files.'a*']\nm = 'm.csv'\nj = 'j*.csv'", "m, file must be a name with one"),
        ("[files.a]\nm = {time = 't'}\nj = 'j.csv'", "needs a `file`"),
        ("[files.a]\nm = {file = 'm', unit = 'h'}\nj = 'j'", "unknown unit 'h' in"),
        ("[files.a]\nm = {file = 'm', offset = 'x'}\nj = 'j'", "offset must be a fin"),
        ("[files]\na = 'm.csv'", "a must be a table"),
    ],
)
def test_files_that_cannot_be(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(CableError, match=sentence):
        parsed(tmp_path, text)
