"""Trajectories from CSV files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
        ("", "{}, line 1: there is no column 'time_s'."),
        (
            "time,angle_rad\n" + GOOD,
            "{}, line 1: there is no column 'time_s'; did you mean to rename 'time'?",
        ),
        (
            "time_s,angle_deg\n" + GOOD,
            "{}, line 1: there is no column 'angle_rad'; "
            "did you mean to rename 'angle_deg'?",
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
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(CableError, match="is not a CSV text file"):
        from_csv(binary)
