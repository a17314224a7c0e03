"""Torques that follow from load cells, a motor's current or a known load."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cc_mujoco.datasets import Bench, Dataset
from cc_mujoco.datasets._channels import ANGLES, TORQUES
from cc_mujoco.datasets._data_findings import DataFinding
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Instruments
from cc_mujoco.diagnosis import load
from cc_mujoco.errors import CableError
from diagnosis.bench import Columns, only_fix, recording
from diagnosis.rigs import BENCH, alone

CURRENT = "[rig]\ntorque_constant = 0.5\ngear_ratio = 4\n"


@pytest.fixture(scope="module")
def plain() -> Columns:
    """Return a trial with both torque sensors."""
    return recording(seconds=6.0)


def with_cells(columns: Columns, names: tuple[str, ...] = BENCH.names) -> Columns:
    """Return the same trial with load cells in place of the torque sensors."""
    made = dict(columns)
    for torque, end in (("motor_torque_nm", "proximal"), ("joint_torque_nm", "distal")):
        pull = 0.5 * made.pop(torque) / BENCH.motor_radius
        for name, sign in zip(names, (1.0, -1.0), strict=True):
            made[f"tension_{name}_{end}_n"] = 100.0 + sign * pull
    return made


def read(folder: Path, columns: Columns, toml: str = "", scene: bool = True) -> Dataset:
    return findings_of(folder, columns, toml, scene)[0]


def findings_of(
    folder: Path, columns: Columns, toml: str = "", scene: bool = True
) -> tuple[Dataset, list[DataFinding]]:
    pq.write_table(pa.table(columns), folder / "run.parquet")
    (folder / "dataset.toml").write_text(toml)
    return load(folder, folder / "dataset.toml", BENCH if scene else None)


def test_load_cells_make_the_torque_that_they_pull_by(
    tmp_path: Path, plain: Columns
) -> None:
    toml = "".join(
        f"[columns.tension_{name}_{end}_n]\nnoise = 0.3\n"
        for name in BENCH.names
        for end in ("proximal", "distal")
    )
    dataset, findings = findings_of(tmp_path, with_cells(plain), toml)
    assert dataset.instruments == Instruments("load cells", "load cells")
    (trial,) = dataset.trials
    assert trial.motor_torque == pytest.approx(plain["motor_torque_nm"])
    assert trial.joint_torque == pytest.approx(plain["joint_torque_nm"])
    for name in ("motor_torque_nm", "joint_torque_nm"):
        noise = dataset.noise[name].deviation
        assert noise == pytest.approx(0.3 * np.sqrt(2.0) * BENCH.motor_radius)
    told = [f.statement for f in findings if "load cells" in f.statement]
    assert len(told) == 2 and "tension_agonist_proximal_n" in told[0]


def test_a_single_cable_needs_no_name(tmp_path: Path, plain: Columns) -> None:
    made = dict(plain)
    pull = 40.0 + made.pop("motor_torque_nm")
    made["tension_proximal_n"] = pull
    pq.write_table(pa.table(made), tmp_path / "run.parquet")
    single = Bench.of(alone(tmp_path))
    dataset, _ = load(tmp_path / "run.parquet", None, single)
    assert dataset.instruments == Instruments("load cells", "torque sensor")
    assert dataset.trials[0].motor_torque == pytest.approx(single.motor_radius * pull)


def test_a_torque_sensor_goes_before_load_cells(tmp_path: Path, plain: Columns) -> None:
    dataset = read(tmp_path, {**with_cells(plain), **plain})
    assert dataset.instruments == Instruments()
    assert np.array_equal(
        dataset.trials[0].channel("motor_torque_nm"), plain["motor_torque_nm"]
    )


@pytest.mark.parametrize(
    ("gain", "told"),
    [(1.0, "with which the load cells agree"), (0.8, "0.8 times its torque")],
)
def test_load_cells_beside_a_torque_sensor_are_held_against_it(
    tmp_path: Path, plain: Columns, gain: float, told: str
) -> None:
    made = {**with_cells(plain), **plain}
    for name in BENCH.names:
        made[f"tension_{name}_distal_n"] = made[f"tension_{name}_distal_n"] * gain
    _, findings = findings_of(tmp_path, made)
    said = {f.channel: f.statement for f in findings if "load cells" in f.statement}
    assert told in said["joint_torque_nm"]
    assert "agree" in said["motor_torque_nm"]
    assert "tension_agonist_distal_n" in said["joint_torque_nm"]
    asked = [f.channel for f in findings if f.severity == "doubt"]
    assert asked == ([] if gain == 1.0 else ["joint_torque_nm"])


def test_a_cell_of_one_cable_beside_a_torque_sensor_is_told(
    tmp_path: Path, plain: Columns
) -> None:
    _, findings = findings_of(
        tmp_path,
        {**plain, "tension_agonist_proximal_n": 40.0 + 0.0 * plain["motor_torque_nm"]},
    )
    (told,) = [f.statement for f in findings if "load cells" in f.statement]
    assert told.endswith("compares the former, the load cells not.")


def test_a_current_is_a_torque_by_constant_gear_and_efficiency(
    tmp_path: Path, plain: Columns
) -> None:
    made = dict(plain)
    torque = made.pop("motor_torque_nm")
    made["motor_current_a"] = torque / 2.0
    noise = "[columns.motor_current_a]\nnoise = 0.01\n"
    dataset = read(tmp_path, made, noise + CURRENT)
    assert dataset.instruments == Instruments("motor current", "torque sensor")
    assert dataset.trials[0].motor_torque == pytest.approx(torque)
    assert dataset.noise["motor_torque_nm"].deviation == pytest.approx(0.02)
    found = read(tmp_path, made, CURRENT + "gear_efficiency = 0.8\n").trials[0]
    shares = found.channel("motor_torque_nm")[abs(torque) > 0.1]
    shares = shares / torque[abs(torque) > 0.1]
    power = np.gradient(plain["motor_angle_rad"]) * torque
    assert set(np.round(shares, 6)) == {0.8, 1.25}
    driving = shares < 1.0
    assert np.mean(driving == (power[abs(torque) > 0.1] > 0.0)) > 0.9


def test_a_torque_of_which_nothing_tells_has_to_be_declared(
    tmp_path: Path, plain: Columns
) -> None:
    made = {k: v for k, v in plain.items() if k != "joint_torque_nm"}
    with_name = {**made, "torque_2": plain["joint_torque_nm"]}
    told = only_fix(findings_of(tmp_path, with_name)[1]).statement
    assert "[columns.joint_torque_nm] measured = false" in told
    dataset, findings = findings_of(
        tmp_path, made, "[columns.joint_torque_nm]\nmeasured = false\n"
    )
    assert dataset.instruments == Instruments("torque sensor", None)
    assert dataset.trials[0].joint_torque is None
    assert any("not measured" in finding.statement for finding in findings)
    loaded = read(tmp_path, made, "[rig]\nload_stiffness = 2\nload_rest_angle = -0.1\n")
    assert loaded.instruments == Instruments("torque sensor", "known load")


@pytest.mark.parametrize(
    ("change", "toml", "told"),
    [
        ("current", "", "declare [rig] torque_constant"),
        ("names", "", "[columns.tension_agonist_proximal_n] name = 'tension_a_prox"),
        ("one", "", "measure the other one too"),
        ("push", "", "a cable cannot push"),
    ],
)
def test_what_is_no_torque_is_told_in_a_sentence(
    tmp_path: Path, plain: Columns, change: str, toml: str, told: str
) -> None:
    made = dict(plain)
    if change == "current":
        made["motor_current_a"] = made.pop("motor_torque_nm")
    elif change == "names":
        made = with_cells(plain, ("a", "b"))
    elif change == "one":
        made = {k: v for k, v in with_cells(plain).items() if "antag" not in k}
    else:
        made = with_cells(plain)
        made["tension_agonist_proximal_n"] *= -1.0
    _, findings = findings_of(tmp_path, made, toml)
    wrong = [f for f in findings if f.severity == "error"]
    assert told in wrong[0].statement
    assert all("\n" not in finding.statement for finding in wrong)


@pytest.mark.parametrize(
    ("toml", "told"),
    [
        ("[columns.joint_angle_rad]\nmeasured = false\n", "must be recorded"),
        ("[columns.motor_current_a]\nmeasured = false\n", "needs no table"),
        ("[columns.motor_torque_nm]\nmeasured = 0\n", "must be true or false, not 0"),
        ("[rig]\ntorque_constant = 1\ngear_efficiency = 1.2\n", "no more than 1"),
        ("[rig]\nload_stiffness = -1\n", "at least 0"),
    ],
)
def test_declarations_that_cannot_be_are_refused(
    tmp_path: Path, plain: Columns, toml: str, told: str
) -> None:
    with pytest.raises(CableError, match=told):
        read(tmp_path, plain, toml)


def test_a_channel_that_is_measured_may_say_so(tmp_path: Path, plain: Columns) -> None:
    tables = [f"[columns.{name}]\nmeasured = true\n" for name in (*TORQUES, *ANGLES)]
    data = read(tmp_path, plain, "".join(tables))
    assert data.instruments == TORQUE_SENSORS
