"""Lines that are drawn for the cables of a model: conduits, and ropes at their ends.

    for line in cable_lines(model, ("flexor", "extensor")):
        points = line.points(model, data)              # (P, 3) [m]
        tension = line.tensions(nodes)                 # (P-1,) [N]

A conduit lies along the tendon that the key `route` names. Without that key it lies
along the only tendon that ends where the rope of an end begins, or else straight from
one end of the cable to the other. The rope of an end is the tendon that the end's
actuator pulls, or one that begins where the conduit ends.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.cable._cable import PATHS
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._attachments import holding_tendon, is_spatial
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.viz import _scene3d as scene3d

CONDUIT, MOTOR_END, JOINT_END = "conduit", "motor_end", "joint_end"  # drawn parts
SLACK_COLOR = np.array([150, 150, 150, 255], dtype=np.uint8)


@dataclass(frozen=True)
class _Straight:
    ends: tuple[int, int]  # actuators, proximal and distal
    first: tuple[bool, bool]  # True where an end is a tendon's first point

    def path(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        each = zip(self.ends, self.first, strict=True)
        places = [_place(model, data, end, first) for end, first in each]
        along = places[1] - places[0]
        along /= max(float(np.linalg.norm(along)), 1e-12)
        for number, end in enumerate(self.ends):
            joint = int(model.actuator_trnid[end, 0])
            kind = model.actuator_trntype[end]
            hinge = mujoco.mjtJoint.mjJNT_HINGE
            if kind == mujoco.mjtTrn.mjTRN_JOINT and model.jnt_type[joint] == hinge:
                # Where a pulley of this radius, which turns forward, pays out to joint.
                radius = float(model.actuator_gear[end, 0])
                places[number] += radius * np.cross(along, data.xaxis[joint])
        return np.stack(places)


@dataclass(frozen=True)
class CableLine:
    """A line along a cable's conduit or rope, to be coloured by tension."""

    cable: str
    part: str  # `CONDUIT`, `MOTOR_END` or `JOINT_END`
    source: int | _Straight  # spatial tendon that it follows, or a straight line
    radius: float  # [m]
    shares: Array  # places of the nodes, see `conduit_shares`; unused for a rope
    fine: Array  # places of its points, as shares of its length (P,)

    def points(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the points (P, 3) [m] in the pose of `data`, after `mj_tendon`."""
        if isinstance(self.source, int):
            path = scene3d.tendon_points(data, self.source)
        else:
            path = self.source.path(model, data)
        return resample(path, self.fine)

    def all_points(self, model: mujoco.MjModel, qpos: Array) -> Array:
        """Return the points (T, P, 3) [m] in the poses `qpos` (T, nq)."""
        each = [self.points(model, data) for data in scene3d.posed(model, qpos)]
        return np.reshape(each, (len(qpos), len(self.fine), 3))

    def nodes(self, count: int) -> Array:
        """Return the node (with fractions) at each point (P,), of `count` nodes."""
        if self.part != CONDUIT:
            node = 0.0 if self.part == MOTOR_END else count - 1.0
            return np.full(len(self.fine), node)
        places = self._places(count)
        return np.interp(self.fine, places, np.arange(len(places)))

    def _places(self, count: int) -> Array:
        """Return the places of nodes (n,), in the open the middles of their pieces."""
        shares = self.shares
        return shares if shares.size == count else 0.5 * (shares[:-1] + shares[1:])

    def tensions(self, nodes: Array) -> Array:
        """Return the tension of each part (..., P-1) from node tensions (..., n)."""
        if self.part != CONDUIT:
            end = nodes[..., :1] if self.part == MOTOR_END else nodes[..., -1:]
            return np.repeat(end, len(self.fine) - 1, axis=-1)
        places = self._places(nodes.shape[-1])
        middle = 0.5 * (self.fine[:-1] + self.fine[1:])
        low = np.clip(np.searchsorted(places, middle) - 1, 0, places.size - 2)
        share = (middle - places[low]) / (places[low + 1] - places[low])
        share = np.clip(share, 0.0, 1.0)
        return np.asarray((1.0 - share) * nodes[..., low] + share * nodes[..., low + 1])


def cable_lines(model: mujoco.MjModel, cables: Iterable[str]) -> list[CableLine]:
    """Return the lines to draw for cables that the model has with a length."""
    sources = {cable: _conduit(model, cable) for cable in instances(model)}
    taken = {source for source in sources.values() if isinstance(source, int)}
    found = []
    for cable in cables:
        source = sources.get(cable)
        if source is None:
            continue
        tendon, radius = -1, 0.004 * float(model.stat.extent)
        if isinstance(source, int):
            tendon, radius = source, float(model.tendon_width[source])
        shares = conduit_shares(model, cable)
        # Fewer points would cut its bends.
        fine = shares if shares.size > 60 else np.linspace(0.0, 1.0, 61)
        found.append(CableLine(cable, CONDUIT, source, radius, shares, fine))
        for part, rope in _ropes(model, cable, tendon):
            if rope not in taken:
                taken.add(rope)
                radius, fine = float(model.tendon_width[rope]), np.linspace(0, 1, 40)
                found.append(CableLine(cable, part, rope, radius, shares, fine))
    return found


def conduit_shares(model: mujoco.MjModel, cable: str) -> Array:
    """Return the division of a cable's route, as fractions of its length from 0 to 1.

    In a conduit these are the places of the nodes (n+1,). In the open they are the ends
    of the pieces for which each node stands, straight ones or parts of an arc (n+2,).
    """
    described = plugin.from_mjcf(model)[cable]
    if described.path == PATHS[0]:
        return node_places(described) / described.length
    reader = plugin.Reader(model, cable)
    nodes = described.segments + 1
    # Slack of a newton at one node alone goes as the length for which the node stands,
    # which the state of a cable at rest has.
    data = mujoco.MjData(model)
    plugin.settle(model, data)
    state = np.tile(data.plugin_state, (nodes, 1))
    state[:, reader.nodes] = -np.eye(nodes)
    along = np.concatenate([[0.0], np.cumsum(reader.read(state).slack)])
    return np.asarray(along / along[-1])


def resample(polyline: Array, shares: Array) -> Array:
    """Return points (n, 3) at fractions `shares` (n,) of a polyline's (P, 3) length."""
    steps = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = shares * along[-1]
    axes = [np.interp(wanted, along, polyline[:, axis]) for axis in range(3)]
    return np.stack(axes, axis=1)


def tension_colors(tension: Array, highest: float) -> NDArray[np.uint8]:
    """Return RGBA colours (..., 4) of tensions [N], brightest at `highest` [N]."""
    import matplotlib

    colormap = matplotlib.colormaps["viridis"]
    scaled = np.clip(tension / max(highest, 1e-9), 0.0, 1.0)
    colors = np.asarray(colormap(scaled, bytes=True), dtype=np.uint8)
    colors[tension <= 0.0] = SLACK_COLOR
    return colors


def line_notes(model: mujoco.MjModel, cables: Iterable[str]) -> Iterator[str]:
    described = plugin.from_mjcf(model)
    for cable in cables:
        if cable not in described or described[cable].route:
            continue
        source = _conduit(model, cable)
        start = f"cable {cable!r} has no `route`: it is"
        if source is None:
            yield f"{start} not drawn, as both of its ends are at one place."
        elif isinstance(source, _Straight):
            yield f"{start} drawn straight from one end to the other."
        else:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, source)
            yield (
                f"{start} drawn along tendon {name or source!r}, which ends where its "
                "rope begins."
            )


def _conduit(model: mujoco.MjModel, cable: str) -> int | _Straight | None:
    """Return the tendon or straight line to draw; None if the ends coincide."""
    if plugin.from_mjcf(model)[cable].route:
        return plugin.route_tendon(model, cable)
    ends = _actuators(model, cable)
    held = {holding_tendon(model, end) for end in ends} - {-1}
    sites = {site for tendon in held for site in _end_sites(model, tendon)} - {-1}
    by_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    users = model.actuator_trnid[by_tendon, 0].tolist()
    visible = [tendon for tendon, _ in scene3d.visible_tendons(model, users)]
    near = [tendon for tendon in visible if sites & {*_end_sites(model, tendon)}]
    if len(near) == 1:
        return near[0]
    data = mujoco.MjData(model)
    scene3d.set_pose(model, data, model.qpos0)
    places = []
    for end in ends:
        firsts = (True, False) if holding_tendon(model, end) >= 0 else (True,)
        places.append({first: _place(model, data, end, first) for first in firsts})
    near_end, far_end = places
    lengths = {}
    for one, other in itertools.product(near_end, far_end):
        lengths[one, other] = float(np.linalg.norm(far_end[other] - near_end[one]))
    straight = _Straight(ends, min(lengths, key=lambda sides: lengths[sides]))
    path = straight.path(model, data)
    short = 1e-3 * float(model.stat.extent)
    return straight if np.linalg.norm(path[1] - path[0]) > short else None


def _ropes(
    model: mujoco.MjModel, cable: str, conduit: int
) -> Iterator[tuple[str, int]]:
    ends = _actuators(model, cable)
    sites = (-1, -1) if conduit < 0 else _end_sites(model, conduit)
    for part, end, site in zip((MOTOR_END, JOINT_END), ends, sites, strict=True):
        for tendon, _ in scene3d.visible_tendons(model, [conduit]):
            begins = site >= 0 and site in _end_sites(model, tendon)
            if begins or holding_tendon(model, end) == tendon:
                yield part, tendon


def _actuators(model: mujoco.MjModel, cable: str) -> tuple[int, int]:
    first, second = np.flatnonzero(model.actuator_plugin == instances(model)[cable])
    return int(first), int(second)


def _end_sites(model: mujoco.MjModel, tendon: int) -> tuple[int, int]:
    """Return ids of a tendon's first and last site; -1 where it ends at no site."""
    start, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    ends = [start, start + count - 1]
    on_sites = model.wrap_type[ends] == mujoco.mjtWrap.mjWRAP_SITE
    first, last = np.where(on_sites, model.wrap_objid[ends], -1).tolist()
    return first, last


def _place(
    model: mujoco.MjModel, data: mujoco.MjData, actuator: int, first: bool
) -> Array:
    """Return a cable end (3,) [m]: joint's anchor, or tendon's `first` or last."""
    tendon, place = holding_tendon(model, actuator), 0 if first else -1
    if tendon < 0:
        return np.array(data.xanchor[model.actuator_trnid[actuator, 0]])
    if is_spatial(model, tendon):
        return np.array(scene3d.tendon_points(data, tendon)[place])
    start, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    return np.array(data.xanchor[model.wrap_objid[start : start + count][place]])


class Capsules:
    """Cables as capsules of a MuJoCo scene, coloured by the tension inside."""

    def __init__(
        self, model: mujoco.MjModel, cables: Iterable[str], highest: float
    ) -> None:
        """Hide the cables' tendons, and colour the others, in the model itself.

        Tensions of `highest` [N] and above have the brightest colour.
        """
        self.highest = highest  # tension of the brightest colour [N]
        self._model = model
        self._lines = cable_lines(model, cables)
        for line in self._lines:
            if isinstance(line.source, int):
                # MuJoCo draws what is transparent, but this group only on request.
                model.tendon_group[line.source] = mujoco.mjNGROUP - 1
        for tendon in range(model.ntendon):
            if scene3d.is_uncolored(model, tendon):
                model.tendon_rgba[tendon] = scene3d.ROPE_COLOR

    def add(
        self,
        scene: mujoco.MjvScene,
        data: mujoco.MjData,
        tensions: Mapping[str, Array] | None = None,
    ) -> None:
        """Append the capsules to the geoms of `scene`, which must have room for them.

        `data` must be up to date as by `mj_fwdPosition`. `tensions` are those at the
        nodes of each cable (n,) [N]; without them capsules are grey.
        """
        for line in self._lines:
            points = line.points(self._model, data)
            shown = np.zeros(len(points) - 1)
            if tensions is not None:
                shown = line.tensions(tensions[line.cable])
            colors = tension_colors(shown, self.highest).astype(np.float32)
            # Lit, the dimmed colours come near those of the scale.
            colors *= 0.72 / 255.0
            colors[:, 3] = 1.0
            shape, none = mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3)
            for color, start, end in zip(colors, points[:-1], points[1:], strict=True):
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(geom, shape, none, none, np.zeros(9), color)
                # Colours need more room than the line of the scene.
                mujoco.mjv_connector(geom, shape, 1.4 * line.radius, start, end)
                geom.emission, geom.specular = 0.25, 0.1
                scene.ngeom += 1
