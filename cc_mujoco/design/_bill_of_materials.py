"""Mass, cost and tightest bends of a design's parts, without simulation.

Lengths are those of the conduits: rope beyond their ends is left out, as are gears,
levers, fittings and frames in the mass. If a cable leaves its conduit, only inertias
are known and the other metrics are missing.

    read_costs("mine.csv")          # part,per,cost with a line for each part

reads the cost of each part. `costs.csv` beside this file is an example with round
figures, to be replaced. A line for a motor of `MOTORS` or a material of `MATERIALS`
takes precedence over that of `motor` or `rope`.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import mujoco

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco.cable._cable import PATHS
from cc_mujoco.design._protocol import COST_METRIC
from cc_mujoco.device import MATERIALS, MOTORS, DeviceModel, Plant
from cc_mujoco.device._materials import area
from cc_mujoco.errors import CableError

EXAMPLE = Path(__file__).with_name("costs.csv")  # the default table

PARTS = dict(motor="piece", pulley="piece", rope="m", conduit="m", fittings="cable")
"""Parts that every table of costs must have, and the unit that a cost is for."""

_ALLOWED = PARTS | dict.fromkeys(MOTORS, "piece") | dict.fromkeys(MATERIALS, "m")


def inertias_of(plant: Plant, model: mujoco.MjModel) -> list[dict[str, float]]:
    """Return each axis's motor inertia at its joint [kg m^2], by name of the metric."""
    drives = DeviceModel(plant.description, model).drives(plant.description.period)
    return [{"reflected_inertia": one.inertia * one.ratio**2} for one in drives]


def parts_of(plant: Plant, costs: Mapping[str, float]) -> dict[str, float]:
    """Return mass, cost and bend metrics of all parts by name, as far as known."""
    cables, values = plant.cables, plant.values
    if any(cable.path != PATHS[0] for cable in cables.values()):
        return {}
    diameters, pulleys, discs = plant.diameters, plant.pulleys, plant.discs
    material, density = plant.material, float(values.get("rope_density", math.nan))
    if material is not None:
        density = material.density.typical
    ropes, ratios = 0.0, []
    for name, cable in cables.items():
        diameter = diameters[name]
        # The steel coil of the conduit, as about a bicycle's brake cable: 2.8 and 4.2
        # mm for 1.6 mm (assumed).
        inner, outer = (area(share * diameter) for share in (1.75, 2.6))
        coil = 7850.0 * (outer - inner)  # density of steel [kg/m^3]
        coil = float(values.get("conduit_linear_mass", coil))
        ropes += cable.length * (density * area(diameter) + coil)
        bends = (section.radius for section in cable.conduit)
        tightest = min(*bends, *pulleys[name], math.inf)
        ratios.append(2.0 * tightest / diameter)
    ratio = min(ratios)
    wires = 0 if material is None else material.wires
    modulus = 207e9  # of the steel of a wire [N/m^2] (source `calqlata`)
    motors = [plant.motor(axis) for axis in plant.description.axes]
    found = {
        "cable_mass": ropes,
        "mass": ropes + sum(motor.mass for motor in motors) + sum(discs),
        "bend_ratio": ratio,
        "bending_stress": modulus / (wires * ratio) if wires else math.nan,
    }
    if costs:
        per_metre = costs.get(str(values.get("material", "")), costs["rope"])
        lengths = [cable.length for cable in cables.values()]
        found[COST_METRIC] = (
            sum(costs.get(motor.name, costs["motor"]) for motor in motors)
            + len(discs) * costs["pulley"]
            + sum(lengths) * (per_metre + costs["conduit"])
            + len(lengths) * costs["fittings"]
        )
    return found


def read_costs(path: str | Path = EXAMPLE) -> dict[str, float]:
    """Return the cost of each part, in the currency of the table."""
    path = Path(path)
    sheet = read_sheet(path, "the costs")
    if sheet.names != ["part", "per", "cost"]:
        raise CableError(f"{path} must begin with the line part,per,cost.")
    found: dict[str, float] = {}
    for _, row in sheet.rows:
        if len(row) != 3:
            raise CableError(f"{path}: the line {','.join(row)!r} must have 3 cells.")
        part, per, amount = row
        if part not in _ALLOWED:
            raise CableError.unknown("part", part, _ALLOWED)
        if part in found:
            raise CableError(f"{path} gives the cost of {part!r} twice.")
        if per != _ALLOWED[part]:
            raise CableError(
                f"{path}: the cost of {part!r} must be per {_ALLOWED[part]}, not per "
                f"{per!r}."
            )
        try:
            cost = float(amount)
        except ValueError:
            cost = math.nan
        if not 0.0 <= cost < math.inf:
            raise CableError(
                f"{path}: the cost of {part!r} must be a number of at least 0, not "
                f"{amount!r}."
            )
        found[part] = cost
    if missing := [part for part in PARTS if part not in found]:
        raise CableError(f"{path} lacks the cost of {', '.join(missing)}.")
    return found
