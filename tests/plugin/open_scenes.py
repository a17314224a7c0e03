"""Mechanisms with cables on open paths."""

from __future__ import annotations

import math

import mujoco


def instance(name: str = "rope", **keys: object) -> str:
    """Return the MJCF of a plugin instance; `route` defaults to its name."""
    given = {"route": name, "path": "open", "segments": 12, "pretension": 10} | keys
    lines = "".join(f'<config key="{k}" value="{v}"/>' for k, v in given.items())
    return (
        '<extension><plugin plugin="cc_mujoco.cable">'
        f'<instance name="{name}">{lines}</instance></plugin></extension>'
    )


def end(kind: str, target: str, gear: float, cable: str = "rope") -> str:
    """Return the MJCF of an end of the cable."""
    return (
        f'<plugin {kind}="{target}" gear="{gear}" plugin="cc_mujoco.cable" '
        f'instance="{cable}"/>'
    )


TIED = end("tendon", "rope", -1) + end("tendon", "rope", 1)
"""Both ends of the rope at sites of its tendon."""


def scene(
    world: str,
    tendon: str,
    ends: str,
    cable: str,
    option: str = 'timestep="0.0002"',
    more: str = "",
) -> str:
    """Return a model without contacts."""
    return (
        f"<mujoco><option {option}>"
        '<flag contact="disable" energy="enable"/></option>'
        f"{cable}<worldbody>{world}</worldbody>"
        f'<tendon><spatial name="rope">{tendon}</spatial></tendon>'
        f"<actuator>{more}{ends}</actuator></mujoco>"
    )


def atwood(
    friction: float,
    masses: tuple[float, float],
    inertia: float,
    radius: float = 0.1,
    timestep: float = 1e-4,
    **keys: object,
) -> mujoco.MjModel:
    """Two masses on a rope over a pulley that turns."""
    keys = {
        "conduit": f"{1.0 + math.pi * radius}:inf",
        "axial_stiffness": 20000,
        "pretension": 4.905 * sum(masses),
        "segments": 8,
    } | keys
    hang = "".join(
        f'<body name="{name}" pos="{side * radius} 0 -0.5">'
        f'<joint name="{name}" type="slide" axis="0 0 1"/>'
        f'<geom size="0.02" mass="{mass}"/><site name="{name}"/></body>'
        for name, side, mass in zip("ab", (-1, 1), masses, strict=True)
    )
    world = (
        f'<body><joint name="wheel" axis="0 1 0" armature="{inertia}"/>'
        f'<geom name="rim" type="cylinder" size="{radius} 0.02" zaxis="0 1 0" '
        f'mass="1e-9"/></body><site name="top" pos="0 0 0.3"/>{hang}'
    )
    rope = '<site site="a"/><geom geom="rim" sidesite="top"/><site site="b"/>'
    text = scene(
        world, rope, TIED, instance(friction=friction, **keys),
        f'timestep="{timestep}"',
    )  # fmt: skip
    return mujoco.MjModel.from_xml_string(text)


POSTS = (
    ("one", (0.0, 0.0, 0.0), (0.0, 0.0, 0.2)),
    ("two", (0.25, 0.0, -0.2), (0.25, 0.0, -0.4)),
    ("three", (0.5, 0.0, 0.0), (0.5, 0.0, 0.2)),
)
"""Name, centre and side of the fixed posts of `winch`."""


def winch(friction: float, load: float, **keys: object) -> mujoco.MjModel:
    """Return a winch that lifts a load over three fixed posts."""
    world = (
        '<body pos="-0.3 0 -0.3"><joint name="drum" axis="0 1 0" armature="0.02" '
        'damping="2"/><geom size="0.02" mass="0.1"/></body>'
        '<site name="out" pos="-0.25 0 -0.3"/>'
    )
    rope = '<site site="out"/>'
    for name, centre, side in POSTS:
        world += (
            f'<geom name="{name}" type="cylinder" size="0.05 0.02" zaxis="0 1 0" '
            f'pos="{" ".join(map(str, centre))}"/>'
            f'<site name="by_{name}" pos="{" ".join(map(str, side))}"/>'
            f'<site name="past_{name}" pos="{centre[0] + 0.125} 0 -0.1"/>'
        )
        rope += f'<geom geom="{name}" sidesite="by_{name}"/>'
        if name != "three":
            rope += f'<site site="past_{name}"/>'
    world += (
        '<body pos="0.55 0 -0.5"><joint name="load" type="slide" axis="0 0 1" '
        f'damping="20"/><geom size="0.02" mass="{load}"/><site name="hook"/></body>'
    )
    rope += '<site site="hook"/>'
    ends = end("joint", "drum", -0.05) + end("tendon", "rope", 1)
    more = '<motor name="motor" joint="drum"/>'
    probe = scene(world, rope, "", "", more=more)
    length = mujoco.MjModel.from_xml_string(probe).tendon_length0[0]
    given = {
        "conduit": f"{length}:inf",
        "axial_stiffness": 20000,
        "pretension": load * 9.81,
    }
    cable = instance(friction=friction, **(given | keys))
    return mujoco.MjModel.from_xml_string(scene(world, rope, ends, cable, more=more))


def tackle(friction: float, load: float) -> mujoco.MjModel:
    """Return a winch that lifts a load, over a fixed sheave and under a moving one."""
    world = (
        '<body pos="0.3 0 -0.4"><joint name="drum" axis="0 1 0" armature="0.02" '
        'damping="2"/><geom size="0.02" mass="0.1"/></body>'
        '<site name="out" pos="0.15 0 -0.4"/><site name="anchor" pos="-0.05 0 0.2"/>'
        '<geom name="high" type="cylinder" size="0.05 0.02" zaxis="0 1 0" '
        'pos="0.1 0 0.2"/><site name="above" pos="0.1 0 0.4"/>'
        '<site name="between" pos="0.05 0 0"/>'
        '<body pos="0 0 -0.5"><joint name="load" type="slide" axis="0 0 1" '
        'damping="20"/><geom name="low" type="cylinder" size="0.05 0.02" '
        f'zaxis="0 1 0" mass="{load}"/><site name="below" pos="0 0 -0.2"/></body>'
    )
    rope = (
        '<site site="out"/><geom geom="high" sidesite="above"/><site site="between"/>'
        '<geom geom="low" sidesite="below"/><site site="anchor"/>'
    )
    ends = end("joint", "drum", -0.05) + end("tendon", "rope", 1)
    more = '<motor name="motor" joint="drum"/>'
    probe = scene(world, rope, "", "", more=more)
    length = mujoco.MjModel.from_xml_string(probe).tendon_length0[0]
    cable = instance(
        friction=friction,
        conduit=f"{length}:inf",
        axial_stiffness=20000,
        pretension=0.5 * load * 9.81,
    )
    return mujoco.MjModel.from_xml_string(scene(world, rope, ends, cable, more=more))


def belt(friction: float, pretension: float, inertia: float) -> mujoco.MjModel:
    """Return a belt from a driven pulley to a blocked one; its seam may move."""
    radius = 0.05
    world = (
        f'<body><joint name="driver" axis="0 1 0" armature="{inertia}"/>'
        f'<geom name="one" type="cylinder" size="{radius} 0.02" zaxis="0 1 0" '
        'mass="1e-9"/></body><site name="left" pos="-0.3 0 0"/>'
        f'<geom name="two" type="cylinder" size="{radius} 0.02" zaxis="0 1 0" '
        'pos="0.4 0 0"/><site name="right" pos="0.7 0 0"/>'
        f'<site name="low" pos="0.2 0 {-radius}"/><body pos="0.2 0 {radius}">'
        '<joint name="seam" type="slide" axis="1 0 0" damping="5"/>'
        '<geom size="0.01" mass="0.05"/><site name="seam"/></body>'
    )
    rope = (
        '<site site="seam"/><geom geom="one" sidesite="left"/><site site="low"/>'
        '<geom geom="two" sidesite="right"/><site site="seam"/>'
    )
    cable = instance(
        friction=friction,
        conduit=f"{0.8 + 2 * math.pi * radius}:inf",
        axial_stiffness=20000,
        pretension=pretension,
        segments=9,
    )
    more = '<motor name="motor" joint="driver"/>'
    return mujoco.MjModel.from_xml_string(
        scene(world, rope, TIED, cable, 'timestep="0.0001"', more)
    )
