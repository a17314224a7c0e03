"""Trajectories and tasks by text, as a device plays them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import Hold, TimeTorque
from cc_mujoco.simulation import simulate

SHORT = {"duration": 0.1}


def motion(folder: Path, head: str, end: float = 0.5) -> Path:
    path = folder / "motion.csv"
    rows = [f"{t},{0.1 * t}" for t in np.linspace(0.0, end, 6)]
    path.write_text("\n".join([head, *rows]))
    return path


def test_a_torque_over_time_does_not_follow_the_phase() -> None:
    task = TimeTorque((0.0, 0.1), (0.0, 0.2))
    log = simulate("wrist", "none", trajectory="sine", task=task, duration=0.1)
    np.testing.assert_allclose(
        log["desired_torque_nm"], 2.0 * log["time_s"], atol=1e-12
    )
    phase = np.arctan2(log["phase_sine"], log["phase_cosine"]) / (2 * np.pi)
    np.testing.assert_allclose(phase, 0.5 * log["time_s"], atol=1e-12)


def test_texts_and_objects_are_the_same_task() -> None:
    one, other = (
        simulate("wrist", "none", task=task, trajectory="sine:0.1", **SHORT)
        for task in ("hold:0.3", Hold(0.3))
    )
    assert np.all(one["desired_torque_nm"] == 0.3)
    for name in ("joint_angle_rad", "joint_torque_nm", "desired_torque_nm"):
        assert np.array_equal(one[name], other[name])


def test_degrees_are_degrees_for_the_named_joint(tmp_path: Path) -> None:
    path = motion(tmp_path, "time_s,wrist_angle_deg")
    log = simulate("wrist", "none", trajectory=str(path), **SHORT)
    assert log["reference_angle_rad"][-1] == pytest.approx(np.deg2rad(0.01), rel=1e-3)
    with pytest.raises(CableError, match="no column of the angle of joint 'finger'"):
        simulate("finger", "none", trajectory=path, **SHORT)


def test_a_table_moves_the_companions_of_the_driven_joint(tmp_path: Path) -> None:
    path = tmp_path / "leg.csv"
    lines = ["time_ms,ankle_deg,knee_deg,hip_deg"]
    lines += [f"{t},0,{-20 - t / 50},10" for t in range(0, 300, 50)]
    path.write_text("\n".join(lines))
    log = simulate("ankle", "none", trajectory=path, task="transparent", **SHORT)
    found = np.rad2deg(log["qpos"])
    assert any(np.allclose(column, 10.0, atol=1.0) for column in found.T)
    assert any(np.ptp(column) > 1.0 and column[0] < -19.9 for column in found.T)
    with pytest.raises(CableError, match=r"'knee' from .* stay in \[-2.1, 0.15\]"):
        path.write_text("\n".join(lines).replace("-2", "2"))
        simulate("ankle", "none", trajectory=path, **SHORT)


@pytest.mark.parametrize("ending", ["csv", "tsv"])
def test_a_table_that_ends_early_is_warned_of(tmp_path: Path, ending: str) -> None:
    text = motion(tmp_path, "time_s,angle_rad", 0.05).read_text()
    path = tmp_path / f"short.{ending}"
    path.write_text(text.replace(",", "\t") if ending == "tsv" else text)
    with pytest.warns(CableWarning, match=r"ends after 0.05 s; .* rest of the 0.1 s"):
        simulate("wrist", "none", trajectory=path, **SHORT)
    torque = tmp_path / "torque.csv"
    torque.write_text("time_s,torque_nm\n0,1\n0.05,0\n")
    with pytest.warns(CableWarning, match="torque keeps its last value"):
        simulate("wrist", "none", trajectory="sine", task=torque, **SHORT)


def test_user_objects_are_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_feel.py").write_text(
        "from cc_mujoco.human import Task\n"
        "class Damper(Task):\n"
        "    def torque(self, angle, velocity, phase):\n"
        "        return -0.1 * velocity\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_feel", raising=False)
    log = simulate("wrist", "none", task="my_feel:Damper", **SHORT)
    expected = -0.1 * log["joint_velocity_rad_s"]
    assert np.array_equal(log["desired_torque_nm"], expected)
    assert log.metadata["task"] == "my_feel:Damper"
