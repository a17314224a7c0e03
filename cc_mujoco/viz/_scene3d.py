"""The 3-D scene of a MuJoCo model as Rerun entities.

Geoms are logged once, as static shapes below their body. A body that can move has one
transform per frame, from `mj_kinematics` at the recorded `qpos`, so a log needs no body
poses. Spatial tendons that are not coloured as cables are plain lines.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._attachments import is_spatial
from cc_mujoco.viz._film_plots import frame_slices


@dataclass(frozen=True)
class Branch:
    """A Rerun recording and the entity path below which an episode is logged."""

    rec: rr.RecordingStream
    root: str = ""  # path under which all of it lies, escaped

    def log(self, path: str, what: Any, *, static: bool = False) -> None:
        self.rec.log(self._full_path(path), what, static=static)

    def send_columns(
        self, path: str, index: Iterable[Any], columns: Sequence[Any]
    ) -> None:
        """Log a whole series at a path below the root, and wait until it is encoded.

        Without waiting, all series of a long episode would queue up in memory.
        """
        self.rec.send_columns(self._full_path(path), index, columns)
        self.rec.flush()

    def send_series(self, path: str, time: Array, columns: Sequence[Any]) -> None:
        """Log a series over simulated time (T,) [s]; see `send_columns`."""
        self.send_columns(path, [rr.TimeColumn(TIMELINE, duration=time)], columns)

    def _full_path(self, path: str) -> str:
        return f"{self.root}/{path.removeprefix('/')}"


WORLD, TIMELINE = "world", "sim_time"


def log_static(rec: Branch, model: mujoco.MjModel) -> None:
    """Log every visible geom once, below its moving body or in the reference pose."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rec.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for geom, rgba in visible_geoms(model):
        body = int(model.geom_bodyid[geom])
        if model.body_weldid[body] == 0:
            position, quaternion = data.geom_xpos[geom], np.empty(4)
            mujoco.mju_mat2Quat(quaternion, data.geom_xmat[geom])
        else:
            position, quaternion = model.geom_pos[geom], model.geom_quat[geom]
        name = _name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        path = rr.new_entity_path([*_body_path(model, body), name])
        # MuJoCo's quaternion has its real part first.
        turn = rr.Quaternion(xyzw=np.roll(quaternion, -1))
        pose = rr.Transform3D(translation=position, quaternion=turn)
        rec.log(path, pose, static=True)
        rec.log(path, _shape(model, geom, rgba), static=True)


def visible_geoms(model: mujoco.MjModel) -> Iterator[tuple[int, Array]]:
    """Yield the id and RGBA colour (4,) of every geom that is drawn."""
    for geom in range(model.ngeom):
        rgba = own_color(model, model.geom_rgba[geom], model.geom_matid[geom])
        if model.geom_group[geom] < 3 and rgba[3] > 0:  # as in MuJoCo's own viewers
            yield geom, rgba


def set_pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> None:
    """Compute bodies, cameras and tendons in `data` for the pose `qpos` (nq,)."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)


def posed(model: mujoco.MjModel, qpos: Array) -> Iterator[mujoco.MjData]:
    """Yield the same data in each of the poses `qpos` (T, nq), see `set_pose`."""
    data = mujoco.MjData(model)
    for coordinates in qpos:
        set_pose(model, data, coordinates)
        yield data


def body_poses(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array]:
    """Return body positions (T, nbody, 3) [m] and quaternions (T, nbody, 4)."""
    each = [np.hstack([data.xpos, data.xquat]) for data in posed(model, qpos)]
    poses = np.reshape(each, (len(qpos), model.nbody, 7))
    return poses[..., :3], poses[..., 3:]


def log_motion(rec: Branch, model: mujoco.MjModel, time: Array, qpos: Array) -> None:
    """Log poses of all moving bodies, at `time` (T,) [s], for `qpos` (T, nq)."""
    moving = np.flatnonzero(model.body_weldid != 0)
    for some in frame_slices(len(time)):
        position, quaternion = body_poses(model, qpos[some])
        for body in moving.tolist():
            path = rr.new_entity_path(_body_path(model, body))
            turn, place = np.roll(quaternion[:, body], -1, axis=1), position[:, body]
            columns = rr.Transform3D.columns(translation=place, quaternion=turn)
            rec.send_series(path, time[some], [*columns])


def viewpoint(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Return position (3,) and target (3,) of the initial view [m].

    It is the model's first camera, or MuJoCo's free camera if it has none.
    """
    if model.ncam:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        position = np.array(data.cam_xpos[0])
        backward = data.cam_xmat[0].reshape(3, 3)[:, 2]
        away = float((position - model.stat.center) @ backward)
        return position, position - max(away, 0.1) * backward
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    flat = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    forward = np.append(flat, np.sin(elevation))
    target = np.array(camera.lookat)
    return target - camera.distance * forward, target


def _body_path(model: mujoco.MjModel, body: int) -> list[str]:
    kind = "fixed" if model.body_weldid[body] == 0 else "moving"
    return [WORLD, kind, _name(model, mujoco.mjtObj.mjOBJ_BODY, body)]


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    return mujoco.mj_id2name(model, kind, index) or str(index)


def own_color(model: mujoco.MjModel, rgba: Array, material: int) -> Array:
    """Return the colour that MuJoCo draws: `rgba` (4,) if set, else the material's."""
    if material < 0 or not _is_default(rgba):
        return np.array(rgba, dtype=float)
    color = np.array(model.mat_rgba[material], dtype=float)
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture >= 0:
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        size = int(model.tex_height[texture] * model.tex_width[texture]) * channels
        pixels = model.tex_data[start : start + size].reshape(-1, channels)
        color[:3] *= pixels.mean(axis=0)[:3] / 255.0
    return color


def _shape(model: mujoco.MjModel, geom: int, rgba: Array) -> Any:
    kind, size, shape = model.geom_type[geom], model.geom_size[geom], mujoco.mjtGeom
    look: dict[str, Any] = {"colors": [rgba], "fill_mode": "solid"}
    round_look: dict[str, Any] = {"lengths": [2 * size[1]], "radii": [size[0]]} | look
    if kind == shape.mjGEOM_PLANE:
        # A side of size 0 is infinite and drawn as large as fits.
        x, y = (half if half > 0 else 2 * model.stat.extent for half in size[:2])
        corners = [[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]
        triangles = [[0, 1, 2], [0, 2, 3]]
        mesh: Any = {"vertex_positions": corners, "triangle_indices": triangles}
        return rr.Mesh3D(**mesh, vertex_normals=[[0, 0, 1]] * 4, albedo_factor=rgba)
    if kind == shape.mjGEOM_MESH:
        points, faces = mesh_arrays(model, geom)
        mesh = {"vertex_positions": points, "triangle_indices": faces}
        return rr.Mesh3D(**mesh, albedo_factor=rgba)
    if kind == shape.mjGEOM_SPHERE:
        return rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], **look)
    if kind == shape.mjGEOM_ELLIPSOID:
        return rr.Ellipsoids3D(half_sizes=[size], **look)
    if kind == shape.mjGEOM_CYLINDER:
        return rr.Cylinders3D(**round_look)
    if kind == shape.mjGEOM_CAPSULE:
        # Rerun's capsule starts at its origin, MuJoCo's is centred on it.
        return rr.Capsules3D(translations=[[0.0, 0.0, -size[1]]], **round_look)
    if kind == shape.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=[size], **look)
    # Height fields and signed distance fields: their bounding box.
    center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return rr.Boxes3D(centers=[center], half_sizes=[half], colors=[rgba])


def mesh_arrays(model: mujoco.MjModel, geom: int) -> tuple[Any, Any]:
    """Return the vertices (V, 3) [m] and triangles (F, 3) of a mesh geom."""
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices, triangles = model.mesh_vert, model.mesh_face
    return vertices[first : first + count], triangles[face : face + faces]


ROPE_COLOR = np.array([0.55, 0.36, 0.18, 1.0])  # of uncoloured tendons: brown


def log_tendons(
    rec: Branch,
    model: mujoco.MjModel,
    time: Array,
    qpos: Array,
    skipped: Collection[int],
) -> None:
    """Log visible spatial tendons but `skipped` ones at `time` (T,), `qpos` (T, nq)."""
    for tendon, rgba in visible_tendons(model, skipped):
        name = _name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon)
        path = rr.new_entity_path([WORLD, "tendon", name])
        radius = float(model.tendon_width[tendon])
        look = rr.LineStrips3D.from_fields(radii=[radius], colors=[rgba])
        rec.log(path, look, static=True)
        for some in frame_slices(len(time)):
            paths = tendon_paths(model, tendon, qpos[some])
            rec.send_series(path, time[some], [*rr.LineStrips3D.columns(strips=paths)])


def visible_tendons(
    model: mujoco.MjModel, skipped: Collection[int]
) -> Iterator[tuple[int, Array]]:
    """Yield id and colour (4,) of every drawn spatial tendon except `skipped` ones."""
    for tendon in range(model.ntendon):
        rgba, material = model.tendon_rgba[tendon], model.tendon_matid[tendon]
        plain = is_uncolored(model, tendon)
        # Not in MuJoCo's default grey, which means slack here.
        rgba = ROPE_COLOR.copy() if plain else own_color(model, rgba, material)
        if tendon not in skipped and is_spatial(model, tendon) and rgba[3] > 0:
            yield tendon, rgba


def is_uncolored(model: mujoco.MjModel, tendon: int) -> bool:
    is_default = _is_default(model.tendon_rgba[tendon])
    return is_default and bool(model.tendon_matid[tendon] < 0)


def _is_default(rgba: Array) -> bool:
    """Return whether a colour is MuJoCo's default grey of an uncoloured object."""
    return np.allclose(rgba, (0.5, 0.5, 0.5, 1.0))


def tendon_paths(
    model: mujoco.MjModel, tendon: int, qpos: Array
) -> list[NDArray[np.float32]]:
    """Return a tendon's points (P, 3) [m] in every pose of `qpos` (T, nq)."""
    each = (tendon_points(data, tendon) for data in posed(model, qpos))
    return [points.astype(np.float32) for points in each]


def tendon_points(data: mujoco.MjData, tendon: int) -> Array:
    """Return the points (P, 3) [m] of a tendon; `mj_tendon` must be up to date."""
    start, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
    part = slice(start, start + count)
    # -2 only separates the branches of a tendon.
    real = data.wrap_obj.reshape(-1)[part] != -2
    return np.array(data.wrap_xpos.reshape(-1, 3)[part][real])
