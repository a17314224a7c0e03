"""Episodes from plants to logs: one, several at once, and those of environments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco import play, simulate
from cc_mujoco.control import (
    CONTROLLERS,
    ProportionalIntegral,
    axes_controller,
    controller,
)
from cc_mujoco.device import PERFECT_SENSING, Drive, Measuring, Plant, find_device
from cc_mujoco.errors import CableError
from cc_mujoco.human import Spring, read_trajectory
from cc_mujoco.simulation import Single, attended
from cc_mujoco.simulation._rollout import Episode
from cc_mujoco.simulation._rollout import play as roll_out
from cc_mujoco.simulation._simulate import task_label


@pytest.mark.parametrize(
    ("scene", "law"),
    [("wrist", "model"), ("ankle", "pi"), ("finger", "none"), ("exosuit", "feedback")],
)
def test_a_log_is_that_of_the_environment_alone_and_in_a_batch(
    scene: str, law: str
) -> None:
    about = find_device(scene).description
    env: Any = gymnasium.make("cc_mujoco/Device-v1", device=scene, duration=0.1)
    names = {
        "trajectory": about.trajectory,
        "task": task_label(about, None),
        "controller": law,
    }
    made = axes_controller(law, env.unwrapped.drives, about.prefixes)
    stepped = play(env, made, seed=3, about=names)
    alone = simulate(scene, law, duration=0.1, seed=3)
    assert alone == stepped
    other, same = simulate([scene] * 2, law, duration=0.1, seed=[4, 3])
    assert same == alone
    assert other == simulate(scene, law, duration=0.1, seed=4)
    name = f"{about.prefixes[0]}motor_torque_nm"
    assert (other[name] != same[name]).any() or law == "none"


def test_a_plant_is_a_device_with_values_changed() -> None:
    plant = Plant("wrist", {"friction": 0.2, "wearer": 0.5})
    env: Any = gymnasium.make("cc_mujoco/WristHandle-v1", duration=0.05)
    law = controller("model", env.unwrapped.drive)  # which does not know the values
    log = simulate(plant, law, duration=0.05, about={"controller": "model"})
    system = Single(env, 0, plant.values)
    columns = system.start()
    measuring = Measuring(
        find_device("wrist").description.sensing, law.drive, log.cables, 0, 50
    )
    law.reset()
    for step in range(50):
        for name in ("joint_torque_nm", "dissipated_flexor_j"):
            assert columns[name] == log[name][step]
        columns = system.advance(law.torque(measuring.measure(columns)))
    assert log.metadata["values"] == plant.values
    assert float(log.metadata["cables"]["flexor"]["friction"]) == 0.2
    nominal, changed = simulate(["wrist", plant], "model", duration=0.05)
    assert nominal == simulate("wrist", "model", duration=0.05)
    assert changed == simulate(plant, "model", duration=0.05)
    late = simulate(Plant("wrist", {"delay": 3}), "pi", duration=0.05)
    on_time = simulate("wrist", "pi", duration=0.05)
    assert not np.array_equal(late["motor_torque_nm"], on_time["motor_torque_nm"])
    assert late.metadata["cables"] == on_time.metadata["cables"]


def test_a_log_is_that_of_a_what_if() -> None:
    episode = Episode(
        find_device("wrist").description, "sine", Spring(2.0), 0.1, 2, 0, "pi"
    )
    found = roll_out(episode, [attended(Plant("wrist"))]).columns
    log = simulate(
        "wrist",
        "pi",
        trajectory="sine",
        task=Spring(2.0),
        duration=0.1,
        sensing=PERFECT_SENSING,
    )
    for name in ("joint_torque_nm", "motor_torque_nm", "desired_torque_nm"):
        assert np.array_equal(log[name], found[name][0])
    for place, cable in enumerate(log.cables):
        proximal = log[f"tension_{cable}_proximal_n"]
        assert np.array_equal(proximal, found["tension_n"][0, 2 * place])


def test_a_motion_is_a_name_a_file_or_an_object_and_the_log_names_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("time_s,angle_rad\n0,0\n1,0.2\n2,0.4\n3,0.6\n")
    times: list[float] = []
    given: Any = {"task": Spring(), "duration": 0.02}
    log = simulate("wrist", trajectory=path, progress=times.append, **given)
    read = simulate("wrist", trajectory=read_trajectory(path), **given)
    assert np.array_equal(log["reference_angle_rad"], read["reference_angle_rad"])
    assert np.ptp(log["reference_angle_rad"]) > 0.0
    assert read.metadata["trajectory"] == "Recorded"
    assert times == log["time_s"][1:].tolist()
    about = log.metadata
    assert (about["trajectory"], about["task"]) == (str(path), "Spring")
    assert (about["controller"], about["scene"]) == ("pi_tuned", "wrist")


def steep(drive: Drive) -> Any:
    """Return a law that knows numbers alone."""
    return lambda seen: 0.2 if seen["joint_angle_rad"] > 0.0 else -0.2


def test_a_controller_is_a_name_a_function_or_an_object() -> None:
    given: Any = {"duration": 0.03}
    alone = simulate("wrist", steep, **given)
    assert alone.metadata["controller"] == "steep"
    assert set(alone["motor_torque_nm"][1:].round(2)) <= {-0.2, 0.2}
    one, two = simulate(["wrist", "wrist"], steep, **given)
    assert one == two == alone
    env: Any = gymnasium.make("cc_mujoco/WristHandle-v1", duration=0.03)
    law = ProportionalIntegral(env.unwrapped.drive)
    named = simulate("wrist", "pi", **given)
    own = simulate("wrist", law, about={"controller": "pi"}, **given)
    assert (
        own == named == simulate(["wrist"], law, about={"controller": "pi"}, **given)[0]
    )


class Wild(ProportionalIntegral):
    """A law that gives no number from its fifth step on."""

    def reset(self, where: Any = None) -> None:
        """Count anew."""
        super().reset(where)
        self.steps = 0

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return nothing finite at the end."""
        self.steps += 1
        return super().torque(observation) * (np.nan if self.steps > 4 else 1.0)


def test_a_torque_that_is_no_number_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(CONTROLLERS, "wild", Wild)
    words = r"controller 'wild' gave no finite torque at 0\.004 s"
    with pytest.raises(CableError, match=f"^{words}; it must be a number"):
        simulate("wrist", "wild", duration=0.02)
    with pytest.raises(CableError, match=rf"^plant 0: {words}\.$"):
        simulate(["wrist"] * 2, "wild", duration=0.02)


@pytest.mark.parametrize(
    ("plants", "given", "words"),
    [
        ("wirst", {}, "'wrist'"),
        ([], {}, "at least one; the list is empty"),
        (3, {}, "plant 0 must be the name or file of a device"),
        (["wrist", 3], {}, "plant 1 must be .* a Device or a Plant, not 3"),
        (["wrist", Plant("wrist", {"segments": 9})], {}, "plant 1 has other segments"),
        (["wrist", "ankle"], {}, "one device, not of 'wrist' and 'ankle'"),
        ("wrist", {"controller": "pid"}, "controller"),
        ("wrist", {"controller": 3}, "a function of a Drive, not 3"),
        ("wrist", {"trajectory": 3}, "trajectory must be a name"),
        ("wrist", {"task": 3}, "task must be a name"),
        ("wrist", {"seed": -1}, "seed must be an integer from 0"),
        (["wrist"], {"seed": [1, 2]}, "one for each of 1 plants"),
        ("wrist", {"duration": 0.0}, "duration"),
        ("wrist", {"threads": -1}, "threads must be an integer >= 0"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(
    plants: Any, given: dict[str, Any], words: str
) -> None:
    with pytest.raises(CableError, match=words) as raised:
        simulate(plants, **{"duration": 0.01, **given})
    assert "\n" not in str(raised.value)


def test_a_controller_of_another_period_is_refused() -> None:
    law = ProportionalIntegral(Drive(5.2, -1.0, 1.0, 0.002))
    with pytest.raises(CableError, match=r"period of 0\.002 s.*one of 0\.001 s"):
        simulate("wrist", law, duration=0.01)


def test_sensors_that_are_none_are_refused() -> None:
    with pytest.raises(CableError, match="sensing must be a Sensing, not 'perfect'"):
        simulate("wrist", sensing="perfect", duration=0.1)  # type: ignore[call-overload]
