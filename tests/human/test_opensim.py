"""Motions and moments in the layouts of OpenSim, Moco and AddBiomechanics."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco._utils import tables
from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco.cli._play import Play
from cc_mujoco.device import Plant, find_device
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import Recorded, TimeTorque, task, trajectory
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation import simulate
from cc_mujoco.simulation._worn_device import WornDevice

NOTE = (
    "Units are S.I. units (second, meters, Newtons, ...)\n"
    "If the header above contains a line with 'inDegrees', this indicates whether "
    "rotational values are in degrees (yes) or radians (no).\n"
)
ROWS = 40
TIME = 0.6 + 0.01 * np.arange(ROWS)
TURN = 2.0 * np.pi * np.arange(ROWS) / ROWS
HIP, KNEE, ANKLE = 0.4 * np.sin(TURN), -0.6 + 0.5 * np.cos(TURN), 0.2 * np.sin(TURN)
"""Angles [rad] in the convention of gait2392: the knee is negative in flexion."""
RANGES = {"ankle": (-0.9, 0.6), "hip": (-0.7, 2.0), "knee": (-2.1, 0.15)}


def write(
    path: Path, header: str, columns: Mapping[str, Array], separator: str = "\t"
) -> Path:
    lines = [separator.join(["time", *columns])]
    rows = np.column_stack([TIME, *columns.values()])
    lines += [separator.join(f"{value:.8f}" for value in row) for row in rows]
    path.write_text(header + "\n".join(lines) + "\n")
    return path


def inverse_kinematics(folder: Path, rows: int = ROWS) -> Path:
    """Write the result of OpenSim's inverse kinematics, in degrees, of two legs."""
    head = f"Coordinates\nversion=1\nnRows={rows}\nnColumns=7\ninDegrees=yes\n\n"
    angles = {"hip_flexion_r": HIP, "knee_angle_r": KNEE, "ankle_angle_r": ANKLE}
    angles |= {"knee_angle_l": 0.9 * KNEE, "ankle_angle_l": 0.5 * ANKLE}
    degrees = {"pelvis_tx": TIME} | {n: np.degrees(a) for n, a in angles.items()}
    return write(folder / "ik.mot", f"{head}{NOTE}\nendheader\n", degrees)


def add_biomechanics(folder: Path, sides: str = "r") -> Path:
    """Write the motion of AddBiomechanics, in radians, of the model Rajagopal2015."""
    leg = {"hip_flexion": HIP, "knee_angle": -KNEE, "ankle_angle": ANKLE}
    angles = {f"{name}_{side}": leg[name] for side in sides for name in leg}
    head = f"Coordinates\nversion=1\nnRows={ROWS}\nnColumns={len(angles) + 1}\n"
    head += f"inDegrees=no\n\n{NOTE}\nendheader\n"
    return write(folder / "trial_ik.mot", head, angles)


def moco(folder: Path, ending: str = "sto") -> Path:
    """Write a solution of Moco: states and controls by their paths."""
    head = (
        f"inDegrees=no\nnColumns=5\nnRows={ROWS}\nnum_controls=1\nnum_states=3\n"
        "success=true\nDataType=double\nversion=3\nOpenSimVersion=4.4\nendheader\n"
    )
    knee, ankle = "/jointset/walker_knee_r/knee_angle_r", "/jointset/ankle_r/"
    columns = {f"{knee}/value": -KNEE, f"{ankle}ankle_angle_r/value": ANKLE}
    columns |= {f"{knee}/speed": HIP, "/forceset/soleus_r": TIME}
    separator = "," if ending == "csv" else "\t"
    return write(folder / f"solution.{ending}", head, columns, separator)


def moments(folder: Path) -> Path:
    """Write the result of OpenSim's inverse dynamics."""
    head = (
        f"Inverse Dynamics Generalized Forces\nversion=1\nnRows={ROWS}\nnColumns=4\n"
        "inDegrees=no\nendheader\n"
    )
    columns = {"pelvis_tx_force": TIME, "ankle_angle_r_moment": -20.0 * (1.0 + HIP)}
    columns["ankle_angle_l_moment"] = 5.0 * HIP
    return write(folder / "id.sto", head, columns)


def recorded(text: str | Path, joints: Sequence[str] = tuple(RANGES)) -> Recorded:
    motion = trajectory(text, joints={joint: RANGES[joint] for joint in joints})
    assert isinstance(motion, Recorded) and motion.times[0] == 0.0
    return motion


def played(text: str | Path, joints: Sequence[str] = tuple(RANGES)) -> dict[str, Array]:
    motion = recorded(text, joints)
    found = {motion.joint: motion.angles, **dict(motion.others)}
    return {joint: np.array(angles) for joint, angles in found.items()}


@pytest.mark.parametrize("writer", [inverse_kinematics, add_biomechanics])
def test_three_joints_move_equally_whatever_unit_and_model(
    tmp_path: Path, writer: Callable[[Path], Path]
) -> None:
    path = writer(tmp_path)
    found = played(path)
    for joint, expected in (("hip", HIP), ("knee", KNEE), ("ankle", ANKLE)):
        np.testing.assert_allclose(found[joint], expected, atol=1e-7)


@pytest.mark.parametrize("ending", ["sto", "csv", "tsv"])
def test_states_of_moco_are_read_from_every_form_of_its_table(
    tmp_path: Path, ending: str
) -> None:
    found = played(moco(tmp_path, ending), ("ankle", "knee"))
    np.testing.assert_allclose(found["knee"], KNEE, atol=1e-7)
    np.testing.assert_allclose(found["ankle"], ANKLE, atol=1e-7)


def test_what_a_file_moves_is_reported_with_column_unit_and_sign(
    tmp_path: Path,
) -> None:
    turned = recorded(add_biomechanics(tmp_path)).describe()
    assert "ankle by 'ankle_angle_r_rad', -0.2 to 0.2 rad, dorsiflexion posi" in turned
    assert "knee by '-knee_angle_r_rad', -1.1 to -0.1 rad, extension positive" in turned
    plain = recorded(inverse_kinematics(tmp_path)).describe()
    assert "knee by 'knee_angle_r_deg', -1.1 to -0.1 rad, extension positive" in plain
    assert plain.endswith("with the signs of the file")


def test_a_knee_that_flexes_forwards_is_turned_once(tmp_path: Path) -> None:
    ranges = {"knee": (-0.1, 2.0)}
    motion = trajectory(inverse_kinematics(tmp_path), joints=ranges)
    assert trajectory(motion, joints=ranges) == motion
    assert isinstance(motion, Recorded)
    np.testing.assert_allclose(motion.angles, -KNEE, atol=1e-7)
    assert "'-knee_angle_r_deg', 0.1 to 1.1 rad, flexion positive" in motion.describe()


def test_columns_and_side_are_chosen_by_text(tmp_path: Path) -> None:
    path = inverse_kinematics(tmp_path)
    left = played(f"{path}:side=left", ("ankle", "knee"))
    np.testing.assert_allclose(left["ankle"], 0.5 * ANKLE, atol=1e-7)
    np.testing.assert_allclose(left["knee"], 0.9 * KNEE, atol=1e-7)
    mixed = played(f"{path}:ankle=-ankle_angle_l;knee=hip_flexion_r", ("ankle", "knee"))
    np.testing.assert_allclose(mixed["ankle"], -0.5 * ANKLE, atol=1e-7)
    np.testing.assert_allclose(np.abs(mixed["knee"]), np.abs(HIP), atol=1e-7)
    state = "/jointset/ankle_r/ankle_angle_r/value"
    for name in (state, "ankle_angle_r/value", "ankle_angle_r", "ankle_angle_r_rad"):
        chosen = played(f"{moco(tmp_path)}:ankle=+{name}", ("ankle",))
        np.testing.assert_allclose(chosen["ankle"], ANKLE, atol=1e-7)


@pytest.mark.parametrize("writer", [inverse_kinematics, moco])
def test_a_file_of_one_leg_moves_that_leg_and_the_other_rests(
    tmp_path: Path, writer: Callable[[Path], Path]
) -> None:
    path = writer(tmp_path)
    kept = path.read_text().replace("_l\t", "_x\t").replace("_l\n", "_x\n")
    path.write_text(kept)
    log = simulate("bilateral", "none", trajectory=str(path), duration=0.1)
    right, left = (log[f"{s}_ankle.reference_angle_rad"] for s in ("right", "left"))
    assert right[-1] == pytest.approx(ANKLE[10], rel=0.05) and not left.any()
    knee = log["right_knee.reference_angle_rad"]
    assert knee[-1] == pytest.approx(KNEE[10], rel=0.05)
    device = find_device("bilateral")
    how: dict[str, Any] = {"trajectory": path, "task": None, "duration": 0.1}
    worn = WornDevice(device.description, Plant(device).model(), **how)
    assert "right_ankle by 'ankle_angle_r" in worn.author.note
    assert "left_ankle rests" in worn.author.note
    assert "right_ankle rests" not in worn.author.note
    columns = {"elbow_flex_r": KNEE}
    alone = write(tmp_path / "k.mot", "inDegrees=no\nendheader\n", columns)
    with pytest.raises(CableError, match="no column of the angle of joint 'left_hip'"):
        simulate("bilateral", "none", trajectory=str(alone), duration=0.1)


def test_a_moment_whose_motion_is_turned_is_warned_of(tmp_path: Path) -> None:
    motion = add_biomechanics(tmp_path, "rl")
    columns = {"knee_angle_r_moment": HIP, "ankle_angle_r_moment": HIP}
    moment = write(tmp_path / "id.sto", "inDegrees=no\nendheader\n", columns)
    how: dict[str, Any] = {"trajectory": str(motion), "duration": 0.02}
    with pytest.warns(CableWarning, match=r"'right_knee' is turned .* '-?knee_angle_r"):
        simulate("bilateral", "none", task=f"right_knee={moment}", **how)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate("bilateral", "none", task=f"right_ankle={moment}", **how)
        chosen = f"right_knee={moment}:right_knee=-knee_angle_r_moment"
        simulate("bilateral", "none", task=chosen, **how)


def test_a_column_without_a_unit_gets_one_by_its_choice(tmp_path: Path) -> None:
    path = write(
        tmp_path / "no.sto", "version=3\nendheader\n", {"ankle_angle_r": ANKLE}
    )
    with pytest.raises(
        CableError, match=r"has no unit; .*--column JOINT=ankle_angle_r"
    ):
        played(path, ("ankle",))
    found = played(f"{path}:ankle=ankle_angle_r_deg", ("ankle",))
    np.testing.assert_allclose(found["ankle"], np.radians(ANKLE), atol=1e-9)


def test_moments_are_torques_of_a_task_from_the_start_of_the_file(
    tmp_path: Path,
) -> None:
    path = moments(tmp_path)
    given = task(path, ("ankle",))
    assert isinstance(given, TimeTorque) and given.times[0] == 0.0
    expected = -20.0 * (1.0 + HIP)
    assert given.torque(0.0, 0.0, 0.1) == pytest.approx(expected[10], abs=1e-6)
    assert "the torque is 'ankle_angle_r_moment_nm' of" in given.describe()
    other = task(f"{path}:ankle=-ankle_angle_l_moment", ("ankle",))
    assert other.torque(0.0, 0.0, 0.1) == pytest.approx(-5.0 * HIP[10], abs=1e-6)
    left = task(f"{path}:side=left", ("ankle",))
    assert left.torque(0.0, 0.0, 0.1) == pytest.approx(5.0 * HIP[10], abs=1e-6)


def test_a_header_that_miscounts_rows_is_warned_of_and_all_rows_are_read(
    tmp_path: Path,
) -> None:
    path = inverse_kinematics(tmp_path, rows=300)
    with pytest.warns(CableWarning, match=r"nRows=300, but there are 40; all of these"):
        assert len(played(path)["ankle"]) == ROWS
    right = inverse_kinematics(tmp_path)
    right.write_text(right.read_text().replace("nColumns=7", "nColumns=9"))
    with pytest.warns(CableWarning, match=r"nColumns=9, but there are 7"):
        played(right)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        played(add_biomechanics(tmp_path))


@pytest.mark.parametrize(
    ("end", "message"),
    [
        (":ankel=ankle_angle_r", "unknown joint 'ankel': did you mean 'ankle'"),
        (":ankle=ankle_angle_x", "no columns named 'ankle_angle_x', only time_s"),
        (":side=up", "unknown side 'up'"),
        (":ankle", "'ankle' must be JOINT=COLUMN or side=left"),
        (":ankle=-", "'ankle=-' must be JOINT=COLUMN"),
        (
            ":ankle=ankle_angle_r_rad",
            "'ankle_angle_r_deg' is in deg, not in the rad of",
        ),
        (":ankle=pelvis_tx", "column 'pelvis_tx' has no unit; name it pelvis_tx_rad"),
    ],
)
def test_a_choice_that_cannot_be_met_is_one_sentence(
    tmp_path: Path, end: str, message: str
) -> None:
    with pytest.raises(CableError, match=message) as caught:
        played(f"{inverse_kinematics(tmp_path)}{end}", ("ankle", "knee"))
    assert "\n" not in str(caught.value)


def test_a_side_that_no_joint_needs_is_warned_of(tmp_path: Path) -> None:
    motion = add_biomechanics(tmp_path, "rl")
    how: dict[str, Any] = {"trajectory": f"{motion}:side=left", "duration": 0.02}
    with pytest.warns(CableWarning, match="side=left has no effect, as no joint lacks"):
        simulate("bilateral", "none", **how)


def test_a_moment_of_no_driven_joint_is_refused(tmp_path: Path) -> None:
    how: dict[str, Any] = {"trajectory": "sine", "duration": 0.02}
    chosen = f"{moments(tmp_path)}:{{}}=-ankle_angle_r_moment"
    simulate("ankle", "none", task=chosen.format("ankle"), **how)
    with pytest.raises(CableError, match="unknown joint 'ankel': did you mean 'ankle'"):
        simulate("ankle", "none", task=chosen.format("ankel"), **how)


def test_markers_need_inverse_kinematics_first(tmp_path: Path) -> None:
    for name in ("walk.c3d", "walk.TRC"):
        path = tmp_path / name
        path.write_bytes(b"\x02P" * 256)
        with pytest.raises(CableError, match="run inverse kinematics first"):
            trajectory(str(path), joints=RANGES)


def test_play_gives_each_table_the_columns_that_it_has(tmp_path: Path) -> None:
    motion, torque = str(inverse_kinematics(tmp_path)), str(moments(tmp_path))
    chosen = ("ankle=-ankle_angle_l", "ankle=ankle_angle_l_moment")
    play = Play("ankle", trajectory=motion, task=torque, column=chosen, side="left")
    names = play._names()
    assert names["trajectory"] == f"{motion}:side=left;{chosen[0]}"
    assert names["task"] == f"{torque}:side=left;{chosen[1]}"
    plain = Play("ankle", trajectory=motion, task=torque, column=chosen[:1])._names()
    assert plain["task"] == torque
    again = Play("ankle", trajectory=f"{motion}:side=left", column=chosen[:1])
    assert again._names()["trajectory"] == names["trajectory"]
    of_axis = Play("bilateral", task=f"right_ankle={torque}", column=chosen[1:])
    assert of_axis._names()["task"].endswith(f"right_ankle={torque}:{chosen[1]}")
    with pytest.raises(CableError, match=r"JOINT=COLUMN with a column of .*, such as"):
        Play("ankle", trajectory=motion, column=("ankle=elbow",))._names()
    with pytest.raises(CableError, match="of a table, and none is given"):
        Play("ankle", side="left")._names()


def test_a_chosen_column_keeps_the_provenance_of_its_file(tmp_path: Path) -> None:
    path = inverse_kinematics(tmp_path)
    text = f"{path}:side=left"
    assert tables.is_table(text) and not tables.is_table("sine:0.2")
    files = code_provenance(text, str(path))["files"]
    assert files[text] == files[str(path)] != ""
