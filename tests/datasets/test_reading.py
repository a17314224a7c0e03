"""Files of trials: found in order, read in any dialect, refused in a sentence."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco._utils import tables
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._dataset_file import DatasetFile, Source, read_dataset_file
from cc_mujoco.datasets._folders import data_files, find_dataset_file
from cc_mujoco.datasets._reading import read
from cc_mujoco.errors import CableError
from diagnosis.bench import Columns, recording, write

SOME = recording(0.4)
TOP = ",".join(SOME)


def text(rows: str, top: str = TOP) -> str:
    return f"{top}\n{rows}"


def put(folder: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = folder / name
    raw = content if isinstance(content, bytes) else content.encode()
    path.write_bytes(raw)
    return path


def same(path: Path, expected: Columns) -> None:
    values = read(path, DatasetFile()).values
    for name, column in expected.items():
        assert values[name] == pytest.approx(column, rel=1e-6, abs=1e-7)


def test_folders_are_sorted_and_files_taken_once(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / ".git").mkdir()
    for name in ("z.csv", "a.PARQUET", "b/c.csv", "notes.txt", ".h.csv", ".git/x.csv"):
        put(tmp_path, "", name)
    found = data_files([tmp_path / "z.csv", tmp_path])
    assert [p.relative_to(tmp_path).as_posix() for p in found] == [
        "z.csv",
        "a.PARQUET",
        "b/c.csv",
    ]


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("none.csv", "does not exist"),
        ("notes.txt", "must end in .csv, .tsv, .parquet, .mot"),
        ("empty", "there is no data file in"),
        ("walk.c3d", "run inverse kinematics first"),
    ],
)
def test_paths_without_data(tmp_path: Path, path: str, sentence: str) -> None:
    put(tmp_path, "", "notes.txt")
    put(tmp_path, "", "walk.c3d")
    (tmp_path / "empty").mkdir()
    with pytest.raises(CableError, match=sentence):
        data_files([tmp_path / path])
    with pytest.raises(CableError, match="no data file in nothing"):
        data_files([])


def test_the_dataset_file_beside_the_data(tmp_path: Path) -> None:
    files = [put(tmp_path, "", "a.csv")]
    assert find_dataset_file(files) is None
    toml = put(tmp_path, "", "dataset.toml")
    assert find_dataset_file(files) == toml
    (tmp_path / "more").mkdir()
    files.append(put(tmp_path / "more", "", "b.csv"))
    put(tmp_path / "more", "", "dataset.toml")
    with pytest.raises(
        CableError, match=r"dataset.toml and .*dataset.toml; give the one"
    ):
        find_dataset_file(files)
    for number in range(70):
        (tmp_path / f"{number}").mkdir()
        files.append(put(tmp_path / f"{number}", "", "b.csv"))
        put(tmp_path / f"{number}", "", "dataset.toml")
    with pytest.raises(CableError, match="and 71 more") as caught:
        find_dataset_file(files)
    assert str(caught.value).count(str(tmp_path)) == 1


@given(
    values=st.lists(
        st.floats(-9e5, 9e5, allow_subnormal=False), min_size=1, max_size=20
    )
)
def test_parquet_and_csv_give_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    folder = tmp_path_factory.mktemp("data")
    columns = {name: np.array(values) for name in SOME}
    pq.write_table(pa.table(columns), folder / "run.parquet")
    rows = "\n".join(",".join([repr(value)] * 5) for value in values)
    put(folder, text(rows))
    for ending in ("csv", "parquet"):
        recorded = read(folder / f"run.{ending}", DatasetFile()).values
        for name in SOME:
            assert np.array_equal(recorded[name], columns[name])


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_dialects(tmp_path: Path, separator: str, newline: str) -> None:
    path = write(tmp_path / "run.csv", SOME)
    lines = path.read_text().replace(",", separator).splitlines()
    put(tmp_path, newline.join(["# rig 3, \u00b5-step", "", *lines, "", ""]))
    same(path, SOME)


def test_tsv_and_opensim_files_are_read_as_csv(tmp_path: Path) -> None:
    rows = np.column_stack(list(SOME.values()))
    lines = ["\t".join(f"{x:.9g}" for x in row) for row in rows]
    put(tmp_path, "\n".join(["\t".join(SOME), *lines]), "run.tsv")
    same(tmp_path / "run.tsv", SOME)
    bare = {
        "time_s": "time",
        "motor_angle_rad": "motor_angle",
        "joint_angle_rad": "joint_angle",
        "motor_torque_nm": "motor_torque_moment",
        "joint_torque_nm": "joint_torque_moment",
    }
    head = ["run", "version=1", "inDegrees=no", "endheader"]
    names = "\t".join(bare.get(name, name) for name in SOME)
    text = "\n".join([*head, names, *lines])
    paths = put(tmp_path, text, "run.sto"), tmp_path / "opensim.csv"
    paths[1].write_text(text.replace("\t", ","))
    columns = {
        channel: Source(name=f"{channel[:-3]}_moment_nm", unit="Nm")
        for channel in ("motor_torque_nm", "joint_torque_nm")
    }
    for path in paths:
        found = read(path, DatasetFile(columns=columns)).values
        for name in bare:
            assert found[name] == pytest.approx(SOME[name], rel=1e-6, abs=1e-7)


def test_decimal_commas_byte_order_marks_and_other_encodings(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", SOME)
    plain = path.read_text()
    put(tmp_path, plain.replace(",", ";").replace(".", ","))
    same(path, SOME)
    put(tmp_path, b"\xef\xbb\xbf" + plain.encode())
    same(path, SOME)
    put(tmp_path, plain.encode("utf-16"))
    same(path, SOME)
    put(
        tmp_path,
        plain.replace(TOP, f"{TOP},\u00b0C")
        .replace("\n", ",1\n")
        .replace("\u00b0C,1", "\u00b0C")
        .encode("latin-1"),
    )
    same(path, SOME)


def test_spaces_quotes_and_other_columns_do_not_matter(tmp_path: Path) -> None:
    top = ", ".join(f'"{name}"' for name in SOME) + ",note,note"
    rows = "\n".join(
        ", ".join(f"{v:.9g}" for v in row) + ',"a, b",c'
        for row in zip(*SOME.values(), strict=True)
    )
    same(put(tmp_path, text(rows, top.replace(', "', ',"'))), SOME)


def test_integers_missing_readings_and_infinity(tmp_path: Path) -> None:
    rows = "0,1,2,3,4\n1,,nan,NA,inf\n2,-inf,null,None,1e400\n"
    values = read(put(tmp_path, text(rows)), DatasetFile()).values
    assert values["time_s"].tolist() == [0, 1, 2]
    for channel in list(SOME)[1:]:
        assert np.isnan(values[channel][1:]).all()
        assert np.isfinite(values[channel][0])


@pytest.mark.parametrize("ones", ["1,0,1", "true,False,TRUE", "1.0,0.0,1", " 1 ,0,1"])
def test_masks_may_be_words_or_numbers(tmp_path: Path, ones: str) -> None:
    rows = "\n".join(f"{k},1,1,1,1,{one}" for k, one in enumerate(ones.split(",")))
    path = put(tmp_path, text(rows, f"{TOP},valid"))
    assert read(path, DatasetFile()).values["valid"].tolist() == [1, 0, 1]
    mask = pa.array([True, False, None])
    table = pa.table({name: [0.0, 1.0, 2.0] for name in SOME} | {"valid": mask})
    pq.write_table(table, tmp_path / "run.parquet")
    found = read(tmp_path / "run.parquet", DatasetFile()).values["valid"]
    assert found[:2].tolist() == [1, 0] and np.isnan(found[2])


def test_a_name_may_say_another_unit(tmp_path: Path) -> None:
    top = "time_ms,motor_angle_deg,motor_torque_mnm,joint_angle_mrad,joint_torque_nm"
    recorded = read(put(tmp_path, text("1000,180,1000,1000,1", top)), DatasetFile())
    assert recorded.values["time_s"] == pytest.approx([1.0])
    assert recorded.values["motor_angle_rad"] == pytest.approx([np.pi])
    assert recorded.values["motor_torque_nm"] == pytest.approx([1.0])
    assert recorded.values["joint_angle_rad"] == pytest.approx([1.0])
    assert recorded.labels["motor_angle_rad"] == "motor_angle_deg"


@pytest.mark.parametrize(
    ("channel", "column", "unit"),
    [
        ("motor_angle_rad", "angle_deg", "deg"),
        ("joint_angle_rad", "phi out [\N{DEGREE SIGN}]", "deg"),
        ("motor_angle_rad", "Encoder (rev)", "rev"),
        ("time_s", "t_ms", "ms"),
        ("time_s", "clock[us]", "us"),
        ("joint_torque_nm", "load_cell_mNm", "mNm"),
        ("motor_torque_nm", "drive_lbfin", "lbfin"),
    ],
)
def test_a_column_in_another_unit_is_offered_with_its_conversion(
    tmp_path: Path, channel: str, column: str, unit: str
) -> None:
    path = put(tmp_path, text("0,1,2,3,4\n", TOP.replace(channel, column)))
    told = f"[columns.{channel}] name = {column!r}, unit = {unit!r}"
    with pytest.raises(CableError, match=re.escape(told)):
        read(path, DatasetFile())
    # What is said is what helps, and so does the name alone, which ends in the unit.
    factor = channels.kind_of(channel).factors[unit]
    for source in (Source(name=column, unit=unit), Source(name=column)):
        value = read(path, DatasetFile(columns={channel: source})).values[channel]
        assert value == pytest.approx([factor * TOP.split(",").index(channel)])


@pytest.mark.parametrize(
    "top",
    [
        "time,Motor Pos [deg],Motor Torque [Nm],Joint Pos [deg],Joint Torque [Nm]",
        "t (ms);q_motor_deg;tau motor [mNm];q_joint_deg;tau joint [mNm]",
        'Time [s],drive\'s angle [rev],drive torque [Nm],"load"_angle_rad,torque_nm',
    ],
)
def test_lines_that_map_all_columns_are_offered_and_valid(
    tmp_path: Path, top: str
) -> None:
    first = "1000;180;1000;90;500" if ";" in top else "1,0.5,1,0.25,0.5"
    path = put(tmp_path, text(f"{first}\n", top))
    with pytest.raises(CableError, match="has no columns time_s") as told:
        read(path, DatasetFile())
    mapping = tmp_path / "dataset.toml"
    mapping.write_text(str(told.value).partition("\n")[2], "utf-8")
    found = read(path, read_dataset_file(mapping))
    names = sorted(found.labels.values())
    assert names == sorted(tables.column_names(path))


def test_a_missing_reading_of_a_spreadsheet_is_missing(tmp_path: Path) -> None:
    found = read(put(tmp_path, text("0,1,#N/A,3,4\n1,1,2,3,<NA>\n")), DatasetFile())
    assert np.isnan(found.values["motor_torque_nm"]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("channel", "column", "advice"),
    [
        ("motor_angle_rad", "motor_speed_rpm", "its integral"),
        ("joint_angle_rad", "joint_travel_mm", "over the radius of its pulley"),
        ("joint_torque_nm", "joint_load_kg", "in kgf or in lbf"),
        ("joint_torque_nm", "joint_load_lbf", "times the radius"),
        ("motor_torque_nm", "motor_current_mA", "times the torque constant"),
    ],
)
def test_another_quantity_is_no_column_to_rename(
    tmp_path: Path, channel: str, column: str, advice: str
) -> None:
    path = put(tmp_path, text("0,1,2,3,4\n", TOP.replace(channel, column)))
    with pytest.raises(CableError, match=f"'{column}' is .*{advice}"):
        read(path, DatasetFile())


def test_a_rate_is_in_no_unit_of_a_channel() -> None:
    for name in ("motor_speed_rad_s", "stiffness_nm_rad", "speed [deg/s]", "", "s2"):
        for channel in channels.REQUIRED_CHANNELS:
            assert channels.unit_of(name, channels.kind_of(channel)) is None


def test_tensions_may_be_in_other_units_too(tmp_path: Path) -> None:
    top = f"{TOP},tension_a_proximal_kn,tension_a_distal_lbf,tension_b_distal_raw"
    values = read(put(tmp_path, text("0,1,2,3,4,1,2,3", top)), DatasetFile()).values
    assert values["tension_a_proximal_n"] == pytest.approx([1000.0])
    assert values["tension_a_distal_n"] == pytest.approx([8.8964432])
    assert not any("_b_" in name for name in values)
    path = put(tmp_path, text("0,1,2,3,4,5", f"{TOP},tension_a_proximal_kg"))
    with pytest.raises(CableError, match=r"tension_a_proximal_kg is a mass"):
        read(path, DatasetFile())


def test_tensions_and_temperature_are_taken_along(tmp_path: Path) -> None:
    top = f"{TOP},tension_flexor_proximal_n,tension_flexor_n,temperature_c"
    path = put(tmp_path, text("0,1,2,3,4,50,6,21", top))
    recorded = read(path, DatasetFile())
    assert recorded.values["tension_flexor_proximal_n"].tolist() == [50.0]
    assert recorded.values["temperature_c"].tolist() == [21.0]
    assert "tension_flexor_n" not in recorded.values
    assert recorded.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "is empty; its first line must name the columns"),
        ("\n\n# nothing\n", "is empty"),
        ("0,1,2,3,4\n1,1,1,1,1\n", "line 1 is numbers"),
        ("t,angle\n0,1\n", "has no column 'time_s'"),
        (text("0,1\n", "time_s,motor_angle"), r"is it 'motor_angle'\?"),
        (text("0,1,2,3,4\n1,1,x1,1,1\n"), "motor_torque_nm, row 2 .* 'x1' must be"),
        (text("0,1,2,3,4\n1,1,1\n"), "is not a table: .* 5 cells"),
        (text("0,1,2,3,4,5\n"), "is not a table"),
        (text("s,rad,Nm,rad,Nm\n0,1,2,3,4\n"), "row 1 .* 's' must .* delete a row of"),
        (text("12:00:01.5,1,2,3,4\n"), "'12:00:01.5' must be a number"),
        (text("0,1,2,3,4,maybe\n", f"{TOP},valid"), "'maybe' must be a number"),
        (text("0,1,2,3,4,9\n", f"{TOP},time_s"), "2 columns time_s"),
        (
            text("0,1,2,3,4\n", TOP.replace("joint_torque", "motor_torque")),
            r"no column 'joint_torque_nm'.*\('motor_torque_nm' more than once\)",
        ),
        (text("0,1,2,3,4,9\n", f"{TOP},motor_angle_deg"), "say in dataset.toml which"),
        (b"PK\x03\x04\x00\x00\xff\xfe\x00\x01" * 50, "run.csv"),
        (bytes(range(256)) * 40, "run.csv"),
    ],
)
def test_bad_csv_files_are_one_sentence(
    tmp_path: Path, content: str | bytes, sentence: str
) -> None:
    with pytest.raises(CableError, match=sentence) as error:
        read(put(tmp_path, content), DatasetFile())
    assert "run.csv" in str(error.value) and "\n" not in str(error.value)


def test_bad_parquet_files_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    path.write_bytes(b"")
    with pytest.raises(CableError, match="not a whole parquet file"):
        read(path, DatasetFile())
    table = pa.table({name: ["a", "b"] for name in SOME})
    pq.write_table(table, path)
    with pytest.raises(CableError, match="column time_s holds string"):
        read(path, DatasetFile())
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(CableError, match="not a whole parquet file"):
        read(path, DatasetFile())


def test_a_folder_called_like_a_file(tmp_path: Path) -> None:
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(CableError, match="cannot read"):
        read(tmp_path / "run.csv", DatasetFile())


def test_columns_mapped_that_are_not_there(tmp_path: Path) -> None:
    path = put(tmp_path, text("0,1,2,3,4\n"))
    for source in (Source(name="theta"), Source(clock="t_theta")):
        file = DatasetFile(columns={"motor_angle_rad": source})
        with pytest.raises(CableError, match="has no column 't"):
            read(path, file)
    file = DatasetFile(columns={"tension_a_distal_n": Source()})
    with pytest.raises(CableError, match="has no column 'tension_a_distal_n'"):
        read(path, file)


def test_no_column_of_another_channel_or_side_is_proposed(tmp_path: Path) -> None:
    names = "time_s,thetaM,theta_j,tau_mot,tau_load"
    path = put(tmp_path, text("0,1,2,3,4\n", names))
    mapped = {
        "motor_angle_rad": Source(name="theta_m"),
        "joint_angle_rad": Source(name="theta_j"),
        "motor_torque_nm": Source(name="tau_mot"),
        "joint_torque_nm": Source(name="tau_load"),
    }
    with pytest.raises(CableError, match="is it 'thetaM'"):
        read(path, DatasetFile(columns=mapped))
    mapped["motor_angle_rad"] = Source(name="thetaM")
    mapped["joint_torque_nm"] = Source(name="tau_lod")
    with pytest.raises(CableError, match="is it 'tau_load'"):
        read(path, DatasetFile(columns=mapped))
    mapped["motor_torque_nm"] = Source(name="tau_load")
    with pytest.raises(CableError, match="no column 'tau_lod' for joint_torque_nm:"):
        read(path, DatasetFile(columns=mapped))


@given(raw=st.binary(max_size=200))
def test_any_bytes_are_a_table_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, raw: bytes
) -> None:
    folder = tmp_path_factory.mktemp("data")
    for content in (raw, text("").encode() + raw):
        try:
            recorded = read(put(folder, content), DatasetFile())
        except CableError as error:
            assert "run.csv" in str(error)
        else:
            assert recorded.rows >= 0


@pytest.mark.parametrize(
    ("columns", "toml", "told"),
    [
        ("joint2_position_rad", "joint_angle_rad", ""),
        ("encoder_2_rad", "joint_angle_rad", ""),
        ("elbow_angle_deg,wrist_angle_deg", "", ""),
        ("joint_angle_rad,second_joint_angle_rad", "", ""),
        ("joint_angle_rad,encoder_1_deg", "", "if it is 'encoder_1_deg'"),
        ("joint_angle_rad,drive_angle_deg", "", "if it is 'drive_angle_deg'"),
    ],
)
def test_a_missing_motor_angle_is_not_looked_for_at_the_joint(
    tmp_path: Path, columns: str, toml: str, told: str
) -> None:
    """Not in a column that is the joint's already, nor in that of another joint."""
    mapped = {toml: Source(name=columns, unit="rad")} if toml else {}
    names = f"time_s,motor_torque_nm,joint_torque_nm,{columns}"
    row = ",".join("0" * (names.count(",") + 1))
    path = put(tmp_path, f"{names}\n{row}\n{row}\n")
    with pytest.raises(CableError, match="no column 'motor_angle_rad'") as error:
        read(path, DatasetFile(columns=mapped))
    assert ("if it is" in str(error.value)) == bool(told)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
