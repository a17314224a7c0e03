"""BIC on refits by simulation."""

from __future__ import annotations

from collections.abc import Callable

from baselines import METHODS, installed
from baselines.methods import bic
from cc_mujoco.diagnosis import BaselineFit

IDS = ("viscous_friction", "joint_gravity", "motor_inertia")


def test_the_hidden_effect_has_the_lowest_bic(
    baseline_fit: Callable[..., BaselineFit],
) -> None:
    rig = baseline_fit({"viscous_friction": {"viscous_friction": 60.0}})
    guess = bic(rig, ids=IDS)
    assert guess.named == "viscous_friction"
    assert set(guess.ranking) == set(IDS)
    assert guess.share > 0.5


def test_parameters_have_their_price(baseline_fit: Callable[..., BaselineFit]) -> None:
    guess = bic(baseline_fit({}), ids=IDS)
    assert guess.named is None
    assert abs(guess.share) < 0.02


def test_every_way_can_run_but_for_what_is_not_installed() -> None:
    assert set(METHODS) - set(installed()) <= {"sparse"}


def test_the_residual_of_a_tuning_is_what_is_regressed(
    baseline_fit: Callable[..., BaselineFit],
) -> None:
    rig = baseline_fit({"viscous_friction": {"viscous_friction": 60.0}})
    guess = METHODS["binned"](rig)
    assert guess.named in ("viscous_friction", "stribeck_friction")
