"""Observer of a planning controller: cables, rotor and motion when they were measured.

There is an observer of the rotor for every possible delay of the measurements. The one
that best predicts the measured angle of the rotor is used (D. Magill, "Optimal adaptive
estimation of sampled stochastic processes", IEEE Trans. Automatic Control 10, 1965).
Friction and the bias of the torque sensor are learned from the torque on the rotor that
the model does not explain.
"""

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _root as root
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as at
from cc_mujoco.control._planner_memory import Planner
from cc_mujoco.control._rollout import MAX_EVALUATIONS
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_MODEL_MEMORY = 0.3  # time over which the errors of both models are compared [s]


@internal
def replace_by_mean_torque(planner: Planner) -> None:
    """Step the motor's lag; its mean torque replaces the command last in `applied`."""
    memory, applied, tune = planner.memory, planner.applied, planner.tune
    command, lag, dt = applied[applied.size - 1], tune[at.LAG], tune[at.PERIOD]
    behind = memory[at.MOTOR_TORQUE] - command
    memory[at.COMMAND] = memory[at.MOTOR_TORQUE] = command
    if lag > 0.0:
        passed = -np.expm1(-dt / lag)
        applied[applied.size - 1] += behind * (passed * lag / dt)
        memory[at.MOTOR_TORQUE] += behind * (1.0 - passed)


@internal
def _smooth(memory: FloatArray, first: int, seen: float, tune: FloatArray) -> None:
    """Update a value and its two differences, at `first` and behind, by a reading."""
    memory[first] += memory[first + 1] + 0.5 * memory[first + 2]
    memory[first + 1] += memory[first + 2]
    off = seen - memory[first]
    memory[first] += tune[at.MOTION_0] * off
    memory[first + 1] += tune[at.MOTION_1] * off
    memory[first + 2] += 2.0 * tune[at.MOTION_2] * off


@internal
def _reset(planner: Planner, seen: FloatArray) -> None:
    """Reset the memory except the guard, at rest at the measured angles `seen`."""
    memory, motor = planner.memory, seen[guard.MOTOR]
    memory[: at.GUARD] = 0.0
    memory[at.FRICTION :] = 0.0
    memory[at.JOINT], memory[at.DESIRED_TORQUE] = seen[guard.JOINT], seen[guard.DESIRED]
    memory[at.BELIEVED_DELAY] = planner.tune[at.LATE_FIRST]
    planner.rotors[:] = 0.0
    for row in range(planner.rotors.shape[0]):
        planner.rotors[row, at.ANGLE] = motor
    memory[at.LOAD] = stepper.torque(planner.cables, planner.state, False, motor)[0]
    for hypothesis in range(2):
        memory[at.MODEL_LOAD + hypothesis] = memory[at.LOAD]
        memory[at.MODEL_ROTOR + hypothesis * at.OBSERVER_SIZE + at.ANGLE] = motor
    planner.other[:] = planner.state
    memory[at.STARTED], memory[at.OTHER_JOINT] = 1.0, planner.joint[0]


@internal
def observe(planner: Planner, seen: FloatArray) -> float:
    """Advance cables, rotor and motion to the measurements; return the joint [rad].

    The angle is that of the model, with or without bristles, that plans use. The cables
    keep that model's bristles.
    """
    cables, memory, tune = planner.cables, planner.memory, planner.tune
    if memory[at.STARTED] == 0.0:
        _reset(planner, seen)
    motor, torque = seen[guard.MOTOR], seen[guard.TORQUE] - memory[at.BIAS]
    before = memory[at.JOINT]
    _smooth(memory, at.JOINT, seen[guard.JOINT], tune)
    _smooth(memory, at.DESIRED_TORQUE, seen[guard.DESIRED], tune)
    turned = memory[at.JOINT] - before
    memory[at.ENERGY] += (torque - memory[at.DESIRED_TORQUE]) * memory[at.JOINT + 1]
    memory[at.ENERGY] -= tune[at.LEAK] * memory[at.ENERGY]
    # Low-passed by a quarter per step, to distinguish taut from slack.
    memory[at.FILTERED_TORQUE] += 0.25 * (torque - memory[at.FILTERED_TORQUE])
    has_second = tune[at.BRISTLES] > 0.0
    for k in range(cables.n.size):
        has_second = has_second and cables.prm[k, PLACE.bristle_length] == 0.0
    if has_second:
        set_bristles(cables, tune[at.BRISTLES])
        joint = memory[at.OTHER_JOINT] + turned
        memory[at.OTHER_JOINT] = _follow(planner, 1, joint, motor, torque)
        _explain_rotor(planner, 1, motor)
        set_bristles(cables, 0.0)
    planner.joint[0] = _follow(planner, 0, planner.joint[0] + turned, motor, torque)
    bristled = False
    if has_second:
        _explain_rotor(planner, 0, motor)
        bristled = _choose_model(memory, tune)
        load = memory[at.MODEL_LOAD + (1 if bristled else 0)]
    else:
        memory[at.BRISTLED] = 0.0
        load = stepper.torque(cables, planner.state, False, motor)[0]
    if bristled:
        set_bristles(cables, tune[at.BRISTLES])
    mean_load = 0.5 * (load + memory[at.LOAD])
    memory[at.LOAD] = load
    _observe_rotor(planner, motor, mean_load)
    return float(memory[at.OTHER_JOINT] if bristled else planner.joint[0])


@internal
def set_bristles(cables: stepper.Cables, bristles: float) -> None:
    """Set the bristle length of all cables, given as a joint motion [rad]; 0: none."""
    for k in range(cables.n.size):
        prm = cables.prm[k]
        prm[PLACE.bristle_length] = bristles * abs(cables.distal[k])
        prm[layout.CONSTANT_COULOMB] = (
            1.0 if law.is_constant_coulomb(layout.scalars(prm)) else 0.0
        )


@internal
def _explain_rotor(planner: Planner, hypothesis: int, motor: float) -> None:
    """Update the torque on the rotor that a model of the cables does not explain.

    `hypothesis` is 1 of that with bristles, else 0; `motor` is measured [rad].
    """
    memory, applied, tune = planner.memory, planner.applied, planner.tune
    state = planner.other if hypothesis == 1 else planner.state
    load = stepper.torque(planner.cables, state, False, motor)[0]
    mean_load = 0.5 * (load + memory[at.MODEL_LOAD + hypothesis])
    memory[at.MODEL_LOAD + hypothesis] = load
    believed = int(memory[at.BELIEVED_DELAY])
    first = at.MODEL_ROTOR + hypothesis * at.OBSERVER_SIZE
    rotor = memory[first : first + at.OBSERVER_SIZE]
    force = applied[applied.size - 1 - believed] - mean_load
    _update_observer(rotor, motor, force, planner.tables.unexplained[believed], tune)
    off, error = rotor[at.DISTURBANCE], memory[at.ROTOR_ERROR + hypothesis]
    share = tune[at.PERIOD] / _MODEL_MEMORY
    memory[at.ROTOR_ERROR + hypothesis] += share * (off * off - error)


@internal
def _choose_model(memory: FloatArray, tune: FloatArray) -> bool:
    """Return whether plans shall use the model with bristles.

    The variances of the errors at joint and rotor are unknown, so a model is the less
    likely, the larger the product of both mean squared errors. The other model replaces
    it only if its product is smaller by a margin and by more than noise.
    """
    # Mean squared errors below 1 % of the squared significant torque do not count.
    floor = 0.01 * tune[at.NOISE] * tune[at.NOISE]
    at_rotor = floor / (tune[at.RATIO] * tune[at.RATIO])
    plain = (memory[at.MODEL_ERROR] + floor) * (memory[at.ROTOR_ERROR] + at_rotor)
    other = memory[at.MODEL_ERROR + 1] + floor
    other *= memory[at.ROTOR_ERROR + 1] + at_rotor
    if memory[at.BRISTLED] != 0.0:
        bristled = other <= plain
    else:
        bristled = other < 0.1 * plain  # a more complex model needs a clear lead
    memory[at.BRISTLED] = 1.0 if bristled else 0.0
    return bool(bristled)


@internal
def _follow(
    planner: Planner, hypothesis: int, joint: float, motor: float, torque: float
) -> float:
    """Advance the cables of a model to the measurements; return its joint [rad].

    `joint` is the angle of the joint after the step without correction [rad],
    `hypothesis` 1 of that with bristles, else 0; `motor` [rad] and `torque`, without
    its bias [N m], are measured. The error of the predicted torque is stored.
    """
    cables, memory, tune = planner.cables, planner.memory, planner.tune
    state, new = planner.other if hypothesis == 1 else planner.state, planner.new
    dt = tune[at.PERIOD]
    stepper.move(cables, state, motor, joint, dt, new, planner.work)
    made, size = stepper.torque(cables, new, True, motor)
    taut = size > 0.0
    if cables.n.size == 1:
        # By the bias of its sensor a cable would be paid out without end.
        taut = abs(made) > tune[at.NOISE]
    if taut or abs(memory[at.FILTERED_TORQUE]) > tune[at.NOISE]:
        error = memory[at.MODEL_ERROR + hypothesis]
        off, share = torque - made, dt / _MODEL_MEMORY
        memory[at.MODEL_ERROR + hypothesis] += share * (off * off - error)
        # The motion of the cables is known better than the last bit of a sensor.
        made += tune[at.BELIEF] * off
        if cables.n.size == 1 and made * cables.distal[0] > 0.0:
            made = 0.0  # noise may push, a cable cannot
        to = _find_joint_angle(planner, state, motor, joint, made)
        if cables.n.size == 1:
            side = np.sign(cables.distal[0])
            shift = _shift(planner, hypothesis, side * (to - joint), -side * torque)
            if shift < side * (to - joint):
                to = joint + side * shift
                stepper.move(cables, state, motor, to, dt, new, planner.work)
        joint = to
    state[:] = new
    return joint


@internal
def _find_joint_angle(
    planner: Planner, state: FloatMatrix, motor: float, start: float, torque: float
) -> float:
    """Find the joint angle [rad] at which the cables make a torque [N m].

    The torque falls as the joint turns: the angle is bracketed from the guess `start`
    [rad], then found by regula falsi (`root`), to a tolerance far below the noise.
    `motor` is the motor angle after the step [rad]. The states there are `new` of
    `planner`.
    """
    cables, tune, new = planner.cables, planner.tune, planner.new
    bracket, beyond, reach = root.UNKNOWN, 0.0, 0.0
    for _ in range(2 * MAX_EVALUATIONS):
        stepper.move(
            cables, state, motor, start + beyond, tune[at.PERIOD], new, planner.work
        )
        over = stepper.torque(cables, new, True, motor)[0] - torque
        if abs(over) <= 0.02 * tune[at.NOISE]:
            break
        bracket = root.narrowed(bracket, beyond, -over)
        if root.encloses(bracket):
            beyond = root.between(bracket)
        else:
            # At least a fifth of the step of a cable that stretches as a whole: its end
            # alone is stiffer.
            reach = max(2.0 * reach, 0.2 * abs(over) / tune[at.STIFFNESS])
            beyond += reach if over > 0.0 else -reach
    return start + beyond


@internal
def _observe_rotor(planner: Planner, motor: float, mean_load: float) -> None:
    """Advance the rotor's observers by a measured angle [rad]; choose the best delay.

    `mean_load` is the torque of the cables on the rotor during the step [N m].
    """
    memory, rotors, applied = planner.memory, planner.rotors, planner.applied
    believed, best, errors = int(memory[at.BELIEVED_DELAY]), 0, at.OBSERVER_ERROR
    # The gain is the same for all, or the quickest would win.
    gain = planner.tables.unexplained[believed]
    for d in range(rotors.shape[0]):
        force = applied[applied.size - 1 - d] - mean_load
        _update_observer(rotors[d], motor, force, gain, planner.tune)
        if rotors[d, errors] < rotors[best, errors]:
            best = d
    # The best replaces the observer in use below 0.7 of its mean squared error, and by
    # more than (2e-4 rad)^2: an encoder of 14 bits rounds by half of that angle.
    if rotors[best, errors] + 2e-4**2 < 0.7 * rotors[believed, errors]:
        believed = best
    memory[at.BELIEVED_DELAY] = believed
    memory[: at.DISTURBANCE + 1] = rotors[believed, : at.DISTURBANCE + 1]


@internal
def _shift(planner: Planner, hypothesis: int, wanted: float, pull: float) -> float:
    """Return the shift of the joint of a single cable's model in this step [rad].

    Drag can keep a cable pulling however much cable is paid out. A model without that
    drag would be shifted as long as it does, and its motor would pay out cable
    endlessly. So while the cable pulls more than desired, the shift grows by at most
    the stretch by that pull plus the angle that the motor can take up in half of the
    horizon.

    `wanted` is the shift that the torque sensor demands [rad], positive for more pull;
    `pull` is the measured torque in the cable's direction [N m]; `hypothesis` is 1 of
    the model with bristles, else 0.
    """
    memory, tune = planner.memory, planner.tune
    now, taut = at.JOINT_SHIFT + 2 * hypothesis, at.TAUT_SHIFT + 2 * hypothesis
    before, shift = memory[now], memory[now] + wanted
    desired = -np.sign(planner.cables.distal[0]) * memory[at.DESIRED_TORQUE]
    if pull > max(desired, 0.0) + tune[at.NOISE]:
        half = 0.5 * tune[at.SPAN] * planner.path.size
        quick = max(abs(tune[at.LOW]), abs(tune[at.HIGH])) / tune[at.INERTIA]
        reach = 0.25 * quick * half * half / abs(tune[at.RATIO])
        most = memory[taut] + pull / tune[at.STIFFNESS] + reach
        shift = min(shift, max(most, before))
    elif pull > tune[at.NOISE]:
        memory[taut] = shift
    memory[now] = shift
    return float(shift - before)


@compiled
def _update_observer(
    rotor: FloatArray, seen: float, force: float, unexplained: float, tune: FloatArray
) -> None:
    """Advance an observer of the rotor by a step.

    `seen` is the measured angle [rad], `force` the torque of motor and cables [N m],
    `unexplained` the gain of the unexplained torque.
    """
    dt, inertia = tune[at.PERIOD], tune[at.INERTIA]
    force += rotor[at.DISTURBANCE] - tune[at.DAMPING] * rotor[at.VELOCITY]
    gained = dt * force / inertia
    rotor[at.ANGLE] += dt * (rotor[at.VELOCITY] + 0.5 * gained)
    rotor[at.VELOCITY] += gained
    off = seen - rotor[at.ANGLE]
    rotor[at.ANGLE] += tune[at.ROTOR_0] * off
    rotor[at.VELOCITY] += tune[at.ROTOR_1] / dt * off
    rotor[at.DISTURBANCE] += 2.0 * unexplained / dt**2 * inertia * off
    error = rotor[at.OBSERVER_ERROR]
    rotor[at.OBSERVER_ERROR] += tune[at.FORGETTING] * (off * off - error)


@internal
def learn(planner: Planner, state: FloatMatrix) -> None:
    """Adapt friction and sensor bias to the unexplained torque on the rotor.

    While all segments slip, the motor's load changes with the logarithm of the friction
    of each cable by r T mu phi, with the tension T at the motor and the sign of the
    slip. With the bias of the torque sensor it changes by the bias over the ratio,
    whatever the slip. Friction takes a step of the normalised gradient, the bias a
    share by both variances.
    """
    cables, memory, tune = planner.cables, planner.memory, planner.tune
    sensitivity = 0.0
    for k in range(cables.n.size):
        n = cables.n[k]
        slip = layout.slips(state[k], n)
        sign = np.sign(slip[0])
        for j in range(n):
            if slip[j] * sign <= 0.0:
                return
        sensitivity += _load_slope(cables, k, state[k], sign) ** 2
    least = tune[at.MIN_FRICTION_TORQUE]
    unexplained = min(max(memory[at.DISTURBANCE], -least), least)
    biased = (tune[at.NOISE] / tune[at.RATIO]) ** 2
    # A bias is estimated up to a relative error of friction of 0.3.
    share = biased / (biased + 0.3**2 * sensitivity)
    step = tune[at.ZEROING] * tune[at.PERIOD] * share * unexplained * tune[at.RATIO]
    # The torque sensor's bias is at most twice its significant torque.
    most = 2.0 * tune[at.NOISE]
    memory[at.BIAS] = min(max(memory[at.BIAS] + step, -most), most)
    rate = tune[at.LEARNING] * tune[at.PERIOD] * unexplained
    rate /= least**2 + sensitivity
    low, high = np.log(0.2), np.log(3.0)  # of the factor of friction
    for k in range(cables.n.size):
        sign = np.sign(layout.slips(state[k], cables.n[k])[0])
        factor = memory[at.FRICTION + k] - rate * _load_slope(cables, k, state[k], sign)
        memory[at.FRICTION + k] = min(max(factor, low), high)


@internal
def _load_slope(
    cables: stepper.Cables, k: int, state: FloatArray, sign: float
) -> float:
    """Return the motor load's derivative by the log of friction of cable k [N m]."""
    n, wrap = cables.n[k], 0.0
    angles = layout.segment_angles(cables.prm[k], n)
    for j in range(n):
        wrap += angles[j]
    pull = cables.proximal[k] * sign * max(layout.tensions(state, n)[0], 0.0)
    return float(pull * (cables.prm[k, PLACE.friction] * wrap))
