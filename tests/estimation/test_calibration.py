"""Fits find the truth, say how sure they are, and say what they cannot know."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section, Transmission
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.estimation import Measurement, calibrate

CABLE = Cable(friction=0.05, pretension=20.0, conduit=(Section(1.0, 0.3),), segments=12)
TIME = np.arange(0.0, 3.0, 0.01)
NOISE = 1e-3


def rig(cable: Cable) -> Transmission:
    return Transmission.pull_pull(cable, 0.02, 0.05)


def trial(seed: int, memory: float = 0.0, cable: Cable = CABLE) -> Measurement:
    """Return a trial with motor torque, joint motion and noise of the given memory."""
    inputs = {
        "motor_torque": 0.25 * np.sin(5.0 * TIME),
        "joint_angle": 0.2 * np.sin(3.0 * TIME),
    }
    found = rig(cable).replay(0.01, **inputs)
    noise = np.random.default_rng(seed).standard_normal((2, TIME.size))
    for row in range(1, TIME.size):
        fresh = np.sqrt(1.0 - memory**2) * noise[:, row]
        noise[:, row] = memory * noise[:, row - 1] + fresh
    outputs = {
        "joint_torque": found.joint_torque + 4.0 * NOISE * noise[0],
        "motor_angle": found.motor_angle + NOISE * noise[1],
    }
    sigma = {"joint_torque": 4.0 * NOISE, "motor_angle": NOISE}
    return Measurement(0.01, inputs, outputs, sigma)


def test_a_fit_from_wrong_values_finds_the_truth() -> None:
    guess = CABLE.replace(friction=0.15, axial_stiffness=9000.0)
    found = calibrate([trial(0)], rig(guess), ("friction", "axial_stiffness"))
    for name in ("friction", "axial_stiffness"):
        truth = getattr(CABLE, name)
        assert found[name].value == pytest.approx(truth, rel=0.02)
        assert found[name].holds(found[name].value)
        fitted = [getattr(cable, name) for cable in found.transmission.cables]
        assert fitted == [found[name].value] * 2
    assert found.misfit["joint_torque"] == pytest.approx(1.0, abs=0.15)
    assert found.undetermined == ()
    assert "friction" in str(found)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_intervals_cover_also_where_noise_has_a_memory(memory: float) -> None:
    held = np.zeros(2)
    for seed in range(5):
        found = calibrate(
            [trial(seed, memory)], rig(CABLE), ("friction", "axial_stiffness"), starts=0
        )
        for place, name in enumerate(("friction", "axial_stiffness")):
            held[place] += found[name].holds(getattr(CABLE, name))
    assert np.all(held >= 4)


def torque_trial() -> Measurement:
    """Both angles are led, the motor's torque is measured."""
    inputs = {
        "motor_angle": 0.4 * np.sin(5.0 * TIME),
        "joint_angle": 0.2 * np.sin(3.0 * TIME),
    }
    noise = NOISE * np.random.default_rng(0).standard_normal(TIME.size)
    torque = rig(CABLE).replay(0.01, **inputs).motor_torque + noise
    return Measurement(0.01, inputs, {"motor_torque": torque}, {"motor_torque": NOISE})


@pytest.mark.parametrize("recorded", [trial(0), torque_trial()])
def test_friction_and_wrap_are_known_as_their_product_alone(
    recorded: Measurement,
) -> None:
    guess = CABLE.replace(friction=0.1)
    found = calibrate([recorded], rig(guess), ("friction", "wrap"))
    product = found["friction"].value * found["wrap"].value
    assert product == pytest.approx(CABLE.friction, rel=0.02)
    (sentence,) = found.undetermined
    assert "friction by k^1 and wrap by k^-1" in sentence
    low, high = found["friction"].ci95
    assert high > 2.0 * low


def test_pretension_trades_with_friction_until_a_cable_goes_slack() -> None:
    names = ("friction", "pretension")
    taut = calibrate([trial(0)], rig(CABLE), names, starts=0)
    assert taut.correlation[0, 1] < -0.9
    loose = CABLE.replace(pretension=4.0)
    slack = calibrate([trial(0, cable=loose)], rig(loose), names, starts=0)
    assert slack.correlation[0, 1] > taut.correlation[0, 1]


def test_a_missing_term_shows_as_misfit_and_widens_intervals() -> None:
    thick = trial(0, cable=CABLE.replace(viscous_friction=60.0))
    with pytest.warns(CableWarning, match="so its intervals do not hold"):
        found = calibrate([thick], rig(CABLE), ("friction",), starts=0)
    assert "no interval holds" in str(found)
    right = calibrate([trial(0)], rig(CABLE), ("friction",), starts=0)
    assert max(found.misfit.values()) > 2.0
    width = [np.ptp(np.log(f["friction"].ci95)) for f in (found, right)]
    assert width[0] > 3.0 * width[1]
    start = CABLE.replace(viscous_friction=20.0)
    mended = calibrate([thick], rig(start), ("friction", "viscous_friction"), starts=0)
    assert mended["viscous_friction"].value == pytest.approx(60.0, rel=0.1)


def test_bad_input_is_one_sentence() -> None:
    good = trial(0)
    with pytest.raises(CableError, match="unknown parameter 'frictoin'"):
        calibrate([good], rig(CABLE), ("frictoin",))
    with pytest.raises(CableError, match="starts at 0"):
        calibrate([good], rig(CABLE), ("viscous_friction",))
    with pytest.raises(CableError, match="at least one trial"):
        calibrate([], rig(CABLE), ("friction",))
    with pytest.raises(CableError, match="did you mean 'joint_torque'"):
        dataclasses.replace(good, outputs={"joint_tork": TIME})
    with pytest.raises(CableError, match="other than these"):
        dataclasses.replace(good, outputs={"joint_angle": TIME})
    with pytest.raises(CableError, match="same number"):
        dataclasses.replace(good, outputs={"joint_torque": TIME[1:]})
    with pytest.raises(CableError, match="greater than 0"):
        dataclasses.replace(good, noise={"joint_torque": 1.0})
    with pytest.raises(CableError, match="is nan; it must be finite"):
        dataclasses.replace(
            good,
            outputs={"joint_torque": np.full_like(TIME, np.nan)},
            noise={"joint_torque": 1.0},
        )
