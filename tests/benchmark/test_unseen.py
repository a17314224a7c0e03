"""Suite v3: events, effects beyond v2, and cables by other equations."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from cc_mujoco.benchmark import SUITES, Cell, Condition, _bristles
from cc_mujoco.benchmark._bristles import NODES, Chains
from cc_mujoco.benchmark._cell import prepare_episodes
from cc_mujoco.benchmark._faults import fault_onsets
from cc_mujoco.benchmark._plant import new_key, sample_plants
from cc_mujoco.cable import Cable, Section, replay

CABLE = Cable(
    friction=0.15,
    pretension=10.0,
    axial_stiffness=4e3,
    conduit=(Section(2.0, 0.28),),
    segments=100,
)


def conditions(scene: str, duration: float = 1.1) -> dict[str, Condition]:
    return {
        one.name.removeprefix("structure-"): dataclasses.replace(one, duration=duration)
        for one in SUITES["v3"].conditions(scene)
    }


def played(condition: Condition, law: str, *names: str) -> tuple[Any, dict[str, Any]]:
    """Return the episodes of seeds 0 and 1, and columns of them."""
    made = prepare_episodes([Cell(condition, law, (0, 1))])
    return made, made.batch.play(made.law, made.sensors.measure, names)


def test_a_device_has_the_conditions_that_its_cables_can_have() -> None:
    events = {"torque-lost", "torque-held", "torque-gain", "torque-tared"}
    anywhere = {"ordinary-rough", "soft-anchors", *events}
    guided = anywhere | {"clearance", "bristles", "clamp-slips"}
    assert set(conditions("wrist")) == guided | {"cable-off"}
    assert set(conditions("ankle")) == guided
    assert set(conditions("finger")) == set(conditions("exosuit")) == anywhere


def test_an_effect_is_in_no_belief_and_its_size_follows_from_the_key() -> None:
    for name, keys in {
        "clearance": ("clearance", "seating_tension"),
        "soft-anchors": ("end_compliance", "end_hardening", "end_loss"),
    }.items():
        one, other = (
            sample_plants(conditions("wrist")[name], (0,), key)[0]
            for key in (new_key(), new_key())
        )
        known, cables = one.known.cables["flexor"], [one.plant, other.plant]
        for key in keys:
            first, second = (getattr(own.cables["flexor"], key) for own in cables)
            assert getattr(known, key) != first != second > 0.0


def test_a_chain_that_slides_whole_has_the_tensions_of_a_capstan() -> None:
    chain = Chains.of([CABLE, CABLE], [3, 4])
    assert not np.allclose(*chain.grip)  # bends of their own
    place, lean = np.zeros((2, NODES + 2)), np.zeros((2, NODES))
    for step in range(1500):
        place, lean = chain.move(place, lean, np.full((2, 2), -1e-5 * step))
    tension = chain.tensions(place)
    ratio = np.exp(CABLE.friction * CABLE.wrap)
    assert tension[:, 0] / tension[:, -1] == pytest.approx([ratio, ratio], rel=1e-5)


def test_a_chain_is_near_the_engine_and_takes_work_from_a_cycle() -> None:
    pull = -0.02 * np.sin(np.linspace(0.0, 4.0 * np.pi, 1600))
    still = np.zeros_like(pull)
    engine = replay(CABLE, dt=0.001, u_proximal=pull, u_distal=still)
    chain = Chains.of([CABLE], [3])
    place, lean = np.zeros((1, NODES + 2)), np.zeros((1, NODES))
    found = []
    for ends in np.stack([pull, still], axis=1):
        place, lean = chain.move(place, lean, ends[None])
        found.append(chain.tensions(place)[0, [0, -1]])
    tension = np.array(found)
    theirs = np.stack([engine.tension_proximal, engine.tension_distal], axis=1)
    off = np.sqrt(np.mean((tension - theirs) ** 2, axis=0)) / theirs.max()
    assert off.max() < 0.03  # of 13 pieces; of 51 with short bristles 0.01
    second = slice(800, None)  # the first cycle begins without memory
    assert -np.trapezoid(tension[second, 0], pull[second]) > 0.1


@pytest.mark.parametrize(
    ("scene", "cable"), [("wrist", "flexor"), ("ankle", "plantarflexor")]
)
def test_a_device_with_short_bristles_moves_as_that_of_the_engine(
    scene: str, cable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_bristles, "LENGTH", 1e-5)
    names = (
        "joint_torque_nm",
        "tension_n",
        "least_tension_n",
        f"tension_{cable}_nodes_n",
    )
    other = conditions(scene, 1.5)["bristles"]
    same = dataclasses.replace(other, structure="")
    (_, chains), (_, engine) = (played(one, "none", *names) for one in (other, same))
    for name in names[:2]:
        one, two = chains[name][500:], engine[name][500:]
        assert np.sqrt(np.mean((one - two) ** 2)) < 0.02 * np.abs(two).max()
        assert not np.array_equal(one, two)
    nodes = chains[names[3]]
    assert np.array_equal(nodes[:, :, 0], chains["tension_n"][:, :, 0])
    assert (nodes.min(axis=2) >= chains["least_tension_n"][:, :, 0]).all()


def test_a_loose_plug_is_put_back_and_a_sensor_under_load_is_zeroed() -> None:
    name = "joint_torque_nm"
    for event in ("torque-lost", "torque-held", "torque-gain", "torque-tared"):
        one = dataclasses.replace(
            conditions("wrist", 2.2)[event], delay=(0, 0), noise=0
        )
        made = prepare_episodes([Cell(one, "none", (0, 1))])
        seen: list[Any] = []
        measure = made.sensors.measure

        def kept(columns: Any, measure: Any = measure, seen: list[Any] = seen) -> Any:
            seen.append(measure(columns))
            return seen[-1]

        rows = made.batch.play(made.law, kept, [name])
        seeds = [drawn.seed for drawn in made.draws]
        first = fault_onsets(seeds, made.batch.exo.period)[0]
        read, true = np.array([each[name][0] for each in seen]), rows[name][:, 0]
        assert np.array_equal(read[:first], true[:first])
        now, later = slice(first, first + 300), slice(first + 300, None)
        expected = {
            "torque-lost": (0.0, true[later]),
            "torque-held": (true[first], true[later]),
            "torque-gain": (0.8 * true[now], 0.8 * true[later]),
            "torque-tared": (true[now] - true[first], true[later] - true[first]),
        }[event]
        assert np.all(read[now] == expected[0]) and np.all(read[later] == expected[1])
        assert abs(true[first]) > 0.01


@pytest.mark.parametrize("event", ["clamp-slips", "cable-off"])
def test_a_cable_loses_its_tension_at_a_time(event: str) -> None:
    made, rows = played(conditions("wrist", 2.2)[event], "none", "tension_n")
    seeds = [drawn.seed for drawn in made.draws]
    for row, first in enumerate(fault_onsets(seeds, made.batch.exo.period)):
        held = made.draws[row].plant.cables["flexor"].pretension
        flexor = rows["tension_n"][:, row, 1]  # at the joint
        assert flexor[first] > 0.3 * held
        if event == "cable-off":
            assert flexor[first + 300 :].max() < 0.02 * held
        else:
            assert flexor[first + 280 : first + 299].max() < 0.3 * held
