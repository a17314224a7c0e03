"""Reading and writing of arrays in the safetensors format, with NumPy alone.

    content = to_bytes({"gain": np.ones(3)}, {"note": "text"})
    tensors, notes = from_bytes(content)

Nothing in a file is executed. Arrays are of floats; one whose numbers all fit in 32
bits is written so.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from cc_mujoco._utils.parsing import parse_json
from cc_mujoco.native import FloatArray as Array


def to_bytes(tensors: Mapping[str, Any], metadata: Mapping[str, str]) -> bytes:
    header: dict[str, Any] = {"__metadata__": dict(metadata)}
    parts, start = [], 0
    for name, tensor in tensors.items():
        whole = np.asarray(tensor, "<f8")
        with np.errstate(over="ignore"):
            values = whole.astype("<f4")
        single = np.array_equal(whole, values)
        values = values if single else whole
        parts.append(values.tobytes())
        end = start + len(parts[-1])
        shape = list(values.shape)
        kind = "F32" if single else "F64"
        header[name] = {"dtype": kind, "shape": shape, "data_offsets": [start, end]}
        start = end
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + b"".join(parts)


def from_bytes(content: bytes) -> tuple[dict[str, Array], dict[str, str]]:
    length = int.from_bytes(content[:8], "little")
    # The longest header is that of the format's own library.
    if not 2 <= length <= min(10**8, len(content) - 8):
        raise ValueError("no header of safetensors")
    header = parse_json(content[8 : 8 + length])
    data = memoryview(content)[8 + length :]
    metadata = header.pop("__metadata__", {})
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        kind = {"F32": "<f4", "F64": "<f8"}.get(entry["dtype"])
        if kind is None or not 0 <= start <= end <= len(data):
            raise ValueError(f"tensor {name!r}")
        values = np.frombuffer(data[start:end], kind).astype(np.float64)
        tensors[name] = values.reshape(entry["shape"])
    return tensors, metadata
