"""At half the time step: changes of numbers that are known, and a real one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import pyarrow as pa
import pytest

from cc_mujoco.design import (
    Plan,
    StudySpec,
    carry_out,
    make_plan,
    read_objectives,
)
from cc_mujoco.design._follow_up import (
    MAX_CHECKED_DESIGNS,
    TOLERATED_CHANGE,
    check_timestep,
)
from cc_mujoco.design._report_text import timestep_sentence

MEASURED = ("rms_torque_error", "peak_tension")
PLAN = make_plan(
    StudySpec(
        "wrist",
        {"friction": "0.1:0.3:40"},
        metrics=MEASURED,
        subject_to=["peak_tension<=100"],
    )
)
FREE = replace(PLAN, limits=())
GOALS = read_objectives(MEASURED[:1])


def table_of(errors: list[float | None]) -> pa.Table:
    return pa.table({MEASURED[0]: errors, MEASURED[1]: [50.0] * len(errors)})


def run(found: Callable[[float], float | None]) -> Callable[[Plan], pa.Table]:
    def carried_out(plan: Plan) -> pa.Table:
        assert plan.protocol.timestep == 0.5 * PLAN.protocol.timestep
        assert set(plan.protocol.metrics) <= set(MEASURED)
        rows = [
            {MEASURED[0]: found(float(d["friction"])), MEASURED[1]: 50.0}
            for d in plan.designs
        ]
        return pa.Table.from_pylist(rows)

    return carried_out


def error_of(friction: float) -> float:
    return 1.0 + friction


ERRORS = [error_of(float(design["friction"])) for design in PLAN.designs]


def test_numbers_that_stay_are_said_to_stay() -> None:
    found = check_timestep(PLAN, table_of([*ERRORS]), GOALS, run(error_of))
    assert found is not None
    assert found.unsettled == ()
    assert len(found.designs) == MAX_CHECKED_DESIGNS
    assert {0, len(ERRORS) - 1} <= set(found.designs)
    assert "same numbers to within 0.0%" in timestep_sentence(found)


def test_one_that_changes_is_named_with_what_it_became() -> None:
    def other(friction: float) -> float:
        return error_of(friction) * (1.3 if friction > 0.29 else 1.0)

    found = check_timestep(PLAN, table_of([*ERRORS]), GOALS, run(other))
    assert found is not None
    (change,) = found.unsettled
    assert (change.metric, change.design) == (MEASURED[0], len(ERRORS) - 1)
    assert change.share == pytest.approx(0.3)
    assert (
        "rms torque error of design 39 is 1.69 N m instead of 1.3"
        in timestep_sentence(found)
    )
    assert "--timestep 0.00025" in timestep_sentence(found)


def test_a_number_that_is_gone_is_a_change() -> None:
    found = check_timestep(FREE, table_of([*ERRORS]), GOALS, run(lambda friction: None))
    assert found is not None
    assert math.isinf(found.unsettled[0].share)
    assert re.search(r"design \d+ fails: such numbers", timestep_sentence(found))


def test_a_small_number_is_measured_by_the_range_of_all() -> None:
    errors: list[float | None] = [1e-9, *ERRORS[1:]]
    found = check_timestep(
        FREE, table_of(errors), GOALS, run(lambda x: error_of(x) - 1e-4)
    )
    assert found is not None
    assert found.changes[0].share > 1.0
    errors[0] = error_of(0.1) - 0.04 * TOLERATED_CHANGE
    found = check_timestep(FREE, table_of(errors), GOALS, run(error_of))
    assert found is not None
    assert found.unsettled == ()


def test_where_nothing_has_a_number_nothing_is_said() -> None:
    nothing = table_of([None] * len(ERRORS))
    assert check_timestep(FREE, nothing, GOALS, run(error_of)) is None


@pytest.mark.parametrize(("stiffness", "settles"), [(5e3, True), (5e6, False)])
def test_a_cable_too_stiff_for_its_controller_is_found(
    stiffness: float, settles: bool
) -> None:
    vary = {"axial_stiffness": [stiffness]}
    plan = make_plan(
        StudySpec("wrist", vary, metrics=MEASURED[:1], duration=2.0, controllers=["pi"])
    )
    found = check_timestep(plan, carry_out(plan), GOALS, carry_out)
    assert found is not None
    assert (found.unsettled == ()) == settles
