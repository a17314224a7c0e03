"""The web page of an episode: one file that a browser plays without a server.

    write_page("episode.html", log, env.unwrapped.model, measure(log))

It shows the scene in 3-D and plots of torques, angles and tensions at the same time. It
is drawn by plotly.js, which is inside the page (`pip install 'cc_mujoco[html]'`).
"""

import base64
import json
import math
import os
from collections.abc import Mapping
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.errors import import_extra
from cc_mujoco.metrics import Metric
from cc_mujoco.metrics._metric import value_text
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import TENSION_COLORS
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz import _film_plots as plots
from cc_mujoco.viz import _scene3d as scene3d
from cc_mujoco.viz._cable_lines import (
    CONDUIT,
    MOTOR_END,
    SLACK_COLOR,
    CableLine,
    cable_lines,
    resample,
)
from cc_mujoco.viz._film_plots import FRAME_RATE, MAX_SAMPLES, Panel, highest_tension
from cc_mujoco.viz._plot_axes import axis_limits
from cc_mujoco.viz._summary import episode_title, guard_sentences


def require_page() -> None:
    """Raise `CableError` if no page can be made, because plotly is missing."""
    _plotly()


def write_page(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    metrics: Mapping[Metric, float] = MappingProxyType({}),
) -> None:
    """Write the page of an episode with `metrics` below, replacing an older one."""
    library = _plotly()
    highest, count = highest_tension(log), len(log)
    log = log.thinned(MAX_SAMPLES)
    # At most 6000 frames: a longer episode shows fewer per second.
    rate = plots.frame_rate(log["time_s"], FRAME_RATE, 6_000)
    samples = plots.frame_samples(log["time_s"], rate)
    panels = [*plots.torques(log), *plots.angles(log), *plots.tensions(log)]
    every = math.ceil(len(log) / 10_000)  # samples of a line: of more, every k-th
    shares = _shares(log, count, every, rate)
    time = log["time_s"]
    shown = []
    for panel in panels:
        lines = []
        for line in panel.lines:
            look = {"label": line.label, "color": line.color, "dashed": line.dashed}
            lines.append({**look, "values": encode_array(line.values[::every])})
        reach = axis_limits(time, [line.values for line in panel.lines])
        shown.append({"range": reach, "lines": lines})
    data = {
        "time": encode_array(time[::every]),
        "frames": encode_array(time[samples]),
        "panels": shown,
        "scene": web_scene(log, model, samples),
        "highest": highest,
        "colors": _colors(),
    }
    style, script, template = (
        Path(__file__).with_name(f"web_page.{kind}").read_text(encoding="utf-8")
        for kind in ("css", "js", "html")
    )
    title, figures = escape(episode_title(log)), "".join(map(_figure, panels))
    colors, slack = ",".join(color for _, color in _colors()[2:]), _rgb(SLACK_COLOR)
    gradient = f"linear-gradient(90deg,{colors})"
    text = {"title": title, "plots": figures, "gradient": gradient, "slack": slack}
    text |= {"highest": f"{highest:.3g}", "shares": escape(shares)}
    body = html.Html(Template(template.replace("\n", "")).substitute(text))
    for sentence in reversed(guard_sentences(log)):
        body = html.join_pieces([html.paragraph(sentence), body])
    if metrics:
        rows = [
            (m.name.replace("_", " "), value_text(value), m.unit, m.meaning)
            for m, value in metrics.items()
        ]
        results = html.table(("", "", "unit", "meaning"), rows)
        body = html.join_pieces([body, html.element("h2", "Results"), results])
    content = json.dumps(data, separators=(",", ":"), allow_nan=False)
    own: Any = {"style": style, "scripts": (library, script)}
    own["data"] = {"episode": content}
    page = html.page(episode_title(log), "episode", body, **own)
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")


def _colors() -> list[tuple[float, str]]:
    """Return plotly's colour scale of tension over its maximum, grey below 0.001."""
    import matplotlib

    shares = np.linspace(0.0, 1.0, 17)
    tones = matplotlib.colormaps[TENSION_COLORS](shares, bytes=True)[:, :3]
    slack = _rgb(SLACK_COLOR)
    shares[0] = 1e-3
    scale = zip(shares.tolist(), map(_rgb, tones), strict=True)
    return [(0.0, slack), (1e-3, slack), *scale]


def _rgb(color: NDArray[np.uint8]) -> str:
    return "#" + bytes(color[:3]).hex()


def _shares(log: EpisodeLog, count: int, every: int, rate: float) -> str:
    text = f"{count} samples over {log['time_s'][-1]:g} s."
    every *= -(-count // len(log))
    if every > 1:
        text += f" Of the samples one in {every} is shown."
    if rate < FRAME_RATE:
        text += f" The scene has {rate:.3g} frames in every second."
    return text


def _figure(panel: Panel) -> str:
    keys = ""
    for line in panel.lines:
        look = "dashed" if line.dashed else "line"
        keys += f'<span><i class="{look}" style="color:{line.color}"></i> '
        keys += f"{escape(line.label)} <b></b></span>"
    return (
        f'<section><div class="key"><h3>{escape(panel.title)} [{panel.unit}]</h3>'
        f'{keys}</div><div class="frame"><div class="plot"></div>'
        '<div class="cursor"></div></div></section>'
    )


def _plotly() -> str:
    needs = "a page of an episode needs plotly"
    return str(import_extra("plotly.offline", needs, "html").get_plotlyjs())


class TriangleMesh(NamedTuple):
    """Triangles of a geom or of geoms of one body, in the frame of the geom or body."""

    vertices: Array  # points (V, 3) [m]
    triangles: NDArray[np.int32]  # their corners (F, 3), anticlockwise from outside


def geom_mesh(model: mujoco.MjModel, geom: int, reach: float) -> TriangleMesh:
    """Return the triangles of a geom in its own frame; of a field its bounding box.

    `reach` [m] is the size of the visible scene: planes are cut to twice that, and
    round shapes that are small beside it have fewer sides.
    """
    shape = mujoco.mjtGeom
    kind, (x, y, z) = model.geom_type[geom], model.geom_size[geom]
    if kind == shape.mjGEOM_MESH:
        points, faces = scene3d.mesh_arrays(model, geom)
        return TriangleMesh(points.astype(np.float64), faces.astype(np.int32))
    if kind == shape.mjGEOM_PLANE:
        x, y = (min(half, reach) if half > 0 else reach for half in (x, y))
        corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
        return TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    if kind == shape.mjGEOM_SPHERE:
        return _ball(np.array([x, x, x]), reach)
    if kind == shape.mjGEOM_ELLIPSOID:
        return _ball(np.array([x, y, z]), reach)
    if kind == shape.mjGEOM_CAPSULE:
        dome = _dome() * x
        dome[:, 1] += y
        return _revolve([np.concatenate([(dome * [1, -1])[::-1], dome])], x / reach)
    if kind == shape.mjGEOM_CYLINDER:
        low, high = [x, -y], [x, y]
        sides = ([[0, -y], low], [low, high], [high, [0, y]])
        return _revolve([np.array(side) for side in sides], x / reach)
    if kind == shape.mjGEOM_BOX:
        return _box(np.zeros(3), model.geom_size[geom])
    return _box(model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:])


def join_meshes(meshes: list[TriangleMesh]) -> TriangleMesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [m.triangles + start for m, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return TriangleMesh(vertices, np.concatenate(faces).astype(np.int32))


def _dome() -> Array:
    """Return (radius, height) points (6, 2) of a unit hemisphere, equator to pole."""
    angle = np.linspace(0.0, 0.5 * np.pi, 6)
    return np.stack([np.cos(angle) * (angle < 0.5 * np.pi), np.sin(angle)], axis=1)


def _ball(halves: Array, reach: float) -> TriangleMesh:
    dome = _dome()
    profile = np.concatenate([(dome[1:] * [1, -1])[::-1], dome])
    ball = _revolve([profile], float(halves.max()) / reach)
    return TriangleMesh(ball.vertices * halves, ball.triangles)


def _revolve(profiles: list[Array], size: float) -> TriangleMesh:
    """Return the surface of profiles turned about z, with sharp edges between them.

    A profile has (radius, height) points (P, 2), the lowest first; `size` is the radius
    over that of the visible scene and sets the number of sides.
    """
    sides = 24 if size > 0.025 else 10
    turn = np.arange(sides) * (2.0 * np.pi / sides)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    here = np.arange(sides)
    beside = (here + 1) % sides
    meshes = []
    for profile in profiles:
        rings = [np.c_[radius * circle, np.full(sides, z)] for radius, z in profile]
        faces = []
        for ring, (low, high) in enumerate(pairwise(profile[:, 0])):
            a, b = ring * sides + here, ring * sides + beside
            if low > 0:
                faces.append(np.stack([a, b, b + sides], axis=1))
            if high > 0:
                faces.append(np.stack([a, b + sides, a + sides], axis=1))
        meshes.append(TriangleMesh(np.concatenate(rings), np.concatenate(faces)))
    return join_meshes(meshes)


def _box(center: Array, half: Array) -> TriangleMesh:
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    meshes = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # Cyclic axes keep the order of the corners; the far side turns it.
            corners = np.roll(np.c_[square, np.full(4, side)], axis + 1, axis=1)
            faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
            outside = faces if side > 0 else faces[:, ::-1]
            meshes.append(TriangleMesh(corners * half + center, outside))
    return join_meshes(meshes)


def encode_array(values: NDArray[Any], kind: str = "f4") -> dict[str, Any]:
    """Return an array in base64 as plotly.js reads it, of type `f4` or `i4`."""
    numbers = np.ascontiguousarray(values, dtype=f"<{kind}")
    text = base64.b64encode(numbers.tobytes()).decode("ascii")
    return {"dtype": kind, "shape": list(numbers.shape), "bdata": text}


def web_scene(
    log: EpisodeLog, model: mujoco.MjModel, samples: NDArray[np.intp]
) -> dict[str, Any]:
    """Return the visible objects and their motion at F samples, as JSON.

    `meshes` are triangles of one colour and moving body (-1 if fixed). `poses` (F,
    bodies, 12) are rows of rotation and position [m] of each moving body. `lines` are
    points (1 or F, P, 3) [m]; cables add node tensions (F, n) [N] and the node index,
    with fractions, at each point. `box` (3, 2) encloses everything [m]; `camera` is
    plotly's.
    """
    qpos = log.rows("qpos", samples)
    moving = np.flatnonzero(model.body_weldid != 0)
    poses = _poses(model, qpos, moving)
    found = cable_lines(model, log.cables)
    lines = [_cable(log, model, qpos, samples, line) for line in found]
    lines += _tendons(model, qpos, [line.source for line in found])
    drawn = [points.reshape(-1, 3) for points, _ in lines]
    moved = []
    for row, body in enumerate(moving.tolist()):
        corners = _corners(model, body)
        turned = np.einsum("fij,cj->fci", poses[:, row, :, :3], corners)
        moved.append((turned + poses[:, row, None, :, 3]).reshape(-1, 3))
    seen = np.concatenate([*drawn, *moved])
    reach = 2.0 * float(np.ptp(seen, axis=0).max())
    meshes = _meshes(model, moving, reach)
    still = [m.vertices for body, _, m in meshes if body < 0]
    everything = np.concatenate([seen, *still])
    low, high = everything.min(axis=0), everything.max(axis=0)
    # Nothing may be flat: the page scales by the sides.
    half = 0.51 * np.maximum(high - low, max(0.05 * float((high - low).max()), 1e-3))
    box = 0.5 * (low + high)[:, None] + np.stack([-half, half], axis=1)
    shapes = []
    for body, rgba, mesh in meshes:
        color = _rgb(np.rint(255 * rgba).astype(np.uint8))
        look: dict[str, Any] = {"body": body, "color": color}
        look |= {"opacity": float(rgba[3]), "vertices": encode_array(mesh.vertices)}
        shapes.append({**look, "triangles": encode_array(mesh.triangles, "i4")})
    return {
        "meshes": shapes,
        "poses": encode_array(poses.reshape(len(samples), len(moving), 12)),
        "lines": [{"points": encode_array(points)} | about for points, about in lines],
        "box": box.tolist(),
        "camera": _camera(model, seen, box),
    }


def _poses(model: mujoco.MjModel, qpos: Array, moving: NDArray[np.intp]) -> Array:
    """Return rotation and position [m] of moving bodies (F, bodies, 3, 4)."""
    position, quaternion = scene3d.body_poses(model, qpos)
    poses = np.empty((len(qpos), len(moving), 3, 4))
    poses[..., 3] = position[:, moving]
    for frame, row in np.ndindex(poses.shape[:2]):
        poses[frame, row, :, :3] = _rotation(quaternion[frame, moving[row]])
    return poses


def _rotation(quaternion: Array) -> Array:
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, quaternion)
    return turned.reshape(3, 3)


def _meshes(
    model: mujoco.MjModel, moving: NDArray[np.intp], reach: float
) -> list[tuple[int, Array, TriangleMesh]]:
    """Return (row of the moving body or -1, colour (4,), triangles) per colour."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rows = {int(body): row for row, body in enumerate(moving)}
    groups: dict[tuple[int, bytes], tuple[Array, list[TriangleMesh]]] = {}
    for geom, rgba in scene3d.visible_geoms(model):
        row = rows.get(int(model.geom_bodyid[geom]), -1)
        mesh = geom_mesh(model, geom, reach)
        if row < 0:
            turned, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        else:
            turned, place = _rotation(model.geom_quat[geom]), model.geom_pos[geom]
        mesh = TriangleMesh(mesh.vertices @ turned.T + place, mesh.triangles)
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            rgba = rgba * [1.0, 1.0, 1.0, 0.35]  # suits a light page and a dark one
        groups.setdefault((row, rgba.tobytes()), (rgba, []))[1].append(mesh)
    return [
        (row, rgba, join_meshes(parts)) for (row, _), (rgba, parts) in groups.items()
    ]


def _corners(model: mujoco.MjModel, body: int) -> Array:
    """Return corners (n, 3) [m] of boxes around a body's geoms, in the body's frame."""
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
    corners = [np.zeros((1, 3))]
    for geom, _ in scene3d.visible_geoms(model):
        if model.geom_bodyid[geom] == body:
            box = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
            turned = _rotation(model.geom_quat[geom])
            corners.append(box @ turned.T + model.geom_pos[geom])
    return np.concatenate(corners)


def _cable(
    log: EpisodeLog, model: mujoco.MjModel, qpos: Array, samples: NDArray[np.intp],
    line: CableLine,
) -> tuple[Array, dict[str, Any]]:  # fmt: skip
    tension = log.rows(f"tension_{line.cable}_nodes_n", samples)
    # In pixels: a conduit, a rope coloured by tension, any other tendon
    about: dict[str, Any] = {"name": line.cable, "width": 9}
    if line.part != CONDUIT:  # one tension for all of a rope
        tension = tension[:, [0, 0] if line.part == MOTOR_END else [-1, -1]]
        about = {"rope": line.cable, "width": 5}
    about["tension"] = encode_array(tension)
    about["nodes"] = encode_array(line.nodes(tension.shape[1]))
    return _without_repeats(line.all_points(model, qpos)), about


def _tendons(
    model: mujoco.MjModel, qpos: Array, sources: list[Any]
) -> list[tuple[Array, dict[str, Any]]]:
    """Return points and look of tendons that are no `sources` of cables."""
    followed = [source for source in sources if isinstance(source, int)]
    found = []
    for tendon, rgba in scene3d.visible_tendons(model, followed):
        shares = np.linspace(0.0, 1.0, 40)
        paths = scene3d.tendon_paths(model, tendon, qpos)
        points = np.stack([resample(path.astype(np.float64), shares) for path in paths])
        look = {"width": 3, "color": _rgb(np.rint(255 * rgba).astype(np.uint8))}
        found.append((_without_repeats(points), look))
    return found


def _without_repeats(points: Array) -> Array:
    """Return points (F, P, 3), or the first frame (1, P, 3) if all are equal."""
    still = np.abs(points - points[0]).max() < 1e-6
    return points[:1] if still else points


def _camera(model: mujoco.MjModel, seen: Array, box: Array) -> dict[str, Any]:
    """Return plotly's camera along the model's first one, so far that `seen` shows.

    Plotly puts the middle of the box at 0 and divides by the geometric mean of its
    sides.
    """
    position, target = scene3d.viewpoint(model)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-3:  # straight down
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward), forward])
    views = seen @ axes.T
    low, high = views.min(axis=0), views.max(axis=0)
    across, up, deep = (views - 0.5 * (low + high)).T
    # Half the height of what the page's camera sees over its distance
    half = np.maximum(np.abs(across) / 1.2, np.abs(up)) / np.tan(np.radians(22.5))
    # With a margin around all that moves.
    distance = max(1.06 * float((half - deep).max()), 1e-3)
    middle = 0.5 * (low + high) @ axes
    scale = float(np.prod(np.ptp(box, axis=1)) ** (1 / 3))
    center = (middle - box.mean(axis=1)) / scale
    eye = center - distance / scale * forward
    return {
        name: dict(zip("xyz", map(float, values), strict=True))
        for name, values in (("eye", eye), ("center", center), ("up", axes[1]))
    }
