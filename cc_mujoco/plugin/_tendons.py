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
from collections.abc import Mapping
from numbers import Real
from typing import Any

import mujoco

from cc_mujoco.cable._parameters import (
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
from cc_mujoco.plugin._spec import compile_spec, require_spec
from cc_mujoco.plugin._takeover.report import (
    TendonTakeover,
    describe_band,
    describe_winch,
    order_line,
)
from cc_mujoco.plugin._takeover.stops import held_tension, keep_constraints
from cc_mujoco.plugin._takeover.survey import (
    Burden,
    TendonBranch,
    find_burden,
    slacken,
    write_branches,
)
from cc_mujoco.plugin._takeover.winch import (
    Winch,
    largest_pull,
    plan_winch,
    pose_keyframes,
    sample_poses,
    write_winch,
)
from cc_mujoco.plugin._tendon_report import tendon_report

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


def add_friction(
    spec: mujoco.MjSpec,
    tendon: str,
    *,
    motor: tuple[Any, float] | None = None,
    joint: tuple[Any, float] | None = None,
    winch: tuple[float, float] | None = None,
    friction: float | None = None,
    segments: int | None = None,
    guides: Mapping[str, float | str] | None = None,
    report: bool = False,
    **parameters: Any,
) -> TendonTakeover:
    """Make a spatial tendon a cable with friction wherever it bends.

    The tendon becomes a cable on an open path, of its own name: its first site is the
    proximal end, its last one the distal end. Each of its pieces then pulls with its
    own tension, and MuJoCo's moment arms stay what they are.

    What acted on the tendon as a whole (actuators, `stiffness`, `damping`,
    `frictionloss`, `range`, `armature`, equalities) then acts at its first site, on a
    winch `<tendon>_winch`: a joint whose position is the length of tendon that it has
    paid out, and a fixed tendon of that length. Commands keep their place and their
    units. A tendon that has nothing but a spring, taut in the pose `qpos0`, becomes an
    elastic band instead. Behind each `<pulley>` a cable begins, `<tendon>_1` and on,
    with its share of the force.

    Args:
        spec: the specification to change.
        tendon: name of a spatial tendon; its sites run from the motor to the load.
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
        report: print the turns and losses of the tendon, see `tendon_report`.
        parameters: other parameters of the cable, by name, see `Cable`; unless given
            they are those of `Cable()`. A tendon with a winch has by default the
            `pretension` that its `frictionloss` holds in `qpos0`, or none, and the
            `axial_stiffness` that its time step bears, at most `MAX_STIFFNESS`.

    Returns:
        What became of all that the tendon had; its text is a line for each.

    Raises:
        CableError: there is no such tendon, it is fixed or belongs to a cable already,
            a drum is on a joint that is no hinge or takes the place of a winch, a
            parameter cannot be used, something that acts on the tendon has no meaning
            at its end, the time step bears only a stiffness by default that is
            unstable under the pull of its actuators, or the model does not compile. The
            specification is as before.

    Warns:
        CableWarning: friction takes much of the tension as the tendon lies in `qpos0`,
            because its sites zig-zag, or the time step bears only a soft tendon.
    """
    require_spec(spec)
    _require_ends(spec, friction, motor, joint, winch)
    if not isinstance(tendon, str):
        raise CableError(
            f"tendon must be the name of a spatial tendon, not {tendon!r}."
        )
    found = spec.tendon(tendon)
    if found is None:
        names = [t.name for t in spec.tendons]
        raise CableError.unknown("tendon", tendon, names)
    for key in parameters:
        if key not in _ALLOWED_KEYS:
            raise CableError.unknown("cable parameter", key, _ALLOWED_KEYS)
    model = compile_spec(spec.copy())
    if tendon not in (model.tendon(i).name for i in range(model.ntendon)):
        # A copy omits dangling references; compiling the original reports them.
        compile_spec(spec)
    index = model.tendon(tendon).id
    if model.wrap_type[model.tendon_adr[index]] == mujoco.mjtWrap.mjWRAP_JOINT:
        raise CableError(
            f"tendon {tendon!r} is fixed: it has no path that could bend; friction is "
            "for a spatial tendon of sites and geoms."
        )
    burden = find_burden(spec, model, tendon)
    given: dict[str, Any] = {
        "friction": friction,
        "path": "open",
        "guides": _checked_guides({} if guides is None else guides, burden),
        **parameters,
    }
    if segments is not None:
        given["segments"] = segments
    if burden.is_none or burden.is_band:
        if winch is not None:
            raise CableError(
                f"winch= is the drum of the actuators of a tendon, and {tendon!r} has "
                "none; give motor=, the joint of a drum and its radius, instead."
            )
        lines: list[str] = []
        tried = spec.copy()
        if burden.is_band:
            _refuse_drums(burden, motor, joint)
            lines = _stretch_as(burden, given, parameters)
            slacken(tried, tendon)
        ends = [_Ends(burden.branches[0], motor, joint)]
        cables = _lay(tried, ends, given)
        _write_cables(tried, cables)
        after = compile_spec(tried)
        lines.append(order_line(after, [tendon], model.nu))
        if burden.is_band:
            slacken(spec, tendon)
        _write_cables(spec, cables)
        _survey(after, [tendon], report)
        return _report(burden, "", cables, lines)
    _refuse_drums(burden, motor, joint)
    compile_spec(spec)  # from now on its keyframes follow what is added
    tried = spec.copy()
    write_branches(tried, burden)
    plan = plan_winch(tried, model, burden, winch)
    _write_taken(tried, model, burden, plan)
    ends = [
        _Ends(branch, (name, -plan.lever), None)
        for branch, name in zip(burden.branches, plan.names, strict=True)
    ]
    # Without it what friction holds would fall into the cable, and shake it.
    held = float(f"{held_tension(model, burden):.3g}")
    given = {"pretension": held, "axial_stiffness": MAX_STIFFNESS, **given}
    cables = _lay(tried, ends, given)
    bearable = _bearable_stiffness(tried, cables)
    if "axial_stiffness" not in parameters:
        given["axial_stiffness"] = stiffness = min(bearable, MAX_STIFFNESS)
        _refuse_soft(burden, stiffness, largest_pull(model, burden), model.opt.timestep)
        if stiffness < _SOFT:
            warnings.warn(
                f"tendon {burden.tendon!r} stretches by {100 / stiffness:.2g} % of its "
                "length per newton, and a pull above "
                f"{_MAX_STRAIN * stiffness:.2g} N may make it unstable, because what "
                "it pulls bears no stiffer one at this time step; shorten the "
                "timestep, or give its joints more `armature`.",
                CableWarning,
                stacklevel=2,
            )
        cables = _lay(tried, ends, given)
    lines = describe_winch(model, tried, burden, plan)
    if held > 0.0 and given["pretension"] == held:
        lines.append(f"pretension {held:g} N: what the dry friction holds in qpos0")
    lines.append(_stretch_line(cables, bearable, model.opt.timestep))
    _write_cables(tried, cables)
    after = compile_spec(tried)
    names = [branch.name for branch in burden.branches]
    lines.append(order_line(after, names, model.nu))
    write_branches(spec, burden)
    _write_taken(spec, model, burden, plan)
    _write_cables(spec, cables)
    _survey(after, names, report)
    return _report(burden, burden.winch, cables, lines)


def _survey(model: mujoco.MjModel, cables: list[str], printed: bool) -> None:
    """Print turns and losses of new cables, or warn of zig-zagging sites."""
    for name in cables:
        turns = tendon_report(model, name)
        (summary,) = turns.tendons
        if printed:
            print(turns)
        elif summary.warning and summary.zigzags:
            warnings.warn(summary.warning, CableWarning, stacklevel=3)


@dataclasses.dataclass(frozen=True)
class _Ends:
    """A branch of a tendon, and drums at its ends, if any."""

    branch: TendonBranch
    motor: tuple[Any, float] | None
    joint: tuple[Any, float] | None


_Laid = list[tuple[_Ends, Cable]]


def _require_ends(
    spec: mujoco.MjSpec,
    friction: float | None,
    motor: Any,
    joint: Any,
    winch: Any,
) -> None:
    """Refuse ends and a friction that cannot be used."""
    if friction is None:
        raise CableError(
            "add_friction needs friction=, the coefficient of friction wherever the "
            "tendon bends, e.g. friction=0.1."
        )
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


def _write_taken(
    spec: mujoco.MjSpec, original: mujoco.MjModel, burden: Burden, plan: Winch
) -> None:
    """Write a winch with all that it takes over."""
    write_winch(spec, original, burden, plan)
    keep_constraints(spec, original, burden)
    pose_keyframes(spec, original, burden, plan)


def _lay(spec: mujoco.MjSpec, ends: list[_Ends], given: dict[str, Any]) -> _Laid:
    """Return the cables of branches, as long and as bent as their paths in `qpos0`."""
    model = compile_spec(spec.copy())
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
        own |= given
        inner = {target for target, _ in end.branch.path[1:-1]}
        own["guides"] = tuple(g for g in given["guides"] if g[0] in inner)
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
    return laid


def _checked_guides(given: Any, burden: Burden) -> tuple[tuple[str, Any], ...]:
    """Return the guides of a tendon, by name.

    Raises:
        CableError: One is not between the ends of a branch, or is neither a roller nor
            a site with a radius.
    """
    if not isinstance(given, Mapping):
        raise CableError(
            f"guides is {given!r}; it must be a dict such as {{'tip': 0.01, 'palm': "
            f"{ROLLER!r}}}."
        )
    inner = {
        target: how for branch in burden.branches for target, how in branch.path[1:-1]
    }
    for name, value in given.items():
        kind = f"guide of tendon {burden.tendon!r} between its ends"
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


def _bearable_stiffness(spec: mujoco.MjSpec, laid: _Laid) -> float:
    """Return the axial stiffness that the time step of new cables bears [N].

    Their pieces do in the pose `qpos0`, in keyframes and over the ranges of the joints.
    """
    tried = spec.copy()
    _write_cables(tried, laid)
    model = compile_spec(tried)
    data = mujoco.MjData(model)
    shortest = math.inf
    for pose in sample_poses(model):
        data.qpos[:] = pose
        limits = step_limits(model, data)
        shortest = min(shortest, *(limits[e.branch.name].pieces for e, _ in laid))
    ratio = shortest / (_STEP_MARGIN * model.opt.timestep)
    stiffness = laid[0][1].axial_stiffness * ratio * ratio
    return float(f"{stiffness:.2g}")


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


def _stretch_line(laid: _Laid, bearable: float, step: float) -> str:
    stiffness = laid[0][1].axial_stiffness
    length = max(cable.length for _, cable in laid)
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
        text += f", as stiff as a timestep of {step:g} s bears"
    return text


def _report(
    burden: Burden, winch: str, laid: _Laid, lines: list[str]
) -> TendonTakeover:
    names = tuple(end.branch.name for end, _ in laid)
    mu = laid[0][1].friction
    count = sum(cable.segments for _, cable in laid)
    first = (
        f"tendon {burden.tendon!r}: "
        f"{'a cable' if len(names) == 1 else f'{len(names)} cables'} with friction "
        f"{mu:g}, of {count} segment{'s' if count > 1 else ''}"
    )
    return TendonTakeover(names, winch, (first, *lines))
