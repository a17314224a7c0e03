"""Springs at the ends of a cable, from measured curves."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section, fit_soft_end, replay
from cc_mujoco.errors import CableError

PULL = np.linspace(0.0, 200.0, 41)


def stretched(compliance, hardening, pull):
    if hardening == 0.0:
        return compliance * pull
    return compliance * np.log1p(hardening * pull) / hardening


@pytest.mark.parametrize("first", [0, 5])
@pytest.mark.parametrize("hardening", [0.0, 1e-4, 0.02, 1.0])
def test_a_curve_of_the_law_gives_its_parameters(hardening, first):
    extension = 0.01 + stretched(3e-4, hardening, PULL)
    found = fit_soft_end(extension[first:], PULL[first:])
    assert found.compliance == pytest.approx(3e-4, rel=2e-3)
    assert found.hardening == pytest.approx(hardening, rel=5e-3, abs=1e-6)
    assert found.residual < 1e-4
    assert found.loss == 0.0


def test_the_loop_of_a_cable_is_the_loop_that_was_measured():
    """The end spring of a replay as the specimen, with noise of 1 %."""
    rope = Cable(
        friction=0.0, pretension=0.0, axial_stiffness=1e9, segments=3,
        conduit=(Section(1.0, np.inf),), end_compliance=2e-4, end_hardening=0.03,
        end_loss=0.3,
    )  # fmt: skip
    cycle = np.concatenate([PULL, PULL[-2::-1]])
    still = np.zeros(cycle.size)
    way = replay(rope, 1e-3, u_proximal=still, tension_distal=cycle).u_distal
    top = PULL.size
    noise = 1e-2 * way.max() * np.sin(np.arange(top)) * (PULL[1] / 200.0)
    found = fit_soft_end(
        way[:top] + noise, PULL, unloading=(way[top - 1 :], cycle[top - 1 :])
    )
    assert found.compliance == pytest.approx(2e-4, rel=2e-2)
    assert found.hardening == pytest.approx(0.03, rel=3e-2)
    assert found.loss == pytest.approx(0.3, abs=5e-3)
    again = rope.replace(
        end_compliance=found.compliance, end_hardening=found.hardening,
        end_loss=found.loss,
    )  # fmt: skip
    other = replay(again, 1e-3, u_proximal=still, tension_distal=cycle).u_distal
    assert np.abs(other - way).max() < 0.01 * way.max()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((PULL[::-1], PULL), "must rise together"),
        ((PULL[:3], PULL[:3]), "4 or more numbers"),
        ((PULL, PULL - 1.0), "no force below 0"),
        ((np.sqrt(np.arange(41.0)) + 0.2 * (PULL > 100), PULL), "of its range off"),
        ((1e-5 * PULL**2, PULL), "of its range off"),
        ((PULL, np.full(41, 3.0)), "one force, 3 N"),
        ((2.0 * PULL, PULL), r"the compliance is 2; it must be a number in \[0, 1\]"),
    ],
)
def test_other_curves_are_refused(given, message):
    with pytest.raises(CableError, match=message):
        fit_soft_end(*given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tolerance": np.nan}, r"tolerance must be a number in \(0, 1\], not nan"),
        ({"tolerance": -0.1}, "tolerance must be"),
        ({"tolerance": "x"}, "tolerance must be"),
        ({"tolerance": True}, "tolerance must be"),
        ({"unloading": 3}, "unloading must be the pair"),
        ({"unloading": (PULL,)}, "unloading must be the pair"),
        ({"unloading": (PULL, PULL, PULL)}, "unloading must be the pair"),
        ({"unloading": ("a", PULL)}, "extension of the unloading curve must be numb"),
    ],
)
def test_other_arguments_are_refused(given, message):
    with pytest.raises(CableError, match=message):
        fit_soft_end(3e-4 * PULL, PULL, **given)


def test_a_loss_needs_a_loop_from_no_force():
    extension = stretched(3e-4, 0.02, PULL)
    with pytest.raises(CableError, match="begin and end at 50 N and 0 N"):
        fit_soft_end(extension[10:], PULL[10:], unloading=(extension[::-1], PULL[::-1]))
