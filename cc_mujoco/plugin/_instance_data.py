"""The block of memory that `plugin_data` holds for an instance, compiled.

It is made when MuJoCo initialises a simulation and freed with it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._reading import PATH_MEMORY
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin._ffi import (
    floats,
    internal,
    load_real,
    load_word,
    store_real,
    store_word,
)

# Byte offsets in the memory block of an instance; after the header follow the packed
# parameters, scratch, the state before and after the last evaluation, a copy of the
# configuration text, the guides, what is known of the path: now, at the last four
# evaluations under RK4, and in the pose `qpos0`; and the forces of an open cable's
# pieces.
SEGMENTS = 0
PROXIMAL = 8
DISTAL = 16
TIED_ENDS = 24  # for each end, whether it is tied to a site of an open cable's tendon
TEXT_SIZE = 40
RESULT_VALID = 48
ROUTE = 56  # the tendon that bends or leads the cable, or -1
BENDS_WITH_ROUTE = 64  # whether it bends the conduit
GUIDED = 72  # number of segments in the conduit
MOUTH = 80  # place of the conduit's mouth in the path of that tendon, 0: none
REFERENCE_KNOWN = 88  # whether the path in the pose `qpos0` is known
PASSIVE_FRESH = 96  # whether `qfrc_passive` has been evaluated since the cable pulled
SHAPE_BYTES = 104  # bytes of what is known of the path at one position
# The time step of the model when it was last held against the limits.
CHECKED_TIMESTEP = 112
INSTANCE = 120
DOFS = 128
END_ACTUATORS = 136  # for each end, its actuator
# Of a model's first cable, for the results of `_implicit_ends.py`.
PREDICTION_AREA = 152
INPUTS = 160  # displacement of both ends, how far they yield, and dt
INPUT_POSITIONS = 200  # displacements for which `INPUTS` were found
EXPLICIT_ENDS = 224  # whether it never does
SCRATCH = 232  # a force, and no torque
STIFFNESS = 280  # of both ends with the present parameters, or 0
PATH_EVALUATION = 296  # the evaluation in which it was led along its path, or 0
EVALUATION_COUNT = 304  # of a model's first cable: counts the evaluations
INPUT_VELOCITIES = 312  # velocities of both ends for which `INPUTS` were found
# Whether the pieces pull before the actuators: 0, `EARLY_KEPT` or `EARLY_REPLACED`.
EARLY_PULL = 328
POSITION_CHANGED = 336  # whether `qpos` is another than the last step made it
# Of a model's first cable, where it keeps poses of mocap bodies, or 0.
MOCAP_POSES = 344
# Stiffness of a piece when the time step was last held against limits.
CHECKED_STIFFNESS = 352
STAGES = 360  # u_proximal, u_distal, time, inputs of the last four evaluations of RK4
STAGE_SIZE = 64
FIRST_STAGE_STATE = (
    STAGES + 4 * STAGE_SIZE
)  # where the state after the first stage of RK4 is
FIRST_STAGE_VALID = FIRST_STAGE_STATE + 8  # whether there is one
# For what model it was made, see `fits`, and for what `path`.
STATE_ADDRESS = FIRST_STAGE_VALID + 8
STATE_SIZE = STATE_ADDRESS + 8
MOCAPS = STATE_SIZE + 8
LEAD = MOCAPS + 8
PATH_KIND = LEAD + 8
OTHER_KIND = PATH_KIND + 8  # whether the configuration has another, or other segments
ROUTE_DIGEST = OTHER_KIND + 8  # of the places of `ROUTE` when it was packed
# Model that the forces of its actuators were evaluated with since the last step, or 0.
EVALUATED_MODEL = ROUTE_DIGEST + 8
HEADER_SIZE = EVALUATED_MODEL + 8
TEXT_CAPACITY = 4096
EARLY_KEPT, EARLY_REPLACED = 1, 2
"""Early pull that the evaluation of the actuators keeps, or that it replaces."""
STATE_TIME, STATE_POSE, STATE_ENDS, STATE_VELOCITIES = 0, 1, 2, 4
STATE_PATH = PATH_MEMORY
"""Place, behind the kernel's own state, of the time of the committed configuration, of
a checksum of its pose, of the displacements of both ends in it [m], of the velocities
of both ends and of the path [m/s], and of what an open cable remembers of its path.

The displacements in the kernel's state are those that the step looked ahead to."""


@internal
def save_sizes(block: int, model: int, instance: int) -> None:
    _, first, second = attachments.find_actuators(model, instance)
    store_word(block + INSTANCE, instance)
    store_word(block + END_ACTUATORS, first)
    store_word(block + END_ACTUATORS + 8, second)
    store_word(block + PROXIMAL, attachments.output_index(model, first))
    store_word(block + DISTAL, attachments.output_index(model, second))
    store_word(block + DOFS, mj_struct.dofs(model))
    store_word(block + MOCAPS, mj_struct.mocaps(model))
    store_word(block + LEAD, mj_struct.first_cable(model, instance))
    for where, field in (
        (STATE_ADDRESS, mj_struct.STATE_ADDRESS),
        (STATE_SIZE, mj_struct.STATE_SIZE),
    ):
        store_word(block + where, mj_struct.integer(model, field, instance))


@internal
def fits(block: int, model: int, instance: int) -> bool:
    """Return whether a block was made for this model's instance.

    With a model of other sizes, or in another order, a cable would write beyond its
    block or its state.
    """
    for end in range(2):
        actuator = load_word(block + END_ACTUATORS + 8 * end)
        output = load_word(block + (DISTAL if end else PROXIMAL))
        if (
            actuator >= mj_struct.actuators(model)
            or mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, actuator) != instance
            or attachments.output_index(model, actuator) != output
        ):
            return False
    address = mj_struct.integer(model, mj_struct.STATE_ADDRESS, instance)
    size = mj_struct.integer(model, mj_struct.STATE_SIZE, instance)
    return (
        load_word(block + STATE_ADDRESS) == address
        and load_word(block + STATE_SIZE) == size
        and load_word(block + DOFS) == mj_struct.dofs(model)
        and load_word(block + MOCAPS) == mj_struct.mocaps(model)
        and load_word(block + LEAD) == mj_struct.first_cable(model, instance)
    )


@internal
def own_block(model: int, data: int, instance: int) -> int:
    """Return the block of an instance of the plugin, or 0 where data have none.

    It may be one for another model, see `fits`.
    """
    kind = mj_struct.integer(model, mj_struct.PLUGIN, instance)
    if not mj_struct.is_plugin(data, instance, kind):
        return 0
    return mj_struct.block(data, instance)


@internal
def block_of(model: int, data: int, instance: int) -> int:
    """Return the block of an instance, or 0 where data have none that fits the model.

    `instance` is one of the plugin.
    """
    block = own_block(model, data, instance)
    return block if block != 0 and fits(block, model, instance) else 0


@internal
def acting_block(model: int, data: int, instance: int) -> int:
    """Return the block of an instance, or 0 where the cable cannot act.

    The first cable of the model must fit too, which keeps what all of them share, and
    the time step must be one.
    """
    if not mj_struct.has_timestep(model):
        return 0
    block, lead = (
        block_of(model, data, instance),
        mj_struct.first_cable(model, instance),
    )
    if block != 0 and lead != instance and block_of(model, data, lead) == 0:
        return 0
    return block


@internal
def parameters_at(block: int) -> int:
    return block + HEADER_SIZE


@internal
def work_at(block: int, n: int) -> int:
    """Return the address of the kernel's scratch."""
    return parameters_at(block) + 8 * kernel.parameter_size(n)


@internal
def old_at(block: int, n: int) -> int:
    """Return the address of the state before the last evaluation."""
    return work_at(block, n) + 8 * kernel.work_size(n)


@internal
def new_at(block: int, n: int) -> int:
    """Return the address of the state after the last evaluation."""
    return old_at(block, n) + 8 * kernel.state_size(n)


@internal
def text_at(block: int, n: int) -> int:
    """Return the address of the configuration text that was packed last."""
    return new_at(block, n) + 8 * kernel.state_size(n)


REFERENCE_STAGE = 5


@internal
def guides_at(block: int, n: int) -> int:
    """Return the address of the guides of an open cable, see `read_guides` (n,)."""
    return text_at(block, n) + TEXT_CAPACITY


@internal
def shape_at(block: int, n: int, stage: int) -> int:
    """Return the address of the path at a stage.

    Stage 0 is now, 1 to 4 are the stages of RK4, and `REFERENCE_STAGE` is `qpos0`. A
    path is the wrap angles of the segments and, for an open cable, the result of
    `measure_path`.
    """
    return guides_at(block, n) + 8 * n + load_word(block + SHAPE_BYTES) * stage


@internal
def pulls_at(block: int, n: int) -> int:
    """Return the address of the last forces of an open cable in `qfrc_passive`."""
    return shape_at(block, n, REFERENCE_STAGE + 1)


@internal
def scratch_at(block: int, n: int) -> int:
    """Return the address of scratch, for forces (nv,) or node lengths (n + 1,)."""
    return pulls_at(block, n) + 8 * load_word(block + DOFS)


@internal
def before_at(block: int, n: int) -> int:
    """Return the address of `qfrc_passive` without an open cable's forces (nv,)."""
    return scratch_at(block, n) + 8 * (load_word(block + DOFS) + n + 1)


@internal
def first_stage_at(block: int) -> int:
    """Return the address of the state after the first stage of the last step of RK4.

    It is laid out as a committed one, with the time of that stage, the checksum of the
    state that it began from, and the path.
    """
    return block + load_word(block + FIRST_STAGE_STATE)


@internal
def invalidate(block: int) -> None:
    """Invalidate the values that follow from the packed parameters."""
    store_word(block + RESULT_VALID, 0)
    store_real(block + STIFFNESS, 0.0)
    store_real(block + STIFFNESS + 8, 0.0)


@internal
def is_open(block: int) -> bool:
    return load_word(block + GUIDED) < load_word(block + SEGMENTS)


@internal
def displacement(data: int, block: int, end: int) -> float:
    """Return the displacement of an end at the last evaluated position [m]."""
    if load_word(block + TIED_ENDS + end - PROXIMAL) != 0:
        return 0.0
    return mj_struct.real(data, mj_struct.ACTUATOR_LENGTH, load_word(block + end))


@internal
def rest_displacement(model: int, block: int, end: int) -> float:
    """Return the displacement of an end in the pose `qpos0` [m]."""
    if load_word(block + TIED_ENDS + end - PROXIMAL) != 0:
        return 0.0
    return mj_struct.real(model, mj_struct.ACTUATOR_LENGTH0, load_word(block + end))


@internal
def proximal_winding(model: int, block: int, length: float) -> tuple[float, float]:
    """Return the displacement of the proximal end [m] and the lever of its tension.

    `length` is that of its actuator. The parameters must be up to date.
    """
    prm = parameters_at(block)
    gear = attachments.pulley_radius(model, load_word(block + PROXIMAL))
    e = load_real(prm + 8 * config.ECCENTRICITY)
    phase = load_real(prm + 8 * config.ECCENTRICITY_PHASE)
    ovality = load_real(prm + 8 * config.OVALITY)
    second = load_real(prm + 8 * config.OVALITY_PHASE)
    return (
        eccentric.wound_length(length, gear, e, phase, ovality, second),
        eccentric.lever_ratio(length, gear, e, phase, ovality, second),
    )


@internal
def committed_time_at(state: int, n: int) -> int:
    """Return the address of the time of the committed configuration."""
    return state + 8 * (kernel.state_size(n) + STATE_TIME)


@internal
def pose_at(state: int, n: int) -> int:
    """Return the address of the checksum of the pose to which the last step led."""
    return state + 8 * (kernel.state_size(n) + STATE_POSE)


@internal
def end_at(state: int, n: int, end: int) -> int:
    """Return the address of the committed displacement of an end (0, 1)."""
    return state + 8 * (kernel.state_size(n) + STATE_ENDS + end)


@internal
def velocity_at(state: int, n: int, part: int) -> int:
    """Return the address of the committed velocity of an end (0, 1) or the path (2)."""
    return state + 8 * (kernel.state_size(n) + STATE_VELOCITIES + part)


@internal
def path_memory(state: int, n: int) -> npt.NDArray[np.float64]:
    """Return the memory of the path in a committed state of an open cable."""
    begin = state + 8 * (kernel.state_size(n) + STATE_PATH)
    return floats(begin, open_path.memory_size(n))
