"""Public calls of cable and estimation refuse what they cannot use, in one sentence."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Conduit, Section, Transmission, replay, rest_state
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.device import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation import Measurement, calibrate

CABLE = Cable(friction=0.2, conduit=(Section(1.0, 0.2),), segments=4)
SENSORS = Sensors((0, 2, 4), (1.0, 1.0, 1.0))
DRIVE = Transmission.pull_pull(CABLE, 0.02, 0.1)
ROW, SLIP = [10.0, 11.0, 12.0], [1, 1, 1, 1]
TRIAL = {
    "dt": 0.01,
    "inputs": {"motor_angle": np.linspace(0.0, 0.1, 9), "joint_angle": np.zeros(9)},
    "outputs": {"joint_torque": np.zeros(9)},
    "noise": {"joint_torque": 0.1},
}
Call = tuple[Callable[..., Any], dict[str, Any]]


def _of(make: Callable[..., Any], method: str) -> Callable[..., Any]:
    return lambda **given: getattr(make(), method)(**given)


CALLS: dict[str, Call] = {
    "replay": (
        replay,
        {"cable": CABLE, "dt": 1e-3, "u_proximal": [0.0, -1e-3], "u_distal": [0.0, 0]},
    ),
    "replay of tensions": (
        replay,
        {
            "cable": CABLE,
            "dt": 1e-3,
            "tension_proximal": [10.0, 11.0],
            "u_distal": [0.0, 0.0],
            "initial_tension": [10.0] * 5,
            "profile": True,
        },
    ),
    "rest_state": (rest_state, {"cable": CABLE, "tension": [10.0] * 5}),
    "Conduit": (Conduit, {"cable": CABLE, "tension": [10.0] * 5}),
    "Conduit.step": (
        _of(lambda: Conduit(CABLE), "step"),
        {"dt": 1e-3, "u_proximal": -1e-3, "tension_distal": 10.0},
    ),
    "Transmission": (
        Transmission,
        {
            "cables": (CABLE,),
            "motor_radius": 0.02,
            "joint_radius": 0.1,
            "gear_ratio": 2.0,
            "backlash": 0.01,
        },
    ),
    "Transmission.replay": (
        DRIVE.replay,
        {"dt": 1e-3, "motor_torque": [0.0, 0.1], "joint_angle": [0.0, 0.01]},
    ),
    "Sensors": (Sensors, {"nodes": (0, 1), "deviation": (1.0, 1.0)}),
    "Sensors.at": (
        Sensors.at,
        {"cable": CABLE, "positions": (0.1, 0.9), "deviation": 1.0},
    ),
    "Measurement": (Measurement, TRIAL),
    "calibrate": (
        calibrate,
        {
            "trials": [Measurement(**TRIAL)],
            "transmission": DRIVE,
            "free": ("friction",),
            "starts": 1,
            "seed": 0,
        },
    ),
}
WRONG: tuple[Any, ...] = (
    None, "many", "1", b"1", 1e308, -1e308, float("nan"), float("inf"), -1.0, 7, 0,
    1j, (), [], [[1.0], [1.0, 2.0]], [1e308, -1e308], [float("nan")] * 3, [7] * 4,
    [7.0, 8.0], np.zeros((2, 2, 2)), {"a": 1}, {}, object(), True, 10**400, Cable,
    CABLE,
)  # fmt: skip


@pytest.mark.parametrize(
    "package", ["cc_mujoco", "cc_mujoco.plugin", "cc_mujoco.cable"]
)
def test_every_public_call_refuses_what_is_of_no_use_in_one_sentence(
    package: str,
) -> None:
    module = importlib.import_module(package)
    own = [getattr(module, name) for name in module.__all__]
    laws = [*CONTROLLERS.values()] if package == "cc_mujoco" else []
    for call in (*own, *laws):
        if not callable(call) or inspect.isabstract(call) or call is CableError:
            continue
        needed = [
            name
            for name, one in inspect.signature(call).parameters.items()
            if one.default is one.empty
            and one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)
        ]
        for wrong in (None, 7, "x", b"x", 1j, [], {}, object(), Cable) * bool(needed):
            try:
                call(**dict.fromkeys(needed, wrong))
            except CableError as error:
                assert "\n" not in str(error), (call, wrong)


def _finite(found: Any) -> bool:
    if isinstance(found, Conduit | Sensors | Measurement) or hasattr(found, "update"):
        return True
    parts = (
        [v for v in vars(found).values() if v is not None]
        if hasattr(found, "__dict__")
        else found
    )
    flat = parts if isinstance(parts, list | tuple) else [parts]
    return all(
        bool(np.isfinite(np.asarray(one, dtype=float)).all())
        for one in flat
        if isinstance(one, float | np.ndarray)
    )


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_argument_is_one_sentence_and_never_a_number_that_is_none(
    name: str,
) -> None:
    call, right = CALLS[name]
    assert _finite(call(**right))
    for argument in right:
        for wrong in WRONG:
            try:
                found = call(**{**right, argument: wrong})
            except CableError as error:
                assert "\n" not in str(error) and len(str(error)) < 800
            else:
                assert _finite(found), (argument, wrong)


def test_numbers_that_overflow_are_refused_with_their_place() -> None:
    with pytest.raises(CableError, match=r"tension_proximal \[1\] is 1e\+308 N"):
        replay(CABLE, 1e-3, tension_proximal=[1.0, 1e308], u_distal=[0.0, 0.0])
    with pytest.raises(CableError, match=r"joint_radius must be a number in \[1e-06"):
        Transmission.single(CABLE, 0.02, 1e308)
