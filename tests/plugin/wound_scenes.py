"""Cables that drums wind, for closed motions; see `mechanisms.py`."""

from __future__ import annotations

from typing import Any

import mujoco

import cc_mujoco
from plugin.mechanisms import Mechanism
from plugin.open_scenes import end

_PRETENSION = 100.0
_BODY = '<geom size="0.01" mass="1"/>'
_DRUM = f'<body pos="0 0 1"><joint name="{{}}" axis="0 1 0"/>{_BODY}</body>'
_WORLD = (
    '<option timestep="1e-3" gravity="0 0 0"/><worldbody>'
    + _DRUM.format("w")
    + _DRUM.format("v")
    + '<site name="motor" pos="-0.4 0 -0.02"/><site name="a" pos="0 0 -0.02"/>'
    '<body pos="0.2 0 0"><joint name="bend" type="slide" axis="0 0 1"/>'
    '<geom name="post" type="cylinder" size="0.04 0.1" zaxis="0 1 0" mass="1"/>'
    '<site name="over" pos="0 0 0.1"/></body>'
    '<body pos="0.4 0 -0.02"><joint name="load" type="slide" axis="{}"/>'
    f'{_BODY}<site name="b"/><site name="c" pos="0 0 0.4"/></body></worldbody>'
)
_PATH = '<site site="a"/><geom geom="post" sidesite="over"/><site site="b"/>'
KINDS = ("winch", "two", "muscle", "mouth", "pull-pull")
"""Kinds of `wound` that drums wind over a post."""


def wound(kind: str, strain: float, friction: float = 0.3, **keys: Any) -> Mechanism:
    """Return a rope over a post that moves, from a drum to a load that slides.

    Args:
        kind: `winch`: on a drum; `two`: the load is one too; `muscle`: of a tendon with
            a muscle, on its own winch; `mouth`: through a conduit on the way;
            `pull-pull`: with another one, on the other side of the drum; `band`:
            without a drum; or `straight`: without the post.
        strain: at its pretension.
        friction: coefficient.
        keys: others of the cable.
    """
    assert kind in (*KINDS, "band", "straight")
    given = {
        "friction": friction,
        "axial_stiffness": _PRETENSION / strain,
        "pretension": _PRETENSION,
        "ends": "explicit",
    } | keys
    world = _WORLD.format("1 0 0" if kind == "straight" else "1 0 0.3")
    start = '<site site="motor"/>' if kind == "mouth" else ""
    path = '<site site="a"/><site site="b"/>' if kind == "straight" else _PATH
    tendons = f'<spatial name="rope">{start}{path}</spatial>'
    if kind == "pull-pull":
        tendons += '<spatial name="back"><site site="c"/><site site="a"/></spatial>'
    if kind not in ("mouth", "pull-pull"):
        drive = (
            '<muscle tendon="rope" lengthrange="0.1 2"/>' if kind == "muscle" else ""
        )
        spec = mujoco.MjSpec.from_string(
            f"<mujoco>{world}<tendon>{tendons}</tendon><actuator>{drive}</actuator>"
            "</mujoco>"
        )
        ends: dict[str, Any] = {"motor": ("w", 0.02)}
        if kind in ("muscle", "band"):
            ends = {"winch": (0.02, 1e-2)} if kind == "muscle" else {}
        if kind == "two":
            ends["joint"] = ("v", 0.03)
        cc_mujoco.add_friction(spec, "rope", **ends, **given)
        return Mechanism(spec.compile(), ())
    bare = f"<mujoco>{world}<tendon>{tendons}</tendon></mujoco>"
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
