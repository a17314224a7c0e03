"""Variables of a designer: one table of names, units, bounds and meanings.

Every parameter of a cable is a variable; those below are of the route, the pulleys, the
motor and the rope. `CABLE.NAME` is a variable of one cable alone (`flexor.friction`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import Profile
from cc_mujoco.human.body import HEAVIEST, LEG, LIGHTEST, LONGEST, MASS, SHORTEST
from cc_mujoco.human.pace import FASTEST, MEASURED, SLOWEST
from cc_mujoco.human.profile import MOST as PEAK
from cc_mujoco.transmission.parameters import KEYS, MAX_SEGMENTS, PARAMETERS
from cc_mujoco.whatif.materials import ENDS, MATERIALS
from cc_mujoco.whatif.motors import MOTORS

Value = float | int | str
"""Value of a variable: a number, or a text where the variable is one."""


@dataclass(frozen=True)
class Variable:
    """One thing that a design sets; numbers lie in (low, high], or [low, high]."""

    name: str
    unit: str
    meaning: str
    low: float = 0.0
    high: float = math.inf
    low_open: bool = True
    whole: bool = False
    text: bool = False
    cable: bool = True
    """True if it belongs to a cable, so that two cables may differ in it."""
    choices: tuple[str, ...] = ()
    """Allowed texts; empty where it may be anything."""

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        if self.text:
            return "a text"
        kind = "a whole number" if self.whole else "a number"
        end = ")" if self.high == math.inf else "]"
        bracket = "(" if self.low_open else "["
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{kind} in {bracket}{self.low:g}, {self.high:g}{end}{unit}"

    def read(self, value: object) -> Value:
        """A value as text, number or NumPy scalar, checked.

        Raises:
            CableError: it is outside the bounds or of the wrong kind.
        """
        if self.choices:
            look_up(self.name, str(value), dict.fromkeys(self.choices))
        if self.text:
            return str(value)
        try:
            number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            number = math.nan
        above = number > self.low if self.low_open else number >= self.low
        fits = above and number <= self.high and math.isfinite(number)
        if not fits or (self.whole and number != round(number)):
            raise CableError(
                f"variable {self.name!r} cannot be {value!r}; "
                f"it must be {self.allowed}."
            )
        return round(number) if self.whole else number


def _of_cables() -> Iterable[Variable]:
    for p in PARAMETERS:
        low_open = p.low_open
        yield Variable(p.name, p.unit, p.meaning, p.low, p.high, low_open)
    whole = "friction elements along the cable"
    yield Variable("segments", "1", whole, 1, MAX_SEGMENTS, False, whole=True)
    known = {p.name for p in PARAMETERS} | {"segments"}
    for key in KEYS:
        if key not in known:
            yield Variable(key, "1", f"configuration key `{key}` as text", text=True)


VARIABLES: dict[str, Variable] = {
    variable.name: variable
    for variable in (
        *_of_cables(),
        Variable("loops", "1", "round loops that the whole conduit makes", 0, 100),
        Variable("wrap", "rad", "bend of the whole conduit; lengths stay", 0, 600),
        Variable("bend_radius", "m", "radius of every bend; lengths stay", 0, 100),
        Variable("length", "m", "length of the conduit; bend angles stay", 0, 1000),
        Variable("diameter", "m", "of the cable; stiffness and strength go with its "
                 "square", 0, 0.1),
        Variable("motor_radius", "m", "pulley radius at the motor", 0, 10),
        Variable("joint_radius", "m", "pulley radius or lever at the joint", 0, 10),
        Variable("strength", "N", "breaking load of the cable", 0, 1e9, cable=False),
        Variable("material", "1", "rope and conduit, of `MATERIALS`: friction, and "
                 "with the diameter stiffness and strength", text=True, cable=False,
                 choices=tuple(MATERIALS)),
        Variable("material_friction", "1", "where in its range the friction of "
                 "`material` is, typical by default", text=True, cable=False,
                 choices=ENDS),
        Variable("rope_density", "kg/m^3", "of the rope, with its voids", 0, 1e5,
                 cable=False),
        Variable("conduit_linear_mass", "kg/m", "of a metre of conduit; by default a "
                 "steel coil that goes with the diameter", 0, 1e3, False, cable=False),
        Variable("motor_torque", "Nm", "largest torque of the motor", 0, 1e6,
                 cable=False),
        Variable("rotor_inertia", "kg m^2", "of the rotor as the pulley feels it, "
                 "without the pulley", 0, 1e3, False, cable=False),
        Variable("motor", "1", "a data sheet of `MOTORS`: inertia and mass of the "
                 "motor, its winding, what it can give for ever", text=True,
                 cable=False, choices=tuple(MOTORS)),
        Variable("gearing", "1", "turns of the rotor per turn of the motor's pulley; "
                 "the gear weighs nothing and loses nothing", 0, 1e4, cable=False),
        Variable("winding_resistance", "ohm", "of the motor, between its terminals",
                 0, 1e6, cable=False),
        Variable("torque_constant", "Nm/A", "of the motor, before its gear", 0, 1e3,
                 cable=False),
        Variable("continuous_torque", "Nm", "that the motor can give for ever, before "
                 "its gear", 0, 1e6, cable=False),
        Variable("motor_mass", "kg", "of the motor", 0, 1e4, False, cable=False),
        Variable("motor_damping", "Nm s/rad", "viscous friction of the motor", 0, 1e3,
                 False, cable=False),
        Variable("gait_speed", "m/s", "of walking: stride time, stance, motion of the "
                 "leg and size of the help go with it as in Bovi et al., Gait & "
                 f"Posture 33, 2011; that of the measured walk, {MEASURED:g}, by "
                 "default",
                 SLOWEST, FASTEST, False, cable=False),
        Variable("body_mass", "kg", "of the wearer of a leg: its segments go with it "
                 "as in Winter, Biomechanics and Motor Control of Human Movement, "
                 "Table 4.1, moments and size of the help as in Hof, Gait & Posture 4, "
                 f"1996; {MASS:g} by default",
                 LIGHTEST, HEAVIEST, False, cable=False),
        Variable("leg_length", "m", "of the wearer, from hip to sole: lengths and "
                 "inertia of the leg, stride time, moments and size of the help go "
                 "with it as in Hof, Gait & Posture 4, 1996, and speed, unless "
                 f"`gait_speed` says it; {LEG:g} by default",
                 SHORTEST, LONGEST, False, cable=False),
        Variable("onset", "% of the stride", "where the help of the ankle begins; with "
                 "`peak_time`, `peak_torque` and `fall` as in Zhang et al., Science "
                 "356, 2017, in place of the shape of `assist`; "
                 f"{Profile.onset:g} by default", 0, 100, False, cable=False),
        Variable("peak_time", "% of the stride", "where the help of the ankle is "
                 f"largest, {Profile.peak_time:g} by default", 0, 100, cable=False),
        Variable("peak_torque", "Nm", "largest help of the ankle, "
                 f"{Profile.peak_torque:g} by default", 0, PEAK, False, cable=False),
        Variable("fall", "% of the stride", "time from the peak of the help of the "
                 f"ankle to its end; {Profile.fall:g} by default, less where the "
                 "foot leaves the ground before", 0, 100,
                 cable=False),
    )
}  # fmt: skip
"""Every variable by name."""

SETS: dict[str, tuple[str, ...]] = {
    "material": ("friction", "axial_stiffness", "strength", "rope_density"),
    "motor": (
        "rotor_inertia",
        "winding_resistance",
        "torque_constant",
        "continuous_torque",
        "motor_mass",
    ),
}
"""Parameters that a variable sets when it names a row of a table."""

_BENDS = ("conduit", "loops", "wrap", "bend_radius")
CONFLICTS: tuple[tuple[str, ...], ...] = (
    _BENDS,
    ("conduit", "length"),
    ("diameter", "axial_stiffness"),
    ("diameter", "strength"),
    *((name, one) for name, them in SETS.items() for one in them),
)
"""Variables of which a design may set only one, because they set the same thing."""


def find(name: str, cables: Iterable[str]) -> Variable:
    """Look a variable up, with or without the name of a cable before it.

    Args:
        name: `NAME` or `CABLE.NAME`.
        cables: the cables of the scene.

    Raises:
        CableError: there is no such variable or cable.
    """
    cable, dot, own = name.rpartition(".")
    if own not in VARIABLES:
        raise CableError.unknown("variable", name, VARIABLES)
    variable = VARIABLES[own]
    if dot and cable not in set(cables):
        raise CableError.unknown("cable", cable, cables)
    if dot and not variable.cable:
        raise CableError(
            f"variable {own!r} belongs to no cable; write {own!r}, not {name!r}."
        )
    return variable


def read_design(
    design: Mapping[str, object], cables: Iterable[str]
) -> dict[str, Value]:
    """A design with its names and values checked, in the order given.

    Raises:
        CableError: an unknown name, a value out of bounds, or two names for one thing.
    """
    cables = tuple(cables)
    read = {name: find(name, cables).read(value) for name, value in design.items()}
    for cable in cables:
        for group in CONFLICTS:
            clash = [n for n in group if n in read or f"{cable}.{n}" in read]
            if len(clash) > 1:
                raise CableError(
                    f"variables {clash[0]!r} and {clash[1]!r} set the same thing; "
                    "vary one of them."
                )
    return read
