"""Controllers by name, for a drive, for a device and for many devices.

    law = controller("lqg", "wrist")
    law = controller("my_module:my_function", env.unwrapped.drive)
    law = axes_controller("hip=predictive,ankle=pi", drives, prefixes)
    law = axes_controller({"hip": "predictive", "ankle": make}, drives, prefixes)
    law = axes_controller("decoupled_pi", drives, prefixes)  # see `_decoupling`

`module:function` is called with the drive. It returns a `Controller`, or a function
from measurements to the torque of the motor [N m]. An exception inside becomes a
`CableError` with its location; the exception itself is its cause.

Controllers act on one axis and see the columns of that axis under plain names. A
function with the attribute `ALL_AXES = True` is called with the drives of all axes; its
controller sees all columns and returns the torques of all motors.
"""

import dataclasses
import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.control import _baselines as baselines
from cc_mujoco.control import _feedback as feedback
from cc_mujoco.control import _model_based as model_based
from cc_mujoco.control import _position as position
from cc_mujoco.control import _tension_feedback as tension_feedback
from cc_mujoco.control._controller import Controller, limit_torques
from cc_mujoco.control._decoupling import Coupling
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._predictive import PredictiveCompensation
from cc_mujoco.device._axis_columns import axis_columns, split_by_axis
from cc_mujoco.device._description import Description
from cc_mujoco.device._device import Nominal
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._plant import Plant
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import task as find_task

CONTROLLERS: dict[str, type[Controller]] = {
    "none": feedback.FeedForward,
    "feedback": feedback.Feedback,
    "pi": feedback.ProportionalIntegral,
    "pi_tuned": feedback.TunedFeedback,
    "pi_feed_forward": feedback.FrictionFeedForward,
    "inverse": baselines.BacklashInverse,
    "lqg": baselines.LinearQuadraticGaussian,
    "fused": tension_feedback.FusedFeedback,
    "model": model_based.ModelBased,
    "stiction": model_based.StictionCompensation,
    "disturbance": model_based.DisturbanceObserver,
    "predictive": PredictiveCompensation,
    "adaptive": tension_feedback.AdaptiveModel,
}
"""Every controller of torque with its default gains, to be called with a `Drive`."""

POSITION_CONTROLLERS: dict[str, type[Controller]] = {
    "none": position.IdealRatio,
    "linear": position.LinearFit,
    "backlash_inverse": position.SmoothBacklashInverse,
    "prandtl_ishlinskii": position.PrandtlIshlinskiiInverse,
    "bouc_wen": position.BoucWenFeedForward,
    "cable_inverse": position.CableInverse,
    "distal_feedback": position.DistalFeedback,
}
"""Every controller of a joint angle, for a drive that commands one."""


Law = str | Callable[..., Any]
"""Name of a controller, or a function that makes one for a drive."""

DECOUPLED = "decoupled_"  # prefix of the name of a controller of decoupled axes
OWN_COLUMNS = "joint_torque_nm", "desired_torque_nm"
"""Columns that a decoupled controller gets of its own cable instead of the joint."""


class _Readings(dict[str, Any]):
    """Measurements by name; the error for an unknown name lists all names."""

    def __missing__(self, name: str) -> Any:
        error = KeyError(name)
        error.add_note(str(CableError.unknown("reading", name, self)))
        raise error


class External(Controller):
    """User function of the measurements, with the motor's limits applied.

    `make` creates the function anew before every episode.
    """

    limits = True  # False in a process whose host limits the torque

    def __init__(
        self,
        drive: Drive | tuple[Drive, ...],
        make: Callable[[Any], Any],
        name: str = "function",
    ) -> None:
        """Prepare; `make(drive)` must return a function of the measurements.

        With the drives of all axes, that function gets the measurements of all axes.
        """
        self._drives = (drive,) if isinstance(drive, Drive) else drive
        super().__init__(self._drives[0])
        self.name = name
        self._make_law: Callable[[], Any] = functools.partial(make, drive)
        self._law = self._make_law()

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._law = self._make_law()

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`.

        Raises:
            CableError: If the function raises, or returns what is not real numbers.
        """
        with controller_errors(self.name):
            torque = self._law(_Readings(observation))
        given = np.asarray(torque)
        if given.dtype.kind not in "fiu":
            raise CableError(
                f"controller {self.name!r} gave {torque!r}; it must be a torque in N m."
            )
        # Infinity is a division by zero, not a request for the motor's largest torque.
        finite = np.where(np.isfinite(given), given, np.nan)[()]
        return limit_torques(finite, self._drives) if self.limits else finite


class AxesController(Controller):
    """One controller for each axis of a device."""

    def __init__(self, laws: Sequence[Controller], prefixes: Sequence[str]) -> None:
        """Prepare for the first episode: one law and column prefix for each axis."""
        super().__init__(laws[0].drive)
        self.laws, self._prefixes = tuple(laws), tuple(prefixes)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        for law in self.laws:
            law.reset(where)

    def given(self, torque: Any) -> None:
        for law, own in zip(self.laws, torque, strict=True):
            law.given(own)

    def torque(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return the torque of every motor [N m], (..., axes)."""
        each = zip(self.laws, self._seen(observation), strict=True)
        torques = [law.torque(own) for law, own in each]
        return np.stack(np.broadcast_arrays(*torques), axis=-1)

    def _seen(self, observation: Mapping[str, Any]) -> list[Mapping[str, Any]]:
        """Return the columns of each axis under plain names."""
        prefixes = self._prefixes
        return [axis_columns(observation, prefix, prefixes) for prefix in prefixes]


class DecoupledController(AxesController):
    """One controller per axis, which reads the torque of its own cables alone."""

    def __init__(
        self, laws: Sequence[Controller], prefixes: Sequence[str], coupling: Coupling
    ) -> None:
        """Prepare; the laws must have the drives of `decoupled_drives`."""
        super().__init__(laws, prefixes)
        self._coupling = coupling

    def _seen(self, observation: Mapping[str, Any]) -> list[Mapping[str, Any]]:
        seen = super()._seen(observation)
        measured, desired = (
            np.stack([np.atleast_1d(own[name]) for own in seen], axis=-1)
            for name in OWN_COLUMNS
        )
        ratios = self._coupling.ratios(seen, len(measured))
        pairs = np.transpose(self._coupling.own_torques(ratios, measured, desired))
        if np.ndim(seen[0][OWN_COLUMNS[0]]) == 0:
            pairs = pairs[:, 0].tolist()
        return [
            {**own, **dict(zip(OWN_COLUMNS, np.transpose(pair), strict=True))}
            for own, pair in zip(seen, pairs, strict=True)
        ]


class Unpowered(Controller):
    """Motors that give no torque."""

    def __init__(self, drive: Drive, axes: int = 1) -> None:
        super().__init__(drive)
        self._axes = axes

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        if self._axes == 1:
            return 0.0
        shape = np.shape(next(iter(observation.values())))
        return np.zeros((*shape, self._axes))


class PlantsController(Controller):
    """A controller for each of several plants, of one axis or of all."""

    def __init__(self, laws: Sequence[Controller]) -> None:
        super().__init__(laws[0].drive)
        self.laws = tuple(laws)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        for row, law in enumerate(self.laws):
            if where is None or where[row]:
                law.reset()

    def given(self, torque: Any) -> None:
        """See `Controller.given`; torques are (n,) or (n, axes), of every plant."""
        for law, own in zip(self.laws, torque, strict=True):
            law.given(own)

    def torque(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return the torque of every motor [N m], (n,) or (n, axes)."""
        # The `info` of an episode that ended is a mapping among the columns.
        columns = {n: v for n, v in observation.items() if isinstance(v, np.ndarray)}
        torques = []
        for row, law in enumerate(self.laws):
            own = {name: value[row] for name, value in columns.items()}
            torques.append(law.torque(own))
        return np.stack(torques)


def controller(
    name: str | Callable[[Drive], Any], drive: Drive | Plant | Nominal | str | Path
) -> Controller:
    """Make a controller, ready for an episode; for several axes as `axes_controller`.

    Args:
        name: A key of `CONTROLLERS`, or of `POSITION_CONTROLLERS` for a drive that
            commands an angle, `module:function` or a function itself (see
            this module), or the file of a policy, `*.safetensors`.
        drive: The device to be driven: name, file, `Device` or `Plant`, with its own
            task and sensors; or a `Drive`, as environments have as `unwrapped.drive`.

    Raises:
        CableError: If there is no such controller; names the nearest and all others.
            Or if it commands a torque where the task commands an angle, or the reverse,
            or needs a sensor at the joint that the device does not have.
    """
    if isinstance(drive, Drive):
        return _controller_of(name, [drive])
    if not isinstance(drive, (Plant, Nominal, str, Path)):
        raise CableError(
            "a controller is made for a Drive, a Device, a Plant or the name or file "
            f"of a device, not for {drive!r}."
        )
    model = DeviceModel.of(drive)
    drives = model.drives(model.frame_skip * float(model.model.opt.timestep))
    about = model.description
    tasks = [find_task(axis.task, about.limbs(axis)) for axis in about.axes]
    each = [
        dataclasses.replace(own, commands_angle=task.commands_angle)
        for own, task in zip(drives, tasks, strict=True)
    ]
    return axes_controller(name, each, model.prefixes)


def _controller_of(
    name: Law, drives: Sequence[Drive], prefixes: Sequence[str] = ("",)
) -> Controller:
    """Return the controller of an axis, see `controller`, or a policy of all axes."""
    if isinstance(name, str) and name.endswith(POLICY_ENDING):
        return Policy(drives, name, prefixes)
    (drive,) = drives
    if not isinstance(name, str) or is_user_controller(name):
        return from_callable(name, drive)
    if drive.commands_angle:
        if name in CONTROLLERS and name not in POSITION_CONTROLLERS:
            raise CableError(
                f"controller {name!r} follows a torque, and the task commands an "
                f"angle; take one of {', '.join(POSITION_CONTROLLERS)}."
            )
        return look_up("controller", name, POSITION_CONTROLLERS)(drive)
    if name in POSITION_CONTROLLERS and name not in CONTROLLERS:
        raise CableError(
            f"controller {name!r} follows an angle, and the task commands a torque; "
            "take the task `position`."
        )
    kind = look_up("controller", name, CONTROLLERS)
    if not drive.joint_sensor:
        raise CableError(
            f"controller {name!r} follows a torque that depends on the joint, and this "
            "device measures nothing there; take the task `position`, or set "
            "joint_sensor = true in [sensors]."
        )
    return kind(drive)


def from_callable(given: str | Callable[[Drive], Any], drive: Drive) -> Controller:
    """Return the controller that a function makes; see the module's documentation.

    `module:function` is imported as from the current directory.
    """
    if isinstance(given, str):
        name, make = given, user_code.named_object("controller", given, "function")
    else:
        name, make = getattr(given, "__qualname__", type(given).__name__), given
    place, _, function = name.rpartition(":")
    if not callable(make):
        raise CableError(
            f"controller {name!r}: module {place!r} has no function {function!r}."
        )
    _require_one_argument(name, make, f"{function!r}", "the drive")
    with controller_errors(name):
        made = make(drive)
    if isinstance(made, Controller):
        return made
    if callable(made):
        returned = f"what {function!r} returns"
        _require_one_argument(name, made, returned, "what is measured")
        return External(drive, make, name)
    raise CableError(
        f"controller {name!r}: called with a Drive it must return a Controller or a "
        f"function of the observation, not {made!r}."
    )


def _require_one_argument(name: str, called: Any, which: str, what: str) -> None:
    """Raise a `CableError` if a function cannot be called with one argument."""
    try:
        signature = inspect.signature(called)
    except (TypeError, ValueError):  # some of extension modules have none
        return
    try:
        signature.bind(None)
    except TypeError:
        code = getattr(inspect.unwrap(called), "__code__", None)
        where = f" in {code.co_filename}, line {code.co_firstlineno}," if code else ""
        raise CableError(
            f"controller {name!r}: {which}{where} must take one argument, {what}, but "
            f"takes {signature}."
        ) from None


def controller_errors(name: str) -> AbstractContextManager[None]:
    """Turn an error in a `with` block into a `CableError` on the controller `name`."""
    return user_code.user_errors(f"controller {name!r}")


def default_controller(device: Description, task: Any = None) -> str:
    """Return the name of the controller that plays a task by default.

    It is `pi_tuned`, whose gains follow from rotor, cables and delay of any device. If
    the task commands an angle, it is `backlash_inverse` if the device has its
    parameters, else `none`. `task` is one for all axes or a mapping by axis, see
    `human.task`; by default that of the device.
    """
    if len(device.axes) > 1:
        return "pi_tuned"
    axis = device.axes[0]
    if isinstance(task, str):
        task = split_by_axis(task, [axis.name])
    named = task.get(axis.name) if isinstance(task, Mapping) else task
    given = axis.task if named is None else named
    if not find_task(given, (axis.limb,)).commands_angle:
        return "pi_tuned"
    fitted = device.hysteresis.get(axis.name, {})
    return "backlash_inverse" if "backlash_inverse" in fitted else "none"


def axes_controller(
    given: Law | Mapping[str, Law], drives: Sequence[Drive], prefixes: Sequence[str]
) -> Controller:
    """Make the controller of a device; with one axis it is that of the axis.

    `given` is a controller for all axes, or one by the name of an axis: a mapping, or a
    text such as `hip=predictive,ankle=pi`. `drives` and `prefixes`, the beginnings of
    columns, have one entry for every axis.

    Raises:
        CableError: There is no such controller or axis, or an axis has none; or a
            single axis is to be decoupled.
    """
    alone = (is_policy(given) or len(drives) == 1) and not is_decoupled(given)
    if alone and not isinstance(given, Mapping):
        return _controller_of(given, drives, prefixes)
    if not isinstance(given, Mapping) and (make := _for_all_axes(given)) is not None:
        name = given if isinstance(given, str) else make.__qualname__
        with controller_errors(name):
            made = make(tuple(drives))
        if isinstance(made, Controller):
            return made
        return External(tuple(drives), make, name)
    laws, coupling = by_axis(given, prefixes), None
    if is_decoupled(given):
        drives, coupling = decoupled_drives(drives, prefixes)
    made = [_controller_of(law, [one]) for law, one in zip(laws, drives, strict=True)]
    if coupling is None:
        return AxesController(made, prefixes)
    return DecoupledController(made, prefixes, coupling)


def batched_controller(
    given: Law | Mapping[str, Law],
    drives: Sequence[Sequence[Drive]],
    prefixes: Sequence[str],
    outside: Callable[[Any, Any, Any], Controller] | None = None,
) -> Controller:
    """Make the controller of many devices, of one axis or several.

    It acts on each device as on that device alone. Equal devices share a controller
    that works on arrays, but code of users may accept numbers only. Arguments are those
    of `axes_controller`, with the drives of every axis of each device; `outside`,
    called with the same arguments, makes a controller with code of users.
    """
    first, has_code = drives[0], runs_code(given)
    if has_code and outside is not None:
        return outside(given, drives, prefixes)
    are_equal = all(list(own) == list(first) for own in drives)
    if len(drives) == 1 or (are_equal and not has_code):
        return axes_controller(given, first, prefixes)
    return PlantsController([axes_controller(given, own, prefixes) for own in drives])


def decoupled_drives(
    drives: Sequence[Drive], prefixes: Sequence[str]
) -> tuple[list[Drive], Coupling]:
    coupling = Coupling(drives, prefixes)
    found = [
        dataclasses.replace(drive, torque_noise=float(noise), shared_joint=False)
        for drive, noise in zip(drives, coupling.noise, strict=True)
    ]
    return found, coupling


def is_decoupled(given: Law | Mapping[str, Law]) -> bool:
    return isinstance(given, str) and given.startswith(DECOUPLED)


def _for_all_axes(given: Law) -> Any:
    """Return the function that makes one controller for all axes, or None."""
    if isinstance(given, str):
        is_plain = "=" not in given and not is_decoupled(given)
        if not (is_plain and _is_code(given)):
            return None
        given = user_code.named_object("controller", given, "function")
    return given if getattr(given, "ALL_AXES", False) else None


def is_policy(given: Law | Mapping[str, Law]) -> bool:
    """Return whether a controller is the file of a policy, which drives all axes."""
    alone = isinstance(given, str) and given.endswith(POLICY_ENDING)
    return alone and named_laws(given) == [given]


def runs_code(given: Law | Mapping[str, Law]) -> bool:
    """Return whether a controller has code of users: a function, or `module:name`."""
    return any(map(_is_code, named_laws(given)))


def _is_code(law: Law) -> bool:
    """Return whether the controller of an axis is `module:name`, or a function."""
    if not isinstance(law, str):
        return True
    return is_user_controller(law) and not law.endswith(POLICY_ENDING)


def by_axis(given: Law | Mapping[str, Law], prefixes: Sequence[str]) -> list[Law]:
    """Return the name or function of the controller of every axis.

    Raises `CableError` for an unknown axis, an axis without a controller, and for
    `decoupled_NAME` of an unknown NAME or a single axis.
    """
    names = [prefix.rstrip(".") for prefix in prefixes]
    if isinstance(given, str):
        for name in named_laws(given) if is_decoupled(given) else ():
            if not is_user_controller(name) and name not in CONTROLLERS:
                error = CableError.unknown("suffix", name, CONTROLLERS)
                raise CableError(f"controller {given!r}: {error}")
        bare = given.removeprefix(DECOUPLED)
        if is_decoupled(given) and len(names) == 1:
            raise CableError(
                f"controller {given!r} decouples several driven axes, and here is one; "
                f"take {bare!r}."
            )
        given = split_by_axis(bare, names)
    if not isinstance(given, Mapping):
        return [given] * len(names)
    for name in given:
        if name not in names:
            raise CableError.unknown("axis", name, names)
    missing = [name for name in names if name not in given]
    if missing:
        raise CableError(
            f"axis {missing[0]!r} has no controller; write {missing[0]}=NAME as well."
        )
    return [given[name] for name in names]


def named_laws(given: Law | Mapping[str, Law]) -> list[Any]:
    """Return all controllers that are given: two in `hip=model,ankle=pi`."""
    if not isinstance(given, str):
        return list(given.values()) if isinstance(given, Mapping) else [given]
    given = given.removeprefix(DECOUPLED)
    pairs = [re.fullmatch(r"\s*[\w-]+=(.*)", part) for part in given.split(",")]
    return [pair[1].strip() for pair in pairs if pair] if all(pairs) else [given]


def law_drives(law: Controller, drives: Sequence[Drive]) -> Sequence[Drive]:
    """Return the drives of a controller: its own, or those of the device if several."""
    if isinstance(law, AxesController):
        return [one.drive for one in law.laws]
    return [law.drive] if len(drives) == 1 else drives
