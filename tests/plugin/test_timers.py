"""MuJoCo's timers stop inside `untimed` and only there."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import gymnasium
import mujoco
import pytest

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.plugin import untimed

STEP = mujoco.mjtTimer.mjTIMER_STEP


def grows() -> bool:
    """Return whether MuJoCo's timer of steps advances."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    return bool(data.timer[STEP].duration > 0.0)


@pytest.fixture
def clock() -> Iterator[list[int]]:
    """Yield the number of calls of a foreign clock, installed in MuJoCo."""
    read = [0]

    def tell() -> float:
        read[0] += 1
        return 1e-3 * read[0]

    mujoco.set_mjcb_time(tell)
    yield read
    mujoco.set_mjcb_time(None)


def test_timers_stand_still_inside_and_go_on_outside() -> None:
    assert grows()
    with untimed():
        assert not grows()
        with untimed():
            assert not grows()
        assert not grows()
    assert grows()


def test_timers_go_on_after_an_error() -> None:
    with pytest.raises(KeyError), untimed():
        raise KeyError
    assert grows()


def test_one_thread_does_not_start_the_timers_of_another() -> None:
    inside, leave = threading.Event(), threading.Event()

    def stay() -> None:
        with untimed():
            inside.set()
            leave.wait(10.0)

    other = threading.Thread(target=stay)
    other.start()
    assert inside.wait(10.0)
    with untimed():
        pass
    assert not grows()
    leave.set()
    other.join()
    assert grows()


def test_a_clock_of_somebody_else_is_left_alone(clock: list[int]) -> None:
    with untimed():
        assert grows()
    assert clock[0] > 0
    before = clock[0]
    assert grows()
    assert clock[0] > before


def test_a_clock_that_is_set_meanwhile_stays() -> None:
    with untimed():
        mujoco.set_mjcb_time(lambda: 7.0)
    try:
        clock = mujoco.get_mjcb_time()
        assert clock is not None
        assert clock() == 7.0
    finally:
        mujoco.set_mjcb_time(None)
    assert grows()


def test_vector_environments_leave_timers_to_others() -> None:
    envs = gymnasium.make_vec(
        "cc_mujoco/WristHandle-v1", num_envs=2, vectorization_mode="vector_entry_point"
    )
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    assert grows()
    envs.close()
