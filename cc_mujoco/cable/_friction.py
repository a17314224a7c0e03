"""Friction terms of a cable in its conduit: the force that opposes a slip.

A term and its parameters are declared as fields of `Cable`; here they take effect.

Every law is reduced, for the step at hand, to per-segment coefficients. Along a segment
that slips at speed v, tension grows in the direction of motion from T_behind to

    T_ahead = E T_behind + B + C v,

E = exp(mu a) with the segment's wrap angle a (thesis 2.10), B the drag that needs no
tension, C that of viscosity. A segment that does not slip holds as long as neither of
its tensions exceeds `H` times the other plus B. The solvers see only E, H, B and C, so
a new term needs only its share in the functions below.
"""

import math
from collections.abc import Callable
from types import SimpleNamespace

from cc_mujoco.cable._cable import PARAMETERS, TERMS
from cc_mujoco.cable._parameter import Term
from cc_mujoco.native import FloatArray, compiled, internal

INDEX = {parameter.name: i for i, parameter in enumerate(PARAMETERS)}
"""Position of each scalar parameter in the packed vector."""
PLACE = SimpleNamespace(**INDEX)
"""`INDEX` with attributes in place of keys, for compiled code."""
DRAG_TERMS = tuple(
    (i, each.term, each.unit)
    for i, each in enumerate(PARAMETERS)
    if each.term is not None and each.term.acts_on == "drag"
)
"""Parameters of friction that needs no tension: place, term and unit."""
MIN_GREASE_SPEED = 1e-6
"""Slip speed [m/s] below which the drag of grease is in proportion to it."""


def _term_indices(holds: Callable[[Term], bool]) -> tuple[tuple[int, int], ...]:
    """Return `INDEX` of each selected term and its `constant_without`, else itself."""
    return tuple(
        (INDEX[name], INDEX[term.constant_without or name])
        for name, term in TERMS.items()
        if holds(term)
    )


_VARYING_TERMS = _term_indices(
    lambda term: (
        term.acts_on != "pulley"
        and bool(term.depends_on)
        and (term.acts_on, term.depends_on[0]) != ("elasticity", "load")
    )
)
_SCALING_TERMS = _term_indices(
    lambda term: (
        term.acts_on == "coefficient"
        and not {"load", "time", "place"}.isdisjoint(term.depends_on)
    )
)


@compiled
def ratio(coefficient: float, angle: float) -> float:
    """Return the tension ratio exp(mu a) of one segment, cut at 1e13."""
    return math.exp(min(coefficient * angle, 30.0))


@internal
def is_state_dependent(values: FloatArray) -> bool:
    """Return whether load, time or place change the friction coefficients."""
    for switch, other in _SCALING_TERMS:
        if values[switch] != 0.0 and values[other] != 0.0:
            return True
    return False


@internal
def is_constant_coulomb(values: FloatArray) -> bool:
    """Return whether friction is Coulomb's, the same at all times and places."""
    for switch, other in _VARYING_TERMS:
        if values[switch] != 0.0 and values[other] != 0.0:
            return False
    return True


@internal
def _weighted_length(length: float, growth: float) -> float:
    """Return a segment's length [m], weighted by the growth of tension along it."""
    exponent = math.log(growth)
    if exponent < 1e-9:
        return length
    return length * (growth - 1.0) / exponent


@compiled
def drag(
    values: FloatArray, length: float, growth: float, j: int, guided: int
) -> float:
    """Return B [N], the drag of segment j over `length` [m]; `growth` is its E.

    The first `guided` segments are in a conduit, which may have a seal at either end.
    """
    load_independent: float = values[PLACE.load_independent_friction]
    total = 0.0
    if load_independent != 0.0:
        total = load_independent * _weighted_length(length, growth)
    if j == 0 and guided > 0:
        total += values[PLACE.seal_proximal]
    if j == guided - 1:
        total += values[PLACE.seal_distal]
    return total


@internal
def grease_viscosity(values: FloatArray, speed: float) -> float:
    """Return the drag of grease per conduit length and slip speed [N s/m^2].

    Herschel and Bulkley, Kolloid-Zeitschrift 39, 1926: g |v|^n = (g |v|^(n-1)) |v|,
    constant below `MIN_GREASE_SPEED`.
    """
    if values[PLACE.grease_drag] == 0.0:
        return 0.0
    power = values[PLACE.grease_exponent] - 1.0
    return float(values[PLACE.grease_drag] * max(speed, MIN_GREASE_SPEED) ** power)


@internal
def next_guess(values: FloatArray, guess: float, speed: float) -> float:
    """Return the next guess of the slip speed for the viscosity of grease [m/s].

    With exponent n, a fixed-point round leaves 1 - n of an error in ln v if drag alone
    resists, and none if the slip is given. The step here, 2/(1 + n) times as long,
    leaves (1 - n)/(1 + n) in magnitude in both cases.
    """
    further = 2.0 / (1.0 + values[PLACE.grease_exponent])
    risen = guess * (max(speed, MIN_GREASE_SPEED) / guess) ** further
    return float(max(risen, MIN_GREASE_SPEED))


@internal
def viscosity(
    values: FloatArray, length: float, growth: float, speed: float, dt: float
) -> float:
    """Return C, viscous drag of a segment per displacement in a step `dt` [N/m]."""
    viscous: float = values[PLACE.viscous_friction] + grease_viscosity(values, speed)
    if viscous == 0.0:
        return 0.0
    return viscous * _weighted_length(length, growth) / dt


@internal
def kinetic_coefficient(values: FloatArray, slip: float, speed: float) -> float:
    """Return the friction coefficient of a segment that slips.

    `slip` is the distance since it last stuck or turned [m], `speed` the slip speed
    that it remembers [m/s]; both >= 0.
    """
    coefficient: float = values[PLACE.friction]
    static, ending = values[PLACE.static_friction], values[PLACE.critical_slip_distance]
    if static > 0.0 and ending > 0.0:
        excess = static - values[PLACE.friction]
        coefficient += excess * math.exp(-slip / ending)
    if values[PLACE.stribeck_friction] > 0.0:
        exponent = values[PLACE.stribeck_exponent]
        decay = (speed / values[PLACE.stribeck_speed]) ** exponent
        tail = values[PLACE.stribeck_tail]
        share = (1.0 - tail) * math.exp(-decay) + tail / (1.0 + decay)
        coefficient += values[PLACE.stribeck_friction] * share
    return coefficient


@compiled
def holding_coefficient(values: FloatArray) -> float:
    """Return the largest friction coefficient of a segment at rest."""
    coefficient: float = max(values[PLACE.friction], values[PLACE.static_friction])
    if values[PLACE.stribeck_friction] > 0.0:
        coefficient += values[PLACE.stribeck_friction]
    return coefficient


@internal
def remembered_speed(values: FloatArray, speed: float, slip: float, dt: float) -> float:
    """Return the slip speed for the Stribeck term of the next step [m/s].

    It follows the slip speed over `critical_slip_distance` of `slip` [m], or at once
    when that is 0; a segment that sticks forgets. For grease it is only the first guess
    of the next step's speed.
    """
    if slip == 0.0:
        return 0.0
    now: float = abs(slip) / dt
    ending = values[PLACE.critical_slip_distance]
    if ending == 0.0:
        return now
    return now + (speed - now) * math.exp(-abs(slip) / ending)


@internal
def bristle_stiffness(
    values: FloatArray, coefficient: float, angle: float, mean: float, drag: float
) -> float:
    """Return the stiffness [N/m] of a segment's bristles at its `mean` tension [N]."""
    # Shorter bristles are Coulomb friction; those of a slack cable give no stiffness.
    length = max(values[PLACE.bristle_length], 1e-9)
    stiffness: float = (coefficient * angle * mean + drag) / length
    return stiffness if stiffness > 1e-12 else 0.0


@internal
def bristle_force(force: float, stretch: float, stiffness: float) -> float:
    """Return the force [N] of bristles after their stiffness changed to this [N/m].

    Softer ones keep their stretch [m], stiffer ones their force [N], so that a
    stiffness which follows the tension never adds energy.
    """
    most = stiffness * abs(stretch)
    return min(max(force, -most), most)


@internal
def drift_factor(values: FloatArray, time: float, heat: float) -> float:
    """Return the factor on friction after this time [s], at this conduit heat [J]."""
    drift = values[PLACE.friction_drift] * time + values[PLACE.friction_heating] * heat
    return float(max(1.0 + drift, 0.0))


@internal
def heat_after_step(values: FloatArray, heat: float, lost: float, dt: float) -> float:
    """Return the heat in the conduit after a step that adds `lost` and cools [J]."""
    if values[PLACE.friction_heating] == 0.0:
        return 0.0
    return float((heat + lost) * math.exp(-dt / values[PLACE.cooling_time]))


@internal
def wrap_factor(
    values: FloatArray, travel: float, begin: float, end: float, length: float
) -> float:
    """Return the factor of `wrap_growth` on the wrap from `begin` to `end` [m].

    The distal end is displaced by `travel` [m], the conduit is `length` [m] long.
    """
    reach = length * values[PLACE.wrap_reach]
    inside, own = end - (length - reach), end - begin
    share = min(max(inside, 0.0), own) / own if own > 0.0 else 0.0
    bent = share * values[PLACE.wrap_growth]
    return float(max(1.0 + bent * travel, 0.0))


@internal
def changed_coefficients(
    values: FloatArray, moving: float, resting: float, drift: float, mean: float,
    age: float,
) -> tuple[float, float]:  # fmt: skip
    """Return friction coefficients of slip and at rest, changed by time, load and age.

    `moving` and `resting` are the unchanged ones, `drift` is the `drift_factor`, `mean`
    the mean tension of the segment [N], `age` that of `age_after_step`.
    """
    factor, exponent = drift, values[PLACE.tension_exponent]
    if exponent != 0.0:
        factor *= max(mean / values[PLACE.pretension], 0.01) ** exponent
    aged = values[PLACE.ageing_friction] * age
    # Without memory the first slip renews the contacts.
    kept = aged if values[PLACE.critical_slip_distance] > 0.0 else 0.0
    return factor * (moving + kept), factor * (resting + aged)


@internal
def direction_factor(values: FloatArray, sense: float) -> float:
    """Return the factor on friction of slip in a sense, 1 towards distal, else -1."""
    return float(1.0 - sense * values[PLACE.friction_asymmetry])


@internal
def age_after_step(values: FloatArray, age: float, slip: float, dt: float) -> float:
    """Return the age ln(1 + T/t_0) of the contacts after a step of `slip` [m].

    Contacts age and slip over `critical_slip_distance` renews them: dT/dt = 1 - |v|
    T/l, T in seconds, solved for the mean speed (Ruina, J. Geophys. Res. 88, 1983).
    """
    scale = values[PLACE.ageing_time]
    if slip == 0.0:
        return math.log(math.exp(age) + dt / scale)
    if values[PLACE.critical_slip_distance] == 0.0:
        return 0.0
    ways = abs(slip) / values[PLACE.critical_slip_distance]
    kept = math.exp(-ways)
    gained = dt * (-math.expm1(-ways) / ways)
    return math.log1p(math.expm1(age) * kept + gained / scale)
