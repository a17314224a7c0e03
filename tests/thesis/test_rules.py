"""Validity of the printed rules of the thesis."""

from __future__ import annotations

import numpy as np

from thesis._experiments import rules


def test_opposed_motion_has_steps_that_no_pattern_fits() -> None:
    theirs, ours, contradicted, _ = rules.null_point_error((5, 10), samples=120)
    assert np.all(contradicted > 0.2)
    assert np.all(theirs > 2.0 * ours)
    assert ours[1] < 0.6 * ours[0]


def test_static_friction_of_2_17_fades_with_the_mesh_in_both_solvers() -> None:
    by_rule, ours, memory = rules.static_effect((5, 20))
    for effect in (by_rule, ours):
        assert effect[0] > 3.0 * effect[1]
    assert abs(memory[0] / memory[1] - 1.0) < 0.15


def test_one_sided_velocity_feeds_energy_in_and_the_mean_does_not() -> None:
    one_sided, mean = rules.one_sided_velocity()
    assert one_sided > 0.0
    assert mean == 0.0


def test_front_passes_one_node_a_step_when_solved_once() -> None:
    assert rules.front_speed(8) == 1.0


def test_printed_rule_never_lets_motion_in_from_the_distal_end() -> None:
    assert rules.distal_rule_as_printed(np.geomspace(1.001, 1e6, 50)) == 0
