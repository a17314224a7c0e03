"""Observer of a planning controller: cables, rotor and motion when they were measured.

The torque that explains the measured motion of the rotor reveals the delay: there is an
observer of the rotor for every possible delay, and the one with the least error is
used. D. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE
Trans. Automatic Control 10, 1965. Friction and the bias of the torque sensor are
learned from the torque on the rotor that the model lacks.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import (
    CONSTANT_COULOMB,
    scalars,
    segment_angles,
    slips,
    tensions,
)
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as at
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._planner_memory import (
    PlannerMemory,
    PlannerWorkspace,
    Tables,
    copy_states,
)
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_FRICTION_FACTOR_BOUNDS = 0.2, 3.0
"""Bounds of the factor of friction."""
_MAX_FRICTION_ERROR = 0.3
"""Relative error of friction up to which a bias may be estimated."""
_MODEL_MEMORY = 0.3
"""Time over which the errors of both models are compared [s]."""
_BRISTLE, _COULOMB = law.INDEX["bristle_length"], law.INDEX["friction"]


@internal
def replace_by_mean_torque(
    memory: FloatArray, applied: FloatArray, tune: FloatArray
) -> None:
    """Replace the newest command in `applied` by the resulting mean torque."""
    command, lag, dt = applied[applied.size - 1], tune[at.LAG], tune[at.PERIOD]
    behind = memory[at.MOTOR_TORQUE] - command
    memory[at.COMMAND] = memory[at.MOTOR_TORQUE] = command
    if lag > 0.0:
        passed = -np.expm1(-dt / lag)
        applied[applied.size - 1] += behind * (passed * lag / dt)
        memory[at.MOTOR_TORQUE] += behind * (1.0 - passed)


@compiled
def smooth(
    memory: FloatArray, first: int, seen: float, a: float, b: float, c: float
) -> None:
    """Correct value, rate and acceleration (per step) by the reading one step later."""
    memory[first] += memory[first + 1] + 0.5 * memory[first + 2]
    memory[first + 1] += memory[first + 2]
    off = seen - memory[first]
    memory[first] += a * off
    memory[first + 1] += b * off
    memory[first + 2] += 2.0 * c * off


@internal
def _reset(
    cables: stepper.Cables,
    state: FloatMatrix,
    device: PlannerMemory,
    seen: FloatArray,
    late: float,
) -> None:
    """Reset the memory, with motor and joint at rest at their measured angles.

    The guard is reset before.
    """
    memory, rotors = device.memory, device.rotors
    memory[: at.GUARD] = 0.0
    memory[at.FRICTION :] = 0.0
    memory[at.JOINT], memory[at.DESIRED_TORQUE], memory[at.BELIEVED_DELAY] = (
        seen[guard.JOINT],
        seen[guard.DESIRED],
        late,
    )
    rotors[:] = 0.0
    for row in range(rotors.shape[0]):
        rotors[row, at.ANGLE] = seen[guard.MOTOR]
    memory[at.LOAD] = stepper.torque(cables, state, False, seen[guard.MOTOR])[0]
    for hypothesis in range(2):
        memory[at.MODEL_LOAD + hypothesis] = memory[at.LOAD]
        memory[at.MODEL_ROTOR + hypothesis * at.OBSERVER_SIZE + at.ANGLE] = seen[
            guard.MOTOR
        ]
    copy_states(state, device.other)
    memory[at.STARTED] = 1.0


@compiled
def observe(
    cables: stepper.Cables,
    state: FloatMatrix,
    joint: FloatArray,
    device: PlannerMemory,
    seen: FloatArray,
    tables: Tables,
    scratch: PlannerWorkspace,
) -> float:
    """Advance cables, rotor and motion to the measurements; return the joint [rad].

    The angle is that of the model in use for plans, whose bristles the cables then
    have.
    """
    memory, tune = device.memory, tables.tune
    if memory[at.STARTED] == 0.0:
        _reset(cables, state, device, seen, tune[at.LATE_FIRST])
        memory[at.OTHER_JOINT] = joint[0]
    torque = seen[guard.TORQUE] - memory[at.BIAS]
    before = memory[at.JOINT]
    smooth(
        memory,
        at.JOINT,
        seen[guard.JOINT],
        tune[at.MOTION_0],
        tune[at.MOTION_1],
        tune[at.MOTION_2],
    )
    smooth(
        memory,
        at.DESIRED_TORQUE,
        seen[guard.DESIRED],
        tune[at.MOTION_0],
        tune[at.MOTION_1],
        tune[at.MOTION_2],
    )
    turned = memory[at.JOINT] - before
    memory[at.ENERGY] += (torque - memory[at.DESIRED_TORQUE]) * memory[at.JOINT + 1]
    memory[at.ENERGY] -= tune[at.LEAK] * memory[at.ENERGY]
    # Low-passed by a quarter per step, to distinguish taut from slack.
    memory[at.FILTERED_TORQUE] += 0.25 * (torque - memory[at.FILTERED_TORQUE])
    has_second = tune[at.BRISTLES] > 0.0 and not _has_bristles(cables)
    if has_second:
        set_bristles(cables, tune[at.BRISTLES])
        memory[at.OTHER_JOINT] = _follow(
            cables, device.other, memory[at.OTHER_JOINT] + turned, memory, 1,
            seen[guard.MOTOR], torque, tune, scratch,
        )  # fmt: skip
        _explain_rotor(cables, device.other, device, 1, seen[guard.MOTOR], tables)
        set_bristles(cables, 0.0)
    joint[0] = _follow(
        cables,
        state,
        joint[0] + turned,
        memory,
        0,
        seen[guard.MOTOR],
        torque,
        tune,
        scratch,
    )
    bristled = False
    if has_second:
        _explain_rotor(cables, state, device, 0, seen[guard.MOTOR], tables)
        bristled = _choose_model(memory, tune)
        load = memory[at.MODEL_LOAD + (1 if bristled else 0)]
    else:
        memory[at.BRISTLED] = 0.0
        load = stepper.torque(cables, state, False, seen[guard.MOTOR])[0]
    if bristled:
        set_bristles(cables, tune[at.BRISTLES])
    mean_load = 0.5 * (load + memory[at.LOAD])
    memory[at.LOAD] = load
    _observe_rotor(device, seen[guard.MOTOR], mean_load, tables)
    return float(memory[at.OTHER_JOINT] if bristled else joint[0])


@internal
def _has_bristles(cables: stepper.Cables) -> bool:
    for k in range(cables.n.size):
        if cables.prm[k, _BRISTLE] != 0.0:
            return True
    return False


@compiled
def set_bristles(cables: stepper.Cables, bristles: float) -> None:
    """Give all cables bristles of a length, as a motion of the joint [rad]."""
    for k in range(cables.n.size):
        prm = cables.prm[k]
        prm[_BRISTLE] = bristles * abs(cables.distal[k])
        prm[CONSTANT_COULOMB] = 1.0 if law.is_constant_coulomb(scalars(prm)) else 0.0


@internal
def _explain_rotor(
    cables: stepper.Cables,
    state: FloatMatrix,
    device: PlannerMemory,
    hypothesis: int,
    motor: float,
    tables: Tables,
) -> None:
    """Update the torque on the rotor that a model of the cables does not explain.

    `hypothesis` as in `_follow`; `motor` is the measured angle [rad].
    """
    memory, applied, tune = device.memory, device.applied, tables.tune
    load = stepper.torque(cables, state, False, motor)[0]
    mean_load = 0.5 * (load + memory[at.MODEL_LOAD + hypothesis])
    memory[at.MODEL_LOAD + hypothesis] = load
    believed = int(memory[at.BELIEVED_DELAY])
    first = at.MODEL_ROTOR + hypothesis * at.OBSERVER_SIZE
    rotor = memory[first : first + at.OBSERVER_SIZE]
    force = applied[applied.size - 1 - believed] - mean_load
    _update_observer(rotor, motor, force, tables.unexplained[believed], tune)
    error = memory[at.ROTOR_ERROR + hypothesis]
    off = rotor[at.DISTURBANCE]
    memory[at.ROTOR_ERROR + hypothesis] += (
        tune[at.PERIOD] / _MODEL_MEMORY * (off * off - error)
    )


@internal
def _choose_model(memory: FloatArray, tune: FloatArray) -> bool:
    """Return whether to plan with the model with bristles.

    The variances of the errors at joint and rotor are unknown, so the likelihood of a
    model falls with the product of both mean squares. A model is replaced only by a
    margin, and by more than noise.
    """
    # Mean squared errors below 1 % of the squared significant torque do not count.
    floor = 0.01 * tune[at.NOISE] * tune[at.NOISE]
    at_rotor = floor / (tune[at.RATIO] * tune[at.RATIO])
    plain = (memory[at.MODEL_ERROR] + floor) * (memory[at.ROTOR_ERROR] + at_rotor)
    other = (memory[at.MODEL_ERROR + 1] + floor) * (
        memory[at.ROTOR_ERROR + 1] + at_rotor
    )
    if memory[at.BRISTLED] != 0.0:
        bristled = other <= plain
    else:
        bristled = other < 0.1 * plain  # a more complex model needs a clear lead
    memory[at.BRISTLED] = 1.0 if bristled else 0.0
    return bool(bristled)


@internal
def _follow(
    cables: stepper.Cables,
    state: FloatMatrix,
    joint: float,
    memory: FloatArray,
    hypothesis: int,
    motor: float,
    torque: float,
    tune: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Advance the cables of a model to the measurements; return its joint [rad].

    `joint` is the angle of the joint after the step [rad], `hypothesis` is 1 for the
    model with bristles, else 0; angle [rad] and torque, without its bias [N m], are
    measured. The memory gets the error of the torque.
    """
    new = scratch.new
    stepper.move(cables, state, motor, joint, tune[at.PERIOD], new, scratch.work)
    made, size = stepper.torque(cables, new, True, motor)
    taut = size > 0.0
    if cables.n.size == 1:
        # By the bias of its sensor a cable would be paid out without end.
        taut = abs(made) > tune[at.NOISE]
    if taut or abs(memory[at.FILTERED_TORQUE]) > tune[at.NOISE]:
        error = memory[at.MODEL_ERROR + hypothesis]
        off = torque - made
        share = tune[at.PERIOD] / _MODEL_MEMORY
        memory[at.MODEL_ERROR + hypothesis] += share * (off * off - error)
        # The motion of the cables is known better than the last bit of a sensor.
        made += tune[at.BELIEF] * off
        if cables.n.size == 1 and made * cables.distal[0] > 0.0:
            made = 0.0  # noise may push, a cable cannot
        to = rollout.find_joint_angle(
            cables, state, motor, joint, made, tune[at.STIFFNESS],
            0.02 * tune[at.NOISE],  # tolerance, far inside the noise [N m]
            tune[at.PERIOD], new, scratch.work,
        )  # fmt: skip
        if cables.n.size == 1:
            side = np.sign(cables.distal[0])
            shift = _shift(
                memory, hypothesis, side * (to - joint), -side * torque, -side, scratch,
                tune,
            )  # fmt: skip
            if shift < side * (to - joint):
                to = joint + side * shift
                stepper.move(
                    cables, state, motor, to, tune[at.PERIOD], new, scratch.work
                )
        joint = to
    copy_states(new, state)
    return joint


@internal
def _observe_rotor(
    device: PlannerMemory, motor: float, mean_load: float, tables: Tables
) -> None:
    """Advance the observers of the rotor and choose the delay that explains it best."""
    memory, rotors, applied = device.memory, device.rotors, device.applied
    tune = tables.tune
    believed = int(memory[at.BELIEVED_DELAY])
    gain = tables.unexplained[believed]  # the same for all, or the quickest would win
    best = 0
    for d in range(rotors.shape[0]):
        _update_observer(
            rotors[d], motor, applied[applied.size - 1 - d] - mean_load, gain, tune
        )
        if rotors[d, at.OBSERVER_ERROR] < rotors[best, at.OBSERVER_ERROR]:
            best = d
    # The best replaces the observer in use below 0.7 of its mean squared error, and by
    # more than (2e-4 rad)^2: an encoder of 14 bits rounds by half of that angle.
    if (
        rotors[best, at.OBSERVER_ERROR] + 2e-4**2
        < 0.7 * rotors[believed, at.OBSERVER_ERROR]
    ):
        believed = best
    memory[at.BELIEVED_DELAY] = believed
    memory[at.ANGLE], memory[at.VELOCITY] = (
        rotors[believed, at.ANGLE],
        rotors[believed, at.VELOCITY],
    )
    memory[at.DISTURBANCE] = rotors[believed, at.DISTURBANCE]


@internal
def _shift(
    memory: FloatArray,
    hypothesis: int,
    wanted: float,
    pull: float,
    way: float,
    scratch: PlannerWorkspace,
    tune: FloatArray,
) -> float:
    """Return the shift of the joint of a single cable's model [rad].

    Drag maintains a pull that no paying out ends. A model without that drag would be
    shifted for as long, and its motor would pay out cable without an end. So while the
    cable pulls more than desired, the shift is at most the stretch by that pull and the
    angle that the motor takes up in half of the horizon.

    `wanted` is the shift by the torque sensor, above 0 where the cable is to pull more
    [rad], `pull` the measured torque in the direction in which the cable pulls [N m],
    `way` the sign of such a torque; `hypothesis` as in `_follow`.
    """
    shift = memory[at.JOINT_SHIFT + 2 * hypothesis] + wanted
    if pull > max(way * memory[at.DESIRED_TORQUE], 0.0) + tune[at.NOISE]:
        half = 0.5 * tune[at.SPAN] * scratch.path.size
        quick = max(abs(tune[at.LOW]), abs(tune[at.HIGH])) / tune[at.INERTIA]
        reach = 0.25 * quick * half * half / abs(tune[at.RATIO])
        most = (
            memory[at.TAUT_SHIFT + 2 * hypothesis] + pull / tune[at.STIFFNESS] + reach
        )
        shift = min(shift, max(most, memory[at.JOINT_SHIFT + 2 * hypothesis]))
    elif pull > tune[at.NOISE]:
        memory[at.TAUT_SHIFT + 2 * hypothesis] = shift
    wanted = shift - memory[at.JOINT_SHIFT + 2 * hypothesis]
    memory[at.JOINT_SHIFT + 2 * hypothesis] = shift
    return float(wanted)


@compiled
def _update_observer(
    rotor: FloatArray, seen: float, force: float, unexplained: float, tune: FloatArray
) -> None:
    """Advance an observer of the rotor by one step, with the measured angle."""
    dt, inertia = tune[at.PERIOD], tune[at.INERTIA]
    force += rotor[at.DISTURBANCE] - tune[at.DAMPING] * rotor[at.VELOCITY]
    gained = dt * force / inertia
    rotor[at.ANGLE] += dt * (rotor[at.VELOCITY] + 0.5 * gained)
    rotor[at.VELOCITY] += gained
    off = seen - rotor[at.ANGLE]
    rotor[at.ANGLE] += tune[at.ROTOR_0] * off
    rotor[at.VELOCITY] += tune[at.ROTOR_1] / dt * off
    rotor[at.DISTURBANCE] += 2.0 * unexplained / dt**2 * inertia * off
    rotor[at.OBSERVER_ERROR] += tune[at.FORGETTING] * (
        off * off - rotor[at.OBSERVER_ERROR]
    )


@compiled
def learn(
    cables: stepper.Cables, state: FloatMatrix, memory: FloatArray, tune: FloatArray
) -> None:
    """Adapt friction and bias to the torque on the rotor that the model lacks.

    While all segments slip, the load grows with the logarithm of friction by r T mu phi
    of every cable, with the tension T at the motor, whose sign is that of the slip; and
    by the bias of the torque sensor, over the ratio, whatever the slip. Friction takes
    the step of a normalised gradient, the bias its share by the two variances.
    """
    sensitivity = 0.0
    for k in range(cables.n.size):
        n = cables.n[k]
        slip = slips(state[k], n)
        sign = np.sign(slip[0])
        for j in range(n):
            if slip[j] * sign <= 0.0:
                return
        sensitivity += _load_slope(cables, k, state[k], sign) ** 2
    unexplained = min(
        max(memory[at.DISTURBANCE], -tune[at.MIN_FRICTION_TORQUE]),
        tune[at.MIN_FRICTION_TORQUE],
    )
    biased = (tune[at.NOISE] / tune[at.RATIO]) ** 2
    share = biased / (
        biased + (_MAX_FRICTION_ERROR * _MAX_FRICTION_ERROR) * sensitivity
    )
    step = tune[at.ZEROING] * tune[at.PERIOD] * share * unexplained * tune[at.RATIO]
    # The torque sensor's bias is at most twice its significant torque.
    most = 2.0 * tune[at.NOISE]
    memory[at.BIAS] = min(max(memory[at.BIAS] + step, -most), most)
    rate = (
        tune[at.LEARNING]
        * tune[at.PERIOD]
        * unexplained
        / (tune[at.MIN_FRICTION_TORQUE] ** 2 + sensitivity)
    )
    low, high = np.log(_FRICTION_FACTOR_BOUNDS[0]), np.log(_FRICTION_FACTOR_BOUNDS[1])
    for k in range(cables.n.size):
        sign = np.sign(slips(state[k], cables.n[k])[0])
        factor = memory[at.FRICTION + k] - rate * _load_slope(cables, k, state[k], sign)
        memory[at.FRICTION + k] = min(max(factor, low), high)


@internal
def _load_slope(
    cables: stepper.Cables, k: int, state: FloatArray, sign: float
) -> float:
    """Return the derivative of the motor's load by the logarithm of friction [N m]."""
    n, wrap = cables.n[k], 0.0
    angles = segment_angles(cables.prm[k], n)
    for j in range(n):
        wrap += angles[j]
    pull = cables.proximal[k] * sign * max(tensions(state, n)[0], 0.0)
    return float(pull * (cables.prm[k, _COULOMB] * wrap))


@compiled
def friction_factors(memory: FloatArray, factor: FloatArray) -> None:
    """Compute the factor on the friction of every cable (cables,)."""
    for k in range(factor.size):
        factor[k] = np.exp(memory[at.FRICTION + k])
