r"""The solver of the thesis, literally: chapter 2 of A. Borowski's thesis in NumPy.

    cable = Cable(friction=0.2, conduit=(Section(2.0, 0.28),), segments=10)
    played = play(cable, u_proximal, u_distal)
    played.tension  # (samples, nodes), from the proximal end

Read it together with the thesis; every part names its equation. It is slow and has the
faults of the printed rules, on purpose: `kernel` is compared with it. Tensions
:math:`T_i` and displacements :math:`u_i` of the nodes are the unknowns. Displacements
count from the unstrained cable with its proximal end at 0, so :math:`u_{i+1}-u_i` is
the stretch of segment i.

Where the printed text contradicts itself or is silent, this module reads it so:

- (2.17) holds as printed at the proximal end. At the distal end it holds in the axis
  turned round, in which the sign of the velocity turns too (footnote 3); so the distal
  subcable is solved as the proximal one of the mirrored cable.
- Motion is *en masse* as soon as no node stands still. The text waits for both
  last-moving nodes to coincide, but when they are neighbours each would have to take
  the other, which moves, for the standing node of (2.16).
- A reversal stops "all other nodes in the affected (sub)cable". In mass motion that
  is the whole cable.
- Often no pattern is consistent (2.25), although 2.3.3 rules that out: where the motion
  turns inside a segment, either sign of that segment contradicts itself, and a segment
  assumed still has a velocity of exactly zero by accident only. Then the pattern stands
  whose contradicting segments move least, and `contradicted` counts the step.
- Slack is left to footnote 4: solved as if the cable could push, shown as 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.native import FloatArray


class Constraint(NamedTuple):
    """One measured state variable (2.14)."""

    kind: Literal["tension", "displacement"]  # what is measured
    node: int  # at which node, 0 is the proximal end
    value: float  # [N] or [m]


class Solution(NamedTuple):
    """State of all nodes under the sign pattern found."""

    tension: FloatArray  # (n + 1,) [N], negative where the cable would have to push
    displacement: FloatArray  # (n + 1,) [m]
    pattern: FloatArray  # direction of every segment (n,)
    # sum of the motion of the segments whose direction is not the assumed one [m]; 0
    # for the solution proper (2.25)
    contradiction: float


def sign_patterns(n: int) -> list[FloatArray]:
    """Return the admissible directions of n segments, in the order of Listing 2.2.

    4 (n - 1) patterns for n >= 2: both uniform ones, then compressing (+ before -) and
    stretching, then each with a single segment that stands still between. The listing
    exchanges the names of the two, against the sign of (2.10).
    """
    whole = [np.full(n, -1.0), np.full(n, 1.0)]
    meeting = [_opposed_signs(n, k, k) for k in range(1, n)]
    still = [_opposed_signs(n, k, k + 1) for k in range(1, n - 1)]
    return whole + meeting + [-p for p in meeting] + still + [-p for p in still]


class Standing(NamedTuple):
    """The node at rest next to the last moving one (2.1.1.4)."""

    tension: float  # [N]
    displacement: float  # [m]
    length: float  # of the segment between them [m]


def sign_pattern_system(
    mesh: Mesh,
    pattern: FloatArray,
    constraints: Sequence[Constraint],
    standing: Standing | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the system 2.13 of one sign pattern (n,), with the rows of constraints.

    Constraints are measured variables (2.14): two, or one with a standing node, the one
    after the last, which bounds a partial motion (2.16). Returns A (2n + 2, 2n + 2) and
    B (2n + 2,) of A x = B (3.11, 3.12), where x is T_1 ... T_{n+1}, u_1 ... u_{n+1}.
    """
    n = mesh.segments
    i = np.arange(n)
    matrix = np.zeros((2 * n + 2, 2 * n + 2))
    matrix[i, i] = mesh.growth(pattern)
    matrix[i, i + 1] = -1.0
    matrix[n + i, i] = mesh.compliance(pattern)
    matrix[n + i, n + 1 + i] = 1.0
    matrix[n + i, n + 2 + i] = -1.0
    distal = np.zeros(2 * n + 2)
    for row, (kind, node, value) in enumerate(constraints, start=2 * n):
        matrix[row, node + (n + 1 if kind == "displacement" else 0)] = 1.0
        distal[row] = value
    if standing is not None:
        half = 0.5 * standing.length / mesh.stiffness
        matrix[-1, [n, -1]] = half, 1.0
        distal[-1] = standing.displacement - standing.tension * half
    return matrix, distal


def segment_motion(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return every segment's motion, the mean of its two nodes' (2.1.1, 3.16)."""
    moved = after - before
    return 0.5 * (moved[:-1] + moved[1:])


def solve(
    mesh: Mesh,
    before: FloatArray,
    constraints: Sequence[Constraint],
    patterns: list[FloatArray],
    standing: Standing | None = None,
) -> Solution:
    """Return the mobile segments (2.1.1.1) by trying sign patterns (2.3.2).

    `before` is the displacement of the nodes at the time before (n + 1,) [m]; for
    constraints and standing node, see `sign_pattern_system`. The pattern found moves to
    the front, so that it is tried first next time: the first that is consistent in all
    segments; where there is none, the one whose contradicting segments move least.
    """
    found = []
    for pattern in patterns:
        x = np.linalg.solve(*sign_pattern_system(mesh, pattern, constraints, standing))
        tension, displacement = np.split(x, 2)
        motion = segment_motion(before, displacement)
        wrong = np.abs(motion[np.sign(motion) != pattern])
        found.append((float(np.sum(wrong)), tension, displacement))
        if found[-1][0] == 0.0:
            break
    place = min(range(len(found)), key=lambda i: found[i][0])
    patterns.insert(0, patterns.pop(place))
    contradiction, tension, displacement = found[place]
    return Solution(tension, displacement, patterns[0], contradiction)


def by_fsolve(
    mesh: Mesh, before: FloatArray, constraints: Sequence[Constraint], guess: FloatArray
) -> FloatArray:
    """Solve equations 2.13 with signs by a general solver, the baseline of 2.3.1.

    `before` is the displacement of the nodes at the time before (n + 1,) [m]; of the
    two constraints at least one is a displacement; the guess (2n + 2,) is best the last
    solution. Returns tensions and displacements of the nodes (2n + 2,).
    """
    from scipy.optimize import fsolve

    n = mesh.segments
    x = np.array(guess)
    free = np.ones(2 * n + 2, dtype=bool)
    for kind, node, value in constraints:
        place = node + (n + 1 if kind == "displacement" else 0)
        x[place], free[place] = value, False

    def residual(unknown: FloatArray) -> FloatArray:
        x[free] = unknown
        tension, u = np.split(x, 2)
        sign = np.sign(segment_motion(before, u))
        friction = tension[:-1] * mesh.growth(sign) - tension[1:]
        stretch = u[:-1] - u[1:] + tension[:-1] * mesh.compliance(sign)
        # In newtons throughout, so that one tolerance fits all rows.
        return np.concatenate([friction, stretch * mesh.stiffness])

    x[free] = fsolve(residual, x[free])
    return x


class ThesisCable:
    """One cable stepped by Listing 2.1, both ends driven by displacement (Fig. 2.2).

    Attributes:
        tension: of the nodes (n + 1,) [N], negative where slack.
        displacement: of the nodes (n + 1,) [m].
        last_moving: how many nodes move, from the proximal and from the distal end.
        contradicted: steps so far whose solution no sign pattern fits.
    """

    def __init__(self, cable: Cable, resolve: bool = True) -> None:
        """Set a cable at rest in its pretension; it has no friction but Coulomb's.

        With `resolve` the solution is repeated when a last-moving node advances (2.2);
        otherwise it advances by one node a step, which limits the speed of motion
        (2.18).
        """
        self.mesh = Mesh.of(cable)
        stretch = cable.pretension * self.mesh.length / self.mesh.stiffness
        self.displacement = np.concatenate([[0.0], np.cumsum(stretch)])
        self.tension = np.full(self.mesh.segments + 1, cable.pretension)
        self._rest = self.displacement[-1]
        self.last_moving = [0, 0]
        self.contradicted = 0
        self._resolve = resolve
        self._slip_direction = [0.0, 0.0]
        self._patterns: dict[int, list[FloatArray]] = {}

    def step(self, u_proximal: float, u_distal: float) -> None:
        """Advance to displacements since rest [m]."""
        ends = (
            Constraint("displacement", 0, u_proximal),
            Constraint("displacement", self.mesh.segments, self._rest + u_distal),
        )
        asked = [float(np.sign(e.value - self.displacement[e.node])) for e in ends]
        if not any(asked):
            return
        # What must stop and what must move (2.2).
        for side, way in enumerate(asked):
            if way * self._slip_direction[side] < 0.0:
                if self._all_nodes_move():
                    self.last_moving = [0, 0]
                else:
                    self.last_moving[side] = 0
        for side, way in enumerate(asked):
            if way != 0.0:
                self.last_moving[side] = max(self.last_moving[side], 1)
                self._slip_direction[side] = way
        while True:
            found = self._solution(ends)
            if not self._advance(found) or not self._resolve:
                break
        self.contradicted += found.contradiction > 0.0
        self.tension, self.displacement = found.tension, found.displacement
        for _, node, value in ends:  # exactly, or rounding would ask for motion
            self.displacement[node] = value

    def _all_nodes_move(self) -> bool:
        return sum(self.last_moving) >= self.mesh.segments + 1

    def _solution(self, ends: Sequence[Constraint]) -> Solution:
        """Return all nodes, for the present last-moving ones (2.1.1.4)."""
        if self._all_nodes_move():
            return self._solved(self.mesh, self.displacement, ends)
        tension, displacement = self.tension.copy(), self.displacement.copy()  # 2.15
        contradiction = 0.0
        # The distal part is the proximal one of the mirrored cable.
        for moving, end, way in zip(self.last_moving, ends, (1, -1), strict=True):
            if not moving:
                continue
            mesh = self.mesh if way > 0 else self.mesh.mirrored()
            t, u = tension[::way], way * displacement[::way]
            driven = Constraint("displacement", 0, way * end.value)
            standing = Standing(t[moving], u[moving], mesh.length[moving - 1])
            part = self._solved(
                mesh.part(0, moving - 1), u[:moving], [driven], standing
            )
            t[:moving] = part.tension
            displacement[::way][:moving] = way * part.displacement
            contradiction += part.contradiction
        return Solution(tension, displacement, np.empty(0), contradiction)

    def _solved(
        self,
        mesh: Mesh,
        before: FloatArray,
        constraints: Sequence[Constraint],
        standing: Standing | None = None,
    ) -> Solution:
        n = mesh.segments
        patterns = self._patterns.setdefault(n, sign_patterns(n))
        return solve(mesh, before, constraints, patterns, standing)

    def _advance(self, found: Solution) -> bool:
        """Let the next node of each end join by (2.17); return whether one did."""
        if self._all_nodes_move():
            return False
        tension, moved = found.tension, found.displacement - self.displacement
        proximal, distal = self.last_moving
        joins = (
            proximal > 0 and _breaks_away(self.mesh, tension, moved, proximal),
            distal > 0
            and _breaks_away(self.mesh.mirrored(), tension[::-1], -moved[::-1], distal),
        )
        self.last_moving = [proximal + joins[0], distal + joins[1]]
        return any(joins)


class ThesisReplay(NamedTuple):
    """A motion played through `ThesisCable`; arrays have one row per sample."""

    tension: FloatArray  # of the nodes (samples, n + 1) [N]; 0 where slack (2.1.1.2)
    # of the nodes (samples, n + 1) [m], from the unstrained cable
    displacement: FloatArray
    last_moving: NDArray[np.intp]  # nodes that move from either end (samples, 2)
    contradicted: int  # steps whose solution no sign pattern fits


def play(
    cable: Cable, u_proximal: FloatArray, u_distal: FloatArray, *, resolve: bool = True
) -> ThesisReplay:
    """Play displacements of both ends since rest (samples,) [m]."""
    solver = ThesisCable(cable, resolve)
    states = []
    for row in zip(u_proximal.tolist(), u_distal.tolist(), strict=True):
        solver.step(*row)
        shown = np.maximum(solver.tension, 0.0)
        states.append((shown, solver.displacement, list(solver.last_moving)))
    arrays = (np.array(each) for each in zip(*states, strict=True))
    return ThesisReplay(*arrays, solver.contradicted)


def _opposed_signs(n: int, first: int, second: int) -> FloatArray:
    """Return +1 before segment `first`, -1 from `second` on, 0 between (n,)."""
    pattern = np.zeros(n)
    pattern[:first], pattern[second:] = 1.0, -1.0
    return pattern


def _breaks_away(
    mesh: Mesh, tension: FloatArray, moved: FloatArray, moving: int
) -> bool:
    """Return whether 2.17 holds at the last of `moving` nodes from the proximal end."""
    sign = np.sign(moved[moving - 1])
    held = tension[moving - 1] * np.exp(mesh.static_angle[moving - 1] * sign)
    return bool(sign != 0.0 and tension[moving] * sign >= held * sign)
