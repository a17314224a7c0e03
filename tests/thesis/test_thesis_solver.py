"""The thesis's own solver, and the kernel held against it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.motions import motion
from cc_mujoco.cable import TERMS, Cable, Section, replay
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.errors import CableError
from thesis._literal_solver import (
    Constraint,
    ThesisCable,
    by_fsolve,
    play,
    segment_motion,
    sign_pattern_system,
    sign_patterns,
    solve,
)

CABLE = Cable(friction=0.1, conduit=(Section(1.2, 0.2), Section(0.8, 0.4)))
STRETCH = CABLE.pretension * CABLE.length / CABLE.axial_stiffness


def whole(u_proximal: float, u_distal: float, n: int) -> list[Constraint]:
    return [
        Constraint("displacement", 0, u_proximal),
        Constraint("displacement", n, u_distal),
    ]


@pytest.mark.parametrize("n", range(2, 30))
def test_there_are_four_times_n_less_one_patterns(n: int) -> None:
    patterns = sign_patterns(n)
    assert len(patterns) == len({tuple(p) for p in patterns}) == 4 * (n - 1)
    for pattern in patterns:
        turns = np.count_nonzero(np.diff(pattern[pattern != 0.0]))
        assert turns <= 1 and np.count_nonzero(pattern == 0.0) <= 1


def test_two_segments_in_the_order_of_the_listing() -> None:
    found = [tuple(p) for p in sign_patterns(2)]
    assert found == [(-1, -1), (1, 1), (1, -1), (-1, 1)]
    assert [tuple(p) for p in sign_patterns(1)] == [(-1,), (1,)]


def test_rows_are_the_capstan_ratio_and_the_stretch() -> None:
    mesh = Mesh.of(CABLE.replace(segments=4))
    pattern = np.array([1.0, 1.0, 0.0, -1.0])
    ends = [Constraint("tension", 0, 7.0), Constraint("displacement", 4, 0.3)]
    tension, u = np.split(np.linalg.solve(*sign_pattern_system(mesh, pattern, ends)), 2)
    ratio = np.exp(np.cumsum(mesh.angle * pattern))
    assert tension == pytest.approx(7.0 * np.concatenate([[1.0], ratio]))
    place = np.linspace(0.0, 1.0, 1001)[:, None]
    inside = tension[:-1] * np.exp(mesh.angle * pattern * place)
    stretch = np.trapezoid(inside, place, axis=0) * mesh.length / mesh.stiffness
    assert np.diff(u) == pytest.approx(stretch, rel=1e-6)
    assert u[-1] == pytest.approx(0.3)


@given(
    st.integers(2, 12),
    st.floats(0.01, 0.3),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
    st.sampled_from([-1.0, 1.0]),
)
@settings(max_examples=60, deadline=None)
def test_one_pattern_at_most_is_consistent(
    n: int, friction: float, proximal: float, distal: float, slip_direction: float
) -> None:
    """Uniqueness, 2.3.3, from any state of mass motion."""
    mesh = Mesh.of(CABLE.replace(segments=n, friction=friction))
    start = np.linalg.solve(
        *sign_pattern_system(mesh, np.full(n, slip_direction), whole(0.0, 0.01, n))
    )
    before = start[n + 1 :]
    consistent = 0
    for pattern in sign_patterns(n):
        ends = whole(1e-4 * proximal, 0.01 + 1e-4 * distal, n)
        after = np.linalg.solve(*sign_pattern_system(mesh, pattern, ends))[n + 1 :]
        consistent += np.array_equal(np.sign(segment_motion(before, after)), pattern)
    assert consistent <= 1


def test_the_last_correct_pattern_is_tried_first() -> None:
    mesh, patterns = Mesh.of(CABLE.replace(segments=10)), sign_patterns(10)
    before = np.linspace(0.0, 0.02, 11)
    first = solve(mesh, before, whole(0.1, 0.12, 10), patterns)
    assert first.contradiction == 0.0
    assert patterns[0] is first.pattern and len(patterns) == 36
    again = solve(mesh, first.displacement, whole(0.2, 0.22, 10), patterns[:1])
    assert again.contradiction == 0.0


def test_the_general_solver_agrees_in_mass_motion() -> None:
    n = 5
    cable = CABLE.replace(segments=n)
    mesh, patterns = Mesh.of(cable), sign_patterns(n)
    drag = np.linspace(0.0, 0.2, 300)
    played = play(cable, drag, drag + np.minimum(drag, 0.03))
    u = played.displacement[-1]
    guess = np.concatenate([played.tension[-1], u])
    for k in range(1, 6):
        ends = whole(drag[-1] + 5e-5 * k, played.displacement[-1, -1] + 6e-5 * k, n)
        expected = solve(mesh, u, ends, patterns)
        guess = by_fsolve(mesh, u, ends, guess)
        tension, u = np.split(guess, 2)
        assert tension == pytest.approx(expected.tension, rel=1e-6)
        assert u == pytest.approx(expected.displacement, rel=1e-6)


@pytest.mark.parametrize("name", ["distal_locked", "proximal_locked"])
def test_kernel_and_thesis_meet_as_the_mesh_is_refined(name: str) -> None:
    """Partial motion, reversals and mass motion with one end driven."""
    proximal, distal = motion(name, STRETCH, samples=500)
    distal = distal - STRETCH
    apart = []
    for n in (10, 20, 40):
        thesis_solver = play(
            CABLE.replace(segments=n), u_proximal=proximal, u_distal=distal
        )
        ours = replay(
            CABLE.replace(segments=n), 1e-3, u_proximal=proximal, u_distal=distal
        )
        assert thesis_solver.contradicted == 0
        difference = thesis_solver.tension[:, 0] - ours.tension_proximal
        apart.append(float(np.sqrt(np.mean(difference**2))))
    assert apart[-1] < 1e-3 * thesis_solver.tension.max()
    assert apart[0] / apart[1] > 2.0 and apart[1] / apart[2] > 2.0


def test_motion_enters_from_both_ends_and_leaves_the_middle_alone() -> None:
    thesis_solver = ThesisCable(CABLE.replace(segments=20))
    for k in range(1, 11):
        thesis_solver.step(-5e-5 * k, 5e-5 * k)
    proximal, distal = thesis_solver.last_moving
    assert proximal > 1 and distal > 1 and proximal + distal < 21
    assert np.all(thesis_solver.tension[proximal : 21 - distal] == CABLE.pretension)
    assert np.all(thesis_solver.tension[:proximal] > CABLE.pretension)
    assert np.all(thesis_solver.tension[-distal:] > CABLE.pretension)


def test_without_solving_again_motion_advances_one_node_a_step() -> None:
    pull = -0.01 * np.ones(15)
    still = np.zeros(15)
    cable = CABLE.replace(segments=12)
    slow = play(cable, pull.cumsum(), still, resolve=False)
    fast = play(cable, pull.cumsum(), still)
    assert list(slow.last_moving[:10, 0]) == list(range(2, 12))
    assert fast.last_moving[0, 0] == 13


def test_a_slack_cable_shows_no_tension() -> None:
    pushed = 0.001 * np.arange(1.0, 30.0)
    played = play(CABLE.replace(segments=5), pushed, np.zeros_like(pushed))
    assert np.all(played.tension[-1] == 0.0)


COULOMB = ("friction", "static_friction")
# Springs that harden or hold are compliances of the ends, which are refused.
ALONE = [
    n for n in TERMS if not n.endswith(("_hardening", "_loss")) and n not in COULOMB
]


@pytest.mark.parametrize("name", ALONE)
def test_terms_that_chapter_2_does_not_know_are_refused(name: str) -> None:
    cable = CABLE.replace(**{name: 1e-3})
    if TERMS[name].acts_on == "pulley":
        Mesh.of(cable)
        return
    with pytest.raises(CableError, match=f"`{name}` is 0.001; it must be 0"):
        Mesh.of(cable)


def test_static_friction_that_weakens_is_refused() -> None:
    weakening = CABLE.replace(static_friction=0.5, critical_slip_distance=1e-3)
    with pytest.raises(CableError, match="it or `critical_slip_distance` must be 0"):
        Mesh.of(weakening)
