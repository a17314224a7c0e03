"""Networks of policies: multilayer perceptrons, compiled.

network = Network.of_layers(layers, mean, deviation)
shares = network(observation)                   # (size,) or (n, size)
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal
from cc_mujoco.native import FloatArray as Array

ACTIVATIONS = ("tanh", "relu", "identity", "elu")
"""Names of the functions that may follow a layer."""
_TANH, _RELU, _, _ELU = range(len(ACTIVATIONS))


class PackedNetwork(NamedTuple):
    """Numbers of a network in the order in which compiled code reads them."""

    # Place of the activation in `ACTIVATIONS`; 1 where the outputs are squashed, else
    # 0; widths, that of the observation first.
    sizes: IntArray
    numbers: FloatArray  # `far`, means and deviations; weights and biases of each layer


_ACTIVATION, _SQUASHED, WIDTHS = range(3)  # places in `PackedNetwork.sizes`


@dataclass(frozen=True, eq=False)
class Network:
    """A multilayer perceptron from an observation (size,) to shares of the torques.

    Raises:
        CableError: If the layers do not fit each other.
    """

    weights: tuple[Array, ...]  # of each layer, (out, in); the last has the motors
    biases: tuple[Array, ...]  # of each layer, (out,)
    activation: str  # one of `ACTIVATIONS`, after every layer but the last
    squashed: bool  # whether hyperbolic tangents of the last outputs are the action
    mean: Array  # offset subtracted from the observation, (size,)
    deviation: Array  # divisor of the difference, (size,)
    far: float = np.inf  # bound at which the quotient is clipped

    def __post_init__(self) -> None:
        """Raise a `CableError` unless the layers fit each other."""
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
    ) -> "Network":
        """Return the network of PyTorch layers, for example a `torch.nn.Sequential`.

        They are `Linear`, with one kind of activation between them. A `Tanh` after the
        last squashes the outputs; see the class for the other arguments.

        Raises:
            CableError: If the layers are others, or an activation is not in
                `ACTIVATIONS`.
        """
        each = list(layers)
        kinds = [type(layer).__name__.lower() for layer in each]
        if kinds[-1:] == ["tanh"]:
            kinds, squashed = kinds[:-1], True
        between = kinds[1::2]
        alternate = len(kinds) % 2 == 1 and set(kinds[::2]) == {"linear"}
        if not alternate or len(set(between)) > 1:
            raise CableError(
                "a policy is Linear layers with one kind of activation between them, "
                f"not {', '.join(type(layer).__name__ for layer in each) or 'nothing'}."
            )
        if any(getattr(layer, "alpha", 1.0) != 1.0 for layer in each):
            raise CableError("the activation ELU of a policy must have alpha = 1.")
        linear = each[: len(kinds) : 2]
        weights = tuple(_numbers(layer.weight) for layer in linear)
        biases = tuple(
            np.zeros(layer.out_features) if layer.bias is None else _numbers(layer.bias)
            for layer in linear
        )
        kind = between[0] if between else "identity"
        return cls(weights, biases, kind, squashed, mean, deviation, far)

    @property
    def motors(self) -> int:
        """Number of motors that the network drives."""
        return int(self.weights[-1].shape[0])

    @cached_property
    def packed(self) -> PackedNetwork:
        """The network as arrays for compiled code."""
        kind = ACTIVATIONS.index(self.activation)
        widths = [self.mean.size, *(own.size for own in self.biases)]
        parts = [np.array([self.far]), self.mean, self.deviation]
        for weights, biases in zip(self.weights, self.biases, strict=True):
            parts += [weights.ravel(), biases]
        return PackedNetwork(
            np.array([kind, int(self.squashed), *widths], dtype=np.int64),
            np.concatenate(parts).astype(np.float64),
        )

    def __call__(self, observation: Array) -> Array:
        """Return the share of each motor's torque, within [-1, 1], (..., motors).

        The observation is (size,), or (n, size) of n environments, each by itself.

        Raises:
            CableError: If it has another size.
        """
        rows = np.ascontiguousarray(np.atleast_2d(observation), dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != self.mean.size:
            raise CableError(
                f"a policy for {self.mean.size} numbers cannot act on observations of "
                f"shape {np.shape(observation)}."
            )
        net, shares = self.packed, np.empty((len(rows), self.motors))
        work = np.empty((2, int(net.sizes[WIDTHS:].max())))
        _all_shares(net, rows, work, shares)
        return shares if np.ndim(observation) == 2 else shares[0]


def _numbers(tensor: Any) -> Array:
    numbers: Array = tensor.detach().cpu().double().numpy()
    return numbers


@internal
def shares_of(net: PackedNetwork, work: FloatMatrix) -> int:
    """Compute each motor's share of its torque; return the row of `work` that has them.

    Row 0 of `work` (2, widest layer) must begin with the observation; both rows change.
    """
    size, layers = net.sizes[WIDTHS], net.sizes.size - WIDTHS - 1
    numbers, far = net.numbers, net.numbers[0]
    for i in range(size):
        value = (work[0, i] - numbers[1 + i]) / numbers[1 + size + i]
        work[0, i] = min(max(value, -far), far)
    place, x = 1 + 2 * size, 0
    for layer in range(layers):
        width, out = net.sizes[WIDTHS + layer], net.sizes[WIDTHS + layer + 1]
        is_last = layer == layers - 1
        for row in range(out):
            total = 0.0
            for i in range(width):
                total += numbers[place + row * width + i] * work[x, i]
            total += numbers[place + out * width + row]
            if is_last:
                if net.sizes[_SQUASHED] != 0:
                    total = math.tanh(total)
                total = min(max(total, -1.0), 1.0)
            elif net.sizes[_ACTIVATION] == _TANH:
                total = math.tanh(total)
            elif net.sizes[_ACTIVATION] == _RELU:
                total = max(total, 0.0)
            elif net.sizes[_ACTIVATION] == _ELU and total < 0.0:
                total = math.expm1(total)
            work[1 - x, row] = total
        place += out * (width + 1)
        x = 1 - x
    return x


@compiled
def _all_shares(
    net: PackedNetwork, rows: FloatMatrix, work: FloatMatrix, shares: FloatMatrix
) -> None:
    for row in range(rows.shape[0]):
        work[0, : rows.shape[1]] = rows[row]
        shares[row] = work[shares_of(net, work), : shares.shape[1]]
