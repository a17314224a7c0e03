"""The cable: every parameter is one of its fields, described in `parameters.csv`.

    >>> from cc_mujoco.cable import Cable
    >>> cable = Cable.from_config({"conduit": "0.8:0.15 0.6:inf 0.6:0.4"})
    >>> round(cable.length, 3), round(cable.wrap, 3)
    (2.0, 6.833)

A row of the table states unit, bounds, default, meaning and, where the parameter
switches one on, the law. MJCF keys, the packed vector of the kernel and the parameters
that a fit may vary follow the fields as `PARAMETERS`.
"""

import csv
import dataclasses
import difflib
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cc_mujoco.cable._parameter import Parameter, Term, parameters_of
from cc_mujoco.errors import CableError

MAX_SEGMENTS, MAX_SECTIONS = 1000, 64
MAX_LENGTH, MAX_WRAP = 50.0, 100.0
"""Largest length [m] and wrap angle [rad] of a section; lengths in millimetres and
bends of more than sixteen turns are mistakes."""
BENDS = ("fixed", "route")
"""Values of `bend`: the conduit bends as in its sections, or as the tendon `route`."""
PATHS = ("guided", "open", "mixed")
"""Values of `path`: guided by a conduit, by sites and geoms of a tendon, or by both."""
ROLLER = "roller"
"""Radius that stands for a guide that turns with the cable, without friction."""
OF_A_CONDUIT = (
    "seal_proximal", "seal_distal", "clamp_creep_proximal", "clamp_creep_distal",
    "clearance",
)  # fmt: skip
"""Parameters of the conduit alone, which must be 0 (off) where `path` is `"open"`."""
NEEDED = {
    "tension_exponent": "pretension",
    "end_hardening": "end_compliance", "end_loss": "end_compliance",
    "proximal_hardening": "proximal_compliance",
    "proximal_loss": "proximal_compliance",
}  # fmt: skip
"""Parameters that must be 0 (off) if the parameter that they map to is 0."""
SCALES = {
    "stribeck_speed": "stribeck_friction", "stribeck_exponent": "stribeck_friction",
    "stribeck_tail": "stribeck_friction", "ageing_time": "ageing_friction",
    "wrap_reach": "wrap_growth", "cooling_time": "friction_heating",
    "bedding_tension": "bedding_strain", "seating_tension": "clearance",
    "relaxation_time": "stress_relaxation", "grease_exponent": "grease_drag",
    "eccentricity_phase": "eccentricity", "ovality_phase": "ovality",
}  # fmt: skip
"""Parameters that have no effect if the parameter that they map to is 0."""
OFF_WITHOUT = "0 (off) where `{}` is 0"
SPRINGS = {NEEDED[key]: key for key in ("end_hardening", "proximal_hardening")}
"""Parameters that MJCF may give as a curve, which gives the other parameter, too."""
ENDS = ("auto", "explicit")
"""Values of `ends`: implicit in MuJoCo if its step is long for them, or never."""
ALLOWED = {
    "segments": f"a whole number in [1, {MAX_SEGMENTS}]",
    "conduit": (
        f"1 to {MAX_SECTIONS} sections `length:radius` in metres, both positive, no "
        f"length above {MAX_LENGTH:g} and no bend above {MAX_WRAP:g} rad, radius `inf` "
        "where straight, e.g. `0.8:0.15 0.6:inf`; `:a:b` behind one are factors on "
        "`clearance` and `seating_tension`, within their ranges"
    ),
    "bend": (
        "`fixed` (the sections of `conduit` bend it) or, with a `route` of one branch, "
        "`route` (that spatial tendon does, as it moves)"
    ),
    "path": (
        "`guided` (a conduit leads the cable from end to end) or, with a `route` of "
        "one branch, `open` (only the sites and geoms of that spatial tendon do) or "
        "`mixed` (a conduit as far as the site `mouth` of the route, then the tendon)"
    ),
    "mouth": (
        "with `path` = `mixed`, and only then, the name of a site of the route between "
        "its first and its last one"
    ),
    "ends": (
        "`auto` (the ends are implicit where the time step of the model is long for "
        "them) or `explicit` (they never are)"
    ),
    "guides": (
        "with `path` = `open` or `mixed`, and only then, words `site:radius` "
        f"(positive, in metres, at most {MAX_LENGTH:g}) or, also of geoms, "
        "`name:roller` (no friction), each the name without blanks of a site or geom "
        "of the route behind `mouth` and between its ends, e.g. "
        "`palm:0.01 tip:roller`"
    ),
}
"""Allowed values of all keys but the scalar parameters, as text for errors."""


def _read_parameters() -> dict[str, Parameter]:
    """Read `parameters.csv`: the scalar parameters of a cable and their laws."""
    found = {}
    with Path(__file__).with_name("parameters.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            low, high = row["range"][1:-1].split(", ")
            acts_on: Any = row["acts on"]
            causes: Any = tuple(row["depends on"].split())
            law = row["law"], row["source"], acts_on, causes, row["constant without"]
            found[row["key"]] = Parameter(
                row["key"], row["unit"], row["meaning"], float(low), float(high),
                row["range"][0] == "(", float(row["default"]), source=row["source"],
                term=Term(*law) if row["law"] else None,
            )  # fmt: skip
    return found


_READ = _read_parameters()
ALLOWED |= {
    key: f"{_READ[key].allowed}, or, without `{other}`, a loading curve: 4 to "
    f"{MAX_SECTIONS} words `extension:force` (m, N) that rise, no force below 0, whose "
    "fit is in the ranges of both"
    for key, other in SPRINGS.items()
}


def _field(name: str) -> float:
    """Return a field that has the default and the descriptor of a parameter."""
    metadata = {"parameter": _READ[name]}
    return dataclasses.field(default=_READ[name].default, metadata=metadata)


class Section(NamedTuple):
    """Part of a conduit of constant curvature: length and bend radius (or inf) [m].

    `clearance` and `seating` are factors on the cable's `clearance` and
    `seating_tension`.
    """

    length: float
    radius: float = math.nan  # refused by `Cable`, in a sentence
    clearance: float = 1.0
    seating: float = 1.0


class Guide(NamedTuple):
    """Guide of an open cable: name of a site or geom, its radius [m] or `ROLLER`."""

    name: str
    radius: float | str


@dataclass(frozen=True)
class Cable:
    """One cable in its conduit, from the proximal (motor) to the distal (joint) end.

    Scalar fields are in SI units; `PARAMETERS` describes them. `conduit` is the route
    as sections of constant bend, `segments` the number N of friction elements along it,
    `route` the name of the MuJoCo spatial tendon that draws it (empty: none). With
    `bend` `"route"` the conduit bends in MuJoCo as that tendon does at the moment; its
    length stays that of the sections, whose bends hold wherever there is no MuJoCo.

    `path` defines what guides the cable in MuJoCo, see `PATHS`, and `mouth` the site of
    its route at which the conduit of a `"mixed"` one ends. `guides` names sites of an
    open path that are guides of a given radius, with drag per length of their arc, and
    sites and geoms that are rollers without friction. Outside MuJoCo an `"open"` path
    is replaced by a conduit of `conduit`'s sections, and a `"mixed"` path by that
    conduit up to the mouth.

    Raises:
        CableError: a value is outside its range.
    """

    axial_stiffness: float = _field("axial_stiffness")
    pretension: float = _field("pretension")
    friction: float = _field("friction")
    static_friction: float = _field("static_friction")
    critical_slip_distance: float = _field("critical_slip_distance")
    viscous_friction: float = _field("viscous_friction")
    stribeck_friction: float = _field("stribeck_friction")
    stribeck_speed: float = _field("stribeck_speed")
    stribeck_exponent: float = _field("stribeck_exponent")
    stribeck_tail: float = _field("stribeck_tail")
    load_independent_friction: float = _field("load_independent_friction")
    seal_proximal: float = _field("seal_proximal")
    seal_distal: float = _field("seal_distal")
    friction_asymmetry: float = _field("friction_asymmetry")
    end_compliance: float = _field("end_compliance")
    proximal_compliance: float = _field("proximal_compliance")
    end_hardening: float = _field("end_hardening")
    end_loss: float = _field("end_loss")
    proximal_hardening: float = _field("proximal_hardening")
    proximal_loss: float = _field("proximal_loss")
    bristle_length: float = _field("bristle_length")
    tension_exponent: float = _field("tension_exponent")
    ageing_friction: float = _field("ageing_friction")
    ageing_time: float = _field("ageing_time")
    wrap_growth: float = _field("wrap_growth")
    wrap_reach: float = _field("wrap_reach")
    friction_drift: float = _field("friction_drift")
    friction_heating: float = _field("friction_heating")
    cooling_time: float = _field("cooling_time")
    bedding_strain: float = _field("bedding_strain")
    bedding_tension: float = _field("bedding_tension")
    clearance: float = _field("clearance")
    seating_tension: float = _field("seating_tension")
    stress_relaxation: float = _field("stress_relaxation")
    relaxation_time: float = _field("relaxation_time")
    clamp_creep_proximal: float = _field("clamp_creep_proximal")
    clamp_creep_distal: float = _field("clamp_creep_distal")
    clamp_force: float = _field("clamp_force")
    eccentricity: float = _field("eccentricity")
    eccentricity_phase: float = _field("eccentricity_phase")
    ovality: float = _field("ovality")
    ovality_phase: float = _field("ovality_phase")
    grease_drag: float = _field("grease_drag")
    grease_exponent: float = _field("grease_exponent")
    segments: int = 50
    conduit: tuple[Section, ...] = (Section(1.0, math.inf),)
    route: str = ""
    bend: str = BENDS[0]
    path: str = PATHS[0]
    mouth: str = ""
    ends: str = ENDS[0]
    guides: tuple[Guide, ...] = ()

    def __post_init__(self) -> None:
        own = vars(self)
        for p, name, low, high in _RANGES:
            value = own[name]
            if type(value) is float and low <= value <= high:
                continue  # most are, and cables are made by the thousand
            if not p.admits(value):
                raise self._refusal(name, p.allowed)
            own[name] = float(value)
        if 0.0 < self.static_friction < self.friction:
            allowed = f"0 (off) or at least `friction` = {self.friction!r}"
            raise self._refusal("static_friction", allowed)
        for name, needed in NEEDED.items():
            if own[name] != 0.0 and own[needed] == 0.0:
                raise self._refusal(name, OFF_WITHOUT.format(needed))
        if (
            not isinstance(self.segments, int)
            or isinstance(self.segments, bool)
            or not 1 <= self.segments <= MAX_SEGMENTS
        ):
            raise self._refusal("segments")
        try:
            sections = tuple(Section(*map(float, each)) for each in self.conduit)
            if any(math.isnan(section.radius) for section in sections):
                raise ValueError
        except (TypeError, ValueError):
            allowed = (
                "sections, each a length and a radius in metres, and perhaps factors "
                "on `clearance` and `seating_tension`; text as in MJCF is for "
                "Cable.from_config"
            )
            raise self._refusal("conduit", allowed) from None
        play, seats = _READ["clearance"].high, _READ["seating_tension"].high
        valid = all(
            0.0 < s.length <= MAX_LENGTH
            and s.length <= MAX_WRAP * s.radius
            and 0.0 <= s.clearance
            and s.clearance * self.clearance <= play
            and 0.0 < s.seating
            and s.seating * self.seating_tension <= seats
            for s in sections
        )
        if not valid or not 1 <= len(sections) <= MAX_SECTIONS:
            raise self._refusal("conduit")
        if self.stress_relaxation > 0.0 and len({s.seating for s in sections}) > 1:
            allowed = "0 (off) where sections differ in `seating_tension`"
            raise self._refusal("stress_relaxation", allowed)
        object.__setattr__(self, "conduit", sections)
        for name, known in (("bend", BENDS), ("ends", ENDS), ("path", PATHS)):
            if own[name] not in known:
                raise self._refusal(name)
        if self.bend == "route" and not self.route:
            raise CableError(
                "cable parameter `bend` is 'route' but `route` is empty; it must name "
                "the spatial tendon that the conduit follows"
            )
        if self.path != PATHS[0] and not self.route:
            raise CableError(
                f"cable parameter `path` is {self.path!r} but `route` is empty; it "
                "must name the spatial tendon that leads the cable"
            )
        if bool(self.mouth) != (self.path == "mixed"):
            raise CableError(
                f"cable parameter `mouth` is {self.mouth!r} where `path` is "
                f"{self.path!r}; it must be {ALLOWED['mouth']}"
            )
        object.__setattr__(self, "guides", _valid_guides(self.guides, self.path))
        for name in OF_A_CONDUIT if self.path == "open" else ():
            if getattr(self, name) != 0.0:
                raise CableError(
                    f"cable parameter `{name}` is that of a conduit; it must be 0 "
                    "(off) where `path` is 'open'"
                )

    def _refusal(self, name: str, allowed: str = "") -> CableError:
        given, allowed = getattr(self, name), allowed or ALLOWED[name]
        return CableError(
            f"cable parameter `{name}` is {given!r}; it must be {allowed}"
        )

    @property
    def length(self) -> float:
        """Length of the conduit [m]."""
        return sum(section.length for section in self.conduit)

    @property
    def wrap(self) -> float:
        """Total wrap angle of the conduit [rad]."""
        return sum(section.length / section.radius for section in self.conduit)

    @property
    def scalars(self) -> tuple[float, ...]:
        """Values of the scalar parameters in the order of `PARAMETERS`."""
        return _scalars(self)

    @property
    def terms(self) -> dict[str, Term]:
        """Terms of the cable's laws that are on, by the parameter that is not 0."""
        found = {}
        for name, term in TERMS.items():
            if getattr(self, name) != 0.0:
                other = term.constant_without
                constant = other and getattr(self, other) == 0.0
                found[name] = term._replace(depends_on=()) if constant else term
        return found

    def require_terms(self, holds: Callable[[Term], bool], why: str) -> None:
        """Require a condition of all terms of the cable that are on.

        Args:
            holds: the condition on a term.
            why: reason for the condition, with which the error ends.

        Raises:
            CableError: a term is on and does not meet the condition.
        """
        for name, term in self.terms.items():
            if not holds(term):
                other = term.constant_without
                off = f"it or `{other}` must be 0" if other else "it must be 0"
                raise CableError(
                    f"cable parameter `{name}` is {getattr(self, name)!r}; {off} "
                    f"(off), for {why}"
                )

    @classmethod
    def from_config(cls, config: Mapping[str, str], where: str = "cable") -> "Cable":
        """Read a cable from configuration text of an MJCF file.

        Args:
            config: key to text; missing keys take their default. Loading curves are
                refused: `from_mjcf` fits them.
            where: place to name in an error, for instance the plugin instance.

        Raises:
            CableError: an unknown key, or a value that is not allowed.
        """

        def refused(key: str, allowed: str) -> CableError:
            text = config[key]
            return CableError(f"{where}: key `{key}` is {text!r}; it must be {allowed}")

        for key in config:
            if key not in KEYS:
                matches = difflib.get_close_matches(key, KEYS, n=1)
                hint = f"; did you mean `{matches[0]}`?" if matches else ""
                raise CableError(
                    f"{where}: unknown key `{key}`{hint} (keys: {', '.join(KEYS)})"
                )
        values: dict[str, object] = {}
        for p in PARAMETERS:
            if p.name in config:
                number = _parse_decimal(config[p.name])
                if number is None or not p.admits(number):
                    raise refused(p.name, ALLOWED.get(p.name, p.allowed))
                values[p.name] = number
        if "segments" in config:
            digits = config["segments"].strip(" \t\n\v\f\r")  # blanks in MJCF
            if not (digits.isascii() and digits.isdigit()):
                raise refused("segments", ALLOWED["segments"])
            values["segments"] = int(digits)
        values |= {name: config[name] for name in _TEXTS if name in config}
        for key, parse in (("conduit", _parse_sections), ("guides", _parse_guides)):
            if key in config:
                values[key] = parse(config[key])
                if values[key] is None:
                    raise refused(key, ALLOWED[key])
        try:
            return cls(**values)  # type: ignore[arg-type]
        except CableError as error:
            raise CableError(f"{where}: {error}") from None

    def to_config(self) -> dict[str, str]:
        """Return the text of every configuration key, the inverse of `from_config`."""
        config = dict(zip(_NAMES, map(repr, self.scalars), strict=True))
        config["segments"] = str(self.segments)
        config["conduit"] = " ".join(map(_section_text, self.conduit))
        for name in _TEXTS:
            if (text := getattr(self, name)) != getattr(Cable, name):
                config[name] = text
        if self.guides:
            words = (
                f"{g.name}:{ROLLER if g.radius == ROLLER else repr(g.radius)}"
                for g in self.guides
            )
            config["guides"] = " ".join(words)
        return config

    def replace(self, **changes: object) -> "Cable":
        """Return a copy with some fields changed."""
        return Cable(**(vars(self) | changes))

    def with_friction(self, friction: float, **changes: object) -> "Cable":
        """Return a copy with other kinetic friction, static friction in proportion.

        Args:
            friction: coefficient [-]. If that of this cable is 0, its copy has no
                static friction.
            changes: other fields to change, except `static_friction`.

        Raises:
            CableError: a coefficient is out of its range.
        """
        changes |= {"friction": friction, "static_friction": 0.0}
        breaks_away = self.friction != 0.0 and self.static_friction != 0.0
        if breaks_away and FRICTION.admits(friction):
            ratio = self.static_friction / self.friction
            if (static := ratio * friction) > BREAK_AWAY.high:
                raise CableError(
                    f"break-away friction is {ratio:.3g} times `friction`, "
                    f"{static:.3g}; it must be at most {BREAK_AWAY.high:g}: give "
                    "`static_friction`, too"
                )
            # In a proportion of 1 it may come out a last digit below.
            changes["static_friction"] = max(static, friction)
        return self.replace(**changes)


PARAMETERS: tuple[Parameter, ...] = parameters_of(Cable)
"""Scalar parameters; their order is that of the packed vector of the kernel."""

FRICTION, BREAK_AWAY = (
    next(p for p in PARAMETERS if p.name == name)
    for name in ("friction", "static_friction")
)

_RANGES = tuple(
    (p, p.name, math.nextafter(p.low, math.inf) if p.low_open else p.low, p.high)
    for p in PARAMETERS
)
"""Each parameter with its name, the least and the largest number that it admits."""
_NAMES = tuple(p.name for p in PARAMETERS)
_scalars = operator.attrgetter(*_NAMES)

TERMS: dict[str, Term] = {p.name: p.term for p in PARAMETERS if p.term is not None}
"""Terms of the cable's laws, by the parameter that switches each on."""

KEYS = tuple(field.name for field in dataclasses.fields(Cable))
"""Configuration keys of a cable: the names of its fields."""
_TEXTS = ("route", "bend", "path", "mouth", "ends")


def _parse_decimal(text: str) -> float | None:
    """Return the number in a decimal text; None for `inf` and texts like `1_0`."""
    if "_" in text or not any(c.isdigit() for c in text):
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _parse_sections(text: str) -> tuple[Section, ...] | None:
    sections = []
    for word in text.split() or [""]:
        length, _, rest = word.partition(":")
        radius, *factors = rest.split(":")
        bend = math.inf if radius == "inf" else _parse_decimal(radius)
        given = _parse_decimal(length), bend, *map(_parse_decimal, factors)
        numbers = [number for number in given if number is not None]
        if len(numbers) < len(given) or len(factors) not in (0, 2):
            return None
        sections.append(Section(*numbers))
    return tuple(sections)


def _section_text(section: Section) -> str:
    plain = section == Section(section.length, section.radius)
    return ":".join(map(repr, section[:2] if plain else section))


def _parse_guides(text: str) -> tuple[Guide, ...] | None:
    guides = []
    for word in text.split():
        name, _, value = word.rpartition(":")
        radius = ROLLER if value == ROLLER else _parse_decimal(value)
        if not name or radius is None:
            return None
        guides.append(Guide(name, radius))
    return tuple(guides)


def _valid_guides(given: Any, path: str) -> tuple[Guide, ...]:
    """Return the guides of a cable as `Guide`s, checked; `path` is its kind of path."""
    guides = []
    try:
        pairs = given.items() if isinstance(given, Mapping) else given
        for name, radius in pairs:
            value = radius if radius == ROLLER else float(radius)
            named = isinstance(name, str) and len(name.split()) == 1
            sized = value == ROLLER or 0.0 < float(value) <= MAX_LENGTH
            if not (named and name == name.strip() and sized and path != PATHS[0]):
                raise ValueError
            guides.append(Guide(name, value))
    except (TypeError, ValueError):
        raise CableError(
            f"cable parameter `guides` is {given!r} where `path` is {path!r}; it must "
            f"be pairs of a name and a radius or {ROLLER!r}, in MJCF "
            f"{ALLOWED['guides']}"
        ) from None
    return tuple(guides)
