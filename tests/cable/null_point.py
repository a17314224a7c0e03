"""A cable whose two ends move apart or together, for the oracle in `continuum`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from cable.capstan import Front, Piece, Profile, Route, grow

_NODES, _WEIGHTS = (a.tolist() for a in np.polynomial.legendre.leggauss(8))
# The null point is taken to be at its target when e^-GRADING of the way is left.
_GRADING = 23
_ROUNDING = 1e-12  # shares closer than this are equal


@dataclass
class Whole:
    """A cable that stretches or releases as a whole from a null point inside it.

    T = T_n e^(sign |phi - n|), sign +1 when both ends stretch the cable and -1 when
    both release it. With `g` the share of the weighted compliance that lies on the
    proximal side of n and `share` the proximal end's share of the change of the total
    stretch S, the balance of each side gives dn/d|ln S| = (share - g)/(2 g (1 - g)).
    """

    route: Route
    sign: float

    def __post_init__(self) -> None:
        """Weights on either side at every edge, without the lump at that edge."""
        self.left = self._weights(self.route)
        self.right = self._weights(self.route.mirrored())[::-1]

    def _weights(self, route: Route) -> list[float]:
        front, weights = Front(0.0, 0.0, 0.0), [0.0]
        for i, (density, lump) in enumerate(
            zip(route.density, route.lump[:-1], strict=True)
        ):
            piece = Piece(0.0, 0.0, 1.0, 0.0, density, lump)
            width = route.angle[i + 1] - route.angle[i]
            front = grow(front, piece, self.sign, width)
            weights.append(front.weight)
        return weights

    def sides(self, bend: int, angle: float) -> tuple[float, float]:
        """Weighted compliance on both sides of a point of a bend [m/N]."""
        low, high = self.route.angle[bend], self.route.angle[bend + 1]
        base = self.sign * self.route.density[bend]
        left = self.left[bend] + self.route.lump[bend]
        right = self.right[bend + 1] + self.route.lump[bend + 1]
        return (
            (left + base) * math.exp(self.sign * (angle - low)) - base,
            (right + base) * math.exp(self.sign * (high - angle)) - base,
        )

    def edge_shares(self, edge: int) -> tuple[float, float]:
        """Share g just before and just after the straight cable at an edge."""
        left, right, lump = self.left[edge], self.right[edge], self.route.lump[edge]
        total = left + right + lump
        return left / total, (left + lump) / total

    def profile(self, null: float, stretch: float) -> Profile:
        """Tension profile of a given null point and total stretch [m]."""
        total = self.route.angle[-1]
        if total == 0.0:
            log_tension = math.log(stretch / self.route.lump[0])
            return Profile([0.0], [log_tension], [])
        bend = min(
            max(int(np.searchsorted(self.route.angle, null)) - 1, 0),
            len(self.route.density) - 1,
        )
        log_tension = math.log(stretch / sum(self.sides(bend, null)))
        knots, logs, slopes = [null], [log_tension], []
        if null > 0.0:
            knots.insert(0, 0.0)
            logs.insert(0, log_tension + self.sign * null)
            slopes.append(-self.sign)
        if null < total:
            knots.append(total)
            logs.append(log_tension + self.sign * (total - null))
            slopes.append(self.sign)
        return Profile(knots, logs, slopes)

    def lack(self, bend: int, angle: float, share: float) -> float:
        """`share` less the share g at a point of a bend, times the whole weight."""
        left, right = self.sides(bend, angle)
        return share * right - (1.0 - share) * left

    def balance(self, share: float) -> float:
        """Null point that stays: g jumps or passes through `share`."""
        for edge in range(len(self.route.lump)):
            before, after = self.edge_shares(edge)
            if share < before - _ROUNDING:
                low, high = self.route.angle[edge - 1], self.route.angle[edge]
                return self._balance_in(edge - 1, share, low, high)
            if share <= after + _ROUNDING:
                break
        return self.route.angle[edge]

    def _balance_in(self, bend: int, share: float, start: float, end: float) -> float:
        """First place on the way from `start` to `end` in a bend where g is `share`.

        In x = e^(sign (angle - low)) that is a quadratic; on releasing it may have two
        roots in the bend, since a straight cable beyond it weighs the more the nearer
        the null point is. `end` where there is none.
        """
        low, high = self.route.angle[bend], self.route.angle[bend + 1]
        base = self.sign * self.route.density[bend]
        left = self.left[bend] + self.route.lump[bend] + base
        right = self.right[bend + 1] + self.route.lump[bend + 1] + base
        square = (1.0 - share) * left
        linear = (2.0 * share - 1.0) * base
        constant = -share * right * math.exp(self.sign * (high - low))
        places = [
            low + self.sign * math.log(root.real)
            for root in np.roots([square, linear, constant])
            if root.imag == 0.0 and root.real > 0.0
        ]
        between = [p for p in places if min(start, end) <= p <= max(start, end)]
        return min(between, key=lambda place: abs(place - start), default=end)

    def drift(self, null: float, share: float, time: float) -> float:
        """Null point after |ln S| has changed by `time`."""
        angle = self.route.angle
        while True:
            bend = int(np.searchsorted(angle, null, side="right")) - 1
            if null == angle[bend]:
                before, after = self.edge_shares(bend)
                if before - _ROUNDING <= share <= after + _ROUNDING:
                    return null
                if share < before:
                    bend -= 1
            lack = self.lack(bend, null, share)
            if abs(lack) < _ROUNDING * sum(self.sides(bend, null)):
                return null
            rising = lack > 0.0
            edge = angle[bend + 1] if rising else angle[bend]
            target = self._balance_in(bend, share, null, edge)
            settles = target != edge
            null, time = self._approach(bend, null, target, share, time)
            if settles or time <= 0.0:
                return null

    def _approach(
        self, bend: int, null: float, target: float, share: float, time: float
    ) -> tuple[float, float]:
        """Go towards `target`; give the point and the time that is left on arrival.

        The way left shrinks as e^-s: time is a smooth function of s even where the
        target is the balance, which takes for ever to reach.
        """
        slip_direction = target - null

        def pace(s: float) -> float:
            rest = slip_direction * math.exp(-s)
            left, right = self.sides(bend, target - rest)
            lack = share * right - (1.0 - share) * left
            return 2.0 * left * right / (left + right) * rest / lack

        def spent(start: float, width: float) -> float:
            middle, half = start + 0.5 * width, 0.5 * width
            pairs = zip(_NODES, _WEIGHTS, strict=True)
            return half * sum(w * pace(middle + half * node) for node, w in pairs)

        if abs(slip_direction) < 1e-13:
            return target, time
        for panel in range(_GRADING):
            used = spent(panel, 1.0)
            if used >= time:

                def late(width: float, start: int = panel, due: float = time) -> float:
                    return spent(start, width) - due

                s = panel + brentq(late, 0.0, 1.0, xtol=1e-14)
                return target - slip_direction * math.exp(-s), 0.0
            time -= used
        return target, time
