"""Grids, Latin hypercubes and lists of designs; what is no design says why."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.design._designs import (
    MAX_DESIGNS,
    Range,
    from_file,
    grid,
    latin_hypercube,
    read_range,
)
from cc_mujoco.device import load_device
from cc_mujoco.errors import CableError

DEVICE = load_device("wrist")


def test_a_grid_has_every_combination_once() -> None:
    ranges = {
        "friction": read_range("friction", "0.1:0.3:3", DEVICE),
        "loops": read_range("loops", "1,2", DEVICE),
        "conduit": read_range("conduit", "2:0.28, 1:0.1 1:inf", DEVICE),
    }
    designs = grid(ranges)
    assert len(designs) == 12 == len({tuple(d.values()) for d in designs})
    assert {d["friction"] for d in designs} == {0.1, 0.2, 0.3}
    assert {d["conduit"] for d in designs} == {"2:0.28", "1:0.1 1:inf"}
    # The last variable is fastest, as the table of effects takes for granted.
    assert [d["loops"] for d in designs[:4]] == [1.0, 1.0, 2.0, 2.0]


def test_a_hypercube_visits_every_part_of_every_range_once() -> None:
    ranges = {
        "pretension": read_range("pretension", "1:100:2:log", DEVICE),
        "friction": read_range("friction", "0:0.5", DEVICE),
        "segments": read_range("segments", "5:8:4", DEVICE),
    }
    count = 40
    designs = latin_hypercube(ranges, count, seed=3)
    assert designs == latin_hypercube(ranges, count, seed=3)
    assert designs != latin_hypercube(ranges, count, seed=4)
    shares = np.log10([float(d["pretension"]) for d in designs]) / 2.0
    assert sorted((shares * count).astype(int)) == list(range(count))
    friction = np.array([d["friction"] for d in designs])
    assert sorted((2.0 * friction * count).astype(int)) == list(range(count))
    segments = [d["segments"] for d in designs]
    assert {n: segments.count(n) for n in (5, 6, 7, 8)} == dict.fromkeys(
        range(5, 9), 10
    )


@pytest.mark.parametrize("name", ["list.csv", "list.toml"])
def test_a_list_comes_from_a_file(name: str, tmp_path: Path) -> None:
    texts = {
        "list.csv": "friction, conduit\n0.1, 2:0.28\n0.2, 1:inf\n",
        "list.toml": '[[design]]\nfriction = 0.1\nconduit = "2:0.28"\n'
        '[[design]]\nconduit = "1:inf"\nfriction = 0.2\n',
    }
    (tmp_path / name).write_text(texts[name])
    designs = from_file(tmp_path / name)
    assert [float(str(d["friction"])) for d in designs] == [0.1, 0.2]
    assert [d["conduit"] for d in designs] == ["2:0.28", "1:inf"]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("friction\n0.1,2\n", "line 2"),
        ("friction,loops\n0.1\n", "line 2"),
        ("friction\n", "no designs"),
        ("\n\nfriction,loops\n\n0.1,1\n0.1\n", "line 6"),
        ("friction,loops, friction\n0.1,1,0.2\n", "'friction' twice"),
        ("friction;loops\n0,1;1\n0,1\n", "line 3"),
    ],
)
def test_a_list_that_is_none_says_where(text: str, wrong: str, tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(CableError, match=wrong):
        from_file(tmp_path / "list.csv")


@pytest.mark.parametrize(
    "content",
    [
        b"friction;conduit\r\n0,1;2:0.28\r\n0,2;1:inf\r\n",
        b"\nfriction\tconduit\n0.1\t2:0.28\n0.2\t1:inf\n",
        "sep=;\nfriction;conduit;\n0,1;2:0.28;\n0,2;1:inf;\n;;\n".encode("utf-16"),
    ],
)
def test_a_list_from_a_spreadsheet(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_bytes(content)
    designs = from_file(tmp_path / "list.csv")
    assert [float(str(d["friction"])) for d in designs] == [0.1, 0.2]
    assert [d["conduit"] for d in designs] == ["2:0.28", "1:inf"]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("[[designs]]\nfriction = 0.1\n", "'designs'"),
        ("[[design]]\nfriction = 0.1\n[other]\n", "'other'"),
        ("design = 3\n", "must be tables"),
        ("[[design]]\nfriction = 0.1 0.2\n", "is not a TOML file"),
    ],
)
def test_a_toml_with_a_slip_says_which(text: str, wrong: str, tmp_path: Path) -> None:
    (tmp_path / "list.toml").write_text(text)
    with pytest.raises(CableError, match=wrong):
        from_file(tmp_path / "list.toml")


def test_a_truth_is_no_number() -> None:
    with pytest.raises(CableError, match="not True"):
        read_range("friction", [True], DEVICE)


def test_designs_of_a_list_must_set_the_same(tmp_path: Path) -> None:
    path = tmp_path / "list.toml"
    path.write_text("[[design]]\nfriction = 0.1\n[[design]]\nloops = 2\n")
    with pytest.raises(CableError, match="design 2 sets loops"):
        from_file(path)


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("friction", "0.3:0.1:3", "must rise"),
        ("friction", "0.1:0.3:1", "2 to 1,000,000 values"),
        ("friction", "0:1:1000000000", "2 to 1,000,000 values"),
        ("friction", "0.1:0.3:3:lag", "is no range"),
        ("friction", "0.1:x:3", "is no range"),
        ("friction", "0:0.3:3:log", "above 0"),
        ("friction", "0.1:9:3", "a number in [0, 5]"),
        ("friction", "0.1,0.2,0.10", "is given 0.1 more than once"),
        ("friction", "nan", "not 'nan'"),
        ("friction", "", "not ''"),
        ("segments", "2.5", "whole number"),
        ("motor_radius", "0", "(0, 10] m"),
        ("frictoin", "1", "did you mean 'friction'"),
        ("flexer.friction", "0.1", "did you mean 'flexor'"),
        ("flexor.motor_torque", "1", "unknown axis 'flexor': it is a cable"),
        ("elbow.motor_torque", "1", "Available: wrist."),
        ("safe_torque", "1", "but a key of [axis] in the description"),
        ("frictoin", "1", "`cc-mujoco list variables` shows all"),
    ],
)
def test_what_is_no_range_is_one_sentence(name: str, text: str, wrong: str) -> None:
    with pytest.raises(CableError, match=re.escape(wrong)) as error:
        read_range(name, text, DEVICE)
    assert "\n" not in str(error.value)


def test_a_range_without_a_count_is_for_a_hypercube_only() -> None:
    with pytest.raises(CableError, match="low:high:count"):
        grid({"friction": read_range("friction", "0.1:0.3", DEVICE)})


def test_designs_are_counted_before_they_are_made(tmp_path: Path) -> None:
    many = {name: Range(tuple(range(1000))) for name in ("a", "b", "c", "d")}
    with pytest.raises(CableError, match="not 1,000,000,000,000"):
        grid(many)
    with pytest.raises(CableError, match="not 1,000,000,000"):
        latin_hypercube(many, 10**9, 0)
    path = tmp_path / "many.csv"
    path.write_text("friction\n" + "0\n" * (MAX_DESIGNS + 1))
    with pytest.raises(CableError, match="not 1,000,001"):
        from_file(path)
