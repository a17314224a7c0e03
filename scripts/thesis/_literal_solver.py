r"""The solver of the thesis, literally: chapter 2 of A. Borowski's thesis in NumPy.

    cable = Cable(friction=0.2, conduit=(Section(2.0, 0.28),), segments=10)
    solver = ThesisCable(cable)
    solver.step(u_proximal=-0.001, u_distal=0.0)
    solver.tension  # every node, from the proximal end

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
- An end driven by tension does not say when it turns. In these modes a contradiction in
  mass motion is taken for the end of it: both last-moving nodes start again, once.
- Slack is left to footnote 4: solved as if the cable could push, shown as 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.errors import CableError
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
    tried: int  # how many patterns were tried
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
    return Solution(tension, displacement, patterns[0], len(found), contradiction)


def by_fsolve(
    mesh: Mesh, before: FloatArray, constraints: Sequence[Constraint], guess: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Solve equations 2.13 with signs by a general solver, the baseline of 2.3.1.

    `before` is the displacement of the nodes at the time before (n + 1,) [m]; of the
    two constraints at least one is a displacement; the guess (2n + 2,) is best the last
    solution x. Returns tension and displacement of the nodes, (n + 1,) each, and
    whether the solver says that it converged.
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

    x[free], _, status, _ = fsolve(residual, x[free], full_output=True)
    tension, displacement = np.split(x, 2)
    return tension, displacement, status == 1


class ThesisCable:
    """One cable stepped by Listing 2.1, in any of the three modes (Fig. 2.2).

    Attributes:
        mesh: the segments.
        displacement: of the nodes (n + 1,) [m].
        last_moving: how many nodes move, from the proximal and from the distal end.
        tried: sign patterns tried so far.
        contradicted: steps so far whose solution no sign pattern fits.
    """

    def __init__(self, cable: Cable, *, resolve: bool = True) -> None:
        """Set a cable at rest in its pretension; it has no friction but Coulomb's.

        With `resolve` the solution is repeated when a last-moving node advances (2.2);
        otherwise it advances by one node a step, which limits the speed of motion
        (2.18).
        """
        self.mesh = Mesh.of(cable)
        stretch = cable.pretension * self.mesh.length / self.mesh.stiffness
        self.displacement = np.concatenate([[0.0], np.cumsum(stretch)])
        self._tension = np.full(self.mesh.segments + 1, cable.pretension)
        self._rest = self.displacement[-1]
        self.last_moving = [0, 0]
        self.tried = self.contradicted = 0
        self._resolve = resolve
        self._slip_direction = [0.0, 0.0]
        self._patterns: dict[int, list[FloatArray]] = {}

    @property
    def tension(self) -> FloatArray:
        """Tension of every node (n + 1,) [N]; 0 where slack (2.1.1.2)."""
        return np.maximum(self._tension, 0.0)

    def step(
        self,
        *,
        u_proximal: float | None = None,
        tension_proximal: float | None = None,
        u_distal: float | None = None,
        tension_distal: float | None = None,
    ) -> None:
        """Advance; give displacement since rest [m] or tension [N] at each end."""
        n = self.mesh.segments
        distal_u = None if u_distal is None else self._rest + u_distal
        ends = (
            _prescribed(0, u_proximal, tension_proximal),
            _prescribed(n, distal_u, tension_distal),
        )
        if ends[0].kind == ends[1].kind == "tension":
            raise CableError(
                "both ends are driven by tension; at least one must be driven by "
                "position"
            )
        if not any(asked := self._asked(ends)):
            return
        self._begin(ends, asked)
        may_end = any(end.kind == "tension" for end in ends)
        while True:
            found = self._solution(ends)
            if found.contradiction and self._all_nodes_move() and may_end:
                may_end = False
                self.last_moving = [int(way != 0.0) for way in asked]
            elif not self._advance(found) or not self._resolve:
                break
        self.contradicted += found.contradiction > 0.0
        self._tension, self.displacement = found.tension, found.displacement
        for kind, node, value in ends:  # exactly, or rounding would ask for motion
            (self._tension if kind == "tension" else self.displacement)[node] = value

    def _asked(self, ends: tuple[Constraint, Constraint]) -> list[float]:
        """Return the direction in which the input drives each end, 0 if unchanged."""
        ways = []
        for end, pull in zip(ends, (-1.0, 1.0), strict=True):
            if end.kind == "displacement":
                ways.append(np.sign(end.value - self.displacement[end.node]))
            else:  # tension pulls an end outwards
                ways.append(pull * np.sign(end.value - self._tension[end.node]))
        return ways

    def _begin(self, ends: Sequence[Constraint], asked: list[float]) -> None:
        """Check before the solution what must stop and what must move (2.2)."""
        for side, end in enumerate(ends):
            if asked[side] * self._slip_direction[side] < 0.0:
                # In mass motion a tension does not tell which way its end moves.
                if self._all_nodes_move() and end.kind == "displacement":
                    self.last_moving = [0, 0]
                elif not self._all_nodes_move():
                    self.last_moving[side] = 0
        for side, slip_direction in enumerate(asked):
            if slip_direction != 0.0:
                self.last_moving[side] = max(self.last_moving[side], 1)
                self._slip_direction[side] = slip_direction

    def _all_nodes_move(self) -> bool:
        return sum(self.last_moving) >= self.mesh.segments + 1

    def _solution(self, ends: Sequence[Constraint]) -> Solution:
        """Return all nodes, for the present last-moving ones (2.1.1.4)."""
        if self._all_nodes_move():
            return self._solved(self.mesh, self.displacement, ends)
        tension, displacement = self._tension.copy(), self.displacement.copy()  # 2.15
        contradiction = 0.0
        # The distal part is the proximal one of the mirrored cable.
        for moving, (kind, _, value), way in zip(
            self.last_moving, ends, (1, -1), strict=True
        ):
            if not moving:
                continue
            mesh = self.mesh if way > 0 else self.mesh.mirrored()
            t, u = tension[::way], way * displacement[::way]
            end = Constraint(kind, 0, way * value if kind == "displacement" else value)
            standing = Standing(t[moving], u[moving], mesh.length[moving - 1])
            part = self._solved(mesh.part(0, moving - 1), u[:moving], [end], standing)
            t[:moving] = part.tension
            displacement[::way][:moving] = way * part.displacement
            contradiction += part.contradiction
        return Solution(tension, displacement, np.empty(0), 0, contradiction)

    def _solved(
        self,
        mesh: Mesh,
        before: FloatArray,
        constraints: Sequence[Constraint],
        standing: Standing | None = None,
    ) -> Solution:
        n = mesh.segments
        patterns = self._patterns.setdefault(n, sign_patterns(n))
        found = solve(mesh, before, constraints, patterns, standing)
        self.tried += found.tried
        return found

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

    tension: FloatArray  # of the nodes (samples, n + 1) [N]
    # of the nodes (samples, n + 1) [m], from the unstrained cable
    displacement: FloatArray
    last_moving: NDArray[np.intp]  # nodes that move from either end (samples, 2)
    tried: int  # sign patterns tried in all
    contradicted: int  # steps whose solution no sign pattern fits


def play(
    cable: Cable, *, resolve: bool = True, **given: ArrayLike | None
) -> ThesisReplay:
    """Play a motion (samples,), prescribed by the names of `ThesisCable.step`."""
    names = [name for name, values in given.items() if values is not None]
    rows = np.column_stack([np.asarray(given[name], dtype=float) for name in names])
    solver = ThesisCable(cable, resolve=resolve)
    states = []
    for row in rows.tolist():
        solver.step(**dict(zip(names, row, strict=True)))
        states.append((solver.tension, solver.displacement, list(solver.last_moving)))
    arrays = (np.array(each) for each in zip(*states, strict=True))
    return ThesisReplay(*arrays, solver.tried, solver.contradicted)


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


def _prescribed(node: int, u: float | None, tension: float | None) -> Constraint:
    if u is not None and tension is None:
        return Constraint("displacement", node, u)
    if tension is not None and u is None:
        return Constraint("tension", node, tension)
    end = "distal" if node else "proximal"
    raise CableError(f"prescribe either u_{end} or tension_{end}, not both or neither")
