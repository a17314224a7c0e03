"""Episodes inside MuJoCo's steps: the same bits as step by step from Python."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco.control import (
    CONTROLLERS,
    Controller,
    ModelBased,
    PredictiveCompensation,
    ProportionalIntegral,
    StictionCompensation,
)
from cc_mujoco.control._controller import stepped_law
from cc_mujoco.design import StudySpec, episodes, make_plan
from cc_mujoco.design._designs import Given
from cc_mujoco.device import Drive, Plant, load_device
from cc_mujoco.human import TASKS, Spring, Tunnel, task
from cc_mujoco.simulation import _rollout as rollout
from cc_mujoco.simulation import attended
from cc_mujoco.simulation._rollout import (
    Rollout,
    attended_together,
    law_of,
    play,
    task_of,
)
from study_marks import study_unless

INSIDE = [name for name, kind in CONTROLLERS.items() if stepped_law(kind)]
QUICK = {
    "ankle": ("pi_tuned", "lqg", "stiction", "disturbance", "adaptive"),
    "finger": ("pi_feed_forward", "inverse", "predictive"),
}
"""Laws of other devices than the wrist that are not left to the study."""
VARY: dict[str, dict[str, Given]] = {
    "wrist": {"friction": [0.05, 0.2], "motor_torque": [0.05, 1.0]},
    "ankle": {"joint_radius": [0.1, 0.13], "static_friction": [0.0, 0.1]},
    "finger": {"friction": [0.05, 0.2]},
}


def both_ways(
    monkeypatch: pytest.MonkeyPatch,
    scene: str,
    vary: dict[str, Given],
    law: str,
    tests: tuple[str, ...] = ("episode",),
    **given: Any,
) -> list[tuple[Rollout, Rollout]]:
    """Every episode of a study, played inside the steps and from Python."""
    given = {"duration": 0.12, "trajectory": None, **given}
    plan = make_plan(StudySpec(scene, vary, controllers=[law], **given))
    device = load_device(scene, plan.protocol.timestep)
    models = [attended(Plant(device, design)) for design in plan.designs]
    pairs = []
    for test, _, episode in episodes(plan.protocol, plan.designs):
        if test not in tests:
            continue
        inside = play(episode, models)
        with monkeypatch.context() as patch:
            patch.setattr(rollout, "_compiled_laws", lambda *given: None)
            pairs.append((inside, play(episode, models)))
    assert pairs
    return pairs


def assert_same(one: Rollout, other: Rollout) -> None:
    assert one.failed == other.failed and one.driven == other.driven
    assert np.array_equal(one.ratio, other.ratio)
    assert one.columns.keys() == other.columns.keys()
    for name, column in one.columns.items():
        assert np.array_equal(column, other.columns[name], equal_nan=True), name


@pytest.mark.parametrize(
    ("scene", "law"),
    study_unless(
        lambda each: each[1] in QUICK.get(each[0], INSIDE),
        itertools.product(VARY, INSIDE),
    ),
)
def test_an_episode_is_the_same_inside_the_steps(
    scene: str, law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for inside, outside in both_ways(monkeypatch, scene, VARY[scene], law):
        assert_same(inside, outside)
        assert np.ptp(inside.columns["joint_angle_rad"]) > 0.0


def test_tests_of_the_hardware_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cc_mujoco.design._evaluation.SWING_TIME", 0.05)
    monkeypatch.setattr("cc_mujoco.design._evaluation.CHIRP_TIME", 0.1)
    tests = "backdrive", "backlash", "bandwidth"
    vary: dict[str, Given] = {"friction": [0.05, 0.2]}
    for pair in both_ways(monkeypatch, "wrist", vary, "model", tests):
        assert_same(*pair)


@pytest.mark.parametrize(
    "vary", [{"onset": [20.0, 30.0]}, {"gait_speed": [1.4], "pretension": [10.0, 20.0]}]
)
def test_help_that_follows_the_walk_is_the_same(
    vary: dict[str, Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    for inside, outside in both_ways(monkeypatch, "ankle", vary, "pi", duration=0.9):
        assert_same(inside, outside)
        assert inside.columns["desired_torque_nm"].min() < -1.0


@pytest.mark.parametrize("scene", ["wrist", "finger"])
@pytest.mark.parametrize("law", ["adaptive", "fused"])
def test_plants_in_one_model_are_those_of_their_own(scene: str, law: str) -> None:
    own: dict[str, Given] = {"friction": [0.05, 1 / 7], "pretension": [20.0, 100 / 3]}
    if scene == "wrist":
        own |= {"loops": [0.5, 2 / 3], "flexor.axial_stiffness": [1e5, 2e5]}
    given: dict[str, Any] = {"controllers": [law], "duration": 0.05}
    plan = make_plan(StudySpec(scene, own, **given))
    plants = [Plant(plan.protocol.device, design) for design in plan.designs]
    each = [attended(plant) for plant in plants]
    (one,) = attended_together(plants)
    before = one.plugin_attr.copy()
    _, _, episode = episodes(plan.protocol)[0]
    for _ in range(2):
        assert_same(play(episode, [one], plants=plants), play(episode, each))
    assert not np.array_equal(one.plugin_attr, before)


@pytest.mark.parametrize(
    "change", [{"motor_radius": 0.01}, {"wearer": 2.0}, {"segments": 20}]
)
def test_plants_that_differ_in_more_than_cables_get_models(change: Any) -> None:
    plants = [Plant("wrist", values) for values in ({}, change)]
    assert len(attended_together(plants)) == 2
    assert len(attended_together([Plant("wrist", change)] * 2)) == 1


@pytest.mark.parametrize("name", ["tunnel", "spring", "hold:0.1", "transparent"])
def test_every_task_is_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = both_ways(
        monkeypatch, "wrist", {"friction": [0.05]}, "pi", task=name, trajectory="sine"
    )
    for pair in pairs:
        assert_same(*pair)


@pytest.mark.parametrize("clock", ["time_s", "phase"])
def test_a_torque_table_is_the_same(
    clock: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "torque.csv"
    path.write_text(f"{clock},torque_nm\n0,0\n0.05,0.4\n0.5,-0.2\n")
    pairs = both_ways(
        monkeypatch, "wrist", {"friction": [0.05]}, "pi", task=path, trajectory="sine"
    )
    for inside, outside in pairs:
        assert_same(inside, outside)
        time = inside.columns["time_s"][0]
        assert task_of(task(path)) is not None
        over = time if clock == "time_s" else np.mod(0.5 * time, 1.0)
        np.testing.assert_allclose(
            inside.columns["desired_torque_nm"][0],
            np.interp(over, [0.0, 0.05, 0.5], [0.0, 0.4, -0.2]),
            atol=1e-12,
        )


def test_a_design_that_diverges_is_told_at_the_same_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A law that is unstable: it drives a light rotor harder the faster it turns.
    class Wild(ProportionalIntegral):
        stepped = ProportionalIntegral.stepped

        def __init__(self, drive: Any) -> None:
            free = dataclasses.replace(drive, safe_torque=np.inf)  # without a guard
            super().__init__(free, proportional=1e6, integral=1e6)

    monkeypatch.setitem(CONTROLLERS, "wild", Wild)
    vary: dict[str, Given] = {
        "friction": [0.0, 0.1], "motor_torque": [1e6], "rotor_inertia": [1e-6],
    }  # fmt: skip
    for inside, outside in both_ways(monkeypatch, "wrist", vary, "wild", duration=0.4):
        assert_same(inside, outside)
        assert any("diverged at" in why for why in inside.failed)


def test_a_torque_that_is_no_number_is_told_at_the_same_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Hollow(ProportionalIntegral):
        stepped = ProportionalIntegral.stepped

        def __init__(self, drive: Any) -> None:
            super().__init__(drive)
            self.proportional = float("inf")

    monkeypatch.setitem(CONTROLLERS, "hollow", Hollow)
    pairs = both_ways(monkeypatch, "wrist", {"friction": [0.05, 0.2]}, "hollow")
    for inside, outside in pairs:
        assert_same(inside, outside)
        assert all("gave no finite torque at" in why for why in inside.failed)


@pytest.mark.parametrize(
    "made",
    [
        lambda drive: StictionCompensation(drive, settling=0.02, preview=0.05),
        lambda drive: PredictiveCompensation(drive, horizon=0.02, knots=5, belief=0.3),
        lambda drive: ModelBased(drive, mismatch=0.5),
    ],
)
def test_a_law_with_settings_of_its_own_is_the_same(
    made: Callable[[Drive], Controller], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CONTROLLERS, "own", made)  # type: ignore[arg-type]
    vary: dict[str, Given] = {"friction": [0.05, 0.2]}
    for pair in both_ways(monkeypatch, "wrist", vary, "own", duration=0.4):
        assert_same(*pair)


def test_what_python_alone_knows_is_left_to_it() -> None:
    class Steeper(Tunnel):
        pass

    class Other(Controller):
        def reset(self, where: Any = None) -> None: ...

        def torque(self, observation: Any) -> float:
            return 0.0

    assert task_of(Steeper()) is None
    assert task_of(Spring(2.0)) is not None
    by_python = {name for name, task in TASKS.items() if task_of(task) is None}
    assert by_python == {"impedance", "position"}
    assert law_of(Other.__new__(Other)) is None
