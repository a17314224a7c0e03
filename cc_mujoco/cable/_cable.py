"""The cable: every parameter is one of its fields, described at the field.

    >>> from cc_mujoco.cable import Cable
    >>> cable = Cable.from_config({"conduit": "0.8:0.15 0.6:inf 0.6:0.4"})
    >>> round(cable.length, 3), round(cable.wrap, 3)
    (2.0, 6.833)

The fields of `Cable` carry their unit, bounds, default, meaning and law; MJCF keys, the
packed vector of the kernel and the parameters that a fit may vary are read off them as
`PARAMETERS`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from cc_mujoco.cable._parameter import Parameter, Term, parameter, parameters_of
from cc_mujoco.errors import CableError

MAX_SEGMENTS, MAX_SECTIONS = 1000, 64
MAX_LENGTH, MAX_WRAP = 50.0, 100.0
"""Longest section [m] and most wrap of one [rad], sixteen turns: what is longer was
meant in millimetres, and a tighter bend otherwise."""
BENDS = ("fixed", "route")
"""Sources of the bends of the conduit: its sections, or the route as it moves."""
PATHS = ("guided", "open", "mixed")
"""Guides of the cable: a conduit, its tendon's sites and geoms, or one, then these."""
ROLLER = "roller"
"""Guide of an open cable that turns with it, so that it does not rub."""
OF_A_CONDUIT = (
    "seal_proximal", "seal_distal", "clamp_creep_proximal", "clamp_creep_distal",
)  # fmt: skip
"""Parameters of what only a conduit has; they are off where the whole path is open."""
ENDS = ("auto", "explicit")
"""Ends of the cable in MuJoCo's step: implicit where it is long for them, or never."""
ALLOWED = {
    "segments": f"a whole number in [1, {MAX_SEGMENTS}]",
    "conduit": (
        f"1 to {MAX_SECTIONS} sections `length:radius` in metres, both positive, no "
        f"length above {MAX_LENGTH:g} and no bend above {MAX_WRAP:g} rad, radius `inf` "
        "where straight, e.g. `0.8:0.15 0.6:inf`"
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
"""Values of the keys that are no scalar parameters, in words."""


MAX_SPRING_LOSS = 0.6
"""Largest loss of a spring at an end: it slides back at a tenth of its tension."""
_HARDENING = Term(
    "C dT/du = 1 + h T", "Fung, Am. J. Physiol. 213, 1967 (soft tissue)", "elasticity",
    ("load",),
)  # fmt: skip
_LOSS = Term(
    "a bristle in parallel holds 3/2 of the loss of the tension of the spring",
    "Iwan, J. Appl. Mech. 33, 1966, with a limit that grows with the load",
    "elasticity", ("load", "history"),
)  # fmt: skip


class Section(NamedTuple):
    """Conduit of constant bend: length [m] and bend radius [m], inf where straight."""

    length: float
    radius: float


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

    axial_stiffness: float = parameter(
        unit="N", bounds=(0.0, 1e9), default=4000.0, low_open=True,
        meaning="EA of the cable: tension per unit strain (thesis k_c, 2.8)",
    )  # fmt: skip
    pretension: float = parameter(
        unit="N", bounds=(0.0, 1e6), default=10.0,
        meaning="uniform tension in the reference pose",
    )  # fmt: skip
    friction: float = parameter(
        unit="1", bounds=(0.0, 5.0), default=0.15,
        meaning="kinetic Coulomb coefficient mu_d (2.6)",
        term=Term("dT/dx = s mu_d T/R", "thesis 2.6, 2.10", "coefficient"),
    )  # fmt: skip
    static_friction: float = parameter(
        unit="1", bounds=(0.0, 5.0), default=0.0,
        meaning=(
            "break-away coefficient mu_s (2.7, 2.17); 0 is off, else at least "
            "`friction`"
        ),
        term=Term(
            (
                "mu_s holds a segment at rest; mu_d + (mu_s - mu_d) "
                "exp(-slip/critical_slip_distance)"
            ),
            "thesis 2.7, 2.17; slip weakening after Ida, J. Geophys. Res. 77, 1972",
            "coefficient", ("history",), "critical_slip_distance",
        ),
    )  # fmt: skip
    critical_slip_distance: float = parameter(
        unit="m", bounds=(0.0, 1.0), default=0.0,
        meaning=(
            "slip over which break-away and Stribeck friction adapt; 0 is at once"
        ),
    )  # fmt: skip
    viscous_friction: float = parameter(
        unit="N s/m^2", bounds=(0.0, 1e6), default=0.0,
        meaning="drag per conduit length and slip speed; 0 is off",
        term=Term("dT/dx = c v", "thesis 2.4.4, Fig. 2.13", "drag", ("rate",)),
    )  # fmt: skip
    stribeck_friction: float = parameter(
        unit="1", bounds=(0.0, 5.0), default=0.0,
        meaning="extra friction coefficient at vanishing slip speed; 0 is off",
        term=Term(
            "mu += mu_b ((1 - q) exp(-d) + q/(1 + d)), d = (|v|/v_b)^p",
            "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994",
            "coefficient", ("rate",),
        ),
    )  # fmt: skip
    stribeck_speed: float = parameter(
        unit="m/s", bounds=(0.0, 10.0), default=0.01, low_open=True,
        meaning="slip speed over which the Stribeck term decays",
    )  # fmt: skip
    stribeck_exponent: float = parameter(
        unit="1", bounds=(0.0, 10.0), default=1.0, low_open=True,
        meaning="exponent p of that decay; 2 is Gaussian",
    )  # fmt: skip
    stribeck_tail: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning="share q of a slow tail in it; 1 with p = 2 is Lorentzian",
    )  # fmt: skip
    load_independent_friction: float = parameter(
        unit="N/m", bounds=(0.0, 1e5), default=0.0,
        meaning="drag per conduit length that needs no tension; 0 is off",
        term=Term(
            "dT/dx = s f_0",
            "capstan intercept; Palli and Melchiorri, Mechatronics 24, 2014", "drag",
        ),
    )  # fmt: skip
    seal_proximal: float = parameter(
        unit="N", bounds=(0.0, 1e5), default=0.0,
        meaning="drag of the seal at the proximal end; needs no tension; 0 is off",
        term=Term(
            "T jumps by s F at the proximal end", "dry friction of wipers and ferrules",
            "drag",
        ),
    )  # fmt: skip
    seal_distal: float = parameter(
        unit="N", bounds=(0.0, 1e5), default=0.0,
        meaning="the same at the distal end of the conduit",
        term=Term(
            "T jumps by s F at the distal end", "dry friction of wipers and ferrules",
            "drag",
        ),
    )  # fmt: skip
    friction_asymmetry: float = parameter(
        unit="1", bounds=(-0.9, 0.9), default=0.0,
        meaning=(
            "a: friction times 1 + a for slip towards proximal, 1 - a towards distal"
        ),
        term=Term(
            "mu *= 1 + a towards proximal, 1 - a towards distal",
            (
                "direction-dependent efficiency, e.g. the drive and backdrive friction "
                "of Duclusaud et al., arXiv 2410.08650, 2024"
            ),
            "coefficient", ("direction",),
        ),
    )  # fmt: skip
    end_compliance: float = parameter(
        unit="m/N", bounds=(0.0, 1.0), default=0.0,
        meaning="spring between the cable and its distal end; 0 is off",
        term=Term("u_distal += C T_distal", "springs in series", "elasticity"),
    )  # fmt: skip
    proximal_compliance: float = parameter(
        unit="m/N", bounds=(0.0, 1.0), default=0.0,
        meaning="the same at the proximal end",
        term=Term("u_proximal -= C T_proximal", "springs in series", "elasticity"),
    )  # fmt: skip
    end_hardening: float = parameter(
        unit="1/N", bounds=(0.0, 10.0), default=0.0,
        meaning=(
            "h: the spring at the distal end is 1 + h T times as stiff at a tension T, "
            "as textile and skin are; 0 is off"
        ),
        term=_HARDENING,
    )  # fmt: skip
    end_loss: float = parameter(
        unit="1", bounds=(0.0, MAX_SPRING_LOSS), default=0.0,
        meaning=(
            "share of the work that the spring at the distal end takes up and does not "
            "give back; 0 is off"
        ),
        term=_LOSS,
    )  # fmt: skip
    proximal_hardening: float = parameter(
        unit="1/N", bounds=(0.0, 10.0), default=0.0,
        meaning="`end_hardening` of the spring at the proximal end",
        term=_HARDENING,
    )  # fmt: skip
    proximal_loss: float = parameter(
        unit="1", bounds=(0.0, MAX_SPRING_LOSS), default=0.0,
        meaning="`end_loss` of the spring at the proximal end",
        term=_LOSS,
    )  # fmt: skip
    bristle_length: float = parameter(
        unit="m", bounds=(0.0, 1.0), default=0.0,
        meaning=(
            "elastic displacement over which friction builds up (presliding); 0 is off"
        ),
        term=Term(
            "dF/dw = F_Coulomb/z_b until F = F_Coulomb",
            (
                "elastic-plastic limit of Dahl, Aerospace Corp. TOR-0158, 1968; with "
                "normal force, Palli and Melchiorri, Mechatronics 24, 2014"
            ),
            "elasticity", ("history",),
        ),
    )  # fmt: skip
    tension_exponent: float = parameter(
        unit="1", bounds=(-1.0, 1.0), default=0.0,
        meaning=(
            "e: friction times (T / pretension)^e, T at least 1 % of the pretension"
        ),
        term=Term(
            "mu *= (T/T_0)^e",
            "Howell's F = a N^n, e.g. Jung, Pan, Kang, Tribology Int. 41, 2008",
            "coefficient", ("load",),
        ),
    )  # fmt: skip
    ageing_friction: float = parameter(
        unit="1", bounds=(0.0, 5.0), default=0.0,
        meaning=(
            "beta: friction grows by beta ln(1 + t / ageing_time) with the age "
            "t of the contacts, which slip over `critical_slip_distance` renews; 0 is "
            "off"
        ),
        term=Term(
            "mu += beta ln(1 + t/t_0) with contacts of age t",
            (
                "Dieterich, Pure Appl. Geophys. 116, 1978; Ruina, J. Geophys. Res. 88, "
                "1983"
            ),
            "coefficient", ("history", "time"),
        ),
    )  # fmt: skip
    ageing_time: float = parameter(
        unit="s", bounds=(0.0, 1e6), default=1.0, low_open=True,
        meaning="time scale of that growth",
    )  # fmt: skip
    wrap_growth: float = parameter(
        unit="1/m", bounds=(-1e3, 1e3), default=0.0,
        meaning=(
            "g: wrap angles times 1 + g u, u the distal displacement from the rest pose"
        ),
        term=Term(
            "wrap angle *= 1 + g u_distal, in the last part of the conduit",
            "a routing that bends with the joint; thesis Experiment 1b", "coefficient",
            ("place",),
        ),
    )  # fmt: skip
    wrap_reach: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=1.0, low_open=True,
        meaning="share of the conduit, from its distal end, in which they do",
    )  # fmt: skip
    friction_drift: float = parameter(
        unit="1/s", bounds=(-1e3, 1e3), default=0.0,
        meaning="d: friction times 1 + d t + h W, t the time since the start",
        term=Term(
            "mu *= 1 + d t", "wear and weather, thesis 3.2.3", "coefficient", ("time",),
        ),
    )  # fmt: skip
    friction_heating: float = parameter(
        unit="1/J", bounds=(-1e3, 1e3), default=0.0,
        meaning="h: of the heat W that friction left in the conduit; 0 is off",
        term=Term(
            "mu *= 1 + h W, dW/dt = friction power - W/t_c",
            "a liner that warms up by its own friction, one thermal mass",
            "coefficient", ("time",),
        ),
    )  # fmt: skip
    cooling_time: float = parameter(
        unit="s", bounds=(0.0, 1e9), default=60.0, low_open=True,
        meaning="time in which that heat falls to 1/e",
    )  # fmt: skip
    bedding_strain: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning=(
            "e: strain by which a cable is longer before its strands lie close; "
            "`axial_stiffness` is that of the taut cable; 0 is off"
        ),
        term=Term(
            "strain = T / EA + e T / (T + T_b)",
            "constructional stretch of ropes, as their makers give it", "elasticity",
            ("load",),
        ),
    )  # fmt: skip
    bedding_tension: float = parameter(
        unit="N", bounds=(0.0, 1e6), default=20.0, low_open=True,
        meaning="T_b: tension that takes half of that strain",
    )  # fmt: skip
    clearance: float = parameter(
        unit="m", bounds=(0.0, 0.01), default=0.0,
        meaning=(
            "c: play of the cable across its conduit, by which its path is shorter per "
            "wrap where it is taut; 0 is off"
        ),
        term=Term(
            "path -= c theta T / (T + T_c)",
            "geometry: slack cable lies at the outer wall, taut at the inner",
            "elasticity", ("load",),
        ),
    )  # fmt: skip
    seating_tension: float = parameter(
        unit="N", bounds=(0.0, 1e6), default=5.0, low_open=True,
        meaning="T_c: tension at which half of that play is taken up",
    )  # fmt: skip
    stress_relaxation: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning=(
            "share of the pretension that the rest pose loses in the end, as "
            "the cable grows longer; 0 is off"
        ),
        term=Term(
            "T_0 *= 1 - c (1 - exp(-t/t_c))", "standard linear solid", "elasticity",
            ("time",),
        ),
    )  # fmt: skip
    relaxation_time: float = parameter(
        unit="s", bounds=(0.0, 1e9), default=60.0, low_open=True,
        meaning="time scale of that loss",
    )  # fmt: skip
    clamp_creep_proximal: float = parameter(
        unit="m/(N s)", bounds=(0.0, 1.0), default=0.0,
        meaning=(
            "c: speed at which the conduit slides for good in its clamp at the "
            "proximal end, per tension above `clamp_force`; 0 is off"
        ),
        term=Term(
            "ds/dt = c max(T_proximal - F, 0), the path shorter by s",
            "plastic flow above a yield force, Bingham 1922", "elasticity",
            ("history", "time"),
        ),
    )  # fmt: skip
    clamp_creep_distal: float = parameter(
        unit="m/(N s)", bounds=(0.0, 1.0), default=0.0,
        meaning="the same at the distal end",
        term=Term(
            "ds/dt = c max(T_distal - F, 0), the path shorter by s",
            "plastic flow above a yield force, Bingham 1922", "elasticity",
            ("history", "time"),
        ),
    )  # fmt: skip
    clamp_force: float = parameter(
        unit="N", bounds=(0.0, 1e6), default=50.0,
        meaning="F: force up to which a clamp holds the end of the conduit",
    )  # fmt: skip
    eccentricity: float = parameter(
        unit="m", bounds=(0.0, 0.1), default=0.0,
        meaning=(
            "e: lever of the cable on the proximal pulley plus e cos(q - phase) at "
            "its angle q; 0 is off"
        ),
        term=Term("r + e cos(q - phase)", "geometry", "pulley", ("place",)),
    )  # fmt: skip
    eccentricity_phase: float = parameter(
        unit="rad", bounds=(-10.0, 10.0), default=0.0,
        meaning=(
            "pulley angle at which that is largest; pi more for the antagonist of a "
            "pair that leaves the pulley on its two sides"
        ),
    )  # fmt: skip
    ovality: float = parameter(
        unit="m", bounds=(0.0, 0.1), default=0.0,
        meaning="o: radius of the proximal pulley plus o cos(2 q - phase); 0 is off",
        term=Term("r + o cos(2 q - phase)", "geometry", "pulley", ("place",)),
    )  # fmt: skip
    ovality_phase: float = parameter(
        unit="rad", bounds=(-10.0, 10.0), default=0.0,
        meaning="twice an angle of largest radius",
    )  # fmt: skip
    grease_drag: float = parameter(
        unit="N/m", bounds=(0.0, 1e6), default=0.0,
        meaning="g: drag of grease per conduit length at a slip of 1 m/s; 0 is off",
        term=Term(
            "dT/dx = s g |v|^n",
            (
                "Herschel and Bulkley, Kolloid-Zeitschrift 39, 1926; its yield stress "
                "is `load_independent_friction`"
            ),
            "drag", ("rate",),
        ),
    )  # fmt: skip
    grease_exponent: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.5, low_open=True,
        meaning="n: power of the slip speed in m/s that it grows with; 1 is viscous",
    )  # fmt: skip
    segments: int = 50
    conduit: tuple[Section, ...] = (Section(1.0, math.inf),)
    route: str = ""
    bend: str = BENDS[0]
    path: str = PATHS[0]
    mouth: str = ""
    ends: str = ENDS[0]
    guides: tuple[Guide, ...] = ()

    def __post_init__(self) -> None:
        for p in PARAMETERS:
            value = getattr(self, p.name)
            plain = type(value) is float and not p.low_open and not p.whole
            if plain and p.low <= value <= p.high:
                continue  # most are, and cables are made by the thousand
            if not p.admits(value):
                raise self._refusal(p.name, p.allowed)
            object.__setattr__(self, p.name, float(value))
        if 0.0 < self.static_friction < self.friction:
            allowed = f"0 (off) or at least `friction` = {self.friction!r}"
            raise self._refusal("static_friction", allowed)
        if self.tension_exponent != 0.0 and self.pretension == 0.0:
            raise self._refusal("tension_exponent", "0 (off) where `pretension` is 0")
        if (
            not isinstance(self.segments, int)
            or isinstance(self.segments, bool)
            or not 1 <= self.segments <= MAX_SEGMENTS
        ):
            raise self._refusal("segments")
        try:
            sections = tuple(Section(float(a), float(b)) for a, b in self.conduit)
        except (TypeError, ValueError):
            allowed = (
                "sections, each a length and a radius in metres; text as in MJCF is "
                "for Cable.from_config"
            )
            raise self._refusal("conduit", allowed) from None
        valid = all(
            0.0 < s.length <= MAX_LENGTH and s.length <= MAX_WRAP * s.radius
            for s in sections
        )
        if not valid or not 1 <= len(sections) <= MAX_SECTIONS:
            raise self._refusal("conduit")
        object.__setattr__(self, "conduit", sections)
        if self.bend not in BENDS:
            raise self._refusal("bend")
        if self.bend == "route" and not self.route:
            raise CableError(
                "cable parameter `bend` is 'route' but `route` is empty; it must name "
                "the spatial tendon that the conduit follows"
            )
        if self.ends not in ENDS:
            raise self._refusal("ends")
        if self.path not in PATHS:
            raise self._refusal("path")
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
        if self.clearance > 0.0 and self.path != PATHS[0]:
            raise self._refusal("clearance", "0 (off) where `path` is not 'guided'")
        for end in "end", "proximal":
            spring = f"{end}_compliance"
            for name in f"{end}_hardening", f"{end}_loss":
                if getattr(self, name) != 0.0 and getattr(self, spring) == 0.0:
                    allowed = f"0 (off) where `{spring}` is 0"
                    raise self._refusal(name, allowed)
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
        return tuple(getattr(self, p.name) for p in PARAMETERS)

    @property
    def terms(self) -> dict[str, Term]:
        """Friction and elasticity terms that are on, by the parameter that is not 0."""
        found = {}
        for name, term in TERMS.items():
            if getattr(self, name) != 0.0:
                other = term.constant_without
                constant = other and getattr(self, other) == 0.0
                found[name] = term._replace(depends_on=()) if constant else term
        return found

    def require_terms(self, holds: Callable[[Term], bool], why: str) -> None:
        """Require that a law holds for all terms of the cable that are on.

        Args:
            holds: whether the law holds for a term.
            why: law that does not hold, as the end of a sentence.

        Raises:
            CableError: a term is on for which it does not.
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
    def from_config(cls, config: Mapping[str, str], where: str = "cable") -> Cable:
        """Read a cable from configuration text of an MJCF file.

        Args:
            config: key to text; missing keys take their default.
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
                    raise refused(p.name, p.allowed)
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
        config = {p.name: repr(getattr(self, p.name)) for p in PARAMETERS}
        config["segments"] = str(self.segments)
        config["conduit"] = " ".join(f"{s.length!r}:{s.radius!r}" for s in self.conduit)
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

    def replace(self, **changes: object) -> Cable:
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def with_friction(self, friction: float) -> Cable:
        """Return a copy with another kinetic friction and the same static ratio.

        Args:
            friction: coefficient [-]. If the present one is 0, there is no ratio of
                break-away friction to keep, and the copy has none.

        Raises:
            CableError: a coefficient is out of its range.
        """
        smooth = self.replace(friction=friction, static_friction=0.0)
        if self.friction == 0.0 or self.static_friction == 0.0:
            return smooth
        ratio = self.static_friction / self.friction
        if (static := ratio * friction) > BREAK_AWAY.high:
            raise CableError(
                f"break-away friction is {ratio:.3g} times `friction`, {static:.3g}; "
                f"it must be at most {BREAK_AWAY.high:g}: give `static_friction`, too"
            )
        # In a proportion of 1 it may come out a last digit below.
        return smooth.replace(static_friction=max(static, friction))


PARAMETERS: tuple[Parameter, ...] = parameters_of(Cable)
"""Scalar parameters; their order is that of the packed vector of the kernel."""

BREAK_AWAY = next(p for p in PARAMETERS if p.name == "static_friction")

TERMS: dict[str, Term] = {p.name: p.term for p in PARAMETERS if p.term is not None}
"""The terms that exist, by the parameter that switches each on."""

KEYS = tuple(field.name for field in dataclasses.fields(Cable))
"""All configuration keys of a cable."""
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
        length, _, radius = word.partition(":")
        number = _parse_decimal(length)
        bend = math.inf if radius == "inf" else _parse_decimal(radius)
        if number is None or bend is None:
            return None
        sections.append(Section(number, bend))
    return tuple(sections)


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
