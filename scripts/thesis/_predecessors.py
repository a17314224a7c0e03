"""Cable models that came before, and ours, behind one interface.

    model = Distributed(cable)                     # or a published model
    answer = model.answer(Motion(1e-3, u_proximal, stiffness=500.0))
    answer.tension_proximal, answer.tension_distal

Every model is made from the same `Cable`. Displacements are positive towards distal and
count from rest in the pretension.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cc_mujoco.cable import Cable, Conduit, Section, replay
from cc_mujoco.cable._conduit import node_lengths
from cc_mujoco.estimation._tension_slope import wrap_angles
from cc_mujoco.native import FloatArray, FloatMatrix, compiled


class Motion(NamedTuple):
    """Motion of the proximal end from rest, and what is at the distal one."""

    dt: float  # time between samples [s]
    proximal: FloatArray  # displacement of the proximal end (samples,) [m], 0 at first
    # of a spring at the distal end, which rests in the pretension; infinite where that
    # end is held or moved [N/m]
    stiffness: float = math.inf
    moved: FloatArray | None = None  # displacement of a moved distal end (samples,) [m]
    start: FloatArray | None = None  # tension profile at first (segments + 1,) [N]
    factor: FloatArray | None = None  # of all wrap angles (samples,)

    @property
    def distal(self) -> FloatArray:
        """Return the displacement of a moved distal end, else 0 (samples,) [m]."""
        return np.zeros(self.proximal.size) if self.moved is None else self.moved

    @property
    def wrap(self) -> FloatArray:
        return np.ones(self.proximal.size) if self.factor is None else self.factor

    def profile(self, cable: Cable) -> FloatArray:
        if self.start is None:
            return np.full(cable.segments + 1, cable.pretension)
        return self.start.copy()

    @property
    def directions(self) -> FloatArray:
        """Sign of the motion, at rest the last one, 0 before any (samples,)."""
        direction = np.sign(np.diff(self.proximal + self.distal, prepend=0.0))
        there = np.where(direction != 0, np.arange(direction.size), 0)
        return direction[np.maximum.accumulate(there)]


class Answer(NamedTuple):
    """Output of a model, (samples,) each."""

    tension_proximal: FloatArray  # [N]
    tension_distal: FloatArray  # [N]
    u_distal: FloatArray  # displacement of the distal end [m]


class PublishedModel(ABC):
    """A model of one cable; subclasses are one published model each."""

    name: ClassVar[str]  # who published it
    refuses: ClassVar[frozenset[str]] = frozenset()  # optional fields of `Motion`

    def __init__(self, cable: Cable) -> None:
        """Take length, stiffness, bends, friction and pretension from a cable."""
        self.cable = cable

    @abstractmethod
    def answer(self, motion: Motion) -> Answer:
        """Return the tensions for a motion without anything that the model refuses."""


class StaticCapstan(PublishedModel):
    """The static capstan ratio: what simulators that know cable friction use today.

    A spring of the cable's stiffness gives the tension at the motor; the tension at the
    joint is that times e^(mu theta s), s the direction of motion (Euler's belt
    equation). Nothing inside has a state, so at a reversal the output jumps.
    """

    name = "static capstan ratio"
    refuses = frozenset({"start"})  # it has one tension, not many

    def answer(self, motion: Motion) -> Answer:
        cable, proximal, stiffness = self.cable, motion.proximal, motion.stiffness
        wrap = cable.friction * cable.wrap * motion.wrap
        ratio = np.exp(wrap * motion.directions)
        own = cable.axial_stiffness / cable.length
        if np.isinf(stiffness):
            distal = motion.distal
        else:  # ratio (T0 + K (far - near)) = T0 - k far
            distal = (cable.pretension * (1.0 - ratio) + ratio * own * proximal) / (
                ratio * own + stiffness
            )
        tension = np.maximum(cable.pretension + own * (distal - proximal), 0.0)
        return Answer(tension, tension * ratio, distal)


class LumpedMasses(PublishedModel):
    """Kaneko's lumped masses, springs and dampers in series (thesis 1.5, Fig. 1.5).

    Friction is not a force here but a change of stiffness: k = k_cable l/(e^l - 1) with
    l = mu theta, of the sign of the motion, gives the stretch that friction causes for
    a tension at the output, which at the input is e^l times larger (Kaneko, Yamashita
    and Tanie 1991; Kaneko, Wada, Maekawa and Tanie 1991; as in the thesis's account).
    The system is linear between reversals: no part of the cable can stand still,
    tension may be negative, and where the direction changes the stiffness jumps.
    """

    name = "Kaneko, lumped masses"
    # its environment is a spring, pretension one number, and stiffness set once
    refuses = frozenset({"moved", "start", "factor"})
    line_density = 2.5e-3  # of a steel rope of 0.75 mm [kg/m]

    def __init__(self, cable: Cable, masses: int = 10) -> None:
        super().__init__(cable)
        self.masses = masses

    def answer(self, motion: Motion) -> Answer:
        proximal, stiffness = motion.proximal, motion.stiffness
        # A chain for either way of moving.
        systems = [self._system(motion.dt, sign, stiffness) for sign in (-1.0, 1.0)]
        angle, direction = self.cable.friction * self.cable.wrap, motion.directions
        ratio, n = np.exp(-angle * direction), self.masses
        state, stretch, last = np.zeros(2 * n), [], []
        for place, way in zip(proximal.tolist(), (direction > 0).tolist(), strict=True):
            step, gain = systems[way]
            state = gain * place + step @ state
            stretch.append(state[n - 1] - state[n - 2])
            last.append(state[n - 1])
        now = np.where(direction > 0, self._spring(1.0), self._spring(-1.0))
        distal = np.array(last) if np.isfinite(stiffness) else np.zeros(proximal.size)
        tension = self.cable.pretension + now * np.array(stretch)
        return Answer(tension * ratio, tension, distal)

    def _spring(self, sign: float) -> float:
        """Return an element's stiffness for motion of this sign, positive to distal."""
        angle = -sign * self.cable.friction * self.cable.wrap
        own = self.cable.axial_stiffness / self.cable.length * self.masses
        return own * angle / math.expm1(angle) if angle else own

    def _system(
        self, dt: float, sign: float, stiffness: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return A and b of implicit Euler: new state = A old state + b u_proximal.

        Masses 1 ... n at the nodes beyond the motor's; where the output is locked the
        last one is held. State: displacements, then velocities.
        """
        n, k = self.masses, self._spring(sign)
        mass = self.line_density * self.cable.length / n
        damping = 2.0 * math.sqrt(k * mass)  # critical for one element
        chain = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        chain[-1, -1] = 1.0
        load, pull = np.zeros((n, n)), np.zeros(2 * n)
        load[-1, -1] = 1e9 * k if math.isinf(stiffness) else stiffness
        pull[n] = dt * k / mass
        rates = [-(k * chain + load) / mass, -damping / mass * chain]
        system = np.block([[np.zeros((n, n)), np.eye(n)], rates])
        inverse = np.linalg.inv(np.eye(2 * n) - dt * system)
        return inverse, inverse @ pull


class Distributed(PublishedModel):
    """This package's model (chapter 2 of the thesis): motion enters from both ends."""

    name = "this package"

    def answer(self, motion: Motion) -> Answer:
        held = np.isinf(motion.stiffness)
        compliance = 0.0 if held else 1.0 / motion.stiffness
        cable = self.cable.replace(end_compliance=compliance)
        start, distal = motion.profile(cable), motion.distal
        if motion.factor is None:
            found = replay(
                cable, motion.dt, u_proximal=motion.proximal, u_distal=distal,
                initial_tension=start,
            )  # fmt: skip
            near, far = found.tension_proximal, found.tension_distal
        else:
            conduit, rows = Conduit(cable, start), []
            ends = zip(motion.proximal, distal, motion.factor, strict=True)
            for proximal, place, factor in ends:
                bends = (Section(s.length, s.radius / factor) for s in cable.conduit)
                conduit.rebend(tuple(bends))
                conduit.step(motion.dt, u_proximal=proximal, u_distal=place)
                rows.append((conduit.tension_proximal, conduit.tension_distal))
            near, far = np.array(rows).T
        return Answer(near, far, distal if held else compliance * (start[-1] - far))


class PassiveDistributed(PublishedModel):
    """Agrawal's distributed cable, moved by the motor alone (thesis 1.5, Fig. 1.6).

    A massless elastic cable under Coulomb friction, as in chapter 2 of the thesis, with
    two restrictions (Agrawal, Peine and Yao 2010; Agrawal et al. 2010): slip enters at
    the motor's end only, and the output must be a known function of its tension,
    T_O = f(x_O). Then one number decides a step, the tension at the motor: behind the
    front the capstan law holds, ahead of it nothing has moved, and the front is where
    the two profiles meet. A slack cable has no tension and no friction.
    """

    name = "Agrawal, one-directional"
    refuses = frozenset({"moved"})  # the tension must be a function of its place

    def answer(self, motion: Motion) -> Answer:
        cable = self.cable
        n = cable.segments
        share = node_lengths(cable) / cable.axial_stiffness
        compliance = 1.0 / motion.stiffness
        share[n] += compliance  # the spring follows the last node
        out = np.empty((3, motion.proximal.size))
        _play(
            motion.proximal, cable.friction * wrap_angles(cable), share,
            motion.profile(cable), compliance, motion.wrap, np.empty(n + 1), out,
        )  # fmt: skip
        return Answer(*out)


@compiled
def _play(
    proximal: FloatArray,
    angle: FloatArray,
    share: FloatArray,
    tension: FloatArray,
    compliance: float,
    factor: FloatArray,
    trial: FloatArray,
    out: FloatMatrix,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples).

    `trial` (n + 1,) is room for a tension that is tried.
    """
    n = angle.size - 1
    rest = tension[n]
    stretch, before = _dot(share, tension), 0.0
    for row in range(proximal.size):
        moved = proximal[row] - before
        before = proximal[row]
        stretch -= moved
        slip_direction = 1.0 if moved > 0.0 else -1.0
        if stretch <= 0.0:
            tension[:] = 0.0
        elif moved != 0.0:
            # The tension at the motor lies between what the cable has and what a front
            # of no length would give; a pull raises it, a push lowers it.
            low = high = tension[0]
            if slip_direction > 0.0:
                low = 0.0
            else:
                high -= moved / share[0]
            while True:
                middle = 0.5 * (low + high)
                _front(tension, angle, factor[row], slip_direction, middle, trial)
                if middle <= low or middle >= high:
                    break
                if _dot(share, trial) < stretch:
                    low = middle
                else:
                    high = middle
            tension, trial = trial, tension
        out[0, row] = tension[0]
        out[1, row] = tension[n]
        out[2, row] = compliance * (rest - tension[n])


@compiled
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled
def _front(
    tension: FloatArray,
    angle: FloatArray,
    factor: float,
    slip_direction: float,
    at_motor: float,
    out: FloatArray,
) -> None:
    """Set the capstan line from the motor until it meets the earlier tension."""
    for i in range(angle.size):
        out[i] = tension[i]
    for i in range(angle.size):
        line = at_motor * np.exp(slip_direction * factor * angle[i])
        # A pull (way -1) raises tension, a push lowers it; the front is where not.
        if i > 0 and slip_direction * (tension[i] - line) <= 0.0:
            break
        out[i] = line


class _Chain(NamedTuple):
    """Friction at the middle of every segment (n,), and springs between (n + 1,)."""

    spring: FloatArray  # stiffness [N/m]
    start: FloatArray  # tension at first [N]
    tension: FloatArray  # of the springs [N]
    friction: FloatArray  # [N]
    limit: FloatArray  # friction that slides [N]
    x: FloatArray  # displacement [m]
    slip: FloatArray  # of a step [m]
    rest: FloatArray  # force out of balance [N]
    diagonal: FloatArray  # of the matrix [N/m]


class BristleChain(PublishedModel):
    """Chain with dynamic friction at its nodes (thesis 1.5, eq. 1.2); knows no slack.

    Kaneko's chain of springs, with the friction of bristles at every node in place of a
    stiffness that depends on direction. Dahl's law bends friction F from sticking to
    sliding as the cable moves,

        dF/dx = sigma_0 (1 - sgn(v) F/F_c),

    with F_c = mu T theta of the node, from the tension before the step. It is solved in
    closed form over the motion of a step, so friction never passes F_c by integration.
    Inertia of the cable is left out: at 2.5 g/m its waves pass in a few milliseconds.
    """

    name = "Palli and Melchiorri, Dahl"

    def __init__(self, cable: Cable, bristle: float = 2e-5) -> None:
        """Choose the displacement over which friction builds up, F_c / sigma_0 [m]."""
        super().__init__(cable)
        self.bristle = bristle

    def answer(self, motion: Motion) -> Answer:
        cable, load, start = self.cable, motion.stiffness, motion.profile(self.cable)
        n = cable.segments
        spring = cable.axial_stiffness / node_lengths(cable)
        if np.isfinite(load):
            spring[n] = spring[n] * load / (spring[n] + load)
        chain = _Chain(spring, start, start.copy(), np.diff(start), *np.zeros((5, n)))
        grip = cable.friction * np.diff(wrap_angles(cable))
        out = np.empty((3, motion.proximal.size))
        _play_chain(
            chain, self.bristle, motion.proximal, motion.distal, load, grip,
            motion.wrap, out,
        )  # fmt: skip
        return Answer(*out)


@compiled
def _play_chain(
    chain: _Chain,
    bristle: float,
    proximal: FloatArray,
    moved: FloatArray,
    load: float,
    grip: FloatArray,
    factor: FloatArray,
    out: FloatMatrix,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples).

    `load` is the stiffness at the distal end, infinite where it is held or moved.
    """
    n, held, tension = grip.size, np.isinf(load), chain.tension
    for row in range(proximal.size):
        distal = moved[row] if held else 0.0
        for j in range(n):
            mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
            chain.limit[j] = mean * grip[j] * factor[row]
            chain.slip[j] = 0.0
        _settle(chain, bristle, proximal[row], distal)
        _pull(chain, proximal[row], distal)
        for j in range(n):
            chain.friction[j] = _bristle(chain, bristle, j)[0]
        out[0, row], out[1, row] = tension[0], tension[n]
        out[2, row] = distal if held else (chain.start[n] - tension[n]) / load


@compiled
def _pull(chain: _Chain, proximal: float, distal: float) -> None:
    """Compute the tension of every spring."""
    n, before = chain.x.size, proximal
    for i in range(n + 1):
        after = chain.x[i] if i < n else distal
        chain.tension[i] = chain.start[i] + chain.spring[i] * (after - before)
        before = after


@compiled
def _settle(chain: _Chain, bristle: float, proximal: float, distal: float) -> None:
    """Move x until every segment is in balance, T_{j+1} - T_j = F_j.

    Newton's method; steps are shortened where the kink of friction at rest makes them
    overshoot.
    """
    n, last, pace = chain.x.size, np.inf, 1.0
    spring, tension = chain.spring, chain.tension
    rest, diagonal = chain.rest, chain.diagonal
    for _ in range(200):
        _pull(chain, proximal, distal)
        size = 0.0
        for j in range(n):
            force, slope = _bristle(chain, bristle, j)
            rest[j] = tension[j + 1] - tension[j] - force
            diagonal[j] = spring[j] + spring[j + 1] + slope
            size = max(size, abs(rest[j]))
        if size < 1e-9:
            return
        pace = min(1.0, 2.0 * pace) if size < last else max(0.5 * pace, 0.05)
        last = size
        for j in range(1, n):
            share = spring[j] / diagonal[j - 1]
            diagonal[j] -= share * spring[j]
            rest[j] += share * rest[j - 1]
        ahead = 0.0
        for j in range(n - 1, -1, -1):
            ahead = (rest[j] + spring[j + 1] * ahead) / diagonal[j]
            chain.x[j] += pace * ahead
            chain.slip[j] += pace * ahead


@compiled
def _bristle(chain: _Chain, bristle: float, j: int) -> tuple[float, float]:
    """Return friction after a slip, and its slope."""
    friction, slip, limit = chain.friction[j], chain.slip[j], chain.limit[j]
    if limit <= 0.0:
        return 0.0, 0.0
    slip_direction = 1.0 if slip >= 0.0 else -1.0
    short = 1.0 - slip_direction * friction / limit
    short *= np.exp(-abs(slip) / bristle)
    force = slip_direction * limit * (1.0 - short)
    return force, max(limit / bristle * short, 0.0)


class Hysteresis(NamedTuple):
    """Parameters of (1.3)-(1.5)."""

    position: float  # k_x [N/m]
    state: float  # k_zeta [N]
    viscous: float  # nu [N s/m]
    offset: float  # F_0 [N]
    rho: float  # [1/m]
    sigma: float  # shape, 0 or more
    lead: float  # lambda, speed by which acceleration leads [m/s]


class ModifiedBoucWen(PublishedModel):
    r"""Do's modified Bouc-Wen friction of a whole cable (thesis 1.5, eq. 1.3-1.5).

    The friction of the cable, :math:`F_f = T_p - T_d` for motion x towards the motor,
    is one hysteresis curve in x, its velocity and the sign of its acceleration. Cable
    stretch is not part of the model: output and motor move equally. Its parameters do
    not describe a cable and have to be fitted to a recording. The brackets of (1.4) are
    taken as printed, with rho in front of all terms.
    """

    name = "Do, modified Bouc-Wen"
    # output and motor move alike in it, it has no inside and is fitted to one path
    refuses = frozenset({"moved", "start", "factor"})

    def __init__(self, cable: Cable, hysteresis: Hysteresis) -> None:
        super().__init__(cable)
        self.hysteresis = hysteresis

    @classmethod
    def fitted(cls, cable: Cable, motion: Motion, answer: Answer) -> ModifiedBoucWen:
        """Fit the parameters to a recording of motor and tensions."""
        x, dt = -motion.proximal, motion.dt
        friction = answer.tension_proximal - answer.tension_distal

        def columns(shape: FloatArray) -> FloatArray:
            parts = _parts(x, dt, *np.exp(shape).tolist())
            return np.column_stack([*parts, np.ones(x.size)])

        def gains(shape: FloatArray) -> FloatArray:
            return np.linalg.lstsq(columns(shape), friction, rcond=None)[0]

        span = float(np.ptp(x))
        speed = float(np.max(np.abs(np.gradient(x, dt))))
        fit = least_squares(
            lambda shape: columns(shape) @ gains(shape) - friction,
            np.log([10.0 / span, 1.0, 0.01 * speed]),
            bounds=(
                np.log([0.1 / span, 0.05, 1e-6 * speed]),
                np.log([1e4 / span, 20.0, speed]),
            ),
        )
        return cls(cable, Hysteresis(*gains(fit.x), *np.exp(fit.x).tolist()))

    def answer(self, motion: Motion) -> Answer:
        proximal = motion.proximal
        *gains, offset, rho, sigma, lead = self.hysteresis
        parts = _parts(-proximal, motion.dt, rho, sigma, lead)
        friction = np.array(gains) @ parts + offset
        distal = self.cable.pretension - motion.stiffness * proximal
        return Answer(distal + friction, distal, proximal.copy())


def _parts(
    x: FloatArray, dt: float, rho: float, sigma: float, lead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the factors of the gains: position with (1.5), zeta, speed (samples,)."""
    speed = np.diff(x, prepend=x[0]) / dt
    turn = np.sign(np.diff(speed, prepend=0.0).round(12))
    fast = np.exp(2.0 * speed)
    position = x * (fast + np.sign(x) * turn) / (fast + 1.0)
    zeta = np.empty(speed.size)
    _hysteresis(speed, turn, dt, rho, sigma, lead, zeta)
    return position, zeta, speed


@compiled
def _hysteresis(
    speed: FloatArray,
    turn: FloatArray,
    dt: float,
    rho: float,
    sigma: float,
    lead: float,
    out: FloatArray,
) -> None:
    """Compute the state zeta of (1.4) over time (samples,), by fine explicit steps."""
    zeta = 0.0
    for row in range(speed.size):
        w = speed[row] + lead * turn[row]
        travel = rho * w * dt
        # The state changes by at most 0.05 in one step of integration.
        steps = 1 + int(abs(travel) * (1.0 + sigma) / 0.05)
        part = travel / steps
        for _ in range(steps):
            zeta += part - sigma * abs(part) * zeta + (sigma - 1.0) * part * abs(zeta)
        out[row] = zeta
