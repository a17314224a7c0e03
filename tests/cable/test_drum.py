"""The rope on the drums at the ends of a path that lengthens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable._conduit import packed_parameters

PRETENSION = 100.0


class Rope:
    """A straight rope of some length [m] between two drums."""

    def __init__(self, strain: float, length: float = 1.0, **keys: float) -> None:
        self.cable = Cable(
            friction=0.1,
            conduit=(Section(length, math.inf),),
            segments=1,
            axial_stiffness=PRETENSION / strain,
            pretension=PRETENSION,
            **keys,  # type: ignore[arg-type]
        )
        self.prm = packed_parameters(self.cable)
        self.length = layout.node_length(self.prm, 1).copy()
        kernel.expect_change(self.prm)
        kernel.expect_lengthening(self.prm)
        self.state = np.zeros(kernel.state_size(1))
        self.work = np.empty(kernel.work_size(1))
        kernel.initialize(self.prm, 1, 0.0, 0.0, self.state)
        self.given = 0.0  # work of both ends

    @property
    def tension(self) -> float:
        return float(layout.tensions(self.state, 1)[0])

    @property
    def heat(self) -> float:
        return float(self.state[2])

    @property
    def stored(self) -> float:
        prm = self.prm.copy()
        tension = layout.tensions(self.state, 1)
        moving_path.set_unstretched_lengths(prm, 1, tension, self.length)
        return kernel.stored_energy(prm, 1, self.state)

    def drums(self) -> np.ndarray:
        """Return the memory of both drums."""
        return np.stack([layout.drum(self.state, 1, end) for end in range(2)])

    def unstretched(self) -> float:
        """Return all rope, in the piece and on the drums less what lay there [m]."""
        cable, tension = self.cable, layout.tensions(self.state, 1)
        strain = tension / cable.axial_stiffness
        bedded = np.maximum(tension, 0.0) + cable.bedding_tension
        strain += cable.bedding_strain * tension / bedded
        own = float(np.sum(self.length / (1.0 + strain)))
        for mounted, owed, *layers in self.drums():
            own += sum(layers[1::2]) - mounted - owed
        return own

    def turn(self, proximal: float, distal: float, yields: float = 0.0) -> None:
        """Take the ends to places [m]; the proximal one yields so much [m/N]."""
        before, new = self.state.copy(), np.empty_like(self.state)
        tension = layout.tensions(before, 1)
        none = np.zeros(2)
        moving_path.carry(
            self.prm, 1, tension, self.length, self.length, none, none, none
        )
        kernel.expect_yielding(self.prm, yields, 0.0)
        kernel.advance(self.prm, 1, before, proximal, distal, 1e-3, new, self.work)
        self.state = new
        moved = new[:2] - before[:2]
        mean = 0.5 * np.maximum(layout.tensions(new, 1), 0.0)
        mean += 0.5 * np.maximum(tension, 0.0)
        self.given += mean[1] * moved[1] - mean[0] * moved[0]


def wander(seed: int, steps: int, knots: int = 8) -> np.ndarray:
    """Return places of both ends and a yield of the first one (steps, 3)."""
    random = np.random.default_rng(seed)
    at = np.linspace(0.0, 1.0, knots + 1)
    fine = np.linspace(0.0, 1.0, steps)
    rows = [
        np.interp(fine, at, np.append(0.0, random.uniform(-0.03, 0.03, knots)))
        for _ in range(2)
    ]
    return np.stack([rows[0], rows[0] + 0.2 * rows[1], np.full(steps, 2e-6)], 1)


TERMS: list[dict[str, float]] = [{}, {"bedding_strain": 0.01}]


@pytest.mark.parametrize("terms", TERMS, ids=str)
@given(seed=st.integers(0, 2**31), strain=st.sampled_from([0.005, 0.05, 0.2]))
@settings(max_examples=10)
def test_drums_give_back_the_rope_that_they_took(
    terms: dict[str, float], seed: int, strain: float
) -> None:
    """Also where an end gives way within a step, for better or worse."""
    rope = Rope(strain, **terms)
    whole, heat = rope.unstretched(), 0.0
    for proximal, distal, yields in wander(seed, 400):
        rope.turn(proximal, distal, yields)
        assert rope.unstretched() == pytest.approx(whole, rel=1e-9)
        assert rope.heat >= heat
        heat = rope.heat
        assert np.all(np.abs(rope.drums()[:, 1]) < 1e-4)


@pytest.mark.parametrize("terms", TERMS, ids=str)
@pytest.mark.parametrize("strain", [0.005, 0.05, 0.2])
def test_work_on_two_drums_is_stored_or_heat(
    strain: float, terms: dict[str, float]
) -> None:
    """To an error that falls with the square of the step."""
    missing = []
    for steps in (400, 1600):
        rope = Rope(strain, **terms)
        start = rope.stored
        for proximal, distal, _ in wander(3, steps):
            rope.turn(proximal, distal)
        missing.append(abs(rope.given - (rope.stored - start) - rope.heat))
    assert rope.heat > 1e-3 * strain
    assert missing[0] < 5e-3 * rope.heat
    assert missing[1] < 0.15 * missing[0] + 1e-7 * rope.heat


def test_rope_that_was_only_taken_in_leaves_no_trace() -> None:
    """Layers of any strains come off in the reverse order, at any speed."""
    rope = Rope(0.05)
    random = np.random.default_rng(2)
    for _ in range(5):
        for u in np.append(-random.uniform(0.0, 0.05, 30), 0.0):
            rope.turn(u, 0.0)
        # Rounding is all that is left on the drum.
        assert rope.tension == pytest.approx(PRETENSION, rel=1e-9)
        assert np.all(np.abs(rope.drums()) < 1e-9)


def eased_loop(strain: float, steps: int) -> np.ndarray:
    """Return two turns of rope paid out and length of path, that eases as it winds."""
    turn = 2.0 * np.pi * np.arange(2 * steps + 1) / steps
    paid = 0.05 * np.sin(turn)
    return np.stack([paid, 0.4 + paid + 0.2 * strain * (1.0 - np.cos(turn))], 1)


def work_on_coulomb_drum(strain: float, friction: float, steps: int) -> float:
    """Return the work of the second turn on a rope that rubs all around a drum [J].

    Pieces of rope lie on a drum of 20 mm at tensions within the cone of the capstan
    equation about that at the outlet, and slip to it where they would leave it.
    """
    stiffness, radius, cut = PRETENSION / strain, 0.02, 5e-4
    own, pull, work = 0.4 / (1.0 + strain), PRETENSION, 0.0
    wound, held = np.full(400, cut), np.full(400, PRETENSION)
    path = eased_loop(strain, steps)
    for k in range(1, len(path)):
        moved = path[k] - path[k - 1]
        ends = np.cumsum(wound * (1.0 + held / stiffness))
        if moved[0] < 0.0:
            taken = -moved[0] / (1.0 + pull / stiffness)
            wound, held = np.append(taken, wound), np.append(pull, held)
            own -= taken
        else:
            left = np.clip((ends - moved[0]) / (wound * (1.0 + held / stiffness)), 0, 1)
            own += float(np.sum(wound * (1.0 - left)))
            wound, held = (wound * left)[left > 0.0], held[left > 0.0]
        around = np.cumsum(wound * (1.0 + held / stiffness)) / radius
        reach = np.exp(np.minimum(friction * around, 50.0))
        low, high = 0.0, 20.0 * PRETENSION
        for _ in range(30):
            now = 0.5 * (low + high)
            slipped = np.clip(held, now / reach, now * reach)
            out = float(np.sum(wound * (slipped - held))) / stiffness
            free = own + out / (1.0 + now / stiffness)
            longer = stiffness * (path[k, 1] - free) > now * free
            low, high = (now, high) if longer else (low, now)
        held, own = slipped, free
        if k > steps:
            work += 0.5 * (pull + now) * (moved[1] - moved[0])
        pull = now
    return work


@pytest.mark.parametrize("strain", [0.005, 0.2])
def test_a_drum_loses_what_coulomb_friction_around_it_takes(strain: float) -> None:
    """Even where nothing else rubs: wound at one tension, rope leaves at another."""
    rope, steps = Rope(strain, 0.4), 250
    heat = []
    for paid, length in eased_loop(strain, steps)[1:]:
        before, now = rope.length, np.full(2, 0.5 * length)
        tension, new = layout.tensions(rope.state, 1), np.empty_like(rope.state)
        moving_path.carry(
            rope.prm, 1, tension, before, now, now - before, np.zeros(1), np.zeros(1)
        )
        kernel.advance(rope.prm, 1, rope.state, paid, 0.0, 1e-3, new, rope.work)
        rope.state, rope.length = new, now
        heat.append(rope.heat)
    lost = heat[-1] - heat[steps - 1]
    assert lost == pytest.approx(work_on_coulomb_drum(strain, 10.0, steps), rel=0.05)
    assert 0.8 < work_on_coulomb_drum(strain, 0.3, steps) / lost < 0.9
