"""The Rerun recording, read back and checked by Rerun's own tool."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from rerun.error_utils import strict_mode

import cc_mujoco.plugin  # noqa: F401  (registers the plugin)
from cc_mujoco.metrics import METRICS, Metric, measure
from cc_mujoco.metrics._metric import Key
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import tension_colors
from cc_mujoco.viz._cable_lines import resample
from cc_mujoco.viz._rerun_file import (
    END_STATES,
    recording,
    recording_id,
    state_changes,
    write_recording,
)
from cc_mujoco.viz._rerun_plots import plotted_series
from cc_mujoco.viz._scene3d import Branch

SCENE = """
<mujoco>
  <extension>
    <plugin plugin="cc_mujoco.cable">
      <instance name="flexor">
        <config key="segments" value="8"/>
        <config key="conduit" value="1.0:0.2"/>
        <config key="axial_stiffness" value="4000"/>
        <config key="pretension" value="5"/>
        <config key="friction" value="0.1"/>
        <config key="route" value="flexor_route"/>
      </instance>
    </plugin>
  </extension>
  <asset>
    <material name="red" rgba="0.8 0.1 0.1 1"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.1"/>
    <geom name="bench" type="box" size="0.1 0.05 0.02" pos="0 0 0.3" material="red"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="0.5 0.5 0"/>
    <geom name="hidden" type="sphere" size="0.2" group="3"/>
    <site name="a" pos="0 0.1 0.3"/>
    <body name="drum" pos="0 0 0.4">
      <joint name="motor" axis="0 0 1"/>
      <geom name="rim" type="cylinder" size="0.02 0.01"/>
      <geom name="crank" type="capsule" size="0.01 0.05" pos="0.05 0 0"/>
    </body>
    <body name="hand" pos="0 0.6 0.4">
      <joint name="wrist" axis="0 0 1"/>
      <geom name="palm" type="ellipsoid" size="0.03 0.05 0.02"/>
      <geom name="ball" type="sphere" size="0.02" pos="0 0.1 0"/>
      <site name="b" pos="0.1 0.05 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="flexor_route"><site site="a"/><site site="b"/></spatial>
  </tendon>
  <actuator>
    <plugin name="flexor_proximal" joint="motor" gear="-0.02"
            plugin="cc_mujoco.cable" instance="flexor"/>
    <plugin name="flexor_distal" joint="wrist" gear="-0.05"
            plugin="cc_mujoco.cable" instance="flexor"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(SCENE)


def measured(log: EpisodeLog) -> dict[Metric, float]:
    return measure(log, [METRICS["peak_joint_torque"]])


def rerun(*arguments: object) -> subprocess.CompletedProcess[str]:
    # `python -m rerun_cli` would drop the exit code.
    program = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def column(path: Path, entity: str, component: str) -> tuple[Any, list[Any]]:
    times, rows = [], []
    for chunk in RrdReader(path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if chunk.is_static or component not in batch.schema.names:
            continue
        stamp = batch.column("sim_time").cast("int64").to_numpy()
        times.append(stamp * 1e-9)
        rows += batch.column(component).to_pylist()
    return np.concatenate(times), rows


def static(path: Path, entity: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for chunk in RrdReader(path).stream().filter(content=entity):
        if chunk.is_static:
            batch = chunk.to_record_batch()
            found |= {
                name: batch.column(name).to_pylist() for name in batch.schema.names
            }
    return found


def unpacked(colors: list[list[int]]) -> Any:
    return np.array(colors, dtype=">u4")[..., None].view(np.uint8).astype(int)


def test_verified_and_equal_for_equal_runs(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    log = make_log(cables=("flexor",))
    for name in ("one.rrd", "two.rrd"):
        write_recording(tmp_path / name, log, model, measured(log))
    other = make_log(cables=("flexor",), motor_torque_nm=log["motor_torque_nm"] + 1e-9)
    write_recording(
        tmp_path / "three.rrd",
        other,
        model,
        measured(other),
    )

    verified = rerun("verify", tmp_path / "one.rrd")
    assert verified.returncode == 0, verified.stderr
    assert "1 file verified without error" in verified.stderr + verified.stdout
    same = ("--unordered", "--ignore-chunks-without-components", tmp_path / "one.rrd")
    equal = rerun("compare", *same, tmp_path / "two.rrd")
    assert equal.returncode == 0, equal.stderr
    assert rerun("compare", *same, tmp_path / "three.rrd").returncode != 0

    reader = RrdReader(tmp_path / "one.rrd")
    assert reader.blueprints()
    assert reader.recordings()[0].recording_id == recording_id(log)
    assert recording_id(log) != recording_id(other)
    assert len(list(tmp_path.iterdir())) == 3


def test_series_keep_every_sample(make_log: Any, model: Any, tmp_path: Path) -> None:
    log, path = make_log(), tmp_path / "run.rrd"
    write_recording(path, log, model)
    times, rows = column(path, "/torque/joint", "Scalars:scalars")
    assert times == pytest.approx(log["time_s"], abs=1e-9)
    assert np.ravel(rows).tolist() == log["joint_torque_nm"].tolist()
    _, rows = column(path, "/angle/motor", "Scalars:scalars")
    assert np.ravel(rows) == pytest.approx(np.degrees(log["motor_angle_rad"]))
    _, rows = column(path, "/tension/extensor/joint_end", "Scalars:scalars")
    assert np.ravel(rows).tolist() == log["tension_extensor_distal_n"].tolist()
    legend = static(path, "/tension/extensor/joint_end")["SeriesLines:names"]
    assert legend == [["extensor, joint end"]]
    paths = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert not any("\\" in path for path in paths)


def test_nodes_are_decimated_to_frames(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    time = np.arange(300) * 0.002
    log, path = make_log(time_s=time), tmp_path / "run.rrd"
    write_recording(path, log, model)
    times, rows = column(path, "/nodes/extensor/tension", "Scalars:scalars")
    assert len(times) == 36  # 0.598 s at 60 frames a second, the first one included
    at = np.searchsorted(time, times - 1e-6)
    assert rows == log["tension_extensor_nodes_n"][at].tolist()


def test_slip_states_are_logged_when_they_change(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    slip = np.zeros((300, 8), dtype=np.int8)
    slip[50:100, 0], slip[100:, 0] = 1, -1
    tension = np.ones(300)
    tension[200:250] = 0.0
    log = make_log(
        cables=("flexor",),
        slip_flexor_direction=slip,
        tension_flexor_proximal_n=tension,
    )
    write_recording(tmp_path / "run.rrd", log, model)
    times, rows = column(
        tmp_path / "run.rrd", "/slip/flexor/motor_end", "StateChange:state"
    )
    expected = ["stuck", "slips to joint", "slips to motor", "slack", "slips to motor"]
    assert [row[0] for row in rows] == expected
    assert times == pytest.approx([0.0, 0.5, 1.0, 2.0, 2.5])


def test_a_motor_that_shakes_is_one_state_of_its_lane() -> None:
    time = np.arange(1000) * 1e-3
    state = np.zeros(1000, dtype=int)
    state[200:600] = 1 + np.arange(400) // 5 % 2  # 5 ms this way, 5 ms that way
    state[600:610], state[610:] = 3, 1
    begun, found = state_changes(time, state)
    names = list(END_STATES)
    assert [names[n] for n in found] == ["stuck", "to and fro", "slips to joint"]
    assert begun.tolist() == [0, 200, 610]
    state[200:600] = 1  # one brief state alone is no shaking
    begun, found = state_changes(time, state)
    assert begun.tolist() == [0, 200, 600, 610]


def test_the_motor_is_seen_at_the_scale_of_the_joint(make_log: Any) -> None:
    log = make_log(metadata={Key.RATIO: 0.1})
    lines = {"/".join(line.path): line for line in plotted_series(log)}
    angle = lines["angle/motor"]
    assert angle.name == "motor, at the joint"
    assert angle.values == pytest.approx(np.degrees(0.1 * log["motor_angle_rad"]))
    assert lines["angle/joint"].values == pytest.approx(
        np.degrees(log["joint_angle_rad"])
    )


def test_moving_bodies_follow_qpos_and_fixed_ones_stay(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    log, path = make_log(cables=("flexor",)), tmp_path / "run.rrd"
    write_recording(path, log, model)
    times, rows = column(path, "/world/moving/hand", "Transform3D:quaternion")
    at = np.searchsorted(log["time_s"], times - 1e-6)
    half = 0.5 * log["qpos"][at, 1]
    quaternion = np.array([row[0] for row in rows])
    assert quaternion[:, 2] == pytest.approx(np.sin(half), abs=1e-6)
    assert quaternion[:, 3] == pytest.approx(np.cos(half), abs=1e-6)

    shapes = {
        "/world/fixed/world/floor": "Mesh3D:vertex_positions",
        "/world/fixed/world/bench": "Boxes3D:half_sizes",
        "/world/fixed/world/wedge": "Mesh3D:triangle_indices",
        "/world/moving/drum/rim": "Cylinders3D:lengths",
        "/world/moving/drum/crank": "Capsules3D:lengths",
        "/world/moving/hand/palm": "Ellipsoids3D:half_sizes",
        "/world/moving/hand/ball": "Ellipsoids3D:half_sizes",
    }
    for entity, component in shapes.items():
        assert component in static(path, entity), entity
    assert not static(path, "/world/fixed/world/hidden")
    bench = static(path, "/world/fixed/world/bench")
    assert bench["Boxes3D:colors"] == [[0xCC1A1AFF]]
    assert bench["Transform3D:translation"][0][0] == pytest.approx([0.0, 0.0, 0.3])


def test_conduit_follows_its_route_and_carries_the_tension(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    log, path = make_log(cables=("flexor",)), tmp_path / "run.rrd"
    write_recording(path, log, model)
    times, strips = column(path, "/world/conduit/flexor", "LineStrips3D:strips")
    _, colors = column(path, "/world/conduit/flexor", "LineStrips3D:colors")
    at = np.searchsorted(log["time_s"], times - 1e-6)
    points = np.array(strips)  # (T, pieces, 2 ends, 3)
    assert points.shape[1:] == (60, 2, 3)
    assert points[:, 0, 0] == pytest.approx(np.tile([0, 0.1, 0.3], (len(at), 1)))
    angle = log["qpos"][at, 1]
    tip = 0.1 * np.cos(angle) - 0.05 * np.sin(angle)
    assert points[:, -1, 1, 0] == pytest.approx(tip, abs=1e-6)
    nodes = log["tension_flexor_nodes_n"][at]
    # 8 segments of equal length; a piece has the tension of its middle.
    middle = 8 * (np.arange(60) + 0.5) / 60
    middle = np.array([np.interp(middle, np.arange(9), row) for row in nodes])
    expected = tension_colors(middle, float(nodes.max())).astype(np.uint32)
    packed = expected @ np.array([1 << 24, 1 << 16, 1 << 8, 1], dtype=np.uint32)
    assert (
        np.abs(unpacked(colors) - unpacked(packed.tolist())).max() <= 8
    )  # a level of the map


def test_a_conduit_that_stays_is_stored_once(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    log = make_log(cables=("flexor",), qpos=np.zeros((300, 2)))
    write_recording(tmp_path / "run.rrd", log, model)
    times, strips = column(
        tmp_path / "run.rrd", "/world/conduit/flexor", "LineStrips3D:strips"
    )
    assert times == log["time_s"][:1]
    assert np.array(strips).shape == (1, 60, 2, 3)


def test_about_shows_metadata_and_results(
    make_log: Any, model: Any, tmp_path: Path
) -> None:
    about = {"scene": "wrist", "versions": {"mujoco": "4"}, "model_xml": "<mujoco/>"}
    log = make_log(metadata=about)
    write_recording(tmp_path / "run.rrd", log, model, measured(log))
    text = static(tmp_path / "run.rrd", "/about")["TextDocument:text"][0][0]
    assert "| scene | wrist |" in text
    assert "| versions | mujoco 4 |" in text
    assert "peak_joint_torque" in text
    assert "<mujoco/>" not in text


def test_misuse_raises_and_leaves_nothing(
    make_log: Any, model: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = strict_mode()

    def broken(*_: Any, **__: Any) -> None:
        assert strict_mode()
        raise KeyboardInterrupt

    monkeypatch.setattr(rr.Scalars, "columns", broken)
    (tmp_path / "run.rrd").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_recording(tmp_path / "run.rrd", make_log(), model)
    assert strict_mode() == before
    assert (tmp_path / "run.rrd").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_resample_walks_along_the_line() -> None:
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 3.0, 0.0]])
    expected = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0], [1, 3, 0]]
    assert resample(line, np.linspace(0.0, 1.0, 5)).tolist() == expected


def test_colors_grow_brighter_with_tension_and_grey_is_slack() -> None:
    colors = tension_colors(np.array([0.0, 1.0, 5.0, 10.0]), 10.0).astype(int)
    assert colors[0].tolist() == [150, 150, 150, 255]
    brightness = colors[1:, :3] @ [299, 587, 114]
    assert (np.diff(brightness) > 0).all()


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="memory is not counted here"
)
def test_a_recording_is_written_while_it_is_made(tmp_path: Path) -> None:
    def memory() -> float:
        status = Path("/proc/self/status").read_text()
        return float(status.split("RssAnon:")[1].split()[0]) / 1024  # MiB

    numbers = np.random.default_rng(0).normal(size=20_000)
    index = [rr.TimeColumn("sim_time", duration=0.001 * np.arange(20_000))]
    with recording(tmp_path / "run.rrd", "a", rrb.Blueprint()) as rec:

        def send(count: int) -> None:
            for _ in range(count):
                columns = [*rr.Scalars.columns(scalars=numbers)]
                Branch(rec).send_columns("line", index, columns)

        send(10)
        before = memory()
        send(150)
        grown = memory() - before
    assert (tmp_path / "run.rrd").stat().st_size > 30e6
    assert grown < 10.0
