"""Policies: small networks that were trained on an environment, and their files.

    write_policy("runs/policy.safetensors", network, observed)
    controller("runs/policy.safetensors", drive)

A file has the weights as safetensors and, in its header, what the policy observes of
each axis as JSON. Nothing in it is executed, and NumPy alone reads and plays it.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import safetensors
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._controller import Controller, limit_torques
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._description import device_label
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._observation import ObservationHistory, Observed
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

POLICY_METADATA_KEY = "cc_mujoco"
"""Key of the JSON in the metadata of a file."""

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "identity": lambda x: x,
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
}
"""Functions that may follow a layer, by name."""


@dataclass(frozen=True, eq=False)
class Network:
    """A multilayer perceptron from an observation (size,) to shares of the torques.

    Attributes:
        weights: of each layer, (out, in); the last has an output for each motor.
        biases: of each layer, (out,).
        activation: key of `ACTIVATIONS`, after every layer but the last.
        squashed: whether the hyperbolic tangents of the last outputs are the action.
        mean: what is subtracted from the observation, (size,).
        deviation: what it is divided by then, (size,).
        far: where what results is cut.

    Raises:
        CableError: If the layers do not fit each other.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    activation: str
    squashed: bool
    mean: Array
    deviation: Array
    far: float = np.inf

    def __post_init__(self) -> None:
        """Refuse layers that do not fit."""
        if self.activation not in ACTIVATIONS:
            raise CableError.unknown("activation", self.activation, ACTIVATIONS)
        widths = [self.mean.size]
        for weights, biases in zip(self.weights, self.biases, strict=True):
            fits = weights.ndim == 2 and weights.shape[1] == widths[-1]
            if not fits or biases.shape != weights.shape[:1]:
                raise CableError(
                    f"a layer of shape {weights.shape} with {biases.shape} biases does "
                    f"not follow {widths[-1]} numbers."
                )
            widths.append(weights.shape[0])
        arrays = (*self.weights, *self.biases, self.mean, self.deviation)
        if len(widths) < 2 or self.deviation.shape != (widths[0],):
            raise CableError(
                "a policy needs a layer, and a deviation for each number it observes."
            )
        if not all(np.isfinite(array).all() for array in arrays):
            raise CableError("a policy's weights must be finite numbers.")
        if not (self.deviation > 0.0).all():
            raise CableError("a policy's deviations must be above 0.")

    @classmethod
    def of_layers(
        cls,
        layers: Iterable[Any],
        mean: Array,
        deviation: Array,
        squashed: bool = False,
        far: float = np.inf,
    ) -> Network:
        """Return the network of PyTorch layers, for example a `torch.nn.Sequential`.

        Args:
            layers: `Linear`, with one kind of activation between them.
            mean: Of the observations, as of the class.
            deviation: See there.
            squashed: See there.
            far: See there.

        Raises:
            CableError: If activations differ or are not in `ACTIVATIONS`.
        """
        each = list(layers)
        linear = [layer for layer in each if hasattr(layer, "weight")]
        kinds = {type(layer).__name__.lower() for layer in each} - {"linear"}
        if len(kinds) > 1:
            raise CableError(
                f"a policy has one activation, not {', '.join(sorted(kinds))}."
            )
        weights, biases = (
            tuple(getattr(one, name).detach().cpu().double().numpy() for one in linear)
            for name in ("weight", "bias")
        )
        kind = kinds.pop() if kinds else "identity"
        return cls(weights, biases, kind, squashed, mean, deviation, far)

    @property
    def motors(self) -> int:
        """Number of motors that it drives."""
        return int(self.weights[-1].shape[0])

    def __call__(self, observation: Array) -> Array:
        """Return the share of each motor's torque, within [-1, 1], (motors,)."""
        x = (observation - self.mean) / self.deviation
        x = np.minimum(np.maximum(x, -self.far), self.far)
        between = ACTIVATIONS[self.activation]
        last = len(self.weights) - 1
        for place, (weights, biases) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            x = weights @ x + biases
            if place < last:
                x = between(x)
        # One by one: of several at once NumPy may round a tangent differently.
        shares = [np.tanh(own) if self.squashed else own for own in x]
        return np.minimum(np.maximum(shares, -1.0), 1.0)


class Policy(Controller):
    """A policy of a file, fed as in the environment of its training."""

    def __init__(
        self,
        drives: Drive | Sequence[Drive],
        path: str | os.PathLike[str],
        prefixes: Sequence[str] = ("",),
    ) -> None:
        """Load the policy.

        Args:
            drives: The device to be driven: its only axis, or every axis.
            path: The file.
            prefixes: Beginnings of the columns of each axis.

        Raises:
            CableError: If the file cannot be read, or has a policy of another device or
                for other samples.
        """
        self._drives = (drives,) if isinstance(drives, Drive) else tuple(drives)
        super().__init__(self._drives[0])
        self._prefixes = tuple(prefixes)
        self._network, self._observed = read_policy(path)
        name = os.fspath(path)
        if len(self._observed) != len(self._drives):
            raise CableError(
                f"policy {name!r} drives {_axes_text(len(self._observed))} at once, "
                f"and is given {_axes_text(len(self._drives))}: play it as the one "
                "controller of the device of its training."
            )
        for observed, drive in zip(self._observed, self._drives, strict=True):
            _require_same(name, observed, drive)
        self._wholes = [
            drive.observed.torque for drive in self._drives if drive.observed
        ]
        self._histories: list[ObservationHistory] = []
        self._fresh = np.zeros(0, dtype=np.bool_)
        self._samples = np.zeros(0, dtype=np.intp)
        self._shares = np.zeros((0, len(self._drives)))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset the state; see `Controller.reset`."""
        if where is None or not self._histories:
            self._histories = []
        else:
            self._fresh |= where

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`.

        Of several axes that of every motor, (..., axes). An observation with what is no
        number, or beyond `guard.MAX_READING`, gives none.
        """
        seen = [
            observed.of(axis_columns(observation, prefix, self._prefixes))
            for observed, prefix in zip(self._observed, self._prefixes, strict=True)
        ]
        many = seen[0].ndim == 2
        measured = [np.atleast_2d(own) for own in seen]
        # Elsewhere one observation that cannot be would stay in the past of a policy.
        heard = np.all([guard.is_heard(own).all(axis=1) for own in measured], axis=0)
        if not heard.any():
            torque = np.zeros((len(heard), len(self._drives)))
            return self._each(torque, many)
        if not heard.all():
            measured = [np.where(heard[:, None], own, 0.0) for own in measured]
        if not self._histories:
            count = len(measured[0])
            self._histories = [ObservationHistory(own, count) for own in self._observed]
            self._fresh = np.ones(count, dtype=np.bool_)
            self._samples = np.zeros(count, dtype=np.intp)
            self._shares = np.zeros((count, len(self._drives)))
        fresh, again = self._fresh, self._fresh.any()
        for history, own in zip(self._histories, measured, strict=True):
            history.add(own)
            if again:
                history.begin(own[fresh], fresh)
        if again:
            self._samples[fresh] = 0
            fresh[:] = False
        due = self._samples % self._observed[0].hold == 0
        if due.any():
            rows = np.concatenate(
                [one.observation() for one in self._histories], axis=1
            )
            rows = rows.astype(np.float64)
            # One by one: a product rounds differently for one environment and for many.
            for row in np.flatnonzero(due):
                self._shares[row] = self._network(rows[row]).astype(np.float32)
            for axis, history in enumerate(self._histories):
                history.act(self._shares[:, axis], due)
        self._samples += 1
        # Of the device's motors, whatever these drives limit them to.
        return self._each(self._shares * self._wholes * heard[:, None], many)

    def _each(self, torque: Array, many: bool) -> Any:
        """Return torques (rows, axes) as `Controller.torque` does, limited."""
        if len(self._drives) == 1:
            return self.limited(torque[:, 0] if many else float(torque[0, 0]))
        limited = limit_torques(torque, self._drives)
        return limited if many else limited[0]


def _axes_text(count: int) -> str:
    return "one axis" if count == 1 else f"{count} axes"


def _require_same(name: str, observed: Observed, drive: Drive) -> None:
    """Refuse a policy of another device or for other samples."""
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


def write_policy(
    path: str | os.PathLike[str],
    network: Network,
    observed: Observed | Sequence[Observed],
) -> None:
    """Write a policy's file.

    Args:
        path: Where; ends in `.safetensors`.
        network: The policy.
        observed: What it observes of the only axis, or of every axis:
            `WornDevice.observed` of its environment.

    Raises:
        CableError: If the network is not for as many numbers as are observed, or as
            many motors.
    """
    each = (observed,) if isinstance(observed, Observed) else tuple(observed)
    _require_fit(network, each)
    tensors = {"mean": network.mean, "deviation": network.deviation}
    for place, (weights, biases) in enumerate(
        zip(network.weights, network.biases, strict=True)
    ):
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


def read_policy(
    path: str | os.PathLike[str],
) -> tuple[Network, tuple[Observed, ...]]:
    """Read a policy's file: its network, and what it observes of every axis.

    Raises:
        CableError: If it cannot be read or is not one.
    """
    name = os.fspath(path)
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise CableError(f"policy {name!r}: there is no such file.") from None
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
    """Refuse a network for other numbers than are observed, or other motors."""
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
