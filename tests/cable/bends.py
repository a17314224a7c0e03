"""Cables whose bends are short and tight, wherever they lie, and how to mesh them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable import continuum
from cable.motions import MOTIONS, motion
from cable.random_cables import cable_of, motion_of
from cc_mujoco.cable import Cable, Section, packed_parameters, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable._mesh import segment_wraps

Array = NDArray[np.float64]
Ends = tuple[Array, Array]


class Case(NamedTuple):
    """A cable, the displacement of its ends [m], and the end tensions it has [N]."""

    cable: Cable
    ends: Ends
    tensions: Ends


def _bent(angle: float, share: float) -> Section:
    """Return a bend over a fraction of a metre."""
    return Section(share, share / angle)


def _straight(length: float) -> Section:
    return Section(length, math.inf)


_RIGHT = _bent(0.5 * math.pi, 0.03)  # a right angle of 19 mm radius
_COIL = _bent(10.0, 0.1)

KINDS: dict[str, tuple[tuple[float, ...], tuple[Section, ...]]] = {
    "90 deg at the proximal end": ((0.1, 0.3, 0.5), (_RIGHT, _straight(0.97))),
    "90 deg at the distal end": ((0.1, 0.3, 0.5), (_straight(0.97), _RIGHT)),
    "90 deg at both ends": ((0.1, 0.3, 0.5), (_RIGHT, _straight(0.94), _RIGHT)),
    "90 deg in the middle": (
        (0.1, 0.3, 0.5),
        (_straight(0.485), _RIGHT, _straight(0.485)),
    ),
    "90 deg, 50 mm before the end": (
        (0.1, 0.3, 0.5),
        (_straight(0.92), _RIGHT, _straight(0.05)),
    ),
    "three times 90 deg": (
        (0.1, 0.3, 0.5),
        (
            *(_straight(0.2), _RIGHT, _straight(0.31), _RIGHT),
            *(_straight(0.35), _RIGHT, _straight(0.05)),
        ),
    ),
    "a loop, then 90 deg at the end": (
        (0.1, 0.3),
        (_bent(2.0 * math.pi, 0.97), _RIGHT),
    ),
    "friction x wrap 3 in a tenth at the end": ((0.3,), (_straight(0.9), _COIL)),
    "friction x wrap 3 in a twentieth at either end": (
        (0.3,),
        (_bent(5.0, 0.05), _straight(0.9), _bent(5.0, 0.05)),
    ),
}
"""Coefficients of friction and conduits, 1 m long."""


def cases(kind: str, samples: int = 1000) -> Iterator[Case]:
    """Yield the cases of a kind with every coefficient of friction and every motion."""
    frictions, conduit = KINDS[kind]
    for friction in frictions:
        for name in MOTIONS:
            yield case(conduit, friction, name, samples)


def case(
    conduit: tuple[Section, ...], friction: float, name: str, samples: int = 1000
) -> Case:
    """Return the case of a motion of a 1 m long cable of 4 kN and 10 N pretension."""
    cable = Cable(friction=friction, conduit=conduit)
    stretch = cable.pretension * cable.length / cable.axial_stiffness
    rng = np.random.default_rng(1)
    return _solved(cable, motion(name, stretch, rng, samples=samples))


def random_case(seed: int) -> Case | None:
    """Return a random cable and motion, or None if the cable is always slack."""
    rng = np.random.default_rng(seed)
    cable = cable_of(rng)
    found = _solved(cable, motion_of(rng, cable))
    return found if max(t.max() for t in found.tensions) > 0.0 else None


def _solved(cable: Cable, ends: Ends) -> Case:
    return Case(
        cable,
        ends,
        continuum.solve(
            cable.conduit,
            cable.friction,
            cable.axial_stiffness,
            cable.pretension,
            *ends,
        ),
    )


def equally_packed(cable: Cable) -> Array:
    """Return the parameters of a cable with segments of equal length."""
    n = cable.segments
    prm = packed_parameters(cable)
    edges = np.linspace(0.0, cable.length, n + 1)
    segment_wraps(np.array(cable.conduit), edges, kernel.segment_angles(prm, n))
    layout.contact_length(prm, n)[:] = cable.length / n
    layout.node_length(prm, n)[:] = cable.length / n
    layout.node_length(prm, n)[[0, n]] *= 0.5
    kernel.pack_mesh(np.array(cable.scalars), n, prm)
    return prm


def error(case: Case, prm: Array, segments: int) -> float:
    """RMS error of the worse end tension over the largest tension."""
    cable = case.cable.replace(segments=segments)
    state, work = rest_state(cable), np.empty(kernel.work_size(segments))
    state[0], state[1] = case.ends[0][0], case.ends[1][0]
    new = state.copy()
    first, last = kernel.STATE_HEADER, kernel.STATE_HEADER + segments
    found = np.empty((case.ends[0].size, 2))
    for row, (proximal, distal) in enumerate(zip(*case.ends, strict=True)):
        kernel.advance(prm, segments, state, proximal, distal, 1e-3, new, work)
        state, new = new, state
        found[row] = max(state[first], 0.0), max(state[last], 0.0)
    largest = max(float(t.max()) for t in case.tensions)
    errors = found - np.stack(case.tensions, axis=1)
    return float(np.sqrt(np.mean(errors**2, axis=0)).max()) / largest
