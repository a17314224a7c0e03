"""Axes that share joints are diagnosed from logs of the whole device, by MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco import Plant, simulate
from cc_mujoco.diagnosis import Options, diagnose, run_inference
from cc_mujoco.diagnosis._loading import load
from diagnosis.whole_device import Device, hidden_values, motions, played, record

EXAMPLES = Path(__file__).parents[2] / "scripts" / "examples"
FEW = ("end_compliance", "viscous_friction", "load_independent_friction")
"""Effects that are looked for."""
SLACK = {"pretension": 0.0, "axial_stiffness": 1.0}
"""Values of a cable that hardly pulls."""


def written(folder: Path, columns: dict[str, np.ndarray]) -> Path:
    folder.mkdir()
    path = folder / "log.csv"
    table = np.column_stack(list(columns.values()))
    header = ",".join(columns)
    np.savetxt(path, table, "%.12g", ",", header=header, comments="")
    return path


def test_what_other_axes_pull_at_the_joint_is_taken_off_or_refused(
    tmp_path: Path,
) -> None:
    device = Device.of("bilateral")
    bench = device.benches["right_hip"]
    _, tension, angles, _ = motions(device, "right_hip", 0.3)[0]
    columns = played(device, "right_hip", SLACK, tension, angles, 0.0)
    torque = columns["right_hip.joint_torque_nm"]
    assert np.abs(torque).min() > 0.1  # of the knee's cable
    dataset, findings = load([written(tmp_path / "whole", columns)], None, bench)
    (trial,) = dataset.trials
    assert trial.joint_torque is not None
    assert np.abs(trial.joint_torque).max() < 1e-5 * np.abs(torque).max()
    assert [*trial.tensions] == [
        f"tension_right_hip_flexor_{end}_n" for end in ("proximal", "distal")
    ]
    assert any("right_knee_extensor of another axis" in f.statement for f in findings)

    gone = "tension_right_knee_extensor"
    fewer = {n: c for n, c in columns.items() if not n.startswith(gone)}
    _, findings = load([written(tmp_path / "fewer", fewer)], None, bench)
    wrong = [found.statement for found in findings if found.severity == "error"]
    assert "cable right_knee_extensor of another axis pulls at joint" in wrong[0]
    assert "record its tension" in wrong[0]

    del columns["right_knee.joint_angle_rad"]
    _, findings = load([written(tmp_path / "blind", columns)], None, bench)
    wrong = [found.statement for found in findings if found.severity == "error"]
    assert "has no column 'right_knee_angle_rad'" in wrong[0]

    toml = tmp_path / "dataset.toml"
    toml.write_text('[columns.jiont_angle_rad]\nname = "encoder"\n', encoding="utf-8")
    _, findings = load([tmp_path / "fewer" / "log.csv"], toml, bench)
    wrong = [found.statement for found in findings if found.severity == "error"]
    assert "jiont_angle_rad" in wrong[0] and "joint_angle_rad" in wrong[0]


@pytest.mark.study
@pytest.mark.parametrize(
    ("scene", "axis", "hidden"),
    [
        ("bilateral", "right_hip", "end_compliance"),
        ("hand", "index_extensor", "end_compliance"),
    ],
)
def test_an_effect_that_one_axis_hides_is_named(
    tmp_path: Path,
    scene: str,
    axis: str,
    hidden: str,
) -> None:
    device = Device.of(scene)
    bench = device.benches[axis]
    record(tmp_path, device, axis, hidden, 2.0)
    dataset, _ = load([tmp_path], None, bench)
    found = run_inference(dataset, bench, Options(ids=FEW)).diagnosis
    (named,) = found.missing
    assert named.id == hidden
    wanted = hidden_values(bench, hidden)[hidden]
    assert named.parameters[hidden].value == pytest.approx(wanted, rel=0.1)
    for gap in found.gap.values():
        assert gap.rmse_after < gap.rmse_before


@pytest.mark.study
def test_friction_of_a_cable_to_a_differential_is_named(tmp_path: Path) -> None:
    """Both axes are played; the hip's cable also turns the knee by a fixed tendon."""
    scene = EXAMPLES / "differential.xml"
    plant = Plant(scene, {"extensor.viscous_friction": 40.0})
    trials = ("sine:0.3", "chirp:0.3,high=1.5", "multisine:0.3", "reach:0.3")
    random = np.random.default_rng(0)
    for number, motion in enumerate(trials):
        log = simulate(
            plant, "none", trajectory=motion, task="hip=hold:8,knee=hold:-3",
            seed=number, duration=8.0,
        )  # fmt: skip
        columns = {"time_s": log["time_s"]}
        for axis, cable in (("hip", "extensor"), ("knee", "flexor")):
            for name in ("motor_angle_rad", "joint_angle_rad"):
                columns[f"{axis}.{name}"] = log[f"{axis}.{name}"]
            for end in ("proximal", "distal"):
                name = f"tension_{cable}_{end}_n"
                columns[name] = log[name] + random.normal(0.0, 0.2, len(log))
            torque = 0.02 * log[f"tension_{cable}_proximal_n"]
            columns[f"{axis}.motor_torque_nm"] = torque
            columns[f"{axis}.joint_torque_nm"] = log[f"{axis}.joint_torque_nm"]
        thinned = {name: column[::4] for name, column in columns.items()}
        written(tmp_path / f"t{number}", thinned)
    files = sorted(tmp_path.glob("t*/log.csv"))
    found = diagnose(scene, files, tmp_path / "out", axis="hip")
    assert found.verdict == "named", found.statement
    (effect,) = found.effects
    assert effect.id == "viscous_friction"
    (estimate,) = effect.parameters.values()
    assert estimate.value == pytest.approx(40.0, rel=0.1)
