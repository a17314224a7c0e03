"""Every number of the packed vectors has a place of its own."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.transmission import PARAMETERS, Cable, packing
from cc_mujoco.transmission.conduit import packed

ROWS_OF_PARAMETERS = (
    packing.segment_angles,
    packing.constant_growth,
    packing.constant_hold,
    packing.constant_drag,
    packing.node_compliance,
    packing.node_stiffness,
    packing.node_length,
    packing.contact_length,
    packing.lengthening,
    packing.half_compliance,
)
ROWS_OF_STATE = (
    packing.tensions,
    packing.slips,
    packing.slip_speeds,
    packing.bristle_forces,
    packing.bristle_stretches,
    packing.contact_ages,
)


@pytest.mark.parametrize("n", [1, 7])
def test_parameters_fill_their_vector_once(n: int) -> None:
    prm = np.arange(float(packing.parameter_size(n)))
    flags = prm[
        [
            packing.CHANGES,
            packing.STATE_DEPENDENT,
            packing.CONSTANT_COULOMB,
            packing.LENGTH,
            packing.GUIDED,
            packing.LENGTHENS,
            packing.YIELD_PROXIMAL,
            packing.YIELD_DISTAL,
            packing.MIXED,
        ]
    ]
    rows = [packing.scalars(prm), flags, *(row(prm, n) for row in ROWS_OF_PARAMETERS)]
    assert sorted(np.concatenate(rows)) == list(prm)


@pytest.mark.parametrize("n", [1, 7])
def test_a_state_fills_its_vector_once(n: int) -> None:
    state = np.arange(float(packing.state_size(n)))
    rows = [state[: packing.STATE_HEADER], *(row(state, n) for row in ROWS_OF_STATE)]
    assert sorted(np.concatenate(rows)) == list(state)


def test_a_packed_cable_keeps_all_its_parameters() -> None:
    values = {
        p.name: 0.5 * (p.low + min(p.high, 3.0))
        for p in PARAMETERS
        if p.name != "static_friction"
    }
    cable = Cable(**values)  # type: ignore[arg-type]
    assert list(packing.scalars(packed(cable))) == list(cable.scalars)
