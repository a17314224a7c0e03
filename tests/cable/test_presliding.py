"""Friction on bristles: the tensions of every step obey its law."""

from __future__ import annotations

import numpy as np
import pytest

from cable.random_cables import cable_of, motion_of
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import packed_parameters, rest_state

CYCLING = (63, 144, 159, 177, 216, 360, 442, 486, 804, 1234)
"""Seeds of cables for which guessing all choices at once cycles in some step."""
DRAGGED = ("load_independent", "seals")
SLACK = (5, 22, 31, 62, 186)
"""Seeds of cables with drag that go slack."""


def largest_misfit(
    seed: int, *, pinched: bool, term: str = "presliding", samples: int = 60
) -> float:
    """Return what a segment's tensions differ by from its bristles' force, relative.

    Args:
        seed: of cable and motion.
        pinched: whether the ends yield by random amounts (implicit ends).
        term: of the cable, without viscosity; it has bristles besides.
        samples: steps of the motion.
    """
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term)
    if not cable.bristle_length:
        cable = cable.replace(bristle_length=10 ** rng.uniform(-5, -3))
    proximal, distal = motion_of(rng, cable)
    n, prm = cable.segments, packed_parameters(cable)
    state, work = rest_state(cable), np.empty(kernel.work_size(n))
    new, worst = state.copy(), 0.0
    for u in zip(proximal[:samples], distal[:samples], strict=True):
        yields = 10.0 ** rng.uniform(-1.0, 2.0, 2) * layout.node_compliance(prm, n)[0]
        if pinched:
            kernel.expect_yielding(prm, *yields)
        assert kernel.advance(prm, n, state, *u, 1e-3, new, work) == kernel.OK
        tension = np.maximum(layout.tensions(new, n), 0.0)
        misfit = np.abs(np.diff(tension) - layout.bristle_forces(new, n)).max()
        worst = max(worst, misfit / max(tension.max(), cable.pretension, 1.0))
        state[:] = new
    return float(worst)


@pytest.mark.parametrize("seed", [*range(20), *CYCLING])
def test_a_segment_carries_what_its_bristles_hold(seed: int) -> None:
    assert largest_misfit(seed, pinched=True) < 1e-9


@pytest.mark.parametrize("term", DRAGGED)
@pytest.mark.parametrize("seed", SLACK)
def test_drag_holds_slack_cable_by_its_bristles(term: str, seed: int) -> None:
    """It is not laid evenly, as cable is that nothing holds."""
    assert largest_misfit(seed, pinched=False, term=term) < 1e-9


@pytest.mark.study
def test_of_three_thousand_cables_every_one_does() -> None:
    """With drag, seeds 1141 (load_independent) and 806 (seals) are known to differ.

    The cause is not known.
    """
    for seed in range(3000):
        assert largest_misfit(seed, pinched=seed % 2 == 0) < 1e-9, seed
