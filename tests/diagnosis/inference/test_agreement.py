"""Effects that parts of the data do not confirm are not accepted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cc_mujoco.datasets import Dataset
from cc_mujoco.diagnosis import Options, prepare, run_inference
from cc_mujoco.diagnosis._search.search import count_votes, split_trials
from diagnosis.recorded import BENCH, dataset

IDS = ("viscous_friction", "joint_gravity")
PULL = {"gravity_sine": 1.2, "gravity_cosine": 0.0}
DRAG = {"viscous_friction": 60.0}


def rig(
    first: dict[str, dict[str, float]], last: dict[str, dict[str, float]]
) -> Dataset:
    """Return four trials, two of one rig and two of another."""
    made = [
        dataset(each, 2.0, seed=k, chosen=(0, 2))
        for k, each in enumerate((first, last))
    ]
    trials = [
        replace(trial, name=f"{half}{place}", path=f"{half}{place}.csv")
        for half, data in zip("ab", made, strict=True)
        for place, trial in enumerate(data.trials)
    ]
    return replace(made[0], trials=tuple(trials))


def test_parts_that_contradict_each_other_name_nothing() -> None:
    found = run_inference(
        rig({IDS[1]: PULL}, {IDS[0]: DRAG}), BENCH, Options(IDS)
    ).diagnosis
    assert found.verdict == "unknown", found.statement
    assert found.missing == ()


def test_what_every_part_shows_is_named_and_what_half_of_them_show_is_not() -> None:
    found = run_inference(
        rig({IDS[1]: PULL, IDS[0]: DRAG}, {IDS[1]: PULL}), BENCH, Options(IDS)
    ).diagnosis
    agreed = {each.id: each.agreement for each in found.effects}
    assert agreed["joint_gravity"] == 1.0


def test_parts_are_halves_that_keep_repetitions_together() -> None:
    records, _ = prepare(rig({}, {}), BENCH)
    parts = split_trials(records)
    assert len(parts) == 4
    for one, other in (parts[:2], parts[2:]):
        for a, b, record in zip(one, other, records, strict=True):
            assert np.array_equal(a | b, record.free)
            assert not np.any(a & b)
    alike = tuple(replace(r, group=min(r.group, "b0")) for r in records)
    assert split_trials(alike) == []
    turned = tuple(replace(r, tilt=1.57 * (r.group == "b1")) for r in records)
    shows = np.array([record.tilt != 0.0 for record in turned])
    for part in split_trials(turned):
        there = np.array([mask.any() for mask in part])
        assert there[shows].all() and there[~shows].any()


def test_what_half_of_the_parts_name_in_place_of_it_is_tied_with_it() -> None:
    asymmetric, offset = "asymmetric_friction", "torque_sensor_offset"
    parts = [[{offset}], [{asymmetric}], [{offset, asymmetric}], [{asymmetric}]]
    found = count_votes([asymmetric], {}, parts)
    assert found.rivals == {asymmetric: (offset,)}
    assert found.shares == {asymmetric: 1.0}
    once = count_votes([asymmetric], {}, [*parts[1:], [{asymmetric}]])
    assert once.rivals == {asymmetric: ()}


def test_what_is_named_beside_it_is_tied_only_if_the_two_are_easily_confused() -> None:
    ageing, falling, pull = (
        "dwell_dependent_stiction",
        "stribeck_friction",
        "joint_gravity",
    )
    parts = [[{ageing}], [{ageing}, {falling}, {pull}]] * 2
    assert count_votes([ageing], {}, parts).rivals == {ageing: (falling,)}
    both = count_votes([ageing, falling], {}, parts[1::2]).rivals
    assert both == {ageing: (), falling: ()}


def test_what_one_part_names_in_place_of_what_it_is_confused_with_is_tied() -> None:
    drift, loss = "friction_drift", "pretension_loss"
    parts = [[{loss}, {drift}], [{drift}], [{loss}], [{drift}, {loss}]]
    found = count_votes([drift, loss], {}, parts)
    assert found.rivals == {drift: (loss,), loss: (drift,)}
    assert found.shares == {drift: 1.0, loss: 1.0}
    parts[2] = [{"motor_cogging"}]
    assert count_votes([drift], {}, parts).shares == {drift: 0.75}


def test_what_few_parts_name_is_disputed() -> None:
    parts = [[{"backlash"}], [], [{"joint_gravity"}], [{"sensor_delay"}]]
    found = count_votes(["backlash"], {}, parts)
    assert found.shares == {"backlash": 0.25}
    assert found.rivals == {"backlash": ()}
    assert count_votes(["backlash"], {}, []).shares == {}
