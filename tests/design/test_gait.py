"""Walking speed and assistance profile as variables, and what strides tell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.design import StudySpec, make_plan, optimise, study
from cc_mujoco.design._execution import fit_profile
from cc_mujoco.design._protocol import is_stride_metric
from cc_mujoco.design._show import show
from cc_mujoco.device import Plant, load_device
from cc_mujoco.device._wearer_scaling import profile_of, tasks_of
from cc_mujoco.errors import CableError
from cc_mujoco.human import Assist, Body, Pace, Paced, Profile, Walk
from cc_mujoco.human._gait import GAIT_MOMENTS, GaitJoint
from cc_mujoco.human._pace import MAX_SPEED, MEASURED_SPEED, MIN_SPEED
from cc_mujoco.metrics import METRICS, ArrayLog
from cc_mujoco.metrics._registry import ANKLE
from cc_mujoco.simulation import EpisodeLog
from study_marks import study_but

NAMES = [name for name in METRICS if is_stride_metric(name)]
QUICK: dict[str, Any] = {"duration": 0.3, "threads": 1}
PLAIN = ("rms_torque_error", "peak_tension", "reflected_torque")
STRIDE = {"duration": 3.5, "threads": 1, "timestep": 1e-3, "controllers": ["none"]}


def walked(
    speed: float, share: float, duration: float = 6.0, part: str = "ankle"
) -> ArrayLog:
    """Return a walk in which the cables give a share of a joint's moment."""
    pace = Pace(speed)
    motion = Walk.at(speed).sample(duration, 1e-3, np.random.default_rng(0))
    motion = motion.companions[part]
    own = pace.moment(part) * GAIT_MOMENTS[part](pace.phase(motion.phase))
    turn = 2 * np.pi * motion.phase
    columns = {
        "time_s": motion.time,
        "phase_sine": np.sin(turn),
        "phase_cosine": np.cos(turn),
        "reference_angle_rad": motion.angle,
        "joint_velocity_rad_s": motion.velocity,
        "joint_torque_nm": share * own,
        "desired_torque_nm": share * own,
    }
    return ArrayLog(columns)


def strides_of(
    log: ArrayLog | EpisodeLog,
    pace: Pace,
    moment: float = 1.0,
    joint: GaitJoint = ANKLE,
) -> dict[str, float]:
    """Return all metrics of strides of an episode at this pace."""
    about = {"pace": pace, "moment_ratio": moment, "gait_joint": joint}
    log = ArrayLog(log.columns, metadata=about)
    return {name: METRICS[name].compute(log) for name in NAMES}


@pytest.mark.parametrize("part", ["ankle", "knee", "hip"])
def test_help_saves_its_share_of_the_work_of_any_joint(part: str) -> None:
    alone, helped = (walked(MEASURED_SPEED, share, part=part) for share in (0.0, 0.3))
    about = {"pace": Pace(), "gait_joint": GaitJoint("mine", part)}
    work, less = (
        METRICS["wearer_work"].compute(ArrayLog(log.columns, metadata=about))
        for log in (alone, helped)
    )
    assert work > 1.0 and less == pytest.approx(0.7 * work)
    turned = {
        name: -column if name[:5] in ("refer", "joint", "desir") else column
        for name, column in helped.columns.items()
    }
    about = {"pace": Pace(), "gait_joint": GaitJoint("mine", part, turned=True)}
    for name in NAMES:
        found = METRICS[name].compute(ArrayLog(turned, metadata=about))
        as_measured = strides_of(helped, Pace(), joint=GaitJoint("mine", part))[name]
        assert found == pytest.approx(as_measured)


def test_nothing_is_known_of_the_work_of_a_knee_at_another_speed() -> None:
    log = walked(MEASURED_SPEED, 0.3, part="knee")
    found = strides_of(log, Pace(1.4), joint=GaitJoint("mine", "knee"))
    assert math.isnan(found["wearer_work"])
    assert found["peak_assistance"] > 0.0


@pytest.mark.study
def test_strides_of_a_hip_are_measured() -> None:
    given = {**STRIDE, "duration": 4.0}
    table = study("exosuit", {"pretension": "15"}, metrics=NAMES, **given)
    row = table.to_pylist()[0]
    assert row["wearer_work"] > 0.0 and row["peak_assistance"] > 0.0


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        pytest.param("ankle", PLAIN, marks=pytest.mark.study),
        ("exosuit", PLAIN[:2]),
    ],
)
def test_at_the_measured_speed_a_study_is_bit_for_bit_that_without(
    scene: str, names: list[str]
) -> None:
    measured = {"metrics": names, **QUICK}
    plain = study(scene, {"pretension": "5,10"}, **measured)
    vary = {"pretension": "5,10", "gait_speed": f"{MEASURED_SPEED}"}
    said = study(scene, vary, **measured)
    across = {"gait_speed": f"{MEASURED_SPEED}"}
    crossed = study(scene, {"pretension": "5,10"}, across=across, **measured)
    for name in names:
        assert plain[name].to_pylist() == said[name].to_pylist()
        assert plain[name].to_pylist() == crossed[name].to_pylist()


@pytest.mark.parametrize("scene", study_but(2, ["exosuit", "ankle"]))
def test_a_design_at_a_speed_is_shown_as_it_was_measured(
    scene: str, tmp_path: Path
) -> None:
    table = study(scene, {"gait_speed": "0.8,1.6", "friction": "0.05,0.1"},
                  out=tmp_path, metrics=["rms_torque_error"], **QUICK)  # fmt: skip
    assert table["failed"].null_count == 4
    assert len(set(table["rms_torque_error"].to_pylist())) == 4
    for row in (3,) if scene == "exosuit" else (0, 3):
        log, _ = show(tmp_path, row)
        each = {
            axis: METRICS["rms_torque_error"].compute(log.axis(axis))
            for axis in log.axes
        } or {"": METRICS["rms_torque_error"].compute(log)}
        assert max(each.values()) == table["rms_torque_error"][row].as_py()
        for axis in log.axes:
            assert each[axis] == table[f"{axis}.rms_torque_error"][row].as_py()


def test_profiles_of_a_batch_are_each_as_alone_and_as_shown(tmp_path: Path) -> None:
    vary = {"peak_time": "48,52", "onset": "30,40", "peak_torque": "20", "fall": "9"}
    across = {"gait_speed": "0.8,1.4"}
    asked = ["rms_torque_error", *NAMES]
    table = study("ankle", vary, across=across, out=tmp_path, metrics=asked, **STRIDE)
    assert table["failed"].null_count == 4
    designs = table.select(list(vary)).to_pylist()
    alone = study("ankle", designs=designs[3:], across=across, metrics=asked, **STRIDE)
    for name in asked:
        assert alone[name][0].as_py() == table[name][3].as_py()
    log, _ = show(tmp_path, 2, case=1)
    found = strides_of(log, Pace(1.4))
    for name in NAMES:
        low, high = (table[f"{name}@{end}"][2].as_py() for end in ("least", "most"))
        assert found[name] in (low, high)


def test_no_default_outlasts_the_stance_of_who_walks_fast() -> None:
    for speed in (0.8, 1.2, 1.6):
        design = {"gait_speed": speed, "peak_torque": 20.0}
        profile = profile_of(design)
        assert profile is not None
        assert profile.end <= profile.toe_off + 1e-9
    with pytest.raises(CableError, match="`fall` must be"):
        profile_of(design | {"fall": Profile.fall})


def test_a_peak_torque_that_is_not_said_goes_with_the_wearer() -> None:
    for walker in (
        {"body_mass": 40.0},
        {"body_mass": 130.0, "leg_length": 1.05},
        {"gait_speed": 0.8},
        {"gait_speed": 1.5, "body_mass": 60.0},
    ):
        help_of = tasks_of([walker], "assist", load_device("ankle").description)
        assert isinstance(help_of, Paced)
        profile = profile_of({**walker, "onset": 30.0})
        assert profile is not None
        assert profile.peak_torque == pytest.approx(help_of.share * Assist().peak)
        said = profile_of({**walker, "onset": 30.0, "peak_torque": 20.0})
        assert said is not None and said.peak_torque == 20.0
    assert profile_of({"onset": 30.0}) == Profile(onset=30.0)


def test_a_later_peak_helps_the_push_off_more() -> None:
    table = study("ankle", {"peak_time": "46,54"}, metrics=NAMES, **STRIDE)
    early, late = table["assistance_work"].to_pylist()
    assert late > early >= 0.0


def test_a_search_tries_no_profile_that_outlasts_the_stance() -> None:
    pytest.importorskip("optuna")
    vary = {"onset": "10:60", "peak_time": "45:64", "fall": "5:20:log"}
    table = optimise("ankle", vary, ["wearer_work"], ["swing_torque<=8"],
                     evaluations=6, **STRIDE)  # fmt: skip
    assert table["failed"].to_pylist() == 6 * [None]


@given(
    speed=st.floats(MIN_SPEED, MAX_SPEED),
    shares=st.tuples(*(3 * [st.floats(0.0, 1.0)])),
    log=st.booleans(),
)
def test_what_a_search_draws_becomes_a_profile_that_can_be(
    speed: float, shares: tuple[float, float, float], log: bool
) -> None:
    ends = {"onset": (5.0, 70.0), "peak_time": (30.0, 90.0), "fall": (2.0, 40.0)}
    ranges = {name: (*pair, log) for name, pair in ends.items()}
    drawn = {
        name: low + share * (high - low)
        for (name, (low, high)), share in zip(ends.items(), shares, strict=True)
    }
    cases = [{"gait_speed": speed}, {"gait_speed": 1.0}]
    design = fit_profile(drawn, ranges, cases)
    for case in cases:
        profile = profile_of({**design, **case})
        assert profile is not None and profile.end <= profile.toe_off
    for name, (low, high) in ends.items():
        assert low <= float(design[name]) <= high


def test_a_profile_that_may_be_anywhere_is_as_it_was_drawn() -> None:
    ranges = {"peak_time": (40.0, 55.0, False), "fall": (3.0, 8.0, False)}
    drawn = {"peak_time": 51.0, "fall": 7.0}
    assert fit_profile(drawn, ranges) == drawn
    assert fit_profile({"friction": 0.1}, {"friction": (0.0, 1.0, False)}) == {
        "friction": 0.1
    }


@given(
    speed=st.floats(MIN_SPEED, MAX_SPEED),
    share=st.floats(0.0, 1.0),
)
def test_help_in_the_shape_of_the_moment_saves_its_share(
    speed: float, share: float
) -> None:
    found = strides_of(walked(speed, share), Pace(speed))
    alone = strides_of(walked(speed, 0.0), Pace(speed))
    assert alone["wearer_work_change"] == 0.0 == alone["assistance_work"]
    assert found["wearer_work_change"] == pytest.approx(-share, abs=1e-9)
    left = (1.0 - share) * alone["wearer_work"]
    assert found["wearer_work"] == pytest.approx(left, abs=1e-9)
    given_work = share * alone["wearer_work"]
    assert found["assistance_work"] == pytest.approx(given_work, rel=2e-3, abs=1e-9)
    assert found["peak_assistance"] == pytest.approx(
        share * np.max(-walked(speed, 1.0)["joint_torque_nm"]), rel=1e-3, abs=1e-9
    )


def test_an_episode_without_a_whole_stride_has_no_number() -> None:
    found = strides_of(walked(MEASURED_SPEED, 0.5, 2.0), Pace())
    assert all(math.isnan(value) for value in found.values())


def test_strides_are_measured_only_where_they_are_asked_for() -> None:
    plain = make_plan(
        StudySpec("ankle", {"friction": "0.1"}, duration=0.3)
    ).protocol.metrics
    assert not set(NAMES) & set(plain)


@pytest.mark.parametrize(
    ("scene", "vary", "how", "says"),
    [
        ("wrist", {"gait_speed": "1"}, {}, "needs a wearer who walks, as in 'ankle'"),
        ("finger", {"fall": "5"}, {}, "who is helped in push-off, as in 'ankle', but"),
        ("bilateral", {"body_mass": "90"}, {}, "of a leg, but .* no body 'thigh'"),
        ("exosuit", {"fall": "20"}, {}, "`fall` must be at most 12.6 %"),
        ("ankle", {"gait_speed": "0.7"}, {}, r"must be a number in \[0.8, 1.6\] m/s"),
        ("ankle", {"gait_speed": "1"}, {"trajectory": "sine"}, "the study plays 'sin"),
        ("ankle", {"fall": "9"}, {"task": "transparent"}, "is of task 'assist', but"),
        ("ankle", {"fall": "20"}, {}, "`fall` must be at most 12.6 %"),
        ("ankle", {"fall": "12"}, {"across": {"gait_speed": "0.8,1.6"}},
         "in case gait_speed=1.6, the torque ends at .* `fall` must be at most 9.8"),
        ("ankle", {"onset": "60"}, {}, "`onset` must be 0.1 % or more before"),
        ("ankle", {"peak_torque": "80"}, {}, "must be at most the 60 N m that"),
        ("ankle", {"gait_speed": "1"}, {"across": {"gait_speed": "1.2"}},
         "'gait_speed' is both varied and crossed"),
        ("finger", {"friction": "0.1"}, {"metrics": ["wearer_work"]},
         "as 'ankle', 'exosuit' and 'bilateral' do, and the trajectory"),
        ("ankle", {"friction": "0.1"},
         {"metrics": ["swing_torque"], "trajectory": "sine"}, "strides of an ass"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_sentence(
    scene: str, vary: dict[str, str], how: dict[str, Any], says: str
) -> None:
    with pytest.raises(CableError, match=says) as caught:
        make_plan(StudySpec(scene, vary, **{"duration": 0.3, **how}))
    assert "\n" not in str(caught.value)


def test_the_size_of_the_scenes_wearer_changes_no_bit() -> None:
    measured = {"metrics": PLAIN, **QUICK}
    for scene, said in (
        ("ankle", {"body_mass": Body.mass, "leg_length": Body.leg}),
        ("exosuit", {"body_mass": Body.mass}),
    ):
        plain = study(scene, {"pretension": "5"}, **measured)
        sized = study(scene, {"pretension": "5"}, across=said, **measured)
        for name in PLAIN:
            assert plain[name].to_pylist() == sized[name].to_pylist()


def test_a_wearer_of_another_size_is_shown_as_measured(tmp_path: Path) -> None:
    across = {"body_mass": "55,95", "leg_length": "0.85"}
    asked = ["rms_torque_error", *NAMES]
    table = study("ankle", {"friction": "0.1"}, across=across, out=tmp_path,
                  metrics=asked, **STRIDE)  # fmt: skip
    log, model = show(tmp_path, 0, case=1)
    body = Body(95.0, 0.85)
    work = strides_of(log, body.pace(), body.moment)["wearer_work"]
    least, most = (table[f"wearer_work@{e}"][0].as_py() for e in ("least", "most"))
    assert least < work == most
    # Hip to ankle, of a leg that has 0.039 of the height below.
    leg = -float(model.body("shank").pos[2] + model.body("foot").pos[2])
    assert leg == pytest.approx(body.leg * 0.491 / 0.530, rel=2e-3)


@pytest.mark.parametrize("whole", [False, True])
def test_segments_go_with_the_wearer_and_what_is_worn_does_not(whole: bool) -> None:
    """Against two bodies put together by MuJoCo itself."""
    body = Body(100.0, 1.0)
    plain = Plant("ankle").model(whole)
    size = {"body_mass": body.mass, "leg_length": body.leg}
    model = Plant("ankle", size).model(whole)
    for name, share in Body.SEGMENTS.items():
        old, new, limb = plain.body(name), model.body(name), share * Body.mass
        worn = float(old.mass[0]) - limb
        spread = old.inertia / old.mass[0]
        spec = mujoco.MjSpec()
        spec.compiler.inertiafromgeom = (
            mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        )
        both = spec.worldbody.add_body(name="both")
        both.add_joint(axis=[0, 1, 0], type=mujoco.mjtJoint.mjJNT_HINGE)
        both.mass, both.explicitinertial, both.inertia = 1e-9, True, 3 * [1e-12]
        for m, far, wide in (
            (worn, 1.0, 1.0),
            (limb * body.heavier, body.longer, body.longer),
        ):
            part = both.add_body()
            part.explicitinertial, part.mass = True, m
            part.ipos, part.inertia = far * old.ipos, m * wide**2 * spread
        composite = spec.compile()
        assert new.mass[0] == pytest.approx(worn + limb * body.heavier)
        about = new.inertia[1] + new.mass[0] * (new.ipos @ new.ipos)
        assert about == pytest.approx(float(composite.dof_M0[0]), rel=1e-6)
    sites = [model.site(n) for n in ("conduit_shank", "heel_lever")]
    ankle = model.body("foot").pos - plain.body("foot").pos
    moved = [s.pos - plain.site(s.name).pos for s in sites]
    assert moved[0] == pytest.approx(ankle)
    assert moved[1] == pytest.approx(np.zeros(3))


def test_heavier_wearers_get_more_help_and_work_more() -> None:
    across = {"body_mass": "50,100"}
    asked = ["peak_assistance", "wearer_work"]
    table = study("ankle", {"friction": "0.05"}, across=across, metrics=asked,
                  **STRIDE)  # fmt: skip
    for name in asked:
        least, most = (table[f"{name}@{end}"][0].as_py() for end in ("least", "most"))
        assert 1.5 < most / least < 2.3


def test_sizes_that_cannot_be_are_refused_in_a_sentence() -> None:
    def refused(scene: str, vary: dict[str, str], **more: Any) -> str:
        with pytest.raises(CableError) as error:
            make_plan(StudySpec(scene, vary, **more))
        return str(error.value)

    assert "draws the paths" in refused("exosuit", {"leg_length": "0.85,0.95"})
    assert "who walks" in refused("wrist", {"body_mass": "60,80"})
    assert "trajectory 'walk'" in refused(
        "ankle", {"leg_length": "0.85"}, trajectory="sweep", task="transparent"
    )
    assert "legs of 0.8 m" in refused("ankle", {"gait_speed": "1.6"},
                                      across={"leg_length": "0.8"})  # fmt: skip
    assert "route" in refused("ankle", {"leg_length": "0.85", "bend": "route"})
    assert "kg" in refused("ankle", {"body_mass": "20"})
