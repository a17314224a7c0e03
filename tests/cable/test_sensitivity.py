"""Derivatives of motions: against differences, closed forms and the plain bits."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.random_cables import CABLES, cable_of, motion_of
from cable.terms_on import TERMS_ON
from cc_mujoco.cable import (
    Cable,
    Replay,
    Section,
    Transmission,
    rest_state,
    sensitivity,
)
from cc_mujoco.cable import _sensitivity as sensitivities
from cc_mujoco.cable import replay as played_by
from cc_mujoco.errors import CableError

CABLE = Cable(
    axial_stiffness=2e4,
    pretension=20.0,
    friction=0.15,
    conduit=(Section(0.4, 0.15), Section(0.3, np.inf), Section(0.5, 0.3)),
    segments=12,
)
DT = 2e-3
TIME = np.linspace(0.0, 1.0, 300)
ENDS = {
    "u_proximal": -4e-3 * np.sin(7.0 * TIME) - 1e-3 * np.sin(23.0 * TIME),
    "u_distal": 2e-3 * np.sin(4.1 * TIME),
}
FIELDS = [each.name for each in dataclasses.fields(Replay)][:-2]
ANGLE, PULL = (
    0.3 * np.sin(6.0 * TIME) + 0.1 * np.sin(17.0 * TIME),
    0.2 * np.sin(6 * TIME),
)
JOINT = 0.2 * np.sin(5.0 * TIME)
OVAL = CABLE.replace(eccentricity=2e-3, ovality=1e-3, ovality_phase=0.5)
PAIR = Transmission((CABLE, OVAL.replace(friction=0.1)), 0.02, 0.03, 2.0)
DRIVES: dict[str, tuple[Transmission, dict[str, Any]]] = {
    "angles": (PAIR, {"motor_angle": 2.0 * ANGLE, "joint_angle": JOINT}),
    "motor torque": (PAIR, {"motor_torque": PULL, "joint_angle": JOINT}),
    "joint torque": (PAIR, {"motor_angle": 2.0 * ANGLE, "joint_torque": PULL}),
    "single": (
        Transmission.single(CABLE, 0.02, 0.03),
        {"motor_torque": 0.3 + PULL, "joint_angle": JOINT},
    ),
    "single joint": (
        Transmission.single(OVAL, 0.02, 0.03),
        {"motor_angle": ANGLE, "joint_torque": 0.5 + PULL},
    ),
    "single oval": (
        Transmission.single(OVAL, 0.02, 0.03),
        {"motor_torque": 0.3 + PULL, "joint_angle": JOINT},
    ),
}


def rows(motion: Any) -> np.ndarray:
    """Return what a motion consists of, a row each."""
    each = [getattr(motion, field.name) for field in dataclasses.fields(motion)]
    return np.vstack([np.atleast_2d(a) for a in each if a is not None and a.size])


def compare(play: Any, value: float, found: np.ndarray, least: float) -> None:
    """Compare derivatives with differences wherever those are one number.

    At a kink the derivative is that of one side. At most samples there is none.
    """
    plain = play(value)
    sizes = np.abs(found).max(1) + 1e-2 * np.abs(plain).max(1) / abs(value) + 1e-300

    def sides(step: float) -> tuple[np.ndarray, np.ndarray]:
        right, left = play(value + step), play(value - step)
        return (right - plain) / step, (plain - left) / step

    far, near = sides(1e-5 * value), sides(2.5e-6 * value)
    sizes = sizes[:, None]
    center = 0.5 * (near[0] + near[1])
    steady = np.abs(0.5 * (far[0] + far[1]) - center) < 2e-7 * sizes
    close = np.abs(center - found) < 1e-6 * sizes
    right, left = (np.abs(each - found) < 2e-5 * sizes for each in near)
    assert steady.mean() > least
    assert close[steady].mean() > 0.98
    assert np.all((close | right | left)[steady])
    for one, other in zip(far, near, strict=True):
        flat = np.abs(one - other) < 1e-6 * sizes  # no kink on that side
        assert np.mean((right | left)[flat]) > 0.99


@pytest.mark.parametrize("term", TERMS_ON)
def test_derivatives_are_those_of_differences(term: str) -> None:
    cable = CABLE.replace(**TERMS_ON[term])
    names = ["friction", "axial_stiffness", "pretension", *TERMS_ON[term]]
    found = sensitivity(cable, DT, of=names, **ENDS)
    for name in names:

        def play(value: float, name: str = name) -> np.ndarray:
            return rows(played_by(cable.replace(**{name: value}), DT, **ENDS))

        least = 0.4 if term == "all" else 0.7
        compare(play, getattr(cable, name), rows(found.by[name]), least)


@pytest.mark.parametrize("case", DRIVES)
def test_derivatives_of_transmissions(case: str) -> None:
    drive, motion = DRIVES[case]
    for name in ("friction", "axial_stiffness", "motor_radius", "gear_ratio"):

        def play(value: float, name: str = name) -> np.ndarray:
            if hasattr(drive, name):
                return rows(
                    dataclasses.replace(drive, **{name: value}).replay(DT, **motion)
                )
            more = value - getattr(drive.cables[0], name)
            cables = tuple(
                c.replace(**{name: getattr(c, name) + more}) for c in drive.cables
            )
            changed = dataclasses.replace(drive, cables=cables)
            return rows(changed.replay(DT, **motion))

        owner = drive if hasattr(drive, name) else drive.cables[0]
        found = sensitivity(drive, DT, of=name, **motion).by[name]
        compare(play, getattr(owner, name), rows(found), 0.7)


@pytest.mark.parametrize("case", DRIVES)
def test_what_drives_a_side_is_changed_in_one_sample(case: str) -> None:
    drive, motion = DRIVES[case]
    found = sensitivity(drive, DT, of=motion, **motion)
    for name in motion:
        for row in (1, 40, 150):
            ends = []
            for step in (1e-7, -1e-7):
                moved = {key: each[: row + 1].copy() for key, each in motion.items()}
                moved[name][row] += step
                ends.append(rows(drive.replay(DT, **moved))[:, -1])
            by = rows(found.by[name])
            off = np.abs((ends[0] - ends[1]) / 2e-7 - by[:, row])
            assert np.all(off < 1e-5 * np.abs(by).max(1) + 1e-6)


def values_of(cable: Cable, name: str, motion: dict[str, Any]) -> tuple[Any, Any]:
    """Return the values of a dual run, and those of the plain one."""
    played = played_by(cable, DT, **motion)
    drive = Transmission.single(cable, 1.0, 1.0)
    out = sensitivities._play_dual(cable, drive, DT, name, motion, played)
    plain = (
        -played.u_proximal, played.tension_proximal, -played.u_distal,
        played.tension_distal, played.tension_proximal, played.tension_distal,
        played.slack, played.stored, played.dissipated,
    )  # fmt: skip
    return out[..., 0], np.array(plain)


@pytest.mark.parametrize("term", TERMS_ON)
def test_values_have_the_bits_of_the_plain_code(term: str) -> None:
    cable = CABLE.replace(**TERMS_ON[term])
    pulled = {"u_proximal": ENDS["u_proximal"], "tension_distal": 15 + 9 * np.sin(TIME)}
    for motion in (ENDS, pulled):
        for name in ("friction", "axial_stiffness", *motion):
            found, plain = values_of(cable, name, motion)
            if name not in motion:
                assert np.array_equal(found, plain)
            else:  # an end that stands still at the first sample is moved
                assert np.array_equal(found[:, 1:], plain[:, 1:])


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(CABLES)))
@settings(max_examples=60, deadline=None)
def test_random_cables(seed: int, term: str) -> None:
    """The derivative lies between the differences of both sides, or is one of them."""
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term).replace(pretension=rng.uniform(5.0, 50.0))
    proximal, distal = motion_of(rng, cable, 120)
    motion = {"u_proximal": proximal, "u_distal": distal}
    names = "axial_stiffness", "friction", "pretension"
    found = sensitivity(cable, 1e-3, of=names, **motion)
    for name in names:
        value = getattr(cable, name)
        if name == "friction" and cable.static_friction > 0.0:
            continue
        got = rows(found.by[name])
        plain = rows(found.motion)
        sizes = np.abs(got).max(1) + 1e-2 * np.abs(plain).max(1) / value + 1e-300

        def play(share: float, name: str = name, value: float = value) -> np.ndarray:
            changed = cable.replace(**{name: value * (1.0 + share)})
            return rows(played_by(changed, 1e-3, **motion))

        far, near = ((play(h) - play(-h)) / (2.0 * h * value) for h in (1e-5, 2e-6))
        steady = np.abs(far - near) < 1e-6 * sizes[:, None]
        off = np.abs(near - got) / sizes[:, None]
        assert np.mean(off[steady] < 1e-5) > 0.99 if steady.any() else True


def test_capstan_in_closed_form() -> None:
    """T_proximal = T_distal exp(mu theta) while the whole cable slips to proximal."""
    cable = CABLE.replace(pretension=30.0)
    motion = {"u_proximal": -0.05 * TIME, "tension_distal": np.full(TIME.size, 30.0)}
    found = sensitivity(cable, DT, of=("friction", "tension_distal"), **motion)
    last = found.motion.tension_proximal[-1]
    assert last == pytest.approx(30.0 * np.exp(0.15 * cable.wrap))
    by_friction = found.by["friction"].tension_proximal[-1]
    assert by_friction == pytest.approx(cable.wrap * last, rel=1e-9)
    by_tension = found.by["tension_distal"].tension_proximal[-1]
    assert by_tension == pytest.approx(np.exp(0.15 * cable.wrap), rel=1e-9)


def test_stiffness_in_closed_form() -> None:
    """T = T_0 + EA (u_distal - u_proximal) / L of a cable without friction."""
    cable = CABLE.replace(friction=0.0)
    found = sensitivity(cable, DT, of=("axial_stiffness", "pretension"), **ENDS)
    moved = ENDS["u_distal"] - (ENDS["u_proximal"] - ENDS["u_proximal"][0])
    taut = found.motion.tension_distal > 1.0
    by = found.by["axial_stiffness"].tension_distal
    np.testing.assert_allclose(by[taut], moved[taut] / cable.length, atol=1e-12)
    np.testing.assert_allclose(found.by["pretension"].tension_distal[taut], 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_moment_of_turning(sign: float) -> None:
    """An end that stands goes on slipping one way, and sticks the other."""
    pulled = sign * 0.004 * np.minimum(TIME, 0.5)
    motion = {"u_proximal": np.zeros(TIME.size), "u_distal": pulled}
    cable = CABLE.replace(pretension=60.0)
    found = sensitivity(cable, DT, of="u_distal", **motion).by["u_distal"]
    held, moving = found.tension_distal[-1], found.tension_distal[100]
    shift = {**motion, "u_distal": np.append(pulled[:-1], pulled[-1] + 1e-8)}
    right = played_by(cable, DT, **shift).tension_distal[-1]
    plain = played_by(cable, DT, **motion).tension_distal[-1]
    assert held == pytest.approx((right - plain) / 1e-8, rel=1e-6)
    if sign > 0.0:
        assert held == pytest.approx(moving, rel=0.1)
    else:
        assert held > 5.0 * moving


def test_the_edge_of_slack() -> None:
    """A cable without pretension is taut on one side of rest and slack on the other."""
    cable = CABLE.replace(pretension=0.0)
    motion = {"u_proximal": np.zeros(3), "u_distal": np.zeros(3)}
    found = sensitivity(cable, DT, of=motion, **motion).by
    assert found["u_distal"].tension_distal[1] > 1e4
    assert found["u_distal"].slack[1] == 0.0
    assert found["u_proximal"].tension_proximal[1] == 0.0
    assert found["u_proximal"].slack[1] == pytest.approx(1.0)


def test_initial_tension() -> None:
    tension = rest_state(CABLE)[9:22] * 1.2
    more = {"initial_tension": tension, "profile": True}
    found = sensitivity(CABLE, DT, of="axial_stiffness", **ENDS, **more)
    by = found.by["axial_stiffness"]
    assert found.motion.tension.shape == (TIME.size, 13)

    def play(value: float) -> np.ndarray:
        changed = CABLE.replace(axial_stiffness=value)
        return rows(played_by(changed, DT, **ENDS, initial_tension=tension))

    compare(play, 2e4, rows(by), 0.7)


@pytest.mark.parametrize(
    ("owner", "name", "said"),
    [
        (CABLE, "fricton", "friction"),
        (CABLE, "segments", "segments"),
        (CABLE, "tension_distal", "tension_distal"),
        (CABLE, "eccentricity", "eccentricity"),
        (CABLE, "motor_radius", "motor_radius"),
        (CABLE, "bedding_strain", "`bedding_strain` is 0 .off., where no derivative"),
        (PAIR, "backlash", "backlash"),
        (dataclasses.replace(PAIR, backlash=0.1), "friction", "with backlash"),
    ],
)
def test_what_has_no_derivative_is_refused(owner: Any, name: str, said: str) -> None:
    motion = DRIVES["angles"][1] if isinstance(owner, Transmission) else ENDS
    with pytest.raises(CableError, match=said):
        sensitivity(owner, DT, of=[name], **motion)


def test_other_arguments_are_refused() -> None:
    wrong: Any
    for wrong in (None, 3, (3,)):
        with pytest.raises(
            CableError,
            match=r"unknown quantity `of` ('None'|'?3'?)\. Available: ageing",
        ):
            sensitivity(CABLE, DT, of=wrong, **ENDS)
    with pytest.raises(CableError, match="unknown argument 'x'"):
        sensitivity(CABLE, DT, of="friction", **ENDS, x=3)
    with pytest.raises(CableError, match="unknown argument 'x'"):
        sensitivity(PAIR, DT, of="friction", **DRIVES["angles"][1], x=3)
