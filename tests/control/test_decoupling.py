"""Axes whose cables pass joints in common: distribution, ratios, torques at joints."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from cc_mujoco.control import axes_controller
from cc_mujoco.control._decoupling import (
    Coupling,
    CouplingTables,
    antagonists,
    coupled,
    distribute,
)
from cc_mujoco.control._registry import batched_controller
from cc_mujoco.device import DeviceModel, Drive, Plant, find_device
from cc_mujoco.errors import CableError
from cc_mujoco.plugin._readings import moments
from cc_mujoco.simulation import EpisodeLog, simulate

Array = NDArray[np.float64]

FRICTIONLESS = dict.fromkeys(
    (
        f"{finger}_{way}.{what}"
        for finger in ("index", "middle")
        for way in ("flexor", "extensor")
        for what in ("friction", "static_friction")
    ),
    0.0,
)


def drive(joint: str, ratio: float, **shared: float) -> Drive:
    return Drive(ratio, 0.0, 9.0, 1e-3, one_way=True, joint=joint, shared_ratios=shared)


@pytest.mark.parametrize("axes", [2, 3, 6])
def test_the_distribution_is_the_bounded_least_squares_solution(axes: int) -> None:
    random = np.random.default_rng(axes)
    ratios = np.eye(axes) + 0.5 * random.normal(size=(20, axes, axes))
    torques = random.normal(size=(20, axes))
    scales = random.uniform(0.3, 3.0, axes)
    least = np.where(random.random(axes) < 0.7, random.uniform(0.0, 0.2), -np.inf)
    row, none = np.empty(axes), np.full(axes, np.inf)
    tables = CouplingTables(np.arange(axes), least, none, none, scales)
    for matrix, wanted in zip(ratios, torques, strict=True):
        distribute(coupled(tables, matrix), wanted, row)
        known = lsq_linear(matrix / scales[:, None], wanted / scales, (least, np.inf))
        cost = 0.5 * np.sum(((matrix @ row - wanted) / scales) ** 2)
        assert np.all(row >= least - 1e-12)
        assert cost == pytest.approx(known.cost, rel=1e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("ratios", "pulled"),
    [
        ([[1.0, 0.5], [0.0, 1.0]], [False, False]),
        ([[1.0, -1.2]], [True, True]),
        ([[1.0, -1.0, 0.5], [0.0, 0.0, 1.0]], [True, True, False]),
        ([[1.0, -1.0, -1.0], [1.0, 1.0, -2.0]], [True, True, True]),
    ],
)
def test_cables_that_can_pull_against_each_other_keep_a_pretension(
    ratios: list[list[float]], pulled: list[bool]
) -> None:
    matrix = np.array(ratios)
    found = antagonists(matrix, np.ones(matrix.shape[1], dtype=np.bool_))
    assert found.tolist() == pulled


def test_proportional_cables_are_refused() -> None:
    drives = [drive("a", 2.0, b=1.0), drive("b", 0.5, a=1.001)]
    with pytest.raises(CableError, match="same proportions"):
        Coupling(drives, ("first.", "second."))


def test_a_missing_ratio_is_named() -> None:
    law = axes_controller(
        "decoupled_pi", [drive("a", 2.0, b=1.0), drive("b", 1.0)], ("one.", "two.")
    )
    seen = {
        f"{axis}.{name}": 0.0
        for axis in ("one", "two")
        for name in ("joint_torque_nm", "desired_torque_nm", "joint_velocity_rad_s")
    }
    with pytest.raises(CableError, match=r"needs to read one\.torque_ratio_b"):
        law.torque(seen)


@pytest.mark.parametrize(
    ("name", "axes", "text"),
    [
        ("decoupled_lgq", 2, "controller 'decoupled_lgq': unknown suffix 'lgq'.*'lqg'"),
        ("decoupled_", 2, "controller 'decoupled_': unknown suffix ''"),
        ("decoupled_one=pi,two=foo", 2, "unknown suffix 'foo'"),
        ("decoupled_pi", 1, "'decoupled_pi' decouples several .*; take 'pi'"),
    ],
)
def test_what_cannot_be_decoupled_is_refused(name: str, axes: int, text: str) -> None:
    drives, prefixes = [drive("a", 2.0), drive("b", 1.0)], ("one.", "two.")
    given = drives[:axes], prefixes[:axes]
    with pytest.raises(CableError, match=text):
        axes_controller(name, *given)
    with pytest.raises(CableError, match=text):
        batched_controller(name, [given[0]] * 2, given[1])


def test_a_torque_beyond_what_is_safe_releases_every_cable_that_adds_to_it() -> None:
    drives = [drive("a", 1.0, b=1.0), drive("b", 1.0)]
    safe = [Drive(**{**vars(one), "safe_torque": 4.0}) for one in drives]
    coupling = Coupling(safe, ("one.", "two."))
    ratios = np.array([[[1.0, 0.0], [1.0, 1.0]]])
    _, held = coupling.own_torques(ratios, np.array([[1.0, 2.0]]), np.ones((1, 2)))
    _, let_go = coupling.own_torques(ratios, np.array([[1.0, 3.0]]), np.ones((1, 2)))
    assert held[0, 0] > 0.5
    assert let_go.tolist() == [[0.0, 0.0]]


def test_without_friction_joints_get_what_is_desired_by_mujocos_own_moments() -> None:
    plant = Plant("hand", {**FRICTIONLESS, "wearer": 30.0})  # held still
    model = DeviceModel(plant.description, plant.model())
    logs = {name: play(plant, name) for name in ("none", "decoupled_none")}
    log = logs["decoupled_none"]
    errors = {
        name: max(
            abs(
                np.mean(
                    (one[f"{p}joint_torque_nm"] - one[f"{p}desired_torque_nm"])[200:]
                )
            )
            for p in model.prefixes
        )
        for name, one in logs.items()
    }
    assert errors["decoupled_none"] < 0.05 * errors["none"]
    arms = moments(model.model, mujoco.MjData(model.model), [log["qpos"][-1]])[0]
    for axis, prefix in zip(model.axes, model.prefixes, strict=True):
        torque = sum(
            -arms[one.first[1], axis.places.joint_v]
            * np.mean(log[f"tension_{one.driven[0]}_distal_n"][200:])
            for one in model.axes
        )
        assert torque == pytest.approx(log[f"{prefix}desired_torque_nm"][-1], abs=3e-3)


def play(plant: Plant, name: str) -> EpisodeLog:
    return simulate(plant, name, trajectory="sine:0.001", seed=0, duration=0.3)


def test_plants_together_are_driven_as_each_alone() -> None:
    plants = [Plant("hand"), Plant("hand", FRICTIONLESS)]
    each = [simulate(one, "decoupled_pi", duration=0.02) for one in plants]
    both = simulate(plants, "decoupled_pi", seed=[0, 0], duration=0.02)
    for alone, together in zip(each, both, strict=True):
        for name in ("index_flexor.motor_torque_nm", "middle_extensor.joint_torque_nm"):
            assert np.array_equal(alone[name], together[name])


def test_the_ratio_is_the_moment_of_the_model() -> None:
    device = find_device("bilateral")
    model = DeviceModel(device.description, Plant(device).model())
    data = mujoco.MjData(model.model)
    data.joint("left_knee").qpos[0] += 0.4
    mujoco.mj_forward(model.model, data)
    knee = model.axes[1]
    assert knee.winding is not None
    read = knee.winding.read(data)
    arms = moments(model.model, mujoco.MjData(model.model), [data.qpos])[0]
    hip = arms[knee.first[1], model.model.joint("left_hip").dofadr[0]]
    drum = arms[knee.first[0], knee.places.motor_v]
    assert read["torque_ratio_left_hip"] == pytest.approx(
        hip / (knee.sense * drum), rel=1e-12
    )
