"""Motion of the cables: massive nodes between segments that cannot push; compiled."""

from __future__ import annotations

import math

from cc_mujoco.native import internal
from rig.cables import Cables
from rig.plant import Plant


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
def step_cable(
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
