"""Routes along which the plugin leads cables, read for other engines."""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.cable._parameters import BENDS, PATHS, Cable
from cc_mujoco.cable._route import Route
from cc_mujoco.native import FloatArray, compiled
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin._ffi import assign, floats, load_word
from cc_mujoco.plugin._instance_data import (
    BENDS_WITH_ROUTE,
    GUIDED,
    MOUTH,
    REFERENCE_STAGE,
    ROUTE,
    SEGMENTS,
    TIED_ENDS,
    guides_at,
    is_open,
    shape_at,
)
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._routing import follow


def routes(model: mujoco.MjModel, cables: dict[str, Cable]) -> dict[str, Route]:
    """Return how the cables are led whose path or bends a tendon gives."""
    led = {
        name: cable
        for name, cable in cables.items()
        if cable.bend != BENDS[0] or cable.path != PATHS[0]
    }
    if not led:
        return {}
    data, places, found = mujoco.MjData(model), instances(model), {}
    mujoco.mj_fwdPosition(model, data)
    for name, cable in led.items():
        n = cable.segments
        words, guides = np.zeros(6), np.zeros(n)
        reference = np.zeros(13 * (n + 1))
        _read(model._address, data._address, places[name], words, guides, reference)
        tendon, mouth, guided, bends, proximal, distal = words.astype(int).tolist()
        found[name] = Route(
            tendon, mouth, guided, bool(bends), (bool(proximal), bool(distal)), guides,
            reference,
        )  # fmt: skip
    return found


@compiled
def _read(
    model: int,
    data: int,
    instance: int,
    words: FloatArray,
    guides: FloatArray,
    reference: FloatArray,
) -> None:
    """Read a route at the position in `data`, which gives the reference too."""
    block = mj_struct.block(data, instance)
    follow(block, model, data, mj_struct.state(model, data, instance))
    n = load_word(block + SEGMENTS)
    words[0] = load_word(block + ROUTE)
    words[1] = load_word(block + MOUTH)
    words[2] = load_word(block + GUIDED)
    words[3] = load_word(block + BENDS_WITH_ROUTE)
    words[4] = load_word(block + TIED_ENDS)
    words[5] = load_word(block + TIED_ENDS + 8)
    assign(guides, floats(guides_at(block, n), n))
    if is_open(block):
        size = open_path.shape_size(n)
        assign(reference, floats(shape_at(block, n, REFERENCE_STAGE), size))
