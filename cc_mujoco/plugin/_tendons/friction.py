"""Friction for a tendon that a model has already.

>>> import mujoco
>>> import cc_mujoco
>>> spec = mujoco.MjSpec.from_string('''<mujoco><worldbody>
...   <site name="a"/><site name="post" pos=".1 0 .05"/>
...   <body pos=".2 0 0"><joint name="knee" axis="0 1 0"/><geom size=".02"/>
...     <site name="b" pos=".05 0 .02"/></body>
...   <body><joint name="winch" armature="1e-4"/><geom size=".01"/></body>
... </worldbody><tendon><spatial name="extensor">
...   <site site="a"/><site site="post"/><site site="b"/>
... </spatial></tendon></mujoco>''')
>>> report = cc_mujoco.add_friction(
...     spec, "extensor", motor=("winch", 0.01), friction=0.1)
>>> model = spec.compile()
>>> [model.actuator(i).name for i in range(2)]
['extensor_proximal', 'extensor_distal']
"""

import dataclasses
import math
import warnings
from collections.abc import Collection, Iterable, Mapping
from numbers import Real
from typing import Any, TypeAlias, TypeVar

import mujoco

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.cable._cable import MAX_LENGTH, MAX_SEGMENTS, ROLLER, Cable, Section
from cc_mujoco.errors import CableError, CableWarning, look_up
from cc_mujoco.plugin import _spec as specs
from cc_mujoco.plugin._mjcf import to_mjcf
from cc_mujoco.plugin._path import ARC_SEGMENTS
from cc_mujoco.plugin._readings import tendon_turn
from cc_mujoco.plugin._settle import step_limits
from cc_mujoco.plugin._tendons import account as accounts
from cc_mujoco.plugin._tendons import burden as burdens
from cc_mujoco.plugin._tendons import winch as winching
from cc_mujoco.plugin._tendons.report import TendonSummary, tendon_report

MAX_STIFFNESS = 50e3
"""Default axial stiffness EA of a tendon made a cable [N], if the step allows it."""
_MAX_STRAIN = 0.2
"""Largest strain under load at which a cable of default stiffness is stable.

A piece becomes stiffer with its strain, and a sudden pull overshoots.
"""
T = TypeVar("T")
Each: TypeAlias = T | Mapping[str | int, T]
"""A value for all tendons, or a dict of values by tendon."""


def add_friction(
    spec: mujoco.MjSpec,
    tendon: str | int | Iterable[str | int],
    *,
    motor: Each[tuple[Any, float] | None] = None,
    joint: Each[tuple[Any, float] | None] = None,
    winch: Each[tuple[float, float] | None] = None,
    friction: Each[float | None] = None,
    segments: Each[int | None] = None,
    guides: Mapping[str, float | str] | None = None,
    report: bool = False,
    **parameters: Any,
) -> accounts.AddedCables:
    """Make spatial tendons cables with friction wherever they bend.

    A tendon becomes a cable on an open path, of its own name: its first site is the
    proximal end, its last one the distal end. Each of its pieces then pulls with its
    own tension, and MuJoCo's moment arms stay what they are.

    What acted on the tendon as a whole (actuators, `stiffness`, `springyield`,
    `damping`, `frictionloss`, `range`, `armature`, equalities) then acts at its first
    site, on a winch `<tendon>_winch`: a joint whose position is the length of tendon
    that it has paid out, and a fixed tendon of that length. Commands keep their place
    and their units. A tendon that has nothing but a spring, taut in the pose `qpos0`,
    becomes an elastic band instead. Behind each `<pulley>` a cable begins, `<tendon>_1`
    and on, with its share of the force.

    Several tendons are taken over at once, which is much faster than one after another
    and makes all of them stable together. Each argument then holds for all of them, or
    is a dict by tendon, as in `friction={"flexor": 0.1, "extensor": 0.2}`.

    Args:
        spec: the specification to change.
        tendon: name of a spatial tendon or its index in `spec.tendons`, or several of
            these; its sites run from the motor to the load. A tendon without a name
            gets `tendon_<index>`.
        motor: joint that winds the tendon up as it turns in the positive sense, and
            the radius of its drum [m]; by default the tendon is tied to its first site,
            or to its winch.
        joint: joint that winds up the other end, and the radius of its drum [m]; by
            default the tendon is tied to its last site.
        winch: radius [m] and inertia [kg m^2] of the drum on which the actuators of the
            tendon wind it; by default they pull at its first site, through a slide so
            light that it changes nothing. The units of commands are those of the tendon
            in both cases.
        friction: coefficient mu of Coulomb friction at every site and geom; must be
            given, since a tendon has none of its own.
        segments: friction elements; by default one for a site and four for a geom.
        guides: guides by the name of a site or geom, `"roller"` where the tendon runs
            over a frictionless roller, or the radius of the guide at a site [m],
            over whose arc there is drag per length; Coulomb friction is the same for
            any.
        report: print the turns and losses of the tendons, see `tendon_report`.
        parameters: other parameters of the cable, by name, see `Cable`; unless given
            they are those of `Cable()`. A tendon with a winch has by default the
            `pretension` that its `frictionloss` holds in `qpos0`, or none, and the
            `axial_stiffness` that its time step bears, at most `MAX_STIFFNESS`.

    Returns:
        Report on everything that acted on the tendon, a line for each. Of several
        tendons it has a line for each tendon, and `parts` has their reports.

    Raises:
        CableError: there is no such tendon, it is fixed or belongs to a cable already,
            a drum is on a joint that is no hinge or takes the place of a winch, a
            parameter cannot be used, something that acts on the tendon has no meaning
            at its end, the time step bears only a stiffness by default that is
            unstable under the pull of its actuators, or the model does not compile. The
            specification is as before.

    Warns:
        CableWarning: friction takes much of the tension as a tendon lies in `qpos0`,
            because its sites zig-zag, the time step bears only a soft tendon, or
            `qpos0` violates its `range`.
    """
    require_kind("spec", spec, mujoco.MjSpec)
    specs.require_parameters(parameters, ("route", "bend", "path", "mouth", "guides"))
    several = not isinstance(tendon, str) and isinstance(tendon, Iterable)
    start, named = spec.copy(), dict[Any, str]()
    if len(start.tendons) != len(spec.tendons):
        # A copy omits dangling references; compiling the original reports them.
        specs.compile_spec(spec)
    for which in tendon if several else (tendon,):  # type: ignore[union-attr]
        name = _name_of(start, which)
        if name not in named.values():
            named[which] = name
    if not named:
        raise CableError("add_friction needs a tendon, by its name or its index.")
    arguments = {
        "motor": motor, "joint": joint, "winch": winch, "friction": friction,
        "segments": segments, **parameters,
    }  # fmt: skip
    requests = []
    for which, name in named.items():
        own = {k: _value_of(k, value, which, named) for k, value in arguments.items()}
        ends = own.pop("motor"), own.pop("joint"), own.pop("winch")
        _require_ends(start, *ends)
        if own["friction"] is None:
            raise CableError(
                "add_friction needs friction=, the coefficient of friction wherever "
                "the tendon bends, e.g. friction=0.1."
            )
        given = {key: value for key, value in own.items() if value is not None}
        requests.append((name, *ends, given))
    with specs.muted_warnings():
        original = specs.compile_spec(start.copy())
        takeovers = [
            _Takeover(burdens.find_burden(start, original, name), *request)
            for name, *request in requests
        ]
        guides = {} if guides is None else guides
        moved, model = _plan(start, original, takeovers, guides)
        for which, name in named.items():
            if isinstance(which, int):
                spec.tendons[which].name = name
        if spec.keys:
            specs.compile_spec(spec)  # from now on its keyframes follow what is added
        _write_branches(spec, takeovers)
        if winches := [x.winch for x in takeovers if x.winch is not None]:
            winching.write_winches(spec, original, winches, moved)
        _write_cables(spec, takeovers)
        laid = [cable.route for takeover in takeovers for cable in takeover.cables]
        turns = tendon_report(model, laid)
    concerns = [
        x for own in takeovers for x in accounts.range_lines(own.burden, original)
    ]
    for takeover in takeovers:
        stiffness = takeover.stiffness
        if takeover.stiffens and stiffness < 100:
            concerns.append(
                f"tendon {takeover.burden.tendon!r} stretches by "
                f"{100 / stiffness:.2g} % of its length per newton, and a pull above "
                f"{_MAX_STRAIN * stiffness:.2g} N may make it unstable, because what "
                "it pulls bears no stiffer one at this time step; shorten the "
                "timestep, or give its joints more `armature`."
            )
    if report:
        print(turns)
    else:
        concerns += [s.warning for s in turns.tendons if s.warning and s.zigzags]
    for concern in concerns:
        warnings.warn(concern, CableWarning, stacklevel=2)
    summaries = {summary.name: summary for summary in turns.tendons}
    parts = tuple(_account(original, spec, model, x, summaries) for x in takeovers)
    if not several:
        return parts[0]
    pairs = zip(takeovers, parts, strict=True)
    lines = [accounts.summary_line(original, own.burden, part) for own, part in pairs]
    return accounts.AddedCables(tuple(laid), "", tuple(lines), parts)


@dataclasses.dataclass
class _Takeover:
    """A tendon that is turned into cables: the arguments and the plan."""

    burden: burdens.Burden  # loads on the tendon
    motor: tuple[Any, float] | None  # joint and radius of a drum at its proximal end
    joint: tuple[Any, float] | None  # joint and radius of a drum at its distal end
    drum: tuple[float, float] | None  # radius [m], inertia [kg m^2] of its winch's drum
    given: dict[str, Any]  # parameters of its cables, by name
    winch: winching.Winch | None = None  # winch that takes over its burden, if needed
    # Cables of its branches, each with the name of its branch as `route`.
    cables: list[Cable] = dataclasses.field(default_factory=list)
    bearable: float = math.inf  # axial stiffness that the time step bears [N]

    @property
    def stiffness(self) -> float:
        """Axial stiffness of its cables [N]."""
        return self.cables[0].axial_stiffness

    @property
    def stiffens(self) -> bool:
        """True if its cables get the largest stiffness that the time step allows."""
        return self.winch is not None and "axial_stiffness" not in self.given


def _name_of(spec: mujoco.MjSpec, which: Any) -> str:
    """Return the name of a tendon given by name or index; name it if it has none."""
    found = specs.find_element("tendon", which, spec.tendons)
    if not found.name:
        name, names = f"tendon_{which}", {tendon.name for tendon in spec.tendons}
        while name in names:
            name += "_"
        found.name = name
    return str(found.name)


def _value_of(key: str, value: Any, which: Any, named: dict[Any, str]) -> Any:
    if not isinstance(value, Mapping):
        return value
    for other in value:
        if other not in named and other not in named.values():
            raise CableError.unknown(f"tendon in {key}=", other, named.values())
    return value.get(which, value.get(named[which]))


def _plan(
    start: mujoco.MjSpec,
    original: mujoco.MjModel,
    takeovers: list[_Takeover],
    guides: Any,
) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Choose the winch and the cables of each tendon, and store them in `takeovers`.

    Return two compiled models: with the winches only, and with the cables too.
    """
    at_guides = _checked_guides(guides, [takeover.burden for takeover in takeovers])
    for takeover in takeovers:
        burden = takeover.burden
        for name in () if burden.is_none else ("motor", "joint"):
            if getattr(takeover, name) is not None:
                what = "actuators" if burden.actuators else "features of its own"
                raise CableError(
                    f"tendon {burden.tendon!r} has {what}, which a drum at its end "
                    f"would change; leave {name}= out, so that they pull at its first "
                    "site, or give winch=, the radius and inertia of a drum of their "
                    "own."
                )
        if takeover.drum is not None and not burden.needs_winch:
            raise CableError(
                "winch= is the drum of the actuators of a tendon, and "
                f"{burden.tendon!r} has none; give motor=, the joint of a drum and its "
                "radius, instead."
            )
    tried, moved = start.copy(), original
    _write_branches(tried, takeovers)
    loaded = [takeover for takeover in takeovers if takeover.burden.needs_winch]
    if loaded:
        winches = winching.plan_winches(
            tried, original, {x.burden: x.drum for x in loaded}
        )
        for takeover, winch in zip(loaded, winches, strict=True):
            takeover.winch = winch
        moved = winching.write_winches(tried, original, winches)
    data = mujoco.MjData(moved)
    mujoco.mj_fwdPosition(moved, data)
    for takeover in takeovers:
        held = 0.0
        if takeover.winch is not None:
            held = burdens.held_tension(original, takeover.burden)
        _lay(moved, data, takeover, held, at_guides)
    if loaded:
        _find_bearable(tried, takeovers)
    for takeover in loaded:
        if takeover.stiffens:
            stiffness = min(takeover.bearable, MAX_STIFFNESS)
            _refuse_soft(original, takeover.burden, stiffness)
            takeover.cables = [
                cable.replace(axial_stiffness=stiffness) for cable in takeover.cables
            ]
    _write_cables(tried, takeovers)
    return moved, specs.compile_spec(tried)


def _write_branches(spec: mujoco.MjSpec, takeovers: list[_Takeover]) -> None:
    for takeover in takeovers:
        if takeover.burden.needs_winch:
            burdens.write_branches(spec, takeover.burden)
        elif takeover.burden.is_band:
            burdens.slacken(spec, takeover.burden.tendon)


def _require_ends(spec: mujoco.MjSpec, motor: Any, joint: Any, winch: Any) -> None:
    for name, end in (("motor", motor), ("joint", joint)):
        paired = isinstance(end, tuple) and len(end) == 2
        if end is not None and not (paired and isinstance(end[1], Real)):
            raise CableError(
                f"{name} must be a joint and the radius of its drum in metres, e.g. "
                f"('winch', 0.02), not {end!r}."
            )
        drum = spec.joint(end[0]) if end and isinstance(end[0], str) else end and end[0]
        is_joint = isinstance(drum, mujoco.MjsJoint)
        if is_joint and drum.type != mujoco.mjtJoint.mjJNT_HINGE:
            raise CableError(
                f"{name} must be a hinge, which turns a drum, and joint {drum.name!r} "
                "is none; what slides pulls a tendon by the site where it is tied."
            )
    if winch is not None and not (
        isinstance(winch, tuple)
        and len(winch) == 2
        and all(isinstance(x, Real) and 0.0 < float(x) < math.inf for x in winch)
        and float(winch[0]) < 1.0
    ):
        raise CableError(
            "winch must be the radius of a drum in metres, below 1, and its inertia in "
            f"kg m^2, e.g. (0.01, 1e-5), not {winch!r}."
        )


def _lay(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    takeover: _Takeover,
    held: float,
    guides: tuple[tuple[str, Any], ...],
) -> None:
    """Create the cables of a tendon, as long and as bent as the paths of its branches.

    `model` contains its winch, `data` is at `qpos0`, and `held` is the tension that dry
    friction holds there [N].
    """
    burden, values = takeover.burden, {"path": "open", **takeover.given}
    if takeover.winch is not None:
        # Without it what friction holds would fall into the cable, and shake it.
        pretension = float(f"{held:.3g}")
        values = {"pretension": pretension, "axial_stiffness": MAX_STIFFNESS} | values
    elif burden.is_band:
        for key in ("axial_stiffness", "pretension"):
            if key in takeover.given:
                raise CableError(
                    f"tendon {burden.tendon!r} has a `stiffness`, which makes its "
                    f"{key}; leave {key}= out, or take the stiffness away."
                )
        rate, rest = burden.spring[0], burden.rest[1]
        values["axial_stiffness"] = rate * rest
        values["pretension"] = rate * (burden.length - rest)
    for branch in burden.branches:
        index = model.tendon(branch.name).id
        length = float(model.tendon_length0[index])
        geoms = sum(side is not None for _, side in branch.path)
        places = len(branch.path) - 2 + (ARC_SEGMENTS - 1) * geoms
        inner = {target for target, _ in branch.path[1:-1]}
        own: dict[str, Any] = {
            "segments": min(max(places, 1), MAX_SEGMENTS),
            "conduit": (Section(length, math.inf),),
            "route": branch.name,
            "guides": tuple(guide for guide in guides if guide[0] in inner),
        }
        cable, wrap = Cable(**(own | values)), tendon_turn(model, data, index)
        if wrap > 0.0:
            # Where there is no MuJoCo the cable bends by as much, evenly.
            conduit = (Section(cable.length, cable.length / wrap),)
            cable = cable.replace(conduit=conduit)
        takeover.cables.append(cable)


def _checked_guides(
    given: Any, burdens: Collection[burdens.Burden]
) -> tuple[tuple[str, Any], ...]:
    if not isinstance(given, Mapping):
        raise CableError(
            f"guides is {given!r}; it must be a dict such as {{'tip': 0.01, 'palm': "
            f"{ROLLER!r}}}."
        )
    inner = {
        target: side
        for burden in burdens
        for branch in burden.branches
        for target, side in branch.path[1:-1]
    }
    tendons = ", ".join(repr(burden.tendon) for burden in burdens)
    for name, value in given.items():
        kind = f"guide of tendon {tendons} between its ends"
        look_up(kind, name, inner)
        radius = float(value) if isinstance(value, Real) else math.nan
        if value != ROLLER and inner[name] is not None:
            raise CableError(
                f"guide {name!r} is {value!r}; a geom has its own radius, so it must "
                f"be {ROLLER!r} or left out."
            )
        if value != ROLLER and not 0.0 < radius <= MAX_LENGTH:
            raise CableError(
                f"guide {name!r} is {value!r}; it must be a radius above 0 and at most "
                f"{MAX_LENGTH:g} m, or {ROLLER!r}."
            )
    return tuple(given.items())


def _write_cables(spec: mujoco.MjSpec, takeovers: list[_Takeover]) -> None:
    for takeover in takeovers:
        for i, cable in enumerate(takeover.cables):
            own, winch, motor = spec.tendon(cable.route), takeover.winch, takeover.motor
            if winch is not None:
                motor = winch.names[i], -winch.lever
            # Cable wound up moves to proximal at the motor's end, to distal at the
            # other.
            proximal, distal = (own, -1.0), (own, 1.0)
            if motor is not None:
                proximal = _joint(spec, motor[0]), -motor[1]
            if takeover.joint is not None:
                distal = _joint(spec, takeover.joint[0]), takeover.joint[1]
            to_mjcf(spec, cable.route, cable, proximal, distal)


def _joint(spec: mujoco.MjSpec, joint: Any) -> Any:
    return spec.joint(joint) or joint if isinstance(joint, str) else joint


def _refuse_soft(
    original: mujoco.MjModel, burden: burdens.Burden, stiffness: float
) -> None:
    """Raise a `CableError` if a default stiffness [N] is too soft for its actuators."""
    bearable, step = _MAX_STRAIN * stiffness, original.opt.timestep
    pull = winching.largest_pull(original, burden)
    if pull > bearable:
        shorter = 0.9 * step * math.sqrt(bearable / pull)
        raise CableError(
            f"tendon {burden.tendon!r}: at a timestep of {step:g} s what it pulls "
            f"bears at most an axial_stiffness of {stiffness:g} N, which is unstable "
            f"above {bearable:.2g} N, and its actuators pull with {pull:.3g} N; "
            f"shorten the timestep to {shorter:.2g} s, give its joints more "
            "`armature`, or limit its actuators."
        )


def _find_bearable(spec: mujoco.MjSpec, takeovers: list[_Takeover]) -> None:
    """Set `bearable` of all takeovers: the largest stable axial stiffness EA [N].

    The pieces of the cables are then stable in `qpos0`, in keyframes and over the
    ranges of the joints. `spec`, which is not changed, contains the winches.
    """
    tried = spec.copy()
    _write_cables(tried, takeovers)
    model = specs.compile_spec(tried)
    data = mujoco.MjData(model)
    names = [cable.route for takeover in takeovers for cable in takeover.cables]
    shortest = dict.fromkeys(names, math.inf)
    for pose in winching.sample_poses(model):
        data.qpos[:] = pose
        limits = step_limits(model, data)
        for name, least in shortest.items():
            shortest[name] = min(least, limits[name].pieces)
    step = 3.0 * model.opt.timestep  # with a margin
    for takeover in takeovers:
        takeover.bearable = min(
            float(f"{cable.axial_stiffness * (shortest[cable.route] / step) ** 2:.2g}")
            for cable in takeover.cables
        )


def _account(
    original: mujoco.MjModel,
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    takeover: _Takeover,
    summaries: dict[str, TendonSummary],
) -> accounts.AddedCables:
    burden, winch, cables = takeover.burden, takeover.winch, takeover.cables
    names = tuple(cable.route for cable in cables)
    count = sum(cable.segments for cable in cables)
    lines = [
        f"tendon {burden.tendon!r}: "
        f"{'a cable' if len(cables) == 1 else f'{len(cables)} cables'} with friction "
        f"{cables[0].friction:g}, of {count} segment{'s' if count > 1 else ''}"
    ]
    held = cables[0].pretension
    if burden.is_band:
        lines.append(accounts.describe_band(burden, takeover.stiffness, held))
    if winch is not None:
        lines += accounts.describe_winch(original, spec, winch)
        if held > 0.0 and "pretension" not in takeover.given:
            lines.append(f"pretension {held:g} N: what the dry friction holds in qpos0")
    if not burden.is_band:
        lines.append(_stretch_line(takeover, original.opt.timestep))
    lines.append(accounts.order_line(model, names, original.nu))
    for summary in (summaries[name] for name in names):
        if summary.step_limit <= summary.timestep:
            lines.append(
                "timestep: in the worst pose over the ranges of its joints pieces of "
                f"{summary.name!r} become so short that {summary.axial_stiffness:g} N "
                f"is stable only below {1e3 * summary.step_limit:.3g} ms, and it is "
                f"{1e3 * summary.timestep:.3g} ms"
            )
    return accounts.AddedCables(
        names, "" if winch is None else burden.winch, tuple(lines)
    )


def _stretch_line(takeover: _Takeover, step: float) -> str:
    stiffness, bearable = takeover.stiffness, takeover.bearable
    length = max(cable.length for cable in takeover.cables)
    text = (
        f"axial_stiffness {stiffness:g} N: it stretches by "
        f"{1e3 * length / stiffness:.2g} mm per newton"
    )
    if stiffness > bearable:
        text += (
            f"; with a timestep of {step:g} s more than {bearable:g} N may make it "
            "unstable: shorten the timestep"
        )
    elif stiffness < MAX_STIFFNESS and stiffness == bearable:
        text += (
            f", as stiff as a timestep of {step:g} s bears in qpos0, keyframes and "
            "sampled poses"
        )
    return text
