"""Policies as ONNX files, for runtimes without Python and this package.

    write_onnx("runs/policy.safetensors", "runs/policy.onnx")

The graph is the network: `observation` (n, size) and `action` (n, motors) of float32,
computed in double as the policy is. The definition of the observation, which the graph
does not contain, is in the metadata `cc_mujoco` as JSON; `Observed` says how to form
it. Needs `pip install 'cc_mujoco[onnx]'`.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.control._network import Network
from cc_mujoco.control._policy import POLICY_METADATA_KEY, read_policy
from cc_mujoco.errors import CableError


def write_onnx(policy: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the file of a policy, see `write_policy`, as an ONNX file `*.onnx`.

    Raises:
        CableError: The policy cannot be read, or the package `onnx` is not installed.
    """
    network, observed = read_policy(policy)
    try:
        import onnx
    except ImportError:
        raise CableError(
            "a policy as ONNX needs the package onnx: pip install 'cc_mujoco[onnx]'."
        ) from None
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


def is_policy(path: Path) -> bool:
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
