"""Estimators refuse the cables that their law does not hold for, and no others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cable.terms_on import TERMS_ON
from cc_mujoco.cable import Cable, replay
from cc_mujoco.device import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._tension_slope import wrap_angles
from estimation.runs import CABLE, DT, moving_runs, strokes
from thesis._estimators import FrictionEstimator
from thesis._experiments.online import BendEstimator, StiffnessEstimator

EVERY = Sensors.everywhere(CABLE, 1.0)
OF_SLOPE = {
    "friction": lambda cable: FrictionEstimator(cable, EVERY, start=0.2),
    "bend": lambda cable: BendEstimator(cable, EVERY, start=0.75),
}
SEEN_AT_ENDS_OR_REST = ("proximal seal", "distal seal", "ageing at once")
"""Terms that are refused although the middle of a cable that moves is free of them."""


def off_the_slope(cable: Cable) -> float:
    """Largest error of ln T over moving segments, by the coefficient of the instant."""
    proximal, distal = strokes(4.0)
    motion = replay(cable, DT, u_proximal=proximal, u_distal=distal, profile=True)
    assert motion.tension is not None and motion.direction is not None
    heat = np.concatenate([[0.0], motion.dissipated[:-1]])
    time = DT * np.arange(1, proximal.size + 1)
    changed = cable.friction_drift * time + cable.friction_heating * heat
    angle, worst = np.diff(wrap_angles(cable)), 0.0
    for tension, direction, factor in zip(
        motion.tension, motion.direction, 1.0 + changed, strict=True
    ):
        for first, last, sign in moving_runs(direction):
            # Ends of a run at the end of the cable may turn inside, unseen.
            inner = slice(max(first, 1), min(last, cable.segments - 1))
            told = np.diff(np.log(np.maximum(tension, 1e-9)))[inner]
            law = sign * cable.friction * factor * angle[inner]
            taut = np.minimum(tension[:-1], tension[1:])[inner] > 5.0
            worst = max(worst, np.max(np.abs(told - law)[taut], initial=0.0))
    return worst


def refuses(estimator: Callable[[Cable], object], cable: Cable) -> bool:
    try:
        estimator(cable)
    except CableError as error:
        assert "must be 0 (off)" in str(error)
        return True
    return False


@pytest.mark.parametrize("name", TERMS_ON)
def test_a_term_is_refused_where_it_bends_the_slope(name: str) -> None:
    # Heat that does not leave is the energy that is dissipated.
    cable = CABLE.replace(**TERMS_ON[name]).replace(cooling_time=1e9)
    bent = off_the_slope(cable) > 1e-3
    for estimator in OF_SLOPE.values():
        assert refuses(estimator, cable) == (bent or name in SEEN_AT_ENDS_OR_REST)


@pytest.mark.parametrize("on", TERMS_ON.values(), ids=TERMS_ON)
def test_stiffness_is_told_only_where_it_stays(on: dict[str, float]) -> None:
    cable = CABLE.replace(**on)
    changes = any(
        name.startswith(("bedding", "clearance", "stress", "bristle", "clamp"))
        or name.endswith(("hardening", "loss"))
        for name in on
    )
    assert refuses(lambda c: StiffnessEstimator(c, EVERY, start=4e3), cable) == changes
