"""Effects that a policy was trained on, as its file states.

    declare_training("runs/0.safetensors", ["viscous", "tremor"])
    trained_on("runs/0.safetensors")                # "tremor, viscous"

The names are those of conditions, without `structure-`. The ordinary condition counts
as trained on. A user who writes a file by other means may declare nothing, or what is
wrong; the statement is theirs.
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path

from cc_mujoco._utils import safetensors
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco.assets import policy_file
from cc_mujoco.benchmark._faults import EVENTS
from cc_mujoco.benchmark._plant import BRISTLES, STRUCTURES, UNSEEN_EFFECTS
from cc_mujoco.control import read_policy
from cc_mujoco.control._registry import is_policy
from cc_mujoco.errors import CableError, look_up

NOT_STATED = "not stated"
KEY = "trained_on"  # of the metadata of a file, and column of results


def declare_training(path: str | os.PathLike[str], effects: Iterable[str]) -> None:
    """Write into a policy's file which effects its training had; () is none."""
    known = dict.fromkeys((*STRUCTURES, *UNSEEN_EFFECTS, BRISTLES, *EVENTS))
    named = sorted(set(effects))
    for name in named:
        look_up("effect", name, known)
    read_policy(path)
    tensors, about = safetensors.from_bytes(Path(path).read_bytes())
    content = safetensors.to_bytes(tensors, about | {KEY: json.dumps(named)})
    with replacing(Path(path)) as file:
        file.write_bytes(content)


def trained_on(law: str) -> str:
    """Return the effects in a policy's training, `NOT_STATED`, or "" of no policy."""
    if not is_policy(law):
        return ""
    read_policy(law)  # or an error that says why it is none
    named = safetensors.from_bytes(policy_file(law).read_bytes())[1].get(KEY)
    if named is None:
        return NOT_STATED
    listed = parse_json(named)
    if not isinstance(listed, list) or not all(isinstance(n, str) for n in listed):
        raise CableError(
            f"policy {law!r}: `{KEY}` must be a list of effects, not {named}."
        )
    return ", ".join(listed) or "no effect"
