"""Energy extracted from a port: none if it is passive, a known amount if active."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.check_passivity import search
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cc_mujoco.export import (
    LIMB_RANGES,
    Limb,
    WearerEnergy,
    inertia_of,
    limb_of,
    play,
    wearer_bounds,
)
from cc_mujoco.export._passivity import extracted_energy
from study_marks import study_but

Array = NDArray[np.float64]
PHYSICS = 5e-4
FRAME_SKIP = 2
SPRING = 2.0
"""Stiffness of the virtual environment [N m/rad]."""


def held(torque: Callable[[Array, Array], Array], limb: Limb) -> tuple[Array, ...]:
    """Return the motion of a joint released at 0.3 rad, sampled like a device.

    Args:
        torque: Torque of the device by angles and velocities so far, at least one each.
        limb: Limb on the joint, at rest at 0.

    Returns:
        Torque, desired torque, angle and velocity in 2000 samples.
    """
    steps = 2000 * FRAME_SKIP
    angle, velocity, acted = (np.zeros(steps + 1) for _ in range(3))
    angle[0] = 0.3
    for k in range(steps):
        acted[k + 1] = torque(angle[: k + 1], velocity[: k + 1])
        own = -limb.stiffness * angle[k] - limb.damping * velocity[k]
        velocity[k + 1] = velocity[k] + PHYSICS * (acted[k + 1] + own) / limb.inertia
        angle[k + 1] = angle[k] + PHYSICS * velocity[k + 1]
    seen = acted[::FRAME_SKIP], angle[::FRAME_SKIP], velocity[::FRAME_SKIP]
    return seen[0], -SPRING * seen[1], *seen[1:]


def energy(series: tuple[Array, ...]) -> float:
    return float(extracted_energy(*series, FRAME_SKIP * PHYSICS, FRAME_SKIP))


limbs = st.builds(
    Limb,
    stiffness=st.floats(0.2, 30.0),
    damping=st.floats(0.02, 0.5),
    inertia=st.floats(4e-3, 4e-2),
)


@given(limb=limbs, share=st.floats(0.0, 1.0), damping=st.floats(0.0, 0.2))
def test_a_real_spring_with_a_damper_gives_nothing(
    limb: Limb, share: float, damping: float
) -> None:
    """Its stiffness is between zero and that of the virtual environment."""
    series = held(lambda a, v: -share * SPRING * a[-1] - damping * v[-1], limb)
    assert energy(series) < 1e-3 * 0.5 * SPRING * 0.3**2


@given(limb=limbs, share=st.floats(0.1, 0.9))
def test_a_negative_damper_gives_what_it_gives(limb: Limb, share: float) -> None:
    """The energy is the integral of the damper's power over the motion."""
    negative = share * limb.damping
    series = held(lambda a, v: -SPRING * a[-1] + negative * v[-1], limb)
    velocity = series[-1]
    expected = negative * float(np.sum(velocity**2)) * FRAME_SKIP * PHYSICS
    assert energy(series) == pytest.approx(expected, rel=0.05, abs=1e-4)


@given(limb=limbs, late=st.integers(4, 12))
def test_a_late_spring_gives_its_stiffness_times_the_delay(
    limb: Limb, late: int
) -> None:
    """To first order a delay T of a spring k is a damper of -k T."""
    series = held(lambda a, v: -SPRING * a[max(len(a) - 1 - late, 0)], limb)
    square = float(np.sum(series[-1] ** 2)) * FRAME_SKIP * PHYSICS
    expected = SPRING * late * PHYSICS * square
    assert energy(series) == pytest.approx(expected, rel=0.15, abs=1e-4)


@given(place=st.tuples(*(st.floats(0.0, 1.0),) * 3), corner=st.integers(0, 7))
def test_the_worst_is_found_within_the_box_and_at_its_corners(
    place: tuple[float, ...], corner: int
) -> None:
    bounds = np.array([(-1.0, 3.0), (0.0, 1.0), (5.0, 7.0)])
    for aim in (place, tuple(float(corner >> k & 1) for k in range(3))):

        def evaluate(places: Array, aim: tuple[float, ...] = aim) -> WearerEnergy:
            within = (places - bounds[:, 0]) / np.diff(bounds).ravel()
            assert np.all((within >= -1e-12) & (within <= 1.0 + 1e-12))
            loss = np.sum((within - aim) ** 2, axis=1)
            return WearerEnergy(-loss, loss, loss)

        tried, found = search(evaluate, bounds, generations=5)
        assert tried.shape == (6 * 24, 3)
        assert -np.max(found.held) < 0.05
    assert -np.max(found.held) < 1e-12


def test_the_box_of_every_device_can_be_worn() -> None:
    for name in (*LIMB_RANGES, "hand.index_flexor"):
        scene, _, axis = name.partition(".")
        inertia, box = (
            inertia_of(scene, axis or None),
            wearer_bounds(scene, axis or None),
        )
        low, high = (limb_of(end, inertia) for end in box.T)
        assert 0.0 < low.stiffness < high.stiffness
        assert 0.0 < low.damping < high.damping
        assert 0.0 < low.inertia < high.inertia


@pytest.mark.study
def test_devices_that_are_passive_give_nothing_and_one_that_is_not_does() -> None:
    soft, stiff = wearer_bounds("wrist").T
    places = [soft, stiff, [stiff[0], *soft[1:]], [*soft[:2], stiff[2]]]
    wearers = [limb_of(np.array(place), inertia_of("wrist")) for place in places]
    for law in ("ideal", "motor-off"):
        found = play("wrist", law, "spring", wearers)
        assert max(found.held.max(), found.begun.max()) < 1e-4
    swung = play("wrist", "stiction", "spring", wearers)
    assert swung.held.max() > 0.1
    assert swung.velocity.max() > 1.0


@pytest.mark.parametrize("law", study_but(2, ["predictive", "adaptive"]))
def test_a_finger_that_nobody_holds_is_not_swung_up(law: str) -> None:
    found = play("finger", law, "spring", [Limb(0.05, 2.7e-4, 3e-6)])
    assert found.held[0] < 1e-5


def test_friction_believed_too_large_is_learned_before_a_stiff_hand_is_shaken() -> None:
    found = play("wrist", "predictive", "spring", [Limb(30.0, 0.73, 4e-4)], 1.3)
    assert found.held[0] < 0.15  # 0.53 J at a quarter of the rate of learning
