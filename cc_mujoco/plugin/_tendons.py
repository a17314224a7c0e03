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
>>> cc_mujoco.add_friction(spec, "extensor", motor=("winch", 0.01), friction=0.1)
>>> model = spec.compile()
>>> [model.actuator(i).name for i in range(2)]
['extensor_proximal', 'extensor_distal']
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from numbers import Real
from typing import Any

import mujoco
import numpy as np

from cc_mujoco.cable._parameters import KEYS, MAX_SEGMENTS, Cable, Section
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin._mjcf import to_mjcf
from cc_mujoco.plugin._open_path import ARC_SEGMENTS
from cc_mujoco.plugin._readings import route_wrap
from cc_mujoco.plugin._spec import compile_spec, require_spec
from cc_mujoco.plugin._tendon_report import tendon_report

_ALLOWED_KEYS = [
    key for key in KEYS if key not in ("route", "bend", "path", "mouth", "guides")
]
_HINGE = mujoco.mjtJoint.mjJNT_HINGE
_BENDING_WRAPS = [
    mujoco.mjtWrap.mjWRAP_SITE,
    mujoco.mjtWrap.mjWRAP_SPHERE,
    mujoco.mjtWrap.mjWRAP_CYLINDER,
]


def add_friction(
    spec: mujoco.MjSpec,
    tendon: str,
    *,
    motor: tuple[Any, float] | None = None,
    joint: tuple[Any, float] | None = None,
    friction: float | None = None,
    segments: int | None = None,
    guides: Mapping[str, float | str] | None = None,
    report: bool = False,
    **parameters: Any,
) -> None:
    """Make a spatial tendon a cable with friction wherever it bends.

    The tendon becomes a cable on an open path, of its own name: its first site is the
    proximal end, its last one the distal end. Each of its pieces then pulls with its
    own tension, and MuJoCo's moment arms stay what they are.

    Args:
        spec: the specification to change.
        tendon: name of a spatial tendon without `<pulley>`; its sites run from the
            motor to the load.
        motor: joint that winds the tendon up as it turns in the positive sense, and
            the radius of its drum [m]; by default the tendon is tied to its first site.
        joint: joint that winds up the other end, and the radius of its drum [m]; by
            default the tendon is tied to its last site.
        friction: coefficient mu of Coulomb friction at every site and geom; must be
            given, since a tendon has none of its own.
        segments: friction elements; by default one for a site and four for a geom.
        guides: by the name of a site or geom, `"roller"` where the tendon runs over a
            roller that takes nothing, or the radius of the guide at a site [m], over
            whose arc there is drag per length; Coulomb friction is the same for any.
        report: print the turns and losses of the tendon, see `tendon_report`.
        parameters: other parameters of the cable, by name, see `Cable`; unless given
            they are those of `Cable()`.

    Raises:
        CableError: there is no such tendon, it has pulleys, something else pulls it as
            a whole (an actuator, a `stiffness`, `damping`, `frictionloss`, `range`,
            `armature` or equality of its own), a drum is on a joint that is no hinge, a
            parameter cannot be used, or the model does not compile. The specification
            is as before.

    Warns:
        CableWarning: friction takes much of the tension as the tendon lies in `qpos0`,
            because its sites zig-zag.
    """
    require_spec(spec)
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
    if not isinstance(tendon, str):
        raise CableError(
            f"tendon must be the name of a spatial tendon, not {tendon!r}."
        )
    found = spec.tendon(tendon)
    if found is None:
        names = [t.name for t in spec.tendons]
        raise CableError.unknown("tendon", tendon, names)
    for actuator in spec.actuators:
        if actuator.plugin.name == tendon:
            raise CableError(f"tendon {tendon!r} is a cable already.")
    for key in parameters:
        if key not in _ALLOWED_KEYS:
            raise CableError.unknown("cable parameter", key, _ALLOWED_KEYS)
    model = compile_spec(spec.copy())
    if tendon not in (model.tendon(i).name for i in range(model.ntendon)):
        # A copy omits dangling references; compiling the original reports them.
        compile_spec(spec)
    index = model.tendon(tendon).id
    start = model.tendon_adr[index]
    kinds = model.wrap_type[start : start + model.tendon_num[index]]
    if not np.all(np.isin(kinds, _BENDING_WRAPS)):
        raise CableError(
            f"tendon {tendon!r} is fixed or has a <pulley>; it must be a spatial one "
            "of sites and geoms, led around the sheaves of a block itself"
        )
    if segments is None:
        geoms = int(np.sum(kinds != mujoco.mjtWrap.mjWRAP_SITE))
        segments = len(kinds) - 2 + (ARC_SEGMENTS - 1) * geoms
        segments = min(max(segments, 1), MAX_SEGMENTS)
    length = float(model.tendon_length0[index])
    given: dict[str, Any] = {
        "friction": friction,
        "segments": segments,
        "conduit": (Section(length, math.inf),),
        "route": tendon,
        "path": "open",
        "guides": tuple((guides or {}).items()),
    }

    def write(into: mujoco.MjSpec) -> None:
        own = into.tendon(tendon)
        # Cable wound up moves to proximal at the motor's end, to distal at the other.
        proximal = (own, -1.0) if motor is None else (motor[0], -motor[1])
        distal = (own, 1.0) if joint is None else joint
        to_mjcf(into, tendon, Cable(**(given | parameters)), proximal, distal)

    tried = spec.copy()
    write(tried)
    model = compile_spec(tried)
    data = mujoco.MjData(model)
    # Only the path is needed: a step would warn of a model that is not finished yet.
    mujoco.mj_fwdPosition(model, data)
    # Where there is no MuJoCo the cable bends by as much, evenly.
    wrap = route_wrap(model, data, tendon)
    if wrap > 0.0:
        given["conduit"] = (Section(length, length / wrap),)
    write(spec)
    turns = tendon_report(model, tendon)
    (summary,) = turns.tendons
    if report:
        print(turns)
    elif summary.warning and summary.zigzags:
        warnings.warn(summary.warning, CableWarning, stacklevel=2)
