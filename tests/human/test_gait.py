"""The harmonic gait profiles and the walking trajectory made of them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD, Walk, assistance
from cc_mujoco.human._gait import GAIT_MOMENTS, Harmonics
from shared_folder import SHARED

ROOT = Path(__file__).parents[2]
DATA = SHARED / "data" / "gait"
PHASE = np.linspace(0.0, 1.0, 2001)


@pytest.fixture
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "fit_gait", ROOT / "scripts" / "fit_gait.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _profiles(path: Path) -> dict[str, np.ndarray]:
    """Read a table that the script wrote, (harmonics, 2) by profile."""
    rows = np.genfromtxt(path, delimiter=",", dtype=None, encoding="utf-8")[1:]
    names = dict.fromkeys(row[0] for row in rows)
    return {
        name: np.array([row[1:] for row in rows if row[0] == name], dtype=float)
        for name in names
    }


def test_harmonics_and_derivative() -> None:
    series = Harmonics(((0.5, 0.0), (1.0, -2.0), (0.25, 0.75)))
    turn = 2 * np.pi * PHASE
    expected = (
        0.5
        + np.cos(turn)
        - 2 * np.sin(turn)
        + 0.25 * np.cos(2 * turn)
        + 0.75 * np.sin(2 * turn)
    )
    np.testing.assert_allclose(series(PHASE), expected, atol=1e-13)
    slope = np.gradient(expected, PHASE)[1:-1]
    np.testing.assert_allclose(series.derivative()(PHASE)[1:-1], slope, atol=1e-3)


@pytest.mark.parametrize("name", ["ankle", "knee", "hip"])
def test_scalars_and_arrays_give_the_same_bits(name: str) -> None:
    expected = [GAIT_ANGLES[name](float(phase)) for phase in PHASE]
    assert all(type(value) is float for value in expected)
    assert GAIT_ANGLES[name](PHASE).tolist() == expected
    assert GAIT_ANGLES[name](PHASE[::-3]).tolist() == expected[::-3]


def test_ranges_are_those_of_level_walking() -> None:
    degrees = {
        name: np.rad2deg(profile(PHASE)) for name, profile in GAIT_ANGLES.items()
    }
    assert degrees["ankle"].min() == pytest.approx(-8.8, abs=0.5)
    assert degrees["ankle"].max() == pytest.approx(14.4, abs=0.5)
    # The knee bends most in swing; the hip is most extended before it.
    assert 0.6 < PHASE[degrees["knee"].argmin()] < 0.8
    assert -75 < degrees["knee"].min() < -55
    assert 0.4 < PHASE[degrees["hip"].argmin()] < 0.6


def test_assistance_is_a_push_off() -> None:
    shape = assistance(PHASE)
    assert shape.min() >= 0
    assert shape.max() == pytest.approx(1, abs=1e-5)
    assert 0.5 < PHASE[shape.argmax()] < 0.55
    assert shape[(PHASE < 0.2) | (PHASE > 0.7)].max() < 0.01


def test_walk_has_the_gait_period_and_companions() -> None:
    motion = Walk().sample(10.0, 1e-3, np.random.default_rng(0))
    assert sorted(motion.companions) == ["ankle", "hip", "knee"]
    assert np.array_equal(motion.companions["ankle"].angle, motion.angle)
    # The smooth start costs half its duration.
    cycles = np.unwrap(motion.phase, period=1.0)
    assert cycles[-1] == pytest.approx((10.0 - 0.5) / GAIT_PERIOD)
    later = motion.time > 1
    for name, joint in motion.companions.items():
        profile = GAIT_ANGLES[name]
        expected = profile(motion.phase)
        np.testing.assert_allclose(joint.angle, expected, rtol=5e-3)
        np.testing.assert_allclose(
            np.gradient(joint.angle, 1e-3)[later][:-1],
            joint.velocity[later][:-1],
            atol=1e-3,
        )
        assert joint.velocity[0] == 0


def test_the_amplitude_of_a_walk_is_the_peak_of_the_ankle_rounded_up() -> None:
    peak = np.abs(GAIT_ANGLES["ankle"](np.linspace(0.0, 1.0, 10_001))).max()
    assert Walk.amplitude == np.ceil(1e3 * peak) / 1e3


def test_walk_scales_all_joints() -> None:
    rng = np.random.default_rng(0)
    full, half = Walk(), Walk(amplitude=Walk().amplitude / 2)
    a, b = full.sample(3.0, 0.01, rng), half.sample(3.0, 0.01, rng)
    np.testing.assert_allclose(a.angle, 2 * b.angle)
    np.testing.assert_allclose(a.companions["hip"].angle, 2 * b.companions["hip"].angle)


@pytest.mark.shared
def test_fit_reproduces_the_shipped_table(script: ModuleType, tmp_path: Path) -> None:
    period, table, errors = script.fit(DATA)
    assert period == GAIT_PERIOD
    assert errors["ankle"] < 0.5
    assert max(errors["knee"], errors["hip"]) < 0.5
    assert errors["assistance"] < 0.01
    moments = {f"{name}_moment": own for name, own in GAIT_MOMENTS.items()}
    for name, own in (GAIT_ANGLES | moments).items():
        np.testing.assert_allclose(table[name], own.coefficients, atol=2e-6)
    target = tmp_path / "table.csv"
    script.main([str(DATA), "--table", str(target)])
    head, _ = target.read_text(encoding="utf-8").split("profile,")
    assert script.TABLE.read_text(encoding="utf-8").startswith(head)
    written, shipped = _profiles(target), _profiles(script.TABLE)
    assert written.keys() == shipped.keys()
    for name, found in written.items():
        np.testing.assert_allclose(found, shipped[name], atol=2e-6)


@pytest.mark.shared
def test_shipped_profile_fits_the_measured_ankle() -> None:
    walk = np.genfromtxt(DATA / "ankle_walk_tidy.csv", delimiter=",", names=True)
    cycle = (walk["t_s"] >= 0.599) & (walk["t_s"] < 1.83)
    phase = (walk["t_s"][cycle] - 0.60) / GAIT_PERIOD
    error = np.rad2deg(GAIT_ANGLES["ankle"](phase)) - walk["ankle_r_deg"][cycle]
    assert np.sqrt(np.mean(error**2)) < 0.5


def test_fit_recovers_a_made_up_walk(
    script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(0.5, 3.5, 1 / 60)
    phase = (time - 0.60) / 1.1
    ankle = 5 + 10 * np.cos(2 * np.pi * phase) + 3 * np.sin(6 * np.pi * phase)
    np.savetxt(
        tmp_path / "ankle_walk_tidy.csv",
        np.column_stack(
            [time, ankle, 2 * ankle, -ankle, 10 * ankle, 20 * ankle, -10 * ankle]
        ),
        delimiter=",",
        header="t_s,ankle_r_deg,knee_r_deg,hip_r_deg,ankle_r_moment_Nm,"
        "knee_r_moment_Nm,hip_r_moment_Nm",
        comments="",
    )
    fraction = np.linspace(0, 1, 101)
    np.savetxt(
        tmp_path / "ankle_assistance_shape.csv",
        np.column_stack([fraction, np.sin(np.pi * fraction) ** 4]),
        delimiter=",",
        header="gait_cycle_fraction,assistance_normalised",
        comments="",
    )
    target = tmp_path / "table.csv"
    script.main([str(tmp_path), "--table", str(target)])
    printed = capsys.readouterr().out
    assert "RMS errors: ankle 0.00, knee 0.00, hip 0.00" in printed
    assert printed.startswith("period 1.1 s")
    found = _profiles(target)
    expected = np.zeros((9, 2))
    expected[0, 0], expected[1, 0], expected[3, 1] = np.deg2rad([5, 10, 3])
    np.testing.assert_allclose(found["ankle"], expected, atol=1e-6)
    moment = 10 * np.rad2deg(expected)
    for name, share in (("ankle", 1.0), ("knee", 2.0), ("hip", -1.0)):
        fitted = found[f"{name}_moment"]
        np.testing.assert_allclose(fitted, share * moment, atol=1e-6)
    # sin^4 is the square of (1 - cos) / 2.
    root = found["assistance_root"]
    assert np.abs(root[:2, 0]) == pytest.approx([0.5, 0.5], abs=1e-4)
