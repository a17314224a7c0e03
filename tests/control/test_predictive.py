"""Plans: a reversal crossed in one move, delay, swing and what must be known."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.benchmark import SUITES, Cell, Condition, play
from cc_mujoco.benchmark._cell import prepare_episodes
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import AdaptiveModel, CableModel, PredictiveCompensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._cable_model import joint_spring
from cc_mujoco.control._controller import motor_limits
from cc_mujoco.control._predictive import filter_gains, optimal_plan
from cc_mujoco.device import Sensing, Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.export import Limb
from cc_mujoco.export import play as wear
from cc_mujoco.simulation import Single, run
from control.devices import kept, pull_pull, single

WRIST, ANKLE, EXOSUIT = (
    {condition.name: condition for condition in SUITES[suite].conditions(scene)}
    for suite, scene in (("v1", "wrist"), ("v1", "ankle"), ("generic", "exosuit"))
)

STRUCTURE = {one.name: one for one in SUITES["v2"].conditions("wrist")}


def scores(law: str, condition: Condition, duration: float) -> dict[str, float]:
    short = dataclasses.replace(condition, duration=duration)
    return {name: float(v[0]) for name, v in play(Cell(short, law)).scores.items()}


def test_a_plan_reaches_what_it_wants_and_leaves_early() -> None:
    span = 0.003
    gains = optimal_plan(30, span, 150.0)
    wanted = np.where(np.arange(1, 31) > 15, 1.0, 0.0)
    push = gains[:, 2:] @ wanted
    velocity = np.concatenate([[0.0], np.cumsum(push) * span])
    angle = np.cumsum(span * velocity[:-1] + 0.5 * span**2 * push)
    assert angle[-1] == pytest.approx(1.0, abs=0.02)
    assert angle[0] == pytest.approx(0.0, abs=0.02)
    assert 0.25 < angle[14] < 0.75
    # At rest where it shall be it stays; a motion that goes on needs no push.
    assert gains @ np.concatenate([[2.0, 0.0], np.full(30, 2.0)]) == pytest.approx(
        0.0, abs=1e-9
    )
    going = np.concatenate([[0.0, 1.0], span * np.arange(1, 31)])
    assert gains @ going == pytest.approx(0.0, abs=1e-6)


def test_the_filter_of_motion_has_no_lag_under_constant_acceleration() -> None:
    a, b, c = filter_gains(0.2)
    value, rate, half = 0.0, 0.0, 0.0
    for step in range(1, 200):
        value, rate = value + rate + half, rate + 2.0 * half
        off = 0.5 * 0.01 * step**2 - value
        value, rate, half = value + a * off, rate + b * off, half + c * off
    assert rate == pytest.approx(0.01 * 199, rel=1e-6)


def test_reversals_at_the_wrist_are_crossed_in_quiet_moves() -> None:
    found, usual = (
        scores(law, WRIST["reversals"], 1.6) for law in ("predictive", "stiction")
    )
    assert found["rms_torque_error"] < 0.5 * usual["rms_torque_error"]
    assert found["chatter"] < 0.2 * usual["chatter"]
    assert found["failed"] == 0.0


def test_the_delay_of_the_sensors_is_found_by_what_moved_the_motor() -> None:
    """It is told of one step; at five it would swing at the motor's limits."""
    slow = dataclasses.replace(ANKLE["delay-long"], delay=(5, 5))
    found = scores("predictive", slow, 1.6)
    none = scores("none", slow, 1.6)
    assert found["rms_torque_error"] < 0.5 * none["rms_torque_error"]
    assert found["chatter"] < 2.0


@pytest.mark.parametrize("wrong", [-0.3, pytest.param(0.3, marks=pytest.mark.study)])
def test_late_sensors_and_a_wrong_inertia_together_do_not_swing(wrong: float) -> None:
    slow = dataclasses.replace(ANKLE["ordinary-rough"], delay=(10, 10), duration=1.6)
    made = prepare_episodes([Cell(slow, "predictive", seeds=(0,))])
    ((known,),) = made.drives
    drive = dataclasses.replace(known, inertia=(1.0 + wrong) * known.inertia)
    torques: list[float] = []
    run(
        made.batch,
        PredictiveCompensation(drive),
        lambda step, columns, torque: torques.append(float(torque[0])),
        measure=made.sensors.measure,
    )
    assert np.ptp(torques) < 40.0
    assert np.std(np.diff(torques)) < 2.0


def test_passive_wearers_who_hold_still_are_left_still() -> None:
    """Without the damper that spends energy they get 29 mJ, and one 0.37 rad/s."""
    places = [(8.0, 0.15, 1.2e-4), (12.0, 0.09, 5.8e-3), (12.0, 0.15, 3e-3)]
    wearers = [Limb(*place) for place in (*places, (8.0, 0.09, 3e-3))]
    found = wear("wrist", "predictive", "spring", wearers)
    assert np.sum(found.held) < 8e-3
    assert np.max(found.velocity) < 0.2


def test_friction_that_builds_up_is_found_and_not_crossed_as_a_backlash() -> None:
    """It was: the motor turned 95 times in 2 s, with an error of 0.46 N m."""
    found = scores("predictive", STRUCTURE["structure-presliding"], 1.3)
    assert found["rms_torque_error"] < 0.1
    assert found["chatter"] < 0.15


def test_where_friction_is_at_once_no_bristles_are_believed() -> None:
    short = dataclasses.replace(STRUCTURE["ordinary-rough"], duration=1.1)
    made = prepare_episodes([Cell(short, "predictive", seeds=(0,))])
    law: Any = made.law
    run(made.batch, law, measure=made.sensors.measure)
    memory = kept(law)
    assert memory[planner_memory.BRISTLED] == 0.0
    errors = memory[planner_memory.MODEL_ERROR :][:2]
    assert 0.0 < errors[0] < errors[1]


@pytest.mark.study
@pytest.mark.parametrize(
    ("suite", "scene"), [("v1", "wrist"), ("v1", "ankle"), ("generic", "finger")]
)
def test_a_right_model_is_better_than_a_rough_one(suite: str, scene: str) -> None:
    """The torque sensor has a bias, and both models meet the same 20 plants.

    Errors were 0.0232 and 0.0284, 0.437 and 0.459, 0.0021 and 0.0022 N m.
    """
    known = {one.name: one for one in SUITES[suite].conditions(scene)}
    right, rough = (
        play(Cell(known[name], "predictive", tuple(range(20)))).scores
        for name in ("ordinary-exact", "ordinary-rough")
    )
    assert np.mean(right["rms_torque_error"]) < np.mean(rough["rms_torque_error"])


def test_a_crossing_that_went_too_far_is_not_crossed_again_and_again() -> None:
    """Behind a cuff the motor crossed the backlash 12 times in a second, for 0.08."""
    worn = dataclasses.replace(STRUCTURE["structure-cuff"], duration=1.6)
    found = play(Cell(worn, "predictive", seeds=(1, 2))).scores
    assert max(found["rms_torque_error"]) < 0.05


@pytest.mark.study
def test_a_delay_leaves_adaptive_far_better_than_no_model() -> None:
    late = WRIST["delay-long"]
    found, usual = (scores(name, late, 1.3) for name in ("adaptive", "pi"))
    assert found["rms_torque_error"] < 0.4 * usual["rms_torque_error"]


def test_the_ankle_is_let_go_in_swing_and_taut_when_it_pushes_off() -> None:
    walking = ANKLE["ordinary-rough"]
    found, usual = (scores(law, walking, 1.6) for law in ("predictive", "pi"))
    assert found["failed"] == 0.0
    assert found["rms_torque_error"] < 0.7 * usual["rms_torque_error"]


@pytest.mark.study
def test_a_cable_over_two_joints_is_paid_out_and_drawn_in_with_both() -> None:
    """With the hip's angle alone the error was that of an unplugged device."""
    walking = EXOSUIT["ordinary-rough"]
    found, none = (scores(law, walking, 1.6) for law in ("predictive", "none"))
    error = "hip.rms_torque_error"
    assert found[error] < 0.25 * none[error]


def errors_with_and_without(terms: dict[str, float], **settings: float) -> list[float]:
    """Return the errors at a wrist with these terms, known to the plan and unknown."""
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    plain: dict[str, float] = {}
    for name, cable in plugin.from_mjcf(spec).items():
        plain = {term: getattr(cable, term) for term in terms}
        plugin.to_mjcf(spec, name, cable.replace(**terms))
    env = gymnasium.make(
        "cc_mujoco/WristHandle-v1", model=spec.compile(), trajectory="multisine",
        duration=1.5,
    )  # fmt: skip
    told = env.unwrapped.drive
    untold = dataclasses.replace(
        told,
        cables=tuple(
            dataclasses.replace(one, cable=one.cable.replace(**plain))
            for one in told.cables
        ),
    )
    errors = []
    for drive in (told, untold):
        kept: list[float] = []

        def keep(
            step: int, columns: Any, torque: Any, kept: list[float] = kept
        ) -> None:
            kept.append(columns["joint_torque_nm"] - columns["desired_torque_nm"])

        run(Single(env, seed=0), PredictiveCompensation(drive, **settings), keep)
        errors.append(float(np.std(kept[300:])))
    return errors


@pytest.mark.parametrize(
    ("term", "size"),
    [
        pytest.param("viscous_friction", 10.0, marks=pytest.mark.study),
        pytest.param("grease_drag", 3.0, marks=pytest.mark.study),
    ],
)
def test_who_is_told_of_drag_does_better_by_it(term: str, size: float) -> None:
    """A plan that leaps within a knot felt the drag of the leap, and shied from it."""
    # Caution costs more than a term that is told saves, as the model is exact.
    known, unknown = errors_with_and_without({term: size}, caution=0.0)
    assert known < 0.6 * unknown


@pytest.mark.study
def test_who_is_told_of_break_away_does_better_by_it() -> None:
    known, unknown = errors_with_and_without(
        {"static_friction": 0.4, "critical_slip_distance": 2e-3}
    )
    assert known < 0.6 * unknown


@pytest.mark.study
def test_who_is_told_of_friction_that_falls_does_no_worse() -> None:
    """A plan that fed it forward let the joint go, too far, and hunted."""
    known, unknown = errors_with_and_without(
        {
            "stribeck_friction": 0.05,
            "ageing_friction": 0.03,
            "critical_slip_distance": 1e-3,
        }
    )
    assert known <= unknown


@pytest.mark.study
def test_joints_that_share_tendons_are_kept_from_swinging() -> None:
    """With the damper of a joint that has a cable of its own the error was 0.023."""
    hand = {one.name: one for one in SUITES["generic"].conditions("hand")}
    found = scores("decoupled_predictive", hand["ordinary-rough"], 1.1)
    assert found["rms_torque_error"] < 0.016


def test_a_biased_sensor_pays_out_no_slack() -> None:
    """Three standard deviations, as a pull that no paying out would end."""
    sensors = Sensing(torque_noise=0.3, tension_noise=3.0)
    still = dataclasses.replace(ANKLE["zero-torque"], duration=1.6)
    cell = Cell(still, "predictive", seeds=(0, 1, 2, 3), sensing=sensors)
    made = prepare_episodes([cell])
    law: Any = made.law
    slack = []

    def watch(step: int, columns: Any, torque: Any) -> None:
        slack.append(columns["least_tension_n"].copy())

    def biased(columns: Any) -> Any:
        seen = made.sensors.measure(columns)
        seen["joint_torque_nm"] = seen["joint_torque_nm"] - 0.9
        return seen

    run(made.batch, law, watch, measure=biased)
    # What is slack counts as a tension below 0, by the stiffness of the cable.
    stiffness = 1.2e5
    assert np.min(slack[500:]) > -0.002 * stiffness


@pytest.mark.study
@pytest.mark.parametrize("bias", [-2.0, 2.0])
def test_a_bias_is_told_from_friction_by_what_the_motor_feels(bias: float) -> None:
    """The error of whoever believes the sensor is its bias, 2 N m."""
    quiet = Sensing(torque_noise=0.3, tension_noise=3.0)
    plain = ANKLE["ordinary-exact"]
    walking = dataclasses.replace(plain, duration=6.0, delay=(1, 1), noise=0.0)
    made = prepare_episodes([Cell(walking, "predictive", seeds=(0,), sensing=quiet)])
    off = []

    def watch(step: int, columns: Any, torque: Any) -> None:
        off.append(columns["joint_torque_nm"][0] - columns["desired_torque_nm"][0])

    def biased(columns: Any) -> Any:
        seen = made.sensors.measure(columns)
        seen["joint_torque_nm"] = seen["joint_torque_nm"] + bias
        return seen

    run(made.batch, made.law, watch, measure=biased)
    assert np.sqrt(np.mean(np.square(off[4000:]))) < 0.3 * abs(bias)


@given(
    turned=st.floats(-1e-3, 1e-3),
    aimed=st.floats(0.0, 30.0),
    friction=st.floats(0.02, 0.3),
)
def test_a_motor_is_found_for_every_torque_that_a_cable_can_make(
    turned: float, aimed: float, friction: float
) -> None:
    """Paying out as well: it was given up where a step met the torque at once."""
    drive = single(friction)
    model = CableModel(drive)
    model.ready(np.zeros(1))
    cables = model.cables
    state, new = model.state[0].copy(), np.zeros_like(model.state[0])
    rise = joint_spring(drive.cables, motor_limits(drive))[guard.STIFFNESS]
    stepper.move(cables, state, turned, 0.0, 0.01, new, model.work)
    state[:] = new
    lack = aimed - rollout.joint_torque(cables, state, turned)
    for way in (1.0, -1.0):
        search = rollout.MotorSearch(
            cables, state, new, np.zeros_like(new), model.work, np.zeros(1), 0.01,
            rise, 0.05, 0.0, False,
        )  # fmt: skip
        found = rollout.find_motor_angle(search, turned, way, 0.0, 0.0, aimed)
        if lack * way > 0.06:
            assert (found - turned) * way > 0.0
            stepper.move(cables, state, found, 0.0, 0.01, new, model.work)
            assert rollout.joint_torque(cables, new, found) == pytest.approx(
                aimed, abs=0.3
            )
        elif lack * way < -0.06:
            assert found == turned


def test_what_it_needs_to_know_is_asked_for() -> None:
    drive = pull_pull()
    with pytest.raises(CableError, match=r"Drive\.inertia is 0"):
        PredictiveCompensation(drive)
    known = dataclasses.replace(drive, inertia=1e-4)
    for name in ("bandwidth", "horizon", "knots", "belief", "turning", "learning"):
        wrong: dict[str, Any] = {name: -1}
        with pytest.raises(CableError, match=name):
            PredictiveCompensation(known, **wrong)
    slow = dataclasses.replace(known, motor_lag=0.05)
    with pytest.raises(CableError, match="longer than the horizon"):
        PredictiveCompensation(slow)
    assert PredictiveCompensation(slow, horizon=0.1)
    with pytest.raises(CableError, match="tension sensors along every cable"):
        AdaptiveModel(known)
    sensors = (Sensors((0, 10), (0.1, 0.1)),) * 2
    assert AdaptiveModel(dataclasses.replace(known, sensors=sensors))
    unlike = sensors[0], Sensors((0, 5, 10), (0.1, 0.1, 0.1))
    with pytest.raises(CableError, match="as many along every cable, not 2, 3"):
        AdaptiveModel(dataclasses.replace(known, sensors=unlike))


@pytest.mark.study
def test_a_cable_that_is_believed_not_to_rub_is_learned_too() -> None:
    """A factor of nothing is no number: the torque was none from there on."""
    found = scores_of_belief(friction=0.0, duration=1.3)
    assert np.isfinite(found)
    assert found < 0.5


def scores_of_belief(friction: float, duration: float) -> float:
    """RMS error of `adaptive` at the wrist over that of `none` [-]."""
    short = dataclasses.replace(WRIST["ordinary-rough"], duration=duration)
    made = prepare_episodes([Cell(short, "adaptive", seeds=(0,))])
    ((drive,),) = made.drives
    cables = tuple(
        dataclasses.replace(
            one, cable=one.cable.replace(friction=friction, static_friction=0.0)
        )
        for one in drive.cables
    )
    law = AdaptiveModel(dataclasses.replace(drive, cables=cables))
    off: list[float] = []

    def watch(step: int, columns: Any, torque: Any) -> None:
        off.append(columns["joint_torque_nm"][0] - columns["desired_torque_nm"][0])

    run(made.batch, law, watch, measure=made.sensors.measure)
    error = float(np.sqrt(np.mean(np.square(off[500:]))))
    return error / scores("none", short, duration)["rms_torque_error"]


def test_sensors_tell_a_drive_how_late_and_noisy_they_are() -> None:
    told = Sensing(torque_noise=0.2, tension_noise=1.0, delay=7).equip(pull_pull())
    assert (told.delay, told.torque_noise) == (7, 0.2)


def test_each_environment_may_get_another_torque_than_was_planned() -> None:
    drive = dataclasses.replace(pull_pull(), inertia=1e-3)
    time = np.arange(60) * drive.period
    names = ("motor_angle_rad", "joint_angle_rad", "joint_torque_nm")
    seen = dict.fromkeys(names, 0.02 * np.sin(20.0 * time))
    seen["desired_torque_nm"] = np.sin(30.0 * time)

    def planned(got: list[float]) -> Any:
        law = PredictiveCompensation(drive)
        law.reset()
        ones = np.ones(len(got))
        for step in range(time.size):
            torque = law.torque({name: v[step] * ones for name, v in seen.items()})
            law.given(np.array(got))
        return torque

    both = planned([0.3, np.nan])
    assert both[0] == planned([0.3])[0]
    assert both[1] == planned([np.nan])[0]
    assert both[0] != both[1]


def test_a_path_that_is_given_counts_from_then_on() -> None:
    drive = dataclasses.replace(pull_pull(), inertia=1e-4)
    belief = drive.cables[0].cable
    own = [belief.wrap / belief.segments] * belief.segments
    read = {name: 0.0 for name in planner_memory.PLANNER_INPUTS}
    found = []
    for share in (None, 1.0, 3.0):
        law = PredictiveCompensation(drive)
        for step in range(20):
            if share is not None and step == 5:
                law.rebend([share * np.array(own)] * 2)
            read |= {"desired_torque_nm": 0.1 * step, "joint_angle_rad": 0.01 * step}
            torque = law.torque(read)
        found.append(torque)
    assert found[0] == found[1] != found[2]
    for angles, says in (
        ([np.zeros(9)] * 2, "shapes"),
        ([-np.array(own)] * 2, "0 or more"),
        ([np.nan * np.array(own)] * 2, "finite"),
    ):
        with pytest.raises(CableError, match=says):
            law.rebend(angles)
