"""The rig of closed forms: what a tendon over posts does, and the scene alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tendon

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis._rig.records import with_lead_in
from rig.posts import KNUCKLE_RADIUS, WINCH_RADIUS, Tendon, path, played

DT = 1e-3
FINGER = Bench.of(scene_path("finger"))


def test_while_it_slides_the_ratio_is_that_of_a_capstan() -> None:
    motor = np.linspace(0.0, 0.6, 800)
    pulled, given = played(Tendon(), DT, motor, np.zeros(800))
    ratio = pulled[-1] / WINCH_RADIUS / (given[-1] / KNUCKLE_RADIUS)
    # 4.7e-8 off, and 2.9e-9 with a quarter of the step.
    assert np.log(ratio) == pytest.approx(0.22 * path(0.0).wrap.sum(), rel=1e-7)


def test_no_energy_comes_of_a_cycle() -> None:
    turn = np.linspace(0.0, 4.0 * np.pi, 4000)
    motor = 0.3 * (1.0 - np.cos(turn))
    joint = 0.4 * np.sin(turn)
    motor = motor + KNUCKLE_RADIUS / WINCH_RADIUS * joint
    pulled, given = played(Tendon(), DT, motor, joint)
    half = slice(2000, 4000)
    work = np.trapezoid(pulled[half], motor[half])
    work -= np.trapezoid(given[half], joint[half])
    assert work > 0.01


@pytest.mark.parametrize(
    ("hidden", "told"),
    [
        ({}, {}),
        ({"drag": 30.0}, {"load_independent_friction": 30.0}),
        ({"viscosity": 300.0}, {"viscous_friction": 300.0}),
        ({"compliance": 2e-5}, {"end_compliance": 2e-5}),
    ],
)
def test_the_scene_is_the_same_tendon_by_other_equations(
    hidden: dict[str, float], told: dict[str, float]
) -> None:
    time = DT * np.arange(3000)
    joint = 0.4 * np.sin(3.0 * time)
    motor = FINGER.following(joint) + 0.25 * np.sin(2.0 * time) ** 2
    rig = Tendon(friction=0.2, stiffness=2000.0, pretension=5.0, **hidden)
    cables = tuple(c.replace(segments=24, **told) for c in FINGER.cables)
    known = replace(FINGER, cables=cables).replay(DT, motor, joint)
    for shown, other in zip(
        played(rig, DT, motor, joint),
        (known.motor_torque, known.joint_torque),
        strict=True,
    ):
        assert np.abs(shown - other).max() < 3e-3 * np.abs(shown).max()


def test_a_rig_comes_to_its_first_sample_as_the_diagnosis_lets_it() -> None:
    """A winch keeps what it wound on the way; by another way it stays 2e-3 off."""
    angles = next(a for notes, _, *a in tendon.motions(FINGER, 1.5) if notes == "held")
    ends = tendon.shown("closed forms", FINGER, {}, (angles[0], angles[1]), 1.0)
    led = with_lead_in(*angles, FINGER.following, tendon.FINE)
    cables = tuple(c.replace(segments=24, **tendon.OTHERWISE) for c in FINGER.cables)
    bench = replace(FINGER, cables=cables)
    known = bench.replay(tendon.STEP / tendon.FINE, *led)
    for shown, other in (
        (ends[0], known.motor_torque),
        (ends[1], known.joint_torque),
    ):
        off = shown - other[:: tendon.FINE][-shown.size :]
        assert abs(off.mean()) < 1e-3 * np.abs(shown).max()
