r"""Rate-independent Coulomb cable without a mesh: the oracle of the kernel's tests.

    tension_proximal, tension_distal = solve(
        [(2.0, 0.28)], friction=0.21, axial_stiffness=4e3, pretension=10.0,
        u_proximal=u_proximal, u_distal=u_distal)

Position along the conduit is the capstan angle :math:`\varphi(x)=\int\mu/R\,dx`, so
where the cable slips in direction s :math:`d\ln T/d\varphi=s`, and where it sticks it
keeps its profile. Every profile is therefore a short list of pieces on which ln T is a
straight line, and all stretch integrals :math:`\int T\,dx/EA` are closed form; a
straight section is a lump of compliance at one angle. Between two samples each end
moves at constant speed, and that path is followed exactly:

1. Alone, each end sends a front into the old profile until the stretch behind the front
   equals the end's displacement (`march`).
2. If the fronts would cross, the cable moves as a whole. Both ends going the same way
   leave one capstan slope, scaled by the total stretch. Ends going opposite ways leave
   a null point: where the fronts met (`meeting`), drifting from then on (`null_point`).
3. A cable shorter than its free length has T = 0 everywhere, and is free of strain
   everywhere at the instant at which it becomes taut again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from cable.capstan import (
    Front,
    Piece,
    Profile,
    Route,
    build_route,
    cut,
    grow,
    mirror,
)
from cable.null_point import Whole


def march(pieces: list[Piece], sign: float, stretch: float) -> Front | None:
    """Return the front whose stretch change is `stretch`; None if there is none."""
    front = Front(0.0, 0.0, 0.0)
    if stretch == 0.0:
        return front
    for piece in pieces:
        width = piece.high - piece.low
        beyond = grow(front, piece, sign, width)
        if beyond.stretch >= stretch:
            inside = partial(grow, front, piece, sign)
            root = brentq(
                lambda z, inside=inside: inside(z).stretch - stretch,
                0.0,
                width,
                xtol=1e-16,
                rtol=1e-15,
            )
            return inside(root)
        front = beyond
    return None


def meeting(
    pieces: list[Piece], route: Route, sign: float, proximal: float, distal: float
) -> tuple[float, float]:
    """Return the meeting place of fronts of equal sign, and the stretch until then.

    Args:
        pieces: Profile before the motion.
        route: Conduit.
        sign: +1 when both ends stretch the cable, -1 when both release it.
        proximal: Stretch the proximal end adds in the whole step, magnitude [m].
        distal: The same for the distal end [m].
    """
    left, right = [Front(0.0, 0.0, 0.0)], [Front(0.0, 0.0, 0.0)]
    opposite = mirror(pieces, route)
    for piece, facing in zip(pieces, opposite, strict=True):
        left.append(grow(left[-1], piece, sign, piece.high - piece.low))
        right.append(grow(right[-1], facing, sign, facing.high - facing.low))
    right.reverse()
    opposite.reverse()

    def fronts(i: int, z: float) -> tuple[float, float]:
        """Return the stretch behind both fronts at `z` inside piece `i`."""
        rest = pieces[i].high - pieces[i].low - z
        near = grow(left[i], pieces[i], sign, z).stretch
        return near, grow(right[i + 1], opposite[i], sign, rest).stretch

    def lead(i: int, z: float) -> float:
        near, far = fronts(i, z)
        return near * distal - far * proximal

    for i, piece in enumerate(pieces):
        width = piece.high - piece.low
        if lead(i, width) >= 0.0:
            start = lead(i, 0.0)
            z = 0.0
            if start < 0.0:
                z = brentq(partial(lead, i), 0.0, width, xtol=1e-16)
            return piece.low + z, sum(fronts(i, z))
    return route.angle[-1], left[-1].stretch


class Continuum:
    """One cable, moved from sample to sample by the displacement of both ends.

    Attributes:
        route: Compliance over the capstan angle.
        stretch: Total stretch [m]; negative when slack.
        profile: Tension along the cable; None when slack.
    """

    def __init__(
        self,
        sections: Sequence[tuple[float, float]],
        friction: float,
        axial_stiffness: float,
        pretension: float,
    ) -> None:
        self.sections = list(sections)
        self.friction = friction
        self.route = build_route(sections, friction, axial_stiffness)
        self._whole = {sign: Whole(self.route, sign) for sign in (1.0, -1.0)}
        compliance = sum(length for length, *_ in sections) / axial_stiffness
        self.stretch = pretension * compliance
        self.profile: Profile | None = None
        if pretension > 0.0:
            ends = [0.0, self.route.angle[-1]] if self.route.density else [0.0]
            logs = [math.log(pretension)] * len(ends)
            self.profile = Profile(ends, logs, [0.0] * (len(ends) - 1))

    def tension(self, position: float) -> float:
        """Return the tension [N] at a distance [m] from the proximal end."""
        if self.profile is None:
            return 0.0
        angle = 0.0
        for length, radius, *_ in self.sections:
            angle += self.friction * min(position, length) / radius
            position = max(position - length, 0.0)
        return self.profile.at(angle)

    def move(self, proximal: float, distal: float) -> None:
        """Displace the ends by these amounts [m], each at its own constant speed."""
        near, far = -proximal, distal  # what each end adds to the stretch
        before, self.stretch = self.stretch, self.stretch + near + far
        if self.stretch <= 0.0:
            self.profile = None
        elif self.profile is not None:
            self._slide(self.profile, before, near, far)
        elif near * far > 0.0:
            whole = self._whole[1.0]
            null = whole.balance(near / (near + far))
            self.profile = whole.profile(null, self.stretch)
        else:
            self.profile = self._one_way(near > 0.0 or far < 0.0)

    def _one_way(self, proximally: bool) -> Profile:
        """Return the profile of a cable that slips in one direction throughout."""
        null = self.route.angle[-1] if proximally else 0.0
        return self._whole[1.0].profile(null, self.stretch)

    def _slide(self, profile: Profile, before: float, near: float, far: float) -> None:
        """Advance a cable that is taut before and after."""
        if near == 0.0 and far == 0.0:
            return
        pieces = cut(self.route, profile)
        left = march(pieces, math.copysign(1.0, near), abs(near))
        right = march(mirror(pieces, self.route), math.copysign(1.0, far), abs(far))
        total = self.route.angle[-1]
        if left and right and left.angle + right.angle < total:
            self.profile = _with_fronts(
                profile, left.angle, near, total - right.angle, far
            )
        elif near * far > 0.0:
            sign = math.copysign(1.0, near)
            null, met = meeting(pieces, self.route, sign, abs(near), abs(far))
            whole = self._whole[sign]
            time = abs(math.log(self.stretch / (before + sign * met)))
            null = whole.drift(null, near / (near + far), time)
            self.profile = whole.profile(null, self.stretch)
        else:
            self.profile = self._one_way(near > 0.0 or far < 0.0)


def _with_fronts(
    profile: Profile, left: float, near: float, right: float, far: float
) -> Profile:
    """Replace the profile outside (left, right) by capstan slopes."""
    first, last = np.interp([left, right], profile.knots, profile.log_tension)
    points = [(left, float(first))]
    pairs = zip(profile.knots, profile.log_tension, strict=True)
    points += [(k, y) for k, y in pairs if left < k < right]
    points.append((right, float(last)))
    slopes = [
        profile.slopes[int(np.searchsorted(profile.knots, 0.5 * (a[0] + b[0]))) - 1]
        for a, b in itertools.pairwise(points)
    ]
    if left > 0.0:
        sign = math.copysign(1.0, near)
        points.insert(0, (0.0, points[0][1] + sign * left))
        slopes.insert(0, -sign)
    end = profile.knots[-1]
    if right < end:
        sign = math.copysign(1.0, far)
        points.append((end, points[-1][1] + sign * (end - right)))
        slopes.append(sign)
    keep = [i for i in range(1, len(slopes)) if slopes[i] != slopes[i - 1]]
    inner = [0, *keep, len(slopes)]
    return Profile(
        [points[i][0] for i in inner],
        [points[i][1] for i in inner],
        [slopes[i] for i in inner[:-1]],
    )


def solve(
    sections: Sequence[tuple[float, float]],
    friction: float,
    axial_stiffness: float,
    pretension: float,
    u_proximal: ArrayLike,
    u_distal: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the end tensions of a cable whose ends are displaced from rest.

    Args:
        sections: (length [m], bend radius [m] or inf), from the proximal end.
        friction: Coefficient of friction, both static and kinetic.
        axial_stiffness: EA [N].
        pretension: Uniform tension at the first sample [N].
        u_proximal: Displacement of the proximal end, positive towards distal [m], (n,).
        u_distal: Displacement of the distal end [m], (n,). Only changes matter.

    Returns:
        Tension at the proximal and at the distal end [N], (n,) each.
    """
    cable = Continuum(sections, friction, axial_stiffness, pretension)
    length = sum(length for length, *_ in sections)
    steps = np.diff(np.stack([u_proximal, u_distal]), axis=1).T
    tension = np.full((len(steps) + 1, 2), pretension, dtype=np.float64)
    for row, (proximal, distal) in zip(tension[1:], steps.tolist(), strict=True):
        cable.move(proximal, distal)
        row[:] = cable.tension(0.0), cable.tension(length)
    return tension[:, 0], tension[:, 1]
