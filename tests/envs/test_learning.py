"""Support for learning: history in observations, randomised plants, wrappers."""

from __future__ import annotations

import pickle
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.device import find_device
from cc_mujoco.device._observation import PLAY_HALF_WIDTHS
from cc_mujoco.envs import DeviceEnv
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from envs.test_vector import COUNT, WRIST, equal, march, pair

RANDOMISED = {
    "friction": (0.05, 0.2),
    "break_away": (1.0, 3.0),
    "extensor.pretension": (5.0, 15.0),
    "wrap": (5.0, 9.0),
    "wearer": (0.5, 2.0),
    "delay": (0, 3),
    "noise": (0.0, 2.0),
}
ALL: dict[str, Any] = {
    "trajectory": "multisine",
    "hold": 3,
    "history": 2,
    "memory": True,
    "randomise": RANDOMISED,
    "smoothness": 0.02,
}


def rolled(env: Any, steps: int = 60, **reset: Any) -> list[Any]:
    """Return the results of a reset and of steps with random actions."""
    random = np.random.default_rng(1)
    seen = [env.reset(seed=5, **reset)]
    for _ in range(steps):
        seen.append(env.step(random.uniform(-1, 1, 1).astype(np.float32)))
    return seen


def observations(env: Any, steps: int = 60, **reset: Any) -> np.ndarray:
    """Return the observations of `rolled`, (steps + 1, size)."""
    return np.array([row[0] for row in rolled(env, steps, **reset)])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_drawn_plants_are_the_same_bits_in_the_vector_environment(mode: str) -> None:
    given = {**ALL, "duration": 0.015}
    a = gymnasium.make_vec(WRIST, COUNT, threads=2, autoreset_mode=mode, **given)
    b = gymnasium.make_vec(
        WRIST,
        COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
        **given,
    )
    equal(a.reset(seed=3), b.reset(seed=3))
    if mode == "Disabled":
        assert march(a, b, 5) == COUNT
        chosen = np.array([True, False, True, True, False])
        options = {"reset_mask": chosen, "friction": 0.1}
        equal(a.reset(options=options), b.reset(options=options))
        return
    assert march(a, b, 16) >= 2 * COUNT
    # One that is given, after others that were drawn.
    options = {"friction": 0.1, "delay": 2}
    equal(a.reset(seed=8, options=options), b.reset(seed=8, options=options))
    march(a, b, 9)


def test_options_of_one_episode_are_the_same_bits_too(name: str) -> None:
    a, b = pair(name, 1, duration=0.02, history=1)
    equal(a.reset(seed=0), b.reset(seed=0))
    options = {"friction": 0.1, "static_friction": 0.15, "wearer": 0.5, "noise": 1.0}
    for given in (options, {"delay": 3}, None):
        equal(a.reset(options=given), b.reset(options=given))
        march(a, b, 6)


def test_an_option_is_what_the_physics_has() -> None:
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    for name, cable in plugin.from_mjcf(spec).items():
        thinner = cable.replace(friction=0.07, static_friction=0.14, pretension=12.0)
        plugin.to_mjcf(spec, name, thinner)
    wearer = DeviceEnv("wrist").exo.device.wearers["wrist"]
    softer = Wearer(0.5 * wearer.stiffness, 0.5 * wearer.damping)
    variant = DeviceEnv("wrist", model=spec.compile(), wearer=softer, duration=0.5)
    env = DeviceEnv("wrist", duration=0.5)
    options = {"friction": 0.07, "break_away": 2.0, "pretension": 12.0, "wearer": 0.5}
    usual = rolled(env)
    changed = rolled(env, options=options)
    assert not np.array_equal(usual[-1][0], changed[-1][0])
    for one, other in zip(changed, rolled(variant), strict=True):
        assert np.array_equal(one[0], other[0])
        assert one[-1]["dissipated_flexor_j"] == other[-1]["dissipated_flexor_j"]
    for one, other in zip(usual, rolled(env), strict=True):
        assert np.array_equal(one[0], other[0]), "something of the plant stayed"


def test_break_away_friction_follows_friction_unless_it_is_given() -> None:
    env = DeviceEnv("wrist", duration=0.1)
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    nominal = plugin.from_mjcf(spec)["flexor"]
    ratio = nominal.static_friction / nominal.friction
    alike = rolled(env, options={"friction": 0.07})
    same = rolled(env, options={"friction": 0.07, "break_away": ratio})
    other = rolled(env, options={"friction": 0.07, "break_away": 1.0})
    for one, two in zip(alike, same, strict=True):
        assert np.array_equal(one[0], two[0])
    assert not np.array_equal(alike[-1][0], other[-1][0])


def test_what_is_said_of_one_cable_counts_more_than_what_is_said_of_all() -> None:
    env = DeviceEnv("wrist", duration=0.1)
    said = {"flexor.friction": 0.02, "friction": 0.09}
    for options in (said, dict(reversed(said.items()))):
        env.reset(seed=0, options=options)
        assert env.plant.cables["flexor"].friction == 0.02
        assert env.plant.cables["extensor"].friction == 0.09


def test_a_wrap_is_the_bend_of_the_whole_conduit() -> None:
    env = DeviceEnv("wrist", duration=0.1)
    env.reset(seed=0, options={"flexor.wrap": 9.0})
    assert env.plant.cables["flexor"].wrap == pytest.approx(9.0)
    nominal = env.exo.plants.nominal.cables
    assert env.plant.cables["flexor"].length == nominal["flexor"].length
    assert env.plant.cables["extensor"] == nominal["extensor"]
    assert plugin.from_mjcf(env.model) == env.plant.cables


def test_plants_are_drawn_from_the_seed_and_lie_in_the_ranges() -> None:
    env = DeviceEnv("wrist", duration=0.1, randomise=RANDOMISED)
    found = []
    for seed in (1, None, None, 1, None):
        env.reset(seed=seed)
        found.append(dict(env.plant.values))
    assert found[0] == found[3]
    assert found[1] == found[4]
    assert len({values["flexor.friction"] for values in found}) == 3
    for values in found:
        assert values["flexor.friction"] != values["extensor.friction"]
        assert "flexor.pretension" not in values
        assert isinstance(values["delay"], int)
        for name, value in values.items():
            low, high = RANDOMISED.get(name) or RANDOMISED[name.split(".")[1]]
            assert low <= value <= high
    env.reset(seed=1, options={"flexor.friction": 0.05, "wearer": 1.5})
    assert env.plant.values == {**found[0], "flexor.friction": 0.05, "wearer": 1.5}
    assert pickle.loads(pickle.dumps(env)).exo.plants.varied == env.exo.plants.varied


def test_delayed_observations_are_those_of_earlier_samples() -> None:
    env = DeviceEnv("wrist", duration=0.5, trajectory="chirp")
    now = observations(env)
    for delay in (1, 7, 50):
        late = observations(env, options={"delay": delay})
        assert np.array_equal(late[delay:], now[: len(now) - delay])
        assert np.array_equal(late[:delay], now[:1].repeat(delay, axis=0))


def test_noise_is_that_of_the_torque_sensor_with_a_bias() -> None:
    env = DeviceEnv("wrist", duration=2.0)
    clean = observations(env, 1500)
    noisy = observations(env, 1500, options={"noise": 2.0})
    error = clean - noisy  # of the desired torque less that which is measured
    assert not error[:, [0, 1, 2, 3, 5]].any()
    deviation = 2.0 * find_device("wrist").description.sensing.torque_noise
    assert np.std(error[:, 4]) == pytest.approx(deviation, rel=0.1)
    assert 0.01 * deviation < abs(error[:, 4].mean()) < 6.0 * deviation


def test_an_action_is_held_for_its_samples() -> None:
    held = DeviceEnv("wrist", duration=0.2, hold=5, trajectory="multisine")
    each = DeviceEnv("wrist", duration=0.2, trajectory="multisine")
    random = np.random.default_rng(0)
    a, b = held.reset(seed=2), each.reset(seed=2)
    over, steps = False, 0
    while not over:
        assert np.array_equal(a[0], b[0])
        action = random.uniform(-1, 1, 1).astype(np.float32)
        a = held.step(action)
        rows = [each.step(action) for _ in range(5)]
        b = rows[-1]
        assert a[1] == pytest.approx(sum(row[1] for row in rows))
        assert a[-1]["time_s"] == pytest.approx(b[-1]["time_s"])
        over, steps = a[3], steps + 1
        assert over == b[3]
    assert steps == 40
    assert held.drive.period == held.exo.period == pytest.approx(0.005)


def test_the_history_is_what_was_seen_and_done() -> None:
    plain = DeviceEnv("wrist", duration=0.5, hold=2)
    env = DeviceEnv("wrist", duration=0.5, hold=2, history=3)
    now, seen = observations(plain, 20), observations(env, 20)
    random = np.random.default_rng(1)
    actions = random.uniform(-1, 1, (20, 1)).astype(np.float32)
    assert seen.shape == (21, 6 + 3 * 7)
    for step in range(21):
        past = seen[step, 6:].reshape(3, 7)
        assert np.array_equal(seen[step, :6], now[step])
        for back, (*frame, action) in enumerate(past, start=1):
            at = step - back
            assert np.array_equal(frame, now[max(at, 0)])
            assert action == (actions[at] if at >= 0 else 0.0)


def test_the_memory_is_that_of_plays_at_motor_and_joint() -> None:
    env = DeviceEnv("wrist", duration=1.0, memory=True, trajectory="chirp")
    rows = rolled(env, 800)
    ratio, unit = (
        env.drive.ratio,
        find_device("wrist").description.axis().units["motor_angle_rad"],
    )
    for place, (column, scale) in enumerate(
        [("motor_angle_rad", ratio), ("joint_angle_rad", 1.0)]
    ):
        angle = np.array([row[-1][column] for row in rows]) / scale
        for width, play in enumerate(PLAY_HALF_WIDTHS):
            reach, p = play * unit, angle[0]
            told = [row[0][6 + 3 * place + width] for row in rows]
            for x, found in zip(angle, told, strict=True):
                p = x - reach if x - p > reach else x + reach if p - x > reach else p
                assert found == pytest.approx((x - p) / reach, abs=1e-5)
        assert np.ptp(told) > 1.0


def test_a_probability_leaves_the_other_episodes_as_the_scene_has_them() -> None:
    given = {"bristle_length": (1e-3, 1e-2, 0.3), "friction": (0.1, 0.2)}
    env = DeviceEnv("wrist", duration=0.1, randomise=given)
    lengths = []
    for seed in range(300):
        env.reset(seed=seed)
        cables = env.plant.cables.values()
        lengths.append([cable.bristle_length for cable in cables])
        assert all(0.1 <= cable.friction <= 0.2 for cable in cables)
    one, other = np.array(lengths).T
    assert np.array_equal(one > 0.0, other > 0.0)  # of all cables or of none
    assert (one != other)[one > 0.0].all()
    assert 1e-3 <= one[one > 0.0].min() and one.max() <= 1e-2
    assert np.mean(one > 0.0) == pytest.approx(0.3, abs=0.08)
    whole = DeviceEnv("wrist", randomise={"friction": (0.1, 0.2, 1.0)})
    plain = DeviceEnv("wrist", randomise={"friction": (0.1, 0.2)})
    for each in (whole, plain):
        each.reset(seed=3)
    assert whole.plant == plain.plant


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"friction": (0.1, 0.2, 1.5)}, r"'friction'..2. must be a number in .0, 1."),
        ({"friction": (0.1, 0.2, 0.5, 0.5)}, "or .least, most, probability."),
        ({"frictoin": (0.1, 0.2)}, "did you mean 'friction'"),
        ({"flexxor.friction": (0.1, 0.2)}, "unknown cable or axis 'flexxor'"),
        ({"friction": 0.1}, "must be .least, most."),
        ({"friction": "abc"}, "must be .least, most."),
        ({"friction": (0.2, 0.1)}, "the lower number first, not"),
        ({"friction": (np.array([0.1]), 0.2)}, "must be a number"),
        ({"friction": (0.1, np.nan)}, "number"),
        ({"friction": (0.1, 3.0)}, "cable 'flexor': break-away .*static_friction"),
        (
            {"friction": (0.1, 0.7), "static_friction": (0.5, 0.6)},
            "cable 'flexor': .*static_friction",
        ),
        ({"friction": (-0.1, 0.1)}, r"'friction'. must be a number in .0, 5."),
        ({"delay": (0, 2.5)}, "whole number"),
        ({"delay": (0, 1001)}, "0, 1000"),
        ({"wearer": (0, 1)}, "wearer"),
        ({"noise": (-1, 1)}, "noise"),
        ({"pretension": (5.0, 1e5)}, "'flexor' .* below the breaking load of 265 N"),
        ({"noise": ("a", "b")}, "noise"),
        ({"wrap": (-1.0, 1.0)}, "wrap"),
        ({"break_away": (1, 2), "static_friction": (0.6, 0.7)}, "set the same thing"),
        ("all", "must be a dictionary"),
    ],
)
def test_ranges_that_make_no_plant_are_one_sentence(given: Any, message: str) -> None:
    with pytest.raises(CableError, match=message) as raised:
        DeviceEnv("wrist", randomise=given)
    assert str(raised.value).endswith((".", "?"))
    assert not str(raised.value).endswith("..")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"friction": "low"}, "must be a number"),
        ({"friction": 5.5}, r"'friction'. must be a number in .0, 5."),
        ({"friction": np.array([0.1])}, "must be a number"),
        ({3: 0.1}, "texts as names, not 3"),
        ({"reset_mask": np.ones(1, dtype=np.bool_)}, "unknown variation"),
        ({"delay": True}, "number"),
        ({"pretension": 265.0}, "below the breaking load of 265 N"),
        ([1], "must be a dictionary"),
    ],
)
def test_options_that_make_no_plant_are_one_sentence(
    options: Any, message: str
) -> None:
    with pytest.raises(CableError, match=message):
        DeviceEnv("wrist").reset(options=options)


def test_what_an_open_tendon_does_not_have_cannot_be_varied() -> None:
    with pytest.raises(CableError, match="'wrap' cannot be varied for cable 'extensor"):
        gymnasium.make("cc_mujoco/TendonFinger-v1", randomise={"wrap": (1.0, 2.0)})


def test_a_model_without_room_for_other_cables_says_so() -> None:
    env = DeviceEnv(
        "wrist", model=mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
    )
    env.reset(seed=0)
    with pytest.raises(CableError, match="longer than the model has room for"):
        env.reset(options={"friction": 0.1})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"hold": 0}, "hold must be"),
        ({"hold": 2.0}, "hold must be a whole number"),
        ({"history": -1}, "history must be"),
        ({"memory": 1}, "memory must be"),
    ],
)
def test_other_arguments_that_mean_nothing_are_one_sentence(
    given: Any, message: str
) -> None:
    with pytest.raises(CableError, match=message):
        DeviceEnv("wrist", **given)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_wrappers_of_gymnasium_give_what_they_give_around_sync(mode: str) -> None:
    given = {**ALL, "duration": 0.015}

    def wrapped(env: Any) -> Any:
        env = wrappers.RecordEpisodeStatistics(env)
        if mode == "NextStep":  # all that NormalizeObservation itself takes
            env = wrappers.NormalizeObservation(env)
        return wrappers.NormalizeReward(env)

    a = wrapped(gymnasium.make_vec(WRIST, COUNT, autoreset_mode=mode, **given))
    b = wrapped(
        gymnasium.make_vec(
            WRIST,
            COUNT,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
            **given,
        )
    )
    a.reset(seed=0)
    b.reset(seed=0)
    random, ended = np.random.default_rng(0), 0
    for _ in range(13):
        actions = random.uniform(-1, 1, (COUNT, 1)).astype(np.float32)
        ours, theirs = a.step(actions), b.step(actions)
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            assert np.array_equal(one, other)
        if "episode" in ours[4]:
            assert np.array_equal(ours[4]["episode"]["r"], theirs[4]["episode"]["r"])
            assert set(ours[4]["episode"]["l"]) == {5}
            ended += 1
    assert ended == 2


def test_processes_of_gymnasium_give_the_same_bits() -> None:
    given = {**ALL, "duration": 0.015}
    a = gymnasium.make_vec(WRIST, 2, **given)
    b = gymnasium.make_vec(WRIST, 2, vectorization_mode="async", **given)
    try:
        equal(a.reset(seed=3), b.reset(seed=3))
        for _ in range(7):
            action = np.full((2, 1), 0.4, np.float32)
            ours, theirs = a.step(action), b.step(action)
            equal(ours[:4], theirs[:4])
    finally:
        b.close()
