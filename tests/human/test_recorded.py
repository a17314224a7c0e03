"""Trajectories from tables."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cc_mujoco._utils.units import ANGLE, CLOCK
from cc_mujoco.errors import CableError
from cc_mujoco.human import TRAJECTORIES, read_trajectory, trajectory
from shared_folder import SHARED

EXAMPLE = Path(__file__).parents[2] / "assets" / "trajectories" / "example_reach.csv"
RNG = np.random.default_rng(0)


def write(folder: Path, text: str) -> Path:
    path = folder / "motion.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_example_is_the_reach_it_was_made_from() -> None:
    motion = read_trajectory(EXAMPLE).sample(8.0, 0.002, RNG)
    reach = TRAJECTORIES["reach"].sample(8.0, 0.002, np.random.default_rng(7))
    assert np.abs(motion.angle - reach.angle).max() < 2e-4
    assert np.abs(motion.velocity - reach.velocity).max() < 2e-2


def test_spline_derivatives_rest_and_hold(tmp_path: Path) -> None:
    rows = [f"{t + 3.0},x,{0.3 + 0.2 * t - 0.1 * t**2}" for t in np.arange(0, 3, 0.25)]
    path = write(tmp_path, "\n".join(["time_s,note, angle_rad", *rows, ""]))
    motion = read_trajectory(path).sample(6.0, 1e-3, RNG)
    assert motion.angle[0] == 0.3 and motion.velocity[0] == 0
    held = motion.time > 2.75
    assert np.ptp(motion.angle[held]) == 0
    assert motion.angle[-1] == pytest.approx(0.3 + 0.2 * 2.75 - 0.1 * 2.75**2)
    assert not motion.velocity[held].any() and not motion.acceleration[held].any()
    slope = np.gradient(motion.angle, 1e-3)
    assert np.abs(slope - motion.velocity).max() < 5e-3
    inside = motion.time < 2.74
    bend = np.gradient(motion.velocity, 1e-3)
    assert np.abs((bend - motion.acceleration)[inside][1:-1]).max() < 2e-2
    assert motion.phase[0] == 0 and 0.999 < motion.phase[-1] < 1


def test_bits_are_read_back_at_the_samples(tmp_path: Path) -> None:
    angles = [0.0, 0.1, -0.2, 0.05, 0.3]
    rows = [f"{i * 0.5},{a}" for i, a in enumerate(angles)]
    path = write(
        tmp_path, "\ufefftime_s,angle_rad\r\n" + "\r\n".join(rows) + "\r\n\r\n"
    )
    motion = read_trajectory(path).sample(2.0, 0.5, RNG)
    np.testing.assert_allclose(motion.angle, angles, atol=1e-15)


GOOD = "0,0\n1,0.1\n2,0.2\n3,0.1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "{} is empty; its first line must name the columns."),
        (
            "time,angle_rad\n" + GOOD,
            "{}: there is no column 'time_s'; if it is 'time', name it by its "
            "unit: time_s or time_ms or time_us or time_ns.",
        ),
        (
            "time_s,angle\n" + GOOD,
            "{}: the angle 'angle' has no unit; name the column angle_deg if it is in "
            "degrees or angle_rad if it is in radians.",
        ),
        (
            "time_s,knee_angle\n" + GOOD,
            "{}: the angle 'knee_angle' has no unit; name the column knee_angle_deg if "
            "it is in degrees or knee_angle_rad if it is in radians.",
        ),
        (
            "time_s,speed\n" + GOOD,
            "{}: there is no column 'angle_rad'; name it: angle_rad or angle_mrad or "
            "angle_deg or angle_rev.",
        ),
        (
            "time_ms,time_us,angle_rad\n0,0,0\n",
            "{}: time_ms and time_us are both time_s; keep one of them.",
        ),
        (
            "time_s,angle_deg\n0,1e6\n",
            "{}, column angle_deg, row 1 of the data is 1e+06; it must be a number "
            "between -57295.8 and 57295.8.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n1,0\n2,0\n",
            "{}, column time_s, row 3 of the data: 1 must be at least 1e-06 above the "
            "1 of the row before.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,nan\n2,0\n3,0\n",
            "{}, column angle_rad, row 2 of the data is missing; it must be a number "
            "between -1000 and 1000.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n4o,0\n",
            "{}, column time_s, row 3 of the data: '4o' must be a number.",
        ),
        (
            "time_s,angle_rad\n0,0\n1\n",
            "{} is not a table: CSV parse error: Row #3: Expected 2 columns, got 1: 1; "
            "every line must have the 2 cells that the first line names.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n",
            "{} has 2 rows of data, but a trajectory needs at least 4.",
        ),
        (
            "time_s,angle_deg,Angle [deg]\n0,0,0\n1,0,0\n2,0,0\n3,0,0\n",
            "{}: angle_deg and Angle [deg] are the angle of one joint; keep one of "
            "them.",
        ),
    ],
)
def test_errors_are_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(CableError) as caught:
        read_trajectory(path)
    assert str(caught.value) == message.format(path)


def test_unreadable_files(tmp_path: Path) -> None:
    missing = tmp_path / "no.csv"
    with pytest.raises(CableError, match=r"cannot read .*no\.csv: No such"):
        read_trajectory(missing)
    with pytest.raises(CableError, match="cannot read"):
        read_trajectory(tmp_path)
    binary = tmp_path / "motion.csv"
    for content in (b"\xff\xfe\x00\x81", b"\x89PNG\r\n\x1a\n\x00\x00", b"PK\x03\x04"):
        binary.write_bytes(content)
        with pytest.raises(CableError, match=r"is no text|there is no column"):
            read_trajectory(binary)


ROWS = [(0.0, 0.0), (0.25, 0.125), (0.5, -0.25), (0.75, 0.5)]


@pytest.mark.parametrize("unit", ["rad", "mrad", "deg", "rev"])
def test_units_are_converted_by_the_name_of_the_column(
    tmp_path: Path, unit: str
) -> None:
    styles = "{}_{}", "{} [{}]", "{} ({})"
    for clock, style in itertools.product(("s", "ms", "us", "ns"), styles):
        names = style.format("time", clock), style.format("Angle", unit)
        factors = CLOCK.factors[clock], ANGLE.factors[unit]
        lines = [f"{t / factors[0]!r},{a / factors[1]!r}" for t, a in ROWS]
        found = read_trajectory(write(tmp_path, "\n".join([",".join(names), *lines])))
        assert found.times == pytest.approx([t for t, _ in ROWS])
        assert found.angles == pytest.approx([a for _, a in ROWS])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_forms_that_spreadsheets_write_read_the_same(
    tmp_path: Path, encoding: str
) -> None:
    first = "", "sep={}", "# recorded at 20 \N{DEGREE SIGN}C"
    for separator, decimal, end, above in itertools.product(
        ",;\t|", ".,", ("\n", "\r\n"), first
    ):
        if separator == decimal:
            continue
        lines = [("time_s", "angle_rad", "note", "")]
        lines += [(*(f"{x}".replace(".", decimal) for x in r), "", "") for r in ROWS]
        text = [above.format(separator)] * bool(above)
        text += [separator.join(line) for line in lines]
        path = tmp_path / "motion.csv"
        path.write_bytes(end.join([*text, separator * 3, ""]).encode(encoding))
        found = read_trajectory(path)
        assert found.times == tuple(t for t, _ in ROWS)
        assert found.angles == tuple(a for _, a in ROWS)


def columns(path: Path, joints: tuple[str, ...]) -> dict[str, list[float]]:
    found = read_trajectory(path, joints)
    return {found.joint: list(found.angles)} | {n: list(a) for n, a in found.others}


@pytest.mark.parametrize(
    ("name", "joint"),
    [
        ("knee_rad", "knee"),
        ("knee_angle_rad", "knee"),
        ("Knee Angle [rad]", "knee"),
        ("angle_rad", "knee"),
        ("joint_angle_rad", "knee"),
        ("knee_r_rad", "knee_angle_r"),
        ("knee_angle_r_rad", "knee_r"),
        ("hip_flexion_r_rad", "hip_flexion_r"),
    ],
)
def test_columns_are_matched_to_joints_by_name(
    tmp_path: Path, name: str, joint: str
) -> None:
    lines = [f"time_s,{name},other_rad", *(f"{t},{a},9" for t, a in ROWS)]
    path = write(tmp_path, "\n".join(lines))
    assert columns(path, (joint, "toe")) == {joint: [a for _, a in ROWS]}


def test_a_table_moves_several_joints(tmp_path: Path) -> None:
    lines = ["time_ms,hip_deg,angle_deg", *(f"{1e3 * t},{a},{2 * a}" for t, a in ROWS)]
    path = write(tmp_path, "\n".join(lines))
    recorded = read_trajectory(path, ("knee", "hip", "ankle"))
    motion = recorded.sample(0.75, 0.25, RNG)
    assert set(motion.companions) == {"knee", "hip"}
    expected = np.deg2rad([a for _, a in ROWS])
    np.testing.assert_allclose(motion.companions["hip"].angle, expected, atol=1e-15)
    np.testing.assert_allclose(motion.angle, 2 * expected, atol=1e-15)
    assert np.array_equal(motion.angle, motion.companions["knee"].angle)
    anonymous = read_trajectory(path).on_joints(("knee", "hip"))
    assert anonymous == recorded


def test_a_table_of_another_joint_is_refused(tmp_path: Path) -> None:
    lines = ["time_s,hip_deg", *(f"{t},{a}" for t, a in ROWS)]
    path = write(tmp_path, "\n".join(lines))
    with pytest.raises(CableError, match="no column of the angle of joint 'knee'"):
        read_trajectory(path, ("knee",))
    with pytest.raises(CableError, match=r"moves 'hip', but .* drives .*'knee'"):
        trajectory(read_trajectory(path), joints={"knee": (0.0, 2.0)})


def test_a_joint_without_a_unit_is_refused_although_others_have_one(
    tmp_path: Path,
) -> None:
    lines = ["time_s,angle_deg,hip_angle", *(f"{t},{a},{a}" for t, a in ROWS)]
    path = write(tmp_path, "\n".join(lines))
    with pytest.raises(CableError, match=r"'hip_angle' has no unit; .*hip_angle_deg"):
        read_trajectory(path, ("knee", "hip"))
    assert columns(path, ("knee",)).keys() == {"knee"}


OPENSIM = """Coordinates
version=1
nRows=4
nColumns=4
{header}
endheader
time\tpelvis_tx\tknee_angle_r\thip_flexion_r
0.0\t0.9\t10\t-20
0.1\t0.9\t20\t-10
0.2\t0.9  30\t0
0.3\t0.9\t40\t10
"""


@pytest.mark.parametrize(("given", "factor"), [("yes", np.pi / 180), ("no", 1.0)])
@pytest.mark.parametrize("ending", ["mot", "STO"])
def test_opensim_files_have_the_unit_in_their_header(
    tmp_path: Path, given: str, factor: float, ending: str
) -> None:
    path = tmp_path / f"walk.{ending}"
    path.write_text(OPENSIM.format(header=f"inDegrees={given}"))
    found = columns(path, ("knee_r", "hip_flexion_r"))
    assert found["knee_r"] == pytest.approx([factor * a for a in (10, 20, 30, 40)])
    assert found["hip_flexion_r"] == pytest.approx(
        [factor * a for a in (-20, -10, 0, 10)]
    )


@pytest.mark.parametrize(
    ("joints", "found"),
    [
        (("knee",), {"knee": "knee_angle_r_deg"}),
        (("knee", "hip"), {"knee": "knee_angle_r_deg", "hip": "hip_flexion_r_deg"}),
        (("right_hip", "left_hip"), {"right_hip": "hip_flexion_r_deg"}),
        (("left_knee", "hip"), None),
        (("ankle",), None),
    ],
)
def test_joints_are_found_by_limb_and_side_as_opensim_names_them(
    tmp_path: Path, joints: tuple[str, ...], found: dict[str, str] | None
) -> None:
    path = tmp_path / "walk.mot"
    path.write_text(OPENSIM.format(header="inDegrees=yes"))
    if found is None:
        with pytest.raises(CableError, match=f"no column .* joint '{joints[0]}'"):
            read_trajectory(path, joints)
        return
    motion = read_trajectory(path, joints)
    assert dict(zip(columns(path, joints), motion.columns, strict=True)) == found
    again = read_trajectory(path, ("knee_r", "hip_r")).on_joints(joints)
    assert again == motion and again.describe() == motion.describe()
    assert f"{joints[0]} by '{found[joints[0]]}', " in motion.describe()


def test_of_two_legs_a_joint_without_a_side_is_the_right_one(tmp_path: Path) -> None:
    path = tmp_path / "walk.sto"
    text = OPENSIM.format(header="inDegrees=yes").replace("pelvis_tx", "knee_angle_l")
    path.write_text(text)
    assert columns(path, ("knee",))["knee"][0] == pytest.approx(np.deg2rad(10.0))
    assert columns(path, ("left_knee",))["left_knee"][0] == pytest.approx(
        np.deg2rad(0.9)
    )


def test_coordinates_of_a_state_of_moco_are_angles_and_its_speeds_are_not(
    tmp_path: Path,
) -> None:
    leg = "/jointset/knee_r/knee_angle_r/"
    text = OPENSIM.format(header="inDegrees=no").replace("pelvis_tx", leg + "speed")
    path = tmp_path / "moco.sto"
    path.write_text(text.replace("\tknee_angle_r", f"\t{leg}value"))
    found = read_trajectory(path, ("knee",))
    assert found.angles[0] == 10.0 and found.columns == ("knee_angle_r_rad",)
    assert read_trajectory(path).joint == "knee_r"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OPENSIM.format(header=""), "'knee_angle_r' has no unit; .* write inDegrees="),
        (OPENSIM.replace("endheader", ""), "is no OpenSim file; a line 'endheader'"),
        (
            OPENSIM.format(header="inDegrees=yes") + "0.4\t0\tx\t0",
            "line 12: .*'x'; every cell must be a number",
        ),
        (
            OPENSIM.format(header="inDegrees=yes") + "0.4\t0\t0",
            "line 12 has 3 cells; it must have the 4 that line 7 names",
        ),
    ],
)
def test_opensim_files_that_cannot_be_used(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "walk.mot"
    path.write_text(text)
    with pytest.raises(CableError, match=message):
        read_trajectory(path, ("knee_r",))


def test_parquet_and_tsv_are_read_as_csv(tmp_path: Path) -> None:
    times, angles = zip(*ROWS, strict=True)
    table = pa.table({"time_s": times, "knee_angle_deg": angles})
    pq.write_table(table, tmp_path / "motion.parquet")
    text = "\n".join(["time_s\tknee_angle_deg", *(f"{t}\t{a}" for t, a in ROWS)])
    for ending in ("tsv", "csv"):
        (tmp_path / f"motion.{ending}").write_text(text)
    found = [
        read_trajectory(tmp_path / f"motion.{ending}", ("knee",))
        for ending in ("parquet", "tsv", "csv")
    ]
    assert found[0] == found[1] == found[2]
    assert found[0].angles == pytest.approx(np.deg2rad(angles))


@pytest.mark.shared
def test_the_motion_of_a_knee_is_read() -> None:
    found = read_trajectory(SHARED / "cases" / "device" / "motion.csv", ("knee",))
    assert found.angles[0] == 0.1 and found.end == 5.99
    assert 0.0 <= min(found.angles) and max(found.angles) <= 2.0
