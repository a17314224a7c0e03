"""Two cables of massive nodes between segments that cannot push; compiled.

A bristle with load N, travel x and stiffness k follows Dahl's law

    dF/dx = k (1 - sign(dx) F / F_c),   F_c = 2 tanh(mu wrap / 2) N,

with N the mean tension of both sides, which makes a sliding node obey the capstan
equation exactly. The law is stepped implicitly in travel, so no step is too long for
the bristle: no chatter, and at rest F stays as it is.

The other variables of friction (speed, age, place, warmth) change slowly compared with
the waves in the cable. They are updated once per tick, see `update`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix, internal
from rig.bristles.plant import Plant

Array = NDArray[np.float64]


class Cables(NamedTuple):
    """State and tables of both cables, (2, nodes) unless noted.

    Displacements are towards the motor, in the cable's own sense.
    """

    place: FloatMatrix
    speed: FloatMatrix
    force: FloatMatrix
    """Force of the bristles against the cable [N]."""
    load: FloatMatrix
    """Mean tension of both sides of a node [N]."""
    lagged: FloatMatrix
    """Low-pass filtered speed, on which friction depends [m/s]."""
    contact: FloatMatrix
    """Age of the contacts [s]."""
    warmth: FloatArray
    """Friction work stored as heat over `heating_energy`, (2,)."""
    ahead: FloatMatrix
    """Friction limit over load for motion towards the motor."""
    behind: FloatMatrix
    """Friction limit over load for motion away from the motor."""
    bristle: FloatMatrix
    """Stiffness of the bristles [N/m]."""
    stiffness: FloatMatrix
    """Stiffness of the segments (2, nodes + 1) [N/m]."""
    seal: FloatArray
    """Load-independent friction (nodes,) [N]."""
    work: FloatMatrix
    """Friction and damping work of each cable since the start (2, 2) [J]."""
    warmed: FloatArray
    """Friction work already converted into `warmth` (2,) [J]."""


def _segments(p: Plant) -> Array:
    """Return the stiffness of each segment; the end ones are half as long."""
    inner = p.axial_stiffness * p.nodes / p.length
    k = np.full((2, p.nodes + 1), inner)
    k[:, 0] = 1.0 / (0.5 / inner + 0.3 * p.end_compliance)
    k[:, p.nodes] = 1.0 / (0.5 / inner + 0.7 * p.end_compliance)
    return k


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, without friction, displaced by arcs.

    `fill_tables` fills in what depends on friction.
    """
    n = p.nodes
    seal = np.zeros(n)
    seal[0] = 0.4 * p.load_free
    seal[n - 1] = 0.6 * p.load_free
    nodes = {name: np.zeros((2, n)) for name in Cables._fields}
    return Cables(
        **nodes
        | {
            "place": np.repeat(np.array(arcs)[:, None], n, axis=1),
            "load": np.full((2, n), pretension),
            "warmth": np.zeros(2),
            "stiffness": _segments(p),
            "seal": seal,
            "work": np.zeros((2, 2)),
            "warmed": np.zeros(2),
        }
    )


@internal
def fill_tables(p: Plant, cables: Cables) -> None:
    """Fill the tables of the friction of cables at rest."""
    _look_up(p, cables, 0.0)
    for c in range(2):
        for i in range(p.nodes):
            limit = 0.5 * (cables.ahead[c, i] + cables.behind[c, i])
            cables.bristle[c, i] = limit * p.reference_tension / p.presliding


@internal
def _varies(p: Plant) -> bool:
    """Return whether friction depends on anything but load."""
    return (
        p.stribeck != 0.0
        or p.asymmetry != 0.0
        or p.tension_power != 0.0
        or p.ageing != 0.0
        or p.wrap_slope != 0.0
        or p.heating != 0.0
        or p.bumps != 0.0
    )


@internal
def _wrap(p: Plant, i: int, joint_angle: float) -> float:
    """Return the wrap angle at node i; a limb bends the last third of the conduit."""
    wrap = p.wrap / p.nodes
    third = p.nodes // 3
    if i >= p.nodes - third:
        bend = joint_angle + 0.2 * joint_angle * abs(joint_angle)
        wrap += p.wrap_slope * bend / third
    return max(wrap, 0.0)


@internal
def _excess(p: Plant, cables: Cables, c: int, i: int) -> float:
    """Return the friction coefficient at a node over its plain value."""
    slowness = cables.lagged[c, i] / p.stribeck_speed
    factor = 1.0 + p.stribeck * math.exp(-slowness * slowness)
    factor += p.ageing * math.log1p(cables.contact[c, i] / p.ageing_time)
    factor *= 1.0 + p.heating * (1.0 - math.exp(-cables.warmth[c]))
    if p.tension_power != 0.0:
        ratio = max(cables.load[c, i], 2.0) / p.reference_tension
        factor *= ratio**p.tension_power
    if p.bumps != 0.0:
        for k in range(p.bump_places.shape[1]):
            away = (cables.place[c, i] - p.bump_places[c, k]) / p.bump_width
            factor += p.bumps * math.exp(-away * away)
    return factor


@internal
def _look_up(p: Plant, cables: Cables, joint_angle: float) -> None:
    """Compute the friction limit over load at every node, in both directions."""
    for c in range(2):
        mu = p.friction_a if c == 0 else p.friction_b
        # The joint turning positive moves cable a ahead and cable b back. The liner of
        # b has worn less, so its friction leans less.
        lean = p.asymmetry if c == 0 else -0.6 * p.asymmetry
        for i in range(p.nodes):
            half = 0.5 * mu * _excess(p, cables, c, i) * _wrap(p, i, joint_angle)
            cables.ahead[c, i] = 2.0 * math.tanh(half * (1.0 + lean))
            cables.behind[c, i] = 2.0 * math.tanh(half * (1.0 - lean))


@internal
def update(p: Plant, cables: Cables, joint_angle: float, tick: float) -> None:
    """Update the variables of friction other than load, after `tick` seconds."""
    if not _varies(p):
        return
    mix = tick / (p.stribeck_lag + tick)
    for c in range(2):
        fresh = cables.work[c, 0] - cables.warmed[c]
        cables.warmed[c] = cables.work[c, 0]
        cables.warmth[c] += fresh / p.heating_energy
        cables.warmth[c] -= tick / p.heating_time * cables.warmth[c]
        for i in range(p.nodes):
            speed = abs(cables.speed[c, i])
            cables.lagged[c, i] += mix * (speed - cables.lagged[c, i])
            age = cables.contact[c, i] + tick
            cables.contact[c, i] = age / (1.0 + speed * tick / p.ageing_slip)
    _look_up(p, cables, joint_angle)


@internal
def _bedded(y: float, h: float, bend: float) -> float:
    """Return the relative tension of a strand at `y`, that of a linear strand."""
    x = abs(y) / bend
    log_cosh = x + math.log1p(math.exp(-2.0 * x)) - math.log(2.0)
    return y + h * bend * log_cosh


@internal
def _laid(tension: float, h: float, bend: float) -> float:
    """Return where `_bedded`, which only grows, is this tension (Newton)."""
    y = tension
    for _ in range(50):
        miss = _bedded(y, h, bend) - tension
        y -= miss / (1.0 + h * math.tanh(y / bend))
        if abs(miss) < 1e-9:
            break
    return y


@internal
def _slide(cables: Cables, c: int, j: int, load: float, travel: float) -> None:
    """Step the bristle of node j by its travel."""
    ahead = cables.ahead[c, j] * load + cables.seal[j] + 1e-12
    behind = cables.behind[c, j] * load + cables.seal[j] + 1e-12
    top = ahead if travel > 0.0 else behind
    held = min(max(cables.force[c, j], -behind), ahead)
    push = cables.bristle[c, j] * travel
    cables.force[c, j] = top * (held + push) / (top + abs(push))
    cables.load[c, j] = load
    cables.work[c, 0] += cables.force[c, j] * travel


@internal
def step(
    p: Plant,
    cables: Cables,
    c: int,
    rest: float,
    near: float,
    near_speed: float,
    far: float,
    far_speed: float,
    dt: float,
) -> tuple[float, float]:
    """Advance cable c by dt between its two ends; tension at the motor and the joint.

    `near` and `far` are the displacements of the ends towards the motor, `rest` is the
    tension of an unstretched cable.
    """
    n = p.nodes
    mass = p.line_density * p.length / n
    drag = p.viscous / n
    h = p.stiffening * (1.0 if c == 0 else 0.33)
    # How stiff a strand is depends on its tension, not on how it was laid in.
    slack = rest - p.reference_tension
    laid = _laid(slack, h, p.stiffening_tension) if h != 0.0 else 0.0
    proximal = 0.0
    before = 0.0
    for i in range(n + 1):
        here = cables.place[c, i] if i < n else far
        here_speed = cables.speed[c, i] if i < n else far_speed
        k = cables.stiffness[c, i]
        elastic = rest + k * (near - here)
        if h != 0.0:
            bedded = _bedded(laid + k * (near - here), h, p.stiffening_tension)
            elastic = p.reference_tension + bedded
        rate = near_speed - here_speed
        tension = elastic + p.material_time * k * rate
        if tension <= 0.0:
            tension = 0.0
        elif elastic > 0.0:
            cables.work[c, 1] += (tension - elastic) * rate * dt
        if i == 0:
            proximal = tension
        else:
            j = i - 1
            pull = before - tension - cables.force[c, j]
            speed = (cables.speed[c, j] + pull / mass * dt) / (1.0 + drag / mass * dt)
            cables.speed[c, j] = speed
            cables.place[c, j] += speed * dt
            cables.work[c, 0] += drag * speed * speed * dt
            _slide(cables, c, j, 0.5 * (before + tension), speed * dt)
        before = tension
        near = here
        near_speed = here_speed
    return proximal, before


@internal
def stored(
    p: Plant,
    cables: Cables,
    rest: float,
    near: tuple[float, float],
    far: tuple[float, float],
) -> float:
    """Return the energy of strain and motion of both cables [J]; linear strand.

    `near` and `far` are the displacements of the ends of cables a and b.
    """
    n = p.nodes
    mass = p.line_density * p.length / n
    energy = 0.0
    for c in range(2):
        last = near[c]
        for i in range(n + 1):
            here = cables.place[c, i] if i < n else far[c]
            tension = rest + cables.stiffness[c, i] * (last - here)
            if tension > 0.0:
                energy += 0.5 * tension * tension / cables.stiffness[c, i]
            if i < n:
                energy += 0.5 * mass * cables.speed[c, i] ** 2
            last = here
    return energy
