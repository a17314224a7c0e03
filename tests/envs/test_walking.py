"""The person who walks on the ground, and what the exoskeleton changes."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from cc_mujoco.cable import Cable
from cc_mujoco.envs import WALKING
from cc_mujoco.envs._strides import Stride, StrideMeter, mean_stride
from cc_mujoco.envs._walking import WalkingEnv
from cc_mujoco.errors import CableError
from cc_mujoco.human import WalkingPolicy
from cc_mujoco.human._gait import GAIT_ANGLES
from cc_mujoco.human._walking_body import CABLE, POLICY

ANKLE = 2


def walked(env: WalkingEnv, duration: float) -> list[dict]:
    """Walk with the default assistance and return what was seen."""
    env.reset(seed=0)
    seen, over = [], False
    while not over and len(seen) < round(duration / 0.004):
        *_, over, _, info = env.step(env.assistance())
        seen.append(info)
    assert not over, "the person fell"
    return seen


@pytest.fixture(scope="module")
def alone() -> tuple[Stride, list[dict]]:
    env = WalkingEnv("none")
    seen = walked(env, 6.0)
    return mean_stride(env.strides[1:]), seen


def test_a_person_walks_like_one_and_is_held_by_the_ground_alone(alone) -> None:
    stride, seen = alone
    print(f"step {stride.step_length} m, {stride.step_time} s")
    assert 0.4 < stride.step_length.min() and stride.step_length.max() < 0.9
    assert 0.4 < stride.step_time.min() and stride.step_time.max() < 0.75
    assert np.ptp(stride.step_length) < 0.1
    ground = np.mean([info["ground_n"].sum() for info in seen[250:]])
    assert ground == pytest.approx(WalkingEnv("none").body.weight, rel=0.05)
    assert 0.0 <= min(info["ground_n"].min() for info in seen)
    angle = np.array([info["joint_angle_rad"][0, 1] for info in seen[500:]])
    assert -1.4 < angle.min() < -0.7  # the knee bends in swing


def test_what_a_lossless_rope_gives_the_person_need_not(alone) -> None:
    env = WalkingEnv("ideal")
    walked(env, 7.0)
    helped, own = mean_stride(env.strides[3:]), alone[0]
    ankle = [one.positive_work[:, ANKLE].sum() for one in (own, helped)]
    print(f"positive work of the ankles {ankle[0]:.1f} J, helped {ankle[1]:.1f} J")
    assert ankle[1] < 0.9 * ankle[0]
    assert (0.0 < helped.assistance).all()
    assert (helped.assistance < helped.motors).all()
    assert helped.length == pytest.approx(own.length, rel=0.1)


def test_the_conduit_takes_the_capstan_share_of_a_pull() -> None:
    seen = walked(WalkingEnv("cable"), 2.5)
    motor, heel = (
        np.array([info[f"tension_{end}_n"] for info in seen[125:]])
        for end in ("motor", "heel")
    )
    left = np.exp(-CABLE.friction * CABLE.wrap)
    pulled = motor > 100.0
    assert pulled.sum() > 50
    share = heel[pulled] / motor[pulled]
    assert share.min() == pytest.approx(left, rel=1e-6)  # the motor winds
    assert share.max() == pytest.approx(1.0 / left, rel=1e-6)  # the ankle pulls it out


def test_strides_add_up_work_and_steps() -> None:
    meter = StrideMeter()
    person = np.array([[3.0, -2.0, 0.0], [0.0, 0.0, 1.0]])
    for number in range(41):
        if number % 10 == 0:
            leg = number // 10 % 2
            meter.strike(leg, 0.05 * number, np.array([0.6, 1.2][:: 1 if leg else -1]))
        meter.add(person, np.array([1.0, 0.0]), np.array([-1.0, 2.0]), 0.05)
    stride = meter.strides[-1]
    assert stride.time == pytest.approx(1.0)
    assert stride.step_time == pytest.approx([0.5, 0.5])
    assert stride.step_length == pytest.approx([0.6, 0.6])
    assert stride.positive_work == pytest.approx(np.maximum(person, 0.0))
    assert stride.negative_work == pytest.approx(np.minimum(person, 0.0))
    assert stride.assistance == pytest.approx([1.0, 0.0])
    assert stride.motors == pytest.approx([0.0, 2.0])
    assert stride.metabolic_power == pytest.approx(4.0 / 0.25 + 2.0 / 1.2)


def test_the_environment_is_registered_and_repeats_itself() -> None:
    env = gymnasium.make(WALKING, transmission="none", duration=0.04)
    found = []
    for _ in range(2):
        env.reset(seed=3)
        steps = [env.step(np.zeros(2, np.float32)) for _ in range(10)]
        found.append(np.array([step[0] for step in steps]))
        assert [step[3] for step in steps] == [False] * 9 + [True]
    np.testing.assert_array_equal(*found)
    assert env.observation_space.contains(found[0][-1])
    with pytest.raises(CableError, match="takes no options"):
        env.reset(options={"friction": 0.1})


def test_a_policy_survives_its_file(tmp_path) -> None:
    policy = WalkingPolicy.read(POLICY)
    policy.write(tmp_path / "again.safetensors")
    again = WalkingPolicy.read(tmp_path / "again.safetensors")
    np.testing.assert_array_equal(again.table(), policy.table())
    angle, _, _ = policy.desired(np.array([0.7]))
    assert angle[0, 1] == pytest.approx(GAIT_ANGLES["knee"](0.7), abs=0.4)
    (tmp_path / "other").write_bytes(b"no policy")
    with pytest.raises(CableError, match="no walking policy"):
        WalkingPolicy.read(tmp_path / "other")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"transmission": "rope"}, "transmission"),
        ({"adaptation": 2.0}, "adaptation must be a number in"),
        ({"cable": Cable(path="open", route="x")}, "guided"),
    ],
)
def test_what_means_nothing_is_refused(given: dict, message: str) -> None:
    with pytest.raises(CableError, match=message):
        WalkingEnv(**given)
