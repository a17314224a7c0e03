"""Trajectories from CSV files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco._utils.units import ANGLE, CLOCK
from cc_mujoco.errors import CableError
from cc_mujoco.human import TRAJECTORIES, from_csv

EXAMPLE = Path(__file__).parents[2] / "assets" / "trajectories" / "example_reach.csv"
RNG = np.random.default_rng(0)


def write(folder: Path, text: str) -> Path:
    path = folder / "motion.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_example_is_the_reach_it_was_made_from() -> None:
    motion = from_csv(EXAMPLE).sample(8.0, 0.002, RNG)
    reach = TRAJECTORIES["reach"].sample(8.0, 0.002, np.random.default_rng(7))
    assert np.abs(motion.angle - reach.angle).max() < 2e-4
    assert np.abs(motion.velocity - reach.velocity).max() < 2e-2


def test_spline_derivatives_rest_and_hold(tmp_path: Path) -> None:
    rows = [f"{t + 3.0},x,{0.3 + 0.2 * t - 0.1 * t**2}" for t in np.arange(0, 3, 0.25)]
    path = write(tmp_path, "\n".join(["time_s,note, angle_rad", *rows, ""]))
    motion = from_csv(path).sample(6.0, 1e-3, RNG)
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
    motion = from_csv(path).sample(2.0, 0.5, RNG)
    np.testing.assert_allclose(motion.angle, angles, atol=1e-15)


GOOD = "0,0\n1,0.1\n2,0.2\n3,0.1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "{} is empty; its first line must name the columns."),
        (
            "time,angle_rad\n" + GOOD,
            "{}, line 1: there is no column 'time_s'; if it is 'time', name it by its "
            "unit: time_s or time_ms or time_us or time_ns.",
        ),
        (
            "time_s,wrist_deg\n" + GOOD,
            "{}, line 1: there is no column 'angle_rad'; name it: "
            "angle_rad or angle_mrad or angle_deg or angle_rev.",
        ),
        (
            "time_s,angel_deg\n" + GOOD,
            "{}, line 1: there is no column 'angle_rad'; if it is 'angel_deg', name it "
            "angle_deg.",
        ),
        (
            "time_ms,time_us,angle_rad\n0,0,0\n",
            "{}, line 1: time_ms and time_us are both time_s; keep one of them.",
        ),
        (
            "time_s,angle_deg\n0,1e6\n",
            "{}, line 2, column angle_deg: '1e6' must be a number between -57295.8 and "
            "57295.8.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n1,0\n2,0\n",
            "{}, line 4, column time_s: 1 s must be at least 1e-06 s after the 1 s of "
            "the line before.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,nan\n2,0\n3,0\n",
            "{}, line 3, column angle_rad: 'nan' must be a number between -1000 and "
            "1000.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n4o,0\n",
            "{}, line 4, column time_s: '4o' must be a number between -1e+06 and "
            "1e+06.",
        ),
        (
            "time_s,angle_rad\n0,0\n1\n",
            "{}, line 3, column angle_rad: '' must be a number between -1000 and 1000.",
        ),
        (
            "time_s,angle_rad\n0,1e400\n",
            "{}, line 2, column angle_rad: '1e400' must be a number between -1000 and "
            "1000.",
        ),
        (
            "time_s,angle_rad\n0,0\n1,0\n",
            "{} has 2 lines of data, but a trajectory needs at least 4.",
        ),
    ],
)
def test_errors_are_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(CableError) as caught:
        from_csv(path)
    assert str(caught.value) == message.format(path)


def test_unreadable_files(tmp_path: Path) -> None:
    missing = tmp_path / "no.csv"
    with pytest.raises(
        CableError, match=r"cannot read the trajectory .*no\.csv: No such"
    ):
        from_csv(missing)
    with pytest.raises(CableError, match="cannot read the trajectory"):
        from_csv(tmp_path)
    binary = tmp_path / "motion.csv"
    for content in (b"\xff\xfe\x00\x81", b"\x89PNG\r\n\x1a\n\x00\x00", b"PK\x03\x04"):
        binary.write_bytes(content)
        with pytest.raises(CableError, match=r"is no text|there is no column"):
            from_csv(binary)


ROWS = [(0.0, 0.0), (0.25, 0.125), (0.5, -0.25), (0.75, 0.5)]


@pytest.mark.parametrize("unit", ["rad", "mrad", "deg", "rev"])
@pytest.mark.parametrize("clock", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("style", ["{}_{}", "{} [{}]", "{} ({})"])
def test_units_are_converted_by_the_name_of_the_column(
    tmp_path: Path, unit: str, clock: str, style: str
) -> None:
    names = style.format("time", clock), style.format("Angle", unit)
    factors = CLOCK.factors[clock], ANGLE.factors[unit]
    lines = [f"{t / factors[0]!r},{a / factors[1]!r}" for t, a in ROWS]
    found = from_csv(write(tmp_path, "\n".join([",".join(names), *lines])))
    assert found.times == pytest.approx([t for t, _ in ROWS])
    assert found.angles == pytest.approx([a for _, a in ROWS])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("above", ["", "sep={}", "# recorded at 20 \N{DEGREE SIGN}C"])
def test_forms_that_spreadsheets_write_read_the_same(
    tmp_path: Path, encoding: str, separator: str, decimal: str, end: str, above: str
) -> None:
    if separator == decimal:
        return
    lines = [("time_s", "angle_rad", "note", "")]
    lines += [(*(f"{x}".replace(".", decimal) for x in row), "", "") for row in ROWS]
    text = [above.format(separator)] * bool(above)
    text += [separator.join(line) for line in lines]
    path = tmp_path / "motion.csv"
    path.write_bytes(end.join([*text, separator * 3, ""]).encode(encoding))
    found = from_csv(path)
    assert found.times == tuple(t for t, _ in ROWS)
    assert found.angles == tuple(a for _, a in ROWS)
