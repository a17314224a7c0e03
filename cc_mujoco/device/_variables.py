"""Variables of a plant: one table of names, units, bounds and meanings.

Every parameter of a cable is a variable. `variables.csv` adds those of the route, the
pulleys, the motor, the rope, the wearer and the sensors. `CABLE.NAME` is a variable of
one cable alone (`flexor.friction`), `AXIS.NAME` one of all cables of an axis.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from cc_mujoco.cable._cable import KEYS, PARAMETERS
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.device._materials import ENDS, MATERIALS
from cc_mujoco.device._motors import MOTORS
from cc_mujoco.errors import CableError

Value = float | int | str
"""Value of a variable: a number, or a text where the variable is one."""


def _read_variables() -> tuple[dict[str, dict[str, Parameter]], set[str]]:
    """Read `variables.csv`: parameters by owner (such as cable or axis) and name.

    The set has the names of those that designs on one compiled model may differ in.
    """
    choices = {"material": MATERIALS, "material_friction": ENDS, "motor": MOTORS}
    found: dict[str, dict[str, Parameter]] = {}
    shared = set()
    with Path(__file__).with_name("variables.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            name, values = row["name"], row["values"]
            if row["model"] == "shared":
                shared.add(name)
            found.setdefault(row["of"], {})[name] = Parameter(
                name,
                row["unit"],
                row["meaning"],
                float(row["low"] or "-inf"),
                float(row["high"] or "inf"),
                low_open=values == "above low",
                whole=values == "whole",
                text=values == "texts",
                choices=tuple(choices.get(name, ())),
            )
    return found, shared


_OF, _SHARED = _read_variables()
"""Variables besides the parameters of a cable, by owner (such as axis)."""

_PARAMETERS = {parameter.name: parameter for parameter in PARAMETERS}

OF_CABLES: dict[str, Parameter] = {
    key: Parameter(key, meaning=f"configuration key `{key}` as text", text=True)
    for key in KEYS
} | (_PARAMETERS | _OF["cable"])
"""Variables that belong to a cable, so that two cables may differ in them."""

VARIABLES: dict[str, Parameter] = OF_CABLES | _OF["design"] | _OF["axis"] | _OF["walk"]
"""Every variable of a design by name."""

IN_EPISODES: dict[str, Parameter] = _OF["episode"] | _PARAMETERS
IN_EPISODES |= {name: OF_CABLES[name] for name in ("break_away", "wrap")}
"""Variables that may change from episode to episode of one compiled model."""

WRITTEN = frozenset({*_PARAMETERS, *_SHARED})
"""Variables that change nothing of a compiled model but numbers of its cables."""

VALUES: dict[str, Parameter] = VARIABLES | IN_EPISODES
"""Every variable of a plant by name."""

SETS: dict[str, tuple[str, ...]] = {
    "material": ("friction", "axial_stiffness", "strength", "rope_density"),
    "motor": (
        "rotor_inertia", "winding_resistance", "torque_constant", "continuous_torque",
        "motor_mass",
    ),
}  # fmt: skip
"""Parameters that a variable sets when it names a row of a table."""

CONFLICTS: tuple[tuple[str, ...], ...] = (
    ("conduit", "loops", "wrap", "bend_radius"),
    ("conduit", "length"),
    ("diameter", "axial_stiffness"),
    ("diameter", "strength"),
    ("break_away", "static_friction"),
    *((name, one) for name, them in SETS.items() for one in them),
)
"""Variables of which a design may set only one, because they set the same thing."""


def split(name: str) -> tuple[str | None, str]:
    """Return owner and variable of `OWNER.NAME`; the owner of `NAME` is None."""
    cable, dot, own = name.rpartition(".")
    return (cable if dot else None), own


def describe(name: str) -> Parameter:
    """Return the parameter (unit, bounds, meaning) of a variable known to exist."""
    return VALUES[split(name)[1]]


def find(
    name: str,
    cables: Iterable[str],
    axes: Mapping[str, Sequence[str]] = MappingProxyType({}),
    among: Mapping[str, Parameter] = VARIABLES,
    kind: str = "variable",
) -> Parameter:
    """Return the parameter of a variable `NAME`, `CABLE.NAME` or `AXIS.NAME`.

    `AXIS.NAME` means all cables of the axis if the variable is one of cables. `axes`
    has the cables of each axis, `among` the known variables; errors call one a `kind`.
    """
    owner, own = split(name)
    if own in ("safe_torque", "safe_speed", "safe_power"):
        raise CableError(
            f"{name!r} is no {kind} but a key of [axis] in the description of the "
            "device; write it there."
        )
    if own not in among:
        error = CableError.unknown(kind, name, among)
        raise CableError(f"{error} `cc-mujoco list variables` shows all.")
    if owner is None:
        return among[own]
    of_axis = own in _OF["axis"]  # two motors may differ in it
    owners = (*axes,) if of_axis else (*cables, *axes)
    if of_axis and owner in cables and owner not in axes:
        raise CableError(
            f"unknown axis {owner!r}: it is a cable, and {kind} {own!r} is of an axis; "
            f"write {' or '.join(f'{axis}.{own}' for axis in axes)}."
        )
    if owner not in owners:
        raise CableError.unknown("axis" if of_axis else "cable or axis", owner, owners)
    if not of_axis and own not in OF_CABLES:
        raise CableError(
            f"variable {own!r} belongs to no cable; write {own!r}, not {name!r}."
        )
    return among[own]


def read_values(
    values: Mapping[str, object],
    cables: Iterable[str],
    axes: Mapping[str, Sequence[str]],
) -> dict[str, Value]:
    """Return the values, checked against the names and bounds of `VALUES`, in order."""
    cables = tuple(cables)
    read = {
        name: find(name, cables, axes, VALUES).read(value, f"variable {name!r}")
        for name, value in values.items()
    }
    owners = [[cable, *owner_axes(cable, axes)] for cable in cables]
    for own in [*owners, *([axis] for axis in axes)]:
        together = of_owner(read, *own)
        for group in CONFLICTS:
            clash = [name for name in group if name in together]
            if len(clash) > 1:
                raise CableError(
                    f"variables {clash[0]!r} and {clash[1]!r} set the same thing; "
                    "vary one of them."
                )
    return read


def owner_axes(cable: str, axes: Mapping[str, Sequence[str]]) -> list[str]:
    return [axis for axis, names in axes.items() if cable in names]


def of_owner(values: Mapping[str, Value], *owners: str) -> dict[str, Value]:
    """Return values of cables or axes; names with an owner take precedence."""
    own = {name: value for name, value in values.items() if "." not in name}
    if len(own) == len(values):
        return own
    for owner in owners:
        start = f"{owner}."
        named = {name: v for name, v in values.items() if name.startswith(start)}
        own |= {name.removeprefix(start): value for name, value in named.items()}
    return own
