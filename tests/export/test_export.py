"""Exported controllers: the library's torques bit for bit, from C, without Python."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cc_mujoco.cable import TERMS
from cc_mujoco.cable._layout import tensions as node_tensions
from cc_mujoco.control import (
    Controller,
    PredictiveCompensation,
    controller,
)
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.device import TENSION_COLUMN, Drive
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.export import EXPORT_FILES, EXPORTED, ExportPlan, measure, write
from cc_mujoco.export._command import Export
from cc_mujoco.export._files import HEADER_FILE
from control.devices import kept
from export.library import (
    COMPILER,
    GUARD,
    STRICT,
    Library,
    device,
    needs_compiler,
    objects,
    run,
)
from study_marks import study_but, study_unless

DEVICES = ("wrist", "ankle", "finger", "exosuit")
Array = NDArray[np.float64]
Made = Callable[[str, str], tuple[Path, ExportPlan]]

CASES = [
    ("wrist", "pi"),
    ("wrist", "stiction"),
    ("wrist", "predictive"),
    pytest.param("ankle", "pi", marks=pytest.mark.study),
    pytest.param("exosuit", "adaptive", marks=pytest.mark.study),
    ("ankle", "none"),
    ("wrist", "pi_tuned"),
    ("exosuit", "inverse"),
    *(
        pytest.param(scene, name, marks=pytest.mark.study)
        for scene, name in (
            ("exosuit", "pi_feed_forward"),
            ("wrist", "lqg"),
            ("ankle", "disturbance"),
            ("ankle", "feedback"),
        )
    ),
    *(
        pytest.param(scene, name, marks=pytest.mark.study)
        for scene, name in itertools.product(
            ("ankle", "finger"), ("pi_tuned", "pi_feed_forward", "inverse", "lqg")
        )
    ),
    pytest.param("ankle", "model", marks=pytest.mark.study),  # part of `stiction`
    pytest.param("ankle", "predictive", marks=pytest.mark.study),
    pytest.param("wrist", "adaptive", marks=pytest.mark.study),
    pytest.param("ankle", "adaptive", marks=pytest.mark.study),
    pytest.param("exosuit", "stiction", marks=pytest.mark.study),
]
PLANNED = ("predictive", "adaptive")
NOISE = {
    "motor_angle_rad": 1e-5,
    "motor_velocity_rad_s": 1e-2,
    "joint_velocity_rad_s": 1e-2,
    "winding_velocity_rad_s": 1e-2,
    "joint_torque_nm": 1e-2,
}
INTERFACE = {
    f"cc_controller_{name}"
    for name in ("size", "init", "set_parameters", "reset", "step")
}
FROM_C = {
    "memset", "memcpy", "memmove",
    "sin", "cos", "tanh", "copysign", "exp", "log", "pow", "expm1", "log1p", "sqrt",
    "sincos",
}  # fmt: skip


@functools.cache
def plan_of(scene: str, name: str) -> ExportPlan:
    return ExportPlan.of(name, [drive_of(scene, name)], [driven(scene)])


def driven(scene: str) -> tuple[str, ...]:
    """Return the names of the cables of the first axis of a device."""
    names: tuple[str, ...] = device(scene).exo.device.driven[0]
    return names


def first_axis(scene: str, info: dict[str, Any]) -> Any:
    """Return the columns of the first axis of a device."""
    prefixes = device(scene).exo.device.prefixes
    return axis_columns(info, prefixes[0], prefixes)


def action_of(scene: str, torque: Any) -> Any:
    """Return the action in which only the motor of the first axis has a torque."""
    env = device(scene)
    if len(env.drives) == 1:
        return env.action(torque)
    torques = np.zeros(len(env.drives))
    torques[0] = torque
    return env.action(torques)


def drive_of(scene: str, name: str) -> Drive:
    """Return the drive of a scene, modified for controllers that adapt to friction.

    Except for the wrist, these drives also have a motor lag and a rate limit.
    """
    drive: Drive = device(scene).drives[0]
    if name not in PLANNED:
        return drive
    if scene != "wrist":
        drive = dataclasses.replace(
            drive, motor_lag=0.003, torque_rate=50.0 * drive.high
        )
    row = tuple(
        dataclasses.replace(one, cable=one.cable.replace(friction=0.7 * friction))
        for one, friction in ((one, one.cable.friction) for one in drive.cables)
    )
    return dataclasses.replace(drive, cables=row)


@functools.cache
def episode(scene: str, name: str) -> tuple[Array, Array]:
    """Return the readings and torques of a controller that drives a noisy device."""
    env = device(scene)
    law = controller(name, drive_of(scene, name))
    _, info = env.reset(seed=3)
    law.reset()
    random = np.random.default_rng(4)
    plan, drive = plan_of(scene, name), drive_of(scene, name)
    (axis,) = plan.axes
    taps = [one for own in drive.sensors for one in own.deviation]
    noise = [NOISE.get(key, 0.0) for key in axis.columns]
    noise += taps[: len(axis.tension_readings)]
    noise += [0.0 for _ in axis.other_columns]
    readings, torques = [], []
    for _ in range(900):
        columns = first_axis(scene, info)
        readings.append([columns[key] for key in axis.columns])
        readings[-1] += [
            info[f"tension_{cable}_nodes_n"][node]
            for _, cable, node in axis.tension_readings
        ]
        readings[-1] += [columns[key] for key in axis.other_columns]
        readings[-1] += random.normal(size=len(noise)) * noise
        torques.append(law.torque(seen(plan, readings[-1])))
        *_, info = env.step(action_of(scene, torques[-1]))
    return np.array(readings), np.array(torques)


def seen(plan: ExportPlan, readings: Any) -> dict[str, Any]:
    """Return the Python readings that match these C readings."""
    (axis,) = plan.axes
    row, count = np.asarray(readings).tolist(), len(axis.columns)
    end = len(row) - len(axis.other_columns)
    told = dict(zip(axis.columns, row[:count], strict=True))
    told |= dict(zip(axis.other_columns, row[end:], strict=True))
    if any(name in told for name in WINDING_COLUMNS):
        told = dict.fromkeys(WINDING_COLUMNS, 1.0) | told
    if axis.taps is not None:
        told[TENSION_COLUMN] = np.array(row[count:end]).reshape(axis.taps.nodes.shape)
    return told


def python(
    law: Controller, readings: Array, name: str = "stiction", scene: str = "wrist"
) -> Array:
    plan = plan_of(scene, name)
    return np.array([law.torque(seen(plan, row)) for row in readings])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Return the exports for this machine, each written once."""

    @functools.cache
    def written(scene: str, name: str) -> tuple[Path, ExportPlan]:
        folder = tmp_path_factory.mktemp("export") / f"{scene}-{name}"
        plan = plan_of(scene, name)
        write(folder, plan, "a test")
        return folder, plan

    return written


def symbols(path: Path) -> tuple[set[str], set[str]]:
    """Return the external names that an object file defines, and those it requires."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("there is no nm to list symbols with")
    listed = [line.split()[-2:] for line in run(nm, "-g", path).splitlines()]
    return (
        {name for kind, name in listed if kind != "U"},
        {name for kind, name in listed if kind == "U"},
    )


def test_what_a_user_changed_is_not_replaced(tmp_path: Path) -> None:
    plan = plan_of("wrist", "pi")
    for _ in range(2):  # an export that nobody touched is replaced
        write(tmp_path, plan, "a test")
    for name in (HEADER_FILE, *EXPORT_FILES[3:-1]):
        ours = (tmp_path / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(ours + "\n", encoding="utf-8")
        with pytest.raises(CableError, match=f"{name} is not as an earlier run wrote"):
            write(tmp_path, plan, "a test")
        assert (tmp_path / name).read_text(encoding="utf-8") == ours + "\n"
        (tmp_path / name).write_text(ours, encoding="utf-8")


@needs_compiler
@pytest.mark.parametrize(("scene", "name"), CASES)
def test_torques_are_those_of_the_library_bit_for_bit(
    scene: str, name: str, made: Made
) -> None:
    readings, torques = episode(scene, name)
    exported = Library(*made(scene, name))
    assert exported.library.cc_controller_size() == exported.memory.nbytes
    assert exported.take(exported.parameters) == 0
    assert np.array_equal(exported.motor_torques(readings), torques)
    assert np.ptp(torques) > 0.1
    around = np.delete(exported.room, np.s_[GUARD:-GUARD])
    assert around.size == 2 * GUARD and np.isnan(around).all()
    exported.reset()
    assert np.array_equal(exported.motor_torques(readings[:300]), torques[:300])


def example(program: Path, plan: ExportPlan, readings: Array, *run_by: Any) -> Array:
    """Return the output of the built program that is written next to the controller."""
    rows = "".join(",".join(map(repr, row)) + "\n" for row in readings.tolist())
    header = ",".join(plan.seen) + "\n"
    head, *torques = run(*run_by, program, input=header + rows).splitlines()
    assert head == "motor_torque_nm"
    return np.array([float(torque) for torque in torques])


def program(folder: Path) -> Path:
    """Return the program that is written next to the controller, built once."""
    built = folder / "built" / "example"
    if not built.exists():
        parts = objects(folder)
        run(COMPILER, *STRICT, "-o", built, folder / "cc_example.c", *parts, "-lm")
    return built


@needs_compiler
@pytest.mark.parametrize(
    ("scene", "name"),
    [("wrist", "stiction"), ("wrist", "predictive"), ("exosuit", "adaptive")],
)
def test_the_example_gives_the_torques_of_recorded_readings(
    scene: str, name: str, made: Made
) -> None:
    readings, torques = episode(scene, name)
    folder, plan = made(scene, name)
    assert np.array_equal(example(program(folder), plan, readings), torques)


@needs_compiler
@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "motor_angle_rad,joint_angle_rad\n0,0\n",
            "the header must be motor_angle_rad,",
        ),
        ("HEAD\n0,0,0\n", "line 2 has not just"),
        ("HEAD\n0,0,0,0,0,0,0\n", "line 2 has not just"),
    ],
)
def test_the_example_takes_no_readings_of_another_controller(
    text: str, told: str, made: Made
) -> None:
    folder, plan = made("wrist", "pi")
    words, given = [program(folder)], text.replace("HEAD", ",".join(plan.seen))
    done = subprocess.run(words, input=given, capture_output=True, text=True)
    assert done.returncode == 2
    assert told in done.stderr


@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no cmake")
@needs_compiler
def test_the_cmake_file_builds(made: Made, tmp_path: Path) -> None:
    folder, _ = made("wrist", "pi")
    run("cmake", "-S", folder, "-B", tmp_path)
    run("cmake", "--build", tmp_path)
    assert (tmp_path / "cc_example").exists()


@needs_compiler
@pytest.mark.parametrize(("scene", "name"), CASES[1:])
def test_source_compiles_without_warnings_and_needs_c_alone(
    scene: str, name: str, made: Made
) -> None:
    """Every library of these tests is compiled with all warnings as errors."""
    folder, _ = made(scene, name)
    defined, needed = symbols(objects(folder)[0])
    assert defined == INTERFACE
    assert needed <= FROM_C


@needs_compiler
def test_parameters_can_be_exchanged_while_it_runs(made: Made) -> None:
    readings, _ = episode("wrist", "stiction")
    folder, plan = made("wrist", "stiction")
    exported = Library(folder, plan)
    law: Any = controller("stiction", device("wrist").drive)
    law.reset()
    exported.take(exported.parameters)
    before = python(law, readings[:400])
    assert np.array_equal(exported.motor_torques(readings[:400]), before)
    law.mismatch = 0.5
    law._scale_friction(0, 1.5)
    law.proportional = 0.5
    changed = exported.parameters.copy()
    for place, field in enumerate(plan.fields):
        rubs = re.fullmatch(r"(flex|extens)or_(static_)?friction", field.name)
        changed[place] *= 1.5 if rubs else 1.0
        changed[place] *= 0.5 if field.name == "proportional" else 1.0
    assert exported.take(changed, "set_parameters") == 0
    after = python(law, readings[400:])
    assert np.array_equal(exported.motor_torques(readings[400:]), after)


TERMS_ON = {
    "friction": 0.3,
    "static_friction": 0.9,
    "viscous_friction": 5.0,
    "stribeck_friction": 0.2,
    "load_independent_friction": 2.0,
    "seal_proximal": 1.0,
    "seal_distal": 1.0,
    "friction_asymmetry": 0.2,
    "end_compliance": 1e-4,
    "proximal_compliance": 5e-5,
    "end_hardening": 0.02,
    "proximal_hardening": 0.05,
    "end_loss": 0.3,
    "proximal_loss": 0.2,
    "bristle_length": 1e-3,
    "tension_exponent": -0.2,
    "ageing_friction": 0.1,
    "wrap_growth": 5.0,
    "friction_drift": 0.1,
    "friction_heating": 0.05,
    "bedding_strain": 2e-3,
    "clearance": 5e-4,
    "stress_relaxation": 0.3,
    "clamp_creep_proximal": 1e-5,
    "clamp_creep_distal": 1e-5,
    "eccentricity": 2e-3,
    "ovality": 1e-3,
    "grease_drag": 3.0,
}


def test_every_term_is_tried() -> None:
    assert set(TERMS_ON) == set(TERMS)


@needs_compiler
@pytest.mark.parametrize("term", TERMS_ON)
def test_every_term_of_the_cables_is_in_the_exported_controller(
    term: str, made: Made
) -> None:
    readings, _ = episode("wrist", "stiction")
    drive = device("wrist").drive
    on = {term: TERMS_ON[term]}
    end, _, kind = term.partition("_")
    if kind in ("hardening", "loss"):
        on[f"{end}_compliance"] = TERMS_ON[f"{end}_compliance"]
    row = tuple(
        dataclasses.replace(one, cable=one.cable.replace(**on)) for one in drive.cables
    )
    drive = dataclasses.replace(drive, cables=row)
    exported = Library(*made("wrist", "stiction"))
    plan = ExportPlan.of("stiction", [drive], [driven("wrist")])
    assert exported.take(plan.values()) == 0
    found = exported.motor_torques(readings[200:400])
    assert np.array_equal(
        found, python(controller("stiction", drive), readings[200:400])
    )


@needs_compiler
def test_bristles_that_cables_have_themselves_replace_those_of_the_second_model(
    made: Made,
) -> None:
    """They came with the exchanged parameters, and were taken away in every step."""
    readings, _ = episode("wrist", "predictive")
    drive = drive_of("wrist", "predictive")
    row = tuple(
        dataclasses.replace(one, cable=one.cable.replace(bristle_length=1e-3))
        for one in drive.cables
    )
    drive = dataclasses.replace(drive, cables=row)
    exported = Library(*made("wrist", "predictive"))
    plan = ExportPlan.of("predictive", [drive], [driven("wrist")])
    assert exported.take(plan.values()) == 0
    found = exported.motor_torques(readings[200:400])
    single = PredictiveCompensation(drive, bristles=0.0)
    expected = python(single, readings[200:400], "predictive")
    assert np.array_equal(found, expected)
    assert np.ptp(found) > 0.1


@needs_compiler
@pytest.mark.parametrize("name", ["pi", "stiction"])
def test_the_guard_is_exported(name: str, made: Made) -> None:
    """It limits excessive joint torque and the speed of winding up slack."""
    readings = episode("wrist", name)[0][:400].copy()
    plan, drive = plan_of("wrist", name), drive_of("wrist", name)
    torque, speed = map(plan.seen.index, ("joint_torque_nm", "motor_velocity_rad_s"))
    readings[100:200, torque] += drive.safe_torque
    readings[300:350, speed] += 200.0
    exported = Library(*made("wrist", name))
    assert exported.take(exported.parameters) == 0
    found = exported.motor_torques(readings)
    assert np.array_equal(found, python(controller(name, drive), readings, name))
    free = controller(name, dataclasses.replace(drive, safe_torque=math.inf))
    other = found != python(free, readings, name)
    assert other[100:200].any() and not other[:100].any()
    # A law with a model is at the limit of its motor against such a speed anyway.
    assert other[300:350].any() or name == "stiction"


@needs_compiler
def test_friction_that_a_plan_learned_is_kept_when_parameters_are_exchanged(
    made: Made,
) -> None:
    readings, torques = episode("wrist", "predictive")
    law: Any = controller("predictive", drive_of("wrist", "predictive"))
    python(law, readings, "predictive")
    assert np.all(np.abs(np.exp(kept(law)[planner_memory.FRICTION :]) - 1.0) > 0.02)
    exported = Library(*made("wrist", "predictive"))
    exported.take(exported.parameters)
    assert np.array_equal(exported.motor_torques(readings[:500]), torques[:500])
    assert exported.take(exported.parameters, "set_parameters") == 0
    assert np.array_equal(exported.motor_torques(readings[500:]), torques[500:])


@needs_compiler
def test_a_plan_goes_on_from_what_the_motor_got(made: Made, tmp_path: Path) -> None:
    folder, _ = made("wrist", "predictive")
    readings, torques = episode("wrist", "predictive")
    rows = ", ".join(
        f"{{{', '.join(map(repr, row))}}}" for row in readings[:40].tolist()
    )
    (tmp_path / "main.c").write_text(
        f"""#include <stdio.h>
        #include "cc_controller.h"
        static const cc_readings rows[] = {{ {rows} }};
        int main(void) {{
            static cc_controller c;
            cc_controller_init(&c, cc_controller_parameters);
            for (int i = 0; i < 40; i++) {{
                double torque, got;
                cc_controller_step(&c, rows + i, &torque);
                printf("%.17g\\n", torque);
                got = 0.5 * torque;
                cc_controller_given(&c, &got);
                got = torque / 0.0;
                cc_controller_given(&c, &got);
                got = 0.0 / 0.0 * torque;
                cc_controller_given(&c, &got);
            }}
        }}"""
    )
    run(
        COMPILER, *STRICT, "-I", folder, "-o", tmp_path / "main", tmp_path / "main.c",
        *objects(folder), "-lm",
    )  # fmt: skip
    found = list(map(float, run(tmp_path / "main").split()))
    law = controller("predictive", drive_of("wrist", "predictive"))
    expected = []
    for row in readings[:40]:
        expected.append(law.torque(seen(plan_of("wrist", "predictive"), row)))
        for torque in (0.5 * expected[-1], math.inf, math.nan):
            law.given(torque)
    assert np.array_equal(found, expected)
    assert not np.allclose(found, torques[:40], rtol=1e-3)


@needs_compiler
def test_what_the_plans_of_an_export_rest_on_cannot_be_exchanged(made: Made) -> None:
    folder, plan = made("wrist", "predictive")
    exported = Library(folder, plan)
    names = [field.name for field in plan.fields]
    for name in ("period", "span", "late"):
        changed = exported.parameters.copy()
        changed[names.index(name)] *= 0.5
        changed[names.index(name)] += 1e-3
        assert exported.take(changed) == names.index(name) + 1


@needs_compiler
@given(st.data())
def test_a_parameter_that_cannot_be_is_named_and_none_is_taken(
    made: Made, data: st.DataObject
) -> None:
    folder, plan = made("wrist", "stiction")
    exported = Library(folder, plan)
    assert exported.take(exported.parameters) == 0
    exported.motor_torques(episode("wrist", "stiction")[0][:5])
    before = exported.memory.tobytes()
    place = data.draw(st.integers(0, len(plan.fields) - 1))
    field = plan.fields[place]
    wrong = [np.nan, np.nextafter(field.low, -np.inf), -np.inf]
    if np.isfinite(field.high):
        wrong += [np.nextafter(field.high, np.inf), np.inf]
    is_arm = field.name.endswith(("_proximal", "_distal")) and field.low < 0.0
    if field.name == "ratio" or is_arm:
        wrong += [0.0]
    changed = exported.parameters.copy()
    changed[place] = data.draw(st.sampled_from(wrong))
    assert exported.take(changed, "set_parameters") == place + 1
    assert exported.memory.tobytes() == before


@needs_compiler
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"low": 2.0, "high": 2.0}, "high"),
        ({"flexor_static_friction": 1e-6}, "flexor_static_friction"),
        (
            {"extensor_tension_exponent": 0.1, "extensor_pretension": 0.0},
            "extensor_tension_exponent",
        ),
    ],
)
def test_parameters_that_contradict_each_other_are_named(
    changes: dict[str, float], named: str, made: Made
) -> None:
    folder, plan = made("wrist", "stiction")
    exported = Library(folder, plan)
    names = [field.name for field in plan.fields]
    changed = exported.parameters.copy()
    for name, value in changes.items():
        changed[names.index(name)] = value
    assert exported.take(changed) == names.index(named) + 1


@needs_compiler
@pytest.mark.parametrize(
    ("name", "place"),
    [*(("stiction", i) for i in range(6)), *(("predictive", i) for i in range(4))],
)
def test_the_guard_rides_through_readings_that_cannot_be_as_in_the_library(
    name: str, place: int, made: Made
) -> None:
    """One of them, a spike, and then so many that it stops."""
    readings = episode("wrist", name)[0][:80].copy()
    readings[20, place] = np.nan
    readings[30, place] += 50.0
    readings[40:42, place] = np.inf, -1.1e6
    readings[60:75, place] = 1e300
    exported = Library(*made("wrist", name))
    exported.take(exported.parameters)
    before = readings.copy()
    found = exported.motor_torques(readings)
    assert np.array_equal(readings, before, equal_nan=True)
    law = controller(name, drive_of("wrist", name))
    assert np.array_equal(found, python(law, readings, name))
    assert np.isfinite(found).all()


@needs_compiler
def test_what_the_observer_finds_is_told_in_c(made: Made, tmp_path: Path) -> None:
    folder, _ = made("wrist", "stiction")
    readings, _ = episode("wrist", "stiction")
    row = ", ".join(map(repr, readings[0].tolist()))
    (tmp_path / "main.c").write_text(
        f"""#include <stdio.h>
        #include "cc_controller.h"
        int main(void) {{
            static cc_controller c;
            cc_readings r = {{ {row} }};
            cc_controller_init(&c, cc_controller_parameters);
            double torque;
            for (int i = 0; i < 3; i++) cc_controller_step(&c, &r, &torque);
            for (int i = 0; i < cc_controller_nodes(CC_CABLE_EXTENSOR); i++)
                printf("%.17g\\n", cc_controller_tensions(&c, CC_CABLE_EXTENSOR)[i]);
            printf("%.17g\\n", cc_controller_joint_angle(&c, 0));
        }}"""
    )
    run(
        COMPILER, *STRICT, "-I", folder, "-o", tmp_path / "main", tmp_path / "main.c",
        *objects(folder), "-lm",
    )  # fmt: skip
    *tensions, angle = map(float, run(tmp_path / "main").split())
    law: Any = controller("stiction", device("wrist").drive)
    python(law, np.tile(readings[0], (3, 1)))
    model = law_steps.model_memory(law._memory[0], law._shape)
    assert np.array_equal(tensions, node_tensions(model.state[1], model.cables.n[1]))
    assert angle == law._memory[0, law_steps.JOINT_ANGLE]


BARE = [
    "-mthumb", "-mfloat-abi=hard", "--specs=rdimon.specs", "-Wconversion", "-Wshadow",
    "-Wl,--section-start=.vectors=0x0,--section-start=.init=0x400",
    "-Wl,-Ttext=0x500,-Tdata=0x20000000",
    Path(__file__).with_name("cortex_m.c"),
]  # fmt: skip
BOARD = ["-nographic", "-semihosting-config", "enable=on,target=native", "-kernel"]
TABLE_PROGRAM = """#include <stdio.h>
#include "cc_controller.h"
static const cc_readings rows[] = {
%s};
int main(void)
{
    static cc_controller controller;
    double torques[CC_AXES];
    if (cc_controller_init(&controller, cc_controller_parameters)) return 2;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cc_controller_step(&controller, rows + i, torques);
        printf("%%.17g\\n", torques[0]);
    }
    return 0;
}
"""


def bare_example(
    folder: Path,
    built: Path,
    readings: Array,
    compiler: Sequence[Any],
    emulator: Sequence[str],
) -> Array:
    """Return the torques of a program with its readings, which no system runs."""
    cells = ("    {" + ", ".join(map(repr, row)) + "},\n" for row in readings.tolist())
    (built / "table.c").write_text(TABLE_PROGRAM % "".join(cells))
    sources = [folder / f"{name}.c" for name in ("cc_controller", "cc_parameters")]
    words = [*compiler, *STRICT, "-O2", "-I", folder, "-o", built / "table.elf"]
    run(*words, built / "table.c", *sources, "-lm")
    example = folder / "cc_example.c"  # it compiles, but nothing gives it a file
    run(*compiler[:-1], *STRICT, "-c", example, "-o", built / "example.o")
    return np.array(list(map(float, run(*emulator, built / "table.elf").split())))


MACHINES: dict[str, tuple[list[Any], list[str]]] = {
    "aarch64": (["aarch64-linux-gnu-gcc"], ["qemu-aarch64"]),
    "armv7": (["arm-linux-gnueabihf-gcc"], ["qemu-arm"]),
    "cortex-m4f": (
        ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", *BARE],
        ["qemu-system-arm", "-M", "mps2-an386", *BOARD],
    ),
    "cortex-m7": (
        ["arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", *BARE],
        ["qemu-system-arm", "-M", "mps2-an500", *BOARD],
    ),
}
"""Compiler and emulator; of a microcontroller without an operating system the C library
is newlib, and a Cortex-M4F computes doubles in software."""
BRIEFLY = [("wrist", "pi")]
"""Cases of every run; all others belong to the study tests."""
NEWLIB_ERROR = 1e-9
"""Most that torques differ by where another C library rounds otherwise [N m]."""
WITHOUT_FUSED = "GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"


@pytest.mark.parametrize("target", study_unless("cortex-m7".__ne__, MACHINES))
@pytest.mark.parametrize(
    ("scene", "name"),
    study_unless(BRIEFLY.__contains__, itertools.product(DEVICES, EXPORTED)),
)
def test_other_machines_give_the_same_bits(
    target: str, scene: str, name: str, made: Made, tmp_path: Path
) -> None:
    """Torques are equal bit for bit if the C libraries round equally.

    The library of this machine uses fused multiply-add if the processor has it; that of
    32-bit ARM does not.
    """
    compiler, machine = MACHINES[target]
    for needed in (compiler[0], machine[0], "gcc"):
        if shutil.which(needed) is None:
            pytest.skip(f"{needed} is not installed")
    folder, plan = made(scene, name)
    readings, torques = episode(scene, name)
    if target.startswith("cortex"):
        found = bare_example(folder, tmp_path, readings[:150], compiler, machine)
        assert np.abs(found - torques[:150]).max() <= NEWLIB_ERROR
        return
    sources = [folder / f"cc_{part}.c" for part in ("example", "parameters")]
    built = [*compiler, *STRICT, "-O2", "-static", "-o", tmp_path / "example"]
    run(*built, *sources, folder / "cc_controller.c", "-lm")
    found = example(tmp_path / "example", plan, readings, *machine)
    assert np.abs(found - torques).max() <= 1e-9
    if not np.array_equal(found, torques):
        words = "env", WITHOUT_FUSED
        assert np.array_equal(found, example(program(folder), plan, readings, *words))


@pytest.mark.parametrize("name", EXPORTED)
@pytest.mark.parametrize("scene", DEVICES)
def test_every_scene_has_a_plan_whose_values_are_within_their_ranges(
    scene: str, name: str
) -> None:
    plan = plan_of(scene, name)
    for field in plan.fields:
        assert field.low <= field.value <= field.high, field
    assert len(set(field.name for field in plan.fields)) == len(plan.fields)


def test_what_cannot_be_exported_is_one_sentence() -> None:
    env = device("wrist")
    cables = driven("wrist")
    for name, says in (
        ("fused", "'fused' cannot be exported"),
        ("stction", "did you mean 'stiction'"),
        ("runs/ppo/0.safetensors", "there is no such file"),
        ("mine:law", "code from outside is not compiled; policies and"),
    ):
        with pytest.raises(CableError, match=says):
            ExportPlan.of(name, [env.drive], [cables])
    with pytest.raises(CableError, match="needs to know the cables"):
        ExportPlan.of("model", [Drive(5.0, -1.0, 1.0, 1e-3)], [()])


@needs_compiler
def test_what_a_slope_of_tension_rests_on_cannot_be_exchanged(made: Made) -> None:
    """Viscous friction would bias the estimates of friction without warning."""
    (cable,) = driven("exosuit")
    folder, plan = made("exosuit", "adaptive")
    exported = Library(folder, plan)
    names = [field.name for field in plan.fields]
    for name, value in (
        (f"{cable}_viscous_friction", 5.0),
        (f"{cable}_grease_drag", 1.0),
        (f"{cable}_friction", 0.0),
        ("learning", 5.0),
        (f"{cable}_sensor_1_deviation", 0.0),
    ):
        changed = exported.parameters.copy()
        changed[names.index(name)] = value
        assert exported.take(changed) == names.index(name) + 1
    changed = exported.parameters.copy()
    changed[names.index(f"{cable}_friction_drift")] = 0.1
    assert exported.take(changed) == 0
    known = device("exosuit").drives[0]
    row = tuple(
        dataclasses.replace(one, cable=one.cable.replace(viscous_friction=5.0))
        for one in known.cables
    )
    drive = dataclasses.replace(known, cables=row)
    with pytest.raises(CableError, match="the slope of the logarithm of tension"):
        ExportPlan.of("adaptive", [drive], [driven("exosuit")])


@needs_compiler
@pytest.mark.parametrize("place", [-2, -4])
def test_a_tension_that_is_no_number_gives_none_and_changes_nothing(
    place: int, made: Made
) -> None:
    readings, torques = episode("exosuit", "adaptive")
    exported = Library(*made("exosuit", "adaptive"))
    exported.take(exported.parameters)
    exported.motor_torques(readings[:20])
    lost = readings[20].copy()
    lost[place] = np.nan
    before = exported.memory.tobytes()
    assert (exported.step(lost) == 0.0).all()
    assert exported.wrong == 1 + lost.size + place
    assert exported.memory.tobytes() == before
    assert exported.step(readings[20]) == torques[20]
    assert exported.wrong == 0


WILD = np.array([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e6, -1.1e6, 1e4, 1e-300, 0.0])


def wild_rows(plan: ExportPlan, rng: np.random.Generator, count: int) -> Array:
    """Return readings of a moving joint among which are some that cannot be."""
    usual, _ = episode("wrist", "pi")
    known = dict(zip(plan_of("wrist", "pi").seen, usual.T, strict=True))
    calm = np.column_stack(
        [known.get(name, np.full(len(usual), 20.0)) for name in plan.seen]
    )
    first = rng.integers(len(calm) - count)
    rows = calm[first : first + count].copy()
    for row, kind in zip(rows, rng.integers(0, 6, count), strict=True):
        if kind == 0:
            row[rng.integers(row.size)] = rng.choice(WILD)
        elif kind == 1:
            row[:] = rng.choice(WILD, row.size)
        elif kind == 2:
            row[:] = rng.normal(size=row.size) * 10.0 ** rng.uniform(-3, 6, row.size)
    return rows


@needs_compiler
@pytest.mark.parametrize(("scene", "name"), CASES)
def test_no_input_makes_a_torque_that_is_no_number(
    scene: str, name: str, made: Made
) -> None:
    """Neither in C nor in Python, where both have the same bits."""
    folder, plan = made(scene, name)
    exported, law = Library(folder, plan), controller(name, drive_of(scene, name))
    rng = np.random.default_rng(7)
    heard = 0
    for _ in range(3):
        assert exported.take(exported.parameters) == 0
        law.reset()
        for row in wild_rows(plan, rng, 80):
            (found,) = exported.step(row)
            assert law.drive.low <= found <= law.drive.high
            if exported.wrong == 0 or name == "none":
                assert law.torque(seen(plan, row)) == found
                heard += 1
            else:
                assert found == 0.0
                with pytest.raises(CableError, match="must be finite numbers"):
                    law.torque(seen(plan, row))
            if rng.random() < 0.3:
                got = rng.choice(WILD)
                exported.given(np.array([got]))
                law.given(got)
    assert heard > 100


def test_the_files_are_those_that_are_told(made: Made) -> None:
    folder, _ = made("wrist", "pi")
    assert {path.name for path in folder.iterdir()} - {"built"} == set(EXPORT_FILES)


@pytest.mark.usefixtures("unmeasured")
def test_only_a_controller_that_is_passive_in_simulation_is_written(
    tmp_path: Path,
) -> None:
    """`pi` is active on a finger with an inertia at its tip; `feedback` is passive."""
    refused = tmp_path / "finger"
    with pytest.raises(CableError, match=r"'pi' is not passive .* --no-check"):
        Export("finger", "pi", refused).run()
    assert not refused.exists()
    Export("finger", "pi", refused, no_check=True).run()
    Export("ankle", "feedback", tmp_path / "ankle").run()
    for folder in (refused, tmp_path / "ankle"):
        assert {path.name for path in folder.iterdir()} == set(EXPORT_FILES)


def test_a_check_is_made_once_for_a_controller_and_a_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[str] = []

    def simulated(device: Any, law: str, *_: Any) -> Any:
        made.append(law)
        return 1e-3, 2e-3, (1.0, 2.0, 3.0)

    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(tmp_path / "kept"))
    monkeypatch.setattr("cc_mujoco.export._passivity._activity", simulated)
    monkeypatch.setattr("shutil.which", lambda name: None)  # measures nothing
    for place, (scene, name) in enumerate(
        [("wrist", "pi"), ("wrist", "pi"), ("wrist", "lqg"), ("ankle", "lqg")]
    ):
        Export(scene, name, tmp_path / str(place)).run()
    assert made == ["pi", "lqg", "lqg"]
    told = "passivity: 1 mJ into the worst of 24 wearers in simulation, of 2 allowed"
    assert capsys.readouterr().out.count(told) == 4
    for file in (HEADER_FILE, "README.md"):
        assert told in (tmp_path / "1" / file).read_text()
    Export("wrist", "pi", tmp_path / "0", no_check=True).run()
    for file in (HEADER_FILE, "README.md"):
        assert "passivity: NOT CHECKED" in (tmp_path / "0" / file).read_text()
    assert len(made) == 3


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
def test_stack_and_work_are_told_where_there_is_gcc(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(tmp_path))
    small, large = (measure(plan_of("wrist", name)) for name in ("none", "pi_tuned"))
    assert small.stack and large.stack and small.stack < large.stack < 10_000
    assert small.blocks and large.blocks and small.blocks < large.blocks < 10_000
    monkeypatch.setattr("shutil.which", lambda name: None)
    unknown = measure(plan_of("wrist", "none"))
    assert all("not known" in line for line in unknown.lines())


WILD_PROGRAM = """#include <math.h>
#include <stdio.h>
#include "cc_controller.h"
static cc_controller controller;
int main(void)
{
    struct { cc_readings seen; double got[CC_AXES]; } row;
    double torques[CC_AXES];
    if (cc_controller_init(&controller, cc_controller_parameters)) return 2;
    while (fread(&row, sizeof row, 1, stdin) == 1) {
        cc_controller_step(&controller, &row.seen, torques);
        for (int i = 0; i < CC_AXES; i++)
            if (!isfinite(torques[i])) return 3;
        cc_controller_given(&controller, row.got);
    }
    return 0;
}
"""


@pytest.mark.parametrize("compiler", study_but(2, ["gcc", "clang"]))
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name == "inverse" else pytest.mark.study)
        for name in EXPORTED
    ],
)
def test_no_input_leaves_memory_or_the_defined(
    name: str, compiler: str, made: Made, tmp_path: Path
) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    folder, plan = made("wrist", name)
    (tmp_path / "main.c").write_text(WILD_PROGRAM)
    sources = [folder / f"cc_{part}.c" for part in ("controller", "parameters")]
    checks = "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1"
    run(
        compiler, *STRICT, *checks, "-I", folder, "-o", tmp_path / "main",
        tmp_path / "main.c", *sources, "-lm",
    )  # fmt: skip
    rng = np.random.default_rng(5)
    rows = np.vstack([wild_rows(plan, rng, 100) for _ in range(3)])
    rows = np.column_stack([rows, rng.choice(WILD, len(rows))])
    done = subprocess.run(
        [tmp_path / "main"], input=rows.tobytes(), capture_output=True
    )
    assert (done.returncode, done.stderr.decode()) == (0, "")


@needs_compiler
def test_the_last_plan_goes_on_where_iterations_do_not_suffice(made: Made) -> None:
    """C and Python agree; more iterations than are needed change nothing."""
    readings, torques = episode("wrist", "predictive")
    drive = drive_of("wrist", "predictive")
    exported, found = Library(*made("wrist", "predictive")), []
    for iterations in (64.0, 1000.0):
        plan = ExportPlan.of(
            "predictive", [drive], [driven("wrist")], iterations=iterations
        )
        exported.take(plan.values())
        found.append(exported.motor_torques(readings[:300]))
        law = PredictiveCompensation(drive, iterations=iterations)
        assert np.array_equal(found[-1], python(law, readings[:300], "predictive"))
    few, many = found
    assert np.array_equal(many, torques[:300])
    assert np.isfinite(few).all() and 0.05 < np.mean(few != many)
    with pytest.raises(CableError, match="8 knots need 64 or more"):
        PredictiveCompensation(drive, iterations=63)
    with pytest.raises(CableError, match="'pi' plans nothing: no iterations"):
        ExportPlan.of("pi", [drive], [driven("wrist")], iterations=64.0)
