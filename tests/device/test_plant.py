"""Plants: devices with some of their values changed."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from cc_mujoco import Plant
from cc_mujoco.cable._cable import MAX_SEGMENTS, PARAMETERS
from cc_mujoco.design._scenarios import Across
from cc_mujoco.device import VARIABLES, Nominal, load_device
from cc_mujoco.device._variables import WRITTEN
from cc_mujoco.errors import CableError
from cc_mujoco.human import Body, Pace, Profile


def test_cables_wearer_and_sensors_are_those_of_the_values() -> None:
    device = load_device("wrist")
    values = {"friction": 0.1, "flexor.break_away": 2.0, "wearer": 0.5, "delay": 4}
    plant = Plant(device, values)
    assert plant.cables["flexor"].friction == plant.cables["extensor"].friction == 0.1
    assert plant.cables["flexor"].static_friction == 0.2
    assert (plant.delay, plant.noise) == (4, 1.0)
    wearer = plant.wearers["wrist"]
    assert wearer.stiffness == 0.5 * device.wearers["wrist"].stiffness
    for whole in (False, True):
        mover = plant.model(whole).actuator(device.description.movers["wrist"])
        assert (mover.gainprm[0], mover.biasprm[2]) == (
            wearer.stiffness,
            -wearer.damping,
        )
    assert plant == Plant("wrist", values) != Plant(device)


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ({"frictoin": 0.1}, "unknown variable 'frictoin': did you mean 'friction'"),
        ({"flexxor.friction": 0.1}, "unknown cable or axis 'flexxor'"),
        ({"flexor.wearer": 2.0}, "'wearer' belongs to no cable"),
        ({"wearer": 0.0}, "'wearer' must be a number in"),
        ({"delay": 1.5}, "'delay' must be a whole number in"),
        ({"break_away": 2.0, "flexor.static_friction": 0.4}, "set the same thing"),
        ({"pretension": 265.0}, "below the breaking load of 265 N"),
    ],
)
def test_impossible_values_say_why(values: dict[str, float], wrong: str) -> None:
    with pytest.raises(CableError, match=wrong):
        Plant("wrist", values)


def test_what_only_episodes_change_is_no_variable_of_designs() -> None:
    with pytest.raises(CableError, match="unknown variable 'delay'"):
        Across().check(load_device("wrist"), {"delay": 2})


def test_the_plant_of_an_environment_has_no_scene_to_change() -> None:
    scene = load_device("wrist")
    device = Nominal(scene.description, scene.cables, scene.wearers)
    with pytest.raises(CableError, match="has no scene to change"):
        Plant(device, {"friction": 0.1}).model()


def test_values_that_are_no_mapping_are_refused() -> None:
    with pytest.raises(CableError, match=r"^values must be"):
        Plant("wrist", ["friction"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "made", "wrong"),
    [
        ({"body_mass": 90.0}, "model", "'body_mass' needs a wearer who walks"),
        ({"body_mass": 90.0}, "spec", "'body_mass' needs a wearer who walks"),
        ({"body_mass": 90.0}, "xml", "'body_mass' needs a wearer who walks"),
        ({"route": "none_such"}, "xml", "none_such"),
    ],
)
def test_a_plant_that_cannot_be_made_is_refused_in_a_sentence(
    values: dict[str, object], made: str, wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong):
        getattr(Plant("wrist", values), made)()


def test_variables_of_a_walker_are_those_of_the_walk() -> None:
    own = {
        field.name: field for owner in (Body, Pace, Profile) for field in fields(owner)
    }
    names = {"gait_speed": "speed", "body_mass": "mass", "leg_length": "leg"}
    for name in ("onset", "peak_time", "peak_torque", "fall", *names):
        field, variable = own[names.get(name, name)], VARIABLES[name]
        low, high, _ = field.metadata["bounds"]
        # A fall has no least size before it is known what it belongs to.
        assert variable.low == (0.0 if name == "fall" else low)
        assert variable.high == high
        assert f"{field.default:g}" in variable.meaning


def test_an_axis_may_have_the_name_of_its_cable() -> None:
    assert "index_flexor" in load_device("hand").cables
    plant = Plant("hand", {"index_flexor.motor_lag": 0.01})
    assert plant.values == {"index_flexor.motor_lag": 0.01}


def test_segments_of_a_design_are_those_of_a_cable() -> None:
    assert VARIABLES["segments"].high == MAX_SEGMENTS


WHERE_POSSIBLE = {
    "break_away": 2.0,
    "strength": 30.0,
    "material": "steel_ptfe",
    "material_friction": "low",
}
"""Values of the variables that do not admit 0.02."""


def test_designs_share_a_model_only_if_all_of_it_but_the_cables_is_equal() -> None:
    def arrays(name: str) -> dict[str, np.ndarray]:
        chosen = {name: WHERE_POSSIBLE.get(name, 0.02)} if name else {}
        if name == "material_friction":
            chosen["material"] = WHERE_POSSIBLE["material"]
        model = Plant("wrist", chosen).model()
        found = {key: getattr(model, key) for key in dir(model)}
        return {
            key: value
            for key, value in found.items()
            if isinstance(value, np.ndarray) and not key.startswith(("plugin_", "_"))
        }

    usual = arrays("")
    for name in WRITTEN - {parameter.name for parameter in PARAMETERS}:
        for key, value in arrays(name).items():
            np.testing.assert_array_equal(value, usual[key], f"{name}: {key}")
    other = arrays("joint_radius")
    assert not np.array_equal(other["actuator_gear"], usual["actuator_gear"])
