"""Cables that drums wind, for closed motions; see `mechanisms.py`."""

from __future__ import annotations

from typing import Any

import mujoco

import cc_mujoco
from plugin.mechanisms import Mechanism
from plugin.open_scenes import end

_PRETENSION = 100.0
_BODY = '<geom size="0.01" mass="1"/>'
_DRUM = f'<body pos="0 0 1"><joint name="{{0}}" axis="0 1 0"/>{_BODY}</body>'
_WORLD = (
    '<option timestep="1e-3" gravity="0 0 0"/><worldbody>'
    + _DRUM.format("w")
    + _DRUM.format("v")
    + '<site name="motor" pos="-0.4 0 -0.02"/><site name="a" pos="0 0 -0.02"/>'
    '<body pos="0.2 0 0"><joint name="bend" type="slide" axis="0 0 1"/>'
    '<geom name="post" type="cylinder" size="0.04 0.1" zaxis="0 1 0" mass="1"/>'
    '<site name="over" pos="0 0 0.1"/></body>'
    '<body pos="0.4 0 -0.02"><joint name="load" type="slide" axis="1 0 0.3"/>'
    f'{_BODY}<site name="b"/><site name="c" pos="0 0 0.4"/></body></worldbody>'
)
_PATH = '<site site="a"/><geom geom="post" sidesite="over"/><site site="b"/>'
_KINDS = ("winch", "two", "muscle", "mouth", "pull-pull")


def wound(kind: str, strain: float, friction: float = 0.3, **keys: Any) -> Mechanism:
    """Return a rope over a post that moves, from a drum to a load that slides.

    Args:
        kind: `winch`: on a drum; `two`: the load is one too; `muscle`: of a tendon with
            a muscle, on its own winch; `mouth`: through a conduit on the way; or
            `pull-pull`: with another one, on the other side of the drum.
        strain: at its pretension.
        friction: coefficient.
        keys: others of the cable.
    """
    assert kind in _KINDS
    given = {
        "friction": friction,
        "axial_stiffness": _PRETENSION / strain,
        "pretension": _PRETENSION,
        "ends": "explicit",
    } | keys
    start = '<site site="motor"/>' if kind == "mouth" else ""
    tendons = f'<spatial name="rope">{start}{_PATH}</spatial>'
    if kind == "pull-pull":
        tendons += '<spatial name="back"><site site="c"/><site site="a"/></spatial>'
    if kind in ("winch", "two", "muscle"):
        drive = (
            '<muscle tendon="rope" lengthrange="0.1 2"/>' if kind == "muscle" else ""
        )
        spec = mujoco.MjSpec.from_string(
            f"<mujoco>{_WORLD}<tendon>{tendons}</tendon><actuator>{drive}</actuator>"
            "</mujoco>"
        )
        ends: dict[str, Any] = {"motor": ("w", 0.02)}
        if kind == "muscle":
            ends = {"winch": (0.02, 1e-2)}
        if kind == "two":
            ends["joint"] = ("v", 0.03)
        cc_mujoco.add_friction(spec, "rope", **ends, **given)
        return Mechanism(spec.compile(), ())
    bare = f"<mujoco>{_WORLD}<tendon>{tendons}</tendon></mujoco>"
    lengths = mujoco.MjModel.from_xml_string(bare).tendon_length0
    instances = actuators = ""
    names = ("rope", "back") if kind == "pull-pull" else ("rope",)
    for name, length, gear in zip(names, lengths, (-0.02, 0.02), strict=False):
        own = given | {"route": name, "path": "open", "conduit": f"{length}:inf"}
        if kind == "mouth":
            own |= {"path": "mixed", "mouth": "a", "conduit": "0.5:0.4", "segments": 9}
        lines = "".join(f'<config key="{k}" value="{v}"/>' for k, v in own.items())
        instances += f'<instance name="{name}">{lines}</instance>'
        actuators += end("joint", "w", gear, name) + end("tendon", name, 1, name)
    return Mechanism(
        mujoco.MjModel.from_xml_string(
            '<mujoco><extension><plugin plugin="cc_mujoco.cable">'
            f"{instances}</plugin></extension>{bare[8:-9]}"
            f"<actuator>{actuators}</actuator></mujoco>"
        ),
        (),
        names,
    )
