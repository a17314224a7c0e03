"""Spatial tendons as plain lines: those that no cable colours by its tension."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cc_mujoco.viz._frame_times import frame_slices
from cc_mujoco.viz._scene3d import DEFAULT_RGBA, TIMELINE, WORLD, Branch, own_color

Array = NDArray[np.float64]

ROPE_COLOR = np.array([0.55, 0.36, 0.18, 1.0])
"""Colour of a tendon that has none of its own: brown."""


def log_tendons(
    rec: Branch,
    model: mujoco.MjModel,
    time: Array,
    qpos: Array,
    skipped: Collection[int],
) -> None:
    """Log every visible spatial tendon that is not skipped in its own colour.

    At `time` (T,) [s] in the poses `qpos` (T, nq).
    """
    for tendon, rgba in visible_tendons(model, skipped):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon)
        path = rr.new_entity_path([WORLD, "tendon", name or str(tendon)])
        radius = float(model.tendon_width[tendon])
        look = rr.LineStrips3D.from_fields(radii=[radius], colors=[rgba])
        rec.log(path, look, static=True)
        for some in frame_slices(len(time)):
            paths = tendon_paths(model, tendon, qpos[some])
            index = [rr.TimeColumn(TIMELINE, duration=time[some])]
            rec.send_columns(path, index, [*rr.LineStrips3D.columns(strips=paths)])


def visible_tendons(
    model: mujoco.MjModel, skipped: Collection[int]
) -> Iterator[tuple[int, Array]]:
    """Yield every drawn spatial tendon that is not skipped, and its colour (4,)."""
    for tendon in range(model.ntendon):
        rgba = tendon_color(model, tendon)
        if tendon not in skipped and is_spatial(model, tendon) and rgba[3] > 0:
            yield tendon, rgba


def is_spatial(model: mujoco.MjModel, tendon: int) -> bool:
    kind = model.wrap_type[model.tendon_adr[tendon]]
    return bool(kind != mujoco.mjtWrap.mjWRAP_JOINT)


def tendon_color(model: mujoco.MjModel, tendon: int) -> Array:
    """Return the colour of a tendon (4,); of one that has none, not MuJoCo's grey.

    Grey means slack where cables are coloured by tension, and such a tendon may well be
    the taut rope between a conduit and a lever.
    """
    if is_uncolored(model, tendon):
        return ROPE_COLOR.copy()
    return own_color(model, model.tendon_rgba[tendon], model.tendon_matid[tendon])


def is_uncolored(model: mujoco.MjModel, tendon: int) -> bool:
    """Return whether a tendon has neither a colour nor a material."""
    plain = np.allclose(model.tendon_rgba[tendon], DEFAULT_RGBA)
    return bool(plain and model.tendon_matid[tendon] < 0)


def tendon_paths(
    model: mujoco.MjModel, tendon: int, qpos: Array
) -> list[NDArray[np.float32]]:
    """Return the points of a tendon in every frame, each (P, 3) in metres."""
    data = mujoco.MjData(model)
    paths = []
    for coordinates in qpos:
        data.qpos[:] = coordinates
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        paths.append(tendon_points(data, tendon).astype(np.float32))
    return paths


def tendon_points(data: mujoco.MjData, tendon: int) -> Array:
    """Return the points of a tendon (P, 3) [m], up to date as by `mj_tendon`."""
    start, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
    part = slice(start, start + count)
    # -2 only separates the branches of a tendon.
    real = data.wrap_obj.reshape(-1)[part] != -2
    return np.array(data.wrap_xpos.reshape(-1, 3)[part][real])
