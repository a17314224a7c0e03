"""The loop of an episode: who is asked what, in what order, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cc_mujoco.control import Controller
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import Trace, run

DRIVE = Drive(1.0, -1.0, 1.0, 0.001)


class Counter:
    """A plant whose joint turns by the torque: a number, or an array of them."""

    def __init__(self, angle: Any) -> None:
        self.steps, self.first = 4, angle
        self.prefixes = ("",)

    def start(self) -> dict[str, Any]:
        self.angle = self.first
        return {"joint_angle_rad": self.angle}

    def advance(self, torque: Any) -> dict[str, Any]:
        self.angle = self.angle + torque
        return {"joint_angle_rad": self.angle}


class Law(Controller):
    """A function of what is measured."""

    def __init__(self, torque: Callable[[Any], Any]) -> None:
        super().__init__(DRIVE)
        self._torque = torque

    def reset(self, where: Any = None) -> None:
        """Nothing to forget."""

    def torque(self, observation: Any) -> Any:
        return self._torque(observation)


def test_every_answer_but_the_last_is_acted_on_and_all_are_observed() -> None:
    seen: list[float] = []
    observed: list[tuple[int, float, float]] = []

    def torque(told: Any) -> float:
        seen.append(told["joint_angle_rad"])
        return 0.25

    run(
        Counter(1.0),
        Law(torque),
        lambda step, columns, torque: observed.append(
            (step, float(columns["joint_angle_rad"]), float(torque))
        ),
        measure=lambda columns: {"joint_angle_rad": -columns["joint_angle_rad"]},
    )
    truth = [1.0, 1.25, 1.5, 1.75, 2.0]
    assert observed == [(k, angle, 0.25) for k, angle in enumerate(truth)]
    assert seen == [-angle for angle in truth]


def test_a_trace_keeps_columns_and_leaves_out_what_has_failed() -> None:
    going = np.ones(2, dtype=np.bool_)
    trace = Trace(("joint_angle_rad",), 4, going)

    def fail(step: int, *_: object) -> None:
        going[1] = step < 2

    start = np.array([0.0, 1.0])
    run(Counter(start), Law(lambda seen: 0.5), fail, trace.keep)
    kept = trace.columns["joint_angle_rad"]
    assert kept[:, 0].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert kept[:2, 1].tolist() == [1.0, 1.5]
    assert np.isnan(kept[2:, 1]).all()
    assert start.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_torque_that_is_no_number_ends_the_episode_of_one_device_when_it_acts(
    bad: float,
) -> None:
    def after(steps: int) -> Law:
        seen: list[object] = []
        return Law(lambda told: bad if len(seen) == steps else seen.append(told) or 0.1)

    with pytest.raises(CableError) as raised:
        run(Counter(0.0), after(3), name="mine")
    said = "controller 'mine' gave no finite torque at 0.003 s; it must be"
    assert str(raised.value).startswith(said)
    run(Counter(0.0), after(4), name="mine")  # nothing follows the last
    run(Counter(np.zeros(2)), Law(lambda seen: np.array([bad, 0.1])))


@pytest.mark.parametrize(
    ("angle", "torque", "words"),
    [
        (0.0, lambda seen: np.zeros(1), r"'mine' gave torques of shape \(1,\)"),
        (np.zeros(3), lambda seen: np.zeros(2), r"shape \(2,\).*each of 3"),
        (
            0.0,
            lambda seen: seen["tension"],
            r"'mine' raised KeyError in .*test_loop",
        ),
    ],
)
def test_what_a_controller_does_wrong_is_one_sentence(
    angle: Any, torque: Any, words: str
) -> None:
    with pytest.raises(CableError, match=words) as raised:
        run(Counter(angle), Law(torque), name="mine")
    assert "\n" not in str(raised.value)
