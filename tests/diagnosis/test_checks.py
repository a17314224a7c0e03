"""Bad input by the dozen: each a sentence or a right answer, and good input neither."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.diagnosis.checks import check_ratio
from cc_mujoco.diagnosis.findings import Finding, to_fix
from cc_mujoco.diagnosis.intake import load
from cc_mujoco.diagnosis.noise import resolution
from cc_mujoco.diagnosis.repeatability import period
from cc_mujoco.diagnosis.signs import mechanics
from cc_mujoco.diagnosis.trials import Dataset, Trial
from diagnosis.bench import RATIO, Columns, recording, write

Change = Callable[[Columns], Columns]


def loaded(
    folder: Path, columns: Columns, toml: str = ""
) -> tuple[Dataset, list[Finding]]:
    path = folder / "run.parquet"
    pq.write_table(pa.table(columns), path)
    (folder / "dataset.toml").write_text(toml)
    dataset, findings = load(path, folder / "dataset.toml")
    for finding in findings:
        assert finding.statement.endswith(".") and "\n" not in finding.statement
        assert "run" in finding.statement
    return dataset, findings


def only_fix(findings: list[Finding]) -> Finding:
    (found,) = to_fix(findings)
    return found


def one(folder: Path, columns: Columns, toml: str = "") -> Trial:
    dataset, findings = loaded(folder, columns, toml)
    assert to_fix(findings) == []
    (trial,) = dataset.trials
    return trial


@pytest.mark.parametrize("seed", range(5))
def test_good_data_need_no_repair(tmp_path: Path, seed: int) -> None:
    columns = recording(seed=seed)
    trial = one(tmp_path, columns)
    assert trial.segments == (slice(0, 10_000),)
    assert np.array_equal(trial.joint_torque, columns["joint_torque_nm"])


@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    rate=st.sampled_from((100.0, 200.0, 1000.0)),
    noise=st.sampled_from((0.0, 1.0, 3.0)),
    seconds=st.floats(3.0, 12.0),
)
def test_no_kind_of_good_data_needs_repair(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    rate: float,
    noise: float,
    seconds: float,
) -> None:
    folder = tmp_path_factory.mktemp("data")
    one(folder, recording(seconds, rate, seed, noise))


# --- what is missing --------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "sentence"), [(0, "no rows of data"), (1, "one row of data")]
)
def test_no_row_and_one_row(tmp_path: Path, rows: int, sentence: str) -> None:
    columns = {name: values[:rows] for name, values in recording(1.0).items()}
    dataset, findings = loaded(tmp_path, columns)
    assert dataset.trials == () and sentence in only_fix(findings).statement


def test_one_bad_file_does_not_hide_the_others(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", recording(2.0))
    (tmp_path / "b.csv").write_text("")
    (tmp_path / "c.csv").write_text("time,angle\n0,1\n")
    dataset, findings = load(tmp_path)
    assert [trial.name for trial in dataset.trials] == ["a"]
    assert [finding.trial for finding in to_fix(findings)] == ["b", "c"]


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
    assert dataset.trials == () and to_fix(findings)


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
    assert "no stretch of 0.2 s" in to_fix(findings)[-1].statement


def test_masks_and_declared_stretches(tmp_path: Path) -> None:
    columns = recording()
    columns["valid"] = np.ones(10_000)
    columns["valid"][:1000] = 0
    toml = "[trials.run]\nvalid = [[0, 9.9991], [12, 14]]"
    trial = one(tmp_path, columns, toml)
    assert trial.segments == (slice(1000, 5000), slice(6000, 7001))
    _, findings = loaded(tmp_path, columns, "[trials.run]\nvalid = [[50, 60]]")
    assert "no sample in the stretches" in to_fix(findings)[0].statement
    columns["valid"][:] = 0
    _, findings = loaded(tmp_path, columns)
    assert "is 1 in no row" in to_fix(findings)[0].statement
    columns["valid"][:] = 1
    columns["valid"][5] = 7
    _, findings = loaded(tmp_path, columns)
    assert "other numbers than 0 and 1" in only_fix(findings).statement


# --- time -------------------------------------------------------------------------


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
    assert "write times with more digits" in to_fix(findings)[0].statement


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
    assert any("not those of arrival" in f.statement for f in to_fix(findings))


def test_times_in_other_units_and_with_an_offset(tmp_path: Path) -> None:
    columns = recording()
    columns["time_s"] = columns["time_s"] * 1e3 + 1.7e12
    toml = "[columns.time_s]\nunit = 'ms'\noffset = 1.7e12"
    trial = one(tmp_path, columns, toml)
    assert trial.time == pytest.approx(recording()["time_s"], abs=1e-6)


def test_clocks_that_drift_apart(tmp_path: Path) -> None:
    columns = recording(40.0)
    now = columns["time_s"]
    for name in ("joint_angle_rad", "joint_torque_nm"):
        columns[name] = np.interp(now * 1.003, now, columns[name])
    found = to_fix(loaded(tmp_path, columns)[1])
    assert any("two clocks" in finding.statement for finding in found)


def test_a_sweep_is_not_a_drifting_clock(tmp_path: Path) -> None:
    columns = recording(40.0)
    now = columns["time_s"]
    phase = 2.0 * np.pi * (0.2 * now + 0.03 * now**2)
    columns["motor_angle_rad"] = RATIO * np.sin(phase)
    reach = 0.05
    here, joint = 0.0, np.empty_like(now)
    for k, wanted in enumerate(np.sin(phase)):
        here = min(max(here, wanted - reach), wanted + reach)
        joint[k] = here
    columns["joint_angle_rad"] = joint
    columns["joint_torque_nm"] = 2.0 * joint
    columns["motor_torque_nm"] = (5.0 * (np.sin(phase) - joint) + 2 * joint) / RATIO
    one(tmp_path, columns)


def test_a_second_clock_is_used_where_declared(tmp_path: Path) -> None:
    columns = recording(40.0)
    now = columns["time_s"].copy()
    truth = columns["joint_angle_rad"].copy()
    columns["joint_time_s"] = now * 1.003 + 0.1
    columns["joint_angle_rad"] = np.interp(columns["joint_time_s"], now, truth)
    found = to_fix(loaded(tmp_path, columns)[1])
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


def test_a_delay_that_no_rig_has(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"] = np.roll(columns["joint_angle_rad"], 200)
    found = to_fix(loaded(tmp_path, columns)[1])
    assert any("declare its delay" in finding.statement for finding in found)


# --- signs and units --------------------------------------------------------------

INVERTED = {
    "motor_angle_rad": "invert motor_angle_rad",
    "motor_torque_nm": "invert motor_torque_nm",
    "joint_angle_rad": "invert joint_angle_rad",
    "joint_torque_nm": "invert joint_torque_nm",
}


@pytest.mark.parametrize("channel", INVERTED)
@pytest.mark.parametrize("seed", range(3))
def test_an_inverted_channel_is_found(tmp_path: Path, channel: str, seed: int) -> None:
    columns = recording(seed=seed)
    columns[channel] = -columns[channel]
    told = only_fix(loaded(tmp_path, columns)[1]).statement
    assert INVERTED[channel] in told
    assert one(tmp_path, columns, f"[columns.{channel}]\nsign = -1")


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        (("motor_torque_nm", "joint_torque_nm"), "makes .* of nothing; invert motor"),
        (("motor_torque_nm", "joint_angle_rad"), "invert motor_torque_nm and joint_an"),
    ],
)
def test_two_inverted_channels_are_found(
    tmp_path: Path, channels: tuple[str, ...], sentence: str
) -> None:
    columns = recording()
    for channel in channels:
        columns[channel] = -columns[channel]
    found = only_fix(loaded(tmp_path, columns)[1])
    assert re.search(sentence, found.statement)


def test_both_sides_the_other_way_round_are_as_good(tmp_path: Path) -> None:
    columns = recording()
    for channel in INVERTED:
        columns[channel] = -columns[channel]
    one(tmp_path, columns)


def test_swapped_sides_are_found(tmp_path: Path) -> None:
    columns = recording()
    swapped = {
        name.replace("motor", "?").replace("joint", "motor").replace("?", "joint"): v
        for name, v in columns.items()
    }
    told = only_fix(loaded(tmp_path, swapped)[1]).statement
    assert "swap the motor's columns with the joint's" in told


@pytest.mark.parametrize("kind", ["torque_nm", "angle_rad"])
def test_swapped_columns_of_one_kind_are_found(tmp_path: Path, kind: str) -> None:
    columns = recording()
    motor, joint = f"motor_{kind}", f"joint_{kind}"
    columns[motor], columns[joint] = columns[joint], columns[motor]
    found = to_fix(loaded(tmp_path, columns)[1])
    assert found or mechanics_contradict_scene(tmp_path, columns)


def mechanics_contradict_scene(folder: Path, columns: Columns) -> bool:
    dataset, _ = loaded(folder, columns)
    return bool(check_ratio(dataset.trials[0], RATIO))


@pytest.mark.parametrize("which", ["motor", "joint"])
def test_degrees_on_one_side_are_found(tmp_path: Path, which: str) -> None:
    columns = recording()
    channel = f"{which}_angle_rad"
    columns[channel] = np.degrees(columns[channel])
    found = to_fix(loaded(tmp_path, columns)[1])
    assert any("deg" in f.statement and channel in f.statement for f in found)
    trial = one(tmp_path, columns, f"[columns.{channel}]\nunit = 'deg'")
    assert trial.channel(channel) == pytest.approx(recording()[channel])


def test_degrees_on_both_sides_are_found(tmp_path: Path) -> None:
    columns = recording()
    for channel in ("motor_angle_rad", "joint_angle_rad"):
        columns[channel] = np.degrees(columns[channel])
    found = to_fix(loaded(tmp_path, columns)[1])
    assert {f.channel for f in found} == {"motor_angle_rad", "joint_angle_rad"}


def test_many_turns_are_right_if_declared(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_angle_rad"] *= 20.0
    columns["motor_torque_nm"] /= 20.0
    _, findings = loaded(tmp_path, columns)
    assert "unit = 'deg'" in only_fix(findings).statement
    one(tmp_path, columns, "[columns.motor_angle_rad]\nunit = 'rad'")


def test_millinewtonmetres_are_found(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_torque_nm"] *= 1e3
    told = only_fix(loaded(tmp_path, columns)[1]).statement
    assert "motor_torque_nm is in mNm" in told


def test_one_trial_in_degrees_among_others(tmp_path: Path) -> None:
    for seed in range(4):
        write(tmp_path / f"run{seed}.csv", recording(5.0, 200.0, seed))
    columns = recording(5.0, 200.0, 9)
    columns["motor_angle_rad"] *= 0.1
    columns["joint_angle_rad"] = np.degrees(columns["joint_angle_rad"]) * 0.1
    write(tmp_path / "run9.csv", columns)
    _, findings = load(tmp_path)
    assert {finding.trial for finding in to_fix(findings)} == {"run9"}


def test_ratio_of_a_scene(tmp_path: Path) -> None:
    trial = one(tmp_path, recording())
    assert check_ratio(trial, RATIO) == []
    assert check_ratio(trial, 1.6 * RATIO) == []
    assert "sides are swapped" in check_ratio(trial, 1.0 / RATIO)[0].statement
    assert "sign" in check_ratio(trial, -RATIO)[0].statement
    degrees = check_ratio(trial, RATIO * 57.3)[0].statement
    assert "joint_angle_rad is in degrees" in degrees


def test_power_of_the_bench_is_what_its_friction_takes(tmp_path: Path) -> None:
    trial = one(tmp_path, recording(noise=0.0))
    known = mechanics(trial)
    lost = (known.motor_work - known.joint_work) * np.abs(
        np.diff(trial.motor_angle)
    ).sum()
    assert lost == pytest.approx(
        0.15 * np.abs(np.diff(trial.joint_angle)).sum(), rel=0.1
    )


# --- readings ---------------------------------------------------------------------


@pytest.mark.parametrize("channel", INVERTED)
def test_constant_channels(tmp_path: Path, channel: str) -> None:
    columns = recording()
    columns[channel][:] = 0.3
    found = [f for f in to_fix(loaded(tmp_path, columns)[1]) if f.channel == channel]
    assert "is 0.3 in every row; check the sensor" in found[0].statement


def test_a_locked_joint_is_right_if_declared(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"][:] = 0.3
    one(tmp_path, columns, "[trials.run]\nlocked = 'joint'")


def test_clipped_torque(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_torque_nm"] = np.clip(columns["motor_torque_nm"], -9.0, 0.2)
    found = only_fix(loaded(tmp_path, columns)[1])
    assert "stays at 0.2" in found.statement and "cut off above" in found.statement


def test_a_copy_is_no_repeat(tmp_path: Path) -> None:
    for name in "ab":
        write(tmp_path / f"{name}.csv", recording(3.0))
    dataset, findings = load(tmp_path)
    assert len(dataset.trials) == 1
    assert any("is a copy of" in finding.statement for finding in findings)


def test_like_names_in_two_folders(tmp_path: Path) -> None:
    for seed, name in enumerate("ab"):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "run.csv", recording(3.0, seed=seed))
    dataset, _ = load([tmp_path / "b", tmp_path / "a"])
    assert [trial.name for trial in dataset.trials] == ["b/run", "a/run"]


def test_the_dataset_file_in_the_folder_is_used(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", recording(3.0))
    (tmp_path / "dataset.toml").write_text("[rig]\njoint_radius = 0.1")
    dataset, findings = load(str(tmp_path))
    assert dataset.constants["joint_radius"].value == 0.1
    assert any("dataset.toml" in finding.statement for finding in findings)


# --- noise ------------------------------------------------------------------------


@given(
    step=st.floats(1e-5, 1e-1),
    offset=st.floats(-1.0, 1.0),
    seed=st.integers(0, 99),
)
def test_quantisation_step_is_found(step: float, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    levels = np.cumsum(rng.integers(-2, 3, 2000))
    assert resolution(offset + step * levels) == pytest.approx(step, rel=1e-3)
    assert resolution(rng.standard_normal(2000)) == 0.0


def test_noise_is_what_was_put_in(tmp_path: Path) -> None:
    dataset, _ = loaded(tmp_path, recording(60.0))
    noise = dataset.noise
    assert noise["joint_torque_nm"].deviation == pytest.approx(2e-3, rel=0.1)
    assert noise["motor_torque_nm"].deviation == pytest.approx(1e-3, rel=0.1)
    assert noise["joint_angle_rad"].resolution == pytest.approx(2e-4, rel=1e-3)


def test_noise_in_rests_is_not_the_torque_that_relaxes(tmp_path: Path) -> None:
    columns = recording(30.0)
    rest = columns["time_s"] % 5.0 > 3.0
    rng = np.random.default_rng(0)
    count = len(rest)
    hold = np.where(rest, 0.0, np.sin(2 * np.pi * columns["time_s"]))
    columns["motor_angle_rad"] = hold
    columns["joint_angle_rad"] = hold / RATIO
    columns["joint_torque_nm"] = (
        0.1 * hold
        + np.exp(-(columns["time_s"] % 5.0))
        + 2e-3 * rng.standard_normal(count)
    )
    dataset, _ = loaded(tmp_path, columns)
    noise = dataset.noise["joint_torque_nm"]
    assert noise.source == "holds"
    assert noise.deviation == pytest.approx(2e-3, rel=0.15)


def test_declared_noise_wins(tmp_path: Path) -> None:
    toml = "[columns.motor_torque_nm]\nunit = 'mNm'\nnoise = 7\nresolution = 0.5"
    columns = recording()
    columns["motor_torque_nm"] *= 1e3
    noise = loaded(tmp_path, columns, toml)[0].noise["motor_torque_nm"]
    assert noise.source == "declared"
    assert noise.deviation == pytest.approx(7e-3)
    assert noise.resolution == pytest.approx(5e-4)


def test_repeats_give_the_floor(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for name in "ab":
        columns = recording(10.0, noise=0.0)
        columns["joint_torque_nm"] += 0.02 * rng.standard_normal(5000)
        write(tmp_path / f"{name}.csv", columns)
    (tmp_path / "dataset.toml").write_text("[trials.b]\nrepeat_of = 'a'")
    floor = load(tmp_path)[0].floor["joint_torque_nm"]
    assert floor.source == "repeats"
    assert floor.deviation == pytest.approx(0.02, rel=0.05)


def test_a_repeat_that_is_none(tmp_path: Path) -> None:
    for seed, name in enumerate("ab"):
        write(tmp_path / f"{name}.csv", recording(5.0, seed=seed))
    (tmp_path / "dataset.toml").write_text("[trials.b]\nrepeat_of = 'a'")
    assert "correct repeat_of" in only_fix(load(tmp_path)[1]).statement


@given(length=st.floats(60.0, 400.0))
def test_period_of_a_motion(length: float) -> None:
    angle = np.sin(2.0 * np.pi * np.arange(1500) / length)
    assert period(angle) == pytest.approx(length, rel=2e-3)
    assert period(np.random.default_rng(0).standard_normal(500).cumsum()) is None


# --- size -------------------------------------------------------------------------


def test_long_trials_are_averaged_quickly(tmp_path: Path) -> None:
    count = 500_000
    now = np.arange(count) / 5000.0
    angle = np.sin(now)
    columns = {
        "time_s": now,
        "motor_angle_rad": RATIO * angle,
        "motor_torque_nm": angle / RATIO + 0.02 * np.sign(np.cos(now)),
        "joint_angle_rad": angle,
        "joint_torque_nm": angle,
    }
    start = time.monotonic()
    dataset, findings = loaded(tmp_path, columns)
    assert time.monotonic() - start < 20.0
    (trial,) = dataset.trials
    assert trial.samples <= 120_000
    assert trial.joint_angle == pytest.approx(np.sin(trial.time), abs=1e-5)
    assert any("samples were averaged" in f.statement for f in findings)


def test_hours_at_a_low_rate_are_sampled_all_over(tmp_path: Path) -> None:
    columns = recording(600.0, 250.0)
    columns["joint_angle_rad"][70_000:70_100] = np.nan
    dataset, findings = loaded(tmp_path, columns)
    (trial,) = dataset.trials
    assert trial.samples > 100_000 and trial.rate == pytest.approx(250.0)
    for part in trial.segments:
        assert np.diff(trial.time[part]) == pytest.approx(0.004, abs=1e-9)
        assert np.isfinite(trial.joint_angle[part]).all()
    assert trial.time[-1] > 0.9 * 600.0 and trial.time[0] == 0.0
    assert any("evenly spread stretches" in f.statement for f in findings)


# --- anything ---------------------------------------------------------------------


@settings(max_examples=60)
@given(data=st.data())
def test_any_table_of_numbers_is_data_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("data")
    columns = {name: v.copy() for name, v in recording(2.0, 100.0).items()}
    names = st.sampled_from(sorted(columns))
    for _ in range(data.draw(st.integers(1, 3))):
        values = columns[data.draw(names)]
        start = data.draw(st.integers(0, 199))
        stop = data.draw(st.integers(start, 200))
        values[start:stop] = data.draw(
            st.sampled_from((0.0, np.nan, np.inf, -1e300, 1e9, 1e-300))
        )
    dataset, findings = loaded(folder, columns)
    assert dataset.trials or to_fix(findings)
