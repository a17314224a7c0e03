"""A jolted motion keeps the promises of every trajectory."""

from __future__ import annotations

import numpy as np

from cc_mujoco.human import Perturbed, Sine, Tremor, Walk


def test_a_bump_is_smooth_and_is_of_the_size_given() -> None:
    base = Sine(amplitude=0.2)
    motion = Perturbed(base, size=0.1).sample(6.0, 1e-3, np.random.default_rng(1))
    plain = base.sample(6.0, 1e-3, np.random.default_rng(1))
    bump = motion.angle - plain.angle
    assert np.abs(bump[motion.time < 1.0]).max() == 0.0
    assert np.isclose(np.abs(bump).max(), 0.1, rtol=1e-3)
    slope = np.gradient(motion.angle, 1e-3)
    assert np.abs(slope - motion.velocity)[1:-1].max() < 2e-3
    bend = np.gradient(motion.velocity, 1e-3)
    assert np.abs(bend - motion.acceleration)[1:-1].max() < 1.0


def test_a_tremor_begins_smoothly_and_has_its_size_and_frequency() -> None:
    base = Sine(amplitude=0.2)
    motion = Tremor(base, size=0.05, low=6.0, high=6.0).sample(
        4.0, 1e-3, np.random.default_rng(1)
    )
    shake = motion.angle - base.sample(4.0, 1e-3, np.random.default_rng(1)).angle
    assert shake[0] == 0.0
    late = shake[motion.time > 1.0]
    assert np.isclose(np.abs(late).max(), 0.05, rtol=1e-3)
    assert abs(np.count_nonzero(np.diff(np.sign(late))) - 36) <= 1
    slope = np.gradient(motion.angle, 1e-3)
    assert np.abs(slope - motion.velocity)[1:-1].max() < 1e-2
    bend = np.gradient(motion.velocity, 1e-3)
    assert np.abs(bend - motion.acceleration)[1:-1].max() < 1.0


def test_only_the_jolted_joint_of_a_walk_moves_otherwise() -> None:
    walk = Walk()
    motion = Perturbed(walk, "ankle").sample(4.0, 1e-3, np.random.default_rng(0))
    plain = walk.sample(4.0, 1e-3, np.random.default_rng(0))
    for joint, own in motion.companions.items():
        same = np.array_equal(own.angle, plain.companions[joint].angle)
        assert same == (joint != "ankle")
