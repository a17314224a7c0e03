"""The one table of cable parameters, and the cable it describes.

    >>> from cc_mujoco.transmission import Cable
    >>> cable = Cable.from_config({"conduit": "0.8:0.15 0.6:inf 0.6:0.4"})
    >>> round(cable.length, 3), round(cable.wrap, 3)
    (2.0, 6.833)

`PARAMETERS` is what MJCF configuration keys, the fields of `Cable` and the
parameters that a fit may vary have in common: name, unit, bounds, default, meaning.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import NamedTuple

from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Parameter:
    """One scalar parameter of a cable.

    The value must lie in [low, high], or in (low, high] where `low_open`.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    low_open: bool = False

    @property
    def allowed(self) -> str:
        """The allowed range as text, with its unit."""
        bracket = "(" if self.low_open else "["
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"a number in {bracket}{self.low:g}, {self.high:g}]{unit}"

    def admits(self, value: float) -> bool:
        """Whether `value` is finite and within bounds."""
        above = value > self.low if self.low_open else value >= self.low
        return above and value <= self.high


PARAMETERS = (
    Parameter(
        "axial_stiffness",
        "N",
        0.0,
        1e9,
        4000.0,
        "EA of the cable: tension per unit strain (thesis k_c, 2.8)",
        low_open=True,
    ),
    Parameter(
        "pretension", "N", 0.0, 1e6, 10.0, "uniform tension in the reference pose"
    ),
    Parameter(
        "friction", "1", 0.0, 5.0, 0.15, "kinetic Coulomb coefficient mu_d (2.6)"
    ),
    Parameter(
        "static_friction",
        "1",
        0.0,
        5.0,
        0.0,
        "break-away coefficient mu_s (2.7, 2.17); 0 is off, else at least `friction`",
    ),
    Parameter(
        "memory_length",
        "m",
        0.0,
        1.0,
        0.0,
        "slip over which break-away and Stribeck friction adapt; 0 is at once",
    ),
    Parameter(
        "viscous_friction",
        "N s/m^2",
        0.0,
        1e6,
        0.0,
        "drag per conduit length and slip speed; 0 is off",
    ),
    Parameter(
        "stribeck_friction",
        "1",
        0.0,
        5.0,
        0.0,
        "extra friction coefficient at vanishing slip speed; 0 is off",
    ),
    Parameter(
        "stribeck_speed",
        "m/s",
        0.0,
        10.0,
        0.01,
        "slip speed over which the Stribeck term decays",
        low_open=True,
    ),
    Parameter(
        "stribeck_exponent",
        "1",
        0.0,
        10.0,
        1.0,
        "exponent of that decay",
        low_open=True,
    ),
    Parameter(
        "load_independent_friction",
        "N/m",
        0.0,
        1e5,
        0.0,
        "drag per conduit length that needs no tension; 0 is off",
    ),
    Parameter(
        "seal_proximal",
        "N",
        0.0,
        1e5,
        0.0,
        "drag of the seal at the proximal end; needs no tension; 0 is off",
    ),
    Parameter(
        "seal_distal", "N", 0.0, 1e5, 0.0, "the same at the distal end of the conduit"
    ),
    Parameter(
        "friction_asymmetry",
        "1",
        -0.9,
        0.9,
        0.0,
        "a: friction times 1 + a for slip towards proximal, 1 - a towards distal",
    ),
    Parameter(
        "end_compliance",
        "m/N",
        0.0,
        1.0,
        0.0,
        "spring between the cable and its distal end; 0 is off",
    ),
    Parameter(
        "bristle_length",
        "m",
        0.0,
        1.0,
        0.0,
        "elastic displacement over which friction builds up (presliding); 0 is off",
    ),
    Parameter(
        "tension_exponent",
        "1",
        -1.0,
        1.0,
        0.0,
        "e: friction times (T / pretension)^e, T at least 1 % of the pretension",
    ),
    Parameter(
        "ageing_friction",
        "1",
        0.0,
        5.0,
        0.0,
        "beta: friction grows by beta ln(1 + t / ageing_time) with the age t of the "
        "contacts, which slip over `memory_length` renews; 0 is off",
    ),
    Parameter(
        "ageing_time", "s", 0.0, 1e6, 1.0, "time scale of that growth", low_open=True
    ),
    Parameter(
        "wrap_growth",
        "1/m",
        -1e3,
        1e3,
        0.0,
        "g: wrap angles times 1 + g u, u the distal displacement from the rest pose",
    ),
    Parameter(
        "wrap_reach",
        "1",
        0.0,
        1.0,
        1.0,
        "share of the conduit, from its distal end, in which they do",
        low_open=True,
    ),
    Parameter(
        "friction_drift",
        "1/s",
        -1e3,
        1e3,
        0.0,
        "d: friction times 1 + d t + h W, t the time since the start",
    ),
    Parameter(
        "friction_heating",
        "1/J",
        -1e3,
        1e3,
        0.0,
        "h: of the heat W that friction left in the conduit; 0 is off",
    ),
    Parameter(
        "cooling_time",
        "s",
        0.0,
        1e9,
        60.0,
        "time in which that heat falls to 1/e",
        low_open=True,
    ),
    Parameter(
        "stiffening",
        "1/N",
        0.0,
        1.0,
        0.0,
        "s: axial stiffness times 1 + s T, to 100-fold; 0 is off",
    ),
    Parameter(
        "creep",
        "1",
        0.0,
        1.0,
        0.0,
        "share of the pretension that the rest pose loses in the end, as the cable "
        "grows longer; 0 is off",
    ),
    Parameter(
        "creep_time", "s", 0.0, 1e9, 60.0, "time scale of that loss", low_open=True
    ),
    Parameter(
        "eccentricity",
        "m",
        0.0,
        0.1,
        0.0,
        "e: radius of the proximal pulley plus e cos(q - phase) at its angle q; "
        "0 is off",
    ),
    Parameter(
        "eccentricity_phase", "rad", -10.0, 10.0, 0.0, "angle of its largest radius"
    ),
    Parameter(
        "ovality",
        "m",
        0.0,
        0.1,
        0.0,
        "o: radius of the proximal pulley plus o cos(2 q - phase); 0 is off",
    ),
    Parameter(
        "ovality_phase", "rad", -10.0, 10.0, 0.0, "twice an angle of largest radius"
    ),
)
"""Scalar parameters; their order is that of the packed vector of the kernel."""
_DEFAULT = {parameter.name: parameter.default for parameter in PARAMETERS}

MAX_SEGMENTS = 1000
MAX_SECTIONS = 64
SEGMENTS_ALLOWED = f"a whole number in [1, {MAX_SEGMENTS}]"
CONDUIT_ALLOWED = (
    f"1 to {MAX_SECTIONS} sections `length:radius` in metres, both positive, "
    "radius `inf` where straight, e.g. `0.8:0.15 0.6:inf`"
)
BENDS = ("fixed", "route")
"""Where the bends of the conduit come from: its sections, or the route as it moves."""
BEND_ALLOWED = (
    "`fixed` (the sections of `conduit` bend it) or, with a `route` of one branch, "
    "`route` (that spatial tendon does, as it moves)"
)
KEYS = (*(p.name for p in PARAMETERS), "segments", "conduit", "route", "bend")
"""All configuration keys of a cable."""


class Section(NamedTuple):
    """Conduit of constant bend: length [m] and bend radius [m], inf where straight."""

    length: float
    radius: float


@dataclass(frozen=True)
class Cable:
    """One cable in its conduit, from the proximal (motor) to the distal (joint) end.

    Scalar fields are those of `PARAMETERS`, in SI units. `conduit` is the bend of the
    route as sections, `segments` the number N of friction elements along it, `route`
    the name of the MuJoCo spatial tendon that draws it (empty: none). With `bend`
    `"route"` the conduit bends in MuJoCo as that tendon does at the moment; its length
    stays that of the sections, which also bend it wherever there is no MuJoCo.

    Raises:
        CableError: a value is outside its range.
    """

    axial_stiffness: float = _DEFAULT["axial_stiffness"]
    pretension: float = _DEFAULT["pretension"]
    friction: float = _DEFAULT["friction"]
    static_friction: float = _DEFAULT["static_friction"]
    memory_length: float = _DEFAULT["memory_length"]
    viscous_friction: float = _DEFAULT["viscous_friction"]
    stribeck_friction: float = _DEFAULT["stribeck_friction"]
    stribeck_speed: float = _DEFAULT["stribeck_speed"]
    stribeck_exponent: float = _DEFAULT["stribeck_exponent"]
    load_independent_friction: float = _DEFAULT["load_independent_friction"]
    seal_proximal: float = _DEFAULT["seal_proximal"]
    seal_distal: float = _DEFAULT["seal_distal"]
    friction_asymmetry: float = _DEFAULT["friction_asymmetry"]
    end_compliance: float = _DEFAULT["end_compliance"]
    bristle_length: float = _DEFAULT["bristle_length"]
    tension_exponent: float = _DEFAULT["tension_exponent"]
    ageing_friction: float = _DEFAULT["ageing_friction"]
    ageing_time: float = _DEFAULT["ageing_time"]
    wrap_growth: float = _DEFAULT["wrap_growth"]
    wrap_reach: float = _DEFAULT["wrap_reach"]
    friction_drift: float = _DEFAULT["friction_drift"]
    friction_heating: float = _DEFAULT["friction_heating"]
    cooling_time: float = _DEFAULT["cooling_time"]
    stiffening: float = _DEFAULT["stiffening"]
    creep: float = _DEFAULT["creep"]
    creep_time: float = _DEFAULT["creep_time"]
    eccentricity: float = _DEFAULT["eccentricity"]
    eccentricity_phase: float = _DEFAULT["eccentricity_phase"]
    ovality: float = _DEFAULT["ovality"]
    ovality_phase: float = _DEFAULT["ovality_phase"]
    segments: int = 50
    conduit: tuple[Section, ...] = (Section(1.0, math.inf),)
    route: str = ""
    bend: str = BENDS[0]

    def __post_init__(self) -> None:
        for parameter in PARAMETERS:
            value = getattr(self, parameter.name)
            number = isinstance(value, Real) and not isinstance(value, bool)
            if not number or not parameter.admits(value):
                raise CableError(
                    f"cable parameter `{parameter.name}` is {value!r}; "
                    f"it must be {parameter.allowed}"
                )
            object.__setattr__(self, parameter.name, float(value))
        if 0.0 < self.static_friction < self.friction:
            raise CableError(
                f"cable parameter `static_friction` is {self.static_friction!r}; it "
                f"must be 0 (off) or at least `friction` = {self.friction!r}"
            )
        if self.tension_exponent != 0.0 and self.pretension == 0.0:
            raise CableError(
                f"cable parameter `tension_exponent` is {self.tension_exponent!r}; it "
                "must be 0 (off) where `pretension` is 0"
            )
        if (
            not isinstance(self.segments, int)
            or isinstance(self.segments, bool)
            or not 1 <= self.segments <= MAX_SEGMENTS
        ):
            raise CableError(
                f"cable parameter `segments` is {self.segments!r}; "
                f"it must be {SEGMENTS_ALLOWED}"
            )
        sections = tuple(Section(float(a), float(b)) for a, b in self.conduit)
        valid = all(0.0 < s.length < math.inf and s.radius > 0.0 for s in sections)
        if not valid or not 1 <= len(sections) <= MAX_SECTIONS:
            raise CableError(
                f"cable parameter `conduit` is {self.conduit!r}; "
                f"it must be {CONDUIT_ALLOWED}"
            )
        object.__setattr__(self, "conduit", sections)
        if self.bend not in BENDS:
            raise CableError(
                f"cable parameter `bend` is {self.bend!r}; it must be {BEND_ALLOWED}"
            )
        if self.bend == "route" and not self.route:
            raise CableError(
                "cable parameter `bend` is 'route' but `route` is empty; it must name "
                "the spatial tendon that the conduit follows"
            )

    @property
    def length(self) -> float:
        """Length of the conduit [m]."""
        return sum(section.length for section in self.conduit)

    @property
    def wrap(self) -> float:
        """Total wrap angle of the conduit [rad]."""
        return sum(section.length / section.radius for section in self.conduit)

    @classmethod
    def from_config(cls, config: Mapping[str, str], where: str = "cable") -> Cable:
        """Read a cable from configuration text, as it stands in an MJCF file.

        Args:
            config: key to text; missing keys take their default.
            where: what to name in an error, for instance the plugin instance.

        Raises:
            CableError: an unknown key, or a value that is not allowed.
        """
        for key in config:
            if key not in KEYS:
                near = difflib.get_close_matches(key, KEYS, n=1)
                hint = f"; did you mean `{near[0]}`?" if near else ""
                raise CableError(
                    f"{where}: unknown key `{key}`{hint} (keys: {', '.join(KEYS)})"
                )
        values: dict[str, object] = {}
        for parameter in PARAMETERS:
            if parameter.name in config:
                text = config[parameter.name]
                number = _number(text)
                if number is None or not parameter.admits(number):
                    raise CableError(
                        f"{where}: key `{parameter.name}` is {text!r}; "
                        f"it must be {parameter.allowed}"
                    )
                values[parameter.name] = number
        if "segments" in config:
            text = config["segments"]
            if not (text.isascii() and text.isdigit()):
                raise CableError(
                    f"{where}: key `segments` is {text!r}; it must be "
                    f"{SEGMENTS_ALLOWED}"
                )
            values["segments"] = int(text)
        if "conduit" in config:
            values["conduit"] = _sections(config["conduit"], where)
        values["route"] = config.get("route", "")
        values["bend"] = config.get("bend", BENDS[0])
        try:
            return cls(**values)  # type: ignore[arg-type]
        except CableError as error:
            raise CableError(f"{where}: {error}") from None

    def to_config(self) -> dict[str, str]:
        """Configuration text of every key; `from_config` gives the same cable back."""
        config = {p.name: repr(getattr(self, p.name)) for p in PARAMETERS}
        config["segments"] = str(self.segments)
        config["conduit"] = " ".join(f"{s.length!r}:{s.radius!r}" for s in self.conduit)
        if self.route:
            config["route"] = self.route
        if self.bend != BENDS[0]:
            config["bend"] = self.bend
        return config

    def replace(self, **changes: object) -> Cable:
        """A copy with some fields changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def _number(text: str) -> float | None:
    """A decimal number in full, or None; `inf` and underscores are no numbers here."""
    if "_" in text or not any(c.isdigit() for c in text):
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _sections(text: str, where: str) -> tuple[Section, ...]:
    sections = []
    for word in text.split():
        length, _, radius = word.partition(":")
        number = _number(length)
        bend = math.inf if radius == "inf" else _number(radius)
        if number is None or bend is None:
            raise CableError(
                f"{where}: key `conduit` is {text!r}; it must be {CONDUIT_ALLOWED}"
            )
        sections.append(Section(number, bend))
    if not sections:
        raise CableError(
            f"{where}: key `conduit` is {text!r}; it must be {CONDUIT_ALLOWED}"
        )
    return tuple(sections)
