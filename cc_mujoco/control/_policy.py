"""Policies: small networks that were trained on an environment, and their files.

    write_policy("runs/policy.safetensors", network, observed)
    controller("runs/policy.safetensors", drive)
    write_onnx("runs/policy.safetensors", "runs/policy.onnx")

A file has the weights as safetensors and, in its header, what the policy observes of
each axis as JSON. Nothing in it is executed.

ONNX is for runtimes without Python and this package. The graph is the network:
`observation` (n, size) and `action` (n, motors) of float32, computed in double as the
policy is. The definition of the observation, which the graph does not contain, is in
the metadata `cc_mujoco` as JSON; `Observed` says how to form it.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import safetensors
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco.assets import POLICIES, policy_file
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring
from cc_mujoco.control._controller import (
    Controller,
    motor_limits,
    needs_winding,
    readings,
)
from cc_mujoco.control._feedback import stable_settling_time
from cc_mujoco.control._network import Network
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._description import device_label
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._observation import (
    JOINT_ANGLE,
    JOINT_VELOCITY,
    ObservationHistory,
    Observed,
)
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError, import_extra
from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal
from cc_mujoco.native import FloatArray as Array

POLICY_METADATA_KEY = "cc_mujoco"  # key of the JSON in the metadata of a file

RELEASE, WHOLE, GAINS = range(guard.LIMITS, guard.LIMITS + 3)
"""Places of gains after `DriveLimits`, and their number: damping of a released motor
[N m s/rad], torque of the motor at a share of 1 [N m].
"""


class PolicyAxis:
    """An axis that a policy drives, its observations and its guard."""

    def __init__(self, drive: Drive, observed: Observed, whole: float) -> None:
        """Prepare; `whole` is the torque of the motor at a share of 1 [N m].

        If the task commands an angle, it defines no safe torque, and the guard of the
        policy only replaces missing readings.
        """
        self.drive, self.observed = drive, observed
        self.is_wound = drive.lever or bool(drive.crossed)
        """True if the guard reads `device.WINDING_COLUMNS` of the joint."""
        self.limits = motor_limits(drive)
        if drive.commands_angle:
            self.limits = self.limits._replace(
                safe_torque=guard.NO_TORQUE_LIMIT,
                safe_speed=guard.NO_SPEED_LIMIT,
                safe_power=guard.NO_POWER_LIMIT,
            )
        self.spring = joint_spring(drive.cables, self.limits)
        settling = stable_settling_time(drive, self.spring)
        damping = settling * self.spring[guard.STIFFNESS] / drive.ratio**2
        self.gains = np.array([*self.limits, damping, whole])
        """`DriveLimits`, then `RELEASE` and `WHOLE`."""
        self.begin(0)

    def begin(self, count: int) -> None:
        """Allocate observations and guard for a number of environments."""
        self.history = ObservationHistory(self.observed, count)
        self.memory: FloatArray = np.zeros((count, guard.MEMORY_SIZE))

    @property
    def unguarded(self) -> tuple[str, ...]:
        """Columns of an observation that the guard does not read."""
        columns = self.observed.columns
        joint: tuple[str, ...] = ()
        if self.is_wound:
            joint = columns[JOINT_ANGLE], columns[JOINT_VELOCITY], WINDING_COLUMNS[2]
        return (*joint, *columns[guard.READINGS :])


class Policy(Controller):
    """Policy from a file, with the observations of its training, and a guard.

    Each axis has the guard of the other controllers, see `_guard`. It replaces readings
    before the policy observes them. While it releases a joint, the policy continues and
    observes its own actions as if they were taken.
    """

    def __init__(
        self,
        drives: Drive | Sequence[Drive],
        path: str | os.PathLike[str],
        prefixes: Sequence[str] = ("",),
    ) -> None:
        """Load the policy of a file for the only axis of a device, or for every axis.

        `prefixes` are the beginnings of the columns of each axis.

        Raises:
            CableError: If the file cannot be read, or has a policy of another device or
                for other samples.
        """
        self._drives = (drives,) if isinstance(drives, Drive) else tuple(drives)
        super().__init__(self._drives[0])
        self._prefixes = tuple(prefixes)
        self.network, self.observed = read_policy(path)
        name = os.fspath(path)
        counts = len(self.observed), len(self._drives)
        if counts[0] != counts[1]:
            its, here = ("one axis" if n == 1 else f"{n} axes" for n in counts)
            raise CableError(
                f"policy {name!r} drives {its} at once, and is given {here}: play it "
                "as the one controller of the device of its training."
            )
        self.axes = [
            PolicyAxis(drive, observed, _same_device(name, observed, drive).torque)
            for observed, drive in zip(self.observed, self._drives, strict=True)
        ]
        self._begin(0)

    @property
    def limits(self) -> guard.DriveLimits:
        """Limits of motor and joint in the guard of the first axis."""
        return self.axes[0].limits

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._begin(0)
        elif self._fresh.size:
            self._fresh |= where
            self._shares[where] = 0.0
            for axis in self.axes:
                axis.memory[where] = 0.0

    def _begin(self, count: int) -> None:
        """Allocate all state for a number of environments before their first sample."""
        self._fresh = np.ones(count, dtype=np.bool_)
        self._samples = np.zeros(count, dtype=np.intp)
        self._shares = np.zeros((count, len(self.axes)))
        for axis in self.axes:
            axis.begin(count)

    def given(self, torque: Any) -> None:
        each = [torque] if len(self.axes) == 1 else np.moveaxis(np.array(torque), -1, 0)
        for axis, own in zip(self.axes, each, strict=True):
            np.copyto(axis.memory[:, guard.COMMAND], own, where=guard.is_heard(own))

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`.

        With several axes it is that of every motor, (..., axes). An environment with an
        unguarded reading that is no number, or beyond `guard.MAX_READING`, gets no
        torque, and its state does not change.
        """
        prefixes = self._prefixes
        seen = [axis_columns(observation, prefix, prefixes) for prefix in prefixes]
        each = list(zip(self.axes, seen, strict=True))
        measured = [readings(own, axis.observed.columns) for axis, own in each]
        count = len(measured[0])
        if len(self._fresh) != count:
            self._begin(count)
        heard = np.ones(count, dtype=np.bool_)
        for axis, own in each:
            needs_winding(own, axis.drive)
            if others := axis.unguarded:
                heard &= guard.is_heard(readings(own, others)).all(axis=1)
        rows, started = np.flatnonzero(heard), heard.copy()
        for (axis, own), taken in zip(each, measured, strict=True):
            wound = axis.is_wound
            winding = readings(own, WINDING_COLUMNS) if wound else np.zeros((count, 0))
            _admit_all(axis.gains, axis.spring, axis.memory, taken, winding, rows)
            started &= axis.memory[:, guard.STARTED] != 0.0
        self._decide(measured, rows, started)
        torques = np.zeros((len(self.axes), count))
        for axis, shares, found in zip(self.axes, self._shares.T, torques, strict=True):
            whole = np.ascontiguousarray(shares)
            _torques(axis.gains, axis.spring, axis.memory, whole, rows, found)
        first = seen[0][self.observed[0].columns[0]]
        if len(self.axes) > 1:
            return torques.T if np.ndim(first) else torques[:, 0]
        return torques[0] if np.ndim(first) else float(torques[0, 0])

    def _decide(
        self, measured: Sequence[Array], rows: NDArray[np.intp], started: Any
    ) -> None:
        """Update the actions of environments in which a new one is due.

        `measured` has the readings of each axis (n, columns), `rows` the environments
        that were read, and `started` is a mask (n,) of those with a complete reading.
        """
        begins = self._fresh & started
        for axis, own in zip(self.axes, measured, strict=True):
            axis.history.add(own[rows], rows)
            if begins.any():
                axis.history.begin(own[begins], begins)
        self._samples[begins] = 0
        self._fresh &= ~begins
        due = started & (self._samples % self.observed[0].hold == 0)
        if due.any():
            rounded = [axis.history.observation() for axis in self.axes]
            shares = self.network(np.concatenate(rounded, axis=1)[due].astype(float))
            self._shares[due] = shares.astype(np.float32)
            for axis, own in zip(self.axes, self._shares.T, strict=True):
                axis.history.act(own, due)
        self._samples[started] += 1


@internal
def admit_measured(
    own: guard.Guarded, measured: FloatArray, winding: FloatArray
) -> None:
    """Let the guard check the measurements, and replace them if needed.

    `measured` are the readings of the policy, `guard.READINGS` first, and is changed;
    `winding` are `device.WINDING_COLUMNS`, or nothing for a round pulley.
    """
    seen = own.memory[guard.SEEN : guard.SEEN + guard.READINGS]
    seen[:] = measured[: guard.READINGS]
    if winding.size > 0:
        seen[guard.JOINT], seen[guard.JOINT_SPEED] = winding[0], winding[1]
        seen[guard.TORQUE] /= winding[2]
        seen[guard.DESIRED] /= winding[2]
    guard.admit(own, seen)
    for i in range(guard.READINGS):
        if winding.size == 0 or i < guard.JOINT:
            measured[i] = seen[i]
        elif i > guard.JOINT_SPEED:
            measured[i] = seen[i] * winding[2]


@compiled
def _admit_all(
    gains: FloatArray,
    spring: FloatArray,
    memory: FloatMatrix,
    measured: FloatMatrix,
    winding: FloatMatrix,
    rows: IntArray,
) -> None:
    for i in range(rows.size):
        row = rows[i]
        own = guard.Guarded(gains, spring, memory[row])
        admit_measured(own, measured[row], winding[row])


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    memory: FloatMatrix,
    shares: FloatArray,
    rows: IntArray,
    found: FloatArray,
) -> None:
    for i in range(rows.size):
        row = rows[i]
        own = guard.Guarded(gains, spring, memory[row])
        found[row] = guard.passed(own, gains[RELEASE], shares[row] * gains[WHOLE])


def _same_device(name: str, observed: Observed, drive: Drive) -> Observed:
    """Return the drive's observations; refuse a policy of another device or period."""
    own = drive.observed
    if own is None:
        raise CableError(
            f"policy {name!r} needs a device with an environment; this Drive has "
            "no `observed`."
        )
    for what, its, here in (
        ("for the device", device_label(observed.device), device_label(own.device)),
        ("on", ", ".join(observed.columns), ", ".join(own.columns)),
    ):
        if its != here:
            raise CableError(f"policy {name!r} was trained {what} {its}, not {here}.")
    if not math.isclose(observed.period, drive.period):
        raise CableError(
            f"policy {name!r} was trained with samples every "
            f"{1e3 * observed.period:g} ms, but is called every "
            f"{1e3 * drive.period:g} ms; give the environment the `frame_skip` of "
            "its training and hold=1, for a policy holds its actions itself."
        )
    if not drive.joint_sensor:
        raise CableError(
            f"policy {name!r} reads the joint, and this device measures nothing there; "
            "set joint_sensor = true in [sensors]."
        )
    return own


def write_policy(
    path: str | os.PathLike[str],
    network: Network,
    observed: Observed | Sequence[Observed],
) -> None:
    """Write a policy's file `*.safetensors`.

    `observed` are the observations of the only axis, or of every axis:
    `WornDevice.observed` of its environment.

    Raises:
        CableError: If the network is not for as many numbers as are observed, or as
            many motors, or the file has another ending.
    """
    if not os.fspath(path).endswith(".safetensors"):
        name = os.fspath(path)
        raise CableError(f"a policy is written as *.safetensors, not to {name!r}.")
    each = (observed,) if isinstance(observed, Observed) else tuple(observed)
    _require_fit(network, each)
    tensors = {"mean": network.mean, "deviation": network.deviation}
    layers = zip(network.weights, network.biases, strict=True)
    for place, (weights, biases) in enumerate(layers):
        tensors |= {f"{place}.weight": weights, f"{place}.bias": biases}
    about = {
        "observed": [own.to_dict() for own in each],
        "activation": network.activation,
        "squashed": network.squashed,
        "far": None if np.isinf(network.far) else float(network.far),
        "layers": len(network.weights),
    }
    content = safetensors.to_bytes(tensors, {POLICY_METADATA_KEY: json.dumps(about)})
    with replacing(Path(path)) as file:
        file.write_bytes(content)


def read_policy(path: str | os.PathLike[str]) -> tuple[Network, tuple[Observed, ...]]:
    """Read a policy's file: its network, and what it observes of every axis.

    A name without folders that is no file here is one of `assets.POLICIES`.

    Raises:
        CableError: If it cannot be read or is not one.
    """
    name = os.fspath(path)
    try:
        content = policy_file(path).read_bytes()
    except FileNotFoundError:
        raise CableError(
            f"policy {name!r}: there is no such file, and the package has "
            f"{', '.join(POLICIES)}."
        ) from None
    except OSError as error:
        raise CableError(f"policy {name!r} cannot be read: {error}.") from None
    try:
        return _parse_policy(content)
    except CableError as error:
        raise CableError(f"policy {name!r}: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise CableError(
            f"policy {name!r} is not one that `write_policy` wrote: "
            f"{type(error).__name__} {error}."
        ) from None


def _require_fit(network: Network, observed: Sequence[Observed]) -> None:
    """Raise a `CableError` if a network's inputs or motors are not those observed."""
    size = sum(own.space.shape[0] for own in observed)
    if network.mean.size != size:
        raise CableError(
            f"the policy is for {network.mean.size} numbers, but {size} are observed."
        )
    if network.motors != len(observed):
        raise CableError(
            f"the policy's layers end in {network.motors} numbers; they must end in "
            f"one for each motor, {len(observed)}."
        )


def _parse_policy(content: bytes) -> tuple[Network, tuple[Observed, ...]]:
    tensors, metadata = safetensors.from_bytes(content)
    about = parse_json(metadata[POLICY_METADATA_KEY])
    places = range(int(about["layers"]))
    network = Network(
        tuple(tensors[f"{place}.weight"] for place in places),
        tuple(tensors[f"{place}.bias"] for place in places),
        about["activation"],
        bool(about["squashed"]),
        tensors["mean"],
        tensors["deviation"],
        np.inf if about["far"] is None else float(about["far"]),
    )
    listed = about["observed"]
    # Policies of one axis were written without a list.
    each = listed if isinstance(listed, list) else [listed]
    observed = tuple(Observed.from_dict(own) for own in each)
    _require_fit(network, observed)
    return network, observed


def write_onnx(policy: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the file of a policy, see `write_policy`, as an ONNX file `*.onnx`.

    Raises:
        CableError: The policy cannot be read, or the package `onnx` is not installed:
            `pip install 'cc_mujoco[onnx]'`.
    """
    network, observed = read_policy(policy)
    onnx = import_extra("onnx", "a policy as ONNX needs the package onnx", "onnx")
    # Old versions of the format and of the operators, which every runtime reads.
    model = onnx.helper.make_model(
        _graph(onnx, network),
        producer_name="cc_mujoco",
        ir_version=8,
        opset_imports=[onnx.helper.make_opsetid("", 13)],
    )
    about = {"observed": [own.to_dict() for own in observed]}
    onnx.helper.set_model_props(model, {POLICY_METADATA_KEY: json.dumps(about)})
    onnx.checker.check_model(model, full_check=True)
    with replacing(Path(path)) as file:
        file.write_bytes(model.SerializeToString())


def is_onnx_policy(path: Path) -> bool:
    """Return whether `write_onnx` wrote a file."""
    try:
        return POLICY_METADATA_KEY.encode() in path.read_bytes()
    except OSError:
        return False


def _graph(onnx: Any, network: Network) -> Any:
    helper, kinds = onnx.helper, onnx.TensorProto
    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(name: str, value: Any) -> str:
        array = np.asarray(value, dtype=np.float64)
        constants.append(onnx.numpy_helper.from_array(array, name))
        return name

    def node(operator: str, *inputs: str, **attributes: Any) -> str:
        name = f"{operator.lower()}_{len(nodes)}"
        nodes.append(helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    x = node("Cast", "observation", to=kinds.DOUBLE)
    x = node("Sub", x, constant("mean", network.mean))
    x = node("Div", x, constant("deviation", network.deviation))
    if np.isfinite(network.far):
        far = constant("least", -network.far), constant("most", network.far)
        x = node("Min", node("Max", x, far[0]), far[1])
    last = len(network.weights) - 1
    # The identity has no operator, and `elu` none in double.
    operators = {"tanh": "Tanh", "relu": "Relu"}
    layers = zip(network.weights, network.biases, strict=True)
    for place, (weights, biases) in enumerate(layers):
        x = node("MatMul", x, constant(f"{place}.weight", weights.T))
        x = node("Add", x, constant(f"{place}.bias", biases))
        if place < last and network.activation in operators:
            x = node(operators[network.activation], x)
        elif place < last and network.activation == "elu":
            zero, one = constant(f"{place}.zero", 0.0), constant(f"{place}.one", 1.0)
            below = node("Exp", node("Min", x, zero))
            x = node("Sub", node("Add", node("Max", x, zero), below), one)
    if network.squashed:
        x = node("Tanh", x)
    x = node("Min", node("Max", x, constant("low", -1.0)), constant("high", 1.0))
    nodes.append(helper.make_node("Cast", [x], ["action"], to=kinds.FLOAT))
    shapes = ("observation", network.mean.size), ("action", network.motors)
    ends = [
        [helper.make_tensor_value_info(name, kinds.FLOAT, ["n", size])]
        for name, size in shapes
    ]
    return helper.make_graph(nodes, "policy", *ends, constants)
