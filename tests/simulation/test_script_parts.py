"""A long script is worked out in parts, with the bits of the whole."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass, fields

import numpy as np
import pytest

import cc_mujoco.simulation._reference_motion as reference_motion
from cc_mujoco import Plant, simulate
from cc_mujoco.human import (
    TRAJECTORIES,
    Motion,
    Perturbed,
    Recorded,
    Sine,
    Trajectory,
    Walk,
)
from cc_mujoco.human._by_text import Centred
from cc_mujoco.human._motion import SampledMotion
from cc_mujoco.simulation._worn_device import WornDevice

STEPS, DT = 1000, 0.01
ROWS = 128


class Summed(Trajectory):
    """A trajectory that cannot be evaluated at some of its times alone."""

    def _motion(self, time: np.ndarray, duration: float, rng: object) -> Motion:
        angle = 1e-4 * np.cumsum(np.ones_like(time))
        return Motion(time, angle, time, time, np.zeros_like(time))


@dataclass(frozen=True)
class SummedSine(Sine):
    """A trajectory of which only the base is pointwise."""

    def _motion(
        self, time: np.ndarray, duration: float, rng: np.random.Generator
    ) -> Motion:
        return Summed()._motion(time, duration, rng)


LEG = Walk().on_joints({"knee_r": (-2.0, 2.0), "hip_l": (-2.0, 2.0)})
RECORDED = Recorded(
    (0.0, 1.0, 2.0, 4.0), (0.0, 0.2, 0.1, 0.3), "a", (("b", (0.0, 1.0, 0.0, 1.0)),)
)
SOURCES: dict[str, tuple[Trajectory, bool]] = {
    **{name: (one, True) for name, one in TRAJECTORIES.items()},
    "leg": (LEG, True),
    "recorded": (RECORDED, True),
    "centred": (Centred(TRAJECTORIES["reach"], 0.3), True),
    "perturbed": (Perturbed(Sine()), False),
    "summed": (Summed(), False),
    "override": (SummedSine(), False),
}


def arrays(motion: Motion) -> dict[str, np.ndarray]:
    found = {
        one.name: value
        for one in fields(motion)
        if isinstance(value := getattr(motion, one.name), np.ndarray)
    }
    for name, other in motion.companions.items():
        found |= {f"{name}.{key}": value for key, value in arrays(other).items()}
    return found


@pytest.mark.parametrize("name", SOURCES)
def test_parts_of_a_motion_have_the_bits_of_the_whole(name: str) -> None:
    source, is_pointwise = SOURCES[name]
    assert source.is_pointwise == is_pointwise
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    whole = arrays(source.sample(STEPS * DT, DT, rng))
    sampled = SampledMotion(source, STEPS * DT, DT, other, ROWS)
    starts = range(0, STEPS + 1, ROWS)
    parts = [
        arrays(sampled.part(first, min(first + ROWS, STEPS + 1))) for first in starts
    ]
    for key, values in whole.items():
        joined = np.concatenate([part[key] for part in parts])
        assert joined.tobytes() == values.tobytes()
    assert rng.bit_generator.state == other.bit_generator.state


@pytest.mark.parametrize(
    ("device", "motion"), [("ankle", "walk"), ("wrist", "reach"), ("wrist", Summed())]
)
def test_episode_of_many_parts_is_that_of_one(
    monkeypatch: pytest.MonkeyPatch, device: str, motion: str | Trajectory
) -> None:
    def play() -> object:
        return simulate(device, "pi", trajectory=motion, duration=0.1, seed=3)

    whole = play()
    monkeypatch.setattr(reference_motion, "PART_STEPS", 20)  # the last has one step
    assert play() == whole


def test_memory_of_a_script_does_not_grow_with_the_duration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reference_motion, "PART_STEPS", 500)
    plant = Plant("ankle")

    def peak(duration: float) -> int:
        exo = WornDevice(plant.description, plant.model(), "walk", None, duration)
        tracemalloc.start()
        script = exo.author.write(np.random.default_rng(0))
        for number in range(script.count):
            script.part(number)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(1.0)  # what is made once
    assert peak(16.0) < 1.1 * peak(4.0)
