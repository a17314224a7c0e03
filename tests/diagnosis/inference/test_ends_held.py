"""Forces at both ends, both ends held: a brake, or a bench whose conduit moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Bench, Dataset, Noise, Trial
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.datasets._trials import Instruments
from cc_mujoco.diagnosis import Options, load, run_inference
from cc_mujoco.diagnosis._rig.records import prepare
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from diagnosis.rigs import alone

DT = 0.004
CELLS = Instruments("load cells", "load cells")
NOISE = {
    "motor_angle_rad": Noise(2e-5, 0.0, "declared"),
    "joint_angle_rad": Noise(2e-5, 0.0, "declared"),
    "motor_torque_nm": Noise(0.02, 0.0, "declared"),
    "joint_torque_nm": Noise(0.02, 0.0, "declared"),
}
LABELS = {"motor_angle_rad": "drum_rad", "joint_angle_rad": "drum_rad"}


def brake(bench: Bench, duration: float, drag: float = 0.0) -> Dataset:
    """Return trials of a drum that turns to and fro under a cable with held ends."""
    cable = bench.cables[0].replace(viscous_friction=drag)
    drive = Transmission((cable,), bench.motor_radius, bench.joint_radius)
    random = np.random.default_rng(4)
    time = np.arange(0.0, duration, DT)
    trials = []
    for k, rate in enumerate((1.5, 4.0, 9.0)):
        drum = 0.5 * np.sin(rate * time)
        played = drive.replay(DT, motor_angle=drum, joint_angle=drum)
        noise = random.normal(0.0, 0.02, (2, time.size))
        trials.append(
            Trial(
                f"trial_{k}",
                time,
                drum,
                played.motor_torque + noise[0],
                drum,
                played.joint_torque + noise[1],
                (slice(0, time.size),),
                DT,
                path=f"trial_{k}.csv",
                labels=LABELS,
            )
        )
    return Dataset(tuple(trials), noise=NOISE, instruments=CELLS)


def test_one_column_may_be_the_angle_of_both_ends(tmp_path: Path) -> None:
    time = DT * np.arange(500)
    drum = 0.4 * np.sin(3.0 * time)
    speed = np.cos(3.0 * time)
    rows = np.array([time, drum, 60 + 20 * np.tanh(9 * speed), 60 - 20 * speed]).T
    head = "time_s,drum_rad,tension_proximal_n,tension_distal_n"
    np.savetxt(tmp_path / "run.csv", rows, "%.7f", ",", header=head, comments="")
    bench = Bench.of(alone(tmp_path))
    toml = "[columns.motor_angle_rad]\nname = 'drum_rad'\n"
    (tmp_path / "dataset.toml").write_text(toml + toml.replace("motor", "joint"))
    dataset, findings = load(tmp_path / "run.csv", None, bench)
    assert not errors(findings)
    assert dataset.ends_held and dataset.instruments == CELLS


def test_held_ends_have_no_ratio_no_zero_and_no_clock_between_them(
    tmp_path: Path,
) -> None:
    bench = Bench.of(alone(tmp_path))
    recorded = brake(bench, 1.0)
    held = replace(bench, ends_held=recorded.ends_held)
    records, _ = prepare(recorded, held)
    usual = {p.name for p in baseline_parameters(bench, records, {}, CELLS)}
    free = {p.name for p in baseline_parameters(held, records, {}, CELLS)}
    assert usual - free == {"joint_angle_offset", "clock_offset", "joint_radius"}
    hidden = SimulatedRig(held, records, 4, instruments=CELLS).library.hidden
    assert "both ends are held" in hidden["pulley_eccentricity"]
    assert "load cells" in hidden["joint_gravity"]


@pytest.mark.study
def test_drag_under_held_ends_is_named(tmp_path: Path) -> None:
    bench = Bench.of(alone(tmp_path))
    suspects = Options(("viscous_friction", "load_independent_friction", "backlash"))
    found = run_inference(brake(bench, 8.0, drag=10.0), bench, suspects).diagnosis
    assert [effect.id for effect in found.missing] == ["viscous_friction"]
    (drag,) = found.effects[0].parameters.values()
    assert drag.value == pytest.approx(10.0, rel=0.05)
    assert "ends held" in found.instruments
    assert "dead zone" not in found.statement
