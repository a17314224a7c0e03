"""Random mechanisms that bend a cable, and closed motions of their joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

import cc_mujoco
from cc_mujoco.plugin import read, settle, stored_energy

Array = np.ndarray

JOINTS = ("none", "hinge", "slide", "ball", "free")
GEOMS = ("sphere", "cylinder")
FRICTION, STIFFNESS, PRETENSION = 0.3, 1500.0, 100.0
SEGMENTS = 9


@dataclass(frozen=True)
class Mechanism:
    """A cable from a site past one or two geoms to another site.

    Attributes:
        model: with the cable `rope`, tied to the ends of its tendon.
        spans: first and last node of the pieces of every span, and its names: site,
            geom, site.
        cables: names of all cables.
    """

    model: mujoco.MjModel
    spans: tuple[tuple[int, int, tuple[str, str, str]], ...]
    cables: tuple[str, ...] = ("rope",)

    def heat(self, d: mujoco.MjData) -> float:
        """Return the energy that the cables dissipated [J]."""
        return sum(float(read(self.model, d, name).dissipated) for name in self.cables)

    def stored(self, d: mujoco.MjData) -> float:
        """Return the energy that the cables store [J]."""
        return sum(stored_energy(self.model, d, name) for name in self.cables)

    def slack(self, d: mujoco.MjData) -> Array:
        """Return which nodes of the cables are slack."""
        found = [read(self.model, d, name).tension == 0.0 for name in self.cables]
        return np.concatenate(found)


def mechanism(
    seed: int,
    geoms: tuple[str, ...],
    inside: tuple[bool, ...],
    joints: tuple[str, ...],
    **keys: Any,
) -> Mechanism:
    """Draw a mechanism.

    Args:
        seed: of its sizes and places.
        geoms: type of every geom along the path, one or two.
        inside: whether the path touches it from inside.
        joints: of the bodies in the order of the path: site, geom, site, ...
        keys: of the cable.
    """
    random = np.random.default_rng(seed)
    count = len(geoms)
    names = ["s0"]
    for i in range(count):
        names += [f"g{i}", f"s{i + 1}"]
    # Places of the sites, then `s0` geom `s1` geom `s2` by columns.
    world, rope = "", ""
    for place, (name, joint) in enumerate(zip(names, joints, strict=True)):
        x = 0.2 * place + random.uniform(-0.02, 0.02)
        across, up = random.uniform(-0.06, 0.06, 2)
        spin = random.uniform(-0.6, 0.6, 3)
        if name[0] == "s":
            low = -0.05 if not inside[min(place // 2, count - 1)] else 0.11
            about = f'pos="{x} {across} {low + 0.3 * up}"'
            what = f'<geom size="0.01" mass="1"/><site name="{name}"/>'
            rope += f'<site site="{name}"/>'
        else:
            kind, within = geoms[place // 2], inside[place // 2]
            radius = random.uniform(0.04, 0.055)
            about = f'pos="{x} {0.3 * across} 0"'
            size = f"{radius} 0.1" if kind == "cylinder" else f"{radius}"
            side = 0.5 * radius if within else radius + 0.03
            what = (
                f'<geom name="{name}" type="{kind}" size="{size}" mass="1" '
                f'zaxis="{0.3 * spin[0]} 1 {0.3 * spin[1]}"/>'
                f'<site name="by_{name}" pos="0 0 {side}"/>'
            )
            rope += f'<geom geom="{name}" sidesite="by_{name}"/>'
        axis = random.normal(size=3)
        if name[0] == "g" and joint == "hinge" and random.random() < 0.5:
            axis = np.array([0.0, 1.0, 0.0])
        moves = {
            "none": "",
            "hinge": f'<joint type="hinge" axis="{axis[0]} {axis[1]} {axis[2]}"/>',
            "slide": f'<joint type="slide" axis="{axis[0]} {axis[1]} {axis[2]}"/>',
            "ball": f'<joint type="ball" pos="{0.02 * spin[0]} 0 {0.02 * spin[1]}"/>',
            "free": "<freejoint/>",
        }[joint]
        world += f"<body {about}>{moves}{what}</body>"
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="1e-3" gravity="0 0 0"><flag contact="disable"/>'
        f"</option><worldbody>{world}</worldbody><tendon>"
        f'<spatial name="rope">{rope}</spatial></tendon></mujoco>'
    )
    given: dict[str, Any] = {
        "friction": FRICTION,
        "axial_stiffness": STIFFNESS,
        "pretension": PRETENSION,
        "segments": SEGMENTS,
        "ends": "explicit",
    }
    cc_mujoco.add_friction(spec, "rope", **(given | keys))
    spans, node = [], 0
    spare = int((given | keys)["segments"]) - (2 * count - 1) + count
    for i in range(count):
        share = spare // count + (1 if i < spare % count else 0)
        spans.append((node, node + share, (f"s{i}", f"g{i}", f"s{i + 1}")))
        node += share + 1
    return Mechanism(spec.compile(), tuple(spans))


def drawn(seed: int, **keys: Any) -> Mechanism:
    """Draw also what it is made of."""
    random = np.random.default_rng([seed, 7])
    count = int(random.integers(1, 3))
    geoms = tuple(str(g) for g in random.choice(GEOMS, count))
    inside = tuple(bool(i) for i in random.random(count) < 0.3)
    joints = tuple(str(j) for j in random.choice(JOINTS, 2 * count + 1))
    if joints.count("none") == len(joints):
        joints = (*joints[:-1], "free")
    return mechanism(seed, geoms, inside, joints, **keys)


def loop(m: mujoco.MjModel, seed: int, steps: int, size: float = 1.0) -> Array:
    """Poses of a closed motion about `qpos0`, `steps` a turn (steps, nq)."""
    random = np.random.default_rng([seed, 3])
    phase, pace = random.uniform(0.0, 2.0 * np.pi, m.nv), np.ones(m.nv)
    pace[random.random(m.nv) < 0.3] = 2.0
    reach = np.empty(m.nv)
    for dof in range(m.nv):
        joint = int(m.dof_jntid[dof])
        kind, first = int(m.jnt_type[joint]), int(m.jnt_dofadr[joint])
        moves = kind == int(mujoco.mjtJoint.mjJNT_SLIDE) or (
            kind == int(mujoco.mjtJoint.mjJNT_FREE) and dof < first + 3
        )
        reach[dof] = random.uniform(0.005, 0.02) if moves else random.uniform(0.1, 0.4)
    poses = np.empty((steps, m.nq))
    for k in range(steps):
        turn = 2.0 * np.pi * k / steps
        poses[k] = m.qpos0
        moved = size * reach * (np.sin(pace * turn + phase) - np.sin(phase))
        mujoco.mj_integratePos(m, poses[k], moved, 1.0)
    return poses


@dataclass(frozen=True)
class Balance:
    """Energy over the last turn of a closed motion.

    Attributes:
        work: that the joints put in [J].
        stored: by how much more the cable stores [J].
        heat: that friction took [J].
        gross: sum of the sizes of the work of all steps [J].
        jump: most by which the path changed otherwise than its moments tell [m].
        torques: largest difference between the forces on the joints and those of
            `virtual`, by their largest; 0 where not tested.
    """

    work: float
    stored: float
    heat: float
    gross: float
    jump: float
    torques: float


def play(
    mechanism: Mechanism,
    poses: Array,
    turns: int = 2,
    test_every: int = 0,
    parts: int = 1,
) -> Balance:
    """Lead the joints through closed motions, by hand; the last one counts.

    The mean force of a step that makes a node taut or slack is not that of its two
    ends, so such a step may be made in parts.

    Args:
        mechanism: to lead.
        poses: of a closed motion (steps, nq).
        turns: how often it is led round.
        test_every: steps after which `virtual` is compared; 0: never.
        parts: of a step that makes a node taut or slack.
    """
    m = mechanism.model
    d, tried = mujoco.MjData(m), mujoco.MjData(m)
    d.qpos[:] = poses[0]
    settle(m, d)
    steps, step = len(poses), m.opt.timestep
    before, force_before = poses[0].copy(), np.zeros(m.nv)
    moved, whole = np.zeros(m.nv), np.zeros(m.nv)
    work = gross = jump = off = largest = 0.0
    start_heat = start_stored = 0.0
    row, row_before, length = np.zeros(m.nv), np.zeros(m.nv), 0.0
    for k in range(turns * steps + 1):
        pose, count = poses[k % steps], 1
        if parts > 1:
            mujoco.mj_copyData(tried, m, d)
            tried.qpos[:], tried.qvel[:] = pose, 0.0
            mujoco.mj_step(m, tried)
            turned = np.any(mechanism.slack(tried) != mechanism.slack(d))
            count = parts if turned else 1
        mujoco.mj_differentiatePos(m, whole, 1.0, before, pose)
        start = before.copy()
        m.opt.timestep = step / count
        for i in range(count):
            d.qpos[:], d.qvel[:] = start, 0.0
            mujoco.mj_integratePos(m, d.qpos, whole, (i + 1) / count)
            place = d.qpos.copy()
            mujoco.mj_step(m, d)
            force = d.qfrc_passive + d.qfrc_actuator
            row = np.zeros((m.ntendon, m.nv))
            mujoco.mju_sparse2dense(
                row, d.ten_J.ravel(), m.ten_J_rownnz, m.ten_J_rowadr,
                m.ten_J_colind.ravel(),
            )  # fmt: skip
            row = row[0]
            mujoco.mj_differentiatePos(m, moved, 1.0, before, place)
            if k > 0:
                told = 0.5 * (row + row_before) @ moved
                jump = max(jump, abs(d.ten_length[0] - length - told))
            if k > (turns - 1) * steps:
                part = -0.5 * (force + force_before) @ moved
                work, gross = work + part, gross + abs(part)
            before[:], force_before = place, force
            row_before, length = row, float(d.ten_length[0])
        if k == (turns - 1) * steps:
            start_heat, start_stored = mechanism.heat(d), mechanism.stored(d)
        if test_every and k > (turns - 1) * steps and k % test_every == 0:
            right = virtual(mechanism, pose, read(m, d, "rope").tension)
            off = max(off, float(np.abs(force - right).max()))
            largest = max(largest, float(np.abs(right).max()))
    m.opt.timestep = step
    return Balance(
        work,
        mechanism.stored(d) - start_stored,
        mechanism.heat(d) - start_heat,
        gross,
        jump,
        off / largest if largest > 0.0 else 0.0,
    )


def virtual(mechanism: Mechanism, pose: Array, tension: Array) -> Array:
    """Return the forces of the pieces on the joints (nv,), by length differences.

    A piece is as long as its site is far from the material point of the geom that it
    touches in this pose, wherever the path would touch in another.
    """
    m = mechanism.model
    d = mujoco.MjData(m)
    d.qpos[:] = pose
    mujoco.mj_fwdPosition(m, d)
    pieces = []
    at = int(d.ten_wrapadr[0])
    points, objects = d.wrap_xpos.reshape(-1, 3), d.wrap_obj.ravel()
    for first, last, (start, geom, stop) in mechanism.spans:
        body = int(m.geom_bodyid[m.geom(geom).id])
        turn = d.xmat[body].reshape(3, 3)
        if objects[at + 1] >= 0:
            for point, site, node in ((at + 1, start, first), (at + 2, stop, last)):
                own = turn.T @ (points[point] - d.xpos[body])
                pieces.append((m.site(site).id, (body, own), tension[node]))
            at += 3
        else:
            mean = 0.5 * (tension[first] + tension[last])
            pieces.append((m.site(start).id, m.site(stop).id, mean))
            at += 1
    total, tiny = np.zeros(m.nv), 1e-6
    for dof in range(m.nv):
        lengths = []
        for sign in (1.0, -1.0):
            d.qpos[:] = pose
            step = np.zeros(m.nv)
            step[dof] = sign * tiny
            mujoco.mj_integratePos(m, d.qpos, step, 1.0)
            mujoco.mj_kinematics(m, d)
            row = []
            for site, other, _ in pieces:
                if isinstance(other, tuple):
                    body, own = other
                    end = d.xpos[body] + d.xmat[body].reshape(3, 3) @ own
                else:
                    end = d.site_xpos[other]
                row.append(float(np.linalg.norm(end - d.site_xpos[site])))
            lengths.append(row)
        gain = (np.array(lengths[0]) - np.array(lengths[1])) / (2.0 * tiny)
        total[dof] = -sum(p[2] * g for p, g in zip(pieces, gain, strict=True))
    return total
