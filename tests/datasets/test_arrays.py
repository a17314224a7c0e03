"""MATLAB and HDF5: columns in variables, structs and groups, refused in a sentence."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from cc_mujoco._utils import tables
from cc_mujoco.datasets._dataset_file import DatasetFile, Source
from cc_mujoco.datasets._reading import read
from cc_mujoco.errors import CableError
from diagnosis.bench import recording

SOME = recording(0.4)
OTHERS = {"fs": 500.0, "who": "ada", "gains": np.arange(3.0), "cells": np.eye(2) * 1j}


def hdf5(path: Path, content: dict[str, Any], matlab: bool = False) -> Path:
    """Write datasets; as MATLAB does it with its header, classes and order of axes."""
    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        for name, value in content.items():
            item = file.create_dataset(name, data=value.T if matlab else value)
            if matlab:
                item.attrs["MATLAB_class"] = np.bytes_("double")
    if matlab:
        head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        with path.open("r+b") as raw:
            raw.write(head)
    return path


def same(path: Path, file: DatasetFile | None = None) -> dict[str, str]:
    """Check that the channels are those of `SOME`; their labels."""
    recorded = read(path, file or DatasetFile())
    for name, column in SOME.items():
        assert np.array_equal(recorded.values[name], column)
    return recorded.labels


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("turn", ["row", "column"])
def test_matlab_variables_are_columns(tmp_path: Path, version: Any, turn: Any) -> None:
    path = tmp_path / "run.mat"
    savemat(path, OTHERS | SOME, format=version, oned_as=turn)
    same(path)


def test_fields_of_a_matlab_struct_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "run.MAT"
    savemat(path, OTHERS | {"data": SOME}, do_compression=True)
    assert same(path)["time_s"] == "data.time_s"
    # Under their own names or in full, in units that the name says.
    degrees = {k: v for k, v in SOME.items() if k != "joint_angle_rad"}
    degrees["joint_angle_deg"] = np.degrees(SOME["joint_angle_rad"])
    savemat(path, {"data": degrees})
    for file in (
        DatasetFile(),
        DatasetFile(columns={"joint_angle_rad": Source(name="joint_angle_deg")}),
        DatasetFile(columns={"joint_angle_rad": Source(name="data.joint_angle_deg")}),
    ):
        angle = read(path, file).values["joint_angle_rad"]
        assert angle == pytest.approx(SOME["joint_angle_rad"])


def test_columns_of_matrices_are_called_as_in_their_language(tmp_path: Path) -> None:
    names = [*SOME]
    both = np.column_stack([SOME[name] for name in names[1:]])
    content = {"time_s": SOME["time_s"], "q": both}
    savemat(tmp_path / "run.mat", content)
    hdf5(tmp_path / "run.h5", content)
    hdf5(tmp_path / "new.mat", {"time_s": SOME["time_s"][:, None], "q": both}, True)
    for file, form, first in (
        ("run.mat", "q(:,{})", 1),
        ("new.mat", "q(:,{})", 1),
        ("run.h5", "q[:,{}]", 0),
    ):
        columns = {
            name: Source(name=form.format(k + first))
            for k, name in enumerate(names[1:])
        }
        same(tmp_path / file, DatasetFile(columns=columns))


def test_datasets_of_hdf5_groups_are_columns(tmp_path: Path) -> None:
    inside = {f"rig/{name}": values for name, values in SOME.items()}
    path = hdf5(tmp_path / "run.hdf5", inside | {"meta": np.array(3.0)})
    assert same(path)["motor_angle_rad"] == "rig/motor_angle_rad"
    hdf5(path, inside | {"other/time_s": SOME["time_s"]})
    with pytest.raises(CableError, match="has other/time_s and rig/time_s; say in"):
        read(path, DatasetFile())
    same(path, DatasetFile(columns={"time_s": Source(name="rig/time_s")}))


def test_a_struct_of_matlab_7_3_is_read(tmp_path: Path) -> None:
    inside = {f"data/{name}": values[:, None] for name, values in SOME.items()}
    refused = {"#refs#/a": np.ones((3, 1))}
    path = hdf5(tmp_path / "run.mat", inside | refused, matlab=True)
    assert same(path)["time_s"] == "data.time_s"
    assert tables.column_names(path) == sorted(f"data.{name}" for name in SOME)


def test_what_needs_h5py_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [
        hdf5(tmp_path / "run.h5", SOME),
        hdf5(tmp_path / "run.mat", {"x": SOME["time_s"][:, None]}, matlab=True),
    ]
    monkeypatch.setitem(sys.modules, "h5py", None)
    for path, other in zip(files, ("write Parquet", "-v7"), strict=True):
        with pytest.raises(CableError, match=rf"needs h5py .*\[hdf5\].*{other}"):
            read(path, DatasetFile())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"t": np.arange(9.0), "phi": np.ones(9)}, "no column 'time_s', only t, phi"),
        ({"who": "ada", "fs": 3.0}, "holds no vector of numbers"),
        (
            SOME | {"joint_angle_rad": np.ones(7)},
            "has 7 readings, but its times, .*200",
        ),
        ({"a": SOME, "b": SOME}, r"has a.time_s and b.time_s; say"),
    ],
)
def test_matlab_files_without_a_trial_are_one_sentence(
    tmp_path: Path, content: dict[str, Any], sentence: str
) -> None:
    savemat(tmp_path / "run.mat", content)
    with pytest.raises(CableError, match=sentence) as error:
        read(tmp_path / "run.mat", DatasetFile())
    assert "run.mat" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["run.mat", "run.h5"])
@pytest.mark.parametrize("content", [b"", b"hello, world", bytes(range(256)) * 9])
def test_broken_files_are_one_sentence(
    tmp_path: Path, name: str, content: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(CableError, match=re.escape(name)) as error:
        read(path, DatasetFile())
    assert "\n" not in str(error.value)
    with pytest.raises(CableError, match=r"cannot read .*: No such file"):
        read(tmp_path / f"none{path.suffix}", DatasetFile())


def test_half_a_matlab_file_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, SOME, do_compression=True)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(CableError, match="not a whole mat file"):
        read(path, DatasetFile())
