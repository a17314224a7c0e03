"""Variables of a plant: one table of names, units, bounds and meanings.

Every parameter of a cable is a variable; those below are of the route, the pulleys, the
motor, the rope, the wearer and the sensors. `CABLE.NAME` is a variable of one cable
alone (`flexor.friction`), `AXIS.NAME` one of all cables of an axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from cc_mujoco.cable._cable import KEYS, MAX_SEGMENTS, PARAMETERS
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.device._materials import ENDS, MATERIALS
from cc_mujoco.device._motors import MOTORS
from cc_mujoco.errors import CableError
from cc_mujoco.human import Profile
from cc_mujoco.human import _body as bodies
from cc_mujoco.human._pace import MAX_SPEED, MEASURED_SPEED, MIN_SPEED
from cc_mujoco.human._profile import MAX_PEAK_TORQUE as PEAK

Value = float | int | str
"""Value of a variable: a number, or a text where the variable is one."""


OF_CABLES: dict[str, Parameter] = {
    variable.name: variable
    for variable in (
        *PARAMETERS,
        Parameter(
            "segments", meaning="friction elements along the cable", low=1,
            high=MAX_SEGMENTS, whole=True,
        ),
        *(
            Parameter(key, meaning=f"configuration key `{key}` as text", text=True)
            for key in KEYS
            if key not in {"segments", *(p.name for p in PARAMETERS)}
        ),
        Parameter(
            "break_away", "1", "static over kinetic friction, at least 1; 0 is off", 0,
            1e9,
        ),
        Parameter("loops", "1", "round loops that the whole conduit makes", 0, 100),
        Parameter("wrap", "rad", "bend of the whole conduit; lengths stay", 0, 600),
        Parameter(
            "bend_radius", "m", "radius of every bend; lengths stay", 0, 100, True,
        ),
        Parameter(
            "length", "m", "length of the conduit; bend angles stay", 0, 1000, True,
        ),
        Parameter(
            "diameter", "m", "of the cable; stiffness and strength go with its square",
            0, 0.1, True,
        ),
        Parameter("motor_radius", "m", "pulley radius at the motor", 0, 10, True),
        Parameter(
            "joint_radius", "m", "pulley radius or lever at the joint", 0, 10, True,
        ),
    )
}  # fmt: skip
"""Variables that belong to a cable, so that two cables may differ in them."""

VARIABLES: dict[str, Parameter] = OF_CABLES | {
    variable.name: variable
    for variable in (
        Parameter("strength", "N", "breaking load of the cable", 0, 1e9, True),
        Parameter(
            "material", "1", "rope and conduit, of `MATERIALS`: friction, and "
            "with the diameter stiffness and strength", text=True,
            choices=tuple(MATERIALS),
        ),
        Parameter(
            "material_friction", "1",
            "where in its range the friction of `material` is, typical by default",
            text=True, choices=ENDS,
        ),
        Parameter(
            "rope_density", "kg/m^3", "of the rope, with its voids", 0, 1e5, True,
        ),
        Parameter(
            "conduit_linear_mass", "kg/m", "of a metre of conduit; by default a "
            "steel coil that goes with the diameter", 0, 1e3,
        ),
        Parameter("motor_torque", "N m", "largest torque of the motor", 0, 1e6, True),
        Parameter(
            "rotor_inertia", "kg m^2",
            "of the rotor as the pulley feels it, without the pulley", 0, 1e3,
        ),
        Parameter(
            "motor", "1", "a data sheet of `MOTORS`: inertia and mass of the "
            "motor, its winding, what it can give for ever", text=True,
            choices=tuple(MOTORS),
        ),
        Parameter(
            "gearing", "1", "turns of the rotor per turn of the motor's pulley; "
            "the gear weighs nothing and loses nothing", 0, 1e4, True,
        ),
        Parameter(
            "winding_resistance", "ohm", "of the motor, between its terminals", 0, 1e6,
            True,
        ),
        Parameter(
            "torque_constant", "N m/A", "of the motor, before its gear", 0, 1e3, True,
        ),
        Parameter(
            "continuous_torque", "N m",
            "that the motor can give for ever, before its gear", 0, 1e6, True,
        ),
        Parameter("motor_mass", "kg", "of the motor", 0, 1e4),
        Parameter(
            "motor_damping", "N m s/rad", "viscous friction of the motor", 0, 1e3,
        ),
        Parameter(
            "motor_friction", "N m", "dry friction of the motor at its pulley", 0, 1e3,
        ),
        Parameter(
            "motor_lag", "s", "time constant of the motor's torque behind its command",
            0, 1,
        ),
        Parameter(
            "cuff_stiffness", "N m/rad",
            "of the cuff between the device and the limb, `[axis.cuff]`", 0, 1e9, True,
        ),
        Parameter(
            "cuff_damping", "N m s/rad", "of the cuff between device and limb", 0, 1e6,
        ),
        Parameter(
            "gait_speed", "m/s", "of walking: stride time, stance, motion of the "
            "leg and size of the help go with it as in Bovi et al., Gait & "
            f"Posture 33, 2011; that of the measured walk, {MEASURED_SPEED:g}, by "
            "default", MIN_SPEED, MAX_SPEED,
        ),
        Parameter(
            "body_mass", "kg", "of the wearer of a leg: its segments go with it "
            "as in Winter, Biomechanics and Motor Control of Human Movement, "
            "Table 4.1, moments and size of the help as in Hof, Gait & Posture 4, "
            f"1996; {bodies.WEARER_MASS:g} by default", bodies.MIN_MASS,
            bodies.MAX_MASS,
        ),
        Parameter(
            "leg_length", "m", "of the wearer, from hip to sole: lengths and "
            "inertia of the leg, stride time, moments and size of the help go "
            "with it as in Hof, Gait & Posture 4, 1996, and speed, unless "
            f"`gait_speed` says it; {bodies.WEARER_LEG_LENGTH:g} by default",
            bodies.MIN_LEG_LENGTH, bodies.MAX_LEG_LENGTH,
        ),
        Parameter(
            "onset", "% of the stride", "where the help of the ankle begins; with "
            "`peak_time`, `peak_torque` and `fall` as in Zhang et al., Science "
            "356, 2017, in place of the shape of `assist`; "
            f"{Profile.onset:g} by default", 0, 100,
        ),
        Parameter(
            "peak_time", "% of the stride",
            f"where the help of the ankle is largest, {Profile.peak_time:g} by default",
            0, 100, True,
        ),
        Parameter(
            "peak_torque", "N m",
            f"largest help of the ankle, {Profile.peak_torque:g} by default", 0, PEAK,
        ),
        Parameter(
            "fall", "% of the stride", "time from the peak of the help of the "
            f"ankle to its end; {Profile.fall:g} by default, less where the "
            "foot leaves the ground before", 0, 100, True,
        ),
    )
}  # fmt: skip
"""Every variable of a design by name."""

WEARER = Parameter(
    "wearer", "1", "stiffness and damping of the wearer, times those of the scene; a "
    "joint that is held stays held", 1e-3, 1e3,
)  # fmt: skip
"""Variable that cases and episodes may have beside those of designs."""

DELAY = Parameter(
    "delay", "samples", "by which measurements are late", 0, 1000, whole=True
)
NOISE = Parameter("noise", "1", "of the sensors, times that of the device", 0, 1e3)

IN_EPISODES: dict[str, Parameter] = {
    variable.name: variable for variable in (WEARER, DELAY, NOISE, *PARAMETERS)
} | {name: OF_CABLES[name] for name in ("break_away", "wrap")}
"""Variables that may change from episode to episode of one compiled model."""

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


OF_AXES = (
    "motor_torque", "rotor_inertia", "motor", "gearing", "winding_resistance",
    "torque_constant", "continuous_torque", "motor_mass", "motor_damping",
    "motor_friction", "motor_lag", "cuff_stiffness", "cuff_damping",
)  # fmt: skip
"""Variables that belong to an axis, so that two motors may differ in them."""


def split(name: str) -> tuple[str | None, str]:
    """Return the owner and the variable that a name stands for; None is any owner."""
    cable, dot, own = name.rpartition(".")
    return (cable if dot else None), own


def describe(name: str) -> Parameter:
    """Return the variable of a name that was found before, for its unit and meaning."""
    return VALUES[split(name)[1]]


def find(
    name: str,
    cables: Iterable[str],
    axes: Mapping[str, Sequence[str]] = MappingProxyType({}),
    among: Mapping[str, Parameter] = VARIABLES,
    kind: str = "variable",
) -> Parameter:
    """Look a variable up by `NAME`, `CABLE.NAME` or `AXIS.NAME`.

    `AXIS.NAME` means all cables of the axis for a variable of cables. `axes` have the
    names of their cables; `kind` is what an error calls a variable.
    """
    owner, own = split(name)
    if own not in among:
        raise CableError.unknown(kind, name, among)
    if owner is None:
        return among[own]
    if own in OF_AXES:
        if owner not in set(axes):
            raise CableError.unknown("axis", owner, axes)
        return among[own]
    if owner not in {*cables, *axes}:
        raise CableError.unknown("cable or axis", owner, (*cables, *axes))
    if own not in OF_CABLES:
        raise CableError(
            f"variable {own!r} belongs to no cable; write {own!r}, not {name!r}."
        )
    return among[own]


def read_values(
    values: Mapping[str, object],
    cables: Iterable[str],
    axes: Mapping[str, Sequence[str]],
) -> dict[str, Value]:
    """Return values with names and bounds checked, in the order given."""
    cables = tuple(cables)
    read = {
        name: find(name, cables, axes, VALUES).read(value, f"variable {name!r}")
        for name, value in values.items()
    }
    owners = [[cable, *owner_axes(cable, axes)] for cable in cables]
    for own in [*owners, *([axis] for axis in axes)]:
        for group in CONFLICTS:
            clash = [
                n
                for n in group
                if n in read or any(f"{owner}.{n}" in read for owner in own)
            ]
            if len(clash) > 1:
                raise CableError(
                    f"variables {clash[0]!r} and {clash[1]!r} set the same thing; "
                    "vary one of them."
                )
    return read


def owner_axes(cable: str, axes: Mapping[str, Sequence[str]]) -> list[str]:
    return [axis for axis, names in axes.items() if cable in names]


def of_owner(values: Mapping[str, Value], *owners: str) -> dict[str, Value]:
    """Return the values for a cable or an axis; those that name it take precedence."""
    own = {name: value for name, value in values.items() if "." not in name}
    for owner in owners:
        start = f"{owner}."
        named = {name: v for name, v in values.items() if name.startswith(start)}
        own |= {name.removeprefix(start): value for name, value in named.items()}
    return own
