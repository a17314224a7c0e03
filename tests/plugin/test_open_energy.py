"""Closed motions of random mechanisms: a cable on an open path creates no energy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plugin.mechanisms import Balance, drawn, loop, mechanism, play
from plugin.wound_scenes import KINDS, wound
from study_marks import study_but


def missing(balance: Balance) -> float:
    """Work that is neither stored nor heat, as a part of the heat."""
    lost = abs(balance.work - balance.stored - balance.heat)
    return lost / max(balance.heat, 1e-3 * balance.gross, 1e-12)


def heat_of_a_drum(
    stiffness: float, mounted: float, paid: np.ndarray, eased: np.ndarray
) -> float:
    """Return the heat of the second turn, where a drum has room for any layers [J].

    Args:
        stiffness: EA of the rope [N].
        mounted: strain of the rope as it was mounted on the drum.
        paid: length that the drum paid out, from 0 to 0 [m].
        eased: by how much the path of 0.4 m is longer than that [m].
    """
    fine = np.linspace(0.0, 1.0, 20_001)
    at = np.linspace(0.0, 1.0, paid.size)
    out, more = np.interp(fine, at, paid), np.interp(fine, at, np.append(eased, 0.0))
    own, layers, heat = 0.4 / (1.0 + mounted), [], 0.0
    for turn in range(2):
        for k in range(1, fine.size):
            strain = (0.4 + out[k] + more[k]) / own - 1.0
            moved = out[k] - out[k - 1]
            if moved < 0.0:
                layers.append([-moved, strain])
                own += moved / (1.0 + strain)
            while moved > 0.0:
                length, wound_at = layers.pop() if layers else [moved, mounted]
                if length > moved:
                    layers.append([length - moved, wound_at])
                amount = min(length, moved) / (1.0 + wound_at)
                own, moved = own + amount, moved - length
                if turn == 1:
                    heat += 0.5 * stiffness * amount * (wound_at - strain) ** 2
    return heat


def axis(m: mujoco.MjModel, geom: str) -> np.ndarray:
    """Axis of a cylinder in the frame of its body."""
    found = np.empty(3)
    mujoco.mju_rotVecQuat(found, np.array([0.0, 0.0, 1.0]), m.geom(geom).quat)
    return found


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_cylinder_carried_along_its_axis_takes_work_either_way_round(
    sense: float,
) -> None:
    """A stuck cable climbs on it, and one of its ends moves a quarter turn ahead."""
    helix = mechanism(
        5, ("cylinder",), (False,), ("none", "slide", "slide"),
        friction=1.5, axial_stiffness=2e4, pretension=50,
    )  # fmt: skip
    m = helix.model
    m.jnt_axis[:] = axis(m, "g0"), [1.0, 0.0, 0.0]
    turn = 2.0 * np.pi * np.arange(400) / 400
    poses = np.stack([0.02 * np.sin(turn), 1e-3 * np.sin(turn + sense * np.pi / 2)], 1)
    balance = play(helix, poses)
    assert balance.heat > 0.1
    assert balance.work > 0.0
    assert missing(balance) < 1e-2


def test_a_ring_that_turns_about_a_cable_heats_as_much_as_it_is_driven() -> None:
    ring = mechanism(2, ("cylinder",), (True,), ("none", "hinge", "none"))
    ring.model.jnt_axis[:] = axis(ring.model, "g0")
    turn = 2.0 * np.pi * np.arange(300) / 300
    balance = play(ring, 0.4 * np.sin(turn)[:, None])
    assert balance.heat > 0.1
    assert missing(balance) < 1e-2


@pytest.mark.parametrize(
    ("geoms", "inside", "joints"),
    [
        (("sphere",), (False,), ("slide", "ball", "hinge")),
        (("cylinder",), (False,), ("ball", "free", "none")),
        (("sphere",), (True,), ("free", "hinge", "none")),
        (("cylinder",), (True,), ("hinge", "ball", "slide")),
        (
            ("cylinder", "sphere"),
            (False, True),
            ("none", "slide", "free", "hinge", "hinge"),
        ),
    ],
)
def test_work_is_stored_or_heat_and_torques_are_virtual_work(
    geoms: tuple[str, ...], inside: tuple[bool, ...], joints: tuple[str, ...]
) -> None:
    bent = mechanism(1, geoms, inside, joints)
    coarse, fine = (
        play(bent, loop(bent.model, 1, steps), test_every=60) for steps in (120, 360)
    )
    assert fine.jump < 1e-6
    assert fine.work > fine.stored
    assert missing(fine) < 1e-3
    # Cable that a geom carries over nodes shorter than a step loses a trace: of the
    # first case 3.5e-4 with 360 steps, 1.1e-4 with 1080 and 3.8e-5 with 3240. With 120
    # errors of two signs cancel.
    assert missing(fine) < 0.5 * missing(coarse) + 2e-4
    assert fine.torques < 1e-6


@pytest.mark.parametrize("strain", study_but(2, [0.005, 0.05, 0.2]))
@pytest.mark.parametrize("kind", KINDS)
def test_a_cable_that_drums_wind_gives_out_no_work(kind: str, strain: float) -> None:
    """With 1000 steps a turn, as of 1 s at 1 ms."""
    rope = wound(kind, strain)
    coarse, fine = (play(rope, loop(rope.model, 1, steps)) for steps in (500, 1000))
    assert fine.work > fine.stored
    assert missing(fine) < 1e-3
    assert missing(fine) < 0.6 * missing(coarse) + 1e-6


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("strain", [0.005, 0.05, 0.2])
def test_a_drum_and_its_load_led_round_a_loop_heat_what_they_are_given(
    strain: float, sense: float
) -> None:
    """The load pulls most as the drum winds, or as it pays out; nothing else rubs."""
    rope = wound("straight", strain)
    turn = 2.0 * np.pi * np.arange(500) / 500
    paid = 0.05 * np.sin(sense * turn)
    poses = np.zeros((500, rope.model.nq))
    poses[:, rope.model.joint("w").qposadr[0]] = -paid / 0.02
    eased = 0.2 * strain * (1.0 - np.cos(turn))
    poses[:, rope.model.joint("load").qposadr[0]] = paid + eased
    balance = play(rope, poses)
    assert balance.work > 0.0
    assert missing(balance) < 1e-5
    heat = heat_of_a_drum(100.0 / strain, strain, np.append(paid, 0.0), eased)
    assert balance.heat == pytest.approx(heat, rel=5e-2)


CLAMPS = {"clamp_creep_proximal": 1e-4, "clamp_creep_distal": 1e-5}
SPRINGS = {
    "end_compliance": 3e-5, "end_hardening": 0.02, "end_loss": 0.2,
    "proximal_compliance": 2e-5, "proximal_hardening": 0.01,
}  # fmt: skip
PLAY = {"clearance": 1e-3, "seating_tension": 20.0}
SLACK_AND_TAUT = {"conduit": "0.2:0.4:0.5:2 0.3:0.3", "bedding_strain": 0.01}


@pytest.mark.parametrize("strain", [0.05, 0.2])
@pytest.mark.parametrize(
    ("kind", "terms"),
    [
        ("band", {"bristle_length": 3e-4}),
        ("winch", {"bristle_length": 3e-3}),
        ("winch", {"bristle_length": 3e-4, "bedding_strain": 0.01}),
        ("mouth", {"bristle_length": 3e-4}),
        ("mouth", CLAMPS),
        ("mouth", CLAMPS | {"bedding_strain": 0.01, "bedding_tension": 10.0}),
        ("mouth", {"stress_relaxation": 0.5, "relaxation_time": 1.0}),
    ],
    ids=str,
)
def test_the_heat_of_presliding_and_creep_is_counted(
    kind: str, terms: dict[str, float], strain: float
) -> None:
    rope = wound(kind, strain, **terms)
    balance = play(rope, loop(rope.model, 1, 1000))
    assert missing(balance) < 1e-4


@pytest.mark.parametrize("strain", [0.01, 0.2])
@pytest.mark.parametrize(
    ("kind", "terms"),
    [
        ("band", {"end_compliance": 3e-5}),
        ("band", SPRINGS),
        ("winch", SPRINGS),
        ("winch", {"end_compliance": 3e-5, "end_loss": 0.4}),
        ("mouth", PLAY),
        ("mouth", PLAY | SLACK_AND_TAUT),
        ("mouth", PLAY | SPRINGS),
    ],
    ids=str,
)
def test_soft_ends_and_clearance_store_work_or_turn_it_to_heat(
    kind: str, terms: dict[str, float], strain: float
) -> None:
    """To an error that falls with the step; their stretch is of the stretched path."""
    rope = wound(kind, strain, **terms)
    coarse, fine = (play(rope, loop(rope.model, 1, steps)) for steps in (500, 2000))
    assert fine.work > fine.stored
    assert missing(coarse) < 5e-5
    assert missing(fine) < 0.4 * missing(coarse) + 2e-7


@pytest.mark.study
@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("term", ["none", "bristles", "clamps", "relaxation"])
@pytest.mark.parametrize("kind", ["band", *KINDS])
def test_the_heat_of_any_presliding_and_creep_is_counted(
    kind: str, term: str, seed: int
) -> None:
    """To an error that falls with the square of the step, also through slack."""
    random = np.random.default_rng([seed, 5])
    strain, friction = random.choice([0.005, 0.05, 0.2]), random.choice([0.05, 0.3, 1])
    size = random.choice([0.5, 1.0, 2.0])
    terms: dict[str, float] = {}
    if term == "bristles":
        terms = {"bristle_length": 10 ** random.uniform(-4.0, -2.5)}
    elif term == "relaxation":
        terms = {
            "stress_relaxation": random.uniform(0.1, 1.0),
            "relaxation_time": 10 ** random.uniform(-1.0, 1.0),
        }
    elif term == "clamps":
        if kind != "mouth":
            pytest.skip("only a conduit has clamps")
        terms = {
            "clamp_creep_proximal": 10 ** random.uniform(-6.0, -2.0),
            "clamp_creep_distal": 10 ** random.uniform(-6.0, -2.0),
            "clamp_force": random.choice([0.0, 10.0, 50.0, 95.0]),
        }
    rope = wound(kind, float(strain), float(friction), **terms)
    coarse, fine = (
        play(rope, loop(rope.model, seed, steps, size), parts=30)
        for steps in (1000, 2000)
    )
    assert abs(fine.work - fine.stored - fine.heat) < 1e-4 * fine.gross
    assert missing(fine) < 0.4 * missing(coarse) + 2e-5


@pytest.mark.study
@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("kind", KINDS)
def test_no_closed_motion_of_drums_gives_out_work(kind: str, seed: int) -> None:
    random = np.random.default_rng([seed, 11])
    strain, friction = 10 ** random.uniform(-2.5, -0.7), random.uniform(0.05, 1.0)
    rope = wound(kind, strain, friction)
    size = random.uniform(0.3, 2.0)
    coarse, fine = (
        play(rope, loop(rope.model, seed, steps, size)) for steps in (500, 2000)
    )
    assert fine.work >= fine.stored - 1e-5 * fine.gross
    slight = max(1e-3 * fine.heat, 1e-5 * fine.gross)
    assert abs(fine.work - fine.stored - fine.heat) < slight
    assert missing(fine) < 0.6 * missing(coarse) + 1e-4


@pytest.mark.study
@pytest.mark.parametrize("seed", range(200))
@pytest.mark.parametrize(("friction", "size"), [(0.05, 1.0), (0.3, 2.0), (1.5, 1.0)])
def test_no_closed_motion_gives_out_work(
    seed: int, friction: float, size: float
) -> None:
    """The whole class; motions through which MuJoCo's path jumps are passed over."""
    bent = drawn(seed, friction=friction)
    coarse, fine = (
        play(bent, loop(bent.model, seed, steps, size), test_every=100)
        for steps in (200, 800)
    )
    if max(coarse.jump, fine.jump) > 1e-4:
        pytest.skip("MuJoCo leads the path another way within a step")
    assert fine.work >= fine.stored - 1e-5 * fine.gross
    # Where the heat is less than a hundredth of what goes in and out, by that part.
    slight = max(1e-2 * fine.heat, 1e-4 * fine.gross)
    assert abs(fine.work - fine.stored - fine.heat) < slight + 1e-12
    assert missing(fine) < 0.5 * missing(coarse) + 1e-3
    assert fine.torques < 1e-3
