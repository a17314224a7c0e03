"""The block of memory that `plugin_data` holds for an instance, compiled.

It is made when MuJoCo initialises a simulation and freed with it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import config, ends, fields, pieces
from cc_mujoco.engine.memory import (
    floats,
    internal,
    load_real,
    load_word,
    store_real,
    store_word,
)
from cc_mujoco.transmission import eccentric, kernel

# Byte offsets in the memory block of an instance; after the header follow the packed
# parameters, scratch, the state before and after the last evaluation, a copy of the
# configuration text, what is known of the path: now, at the last four evaluations under
# RK4, and in the pose `qpos0`; and the forces of an open cable's pieces.
SEGMENTS = 0
PROXIMAL = 8
DISTAL = 16
TIED = 24  # for each end, whether it is tied to a site of an open cable's tendon
TEXT_SIZE = 40
KNOWN = 48
ROUTE = 56  # the tendon that bends or leads the cable, or -1
FOLLOWS = 64  # whether it bends the conduit
GUIDED = 72  # number of segments in the conduit
MOUTH = 80  # place of the conduit's mouth in the path of that tendon, 0: none
REFERRED = 88  # whether the path in the pose `qpos0` is known
FRESH = 96  # whether `qfrc_passive` has been evaluated since the cable pulled
SHAPE = 104  # bytes of what is known of the path at one position
CHECKED = 112  # the time step of the model when it was last held against the limits
INSTANCE = 120
DOFS = 128
HOLDERS = 136  # for each end, its actuator
AREA = 152  # of a model's first cable, where `ahead.py` keeps what it finds
INPUTS = 160  # displacement of both ends, how far they yield, and dt
SEEN = 200  # displacements for which `INPUTS` were found
EXPLICIT = 224  # whether it never does
SCRATCH = 232  # a force, and no torque
STIFFNESS = 280  # of both ends with the present parameters, or 0
WALKED = 296  # the evaluation in which it was led along its path, or 0
EVALUATION = 304  # of a model's first cable: counts the evaluations
SPEEDS = 312  # velocities of both ends for which `INPUTS` were found
EARLY = 328  # whether the pieces pull before the actuators: 0, `KEPT` or `FOR_NOW`
TOUCHED = 336  # whether `qpos` is another than the last step made it
MOCAPS = 344  # of a model's first cable, where it keeps poses of mocap bodies, or 0
STIFFEST = 352  # stiffness of a piece when the time step was last held against limits
STAGES = 360  # u_proximal, u_distal, time, inputs of the last four evaluations of RK4
STAGE = 64
FIRST = STAGES + 4 * STAGE  # where the state after the first stage of RK4 is
BEGUN = FIRST + 8  # whether there is one
HEADER = BEGUN + 8
TEXT_CAPACITY = 4096
KEPT, FOR_NOW = 1, 2
"""Early pull that the evaluation of the actuators keeps, or that it replaces."""
TIME, POSE, PATH = 0, 1, 2
"""Place, behind the kernel's own state, of the time of the committed configuration, of
a checksum of its pose, and of what an open cable remembers of its path."""


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


REFERENCE = 5


@internal
def shape_at(block: int, n: int, stage: int) -> int:
    """Address of a path: 0 is now, 1 to 4 the stages of RK4, `REFERENCE` in `qpos0`.

    A path is the wrap angles of the segments and, of an open cable, what
    `pieces.survey` finds.
    """
    return text_at(block, n) + TEXT_CAPACITY + load_word(block + SHAPE) * stage


@internal
def pulls_at(block: int, n: int) -> int:
    """Address of the forces that an open cable added to `qfrc_passive` last."""
    return shape_at(block, n, REFERENCE + 1)


@internal
def scratch_at(block: int, n: int) -> int:
    """Address of scratch, for forces (nv,) or for lengths of nodes (n + 1,)."""
    return pulls_at(block, n) + 8 * load_word(block + DOFS)


@internal
def before_at(block: int, n: int) -> int:
    """Address of `qfrc_passive` before an open cable added its forces (nv,)."""
    return scratch_at(block, n) + 8 * (load_word(block + DOFS) + n + 1)


@internal
def first_at(block: int) -> int:
    """Address of the state after the first stage of the last step of RK4.

    It is laid out as a committed one, with the time of that stage, the checksum of the
    state that it began from, and the path.
    """
    return block + load_word(block + FIRST)


@internal
def outdate(block: int) -> None:
    """Forget what follows from the packed parameters."""
    store_word(block + KNOWN, 0)
    store_real(block + STIFFNESS, 0.0)
    store_real(block + STIFFNESS + 8, 0.0)


@internal
def opens(block: int) -> bool:
    """Return whether the cable leaves its conduit or has none."""
    return load_word(block + GUIDED) < load_word(block + SEGMENTS)


@internal
def displacement(data: int, block: int, end: int) -> float:
    """Displacement of an end at the last evaluated position [m]."""
    if load_word(block + TIED + end - PROXIMAL) != 0:
        return 0.0
    return fields.real(data, fields.LENGTH, load_word(block + end))


@internal
def rest_displacement(model: int, block: int, end: int) -> float:
    """Displacement of an end in the pose `qpos0` [m]."""
    if load_word(block + TIED + end - PROXIMAL) != 0:
        return 0.0
    return fields.real(model, fields.LENGTH0, load_word(block + end))


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
    return state + 8 * (kernel.state_size(n) + TIME)


@internal
def pose_at(state: int, n: int) -> int:
    """Address of the checksum of the pose to which the last step led."""
    return state + 8 * (kernel.state_size(n) + POSE)


@internal
def memory(state: int, n: int) -> npt.NDArray[np.float64]:
    """Return the memory of the path in a committed state of an open cable."""
    begin = state + 8 * (kernel.state_size(n) + PATH)
    return floats(begin, pieces.memory_size(n))
