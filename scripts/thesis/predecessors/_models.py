"""Interface of a cable model: a recorded motion in, both end tensions out.

    model = Distributed(cable)                     # or a published model
    answer = model.replay(1e-3, u_proximal, EndSpring(stiffness=500.0, preload=10.0))
    answer.tension_proximal, answer.tension_distal

Every model is made from the same `Cable`. Displacements are positive towards distal and
count from rest in the pretension. A model that cannot do what is requested raises
`CableError` with the reason.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from cc_mujoco.cable import Cable, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._conduit import node_lengths, packed_parameters
from cc_mujoco.cable._layout import tensions
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._tracks import wrap_angles
from cc_mujoco.native import FloatArray, FloatMatrix, compiled


@dataclass(frozen=True)
class Locked:
    """The distal end does not move."""


@dataclass(frozen=True)
class EndSpring:
    """A spring pulls the distal end, which rests at the preload."""

    stiffness: float  # [N/m]


@dataclass(frozen=True)
class Moved:
    """Someone moves the distal end, whatever the tension."""

    displacement: FloatArray  # recorded (samples,) [m]


Environment = Locked | EndSpring | Moved


class Answer(NamedTuple):
    """Output of a model, (samples,) each."""

    tension_proximal: FloatArray  # [N]
    tension_distal: FloatArray  # [N]
    u_distal: FloatArray  # displacement of the distal end [m]


Asked = Literal[
    "a locked output", "a moved output", "a tension profile", "bends that change"
]
"""Requests that not every model can fulfil."""


class ReplayedMotion(NamedTuple):
    """A motion to simulate, checked and with defaults filled in."""

    dt: float  # time between samples [s]
    proximal: FloatArray  # displacement of the proximal end (samples,) [m]
    # that of the distal end where someone moves it, else 0 (samples,) [m]
    moved: FloatArray
    stiffness: float  # of the spring at the distal end, infinite without one [N/m]
    start: FloatArray  # tension at the nodes at first (segments + 1,) [N]
    factor: FloatArray  # of all wrap angles (samples,)

    @property
    def directions(self) -> FloatArray:
        """Sign of the motion, at rest the last one, 0 before any (samples,)."""
        direction = np.sign(np.diff(self.proximal + self.moved, prepend=0.0))
        there = np.where(direction != 0, np.arange(direction.size), 0)
        return direction[np.maximum.accumulate(there)]


class PublishedModel(ABC):
    """A model of one cable; subclasses are one published model each."""

    name: ClassVar[str]  # who published it
    refuses: ClassVar[Mapping[Asked, str]] = {}  # what it cannot take, and why

    def __init__(self, cable: Cable) -> None:
        """Take length, stiffness, bends, friction and pretension from a cable."""
        self.cable = cable

    def replay(
        self,
        dt: float,
        u_proximal: ArrayLike,
        environment: Environment,
        *,
        initial_tension: ArrayLike | None = None,
        wrap_scale: ArrayLike | None = None,
    ) -> Answer:
        """Play a motion of the proximal end (samples,) [m], 0 at first, from rest.

        Samples are `dt` apart [s]. Nodes begin with `initial_tension` (segments + 1,)
        [N], by default the uniform pretension; `wrap_scale` (samples,) multiplies all
        wrap angles.
        """
        asked: dict[Asked, bool] = {
            "a locked output": isinstance(environment, Locked),
            "a moved output": isinstance(environment, Moved),
            "a tension profile": initial_tension is not None,
            "bends that change": wrap_scale is not None,
        }
        for what, why in self.refuses.items():
            if asked[what]:
                raise CableError(f"{self.name} cannot take {what}: {why}")
        proximal = np.ascontiguousarray(u_proximal, dtype=np.float64)
        samples, nodes = proximal.size, self.cable.segments + 1
        stiffness, moved = np.inf, np.zeros(samples)
        if isinstance(environment, EndSpring):
            stiffness = environment.stiffness
        elif isinstance(environment, Moved):
            moved = _sized("the distal motion", environment.displacement, samples)
        start, factor = np.full(nodes, self.cable.pretension), np.ones(samples)
        if initial_tension is not None:
            start = _sized("the initial tension", initial_tension, nodes)
        if wrap_scale is not None:
            factor = _sized("the factor of the wrap angles", wrap_scale, samples)
        return self.answer(
            ReplayedMotion(dt, proximal, moved, stiffness, start, factor)
        )

    @abstractmethod
    def answer(self, motion: ReplayedMotion) -> Answer:
        """Return the tensions for a motion without anything that the model refuses."""


def _sized(name: str, values: ArrayLike, size: int) -> FloatArray:
    """Return the values as an array of their own, if they are as many as they must."""
    given = np.array(values, dtype=np.float64)
    if given.shape != (size,):
        raise CableError(f"{name} has shape {given.shape}; it must be ({size},)")
    return given


class StaticCapstan(PublishedModel):
    """The static capstan ratio: what simulators that know cable friction use today.

    A spring of the cable's stiffness gives the tension at the motor; the tension at the
    joint is that times e^(mu theta s), s the direction of motion (Euler's belt
    equation). Nothing inside has a state, so at a reversal the output jumps.
    """

    name = "static capstan ratio"
    refuses: ClassVar = {"a tension profile": "it has one tension, not many"}

    def answer(self, motion: ReplayedMotion) -> Answer:
        proximal, moved, stiffness = motion.proximal, motion.moved, motion.stiffness
        cable = self.cable
        wrap = cable.friction * cable.wrap * motion.factor
        ratio = np.exp(wrap * motion.directions)
        own = cable.axial_stiffness / cable.length
        if np.isinf(stiffness):
            distal = moved
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
    refuses: ClassVar = {
        "a moved output": "its environment must be a spring",
        "a tension profile": "pretension is one number",
        "bends that change": "its stiffness is set once",
    }

    def __init__(
        self, cable: Cable, masses: int = 10, line_density: float = 2.5e-3
    ) -> None:
        """Choose the number of masses, and the mass per length [kg/m].

        A steel rope of 0.75 mm has 2.5e-3.
        """
        super().__init__(cable)
        self.masses, self.line_density = masses, line_density

    def answer(self, motion: ReplayedMotion) -> Answer:
        proximal, stiffness = motion.proximal, motion.stiffness
        # A chain for either way of moving.
        systems = [self._system(motion.dt, sign, stiffness) for sign in (-1.0, 1.0)]
        angle, direction = self.cable.friction * self.cable.wrap, motion.directions
        ratio, n = np.exp(-angle * direction), self.masses
        state, stretch, last = np.zeros(2 * n), [], []
        for place, way in zip(proximal.tolist(), (direction > 0).tolist(), strict=True):
            step, gain = systems[way]
            state = gain * place + step @ state
            stretch.append(state[n - 1] - (state[n - 2] if n > 1 else place))
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
        n = self.masses
        k = self._spring(sign)
        mass = self.line_density * self.cable.length / n
        damping = 2.0 * math.sqrt(k * mass)  # critical for one element
        chain = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        chain[-1, -1] = 1.0
        pull = np.zeros(n)
        pull[0] = k
        load = np.zeros((n, n))
        load[-1, -1] = 1e9 * k if math.isinf(stiffness) else stiffness
        whole = k * chain + load
        matrix = mass * np.eye(n) + dt * damping * chain + dt**2 * whole
        inverse = np.linalg.inv(matrix)
        by_velocity = inverse * mass
        by_place = -dt * inverse @ whole
        by_input = dt * inverse @ pull
        step = np.block(
            [[np.eye(n) + dt * by_place, dt * by_velocity], [by_place, by_velocity]]
        )
        return step, np.concatenate([dt * by_input, by_input])


class Distributed(PublishedModel):
    """This package's model (chapter 2 of the thesis): motion enters from both ends."""

    name = "this package"

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable = self.cable
        out = np.empty((3, motion.proximal.size))
        # Arms of one, so that an angle is a displacement, a torque a tension.
        cables = stepper.make_cables((cable,), (1.0,), (-1.0,))
        values, sections = np.array(cable.scalars), np.array(cable.conduit, float)
        n, prm, dt = cables.n[0], cables.prm[0], motion.dt
        state = rest_state(cable, motion.start)[None]
        new, work = state.copy(), np.empty(kernel.work_size(n))
        changing = bool(np.any(motion.factor != 1.0))
        bent, rest, distal = sections.copy(), max(tensions(state[0], n)[n], 0.0), 0.0
        for row, proximal in enumerate(motion.proximal):
            if changing:
                bent[:, 1] = sections[:, 1] / motion.factor[row]
                kernel.pack(values, bent, n, prm)
                kernel.expect_change(prm)
            if np.isinf(motion.stiffness):
                distal = motion.moved[row]
                stepper.move(cables, state, proximal, -distal, dt, new, work)
            else:
                load = stepper.Load(rest, motion.stiffness, -np.inf, np.inf)
                distal = -stepper.balance(
                    cables, state, True, proximal, -distal, load, dt, new, work
                )
            state, new = new, state
            tension = tensions(state[0], n)
            out[:, row] = max(tension[0], 0.0), max(tension[n], 0.0), distal
        return Answer(*out)


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
    refuses: ClassVar = {
        "a moved output": "its tension must be a function of its place"
    }

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable = self.cable
        n = cable.segments
        share = node_lengths(cable) / cable.axial_stiffness
        compliance = 1.0 / motion.stiffness
        share[n] += compliance  # the spring follows the last node
        out = np.empty((3, motion.proximal.size))
        _play(
            motion.proximal, cable.friction * wrap_angles(cable), share, motion.start,
            compliance, motion.factor, np.empty(n + 1), out,
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


class Bristle(NamedTuple):
    # displacement over which friction builds up, F_c / sigma_0 [m]
    length: float = 2e-5
    exponent: float = 1.0  # delta_D of Dahl's law
    excess: float = 0.0  # of static over kinetic friction, relative (LuGre)
    stribeck_speed: float = 1e-3  # over which the excess fades [m/s] (LuGre)
    damping: float = 0.0  # of the bristles, sigma_1 over sigma_0 [s] (LuGre)


class _Chain(NamedTuple):
    """Friction at the middle of every segment (n,), and springs between (n + 1,)."""

    spring: FloatArray  # stiffness [N/m]
    start: FloatArray  # tension at first [N]
    tension: FloatArray  # of the springs [N]
    friction: FloatArray  # [N]
    limit: FloatArray  # friction that slides [N]
    x: FloatArray  # displacement [m]
    slip: FloatArray  # of a step [m]
    speed: FloatArray  # [m/s]
    rest: FloatArray  # force out of balance [N]
    diagonal: FloatArray  # of the matrix [N/m]


class BristleChain(PublishedModel):
    """Chain with dynamic friction at its nodes (thesis 1.5, eq. 1.2); knows no slack.

    Kaneko's chain of springs, with the friction of bristles at every node in place of a
    stiffness that depends on direction. Dahl's law bends friction F from sticking to
    sliding as the cable moves,

        dF/dx = sigma_0 sgn(1 - sgn(v) F/F_c) |1 - sgn(v) F/F_c|^delta,

    with F_c = mu T theta of the node, from the tension before the step. It is solved in
    closed form over the motion of a step, so friction never passes F_c by integration.
    Inertia of the cable is left out: at 2.5 g/m its waves pass in a few milliseconds.
    """

    name = "Palli and Melchiorri, Dahl"

    def __init__(self, cable: Cable, bristle: Bristle | None = None) -> None:
        super().__init__(cable)
        self.bristle = bristle or Bristle()

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable, load, start = self.cable, motion.stiffness, motion.start
        n = cable.segments
        spring = cable.axial_stiffness / node_lengths(cable)
        if np.isfinite(load):
            spring[n] = spring[n] * load / (spring[n] + load)
        chain = _Chain(spring, start, start.copy(), np.diff(start), *np.zeros((6, n)))
        grip = cable.friction * kernel.segment_angles(packed_parameters(cable), n)
        out = np.empty((3, motion.proximal.size))
        _play_chain(
            chain, self.bristle, motion.proximal, motion.moved, load, grip,
            motion.factor, motion.dt, out,
        )  # fmt: skip
        return Answer(*out)


class LuGreChain(BristleChain):
    """The chain with LuGre friction (Canudas de Wit et al. 1995).

    It falls with speed, and bristles are damped.
    """

    name = "Palli and Melchiorri, LuGre"

    def __init__(self, cable: Cable) -> None:
        super().__init__(cable, Bristle(excess=0.2, damping=1e-3))


@compiled
def _play_chain(
    chain: _Chain,
    shape: Bristle,
    proximal: FloatArray,
    moved: FloatArray,
    load: float,
    grip: FloatArray,
    factor: FloatArray,
    dt: float,
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
            slow = chain.speed[j] / shape.stribeck_speed
            more = shape.excess * np.exp(-(slow**2))
            chain.limit[j] = mean * grip[j] * factor[row] * (1.0 + more)
            chain.slip[j] = 0.0
        _settle(chain, shape, proximal[row], distal, dt)
        _pull(chain, proximal[row], distal)
        for j in range(n):
            chain.friction[j] = _bristle(chain, shape, j, dt)[2]
            chain.speed[j] = chain.slip[j] / dt
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
def _settle(
    chain: _Chain, shape: Bristle, proximal: float, distal: float, dt: float
) -> None:
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
            force, slope, _ = _bristle(chain, shape, j, dt)
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
def _bristle(
    chain: _Chain, shape: Bristle, j: int, dt: float
) -> tuple[float, float, float]:
    """Return friction after a slip, its slope, and the part stored in bristles."""
    friction, slip, limit = chain.friction[j], chain.slip[j], chain.limit[j]
    if limit <= 0.0:
        return 0.0, 0.0, 0.0
    slip_direction = 1.0 if slip >= 0.0 else -1.0
    short = 1.0 - slip_direction * friction / limit
    side = 1.0 if short >= 0.0 else -1.0
    size, travel, exponent = abs(short), abs(slip) / shape.length, shape.exponent
    if exponent == 1.0:
        size *= np.exp(-travel)
    elif size > 0.0:
        power = 1.0 - exponent
        size = max(size**power - power * travel, 0.0) ** (1.0 / power)
    stored = slip_direction * limit * (1.0 - side * size)
    slope = limit / shape.length * side * size**exponent
    damping = shape.damping / dt
    force = stored + damping * (stored - friction)
    return force, max(slope, 0.0) * (1.0 + damping), stored


class Hysteresis(NamedTuple):
    """Parameters of (1.3)-(1.5)."""

    position: float  # k_x [N/m]
    state: float  # k_zeta [N]
    viscous: float  # nu [N s/m]
    offset: float  # F_0 [N]
    rho: float  # [1/m]
    sigma: float  # shape, 0 or more
    lead: float  # lambda, speed by which acceleration leads [m/s]
    exponent: float = 1.0  # n, 1 or more


class ModifiedBoucWen(PublishedModel):
    r"""Do's modified Bouc-Wen friction of a whole cable (thesis 1.5, eq. 1.3-1.5).

    The friction of the cable, :math:`F_f = T_p - T_d` for motion x towards the motor,
    is one hysteresis curve in x, its velocity and the sign of its acceleration. Cable
    stretch is not part of the model: output and motor move equally. Its parameters do
    not describe a cable and have to be fitted to a recording. The brackets of (1.4) are
    taken as printed, with rho in front of all terms.
    """

    name = "Do, modified Bouc-Wen"
    refuses: ClassVar = {
        "a locked output": "output and motor move alike in it",
        "a moved output": "output and motor move alike in it",
        "a tension profile": "it has no inside",
        "bends that change": "its parameters are fitted to one",
    }

    def __init__(self, cable: Cable, hysteresis: Hysteresis) -> None:
        super().__init__(cable)
        self.hysteresis = hysteresis

    @classmethod
    def fitted(
        cls,
        cable: Cable,
        dt: float,
        u_proximal: ArrayLike,
        environment: EndSpring,
        answer: Answer,
    ) -> ModifiedBoucWen:
        """Fit the parameters to a recording of motor and tensions, n = 1."""
        x = -np.asarray(u_proximal, dtype=np.float64)
        friction = answer.tension_proximal - answer.tension_distal

        def columns(shape: FloatArray) -> FloatArray:
            rho, sigma, lead = np.exp(shape)
            parts = _parts(x, dt, float(rho), float(sigma), float(lead), 1.0)
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
        position, state, viscous, offset = gains(fit.x).tolist()
        rho, sigma, lead = np.exp(fit.x).tolist()
        return cls(
            cable, Hysteresis(position, state, viscous, offset, rho, sigma, lead)
        )

    def answer(self, motion: ReplayedMotion) -> Answer:
        proximal, has = motion.proximal, self.hysteresis
        position, state, speed = _parts(
            -proximal, motion.dt, has.rho, has.sigma, has.lead, has.exponent
        )
        friction = (
            has.position * position
            + has.state * state
            + has.viscous * speed
            + has.offset
        )
        distal = self.cable.pretension - motion.stiffness * proximal
        return Answer(distal + friction, distal, proximal.copy())


def _parts(
    x: FloatArray, dt: float, rho: float, sigma: float, lead: float, exponent: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the factors of the gains: position with (1.5), zeta, speed (samples,)."""
    speed = np.diff(x, prepend=x[0]) / dt
    turn = np.sign(np.diff(speed, prepend=0.0).round(12))
    fast = np.exp(2.0 * speed)
    position = x * (fast + np.sign(x) * turn) / (fast + 1.0)
    zeta = np.empty(speed.size)
    _hysteresis(speed, turn, dt, rho, sigma, lead, exponent, zeta)
    return position, zeta, speed


@compiled
def _hysteresis(
    speed: FloatArray,
    turn: FloatArray,
    dt: float,
    rho: float,
    sigma: float,
    lead: float,
    exponent: float,
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
            size = abs(zeta) ** (exponent - 1.0)
            zeta += (
                part
                - sigma * abs(part) * size * zeta
                + (sigma - 1.0) * part * size * abs(zeta)
            )
        out[row] = zeta
