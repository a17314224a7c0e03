"""Exported controllers of several axes: one step for all motors."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.cable._layout import tensions
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import axes_controller
from cc_mujoco.device import DeviceModel, Plant, find_device
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.export import EXPORT_FILES, ExportPlan, write
from cc_mujoco.export._command import Export
from export.library import COMPILER, GUARD, STRICT, Library, device, needs_compiler, run
from hardware.devices import ARM, written
from shared_folder import SHARED
from study_marks import study_unless

Array = NDArray[np.float64]
Made = Callable[[str, str], tuple[Path, ExportPlan]]

CASES = SHARED / "cases" / "device"
COUPLED = "hand", "bilateral"
STEPS = 300


@functools.cache
def plan_of(scene: str, name: str) -> ExportPlan:
    env = device(scene)
    own = env.exo.device
    return ExportPlan.of(name, env.drives, own.driven, own.prefixes)


def columns_of(scene: str, name: str) -> list[str]:
    """Return the column of every reading."""
    axes, prefixes = plan_of(scene, name).axes, device(scene).exo.device.prefixes
    return [
        prefix + column
        for axis, prefix in zip(axes, prefixes, strict=True)
        for column in (*axis.columns, *axis.other_columns)
    ]


def law_of(scene: str, name: str) -> Any:
    env = device(scene)
    return axes_controller(name, env.drives, env.exo.device.prefixes)


def seen(columns: list[str], row: Array) -> dict[str, float]:
    """Return the Python readings that match these C readings."""
    found = dict(zip(columns, row.tolist(), strict=True))
    for prefix in {column.rpartition(".")[0] for column in columns}:
        if any(f"{prefix}.{name}" in found for name in WINDING_COLUMNS):
            found = {f"{prefix}.{name}": 1.0 for name in WINDING_COLUMNS} | found
    return found


def torques_of(law: Any, columns: list[str], readings: Array) -> Array:
    """Return what a controller of the library answers."""
    law.reset()
    return np.array([law.torque(seen(columns, row)) for row in readings])


@functools.cache
def episode(scene: str, name: str) -> tuple[Array, Array]:
    """Return readings and torques of a controller that drives a noisy device."""
    env, law, columns = device(scene), law_of(scene, name), columns_of(scene, name)
    _, info = env.reset(seed=3)
    law.reset()
    random = np.random.default_rng(4)
    noise = {"motor_angle_rad": 1e-5, "motor_velocity_rad_s": 1e-2}
    noise |= {f"{axis}_velocity_rad_s": 1e-2 for axis in ("joint", "winding")}
    scale = [noise.get(column.rpartition(".")[2], 0.0) for column in columns]
    for place, column in enumerate(columns):
        if column.endswith("joint_torque_nm"):
            axis = env.exo.device.prefixes.index(column.removesuffix("joint_torque_nm"))
            scale[place] = 0.01 * env.drives[axis].reach[1]
    readings, torques = [], []
    for _ in range(STEPS):
        row = np.array([float(info[column]) for column in columns])
        row += random.normal(size=row.size) * scale
        readings.append(row)
        torques.append(law.torque(seen(columns, row)))
        *_, info = env.step(env.action(torques[-1]))
    return np.array(readings), np.array(torques)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Return the exports for this machine, each written once."""

    @functools.cache
    def written_once(scene: str, name: str) -> tuple[Path, ExportPlan]:
        folder, plan = tmp_path_factory.mktemp("export") / "c", plan_of(scene, name)
        write(folder, plan, "a test")
        return folder, plan

    return written_once


@needs_compiler
@pytest.mark.parametrize(
    ("scene", "name"),
    [
        *study_unless(
            lambda case: case[0] == "hand",
            [(scene, "decoupled_pi") for scene in COUPLED],
        ),
        pytest.param("hand", "decoupled_lqg", marks=pytest.mark.study),
        pytest.param("bilateral", "decoupled_inverse", marks=pytest.mark.study),
        pytest.param("hand", "decoupled_pi_feed_forward", marks=pytest.mark.study),
        ("exosuit", "hip=pi_tuned,ankle=pi"),
        pytest.param("exosuit", "hip=stiction,ankle=pi", marks=pytest.mark.study),
        pytest.param("bilateral", "stiction", marks=pytest.mark.study),
        pytest.param("hand", "decoupled_stiction", marks=pytest.mark.study),
        pytest.param("hand", "decoupled_predictive", marks=pytest.mark.study),
        pytest.param("bilateral", "decoupled_predictive", marks=pytest.mark.study),
    ],
)
def test_one_step_in_c_gives_the_torques_of_all_motors_bit_for_bit(
    scene: str, name: str, made: Made
) -> None:
    readings, torques = episode(scene, name)
    exported = Library(*made(scene, name))
    assert exported.library.cc_controller_size() == exported.memory.nbytes
    assert exported.take(exported.parameters) == 0
    assert np.array_equal(exported.torques(readings), torques)
    assert (np.ptp(torques, axis=0) > 0.02 * np.abs(torques).max(axis=0)).all()
    around = np.delete(exported.room, np.s_[GUARD:-GUARD])
    assert around.size == 2 * GUARD and np.isnan(around).all()
    exported.reset()
    assert np.array_equal(exported.torques(readings[:100]), torques[:100])


@needs_compiler
@pytest.mark.parametrize("scene", study_unless("hand".__eq__, COUPLED))
def test_decoupling_in_c_is_that_of_the_library_far_from_what_is_usual(
    scene: str, made: Made
) -> None:
    """Torques of any sign are at every bound, beyond what is safe, and in any pose.

    Each row begins anew, as a guard stops where rows contradict each other.
    """
    random, columns = np.random.default_rng(1), columns_of(scene, "decoupled_pi")
    reach = {
        prefix: max(map(abs, drive.reach))
        for drive, prefix in zip(
            device(scene).drives, device(scene).exo.device.prefixes, strict=True
        )
    }
    readings = random.normal(size=(400, len(columns)))
    for place, column in enumerate(columns):
        prefix, _, plain = column.rpartition(".")
        if plain.endswith("torque_nm"):
            readings[:, place] *= reach[prefix + "."]
        if plain == "leverage_ratio":
            readings[:, place] = 0.2 + np.abs(readings[:, place])
        if plain.startswith("torque_ratio_"):
            readings[:, place] *= 3.0
    exported = Library(*made(scene, "decoupled_pi"))
    assert exported.take(exported.parameters) == 0
    found, expected, plain = np.empty((3, len(readings), exported.axes))
    laws = law_of(scene, "decoupled_pi"), law_of(scene, "pi")
    for row in range(len(readings)):
        exported.reset()
        found[row] = exported.step(readings[row])
        expected[row], plain[row] = (
            torques_of(law, columns, readings[row : row + 1])[0] for law in laws
        )
    assert np.array_equal(found, expected)
    assert np.mean(np.abs(found - plain) > 1e-3 * np.ptp(plain)) > 0.3


@needs_compiler
def test_an_arm_that_cannot_be_is_a_torque_that_is_missing(made: Made) -> None:
    scene, name = "exosuit", "hip=stiction,ankle=pi"
    readings, columns = episode(scene, name)[0][:40].copy(), columns_of(scene, name)
    place = columns.index("hip.leverage_ratio")
    for row, arm in ((10, np.nan), (20, 0.0), (25, np.inf), (28, 1e308)):
        readings[row, place] = arm
    exported = Library(*made(scene, name))
    exported.take(exported.parameters)
    found = exported.torques(readings)
    assert np.isfinite(found).all()
    assert np.array_equal(found, torques_of(law_of(scene, name), columns, readings))


@needs_compiler
def test_one_reading_that_cannot_be_gives_no_torque_and_changes_nothing(
    made: Made,
) -> None:
    scene, name = "hand", "decoupled_pi"
    readings, torques = episode(scene, name)
    exported = Library(*made(scene, name))
    exported.take(exported.parameters)
    exported.torques(readings[:20])
    before = exported.memory.tobytes()
    names = columns_of(scene, name)
    for place in range(len(names)):
        lost = readings[20].copy()
        lost[place] = np.nan
        assert (exported.step(lost) == 0.0).all()
        assert exported.wrong == place + 1
    assert exported.memory.tobytes() == before
    assert np.array_equal(exported.step(readings[20]), torques[20])


@needs_compiler
def test_a_wrong_parameter_of_the_last_axis_is_named_and_none_is_taken(
    made: Made,
) -> None:
    folder, plan = made("hand", "decoupled_pi")
    exported = Library(folder, plan)
    exported.take(exported.parameters)
    exported.torques(episode("hand", "decoupled_pi")[0][:5])
    before = exported.memory.tobytes()
    names = [field.name for field in plan.fields]
    for name in ("integral", "ratio", "high", "safe_torque"):  # decoupling rests on 3
        place = names.index(f"middle_extensor_{name}")
        changed = 1.5 * exported.parameters
        changed[: place + 1] = exported.parameters[: place + 1]
        changed[place] *= -1.0 if name == "integral" else 0.9
        assert exported.take(changed, "set_parameters") == place + 1
        assert exported.memory.tobytes() == before


@pytest.mark.study
@needs_compiler
def test_what_the_motors_got_and_what_observers_find_are_those_of_their_axes(
    made: Made, tmp_path: Path
) -> None:
    scene, name = "exosuit", "hip=predictive,ankle=pi"
    folder, _ = made(scene, name)
    readings, torques = episode(scene, name)
    rows = ", ".join(f"{{{', '.join(map(repr, r))}}}" for r in readings[:30].tolist())
    (tmp_path / "main.c").write_text(
        f"""#include <stdio.h>
        #include "cc_controller.h"
        static const cc_readings rows[] = {{ {rows} }};
        int main(void) {{
            static cc_controller c;
            double torques[CC_AXES];
            int i, k;
            cc_controller_init(&c, cc_controller_parameters);
            for (i = 0; i < 30; i++) {{
                cc_controller_step(&c, rows + i, torques);
                for (k = 0; k < CC_AXES; k++) {{
                    printf("%.17g\\n", torques[k]);
                    torques[k] *= 0.5;
                }}
                cc_controller_given(&c, torques);
            }}
            printf("%.17g\\n", cc_controller_joint_angle(&c, CC_AXIS_HIP));
            printf("%.17g\\n", cc_controller_joint_angle(&c, CC_AXIS_ANKLE));
            for (k = 0; k < cc_controller_nodes(0); k++)
                printf("%.17g\\n", cc_controller_tensions(&c, CC_CABLES - 1)[k]);
        }}"""
    )
    run(
        COMPILER, *STRICT, "-I", folder, "-o", tmp_path / "main", tmp_path / "main.c",
        folder / "cc_parameters.c", folder / "cc_controller.c", "-lm",
    )  # fmt: skip
    found = list(map(float, run(tmp_path / "main").split()))
    law, columns = law_of(scene, name), columns_of(scene, name)
    law.reset()
    expected = []
    for row in readings[:30]:
        expected.append(law.torque(seen(columns, row)))
        law.given(0.5 * expected[-1])
    assert np.array_equal(found[:60], np.ravel(expected))
    assert not np.allclose(expected, torques[:30], rtol=1e-3)
    one: Any = law.laws[0]
    state, segments = one._memory[0, one._tables.states :], one._tables.shape[1]
    assert found[60:62] == [one._memory[0, law_steps.JOINT_ANGLE], 0.0]
    assert np.array_equal(found[62:], tensions(state, segments))


@pytest.mark.usefixtures("unmeasured")
def test_one_axis_of_several_is_exported_as_a_device_with_one(tmp_path: Path) -> None:
    scene = written(tmp_path, ARM)
    out = tmp_path / "out"
    Export(str(scene), "pi", out, no_check=True, axis="elbow").run()
    assert {path.name for path in out.iterdir()} == set(EXPORT_FILES)
    header = (out / "cc_controller.h").read_text()
    assert f"pi for axis elbow of the scene {scene}" in header
    assert "enum { CC_AXES = 1 };" in header and "    CC_RATIO, /*" in header
    Export(str(scene), "pi", out, no_check=True).run()
    header = (out / "cc_controller.h").read_text()
    assert "enum { CC_AXIS_ELBOW = 0, CC_AXIS_SHOULDER = 1, CC_AXES = 2 };" in header
    assert "double elbow_joint_torque_nm;" in header


def test_what_cannot_be_exported_of_several_axes_is_one_sentence(
    tmp_path: Path,
) -> None:
    scene = written(tmp_path, ARM)
    drives = DeviceModel(find_device(scene).description, Plant(scene).model()).drives(
        1e-3
    )
    names = "shoulder.", "elbow."
    for given, cables, prefixes, says in (
        ("policy.safetensors", names, names, "drives several axes at once"),
        ("decoupled_fused", names, names, "'fused' cannot be exported"),
        ("decoupled_none", names, names, "do not read the torque of their joint"),
        ("pi", names, ("a b.", "a_b."), "several .* have the name A_B"),
        ("elbow=pi", names, names, "axis 'shoulder' has no controller"),
    ):
        with pytest.raises(CableError, match=says):
            ExportPlan.of(given, drives, [(name,) for name in cables], prefixes)


@pytest.mark.shared
@pytest.mark.parametrize(
    "name",
    [
        "knee_exo",
        pytest.param("elbow", marks=pytest.mark.study),
        pytest.param("knee4", marks=pytest.mark.study),
        pytest.param("knee_mid", marks=pytest.mark.study),
    ],
)
@pytest.mark.usefixtures("unmeasured")
def test_devices_of_others_are_exported(name: str, tmp_path: Path) -> None:
    scene = str(CASES / f"{name}.xml")
    Export(scene, "stiction", tmp_path / "out", no_check=True).run()
    header = (tmp_path / "out" / "cc_controller.h").read_text()
    assert f"stiction for the scene {scene}" in header
