"""MCAP files: messages of ROS 2 and in JSON, by topics."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as RosWriter

from cc_mujoco._utils import tables
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import data_files, find_dataset_file
from cc_mujoco.datasets._reading import read
from cc_mujoco.errors import CableError

HEADER = "std_msgs/Header header\n"
LAYOUT = "\n".join(
    [
        *("=" * 80, "MSG: std_msgs/Header", "builtin_interfaces/Time stamp"),
        *("string frame_id", "=" * 80, "MSG: builtin_interfaces/Time"),
        *("int32 sec", "uint32 nanosec"),
    ]
)
JOINT_STATE = (
    f"{HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\n"
    f"float64[] effort\n{LAYOUT}"
)
WRENCH = f"{HEADER}float32 torque\nint16 counts\nbool valid\n{LAYOUT}"
START = 1_700_000_000_000_000_000

MAPPING = """
[columns.motor_angle_rad]
name = "/joint_states/position/motor"
[columns.motor_torque_nm]
name = "/joint_states/effort/motor"
[columns.joint_angle_rad]
name = "/elbow/counts"
unit = "deg"
scale = 0.25
offset = 100
sign = -1
resolution = 1
[columns.joint_torque_nm]
name = "/elbow/torque"
"""


def header(time: int) -> dict[str, object]:
    return {
        "stamp": {"sec": time // 10**9, "nanosec": time % 10**9},
        "frame_id": "rig",
    }


def write_bag(path: Path, rows: int = 200) -> Path:
    """Write a recording of two topics, 500 and 250 messages per second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        writer = RosWriter(file)
        states = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        wrench = writer.register_msgdef("rig_msgs/msg/Elbow", WRENCH)
        for k in range(rows):
            time = START + 2_000_000 * k
            turn = np.sin(0.02 * k)
            state = {
                "header": header(time),
                "name": ["motor", "spare"],
                "position": [turn, 0.0],
                "velocity": [],
                "effort": [0.1 * turn, 0.0],
            }
            writer.write_message("/joint_states", states, state, log_time=time)
            if k % 2 == 0:
                elbow = {
                    "header": header(time),
                    "torque": 0.5 * turn,
                    "counts": 100 - round(800 * turn),
                    "valid": True,
                }
                writer.write_message("/elbow", wrench, elbow, log_time=time + 500)
        writer.finish()
    return path


def test_columns_are_topics_and_fields_with_the_names_of_joints(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap")
    names = tables.column_names(path)
    assert names[0] == "__time"
    assert "/joint_states/position/motor" in names
    assert "/joint_states/velocity/motor" not in names
    assert "/elbow/header/stamp/nanosec" in names
    columns = tables.read_columns(path, ["__time", "/elbow/counts"])
    known = np.isfinite(columns["/elbow/counts"])
    assert known.sum() == 100
    assert columns["__time"][0] == pytest.approx(START * 1e-9, abs=1e-6)


def test_bag_of_ros_is_a_trial_in_si_units(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run_1" / "run_1_0.mcap")
    (bag.parent / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (tmp_path / "dataset.toml").write_text(MAPPING)
    files = data_files([tmp_path])
    assert files == [bag]
    assert find_dataset_file(files) == tmp_path / "dataset.toml"
    recording = read(bag, read_dataset_file(tmp_path / "dataset.toml"))
    assert "joint_angle_rad" in recording.remarks[0]
    joint = recording.values["joint_angle_rad"]
    turn = np.sin(0.04 * np.arange(len(joint)))
    assert joint == pytest.approx(np.radians(0.25 * np.round(800 * turn)), abs=1e-12)
    assert recording.values["joint_torque_nm"] == pytest.approx(0.5 * turn, abs=1e-6)


def test_noise_and_steps_of_counts_are_converted(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(MAPPING)
    file = read_dataset_file(tmp_path / "dataset.toml")
    assert file.factor("joint_angle_rad", "/elbow/counts") == pytest.approx(
        np.radians(0.25)
    )
    (tmp_path / "dataset.toml").write_text(MAPPING.replace("0.25", "-0.25"))
    with pytest.raises(CableError, match=r"scale must be above 0 .*not -0\.25"):
        read_dataset_file(tmp_path / "dataset.toml")


def test_messages_in_json_are_read_and_others_skipped(tmp_path: Path) -> None:
    path = tmp_path / "motion.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        json_topic = writer.register_channel("/knee", "json", schema)
        other = writer.register_channel("/camera", "protobuf", schema)
        for k in range(50):
            content = {"knee_rad": 0.1 * np.sin(0.3 * k), "note": "x", "scan": [0] * 99}
            data = json.dumps(content).encode()
            writer.add_message(json_topic, 10_000_000 * k, data, 0)
            writer.add_message(other, 10_000_000 * k, b"\x00", 0)
        writer.finish()
    assert tables.column_names(path) == ["__time", "/knee/knee_rad"]


def test_what_cannot_be_read_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(write_bag(tmp_path / "whole.mcap").read_bytes()[:900])
    with pytest.raises(CableError, match=r"broken\.mcap is not a whole mcap file: "):
        tables.column_names(broken)
    with pytest.raises(CableError, match=r"cannot read .*No such file"):
        tables.column_names(tmp_path / "none.mcap")
    empty = tmp_path / "empty.mcap"
    with empty.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/camera", "protobuf", 0)
        writer.add_message(channel, 0, b"\x00", 0)
        writer.finish()
    with pytest.raises(CableError, match="its messages are protobuf"):
        tables.column_names(empty)
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    with pytest.raises(CableError, match=r"needs mcap .*cc_mujoco\[mcap\]"):
        tables.column_names(write_bag(tmp_path / "again.mcap"))
