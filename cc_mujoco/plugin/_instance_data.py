"""The block of memory that `plugin_data` holds for an instance, compiled.

It is made when MuJoCo initialises a simulation and freed with it.
"""

import ctypes
from typing import Annotated, Any

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin._ffi import MjData, MjModel, floats, internal, memory
from cc_mujoco.plugin._path import OpenPath

Pair = tuple[float, float]
"""Two numbers: of the proximal and the distal end, or displacement and lever of one."""
_INT, _REAL = ctypes.c_int64, ctypes.c_double


class _Block(ctypes.Structure):
    """Head of an instance's memory; in pairs the proximal end comes first."""

    _fields_ = (
        ("segments", _INT),
        ("outputs", _INT * 2),  # indices of its actuators in `actuator_force`
        ("tied", _INT * 2),  # 1 for an end tied to a site of an open cable's tendon
        ("text_size", _INT),  # bytes of `text`
        ("result_valid", _INT),  # 1 if `new_state` is the result of `inputs`
        ("route", _INT),  # index of the tendon that bends or guides the cable, or -1
        ("bends_with_route", _INT),  # 1 if that bends the conduit
        ("guided", _INT),  # number of segments in the conduit
        ("mouth", _INT),  # place of the conduit's mouth in the tendon's path, 0: none
        ("reference_known", _INT),  # 1 if the path in the pose `qpos0` is measured
        ("passive_fresh", _INT),  # 1 if the cable's pull is not in `qfrc_passive` yet
        ("shape_bytes", _INT),  # bytes of the path at one stage, see `shape_at`
        ("checked_timestep", _REAL),  # time step at the last check of limits [s]
        ("instance", _INT),
        ("content", _INT),  # digest of the model that it was made for
        ("dofs", _INT),
        ("actuators", _INT * 2),
        ("inputs", _REAL * 5),  # displacements and yielding of the ends, time step
        ("input_positions", _REAL * 2),  # displacements for which `inputs` were found
        ("input_velocities", _REAL * 2),
        ("explicit_ends", _INT),  # 1 if its ends are never implicit
        ("scratch", _REAL * 6),  # a force, and no torque
        ("stiffness", _REAL * 2),  # stiffness of the ends, 0 if not computed [N/m]
        ("path_evaluation", _INT),  # evaluation in which its path was measured, or 0
        ("evaluation_count", _INT),  # in a model's first cable
        ("position", _REAL),  # in a model's first cable: checksum of `qpos`
        ("position_size", _REAL),  # scale of that checksum
        ("early_pull", _INT),  # result of `_pull_early`: 0, or `EARLY_KEPT` and so on
        ("position_changed", _INT),  # 1 if `qpos` was set since the last step
        ("checked_stiffness", _REAL),  # stiffest piece at the last check of limits
        ("stages", _REAL * 8 * 4),  # ends, time and `inputs` of four stages of RK4
        ("first_stage_valid", _INT),
        # Offsets of the parts behind this head [bytes].
        ("parameters", _INT),  # packed parameters
        ("work", _INT),  # scratch of the kernel
        ("old_state", _INT),  # state before the last evaluation
        ("new_state", _INT),  # state after it
        ("text", _INT),  # text of the configuration that was packed last
        ("guides", _INT),  # guides of an open cable, see `read_guides` (n,)
        ("shapes", _INT),  # paths at all stages, see `shape_at`
        ("pulls", _INT),  # last forces of an open cable in `qfrc_passive` (nv,)
        ("forces", _INT),  # scratch for forces (nv,) or lengths of nodes (n + 1,)
        ("passive_before", _INT),  # `qfrc_passive` without its forces (nv,)
        # State after the first stage of the last step of RK4, as a committed one, with
        # the checksum `pose` of the state that it began from.
        ("first_stage", _INT),
        # In a model's first cable, else 0: for `_implicit_ends.py`, `save_poses`.
        ("known_step", _INT),
        ("prediction", _INT),
        ("mocap_poses", _INT),
        # The model that it was made for, see `fits`, and the kind of path.
        ("state_address", _INT),
        ("state_size", _INT),
        ("mocaps", _INT),
        ("lead", _INT),
        ("path_kind", _INT),
        ("other_kind", _INT),  # 1 if the configuration has another kind or segments
        ("route_digest", _INT),  # digest of the places of `route` when it was packed
        ("evaluated_model", _INT),  # model of the evaluation since the last step, or 0
    )


class Commitment(ctypes.Structure):
    """Part of a committed state that follows the state of the kernel.

    For an implicit end the kernel's state has the predicted displacement, and `ends`
    the true one. The memory of an open cable's path comes next.
    """

    _fields_ = (
        ("time", _REAL),  # time of the state under RK4 [s]
        ("pose", _REAL),  # checksum of `qpos` after the last step
        ("ends", _REAL * 2),  # displacements of the ends [m]
        ("velocities", _REAL * 3),  # velocities of the ends and of the path [m/s]
    )


Block = Annotated[Any, memory(_Block)]
Committed = Annotated[Any, memory(Commitment)]
BLOCK_WORDS, COMMITMENT_SIZE = ctypes.sizeof(_Block) // 8, ctypes.sizeof(Commitment)
TEXT_CAPACITY = 4096
MAX_DOFS = 300
"""Most degrees of freedom of a model with implicit ends, as its factors are dense."""
EARLY_KEPT, EARLY_REPLACED = 1, 2
"""Values of `early_pull` if the later evaluation of actuators keeps or replaces it."""
REFERENCE_STAGE = 5
"""Stage of the pose `qpos0`, see `shape_at`."""


@internal
def save_sizes(block: Block, model: MjModel, instance: int) -> None:
    _, block.actuators[0], block.actuators[1] = attachments.find_actuators(
        model, instance
    )
    for end in range(2):
        block.outputs[end] = model.actuator_outadr[block.actuators[end]]
    block.instance = instance
    block.dofs = model.nv
    block.mocaps = model.nmocap
    block.lead = ffi.first_cable(model, instance)
    block.state_address = model.plugin_stateadr[instance]
    block.state_size = model.plugin_statenum[instance]


@internal
def fits(block: Block, model: MjModel, instance: int) -> bool:
    """Return whether a block was made for a model of these sizes and this order."""
    for end in range(2):
        actuator = block.actuators[end]
        if (
            actuator >= model.nactuator
            or model.actuator_plugin[actuator] != instance
            or model.actuator_outadr[actuator] != block.outputs[end]
        ):
            return False
    return bool(
        block.state_address == model.plugin_stateadr[instance]
        and block.state_size == model.plugin_statenum[instance]
        and block.dofs == model.nv
        and block.mocaps == model.nmocap
        and block.lead == ffi.first_cable(model, instance)
    )


@internal
def block_of_memory(address: int) -> Block:
    return address


@internal
def block_at(data: MjData, instance: int) -> Block:
    return data.plugin_data[instance]


@internal
def own_block(model: MjModel, data: MjData, instance: int) -> Block:
    """Return an instance's block or 0; it may be that of another model, see `fits`."""
    if instance >= data.nplugin or data.plugin[instance] != model.plugin[instance]:
        return 0
    return block_at(data, instance)


@internal
def block_of(model: MjModel, data: MjData, instance: int) -> Block:
    """Return an instance's block, or 0 if `data` has none that fits the model."""
    block = own_block(model, data, instance)
    return block if block != 0 and fits(block, model, instance) else 0


@internal
def acting_block(model: MjModel, data: MjData, instance: int) -> Block:
    """Return the block of an instance, or 0 if the cable cannot act.

    It can if the time step is valid and the block of the model's first cable, which
    holds what all cables share, fits the model too.
    """
    if not ffi.has_timestep(model):
        return 0
    lead = ffi.first_cable(model, instance)
    block = block_of(model, data, instance)
    if block != 0 and lead != instance and block_of(model, data, lead) == 0:
        return 0
    return block


@internal
def lay_out(block: Block, model: MjModel, first: bool) -> int:
    """Set the offsets of the parts of a block by its sizes; return its size [bytes].

    `first` is true for the first cable of a model, which holds what all cables share.
    """
    n, state = block.segments, 8 * kernel.state_size(block.segments)
    free = block.path_kind > 0
    forces = 8 * model.nv if free else 0
    block.parameters = 8 * BLOCK_WORDS
    block.work = block.parameters + 8 * kernel.parameter_size(n)
    block.old_state = block.work + 8 * kernel.work_size(n)
    block.new_state = block.old_state + state
    block.text = block.new_state + state
    block.guides = block.text + TEXT_CAPACITY
    block.shape_bytes = 8 * (open_path.shape_size(n) if free else n)
    block.shapes = block.guides + 8 * n
    block.pulls = block.shapes + (REFERENCE_STAGE + 1) * block.shape_bytes
    block.forces = block.pulls + forces
    block.passive_before = block.forces + (forces + 8 * (n + 1) if free else 0)
    block.first_stage = block.passive_before + forces
    end = block.first_stage + state + COMMITMENT_SIZE
    end += 8 * open_path.memory_size(n) if free else 0
    if first and model.nv <= MAX_DOFS:
        block.prediction = end
        end += 8 * (5 * model.nv + 3 * model.nv * model.nv)
    if first and model.nmocap > 0:
        block.mocap_poses = end
        end += 2 * 7 * 8 * model.nmocap
    return int(end)


@internal
def parameters(block: Block) -> FloatArray:
    return floats(block + block.parameters, kernel.parameter_size(block.segments))


@internal
def kernel_state(state: int, n: int) -> FloatArray:
    return floats(state, kernel.state_size(n))


@internal
def shape_at(block: Block, stage: int) -> int:
    """Return the address of the path at a stage.

    Stage 0 is the present position, 1 to 4 are the stages of RK4, and `REFERENCE_STAGE`
    is `qpos0`. A path has the wrap angles of the segments [rad] or, for an open cable,
    the result of `measure_path`.
    """
    return int(block + block.shapes + block.shape_bytes * stage)


@internal
def shape(block: Block, stage: int) -> FloatArray:
    return floats(shape_at(block, stage), block.shape_bytes // 8)


@internal
def node_scratch(block: Block) -> FloatArray:
    return floats(block + block.forces, block.segments + 1)


@internal
def path_of(block: Block, stage: int) -> OpenPath:
    n = block.segments
    guides = floats(block + block.guides, n)
    return OpenPath(
        block.route, block.mouth, block.guided, n, guides, shape(block, stage)
    )


@internal
def invalidate(block: Block) -> None:
    block.result_valid = 0
    block.stiffness[:] = 0.0


@internal
def is_open(block: Block) -> bool:
    return bool(block.guided < block.segments)


@internal
def displacement(data: MjData, block: Block, end: int) -> float:
    if block.tied[end] != 0:
        return 0.0
    return float(data.actuator_length[block.outputs[end]])


@internal
def rest_displacement(model: MjModel, block: Block, end: int) -> float:
    if block.tied[end] != 0:
        return 0.0
    return float(model.actuator_length0[block.outputs[end]])


@internal
def proximal_winding(model: MjModel, block: Block, length: float) -> Pair:
    """Return displacement [m] and lever ratio of the proximal end at a `length` [m]."""
    prm, gear = parameters(block), attachments.pulley_radius(model, block.outputs[0])
    return (
        eccentric.wound_length(prm, length, gear),
        eccentric.lever_ratio(prm, length, gear),
    )


@internal
def winding(model: MjModel, data: MjData, block: Block) -> Pair:
    return proximal_winding(model, block, displacement(data, block, 0))


@internal
def committed(state: int, n: int) -> Committed:
    return state + 8 * kernel.state_size(n)


@internal
def path_memory(state: int, n: int) -> FloatArray:
    begin = state + 8 * kernel.state_size(n) + COMMITMENT_SIZE
    return floats(begin, open_path.memory_size(n))
