r"""Controllers of the joint torque by the stiffness of the cables and a known motor.

law = BacklashInverse(env.unwrapped.drive)
"""

import math

import numpy as np

from cc_mujoco.control import _controller as controller
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as laws
from cc_mujoco.control._cable_model import cable_table, joint_spring
from cc_mujoco.control._feedback import loop_gains, require_known_motor
from cc_mujoco.control._law_steps import LACK, LOAD, SPEED, STATES, STRETCH, Design
from cc_mujoco.device._drive import Drive
from cc_mujoco.estimation._least_squares import single_threaded_blas


class _KnownMotor(controller.SteppedController):
    fixed = frozenset({"ratio", "period", "one_way", "inertia"})
    """Gains that the tables depend on."""

    def __init__(self, drive: Drive) -> None:
        """Prepare; raise a `CableError` if cables or rotor are not known."""
        super().__init__(drive)
        require_known_motor(drive)
        self.spring = joint_spring(drive.cables, self.limits)
        """All cables as a spring at the joint, see `guard.STIFFNESS`."""


class BacklashInverse(_KnownMotor):
    r"""Position control of the motor by the inverse of the backlash, with an integral.

    If all cables slip as a whole, they make the desired torque at one angle of the
    motor for each direction of motion (`full_slip_balance`). The direction is that of
    the angle that would do so without friction, \(\rho (\theta_j + \tau_d / k)\); noise
    does not reverse it. At a reversal the wanted angle jumps across the backlash. The
    motor follows it by a position loop, with the torque of the cables fed forward, and
    an integral of the torque error shifts the angle, which makes up for friction other
    than `Cable.friction`, too. This is the inverse of a cable transmission of T. Do et
    al., "Hysteresis modeling and position control of tendon-sheath mechanism",
    Mechatronics 24, 2014, applied to a torque.
    """

    stepped = controller.SteppedLaw(laws.step_inverse, fixed=_KnownMotor.fixed)
    # Free numbers, see `scripts/benchmarks/tune_baselines.py`.
    delay_share, max_bandwidth, integral_share = 0.2, 200.0, 1.2

    def law_tables(self) -> controller.LawTables:
        drive = self.drive
        stiffness, late = self.spring[guard.STIFFNESS], controller.total_delay(drive)
        # Of the motor's position [rad/s].
        bandwidth = min(self.delay_share / late, self.max_bandwidth)
        noise = laws.BAND_SIGMAS * drive.torque_noise / stiffness
        gains = laws.InverseGains(
            late,
            drive.inertia * bandwidth**2,
            2.0 * drive.inertia * bandwidth,
            self.integral_share * bandwidth,
            max(noise, 5e-4),  # motion of the joint below which it is still [rad]
            loop_gains(drive).settling * stiffness / drive.ratio**2,
        )
        cables = cable_table(drive.cables, self.limits)
        first = laws.OWN_MEMORY + guard.LIMITS + len(gains)
        return controller.LawTables(
            cables.shape,
            tuple(np.concatenate([gains, self.spring, cables.ravel()]).tolist()),
            first + laws.INVERSE_GUARD + guard.MEMORY_SIZE,
            (first + laws.INVERSE_GUARD + guard.COMMAND,),
        )


class LinearQuadraticGaussian(_KnownMotor):
    r"""LQG of the joint torque with observers of both disturbances; no friction known.

    The model is linear, a rotor on a spring: with the stretch
    \(z = \theta_m - \rho \theta_j\) and the stiffness k of the cables at the motor,

    \[ J \ddot z = \tau_m + d_m - k z, \qquad \tau_j = \rho k z + d_j \]

    A Kalman filter estimates z, its rate and the two disturbances, modelled as random
    walks, from delayed angles and torque. A prediction over the delay and a linear
    quadratic regulator bring z to where the model makes the desired torque less
    \(d_j\). If an innovation changes in one step by more than any motion can, an
    encoder has slipped, and its zero is shifted. Disturbance observers after K.
    Ohnishi, M. Shibata, T. Murakami, "Motion control for advanced mechatronics",
    IEEE/ASME Trans. Mechatronics 1, 1996.
    """

    stepped = controller.SteppedLaw(laws.step_gaussian, fixed=_KnownMotor.fixed)
    # Free numbers, tuned likewise: weights of the motor's torque, of cables that pull
    # both ways and of a single one; random walks in a second, over the greatest torque.
    effort, single_effort, load_walk, lack_walk = 1.0, 0.4, 0.2, 0.5

    def __init__(self, drive: Drive) -> None:
        super().__init__(drive)
        rigidity = float(self.spring[guard.STIFFNESS])
        with single_threaded_blas():  # its threads take 30 times as long
            self.design, slip = _design(self, rigidity)
        release = loop_gains(drive).settling * rigidity / drive.ratio**2
        self._own_gains = laws.GaussianGains(release, slip)
        self._late = round(controller.total_delay(drive) / drive.period - 0.5)

    def law_tables(self) -> controller.LawTables:
        numbers = np.array(self._own_gains), self.spring, *map(np.ravel, self.design)
        first = laws.OWN_MEMORY + guard.LIMITS + len(self._own_gains)
        size = laws.HEADER + STATES + self._late
        return controller.LawTables(
            (size,),
            tuple(np.concatenate(numbers).tolist()),
            first + size + 2 * STATES,
            (first + size - 1, first + laws.GAUSSIAN_GUARD + guard.COMMAND),
        )


def _design(law: LinearQuadraticGaussian, rigidity: float) -> tuple[Design, float]:
    """Return the `Design` for a joint stiffness [N m/rad], and `GaussianGains.slip`."""
    from scipy.linalg import expm, solve_discrete_are

    drive = law.drive
    ratio, period, inertia = drive.ratio, drive.period, drive.inertia
    most = max(map(abs, drive.reach))
    drift = np.zeros((STATES + 1, STATES + 1))
    drift[STRETCH, SPEED] = 1.0
    drift[SPEED, STRETCH] = -rigidity / ratio**2 / inertia
    drift[SPEED, SPEED] = -drive.damping / inertia
    drift[SPEED, LOAD] = drift[SPEED, STATES] = 1.0 / inertia
    step = expm(period * drift)
    a, b = step[:STATES, :STATES], step[:STATES, STATES:]
    seen = np.zeros((2, STATES))
    seen[0, STRETCH] = 1.0
    seen[1, STRETCH], seen[1, LACK] = rigidity / ratio, 1.0
    angles = 3e-4 * (1.0 + abs(ratio))  # 3e-4 rad: deviation of an angle
    noise = np.diag([angles**2, max(drive.torque_noise, 1e-4 * most) ** 2])
    walk = np.zeros(STATES)
    walk[LOAD] = (law.load_walk * most / ratio) ** 2 * period
    walk[LACK] = (law.lack_walk * most) ** 2 * period
    walk[SPEED] = 1e-9 * (most / ratio / inertia) ** 2 * period
    spread = solve_discrete_are(a.T, seen.T, np.diag(walk), noise)
    gain = spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + noise)
    deviation = math.sqrt((seen @ spread @ seen.T + noise)[0, 0])
    push = max(map(abs, (drive.low, drive.high))) / inertia * period**2
    # An encoder has slipped where the innovation of the stretch changes in a step by 8
    # standard deviations more than the motor can cause.
    slip = 8.0 * deviation + push
    cost = np.diag([(rigidity / ratio / most) ** 2, 0.0])
    # Of motor torque to torque error at the joint, both over the greatest: with less of
    # a single cable the ankle is passive.
    weight = law.single_effort if drive.one_way else law.effort
    effort = np.array([[(weight * ratio / most) ** 2]])
    value = solve_discrete_are(a[:2, :2], b[:2], cost, effort)
    own = b[:2].T @ value
    regulator = np.linalg.solve(effort + own @ b[:2], own @ a[:2, :2])
    parts = step[:STATES], seen, gain, regulator[0]
    return Design(*map(np.ascontiguousarray, parts)), slip
