"""Materials of a design: rows with sources, and what they set."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import pytest

from cc_mujoco import design
from cc_mujoco.design import StudySpec, make_plan, study
from cc_mujoco.device import MATERIALS, Plant, load_device
from cc_mujoco.device._materials import ENDS, area
from cc_mujoco.errors import CableError

FOLDER = Path(design.__file__).parent
with (FOLDER / "material_sources.csv").open(encoding="utf-8") as file:
    SOURCES = {row["source"] for row in csv.DictReader(file)}

SHORT: dict[str, Any] = {
    "duration": 0.1,
    "timestep": 1e-3,
    "controllers": ["pi"],
    "metrics": ["rms_torque_error", "peak_tension", "strength_used"],
    "threads": 1,
}


NEWTON, INCH = 4.4482216, 0.0254  # of a pound, in metres


def per_area(pounds: float, inches: float) -> float:
    return pounds * NEWTON / area(INCH * inches)


def turned(share: float) -> float:
    """Return the friction of which half a turn leaves a share of the tension."""
    return -math.log(share) / math.pi


AEROSPACE = 100.0 * NEWTON / (0.0000162 * area(INCH))  # 1 % of stretch a pound
FIGURES = {
    ("steel_ptfe", "modulus"): (111.824e9 * 365.279 / 804.248, AEROSPACE, AEROSPACE),
    ("steel_ptfe", "density"): (2.867 / area(0.032), *[0.124 / area(0.006)] * 2),
    ("steel_ptfe", "strength"): (
        per_area(4800.0, 0.25), 21.2e3 / area(0.006), per_area(480.0, 0.0625),
    ),
    ("dyneema_steel", "modulus"): (
        AEROSPACE, AEROSPACE, 1000.0 * NEWTON / 0.00078 / area(0.009),
    ),
    ("dyneema_steel", "density"): (0.15 * 0.124 / area(0.006),) * 3,
    ("dyneema_steel", "strength"): (
        per_area(8000.0, 0.25), per_area(5400.0, 0.1875), per_area(12e3, 0.25),
    ),
    ("dyneema_steel", "friction"): (turned(0.60), turned(0.60), turned(0.48)),
}  # fmt: skip


@pytest.mark.parametrize(("pair", "name"), FIGURES)
def test_a_figure_follows_from_its_sources(pair: str, name: str) -> None:
    found = getattr(MATERIALS[pair], name)
    shown = found.low, found.typical, found.high
    assert shown == pytest.approx(FIGURES[pair, name], rel=1e-12)


@pytest.mark.parametrize("name", MATERIALS)
def test_every_figure_is_a_range_about_its_typical_value_and_has_a_source(
    name: str,
) -> None:
    row = MATERIALS[name]
    figures = [row.friction, row.modulus, row.density, row.strength]
    for figure in [*figures, *([row.hottest] if row.hottest else [])]:
        assert 0.0 < figure.low <= figure.typical <= figure.high
        assert figure.sources and set(figure.sources) <= SOURCES
    # What any rope is: softer and lighter than what it is made of, and no gas.
    assert 1e9 < row.modulus.typical < 210e9
    assert 500.0 < row.density.typical < 7850.0
    assert row.strength.high < 0.05 * row.modulus.typical


def test_every_source_is_used() -> None:
    rows = MATERIALS.values()
    figures = [f for r in rows for f in (r.friction, r.modulus, r.density, r.strength)]
    figures += [r.hottest for r in rows if r.hottest]
    assert {key for figure in figures for key in figure.sources} == SOURCES


@pytest.mark.parametrize("end", ENDS)
def test_a_material_is_what_its_numbers_set_by_hand_are(end: str) -> None:
    row, diameter = MATERIALS["steel_nylon"], 1.5e-3
    friction = row.friction.at(end)
    chosen = {"material": [row.name], "diameter": [diameter], "material_friction": end}
    by_hand = {
        "friction": [friction],
        "axial_stiffness": [row.modulus.typical * math.pi / 4.0 * diameter**2],
        "strength": [row.strength.typical * math.pi / 4.0 * diameter**2],
    }
    tables = [study("ankle", vary, **SHORT) for vary in (chosen, by_hand)]
    for name in SHORT["metrics"]:
        assert tables[0][name].equals(tables[1][name])


def test_static_friction_stays_as_far_above_kinetic_as_in_the_scene() -> None:
    device = load_device("wrist")
    scene = device.cables["flexor"]
    for name, cable in Plant(device, {"material": "steel_ptfe"}).cables.items():
        assert cable.friction == 0.06
        assert cable.static_friction / cable.friction == pytest.approx(
            scene.static_friction / scene.friction
        )
        own = Plant(device, {"material": "steel_ptfe", "static_friction": 0.07}).cables
        assert own[name].static_friction == 0.07


def test_stiffness_and_strength_go_with_the_square_of_each_cable_s_diameter() -> None:
    row = MATERIALS["dyneema_steel"]
    design = {"material": row.name, "flexor.diameter": 2e-3, "extensor.diameter": 1e-3}
    plant = Plant("wrist", design)
    cables, loads = plant.cables, plant.strength
    for found in (loads, {n: c.axial_stiffness for n, c in cables.items()}):
        assert found["flexor"] == pytest.approx(4.0 * found["extensor"])
    assert loads["extensor"] == pytest.approx(row.strength.typical * area(1e-3))


def test_a_material_s_friction_can_be_crossed() -> None:
    plan = make_plan(
        StudySpec(
            "ankle",
            {"material": "steel_ptfe,steel_nylon"},
            across={"material_friction": "low,high"},
            **{name: value for name, value in SHORT.items() if name != "threads"},
        )
    )
    assert [d["material"] for d in plan.designs] == ["steel_ptfe", "steel_nylon"]
    assert len(plan.protocol.across.cases) == 2


@pytest.mark.parametrize(
    ("scene", "design", "wrong"),
    [
        ("ankle", {"material": "steel"}, "unknown material 'steel': did you mean"),
        ("ankle", {"material": "steel_ptfe", "friction": 0.1}, "set the same thing"),
        ("ankle", {"material": "steel_ptfe", "strength": 9e3}, "set the same thing"),
        (
            "wrist",
            {"material": "steel_ptfe", "flexor.axial_stiffness": 9e3},
            "set the same thing",
        ),
        ("ankle", {"material_friction": "low"}, "needs a `material`"),
        ("ankle", {"material_friction": "most"}, "unknown material_friction 'most'"),
        ("finger", {"material": "steel_ptfe"}, "cable 'extensor' leaves"),
        ("wrist", {"flexor.material": "steel_ptfe"}, "belongs to no cable"),
    ],
)
def test_a_material_that_cannot_be_says_why(
    scene: str, design: dict[str, object], wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong) as raised:
        Plant(scene, design).check()
    assert "\n" not in str(raised.value)
