"""A lever whose geometry is known from pairs of angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._rig_table import RATIO_KEY, fit_angle_pairs, known_arm
from cc_mujoco.errors import CableError
from diagnosis.rigs import BENCH

RATIO, SLOPE, CURVE = 1.4, 0.3, -0.2
JOINT = np.linspace(-0.8, 0.9, 12)
MOTOR = 0.1 + RATIO * (JOINT + SLOPE * JOINT**2 / 2 + CURVE * JOINT**3 / 3)
PAIRS = np.array([MOTOR, JOINT]).T.tolist()


def test_pairs_give_the_arm_and_the_uncertainty_of_its_ratio() -> None:
    exact = fit_angle_pairs(PAIRS, "here")
    assert exact[RATIO_KEY].value == pytest.approx(RATIO)
    assert known_arm(exact) == pytest.approx((SLOPE, CURVE))
    noise = 0.002 * np.random.default_rng(1).standard_normal(MOTOR.size)
    rough = fit_angle_pairs(np.array([MOTOR + noise, JOINT]).T.tolist(), "here")
    ratio = rough[RATIO_KEY]
    assert abs(ratio.value - RATIO) < 3.0 * ratio.uncertainty < 0.02


def test_a_bench_with_a_known_arm_keeps_the_length_of_its_cables() -> None:
    bench = BENCH.known(fit_angle_pairs(PAIRS, "here"))
    assert bench.following(JOINT) == pytest.approx(MOTOR - 0.1)
    assert bench.carried(MOTOR - 0.1) == pytest.approx(JOINT, abs=1e-4)
    played = bench.replay(0.01, bench.following(JOINT), JOINT)
    pull = played.tension_distal[0] - played.tension_distal[1]
    arm = bench.joint_radius * (1.0 + SLOPE * JOINT + CURVE * JOINT**2)
    assert played.joint_torque == pytest.approx(arm * pull)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("angle_pairs = [[0, 0], [1, 1]]", "2 different joint angles"),
        ("angle_pairs = [[0, 0], [1]]", r"a list of \[motor, joint\] angles"),
        (
            f"angle_pairs = {(np.array(PAIRS) * [-1, 1]).tolist()}",
            "does not follow the motor",
        ),
        (f"joint_radius = 0.1\nangle_pairs = {PAIRS}", "leave `joint_radius` out"),
    ],
)
def test_pairs_that_cannot_be_used_are_refused(
    tmp_path: Path, text: str, sentence: str
) -> None:
    file = tmp_path / "dataset.toml"
    file.write_text(f"[rig]\n{text}\n")
    with pytest.raises(CableError, match=sentence):
        read_dataset_file(file)
