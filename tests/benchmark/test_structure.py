"""Plants with structure that no controller's model has."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cc_mujoco.benchmark import SUITES, Cell, Condition, play
from cc_mujoco.benchmark._cell import prepare_episodes
from cc_mujoco.benchmark._plant import (
    EFFECTS,
    STRUCTURES,
    Actuation,
    ActuationFaults,
    sample_plants,
)
from cc_mujoco.errors import CableError
from study_marks import study_but


def conditions(scene: str, suite: str = "v2") -> dict[str, Condition]:
    """Return the conditions of a device, little longer than the least."""
    return {
        one.name: dataclasses.replace(one, duration=1.01)
        for one in SUITES[suite].conditions(scene)
    }


def test_the_wrist_has_every_effect_once_and_an_open_cable_those_it_can_have() -> None:
    names = {f"structure-{name}" for name in STRUCTURES if name != "motor-lag"}
    assert set(conditions("wrist")) == {"ordinary-rough", *names}
    drawn = {"structure-seals", "structure-wrap-end", "structure-route"}
    assert set(conditions("finger")) == {"ordinary-rough", *names} - drawn


@pytest.mark.parametrize("scene", ["wrist", "ankle"])
def test_an_effect_changes_the_plant_and_nothing_that_is_believed(scene: str) -> None:
    for name, condition in conditions(scene).items():
        (drawn,) = sample_plants(condition, (1,))
        plain = not drawn.plant.values.keys() ^ drawn.known.values.keys()
        hidden = not plain or drawn.plant.values != drawn.known.values
        hidden |= drawn.plant.device is not drawn.known.device
        hidden |= not drawn.actuation.is_plain or name == "structure-tremor"
        assert hidden == (name != "ordinary-rough"), name
        for cable, believed in drawn.known.cables.items():
            assert (
                not set(believed.terms)
                - set(drawn.known.device.cables[cable].terms)
                - {"static_friction"}
            ), name


def test_wrap_at_one_end_is_the_same_wrap_of_a_conduit_as_long() -> None:
    (drawn,) = sample_plants(conditions("ankle")["structure-wrap-end"], (0,))
    plant, known = (p.cables["plantarflexor"] for p in (drawn.plant, drawn.known))
    assert plant.wrap == pytest.approx(known.wrap, rel=1e-6)
    assert plant.length == pytest.approx(known.length, rel=1e-6)
    assert len(plant.conduit) == 2


def test_a_drive_has_the_inertia_that_the_rotor_does_not_have() -> None:
    (drawn,) = sample_plants(conditions("wrist")["structure-rotor-inertia"], (0,))
    cell = Cell(conditions("wrist")["structure-rotor-inertia"], "none", (0,))
    made = prepare_episodes([cell])
    nominal = float(drawn.known.scene.spec.joint("motor").armature)
    factor = float(drawn.plant.values["wrist.rotor_inertia"]) / nominal
    assert factor in [pytest.approx(one) for one in (0.6, 1.6)]
    assert made.drives[0][0].inertia >= nominal


def test_an_effect_that_is_known_has_the_plants_of_the_unknown_one() -> None:
    found = conditions("wrist", "v2-known")
    assert set(found) == {"ordinary-rough"} | {
        f"{begin}-{name}" for begin in ("structure", "known") for name in EFFECTS
    }
    (unknown,), (known,) = (
        sample_plants(found[f"{begin}-viscous"], (3,))
        for begin in ("structure", "known")
    )
    assert known.plant == unknown.plant
    assert known.known == known.plant
    assert "viscous_friction" not in unknown.known.cables["flexor"].terms


def test_late_commands_and_cogging_reach_the_motor() -> None:
    plain = conditions("wrist")["ordinary-rough"]
    still = dataclasses.replace(plain, delay=(0, 0), noise=0.0)
    made = prepare_episodes([Cell(still, "none", (0, 1))])
    batch = made.batch
    actuations = [Actuation(delay=2), Actuation(cogging=(0.1,), order=3)]
    batch.actuate = ActuationFaults(actuations, batch.prefixes)
    begun = batch.start()["motor_angle_rad"].copy()
    got = [
        batch.advance(np.array([0.05 * step, 0.0]))["motor_torque_nm"].copy()
        for step in range(1, 5)
    ]
    assert [one[0] for one in got] == pytest.approx([0.0, 0.0, 0.05, 0.1], abs=1e-6)
    wave = 0.1 * np.sin(3.0 * begun[1])
    assert got[0][1] == pytest.approx(wave, abs=1e-6)
    with pytest.raises(CableError, match="a batch is played once"):
        batch.start()


@pytest.mark.parametrize(
    "name", study_but(2, ["cuff", "cogging", "motor-friction", "tremor"])
)
def test_effects_outside_the_cable_are_played(name: str) -> None:
    found = play(Cell(conditions("ankle")[f"structure-{name}"], "none", (0,)))
    assert np.isfinite(found.scores["rms_torque_error"][0])
