"""Objects whose memory compiled code works in, called by several threads at once."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.cable import Cable, Conduit, Section
from cc_mujoco.control import CONTROLLERS, Controller, controller
from cc_mujoco.device import MEASURED_COLUMNS, TENSION_COLUMN
from cc_mujoco.errors import CableError

THREADS, CALLS, ROWS = 4, 30, 40
CABLE = Cable(friction=0.2, conduit=(Section(2.0, 0.3),))


def together(call: Callable[[], object]) -> list[str]:
    """Return the errors of a call that several threads repeat at once."""
    start = Barrier(THREADS)

    def repeat(_: int) -> list[str]:
        start.wait()
        errors = []
        for _ in range(CALLS):
            try:
                call()
            except CableError as error:
                errors.append(str(error))
        return errors

    with ThreadPoolExecutor(THREADS) as pool:
        return [one for errors in pool.map(repeat, range(THREADS)) for one in errors]


@pytest.fixture(scope="module")
def setup() -> tuple[Any, dict[str, Any]]:
    """Return the drive of the wrist, and what many of them measure at once."""
    env: Any = gymnasium.make("cc_mujoco/Device-v1", device="wrist").unwrapped
    _, info = env.reset(seed=1)
    seen = {name: np.full(ROWS, float(info[name])) for name in MEASURED_COLUMNS}
    shape = ROWS, len(env.drive.cables), len(env.drive.sensors[0].nodes)
    return env.drive, seen | {TENSION_COLUMN: np.full(shape, 20.0)}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_answers_one_thread_at_a_time(
    name: str, setup: tuple[Any, dict[str, Any]]
) -> None:
    drive, seen = setup
    law = controller(name, drive)
    for error in together(lambda: law.torque(seen)):
        assert error.endswith("make one for each thread.")
    law.reset()  # it is free again
    assert np.isfinite(law.torque(seen)).all()
    copy.deepcopy(law), pickle.dumps(law)


def test_a_call_from_another_thread_is_one_error_and_from_its_own_none() -> None:
    class Nested(Controller):
        def reset(self, where: Any = None) -> None:
            pass

        def torque(self, observation: Any) -> Any:
            self.reset()
            with ThreadPoolExecutor(1) as pool:
                pool.submit(self.reset).result()

    law = Nested(controller("none", _drive()).drive)
    for _ in range(2):
        with pytest.raises(CableError, match=r"Nested is called .* its reset\(\)"):
            law.torque({})
        law.reset()


def _drive() -> Any:
    return gymnasium.make("cc_mujoco/Device-v1", device="wrist").unwrapped.drive


def test_a_cable_serves_one_thread_at_a_time() -> None:
    conduit = Conduit(CABLE)

    def call() -> object:
        return conduit.step(1e-3, u_proximal=-1e-3, u_distal=0.0)

    for error in together(call):
        assert error.endswith("make one for each thread.")
    call()
    assert np.isfinite(conduit.tension).all()


def test_an_environment_is_stepped_by_one_thread_at_a_time() -> None:
    env: Any = gymnasium.make("cc_mujoco/WristHandle-v1").unwrapped
    env.reset(seed=0)
    action = np.zeros(1, np.float32)
    for error in together(lambda: env.step(action)):
        assert "make one for each thread" in error
    assert np.isfinite(env.step(action)[0]).all()
