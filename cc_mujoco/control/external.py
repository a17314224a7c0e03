"""Controllers from outside: any `module:function`, and policies of Stable-Baselines3.

    controller("my_module:my_function", drive)      # called with the drive
    controller("runs/policy.zip", drive)            # a saved policy

What the function returns is a `Controller`, or a function from what is measured to the
torque of the motor [Nm]. An exception inside becomes a `CableError` that says where it
was raised; the exception itself is its cause.
"""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control.controller import Controller
from cc_mujoco.control.drive import Drive
from cc_mujoco.control.observed import ACTION, alike, described
from cc_mujoco.errors import CableError


class External(Controller):
    """A function of what is measured, with the motor's limits around it.

    It is made anew, by the function that makes it, before every episode.
    """

    def __init__(
        self, drive: Drive, make: Callable[[Drive], Any], name: str = "function"
    ) -> None:
        """Make the function.

        Args:
            drive: The device to be driven.
            make: Called with the drive; returns a function of the observation.
            name: For error messages.
        """
        super().__init__(drive)
        self._make = make
        self._name = name
        self._law = make(drive)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Make the function anew, for all environments; see `Controller.reset`."""
        if where is None:
            self._law = self._make(self.drive)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`.

        Raises:
            CableError: If the function raises, or returns what is not real numbers.
        """
        with blamed(self._name):
            torque = self._law(observation)
        given = np.asarray(torque)
        if given.dtype.kind not in "fiu":
            raise CableError(
                f"controller {self._name!r} gave {torque!r}; it must be a torque in Nm."
            )
        # Infinite is a division by zero, not the wish for all that the motor has.
        return self.limited(np.where(np.isfinite(given), given, np.nan)[()])


def from_callable(name: str, drive: Drive) -> Controller:
    """The controller that `module:function` makes; see the module's documentation.

    Modules are found as by `import` in the folder of the call.

    Raises:
        CableError: If there is no such module or function, it makes no controller, or
            its code raises.
    """
    place, _, function = name.partition(":")
    make = getattr(_module(name, place), function, None)
    if not callable(make):
        raise CableError(
            f"controller {name!r}: module {place!r} has no function {function!r}."
        )
    with blamed(name):
        made = make(drive)
    if isinstance(made, Controller):
        return made
    if callable(made):
        return External(drive, make, name)
    raise CableError(
        f"controller {name!r}: called with a Drive it must return a Controller or a "
        f"function of the observation, not {made!r}."
    )


def _module(name: str, place: str) -> ModuleType:
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        with blamed(name):
            return importlib.import_module(place)
    except CableError as error:
        missing = getattr(error.__cause__, "name", None)
        absent = isinstance(error.__cause__, ModuleNotFoundError)
        if place and not (absent and missing and f"{place}.".startswith(f"{missing}.")):
            raise
        raise CableError(
            f"controller {name!r}: there is no module {place!r}; it must be importable "
            f"or lie in {here}."
        ) from None
    finally:
        sys.path.remove(here)


@contextmanager
def blamed(name: str) -> Iterator[None]:
    """Say in one sentence which controller raised what, and where."""
    try:
        yield
    except CableError:
        raise
    except Exception as error:
        if isinstance(error, SyntaxError):
            what, file, line = error.msg, error.filename, error.lineno
        else:
            last = traceback.extract_tb(error.__traceback__)[-1]
            what, file, line = str(error), last.filename, last.lineno
        raise CableError(
            f"controller {name!r} raised {type(error).__name__} in {file}, line "
            f"{line}: {what}"
        ) from error


class Policy(Controller):
    """A policy that Stable-Baselines3 saved, fed as in the environment of its training.

    It sees the environment's own observation and gives an action of it, the share of
    the motor's torque. `scripts/train_policy.py` trains one.
    """

    def __init__(self, drive: Drive, path: str | os.PathLike[str]) -> None:
        """Load the policy.

        Args:
            drive: The device to be driven.
            path: The file.

        Raises:
            CableError: If Stable-Baselines3 is not installed, or the file cannot be
                read or has a policy of another device or environment.
        """
        super().__init__(drive)
        if drive.observed is None:
            raise CableError(
                f"policy {os.fspath(path)!r} needs a device with an environment; this "
                "Drive has no `observed`."
            )
        self._observed = drive.observed
        if not os.path.isfile(path):
            raise CableError(f"policy {os.fspath(path)!r}: there is no such file.")
        self._policy = _loaded(path)
        for does, its, own in (
            ("observes", self._policy.observation_space, self._observed.space),
            ("acts with", self._policy.action_space, ACTION),
        ):
            if not alike(its, own):
                raise CableError(
                    f"policy {os.fspath(path)!r} is not one for {drive.observed.device}"
                    f": it {does} {described(its)}, but the environment of "
                    f"{drive.observed.device} {does} {described(own)}."
                )

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        seen = self._observed.of(observation)
        # One by one: a network rounds differently for one environment and for many.
        rows = np.atleast_2d(seen)
        share = np.array(
            [self._policy.predict(row, deterministic=True)[0][0] for row in rows]
        ).astype(np.float64)
        torque = np.clip(share, -1.0, 1.0) * self.drive.high
        return self.limited(torque if seen.ndim == 2 else float(torque[0]))


def _loaded(path: str | os.PathLike[str]) -> Any:
    """The policy in a file, of whichever algorithm."""
    try:
        import stable_baselines3 as algorithms
        from stable_baselines3.common.save_util import load_from_zip_file
    except ModuleNotFoundError:
        raise CableError(
            f"policy {os.fspath(path)!r} needs Stable-Baselines3: "
            "pip install 'cc_mujoco[policy]'."
        ) from None
    try:
        kind = (load_from_zip_file(path, device="cpu")[0] or {})["policy_class"]
        for name in ("PPO", "SAC", "TD3"):
            algorithm = getattr(algorithms, name)
            if kind in algorithm.policy_aliases.values():
                return algorithm.load(path, device="cpu").policy
    except Exception as error:  # whatever a file of another kind makes it raise
        raise CableError(
            f"policy {os.fspath(path)!r} is not one that Stable-Baselines3 saved: "
            f"{error}"
        ) from error
    raise CableError(
        f"policy {os.fspath(path)!r} is a {kind.__name__}; it must be one of PPO, A2C, "
        "SAC, TD3 or DDPG."
    )
