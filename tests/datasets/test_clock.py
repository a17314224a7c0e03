"""Time: gaps are not filled, and uneven samples are resampled evenly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import load
from diagnosis.bench import loaded, one, only_fix, recording, write


@pytest.mark.parametrize(
    ("rows", "sentence"), [(0, "no rows of data"), (1, "one row of data")]
)
def test_no_row_and_one_row(tmp_path: Path, rows: int, sentence: str) -> None:
    columns = {name: values[:rows] for name, values in recording(1.0).items()}
    dataset, findings = loaded(tmp_path, columns)
    assert dataset.trials == () and sentence in only_fix(findings).statement


def test_an_excluded_trial_is_not_read(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", recording(2.0))
    (tmp_path / "b.csv").write_text("")
    (tmp_path / "dataset.toml").write_text("[trials.b]\nexclude = true\n")
    dataset, findings = load(tmp_path)
    assert [trial.name for trial in dataset.trials] == ["a"]
    assert not errors(findings)


def test_one_bad_file_does_not_hide_the_others(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", recording(2.0))
    (tmp_path / "b.csv").write_text("")
    (tmp_path / "c.csv").write_text("time,angle\n0,1\n")
    dataset, findings = load(tmp_path)
    assert [trial.name for trial in dataset.trials] == ["a"]
    assert [finding.trial for finding in errors(findings)] == ["b", "c"]


def test_nothing_is_filled_in_where_readings_are_missing(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"][3000:3400] = np.nan
    columns["motor_torque_nm"][7000] = np.inf
    trial = one(tmp_path, columns)
    assert trial.segments == (slice(0, 3000), slice(3400, 7000), slice(7001, 10_000))
    _, findings = loaded(tmp_path, columns)
    assert {f.channel for f in findings} == {"joint_angle_rad", "motor_torque_nm"}
    columns["joint_angle_rad"][:5000] = np.nan
    _, findings = loaded(tmp_path, columns)
    assert "lacks 5000 of 10000" in only_fix(findings).statement
    columns["joint_angle_rad"][:] = np.nan
    dataset, findings = loaded(tmp_path, columns)
    assert dataset.trials == () and errors(findings)


@pytest.mark.parametrize("last", [10_000, 9_999])
def test_a_sensor_that_fails_leaves_what_it_read_before(
    tmp_path: Path, last: int
) -> None:
    """One that reads again is no such failure, and a trial of gaps is refused."""
    columns = recording()
    columns["joint_torque_nm"][4000:last] = np.nan
    dataset, findings = loaded(tmp_path, columns)
    (finding,) = (each for each in findings if "usable readings" in each.statement)
    assert finding.channel == "joint_torque_nm"
    if last < 10_000:
        assert finding.severity == "error"
    else:
        (trial,) = dataset.trials
        assert trial.segments == (slice(0, 4000),)
        assert finding.severity == "doubt"
        assert "did the sensor fail at 8 s?" in finding.statement


def test_nothing_is_filled_in_across_gaps(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"][4000:] += 0.5
    trial = one(tmp_path, columns)
    assert trial.segments == (slice(0, 4000), slice(4000, 10_000))
    assert trial.step == pytest.approx(0.002)


def test_short_scraps_are_no_data(tmp_path: Path) -> None:
    columns = recording(4.0)
    columns["joint_angle_rad"][::30] = np.nan
    dataset, findings = loaded(tmp_path, columns)
    assert dataset.trials == ()
    assert "no stretch of 0.2 s" in errors(findings)[-1].statement


def test_masks_and_declared_stretches(tmp_path: Path) -> None:
    columns = recording()
    columns["valid"] = np.ones(10_000)
    columns["valid"][:1000] = 0
    toml = "[trials.run]\nvalid = [[0, 9.9991], [12, 14]]"
    trial = one(tmp_path, columns, toml)
    assert trial.segments == (slice(1000, 5000), slice(6000, 7001))
    _, findings = loaded(tmp_path, columns, "[trials.run]\nvalid = [[50, 60]]")
    assert "no sample in the stretches" in errors(findings)[0].statement
    columns["valid"][:] = 0
    _, findings = loaded(tmp_path, columns)
    assert "is 1 in no row" in errors(findings)[0].statement
    columns["valid"][:] = 1
    columns["valid"][5] = 7
    _, findings = loaded(tmp_path, columns)
    assert "other numbers than 0 and 1" in only_fix(findings).statement


def test_a_temperature_that_nobody_logged_costs_no_trial(tmp_path: Path) -> None:
    columns = recording(5.0)
    columns["temperature_c"] = np.full_like(columns["time_s"], np.nan)
    dataset, findings = loaded(tmp_path, columns)
    assert errors(findings) == []
    assert "temperature_c" not in dataset.channels
    assert any("it is left out" in finding.statement for finding in findings)


def test_ten_samples_per_second_are_too_few(tmp_path: Path) -> None:
    _, findings = loaded(tmp_path, recording(60.0, 10.0))
    found = only_fix(findings)
    assert "10 samples per second are too few" in found.statement
    assert found.channel == "time_s"


def test_time_that_goes_back(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"][6000:] -= 12.0
    dataset, findings = loaded(tmp_path, columns)
    assert dataset.trials == ()
    told = only_fix(findings).statement
    assert "goes back from 11.998 to 0 s at row 6001" in told


def test_time_that_stands_still(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"][:] = 3.0
    assert "in every row" in only_fix(loaded(tmp_path, columns)[1]).statement


def test_few_duplicates_are_dropped_many_are_told(tmp_path: Path) -> None:
    columns = recording()
    twice = {name: np.insert(v, 500, v[500]) for name, v in columns.items()}
    trial = one(tmp_path, twice)
    assert np.array_equal(trial.time, columns["time_s"])
    columns["time_s"] = np.round(columns["time_s"], 2)
    _, findings = loaded(tmp_path, columns)
    assert "write times with more digits" in errors(findings)[0].statement


def test_times_that_are_missing(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"][100] = np.nan
    assert one(tmp_path, columns).samples == 9999
    columns["time_s"][:4000] = np.nan
    assert "lacks 4000 of" in only_fix(loaded(tmp_path, columns)[1]).statement


def test_jitter_is_sampled_anew_and_wild_times_are_refused(tmp_path: Path) -> None:
    columns = recording()
    rng = np.random.default_rng(1)
    truth = columns["time_s"].copy()
    columns["time_s"] = truth + rng.uniform(-4e-4, 4e-4, len(truth))
    columns["joint_torque_nm"] = np.sin(columns["time_s"])
    dataset, findings = loaded(tmp_path, columns)
    (trial,) = dataset.trials
    assert np.diff(trial.time) == pytest.approx(trial.step, rel=1e-6)
    assert trial.joint_torque == pytest.approx(np.sin(trial.time), abs=1e-6)
    assert any("off an even clock" in f.statement for f in findings)
    columns["time_s"] = np.sort(rng.uniform(0.0, 20.0, len(truth)))
    _, findings = loaded(tmp_path, columns)
    assert any("not those of arrival" in f.statement for f in errors(findings))


def test_times_in_other_units_and_with_an_offset(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"] = columns["time_s"] * 1e3 + 1.7e12
    toml = "[columns.time_s]\nunit = 'ms'\noffset = 1.7e12"
    trial = one(tmp_path, columns, toml)
    assert trial.time == pytest.approx(recording()["time_s"], abs=1e-6)


def test_a_second_clock_is_used_where_declared(tmp_path: Path) -> None:
    columns = recording(40.0)
    now = columns["time_s"].copy()
    truth = columns["joint_angle_rad"].copy()
    columns["joint_time_s"] = now * 1.003 + 0.1
    columns["joint_angle_rad"] = np.interp(columns["joint_time_s"], now, truth)
    found = errors(loaded(tmp_path, columns)[1])
    assert any("clock = 'joint_time_s'" in finding.statement for finding in found)
    toml = "[columns.joint_angle_rad]\nclock = 'joint_time_s'"
    trial = one(tmp_path, columns, toml)
    (part,) = trial.segments
    assert trial.joint_angle[part] == pytest.approx(truth[part], abs=2e-3)
    assert part.start == pytest.approx(50, abs=1)


def test_a_declared_delay_is_undone(tmp_path: Path) -> None:
    columns = recording()
    late = {name: values.copy() for name, values in columns.items()}
    late["joint_angle_rad"] = np.roll(columns["joint_angle_rad"], 25)
    toml = "[columns.joint_angle_rad]\ndelay = 0.05"
    trial = one(tmp_path, late, toml)
    (part,) = trial.segments
    assert part.stop in (9975, 9974)
    inner = slice(0, 9970)
    truth = columns["joint_angle_rad"][inner]
    assert trial.joint_angle[inner] == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_rounding_takes_no_reading_from_uneven_times(tmp_path: Path, seed: int) -> None:
    """The resampled segment has as many samples as readings, all of them finite."""
    rng = np.random.default_rng(seed)
    rows = int(rng.integers(900, 1000))
    columns = {name: values[:rows] for name, values in recording(1.0).items()}
    time = columns["time_s"] * rng.uniform(0.9, 1.1)
    step = time[1] - time[0]
    inner = time[1:-1] + 0.3 * step * rng.uniform(-1.0, 1.0, len(time) - 2)
    columns["time_s"] = np.concatenate([time[:1], inner, time[-1:]])
    trial = one(tmp_path, columns)
    (part,) = trial.segments
    assert np.isfinite(trial.motor_torque[part]).all()
    assert part.stop - part.start == len(time)
