"""The kernel against the continuum: the project's own solver, and stored references."""

from __future__ import annotations

import json
import math
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from cable.continuum import solve
from cable.motions import MOTIONS, motion
from cc_mujoco.cable import Cable, Section, replay
from shared_folder import SHARED
from study_marks import study_but

REFERENCE = SHARED / "reference" / "cable"

CABLES = {
    "one bend": Cable(
        axial_stiffness=4000.0,
        pretension=10.0,
        friction=0.21,
        conduit=(Section(2.0, 0.28),),
    ),
    "bends and straights": Cable(
        axial_stiffness=6000.0,
        pretension=20.0,
        friction=0.08,
        conduit=(Section(0.8, 0.15), Section(0.6, math.inf), Section(0.6, 0.4)),
    ),
    "tight and stiff": Cable(
        axial_stiffness=30000.0,
        pretension=60.0,
        friction=0.12,
        conduit=(
            Section(0.3, math.inf),
            Section(0.5, 0.08),
            Section(0.4, 0.5),
            Section(0.3, 0.1),
        ),
    ),
}


def rms_error(cable: Cable, segments: int, ends, tensions, dt: float = 1e-3) -> float:
    """RMS error of the worse end over the largest tension of the motion."""
    ours = replay(
        cable.replace(segments=segments), dt, u_proximal=ends[0], u_distal=ends[1]
    )
    largest = max(float(np.max(t)) for t in tensions)
    errors = (ours.tension_proximal - tensions[0], ours.tension_distal - tensions[1])
    return max(float(np.sqrt(np.mean(e**2))) for e in errors) / largest


def continuum(cable: Cable, ends):
    return solve(
        cable.conduit, cable.friction, cable.axial_stiffness, cable.pretension, *ends
    )


def case(cable: Cable, name: str, seed: int, samples: int):
    stretch = cable.pretension * cable.length / cable.axial_stiffness
    return motion(name, stretch, np.random.default_rng(seed), samples=samples)


@pytest.mark.parametrize(("which", "name"), study_but(2, product(CABLES, MOTIONS)))
def test_50_segments_are_within_0_2_percent_of_the_continuum(which, name):
    cable = CABLES[which]
    ends = case(cable, name, 7, 1000)
    assert rms_error(cable, 50, ends, continuum(cable, ends)) < 2e-3


@pytest.mark.parametrize("name", study_but(2, MOTIONS))
def test_error_falls_with_at_least_first_order_in_segments(name):
    cable = CABLES["one bend"]
    ends = case(cable, name, 3, 2000)
    tensions = continuum(cable, ends)
    errors = [rms_error(cable, n, ends, tensions) for n in (25, 50, 100, 200)]
    assert errors[3] < errors[0] / 8.0
    assert all(fine < coarse for coarse, fine in pairwise(errors))


@pytest.mark.parametrize("name", MOTIONS)
def test_halving_the_time_step_converges(name):
    cable = CABLES["one bend"].replace(segments=30)
    fine = case(cable, name, 5, 8001)
    ends = {}
    for every in (16, 8, 4, 2, 1):
        u = (fine[0][::every], fine[1][::every])
        motion_ = replay(cable, 1e-3 * every, u_proximal=u[0], u_distal=u[1])
        stride = 16 // every
        ends[every] = motion_.tension_proximal[::stride]
    steps = [
        float(np.sqrt(np.mean((ends[k] - ends[1]) ** 2))) / ends[1].max()
        for k in (16, 8, 4, 2)
    ]
    assert steps[-1] <= max(0.5 * steps[0], 1e-9)
    assert steps[-1] < 2e-3


def references(folder: Path):
    """Name, cable, ends and end tensions of every motion in a folder of references."""
    for file, p in json.loads((folder / "parameters.json").read_text()).items():
        table = np.loadtxt(folder / file, delimiter=",", skiprows=1)
        radius = p["radius_m"]
        sections = (
            [(b - a, math.inf if r is None else r) for a, b, r in radius]
            if isinstance(radius, list)
            else [(p["length_m"], radius)]
        )
        cable = Cable(
            axial_stiffness=p["axial_stiffness_n"],
            pretension=p["pretension_n"],
            friction=p["friction"],
            conduit=tuple(Section(*s) for s in sections),
        )
        yield Path(file).stem, cable, table[:, :2].T, table[:, 2:].T


@pytest.mark.shared
def test_references_solved_by_another_solver():
    cases = list(references(REFERENCE))
    assert len(cases) == 14
    for name, cable, ends, tensions in cases:
        errors = [rms_error(cable, n, ends, tensions) for n in (25, 50, 200)]
        assert errors[1] < 1.5e-3, name
        assert errors[2] < errors[0] / 8.0, name
