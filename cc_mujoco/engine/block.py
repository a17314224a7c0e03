"""The block of memory that `plugin_data` holds for an instance, compiled.

It is made when MuJoCo initialises a simulation and freed with it.
"""

from __future__ import annotations

from cc_mujoco.engine import config, ends, fields
from cc_mujoco.engine.memory import internal, load_real, load_word
from cc_mujoco.transmission import eccentric, kernel

# Byte offsets in the memory block of an instance; after the header follow the packed
# parameters, scratch, the state before and after the last evaluation, a copy of the
# configuration text, and the bends of the route: now, and at the last four evaluations
# under RK4.
SEGMENTS = 0
PROXIMAL = 8
DISTAL = 16
TEXT_SIZE = 24
KNOWN = 32
ROUTE = 40  # the tendon that bends the conduit, or -1
INPUTS = 48  # u_proximal, u_distal, dt
CHECKED = 72  # the time step of the model when it was last held against the limits
STAGES = 80  # u_proximal, u_distal, dt, time of the last four evaluations under RK4
STAGE = 32
HEADER = STAGES + 4 * STAGE
TEXT_CAPACITY = 4096


@internal
def parameters_at(block: int) -> int:
    """Address of the packed parameters."""
    return block + HEADER


@internal
def work_at(block: int, n: int) -> int:
    """Address of the kernel's scratch."""
    return parameters_at(block) + 8 * kernel.parameter_size(n)


@internal
def old_at(block: int, n: int) -> int:
    """Address of the state before the last evaluation."""
    return work_at(block, n) + 8 * kernel.work_size(n)


@internal
def new_at(block: int, n: int) -> int:
    """Address of the state after the last evaluation."""
    return old_at(block, n) + 8 * kernel.state_size(n)


@internal
def text_at(block: int, n: int) -> int:
    """Address of the configuration text that was packed last."""
    return new_at(block, n) + 8 * kernel.state_size(n)


@internal
def bends_at(block: int, n: int, stage: int) -> int:
    """Address of the wrap angles of the route: 0 is now, 1 to 4 the stages of RK4."""
    return text_at(block, n) + TEXT_CAPACITY + 8 * n * stage


@internal
def displacement(data: int, block: int, end: int) -> float:
    """Displacement of an end at the last evaluated position [m]."""
    return fields.real(data, fields.LENGTH, load_word(block + end))


@internal
def wound(model: int, block: int, length: float) -> tuple[float, float]:
    """Displacement of the proximal end [m] and the lever of its tension.

    `length` is that of its actuator. The parameters must be up to date.
    """
    prm = parameters_at(block)
    gear = ends.gear(model, load_word(block + PROXIMAL))
    e = load_real(prm + 8 * config.ECCENTRICITY)
    phase = load_real(prm + 8 * config.ECCENTRICITY_PHASE)
    ovality = load_real(prm + 8 * config.OVALITY)
    second = load_real(prm + 8 * config.OVALITY_PHASE)
    return (
        eccentric.wound(length, gear, e, phase, ovality, second),
        eccentric.lever(length, gear, e, phase, ovality, second),
    )


@internal
def committed_time(state: int, n: int) -> int:
    """Address of the time of the committed configuration."""
    return state + 8 * kernel.state_size(n)
