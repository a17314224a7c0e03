"""Every number of the packed vectors has a place of its own."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import PARAMETERS, Cable, packed_parameters
from cc_mujoco.cable import _layout as layout

ROWS_OF_PARAMETERS = (
    layout.segment_angles,
    layout.constant_growth,
    layout.constant_hold,
    layout.constant_drag,
    layout.node_compliance,
    layout.node_stiffness,
    layout.node_length,
    layout.contact_length,
    layout.lengthening,
    layout.half_compliance,
    layout.carried_path,
    layout.carried_cable,
    layout.clearance_factors,
    layout.seating_factors,
)
ROWS_OF_STATE = (
    layout.tensions,
    layout.slips,
    layout.slip_speeds,
    layout.bristle_forces,
    layout.bristle_stretches,
    layout.contact_ages,
)


@pytest.mark.parametrize("n", [1, 7])
def test_parameters_fill_their_vector_once(n: int) -> None:
    prm = np.arange(float(layout.parameter_size(n)))
    flags = prm[
        [
            layout.BENDS_CHANGE,
            layout.STATE_DEPENDENT,
            layout.CONSTANT_COULOMB,
            layout.LENGTH,
            layout.GUIDED,
            layout.PATH_LENGTHENS,
            layout.YIELD_PROXIMAL,
            layout.YIELD_DISTAL,
            layout.CURVED,
            layout.HELD_PROXIMAL,
            layout.HELD_DISTAL,
            layout.RATIO_PROXIMAL,
            layout.RATIO_DISTAL,
        ]
    ]
    rows = [layout.scalars(prm), flags, *(row(prm, n) for row in ROWS_OF_PARAMETERS)]
    assert sorted(np.concatenate(rows)) == list(prm)


@pytest.mark.parametrize("n", [1, 7])
def test_a_state_fills_its_vector_once(n: int) -> None:
    state = np.arange(float(layout.state_size(n)))
    rows = [state[: layout.STATE_HEADER], *(row(state, n) for row in ROWS_OF_STATE)]
    drums = [layout.drum(state, n, end) for end in range(2)]
    assert sorted(np.concatenate(rows + drums)) == list(state)


def test_a_packed_cable_keeps_all_its_parameters() -> None:
    values = {
        p.name: 0.5 * (p.low + min(p.high, 3.0))
        for p in PARAMETERS
        if p.name != "static_friction"
    }
    cable = Cable(**values)  # type: ignore[arg-type]
    assert list(layout.scalars(packed_parameters(cable))) == list(cable.scalars)
