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

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Collection, Iterable, Mapping
from numbers import Real
from typing import Any, TypeAlias, TypeVar

import mujoco

from cc_mujoco.cable._cable import (
    KEYS,
    MAX_LENGTH,
    MAX_SEGMENTS,
    ROLLER,
    Cable,
    Section,
)
from cc_mujoco.errors import CableError, CableWarning, look_up
from cc_mujoco.plugin._mjcf import to_mjcf
from cc_mujoco.plugin._open_path import ARC_SEGMENTS
from cc_mujoco.plugin._readings import route_wrap
from cc_mujoco.plugin._settle import step_limits
from cc_mujoco.plugin._spec import (
    compile_spec,
    find_element,
    muted_warnings,
    require_spec,
)
from cc_mujoco.plugin._tendons.account import (
    AddedCables,
    describe_band,
    describe_winch,
    order_line,
    range_lines,
    summary_line,
)
from cc_mujoco.plugin._tendons.burden import (
    Burden,
    TendonBranch,
    find_burden,
    held_tension,
    keep_constraints,
    slacken,
    write_branches,
)
from cc_mujoco.plugin._tendons.report import TendonSummary, tendon_report
from cc_mujoco.plugin._tendons.winch import (
    Taken,
    largest_pull,
    plan_winches,
    pose_keyframes,
    sample_poses,
    write_winches,
)

_ALLOWED_KEYS = [
    key for key in KEYS if key not in ("route", "bend", "path", "mouth", "guides")
]
_HINGE = mujoco.mjtJoint.mjJNT_HINGE
MAX_STIFFNESS = 50e3
"""Axial stiffness of a tendon taken over, where its time step bears it [N]."""
_STEP_MARGIN = 3.0
"""Ratio of the step that the pieces of such a tendon bear to the model's."""
_MAX_STRAIN = 0.2
"""Strain under load up to which such a tendon stays stable and settles.

A piece of it gets stiffer with its strain, and a pull that sets in at once overshoots.
"""
_SOFT = 100.0
"""Axial stiffness at which a tendon stretches by 1 % per newton [N]."""
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
) -> AddedCables:
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
        guides: by the name of a site or geom, `"roller"` where the tendon runs over a
            roller that takes nothing, or the radius of the guide at a site [m], over
            whose arc there is drag per length; Coulomb friction is the same for any.
        report: print the turns and losses of the tendons, see `tendon_report`.
        parameters: other parameters of the cable, by name, see `Cable`; unless given
            they are those of `Cable()`. A tendon with a winch has by default the
            `pretension` that its `frictionloss` holds in `qpos0`, or none, and the
            `axial_stiffness` that its time step bears, at most `MAX_STIFFNESS`.

    Returns:
        What became of all that the tendon had; its text is a line for each. Of several
        tendons the text is a line for each tendon, and `parts` has their accounts.

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
    require_spec(spec)
    for key in parameters:
        if key not in _ALLOWED_KEYS:
            raise CableError.unknown("cable parameter", key, _ALLOWED_KEYS)
    several = not isinstance(tendon, str) and isinstance(tendon, Iterable)
    start, named = spec.copy(), dict[Any, str]()
    if len(start.tendons) != len(spec.tendons):
        # A copy omits dangling references; compiling the original reports them.
        compile_spec(spec)
    for which in tendon if several else (tendon,):  # type: ignore[union-attr]
        name = _name_of(start, which)
        if name not in named.values():
            named[which] = name
    if not named:
        raise CableError("add_friction needs a tendon, by its name or its index.")
    ends = {"motor": motor, "joint": joint, "winch": winch}
    cable = {"friction": friction, "segments": segments, **parameters}
    requests = []
    for which, name in named.items():
        own = {key: _value_of(key, x, which, named) for key, x in ends.items()}
        _require_ends(start, **own)
        values = {
            key: _value_of(key, value, which, named) for key, value in cable.items()
        }
        if values["friction"] is None:
            raise CableError(
                "add_friction needs friction=, the coefficient of friction wherever "
                "the tendon bends, e.g. friction=0.1."
            )
        values = {key: value for key, value in values.items() if value is not None}
        requests.append(_Request(name, **own, values=values))
    with muted_warnings():
        original = _compile_with(start, list(named.values()))
        plan = _plan(start, original, requests, {} if guides is None else guides)
        for which, name in named.items():
            if isinstance(which, int):
                spec.tendons[which].name = name
        _write(spec, original, plan)
        turns = tendon_report(plan.model, [end.branch.name for end, _ in plan.laid])
    concerns = plan.concerns
    if report:
        print(turns)
    else:
        concerns += [s.warning for s in turns.tendons if s.warning and s.zigzags]
    for concern in concerns:
        warnings.warn(concern, CableWarning, stacklevel=2)
    steps = {s.name: _step_lines(s) for s in turns.tendons}
    parts = tuple(
        dataclasses.replace(
            part, lines=sum((steps[cable] for cable in part.cables), part.lines)
        )
        for part in plan.parts
    )
    if not several:
        return parts[0]
    pairs = zip(plan.burdens, parts, strict=True)
    return AddedCables(
        tuple(cable for part in parts for cable in part.cables),
        "",
        tuple(summary_line(original, burden, part) for burden, part in pairs),
        parts,
    )


def _step_lines(summary: TendonSummary) -> tuple[str, ...]:
    """Return a line where pieces become too short for the time step in motion."""
    if summary.step_limit > summary.timestep:
        return ()
    return (
        f"timestep: in the worst pose over the ranges of its joints pieces of "
        f"{summary.name!r} become so short that {summary.axial_stiffness:g} N is "
        f"stable only below {1e3 * summary.step_limit:.3g} ms, and it is "
        f"{1e3 * summary.timestep:.3g} ms",
    )


@dataclasses.dataclass(frozen=True)
class _Request:
    """A tendon that becomes a cable, and what was given for it."""

    tendon: str
    motor: tuple[Any, float] | None
    joint: tuple[Any, float] | None
    winch: tuple[float, float] | None
    values: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class _Ends:
    """A branch of a tendon, drums at its ends, if any, and values for its cable."""

    branch: TendonBranch
    motor: tuple[Any, float] | None
    joint: tuple[Any, float] | None
    values: dict[str, Any]


_Laid = list[tuple[_Ends, Cable]]


@dataclasses.dataclass(frozen=True)
class _Plan:
    """All that is to be written into a specification, and what it becomes.

    Attributes:
        burdens: what acts on the tendons, in their order.
        taken: what winches take over of it.
        moved: the specification with winches, but without cables, compiled.
        laid: the cables of all branches.
        model: the specification with winches and cables, compiled.
        parts: the account of each tendon.
        concerns: warnings.
    """

    burdens: list[Burden]
    taken: Taken
    moved: mujoco.MjModel
    laid: _Laid
    model: mujoco.MjModel
    parts: tuple[AddedCables, ...]
    concerns: list[str]


def _name_of(spec: mujoco.MjSpec, which: Any) -> str:
    """Return the name of a tendon given by its name or index; give it one without."""
    found = find_element("tendon", which, spec.tendons)
    if not found.name:
        name, names = f"tendon_{which}", {tendon.name for tendon in spec.tendons}
        while name in names:
            name += "_"
        found.name = name
    return str(found.name)


def _value_of(key: str, value: Any, which: Any, named: dict[Any, str]) -> Any:
    """Return the value of an argument for a tendon, None where a dict omits it."""
    if not isinstance(value, Mapping):
        return value
    for other in value:
        if other not in named and other not in named.values():
            raise CableError.unknown(f"tendon in {key}=", other, named.values())
    return value.get(which, value.get(named[which]))


def _compile_with(spec: mujoco.MjSpec, tendons: list[str]) -> mujoco.MjModel:
    """Compile a copy of a specification; refuse a fixed one of some tendons."""
    model = compile_spec(spec.copy())
    for tendon in tendons:
        first = model.tendon_adr[model.tendon(tendon).id]
        if model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT:
            raise CableError(
                f"tendon {tendon!r} is fixed: it has no path that could bend; friction "
                "is for a spatial tendon of sites and geoms."
            )
    return model


def _plan(
    start: mujoco.MjSpec,
    original: mujoco.MjModel,
    requests: list[_Request],
    guides: Any,
) -> _Plan:
    """Plan the winches and cables of tendons."""
    burdens = [find_burden(start, original, request.tendon) for request in requests]
    at_guides, tried = _checked_guides(guides, burdens), start.copy()
    lines: list[list[str]] = []
    loaded: dict[Burden, tuple[float, float] | None] = {}
    for burden, request in zip(burdens, requests, strict=True):
        plain = burden.is_none or burden.is_band
        if not burden.is_none:
            _refuse_drums(burden, request.motor, request.joint)
        if plain and request.winch is not None:
            raise CableError(
                "winch= is the drum of the actuators of a tendon, and "
                f"{burden.tendon!r} has none; give motor=, the joint of a drum and its "
                "radius, instead."
            )
        if not plain:
            loaded[burden] = request.winch
            write_branches(tried, burden)
        elif burden.is_band:
            slacken(tried, burden.tendon)
    taken, moved = [], original
    if loaded:
        taken = plan_winches(tried, original, loaded)
        moved = _write_taken(tried, original, taken)
    winches = {burden.tendon: winch for burden, winch in taken}
    ends, held = [], {}
    for burden, request in zip(burdens, requests, strict=True):
        values = {"path": "open", "guides": at_guides, **request.values}
        own: list[str] = []
        winch = winches.get(burden.tendon)
        if winch is None:
            if burden.is_band:
                own = _stretch_as(burden, values, request.values)
            ends.append(_Ends(burden.branches[0], request.motor, request.joint, values))
        else:
            # Without it what friction holds would fall into the cable, and shake it.
            held[burden] = float(f"{held_tension(original, burden):.3g}")
            values = {
                "pretension": held[burden], "axial_stiffness": MAX_STIFFNESS, **values
            }  # fmt: skip
            own = describe_winch(original, tried, burden, winch)
            if held[burden] > 0.0 and values["pretension"] == held[burden]:
                own.append(
                    f"pretension {held[burden]:g} N: what the dry friction holds in "
                    "qpos0"
                )
            for branch, name in zip(burden.branches, winch.names, strict=True):
                ends.append(_Ends(branch, (name, -winch.lever), None, values))
        lines.append(own)
    laid, model = _lay(tried, moved, ends)
    bearable = _bearable_stiffness(model, laid) if taken else {}
    concerns = [x for burden in burdens for x in range_lines(burden, original)]
    for burden, request, own in zip(burdens, requests, lines, strict=True):
        if burden.tendon not in winches:
            continue
        names = [branch.name for branch in burden.branches]
        most = min(bearable[name] for name in names)
        if "axial_stiffness" not in request.values:
            stiffness = min(most, MAX_STIFFNESS)
            pull = largest_pull(original, burden)
            _refuse_soft(burden, stiffness, pull, original.opt.timestep)
            if stiffness < _SOFT:
                concerns.append(_soft_warning(burden, stiffness))
            for i, (end, cable) in enumerate(laid):
                if end.branch.name in names:
                    laid[i] = end, cable.replace(axial_stiffness=stiffness)
        cables = [cable for end, cable in laid if end.branch.name in names]
        own.append(_stretch_line(cables, most, original.opt.timestep))
    _write_cables(tried, laid)
    model = compile_spec(tried)
    parts = []
    for burden, own in zip(burdens, lines, strict=True):
        names = [branch.name for branch in burden.branches]
        own.append(order_line(model, names, original.nu))
        cables = [cable for end, cable in laid if end.branch.name in names]
        winch_name = burden.winch if burden.tendon in winches else ""
        first = _first_line(burden.tendon, cables)
        parts.append(AddedCables(tuple(names), winch_name, (first, *own)))
    return _Plan(burdens, taken, moved, laid, model, tuple(parts), concerns)


def _write(spec: mujoco.MjSpec, original: mujoco.MjModel, plan: _Plan) -> None:
    if spec.keys:
        compile_spec(spec)  # from now on its keyframes follow what is added
    for burden in plan.burdens:
        if burden.is_band:
            slacken(spec, burden.tendon)
    for burden, _ in plan.taken:
        write_branches(spec, burden)
    if plan.taken:
        _write_taken(spec, original, plan.taken, plan.moved)
    _write_cables(spec, plan.laid)


def _write_taken(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    taken: Taken,
    model: mujoco.MjModel | None = None,
) -> mujoco.MjModel:
    """Write winches with all that they take over; return that compiled, as `model`."""
    write_winches(spec, original, taken)
    model = compile_spec(spec.copy()) if model is None else model
    keep_constraints(spec, model, original, [burden for burden, _ in taken])
    pose_keyframes(spec, original, taken)
    return model


def _require_ends(spec: mujoco.MjSpec, motor: Any, joint: Any, winch: Any) -> None:
    """Refuse ends that cannot be used."""
    for name, end in (("motor", motor), ("joint", joint)):
        paired = isinstance(end, tuple) and len(end) == 2
        if end is not None and not (paired and isinstance(end[1], Real)):
            raise CableError(
                f"{name} must be a joint and the radius of its drum in metres, e.g. "
                f"('winch', 0.02), not {end!r}."
            )
        drum = spec.joint(end[0]) if end and isinstance(end[0], str) else end and end[0]
        if isinstance(drum, mujoco.MjsJoint) and drum.type != _HINGE:
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


def _refuse_drums(burden: Burden, motor: Any, joint: Any) -> None:
    """Refuse drums for a tendon whose length they would change."""
    for name, end in (("motor", motor), ("joint", joint)):
        if end is not None:
            what = "actuators" if burden.actuators else "features of its own"
            raise CableError(
                f"tendon {burden.tendon!r} has {what}, which a drum at its end would "
                f"change; leave {name}= out, so that they pull at its first site, or "
                "give winch=, the radius and inertia of a drum of their own."
            )


def _stretch_as(
    burden: Burden, given: dict[str, Any], parameters: dict[str, Any]
) -> list[str]:
    """Give a cable the stiffness of a band; return the lines about it."""
    for key in ("axial_stiffness", "pretension"):
        if key in parameters:
            raise CableError(
                f"tendon {burden.tendon!r} has a `stiffness`, which makes its {key}; "
                f"leave {key}= out, or take the stiffness away."
            )
    rate, rest = burden.spring[0], burden.rest[1]
    given["axial_stiffness"] = rate * rest
    given["pretension"] = rate * (burden.length - rest)
    return describe_band(burden, given["axial_stiffness"], given["pretension"])


def _lay(
    spec: mujoco.MjSpec, model: mujoco.MjModel, ends: list[_Ends]
) -> tuple[_Laid, mujoco.MjModel]:
    """Return the cables of branches, as long and as bent as their paths in `qpos0`.

    Also the model with them; `spec` is not changed.
    """
    laid = []
    for end in ends:
        name = end.branch.name
        length = float(model.tendon_length0[model.tendon(name).id])
        sites = sum(how.startswith("site") for _, how in end.branch.path)
        geoms = len(end.branch.path) - sites
        places = len(end.branch.path) - 2 + (ARC_SEGMENTS - 1) * geoms
        own: dict[str, Any] = {
            "segments": min(max(places, 1), MAX_SEGMENTS),
            "conduit": (Section(length, math.inf),),
            "route": name,
        }
        own |= end.values
        inner = {target for target, _ in end.branch.path[1:-1]}
        own["guides"] = tuple(g for g in own["guides"] if g[0] in inner)
        laid.append((end, Cable(**own)))
    tried = spec.copy()
    _write_cables(tried, laid)
    model = compile_spec(tried)
    data = mujoco.MjData(model)
    # Only the path is needed: a step would warn of a model that is not finished yet.
    mujoco.mj_fwdPosition(model, data)
    for i, (end, cable) in enumerate(laid):
        # Where there is no MuJoCo the cable bends by as much, evenly.
        wrap = route_wrap(model, data, end.branch.name)
        if wrap > 0.0:
            bent = (Section(cable.length, cable.length / wrap),)
            laid[i] = end, dataclasses.replace(cable, conduit=bent)
    return laid, model


def _checked_guides(
    given: Any, burdens: Collection[Burden]
) -> tuple[tuple[str, Any], ...]:
    if not isinstance(given, Mapping):
        raise CableError(
            f"guides is {given!r}; it must be a dict such as {{'tip': 0.01, 'palm': "
            f"{ROLLER!r}}}."
        )
    inner = {
        target: how
        for burden in burdens
        for branch in burden.branches
        for target, how in branch.path[1:-1]
    }
    tendons = ", ".join(repr(burden.tendon) for burden in burdens)
    for name, value in given.items():
        kind = f"guide of tendon {tendons} between its ends"
        look_up(kind, name, inner)
        radius = float(value) if isinstance(value, Real) else math.nan
        if value != ROLLER and not inner[name].startswith("site"):
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


def _write_cables(spec: mujoco.MjSpec, laid: _Laid) -> None:
    for end, cable in laid:
        own = spec.tendon(end.branch.name)
        # Cable wound up moves to proximal at the motor's end, to distal at the other.
        proximal, distal = (own, -1.0), (own, 1.0)
        if end.motor is not None:
            proximal = _joint(spec, end.motor[0]), -end.motor[1]
        if end.joint is not None:
            distal = _joint(spec, end.joint[0]), end.joint[1]
        to_mjcf(spec, end.branch.name, cable, proximal, distal)


def _joint(spec: mujoco.MjSpec, joint: Any) -> Any:
    """Return a joint by its name, also where a tendon has the same name."""
    return spec.joint(joint) or joint if isinstance(joint, str) else joint


def _refuse_soft(burden: Burden, stiffness: float, pull: float, step: float) -> None:
    """Refuse a default stiffness [N] that a pull of the actuators [N] overloads."""
    bearable = _MAX_STRAIN * stiffness
    if pull > bearable:
        shorter = 0.9 * step * math.sqrt(bearable / pull)
        raise CableError(
            f"tendon {burden.tendon!r}: at a timestep of {step:g} s what it pulls "
            f"bears at most an axial_stiffness of {stiffness:g} N, which is unstable "
            f"above {bearable:.2g} N, and its actuators pull with {pull:.3g} N; "
            f"shorten the timestep to {shorter:.2g} s, give its joints more "
            "`armature`, or limit its actuators."
        )


def _bearable_stiffness(model: mujoco.MjModel, laid: _Laid) -> dict[str, float]:
    """Return the axial stiffness that the time step bears, by cable [N].

    Their pieces do in the pose `qpos0`, in keyframes and over the ranges of the joints.
    `model` has the cables with the stiffness in `laid`.
    """
    data = mujoco.MjData(model)
    shortest = {end.branch.name: math.inf for end, _ in laid}
    for pose in sample_poses(model):
        data.qpos[:] = pose
        limits = step_limits(model, data)
        for name, least in shortest.items():
            shortest[name] = min(least, limits[name].pieces)
    step = _STEP_MARGIN * model.opt.timestep
    ratios = {name: least / step for name, least in shortest.items()}
    return {
        end.branch.name: float(
            f"{cable.axial_stiffness * ratios[end.branch.name] ** 2:.2g}"
        )
        for end, cable in laid
    }


def _soft_warning(burden: Burden, stiffness: float) -> str:
    """Return the warning of a tendon that a time step keeps soft."""
    return (
        f"tendon {burden.tendon!r} stretches by {100 / stiffness:.2g} % of its length "
        f"per newton, and a pull above {_MAX_STRAIN * stiffness:.2g} N may make it "
        "unstable, because what it pulls bears no stiffer one at this time step; "
        "shorten the timestep, or give its joints more `armature`."
    )


def _stretch_line(cables: list[Cable], bearable: float, step: float) -> str:
    stiffness = cables[0].axial_stiffness
    length = max(cable.length for cable in cables)
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


def _first_line(tendon: str, cables: list[Cable]) -> str:
    count = sum(cable.segments for cable in cables)
    return (
        f"tendon {tendon!r}: "
        f"{'a cable' if len(cables) == 1 else f'{len(cables)} cables'} with friction "
        f"{cables[0].friction:g}, of {count} segment{'s' if count > 1 else ''}"
    )
