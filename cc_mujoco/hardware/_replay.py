"""Conversion of a run's log to an episode: a recording for Rerun and a figure.

    replay("runs/first/log.csv", "bench")

A rig has no sensors inside its cables. Their states are simulated from the measured
motor angle and joint torque with the model of the scene, as in controllers. Angles,
torques and times are those that were measured.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import is_marked, replacing_folder, require_own_file
from cc_mujoco.cable._reading import CableReading
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.datasets._run_log import beside, other_scene
from cc_mujoco.device import Drive, find_device
from cc_mujoco.device._model import DeviceModel, cable_columns
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._drive_model import Windings
from cc_mujoco.hardware._run_log import RUN_COLUMNS, files_of
from cc_mujoco.metrics._metric import Key
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation import _log_columns as log_columns
from cc_mujoco.simulation._episode_log import EpisodeLog

REQUIRED_COLUMNS = RUN_COLUMNS[1:8]
"""Columns that a log must have of every axis, besides time."""
RECORDING_FILE, SUMMARY_FIGURE = "recording.rrd", "summary.png"


def replay(log: str | os.PathLike[str], scene: str) -> tuple[Path, Path]:
    """Write recording and figure of a run's log next to it; return their paths."""
    path = Path(log)
    if is_marked(path):
        made = path.with_name(RECORDING_FILE)
        if not made.is_file():
            raise CableError(
                f"{path} is no log of a run; `cc-mujoco run` leaves those."
            )
        raise CableError(
            f"{path} is the log of an episode; open its recording: rerun {made}"
        )
    if ran := other_scene(path, scene):
        raise CableError(
            f"{path} was recorded with scene {ran!r}, not {scene!r}; name that one, or "
            "a file of it."
        )
    model, episode = as_episode(read_rows(path), scene, path)
    written = beside(path, RECORDING_FILE), beside(path, SUMMARY_FIGURE)
    about = files_of(path.stem)[1]
    for each in written:
        require_own_file(each, lambda one: one.with_name(about).is_file())

    from cc_mujoco.viz._rerun_file import write_recording
    from cc_mujoco.viz._summary import write_summary

    with replacing_folder(path.parent) as partial:
        write_summary(partial / written[1].name, episode)
        write_recording(partial / written[0].name, episode, model)
    return written


def read_rows(path: Path) -> dict[str, Array]:
    """Return the required columns of a log (T,), less an incomplete last line."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    try:
        if path.suffix.lower() == ".parquet":
            table = pyarrow.parquet.read_table(path)
        else:
            content = path.read_bytes()
            # A process that is killed while it writes may leave a part of a line.
            whole = content[: content.rfind(b"\n") + 1]
            table = pyarrow.csv.read_csv(pa.BufferReader(whole))
        names = table.column_names
    except (OSError, UnicodeDecodeError, pa.ArrowInvalid) as error:
        reason = " ".join(str(error).split())
        raise CableError(f"cannot read {path} as the log of a run: {reason}") from None
    prefixes = _prefixes(names)
    required = ["time_s", *(p + name for p in prefixes for name in REQUIRED_COLUMNS)]
    missing = [name for name in required if name not in names]
    if missing:
        raise CableError(
            f"{path} has no column {', '.join(missing)}; it must be a log that "
            "`cc-mujoco run` wrote."
        )
    if len(table) < 2:
        raise CableError(f"{path} has {len(table)} rows; a log needs two or more.")
    found: dict[str, Array] = {}
    for name in required:
        try:
            values = table.column(name).cast(pa.float64()).to_numpy()
        except pa.ArrowInvalid as error:
            raise CableError(f"{path}, column {name}: {error}") from None
        may_lack = name.endswith("desired_torque_nm")  # none while a run is stopped
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size and not may_lack:
            row = int(wrong[0])
            raise CableError(
                f"{path}, line {row + 2}, column {name}: {values[row]} must be a "
                "finite number."
            )
        found[name] = np.asarray(values, dtype=np.float64)
    wrong = np.flatnonzero(np.diff(found["time_s"]) <= 0.0)
    if wrong.size:
        raise CableError(f"{path}, line {wrong[0] + 3}, column time_s: time must rise.")
    return found


def as_episode(
    rows: dict[str, Array], scene: str, path: Path
) -> tuple[mujoco.MjModel, EpisodeLog]:
    """Return the scene's model, and the log of a run as an episode log.

    The ratio of the scene's device must match the measured angles, and the run must
    have measured the joints that move its cables.
    """
    device, prefixes = find_device(scene), _prefixes(rows)
    description = device.description
    model = device.spec.copy().compile()
    made = DeviceModel(description, model)
    named = [description.axis(prefix.rstrip(".") or None) for prefix in prefixes]
    driven = [made.axes[description.axes.index(axis)] for axis in named]
    time = rows["time_s"]
    count, period = time.size, float(np.median(np.diff(time)))
    windings = Windings(driven)
    each = [{n: rows[p + n] for n in REQUIRED_COLUMNS} for p in prefixes]
    found = {axis.name: part for axis, part in zip(named, each, strict=True)}
    for missing in windings.unmeasured:
        if missing:
            raise CableError(
                f"{path} cannot be shown in scene {scene}: joint {', '.join(missing)} "
                "winds the cable too, and the run did not measure it."
            )
    _add_wound(each, windings)
    nothing = np.full(count, np.nan)
    columns: dict[str, NDArray[Any]] = {"time_s": time}
    for axis, start in zip(description.axes, made.prefixes, strict=True):
        own_rows = found.get(axis.name, {})
        for column in log_columns.AXIS_COLUMNS:
            columns[start + column.name] = own_rows.get(column.name, nothing)
    qpos = np.tile(model.qpos0, (count, 1))
    columns[log_columns.POSE_COLUMN.name] = qpos
    for name, cable in device.cables.items():
        nodes = np.full((count, cable.segments + 1), np.nan)  # unless it was driven
        slip = np.zeros((count, cable.segments), np.int8)
        columns |= cable_columns(name, _reading(nodes, slip, nothing, nothing))
    facts: dict[str, dict[str, float]] = {}
    for own in driven:
        own_rows = found[own.axis.name]
        qpos[:, own.places.motor_q] += own.sense * own_rows["motor_angle_rad"]
        qpos[:, own.places.joint_q] = own_rows["joint_angle_rad"]
        drive = own.drive(device.cables, device.name, period)
        _require_ratio(own_rows, drive, scene, path)
        torque = own_rows["joint_torque_nm"] / own_rows["leverage_ratio"]
        columns |= _observed(drive, own.driven, own_rows["motor_angle_rad"], torque)
        facts[own.axis.name] = {Key.RATIO: 1.0 / drive.ratio}
    alone = next(iter(facts.values()))
    about = {
        "scene": scene,
        "run": str(path),
        "tensions": "by the scene's model, from motor angle and joint torque",
        **({log_columns.AXES: facts} if len(description.axes) > 1 else alone),
        "cables": {name: cable.to_config() for name, cable in device.cables.items()},
        log_columns.MODEL_XML: device.xml(),
    }
    return model, EpisodeLog(columns, about)


def _prefixes(names: Iterable[str]) -> tuple[str, ...]:
    """Return the prefix of the columns of each axis in a log."""
    known = log_columns.prefixes_in(names)
    found = [name for name in known if not name or name.endswith(".")]
    return tuple(found) or ("",)


def _require_ratio(
    rows: dict[str, Array], drive: Drive, scene: str, path: Path
) -> None:
    """Refuse a scene with another ratio of motor to joint angle than was measured."""
    twist = rows["motor_angle_rad"] / drive.ratio - rows["winding_angle_rad"]
    if drive.one_way:  # where its cable may be slack, the motor turns as it likes
        torque = rows["joint_torque_nm"] / rows["leverage_ratio"] * np.sign(drive.ratio)
        at_rest = max(each.cable.pretension * abs(each.distal) for each in drive.cables)
        twist = twist[torque > max(at_rest, 0.1 * float(np.max(torque)))]
    # More than slack, stretch and offsets of the encoders [rad].
    if twist.size and np.ptp(twist) > 0.5:
        raise CableError(
            f"{path} does not fit scene {scene}: the motor over {drive.ratio:.3g} and "
            f"the joint drift {np.ptp(twist):.2g} rad apart; give the rig's own scene."
        )


def _add_wound(axes: Sequence[dict[str, Array]], windings: Windings) -> None:
    angles = np.column_stack([rows["joint_angle_rad"] for rows in axes])
    velocities = np.column_stack([rows["joint_velocity_rad_s"] for rows in axes])
    wound = list(map(windings.read, angles.tolist(), velocities.tolist()))
    for place, rows in enumerate(axes):
        round_pulley = angles[:, place], velocities[:, place], np.ones(len(angles))
        for name, usual in zip(WINDING_COLUMNS, round_pulley, strict=True):
            own = [each[place].get(name) for each in wound]
            rows[name] = usual if own[0] is None else np.array(own, dtype=np.float64)


def _observed(
    drive: Drive, names: Sequence[str], motor: Array, torque: Array
) -> dict[str, NDArray[Any]]:
    """Return cable columns estimated from motor angle [rad] and joint torque [N m]."""
    observer = CableModel(drive)
    states = []
    for angle, load in zip(motor.tolist(), torque.tolist(), strict=True):
        observer.follow([angle], [load])
        for k in range(len(names)):
            kept = observer.state[0, k, 2:4]
            states.append((observer.tension(k)[0], observer.slip(k)[0], *kept))
    columns: dict[str, NDArray[Any]] = {}
    for k, cable in enumerate(names):
        series = zip(*states[k :: len(names)], strict=True)
        nodes, slip, dissipated, slack = map(np.array, series)
        columns |= cable_columns(cable, _reading(nodes, slip, slack, dissipated))
    return columns


def _reading(
    nodes: Array, slip: NDArray[np.int8], slack: Array, dissipated: Array
) -> CableReading:
    ends, moving = (nodes[:, 0], nodes[:, -1]), np.mean(slip != 0, axis=1)
    return CableReading(nodes, slip, *ends, moving, slack, dissipated)
