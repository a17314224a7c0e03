"""Friction of every segment in a step, compiled.

The laws are those of `_friction.py`. What they give are rows of scratch, `_layout.py`.
"""

from __future__ import annotations

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nonlinear_elasticity as nonlinear_elasticity
from cc_mujoco.cable._fronts import overcome_direction
from cc_mujoco.native import FloatArray, internal

_ASYMMETRY = law.INDEX["friction_asymmetry"]
_BRISTLE = law.INDEX["bristle_length"]
_AGEING = law.INDEX["ageing_friction"]
_CRITICAL_SLIP = law.INDEX["critical_slip_distance"]


@internal
def write_holds(
    prm: FloatArray, n: int, state: FloatArray, work: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Write and return H of segments whose friction is constant, towards both ends."""
    growth, hold = at.constant_growth(prm, n), at.constant_hold(prm, n)
    slips = at.slips(state, n)
    distal, proximal = (
        at.row(work, n, at.HOLD_DISTAL),
        at.row(work, n, at.HOLD_PROXIMAL),
    )
    for j in range(n):
        # A segment that goes on slipping the same way has already broken away.
        distal[j] = growth[j] if slips[j] > 0.0 else hold[j]
        proximal[j] = growth[j] if slips[j] < 0.0 else hold[j]
    return distal, proximal


@internal
def write_coefficients(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    tension: FloatArray,
    dt: float,
    work: FloatArray,
) -> None:
    """Write the coefficients of every segment for this step, see `_friction.py`."""
    if prm[at.CONSTANT_COULOMB] != 0.0:
        write_holds(prm, n, state, work)
        at.row(work, n, at.GROWTH)[:] = at.constant_growth(prm, n)
        at.row(work, n, at.GROWTH_PROXIMAL)[:] = at.constant_growth(prm, n)
        at.row(work, n, at.DRAG)[:] = at.constant_drag(prm, n)
        at.row(work, n, at.VISCOSITY)[:] = 0.0
        return
    values = at.scalars(prm)
    is_state_dependent = prm[at.STATE_DEPENDENT] != 0.0
    asymmetry = values[_ASYMMETRY]
    guided, length = int(prm[at.GUIDED]), at.contact_length(prm, n)
    growth, growth_proximal = (
        at.row(work, n, at.GROWTH),
        at.row(work, n, at.GROWTH_PROXIMAL),
    )
    hold_distal, hold_proximal = (
        at.row(work, n, at.HOLD_DISTAL),
        at.row(work, n, at.HOLD_PROXIMAL),
    )
    drag, viscosity = at.row(work, n, at.DRAG), at.row(work, n, at.VISCOSITY)
    resting = law.holding_coefficient(values)
    drift = 1.0
    if is_state_dependent:
        drift = law.drift_factor(values, state[at.TIME] + dt, state[at.HEAT])
    constant_hold = at.constant_hold(prm, n)
    slips, speeds = at.slips(state, n), at.slip_speeds(state, n)
    angles, ages = at.segment_angles(prm, n), at.contact_ages(state, n)
    reached = 0.0
    for j in range(n):
        begin, reached = reached, reached + length[j]
        slip = slips[j]
        distal_hold = proximal_hold = constant_hold[j]
        angle = angles[j]
        if is_state_dependent:
            angle *= law.wrap_factor(
                values, state[at.TRAVEL], begin, reached, prm[at.LENGTH]
            )
        mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
        coefficient = law.kinetic_coefficient(values, abs(slip), speeds[j])
        holding = resting
        if is_state_dependent:
            factor = drift * law.load_factor(values, mean)
            extra = values[_AGEING] * ages[j]
            holding = factor * (holding + extra)
            # Without memory the first slip renews the contacts.
            extra = extra if values[_CRITICAL_SLIP] > 0.0 else 0.0
            coefficient = factor * (coefficient + extra)
        growth[j] = growth_proximal[j] = law.ratio(coefficient, angle)
        if is_state_dependent:
            distal_hold = proximal_hold = growth[j]
            if holding != coefficient:
                distal_hold = proximal_hold = law.ratio(holding, angle)
        drag[j] = law.drag(values, length[j], growth[j], j, guided)
        viscosity[j] = law.viscosity(
            values, length[j], growth[j], at.row(work, n, at.SPEED)[j], dt
        )
        if asymmetry != 0.0:
            distal, proximal = 1.0 - asymmetry, 1.0 + asymmetry
            growth[j] = law.ratio(coefficient * distal, angle)
            growth_proximal[j] = law.ratio(coefficient * proximal, angle)
            distal_hold, proximal_hold = growth[j], growth_proximal[j]
            if holding != coefficient:
                distal_hold = law.ratio(holding * distal, angle)
                proximal_hold = law.ratio(holding * proximal, angle)
        if values[_BRISTLE] > 0.0:
            spring = law.bristle_stiffness(values, coefficient, angle, mean, drag[j])
            force = at.bristle_forces(state, n)[j]
            stretch = at.bristle_stretches(state, n)[j]
            at.row(work, n, at.HELD)[j] = law.bristle_force(force, stretch, spring)
            # Bristles bend by the way on the surface, slip is of unstretched cable.
            spring *= moving_path.surface_ratio(prm, tension[j], tension[j + 1])
            at.row(work, n, at.SPRING)[j] = spring
        # A segment that goes on slipping the same way has already broken away.
        hold_distal[j] = growth[j] if slip > 0.0 else distal_hold
        hold_proximal[j] = growth_proximal[j] if slip < 0.0 else proximal_hold


@internal
def friction_holds(
    n: int,
    tension: FloatArray,
    hold_distal: FloatArray,
    hold_proximal: FloatArray,
    drag: FloatArray,
) -> bool:
    for j in range(n):
        proximal, distal = max(tension[j], 0.0), max(tension[j + 1], 0.0)
        if (
            overcome_direction(
                proximal, distal, hold_distal[j], hold_proximal[j], drag[j]
            )
            != 0
        ):
            return False
    return True


@internal
def update_viscosity(
    prm: FloatArray, n: int, node: FloatArray, dt: float, work: FloatArray
) -> bool:
    """Take the viscosity of grease at other slip speeds; return if they were right.

    Implicit in the slip of the step, so grease takes energy whatever dt, and after any
    round. The error is of first order in dt, as that of viscous friction (0.06 % RMS at
    1 ms where the ends turn at once); rounds stop where all segments together are off
    the law by 1e-5 of the largest tension.
    """
    values = at.scalars(prm)
    shift, guess = at.row(work, n, at.SHIFT), at.row(work, n, at.SPEED)
    length, largest = at.contact_length(prm, n), 0.0
    for i in range(n + 1):
        largest = max(largest, node[i])
    error = 0.0
    for j in range(n):
        speed = abs(shift[j]) / dt
        taken = law.grease_viscosity(values, guess[j])
        right = law.grease_viscosity(values, speed)
        error += abs(right - taken) * speed * length[j]
        guess[j] = law.next_guess(values, guess[j], speed)
    return error <= nonlinear_elasticity.LINEARIZATION_TOLERANCE * largest
