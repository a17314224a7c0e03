"""Masses, costs and loads of parts: properties, and values computed by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cc_mujoco import cli
from cc_mujoco.design import StudySpec, make_plan, optimise, study
from cc_mujoco.design._bill_of_materials import EXAMPLE, read_costs
from cc_mujoco.design._protocol import DEFAULT_METRICS
from cc_mujoco.device import MATERIALS, MOTORS, Plant, load_device
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import METRICS, ArrayLog

PARTS = [name for name, metric in METRICS.items() if metric.test == "parts"]
MOTOR = "maxon_353297"
SHORT: dict[str, Any] = {
    "duration": 0.1,
    "timestep": 1e-3,
    "controllers": ["pi"],
    "threads": 1,
}


def parts(scene: str, design: dict[str, Any], **how: Any) -> dict[str, float]:
    """Return the metrics of the parts of one design."""
    table = study(scene, designs=[design], metrics=PARTS, **{**SHORT, **how})
    return {name: table[name][0].as_py() for name in PARTS}


MOTOR_METRICS = (
    "rms_motor_torque",
    "thermal_load",
    "motor_heat",
    "electrical_power",
)
SHEET = {"winding_resistance": 0.5, "torque_constant": 0.1, "continuous_torque": 0.4}


def measured(
    torque: np.ndarray, speed: float = 0.0, gear: float = 1.0, **sheet: float
) -> dict[str, float]:
    """Return the metrics of a motor with this torque [N m] at this speed [rad/s]."""
    columns = {
        "motor_torque_nm": torque,
        "motor_velocity_rad_s": np.full(torque.size, speed),
    }
    log = ArrayLog(columns, metadata={"gearing": gear, **(sheet or SHEET)})
    return {name: METRICS[name].compute(log) for name in MOTOR_METRICS}


@pytest.mark.parametrize("gear", [1.0, 5.0])
def test_a_constant_torque_is_its_rms_and_heats_as_ohm_says(gear: float) -> None:
    found = measured(np.full(50, -0.6), gear=gear)
    assert found["rms_motor_torque"] == pytest.approx(0.6)
    assert found["thermal_load"] == pytest.approx(0.6 / gear / 0.4)
    assert found["motor_heat"] == pytest.approx(0.5 * (0.6 / gear / 0.1) ** 2)
    assert found["electrical_power"] == pytest.approx(found["motor_heat"])


def test_without_torque_there_is_no_heat_and_nothing_is_drawn() -> None:
    found = measured(np.zeros(50), speed=7.0)
    assert found["motor_heat"] == found["electrical_power"] == 0.0
    assert found["thermal_load"] == found["rms_motor_torque"] == 0.0


def test_heat_is_that_of_the_rms_torque_however_it_is_spread() -> None:
    torque = np.random.default_rng(0).normal(size=400)
    spread = measured(torque)
    even = measured(np.full(400, spread["rms_motor_torque"]))
    assert spread["motor_heat"] == pytest.approx(even["motor_heat"])


def test_a_motor_that_is_driven_gives_nothing_back_but_heats() -> None:
    giving, taking = (measured(np.full(50, t), speed=30.0) for t in (0.2, -0.2))
    assert giving["motor_heat"] == pytest.approx(taking["motor_heat"])
    assert giving["electrical_power"] == pytest.approx(6.0 + giving["motor_heat"])
    assert taking["electrical_power"] == 0.0


def test_a_motor_of_which_nothing_is_known_has_no_heat_but_an_rms() -> None:
    found = measured(np.ones(9), rotor_inertia=1e-4)
    assert found["rms_motor_torque"] == 1.0
    assert math.isnan(found["motor_heat"]) and math.isnan(found["thermal_load"])


def test_parts_of_the_ankle_are_what_pencil_and_paper_say() -> None:
    design = {"material": "steel_ptfe", "motor": MOTOR, "diameter": 0.002}
    found = parts("ankle", design)
    row, axis = MATERIALS["steel_ptfe"], load_device("ankle").description.axis()
    length = 0.06 + 1.475 + 0.698
    circle = math.pi / 4.0 * 0.002**2
    rope = row.density.typical * circle
    coil = 7850.0 * circle * (2.6**2 - 1.75**2)
    assert found["cable_mass"] == pytest.approx(length * (rope + coil))
    drum = 2.0 * axis.motor_pulley / 0.025**2
    assert found["mass"] == pytest.approx(found["cable_mass"] + 2.1 + drum)
    assert found["bend_ratio"] == pytest.approx(2.0 * 0.025 / 0.002)
    wire = 0.002 / 15  # three strands of five wires across
    assert found["bending_stress"] == pytest.approx(207e9 * wire / 0.05)
    assert found["cost"] == pytest.approx(300 + 20 + length * (5 + 10) + 10)
    rotor = 1.34e-4 * 5.0**2 + axis.motor_pulley
    assert found["reflected_inertia"] == pytest.approx(
        rotor * (0.12 / 0.025) ** 2, rel=1e-3
    )
    # A metric of `metrics.csv` that has no function is one of these.
    assert all(math.isfinite(value) for value in found.values())


def test_masses_grow_with_the_square_of_diameter_and_of_radius() -> None:
    base = {"material": "dyneema_steel", "motor_mass": 0.0, "diameter": 0.001}
    thin, thick, wide, bare = (
        parts("wrist", base | more)
        for more in (
            {},
            {"diameter": 0.003},
            {"motor_radius": 0.04, "joint_radius": 0.208},
            {"conduit_linear_mass": 0.0},
        )
    )
    assert thick["cable_mass"] == pytest.approx(9.0 * thin["cable_mass"])
    assert thick["bend_ratio"] == pytest.approx(thin["bend_ratio"] / 3.0)
    pulleys = [one["mass"] - one["cable_mass"] for one in (thin, wide)]
    assert pulleys[1] == pytest.approx(4.0 * pulleys[0])
    assert thin["bending_stress"] is None  # fibres
    rope = MATERIALS["dyneema_steel"].density.typical * math.pi / 4.0 * 1e-6
    assert bare["cable_mass"] == pytest.approx(2.0 * 2.0 * rope)


def test_one_tight_bend_decides() -> None:
    design = {"conduit": "1:0.4 0.1:0.01 0.9:inf", "diameter": 0.001}
    assert parts_asked("wrist", design) == pytest.approx(20.0)
    assert parts_asked("wrist", {"diameter": 0.001}) == pytest.approx(40.0)


def parts_asked(scene: str, design: dict[str, Any]) -> float | None:
    """Return the metric `bend_ratio`, which needs no material."""
    table = study(scene, designs=[design], metrics=["bend_ratio"], **SHORT)
    found: float | None = table["bend_ratio"][0].as_py()
    return found


def test_a_cable_that_leaves_its_conduit_has_no_such_numbers() -> None:
    assert parts_asked("finger", {"friction": 0.1}) is None


def test_a_motor_is_what_its_numbers_set_by_hand_are() -> None:
    row = MOTORS[MOTOR]
    chosen = {"motor": MOTOR, "friction": 0.1}
    by_hand = {
        "friction": 0.1,
        "rotor_inertia": row.rotor_inertia * 5.0**2,
        "winding_resistance": row.resistance,
        "torque_constant": row.torque_constant,
        "continuous_torque": row.continuous_torque,
        "motor_mass": row.mass,
    }
    names = ["rms_torque_error", "thermal_load", "motor_heat", "electrical_power"]
    names += ["reflected_inertia"]
    tables = [
        study("ankle", designs=[design], metrics=names, **SHORT)
        for design in (chosen, by_hand)
    ]
    for name in names:
        assert tables[0][name].equals(tables[1][name])
        assert tables[0][name][0].as_py() > 0.0


def test_unasked_a_study_measures_what_its_designs_have() -> None:
    how = {name: value for name, value in SHORT.items() if name != "threads"}
    plain = make_plan(StudySpec("ankle", {"friction": "0.1"}, **how)).protocol.metrics
    assert {"rms_motor_torque", "bend_ratio", "reflected_inertia"} <= set(plain)
    assert not {"cable_mass", "mass", "motor_heat", "cost"} & set(plain)
    vary = {"material": "steel_ptfe", "motor": MOTOR}
    rich = make_plan(StudySpec("ankle", vary, costs=EXAMPLE, **how)).protocol.metrics
    assert rich == (*DEFAULT_METRICS, "cost")
    crossed = {"material": "steel_ptfe,steel_nylon"}
    across = make_plan(
        StudySpec("ankle", {"motor_radius": "0.02"}, across=crossed, **how)
    )
    assert "cable_mass" in across.protocol.metrics


def test_mass_is_objective_and_limit_of_a_search() -> None:
    table = optimise(
        "wrist",
        {"material": "steel_ptfe,dyneema_steel", "diameter": "0.0005:0.002:4"},
        ["cable_mass"],
        ["bend_ratio<=40"],
        evaluations=6,
        **{**SHORT, "duration": 0.05},
    )
    assert table["cable_mass"].null_count == 0
    ratio = 0.04 / np.array(table["diameter"].to_pylist())
    assert table["bend_ratio"].to_pylist() == pytest.approx(ratio.tolist())


@pytest.mark.parametrize(
    ("vary", "metric", "wrong"),
    [
        ({"friction": 0.1}, "motor_heat", "'motor' or 'winding_resistance'"),
        ({"winding_resistance": 1.0}, "motor_heat", "'motor' or 'torque_constant'"),
        ({"friction": 0.1}, "cable_mass", "'material' or 'rope_density'"),
        ({"material": "steel_ptfe"}, "mass", "'motor' or 'motor_mass'"),
        ({"rope_density": 1e3}, "bending_stress", "'material'"),
    ],
)
def test_a_metric_says_what_it_lacks(
    vary: dict[str, Any], metric: str, wrong: str
) -> None:
    with pytest.raises(CableError, match=f"{metric!r} needs .* {wrong}") as raised:
        study("ankle", vary, metrics=[metric], **SHORT)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("scene", "design", "wrong"),
    [
        ("wrist", {"motor": "maxon"}, "unknown motor 'maxon'"),
        ("wrist", {"motor": MOTOR, "rotor_inertia": 1e-4}, "set the same thing"),
        ("wrist", {"motor": MOTOR, "motor_mass": 1.0}, "set the same thing"),
        ("finger", {"motor": MOTOR}, "needs a `gearing`"),
        ("exosuit", {"continuous_torque": 1.0}, "needs a `gearing`"),
    ],
)
def test_a_motor_that_cannot_be_says_why(
    scene: str, design: dict[str, object], wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong):
        Plant(scene, design).check()


HEAD = "part,per,cost\n"
ALL = EXAMPLE.read_text("utf-8")


def test_costs_that_nothing_asks_for_are_refused() -> None:
    with pytest.raises(CableError, match="costs are for the metric 'cost'"):
        study("wrist", {"friction": 0.1}, metrics=["bend_ratio"], costs=EXAMPLE,
              **SHORT)  # fmt: skip


def test_a_table_of_costs_replaces_the_example(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(ALL + f"{MOTOR},piece,900\nsteel_ptfe,m,25\n", "utf-8")
    design = {"material": "steel_ptfe", "motor": MOTOR}
    more = parts("wrist", design, costs=path)["cost"] - parts("wrist", design)["cost"]
    assert more == pytest.approx(900 - 300 + 2 * 2.0 * (25 - 5))


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "is empty; its first line must name the columns"),
        ("part;cost\n", "must begin with the line part,per,cost"),
        (HEAD + "motor,piece,3\n", "lacks the cost of pulley, rope"),
        (ALL + "motor,piece,3\n", "'motor' twice"),
        (ALL + "screw,piece,3\n", "unknown part 'screw'"),
        (ALL.replace("rope,m", "rope,ft"), "'rope' must be per m, not per 'ft'"),
        (ALL.replace(",300", ",-3"), "must be a number of at least 0, not '-3'"),
        (ALL.replace(",300", ",dear"), "not 'dear'"),
        (HEAD + "motor,piece\n", "must have 3 cells"),
    ],
)
def test_a_table_of_costs_that_is_none_says_why(
    text: str, wrong: str, tmp_path: Path
) -> None:
    path = tmp_path / "costs.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(CableError, match=wrong) as raised:
        read_costs(path)
    assert "\n" not in str(raised.value)
    with pytest.raises(CableError, match="cannot read the costs"):
        read_costs(tmp_path / "none.csv")


def test_the_command_takes_costs_and_ranks_by_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text(ALL.replace(",5\n", ",50\n"), "utf-8")
    words = ["whatif", "wrist", "--vary", "material=steel_ptfe"]
    words += ["--vary", "length=1,3", "--metric", "cost", "--objective", "cost"]
    words += ["--duration", "0.1", "--costs", "mine.csv", "--out", "study"]
    assert cli.main(words) == 0
    assert capsys.readouterr().err.startswith("warning: The friction of a material")
    table = pa.parquet.read_table(tmp_path / "study" / "table.parquet")
    assert table["cost"].to_pylist() == [340 + 20 + 2 * n * 60 for n in (1, 3)]
    assert "cost" in (tmp_path / "study" / "report.html").read_text("utf-8")
