"""Interface of a cable model here: a recorded motion in, both end tensions out.

    model = Distributed(cable)                     # ours, or one of those before
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

from cc_mujoco.cable import Cable, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._conduit import node_lengths
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
    """A motion that a model is to answer, checked and with its defaults."""

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
        """Return the answer a motion with nothing in it that the model refuses."""


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
