"""The path of a cable at every angle of one joint, as MuJoCo computes it.

    angles = np.linspace(-0.9, 1.0, 2001)
    course = compute_path_table(model, "extensor", "finger", angles)

The table has the path that the plugin finds at these angles, with all other joints as
in `qpos0`: wrap, contact and length of its pieces, for replays outside MuJoCo. If other
joints move as well, `compute_recorded_path` has a row for every pose.
"""

from dataclasses import replace

import mujoco
import numpy as np

from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._cable import BENDS, PATHS, Cable
from cc_mujoco.cable._coupled_route import CoupledPath
from cc_mujoco.cable._route import Route
from cc_mujoco.errors import look_up
from cc_mujoco.native import FloatArray, compiled
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._mjcf import cable_of, instances
from cc_mujoco.plugin._routing import follow, set_reference


def compute_path_table(
    model: mujoco.MjModel, cable: str, joint: str, angles: FloatArray
) -> CoupledPath:
    """Compute the path of a cable at every angle of one joint.

    `joint` is a hinge; no other joint may move the path, see `moving_joints`. `angles`
    [rad] increase by equal steps and begin at 0 or below.
    """
    walk = _Walk(model, cable)
    course = walk.make_course(np.array(angles))
    place = int(model.joint(joint).qposadr[0])
    first, poses = model.qpos0.copy(), np.tile(model.qpos0, (angles.size, 1))
    first[place], poses[:, place] = 0.0, angles
    start = int(np.searchsorted(angles, 0.0))
    for rows in (range(start, angles.size), range(start - 1, -1, -1)):
        walk.follow(course, rows, first, poses)
    return course


def compute_recorded_path(
    model: mujoco.MjModel, cable: str, joint: str, poses: FloatArray
) -> CoupledPath:
    """Compute the path of a cable in each of a sequence of poses.

    In the result `joint` is the number of the pose, while slopes are per angle of the
    hinge `joint`. `poses` (poses, nq) begin near `qpos0` and change by small steps.
    """
    walk, place = _Walk(model, cable), int(model.joint(joint).qposadr[0])
    course = walk.make_course(np.arange(len(poses), dtype=np.float64), slopes=True)
    walk.follow(course, range(len(poses)), model.qpos0, poses, place)
    return course


def moving_joints(
    model: mujoco.MjModel, cable: str, poses: int = 8, pulled: bool = False
) -> list[str]:
    """Return the names of joints that move a cable's path or distal end.

    They are tried in a number of random `poses`. If `pulled`, joints that only bend the
    conduit are left out: the cable does not pull them.
    """
    walk = _Walk(model, cable)
    random = np.random.default_rng(0)
    found: dict[str, None] = {}
    for _ in range(poses):
        pose = model.qpos0.copy()
        mujoco.mj_integratePos(model, pose, random.uniform(-0.5, 0.5, model.nv), 1.0)
        for dof in range(model.nv):
            turn, moved = np.zeros(model.nv), pose.copy()
            turn[dof] = 1e-3  # rad
            mujoco.mj_integratePos(model, moved, turn, 1.0)
            before, wrap = walk.lay(pose), walk.wrap.copy()
            after = walk.lay(moved)
            parts = [walk.longer, np.array([after - before])]
            if not pulled:
                parts.append(walk.wrap - wrap)
            # By rounding a path that a joint does not move changes by 1e-6 per radian.
            if max(float(np.abs(part).max()) for part in parts) > 1e-6 * turn[dof]:
                found[str(model.joint(int(model.dof_jntid[dof])).name)] = None
    return list(found)


class _Walk:
    """A simulation that measures a cable's path pose by pose.

    Attributes:
        wrap: wrap angles of the segments in the last pose (n,) [rad].
        contact: lengths over which they rub (n,) [m].
        longer: growth of the path at every node since the pose before (n + 1,) [m].
        length: length of an open path at every node (n + 1,) [m].
    """

    def __init__(self, model: mujoco.MjModel, cable: str) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._instance = look_up("cable", cable, instances(model))
        n = cable_of(model, self._instance, cable).segments
        self.wrap, self.contact = np.empty((2, n))
        self.longer, self.length = np.empty((2, n + 1))
        self._given = (
            model._address, self._data._address, self._instance, self.wrap,
            self.contact, self.longer, self.length,
        )  # fmt: skip
        self.lay(model.qpos0)

    def lay(self, pose: FloatArray, stay: bool = False) -> float:
        """Measure the path in a pose (nq,); return the distal displacement [m].

        With `stay` the next pose is still compared with the pose before this one.
        """
        self._data.qpos[:] = pose
        mujoco.mj_fwdPosition(self._model, self._data)
        return float(_lay_path(*self._given, stay))

    def make_course(self, joint: FloatArray, slopes: bool = False) -> CoupledPath:
        """Return an empty table for angles [rad] or numbers of poses `joint`."""
        n, count = self.wrap.size, joint.size
        guided = _route_of(self._data._address, self._instance)[2]
        wrap, contact = np.empty((2, count, n))
        gained, length, gain = np.empty((3, count, n + 1))
        distal, arm = np.empty((2, count))
        if guided == n:
            length = length[:0]
        course = CoupledPath(joint, wrap, contact, gained, distal, length, guided)
        return replace(course, gain=gain, arm=arm) if slopes else course

    def follow(
        self,
        course: CoupledPath,
        rows: range,
        first: FloatArray,
        poses: FloatArray,
        turned: int | None = None,
    ) -> None:
        """Fill `rows` of a table from `poses` (k, nq), beginning at pose `first`.

        If the index `turned` of an angle in `qpos` is given, fill in its slopes too.
        """
        rest, total = self.lay(first), np.zeros(self.longer.size)
        turn = 1e-4  # either way, by which a slope is found [rad]
        for k in rows:
            course.distal[k] = self.lay(poses[k]) - rest
            total += self.longer
            course.wrap[k], course.contact[k] = self.wrap, self.contact
            course.gained[k] = total
            if course.open:
                course.length[k] = self.length
            if turned is not None:
                assert course.gain is not None and course.arm is not None
                aside = poses[k].copy()
                aside[turned] += turn
                ahead, longer = self.lay(aside, stay=True), self.longer.copy()
                aside[turned] -= 2.0 * turn
                course.arm[k] = (ahead - self.lay(aside, stay=True)) / (2.0 * turn)
                course.gain[k] = (longer - self.longer) / (2.0 * turn)


@compiled
def _lay_path(
    model: MjModel, data: MjData, instance: int, wrap: FloatArray, contact: FloatArray,
    longer: FloatArray, length: FloatArray, stay: bool,
) -> float:  # fmt: skip
    block = blocks.block_at(data, instance)
    state, n = ffi.state(model, data, instance), block.segments
    follow(block, model, data, state)
    prm = blocks.parameters(block)
    wrap[:] = layout.segment_angles(prm, n)
    contact[:] = layout.contact_length(prm, n)
    longer[:] = 0.0
    if blocks.is_open(block):
        shape = blocks.shape(block, 0)
        longer[:] = blocks.node_scratch(block)
        length[:] = open_path.lengths(shape, n)
        if not stay:
            open_path.save_path(shape, n, blocks.path_memory(state, n))
    return blocks.displacement(data, block, 1)


@compiled
def _route_of(
    data: MjData, instance: int
) -> tuple[int, int, int, bool, tuple[bool, bool]]:
    """Return the fields of a cable's `Route` that are no arrays."""
    block = blocks.block_at(data, instance)
    tied = block.tied[0] != 0, block.tied[1] != 0
    bends = block.bends_with_route != 0
    return block.route, block.mouth, block.guided, bends, tied


def routes(model: mujoco.MjModel, cables: dict[str, Cable]) -> dict[str, Route]:
    """Return the `Route` of every cable that a tendon guides or bends, by name."""
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
        guides, reference = np.zeros(n), np.zeros(13 * (n + 1))
        _read(model._address, data._address, places[name], guides, reference)
        own = _route_of(data._address, places[name])
        found[name] = Route(*own, guides, reference)
    return found


@compiled
def _read(
    model: MjModel, data: MjData, instance: int, guides: FloatArray,
    reference: FloatArray,
) -> None:  # fmt: skip
    block = blocks.block_at(data, instance)
    follow(block, model, data, ffi.state(model, data, instance))
    if blocks.is_open(block):
        guides[:] = blocks.path_of(block, 0).guides
        reference[:] = blocks.shape(block, blocks.REFERENCE_STAGE)
    else:
        if block.reference_known == 0:
            set_reference(block, model, data)
        n = block.segments
        reference[:n] = blocks.shape(block, blocks.REFERENCE_STAGE)[:n]
