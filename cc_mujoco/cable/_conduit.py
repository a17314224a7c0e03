"""One cable from Python: step by step, or a whole recorded motion in one call.

>>> import numpy as np
>>> from cc_mujoco.cable import Cable, Section, replay
>>> cable = Cable(friction=0.2, conduit=(Section(2.0, 0.28),))
>>> pulled = -np.linspace(0.0, 0.02, 200)
>>> motion = replay(cable, dt=0.001, u_proximal=pulled, u_distal=np.zeros(200))
>>> bool(motion.tension_proximal[-1] > motion.tension_distal[-1])
True
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.arguments import MAX_FORCE, numbers, require_kind
from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._cable import PARAMETERS, Cable, Section
from cc_mujoco.cable._friction import drag, holding_coefficient, ratio
from cc_mujoco.cable._mesh import lay_segments, segment_wraps
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.errors import CableError, shown, with_known_names
from cc_mujoco.native import ByteMatrix, FloatArray, FloatMatrix, compiled, interrupted

MAX_TRAVEL = 1e6
"""Largest displacement of an end of a cable that is accepted [m]."""
TIME_STEP = Parameter("time step", "s", low=0.0, high=1e6, low_open=True)
"""Bounds of the time between two samples of a replay."""


def packed_parameters(cable: Cable) -> FloatArray:
    """Return the cable's parameters as the vector that the kernel reads."""
    require_kind("cable", cable, Cable)
    prm = np.empty(kernel.parameter_size(cable.segments))
    sections = np.array(cable.conduit, dtype=np.float64)
    kernel.pack(np.array(cable.scalars), sections, cable.segments, prm)
    return prm


def node_places(cable: Cable) -> FloatArray:
    """Return the places of the nodes from the proximal end (segments + 1,) [m].

    They are denser where the conduit bends more, see `_mesh.py`.
    """
    places = np.empty(cable.segments + 1)
    lay_segments(np.array(cable.conduit, dtype=np.float64), cable.segments, places)
    return places


def node_lengths(cable: Cable) -> FloatArray:
    """Return the length of cable that every node represents (segments + 1,) [m]."""
    return np.array(layout.node_length(packed_parameters(cable), cable.segments))


def end_stiffness(cable: Cable) -> tuple[float, float]:
    """Return the stiffness [N/m] of each end if only its outermost node stretches."""
    proximal, *_, distal = node_lengths(cable).tolist()
    return cable.axial_stiffness / proximal, cable.axial_stiffness / distal


def segment_lengths(cable: Cable) -> FloatArray:
    """Return the length of every segment (segments,) [m]."""
    return np.array(layout.contact_length(packed_parameters(cable), cable.segments))


def rest_state(cable: Cable, tension: ArrayLike | None = None) -> FloatArray:
    """Return the kernel state at rest, with both ends at displacement 0.

    Args:
        cable: the cable.
        tension: initial node tensions (segments + 1,) [N], proximal to distal; default
            the cable's uniform pretension.

    Raises:
        CableError: no cable, a wrong number of tensions, a negative one, or a
            difference between two neighbours that static friction cannot hold (thesis
            2.7).
    """
    require_kind("cable", cable, Cable)
    n = cable.segments
    prm = packed_parameters(cable)
    state = np.empty(kernel.state_size(n))
    kernel.initialize(prm, n, 0.0, 0.0, state)
    if tension is not None:
        node = numbers("initial tension", tension, high=MAX_FORCE, unit="N")
        if node.shape != (n + 1,):
            raise CableError(
                f"initial tension has shape {node.shape}; a cable of {n} segments "
                f"takes one value per node, ({n + 1},)"
            )
        if np.any(node < 0.0):
            raise CableError(
                f"initial tension is {node.min():g} N; it is never less than 0"
            )
        hold = holding_coefficient(prm[: len(PARAMETERS)])
        length = layout.contact_length(prm, n)
        for j, angle in enumerate(kernel.segment_angles(prm, n)):
            low, high = sorted((float(node[j]), float(node[j + 1])))
            free = drag(prm[: len(PARAMETERS)], float(length[j]), 1.0, j, n)
            if high > (ratio(hold, float(angle)) * low + free) * (1.0 + 1e-9):
                raise CableError(
                    f"initial tension jumps from {node[j]:g} N to {node[j + 1]:g} N "
                    f"between nodes {j} and {j + 1}, more than friction holds"
                )
        state[kernel.STATE_HEADER : kernel.STATE_HEADER + n + 1] = node
        nodes.rest_springs(prm, n, state)
        state[3] = kernel.total_stretch(prm, n, state)
    return state


class Conduit:
    """One cable with its state, stepped by its ends.

    Displacements are positive towards distal and count from the rest position.
    """

    def __init__(self, cable: Cable, tension: ArrayLike | None = None) -> None:
        self.cable = require_kind("cable", cable, Cable)
        self._prm = packed_parameters(cable)
        self._start = rest_state(cable, tension)
        self._state = self._start.copy()
        self._next = self._start.copy()
        self._work = np.empty(kernel.work_size(cable.segments))
        self._bent = False

    @exclusive
    def reset(self) -> None:
        """Return to the initial rest state, in the conduit it was made with."""
        self._state[:] = self._start
        if self._bent:
            self._prm[:] = packed_parameters(self.cable)
            self._bent = False

    @exclusive
    def rebend(self, conduit: Sequence[Section]) -> None:
        """Give the conduit another path of the same length, at once.

        The cable and its nodes keep their places along it until the next step. In that
        step the cable slips wherever friction no longer holds it, even inside, and even
        if both ends stand still.

        Args:
            conduit: sections of the new path, proximal to distal.

        Raises:
            CableError: not sections, or another total length.
        """
        bent = self.cable.replace(conduit=tuple(conduit))
        if not math.isclose(bent.length, self.cable.length, rel_tol=1e-9):
            raise CableError(
                f"the new path of the conduit is {bent.length:g} m long; it must be "
                f"{self.cable.length:g} m as before"
            )
        n = self.cable.segments
        angles = np.empty(n)
        segment_wraps(np.array(bent.conduit), node_places(self.cable), angles)
        kernel.rebend(self._prm, n, angles)
        kernel.expect_change(self._prm)
        self._bent = True

    @exclusive
    def step(
        self,
        dt: float,
        *,
        u_proximal: float | None = None,
        tension_proximal: float | None = None,
        u_distal: float | None = None,
        tension_distal: float | None = None,
    ) -> None:
        """Advance by `dt` seconds with one quantity prescribed at each end.

        Args:
            dt: time step [s], > 0.
            u_proximal: displacement of the proximal end [m], or
            tension_proximal: its tension [N], >= 0.
            u_distal: displacement of the distal end [m], or
            tension_distal: its tension [N], >= 0.

        Raises:
            CableError: not exactly one quantity per end, tension at both ends, or a
                value that is not finite or negative.
        """
        proximal = _prescribed("proximal", u_proximal, tension_proximal)
        distal = _prescribed("distal", u_distal, tension_distal)
        _check_ends(proximal[0], distal[0], dt)
        for end, (kind, value) in (("proximal", proximal), ("distal", distal)):
            if value.shape or (kind == kernel.TENSION and value < 0.0):
                raise CableError(
                    f"the {end} end is driven to {shown(value)}; it must be "
                    "one number, of a tension 0 or more"
                )
        ends = proximal[0], float(proximal[1]), distal[0], float(distal[1])
        status = kernel.step(
            self._prm, self.cable.segments, self._state, *ends, float(dt), self._next,
            self._work,
        )  # fmt: skip
        if status != kernel.OK or not np.all(np.isfinite(self._next)):
            raise CableError(
                f"ends of the cable are driven to {ends[1]:g} and {ends[3]:g}, where "
                "its numbers overflow"
            )
        self._state, self._next = self._next, self._state

    @property
    def tension(self) -> FloatArray:
        """Tension of every node, proximal to distal (segments + 1,) [N]."""
        t = kernel.STATE_HEADER
        return np.maximum(self._state[t : t + self.cable.segments + 1], 0.0)

    @property
    def tension_proximal(self) -> float:
        """Tension of the proximal end [N]."""
        return float(self.tension[0])

    @property
    def tension_distal(self) -> float:
        """Tension of the distal end [N]."""
        return float(self.tension[-1])

    @property
    def u_proximal(self) -> float:
        """Displacement of the proximal end [m]."""
        return float(self._state[0])

    @property
    def u_distal(self) -> float:
        """Displacement of the distal end [m]."""
        return float(self._state[1])

    @property
    def direction(self) -> NDArray[np.int8]:
        """Direction of slip of every segment in the last step (segments,), 0 = rest."""
        n = self.cable.segments
        t = kernel.STATE_HEADER + n + 1
        return np.sign(self._state[t : t + n]).astype(np.int8)

    @property
    def moving_fraction(self) -> float:
        """Share of the segments that slipped in the last step."""
        return float(np.mean(self.direction != 0))

    @property
    def slack(self) -> float:
        """Length of cable lying slack [m]."""
        return kernel.slack_length(self._prm, self.cable.segments, self._state)

    @property
    def stored(self) -> float:
        """Elastic energy [J]."""
        return kernel.stored_energy(self._prm, self.cable.segments, self._state)

    @property
    def dissipated(self) -> float:
        """Energy lost to friction since the start [J], friction times slip."""
        return float(self._state[2])


@dataclass(frozen=True)
class Replay:
    """A recorded motion played through a cable; arrays have one row per sample.

    Attributes:
        u_proximal: displacement of the proximal end [m].
        u_distal: displacement of the distal end [m].
        tension_proximal: tension of the proximal end [N].
        tension_distal: tension of the distal end [N].
        moving_fraction: share of segments that slipped.
        slack: length of slack cable [m].
        stored: elastic energy [J].
        dissipated: energy lost to friction so far [J].
        tension: node tensions (samples, segments + 1) [N], if requested.
        direction: slip direction (samples, segments), if requested.
    """

    u_proximal: FloatArray
    u_distal: FloatArray
    tension_proximal: FloatArray
    tension_distal: FloatArray
    moving_fraction: FloatArray
    slack: FloatArray
    stored: FloatArray
    dissipated: FloatArray
    tension: FloatArray | None
    direction: NDArray[np.int8] | None


@with_known_names
def replay(
    cable: Cable,
    dt: float,
    *,
    u_proximal: ArrayLike | None = None,
    tension_proximal: ArrayLike | None = None,
    u_distal: ArrayLike | None = None,
    tension_distal: ArrayLike | None = None,
    initial_tension: ArrayLike | None = None,
    profile: bool = False,
) -> Replay:
    """Play a recorded motion of both ends through a cable, in one compiled call.

    The first sample is the rest state; only changes of displacement matter.

    Args:
        cable: the cable.
        dt: time between samples [s].
        u_proximal: displacement of the proximal end (samples,) [m], or
        tension_proximal: its tension (samples,) [N].
        u_distal: displacement of the distal end (samples,) [m], or
        tension_distal: its tension (samples,) [N].
        initial_tension: node tensions at the start, see `rest_state`.
        profile: also return node tensions and slip directions of every sample.

    Raises:
        CableError: no cable, not exactly one quantity per end, tension at both, unequal
            lengths, values that are not finite or too large, or negative tensions.
    """
    proximal_kind, proximal = _prescribed("proximal", u_proximal, tension_proximal)
    distal_kind, distal = _prescribed("distal", u_distal, tension_distal)
    _check_ends(proximal_kind, distal_kind, dt)
    require_kind("cable", cable, Cable)
    proximal = _series("proximal", proximal_kind, proximal)
    distal = _series("distal", distal_kind, distal)
    if proximal.size != distal.size:
        raise CableError(
            f"the proximal end has {proximal.size} samples and the distal end "
            f"{distal.size}; both must have the same number"
        )
    n = cable.segments
    prm = packed_parameters(cable)
    require_kind("profile", profile, bool)
    state = rest_state(cable, initial_tension)
    state[0] = proximal[0] if proximal_kind == kernel.POSITION else 0.0
    state[1] = distal[0] if distal_kind == kernel.POSITION else 0.0
    summary = np.empty((8, proximal.size))
    rows = proximal.size if profile else 0
    tension = np.empty((rows, n + 1))
    direction = np.empty((rows, n), dtype=np.int8)
    _play(
        prm, n, state, proximal_kind, proximal, distal_kind, distal, dt, state.copy(),
        np.empty(kernel.work_size(n)), summary, tension, direction,
    )  # fmt: skip
    require_no_overflow(summary, proximal, distal)
    profiles = (tension, direction) if profile else (None, None)
    return Replay(*summary, *profiles)


@compiled
def _play(
    prm: FloatArray, n: int, state: FloatArray, proximal_kind: int,
    proximal: FloatArray, distal_kind: int, distal: FloatArray, dt: float,
    new_state: FloatArray, work: FloatArray, summary: FloatMatrix, tension: FloatMatrix,
    direction: ByteMatrix,
) -> None:  # fmt: skip
    t = kernel.STATE_HEADER
    for row in range(proximal.size):
        if interrupted(row):
            return
        # At the first sample, at rest, only a prescribed tension moves anything.
        kernel.step(
            prm, n, state, proximal_kind, proximal[row], distal_kind, distal[row], dt,
            new_state, work,
        )  # fmt: skip
        state, new_state = new_state, state
        moving = 0
        for j in range(n):
            if state[t + n + 1 + j] != 0.0:
                moving += 1
        summary[0, row] = state[0]
        summary[1, row] = state[1]
        summary[2, row] = max(state[t], 0.0)
        summary[3, row] = max(state[t + n], 0.0)
        summary[4, row] = moving / n
        summary[5, row] = kernel.slack_length(prm, n, state)
        summary[6, row] = kernel.stored_energy(prm, n, state)
        summary[7, row] = state[2]
        if tension.shape[0] > 0:
            for i in range(n + 1):
                tension[row, i] = max(state[t + i], 0.0)
            for j in range(n):
                direction[row, j] = np.int8(np.sign(state[t + n + 1 + j]))


def require_no_overflow(
    results: FloatMatrix, proximal: FloatArray, distal: FloatArray
) -> None:
    """Require that the results of a replay (rows, samples) are finite."""
    overflows = ~np.isfinite(results).all(axis=0)
    if overflows.any():
        row = int(np.argmax(overflows))
        raise CableError(
            f"numbers overflow at sample {row}, where the ends are driven to "
            f"{proximal[row]:g} and {distal[row]:g}; drive them by less"
        )


def _prescribed(
    end: str, u: ArrayLike | None, tension: ArrayLike | None
) -> tuple[int, FloatArray]:
    """Return the kind of an end, POSITION or TENSION, and its prescribed values."""
    if u is not None and tension is None:
        return kernel.POSITION, numbers(f"u_{end}", u, high=MAX_TRAVEL, unit="m")
    if tension is not None and u is None:
        name = f"tension_{end}"
        return kernel.TENSION, numbers(name, tension, high=MAX_FORCE, unit="N")
    raise CableError(f"prescribe either u_{end} or tension_{end}, not both or neither")


def _check_ends(proximal_kind: int, distal_kind: int, dt: float) -> None:
    if proximal_kind == distal_kind == kernel.TENSION:
        raise CableError(
            "both ends are driven by tension; at least one must be driven by position"
        )
    TIME_STEP.check(dt)


def _series(end: str, kind: int, given: FloatArray) -> FloatArray:
    values = np.ascontiguousarray(given)
    if values.ndim != 1 or values.size == 0:
        raise CableError(
            f"the motion of the {end} end has shape {values.shape}, not (samples,)"
        )
    if kind == kernel.TENSION and np.any(values < 0.0):
        row = int(np.flatnonzero(values < 0.0)[0])
        raise CableError(
            f"sample {row} of tension_{end} is {values[row]:g} N; "
            "tension is never negative"
        )
    return values
