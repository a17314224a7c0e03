"""The path of a cable at every angle of one joint, as MuJoCo lays it.

    angles = np.linspace(-0.9, 1.0, 2001)
    course = compute_path_table(model, "extensor", "finger", angles)

The table has the path that the plugin finds at these angles, with all other joints as
in `qpos0`: wrap, contact and length of its pieces, for replays outside MuJoCo. Where
other joints move as well, `compute_recorded_path` has a row for every pose.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable._cable import BENDS, PATHS, Cable
from cc_mujoco.cable._coupled_route import CoupledPath
from cc_mujoco.cable._route import Route
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, compiled
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin._ffi import assign, fill, floats, load_word
from cc_mujoco.plugin._mjcf import cable_of, instances
from cc_mujoco.plugin._routing import follow

_TRIAL_TURN = 1e-3
"""Turn by which a joint is tried [rad]."""
_SLOPE_TURN = 1e-4
"""Turn either way by which a slope is found [rad]."""
_ROUNDING_RATE = 1e-6
"""Change by rounding of a path that a joint does not move, per radian."""


def compute_path_table(
    model: mujoco.MjModel, cable: str, joint: str, angles: FloatArray
) -> CoupledPath:
    """Compute the course of a cable's path as a joint turns.

    `joint` is a hinge; no other may move the path, see `moving_joints`. `angles` go by
    equal steps from 0 or below up [rad].
    """
    walk = _Walk(model, cable)
    place = int(model.joint(joint).qposadr[0])
    n, count = walk.wrap.size, angles.size
    wrap, contact = np.empty((2, count, n))
    gained, length = np.empty((2, count, n + 1))
    distal = np.empty(count)
    start = int(np.searchsorted(angles, 0.0))
    pose = model.qpos0.copy()
    for rows in (range(start, count), range(start - 1, -1, -1)):
        pose[place] = 0.0
        rest = walk.lay(pose)
        total = np.zeros(n + 1)
        for k in rows:
            pose[place] = angles[k]
            distal[k] = walk.lay(pose) - rest
            total += walk.longer
            wrap[k], contact[k], gained[k] = walk.wrap, walk.contact, total
            length[k] = walk.length
    guided = walk.guided()
    if guided == n:
        length = np.empty((0, n + 1))
    return CoupledPath(np.array(angles), wrap, contact, gained, distal, length, guided)


def compute_recorded_path(
    model: mujoco.MjModel, cable: str, joint: str, poses: FloatArray
) -> CoupledPath:
    """Compute the course of a cable's path along poses, by the number of the pose.

    The slopes are by the angle of `joint`, a hinge. `poses` (poses, nq) go from near
    `qpos0` on by small steps.
    """
    walk = _Walk(model, cable)
    place = int(model.joint(joint).qposadr[0])
    n, count = walk.wrap.size, len(poses)
    wrap, contact = np.empty((2, count, n))
    gained, length, gain = np.empty((3, count, n + 1))
    distal, arm = np.empty((2, count))
    rest = walk.lay(model.qpos0)
    total = np.zeros(n + 1)
    for k, pose in enumerate(poses):
        distal[k] = walk.lay(pose) - rest
        total += walk.longer
        wrap[k], contact[k], gained[k] = walk.wrap, walk.contact, total
        length[k] = walk.length
        aside = pose.copy()
        aside[place] += _SLOPE_TURN
        ahead = walk.lay(aside, stay=True)
        gain[k] = walk.longer
        aside[place] -= 2.0 * _SLOPE_TURN
        arm[k] = (ahead - walk.lay(aside, stay=True)) / (2.0 * _SLOPE_TURN)
        gain[k] = (gain[k] - walk.longer) / (2.0 * _SLOPE_TURN)
    guided = walk.guided()
    if guided == n:
        length = np.empty((0, n + 1))
    rows = np.arange(count, dtype=np.float64)
    return CoupledPath(
        rows, wrap, contact, gained, distal, length, guided, gain=gain, arm=arm
    )


def moving_joints(
    model: mujoco.MjModel, cable: str, poses: int = 8, pulled: bool = False
) -> list[str]:
    """Return the joints that move the path or distal end of a cable in some pose.

    With `pulled` without those that only bend its conduit, which it does not pull.
    """
    walk = _Walk(model, cable)
    random = np.random.default_rng(0)
    found: dict[str, None] = {}
    for _ in range(poses):
        pose = model.qpos0.copy()
        mujoco.mj_integratePos(model, pose, random.uniform(-0.5, 0.5, model.nv), 1.0)
        for dof in range(model.nv):
            turn, moved = np.zeros(model.nv), pose.copy()
            turn[dof] = _TRIAL_TURN
            mujoco.mj_integratePos(model, moved, turn, 1.0)
            before, wrap = walk.lay(pose), walk.wrap.copy()
            after = walk.lay(moved)
            parts = [walk.longer, np.array([after - before])]
            if not pulled:
                parts.append(walk.wrap - wrap)
            if (
                max(float(np.abs(part).max()) for part in parts)
                > _ROUNDING_RATE * _TRIAL_TURN
            ):
                found[str(model.joint(int(model.dof_jntid[dof])).name)] = None
    return list(found)


class _Walk:
    """A simulation whose cable is led along its path, pose by pose.

    Attributes:
        wrap: of the segments in the last pose (n,) [rad].
        contact: length over which they rub (n,) [m].
        longer: what the path gained at every node since the pose before (n + 1,) [m].
        length: of an open path at every node (n + 1,) [m].
    """

    def __init__(self, model: mujoco.MjModel, cable: str) -> None:
        known = instances(model)
        if cable not in known:
            raise CableError.unknown("cable", cable, known)
        self._model, self._data = model, mujoco.MjData(model)
        self._instance = known[cable]
        n = cable_of(model, self._instance, cable).segments
        self.wrap, self.contact = np.empty((2, n))
        self.longer, self.length = np.empty((2, n + 1))
        self.lay(model.qpos0)

    def lay(self, pose: FloatArray, stay: bool = False) -> float:
        """Lay the cable along its path in a pose; return its distal displacement.

        With `stay` the next pose is compared with the one before, not with this one.
        """
        self._data.qpos[:] = pose
        mujoco.mj_fwdPosition(self._model, self._data)
        return float(
            _lay_path(
                self._model._address,
                self._data._address,
                self._instance,
                self.wrap,
                self.contact,
                self.longer,
                self.length,
                stay,
            )
        )

    def guided(self) -> int:
        """Return the number of segments in a conduit."""
        return int(_guided_segments(self._data._address, self._instance))


@compiled
def _lay_path(
    model: int,
    data: int,
    instance: int,
    wrap: FloatArray,
    contact: FloatArray,
    longer: FloatArray,
    length: FloatArray,
    stay: bool,
) -> float:
    block, state = (
        mj_struct.block(data, instance),
        mj_struct.state(model, data, instance),
    )
    n = load_word(block + blocks.SEGMENTS)
    follow(block, model, data, state)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    assign(wrap, layout.segment_angles(prm, n))
    assign(contact, layout.contact_length(prm, n))
    fill(longer, 0.0)
    if blocks.is_open(block):
        shape = floats(blocks.shape_at(block, n, 0), open_path.shape_size(n))
        assign(longer, floats(blocks.scratch_at(block, n), n + 1))
        assign(length, open_path.lengths(shape, n))
        if not stay:
            open_path.save_path(shape, n, blocks.path_memory(state, n))
    return blocks.displacement(data, block, blocks.DISTAL)


@compiled
def _guided_segments(data: int, instance: int) -> int:
    return load_word(mj_struct.block(data, instance) + blocks.GUIDED)


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
    n = load_word(block + blocks.SEGMENTS)
    words[0] = load_word(block + blocks.ROUTE)
    words[1] = load_word(block + blocks.MOUTH)
    words[2] = load_word(block + blocks.GUIDED)
    words[3] = load_word(block + blocks.BENDS_WITH_ROUTE)
    words[4] = load_word(block + blocks.TIED_ENDS)
    words[5] = load_word(block + blocks.TIED_ENDS + 8)
    assign(guides, floats(blocks.guides_at(block, n), n))
    if blocks.is_open(block):
        size = open_path.shape_size(n)
        assign(
            reference, floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), size)
        )
