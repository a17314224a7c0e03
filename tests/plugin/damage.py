"""Random damage to models and data with cables, which no process may die of."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache

import mujoco
import numpy as np

from cc_mujoco import plugin
from cc_mujoco.errors import CableError

_SCENE = """
<mujoco><option timestep="5e-4"><flag contact="disable"/></option>
<extension><plugin plugin="cc_mujoco.cable">{instances}</plugin></extension>
<worldbody><site name="a"/><site name="m" pos="0.2 0 0"/>
<body name="held" mocap="true" pos="0.4 0 0">
<geom name="post" type="cylinder" size="0.05 0.1" euler="90 0 0"/>
<site name="side" pos="0 0 0.2"/></body>
<body name="drum" pos="0 0 1"><joint name="motor" axis="0 1 0" armature="1e-3"/>
<geom size="0.02" mass="0.1"/></body>
<body name="arm" pos="0.6 0 -0.1">
<joint name="hinge" axis="0 1 0" damping="0.02" stiffness="2"/>
<geom size="0.05" mass="0.5" pos="0.1 0 0"/><site name="b" pos="0.2 0 -0.1"/></body>
</worldbody><tendon><spatial name="rope">{path}</spatial>
<spatial name="spare"><site site="a"/><site site="b"/></spatial></tendon>
<actuator>{ends}</actuator></mujoco>"""
_PATH = (
    '<site site="a"/><site site="m"/><geom geom="post" sidesite="side"/>'
    '<site site="b"/>'
)
_OTHER_PATH = (
    '<site site="a"/><geom geom="post" sidesite="side"/><site site="m"/>'
    '<site site="b"/>'
)
_JOINTS = ('joint="motor" gear="-0.02"', 'joint="hinge" gear="-0.05"')
_TIED = ('tendon="rope" gear="-1"', 'tendon="rope" gear="1"')
_COMMON = {
    "segments": "8",
    "axial_stiffness": "4000",
    "pretension": "10",
    "friction": "0.15",
}
_ROUTE = {"route": "rope"}
_KINDS: dict[str, tuple[tuple[str, str], dict[str, str]]] = {
    "guided": (_JOINTS, {"conduit": "0.4:0.3 0.4:inf"}),
    "rates": (
        _JOINTS,
        {
            "conduit": "0.4:0.3 0.4:inf",
            "viscous_friction": "20",
            "stribeck_friction": "0.05",
            "critical_slip_distance": "1e-4",
            "bristle_length": "1e-3",
        },
    ),
    "route": (_JOINTS, {"conduit": "0.8:0.3", "bend": "route"} | _ROUTE),
    "open": ((_JOINTS[0], _TIED[1]), {"path": "open"} | _ROUTE),
    "mixed": (
        (_JOINTS[0], _TIED[1]),
        {"conduit": "0.2:0.3", "path": "mixed", "mouth": "m"} | _ROUTE,
    ),
    "band": (_TIED, {"path": "open"} | _ROUTE),
}
KINDS = tuple(_KINDS)
"""Kinds of paths, and a guided cable whose friction depends on the rate."""
PLAIN, SWAPPED, BEHIND, ALONE, REROUTED = range(5)
"""Arrangements: a cable before another one; with its actuators last; as the second
instance; with motors in place of the other cable; with another path of its tendon."""
READERS: tuple[Callable[..., object], ...] = (
    plugin.read,
    plugin.segment_wrap,
    plugin.stored_energy,
    plugin.route,
    plugin.route_wrap,
)
"""Readers of a cable, which refuse data of another model."""
_SPECIAL = np.array(
    "nan inf -inf 1e300 -1e300 -5 5 1e14 -1e14 5e-324 -0 0 1e19 -9.3e18".split(), float
)


@cache
def scene(kind: str, arrangement: int = PLAIN) -> mujoco.MjModel:
    """Return the model of a kind of cable, of the same sizes as every other."""
    return _compile(kind, arrangement)


def path_of(kind: str) -> str:
    """Return the `path` of a kind of cable."""
    return _KINDS[kind][1].get("path", "guided")


def _compile(kind: str, arrangement: int) -> mujoco.MjModel:
    ends, own = _KINDS[kind]
    path = _OTHER_PATH if arrangement == REROUTED else _PATH
    if "conduit" not in own:
        own = own | {"conduit": f"{_path_length(path)}:inf"}
    keys = _COMMON | own
    if arrangement == REROUTED and "mouth" in keys:
        keys |= {"segments": "9"}  # the geom is in the conduit, so less is needed
    cable = _instance("cable", keys)
    other = _instance("other", _COMMON | {"segments": "6", "conduit": "0.5:0.2"})
    pulled = "".join(_end("cable", end) for end in ends)
    beside = "".join(
        _end("other", end)
        for end in ('joint="motor" gear="0.01"', 'joint="hinge" gear="-0.01"')
    )
    if arrangement == ALONE:
        other, beside = "", '<motor joint="motor"/><motor joint="hinge"/>'
    return mujoco.MjModel.from_xml_string(
        _SCENE.format(
            instances=other + cable if arrangement == BEHIND else cable + other,
            path=path,
            ends=beside + pulled if arrangement == SWAPPED else pulled + beside,
        )
    )


@cache
def _path_length(path: str) -> float:
    bare = _SCENE.format(instances="", path=path, ends="")
    return float(mujoco.MjModel.from_xml_string(bare).tendon_length0[0])


def _instance(name: str, keys: dict[str, str]) -> str:
    lines = "".join(f'<config key="{k}" value="{v}"/>' for k, v in keys.items())
    return f'<instance name="{name}">{lines}</instance>'


def _end(cable: str, target: str) -> str:
    return f'<plugin {target} plugin="cc_mujoco.cable" instance="{cable}"/>'


def _use(m: mujoco.MjModel, d: mujoco.MjData, random: np.random.Generator) -> None:
    """Do with a simulation what users do, in a random order."""
    d.qvel[:] = random.normal(size=m.nv)
    for _ in range(random.integers(1, 4)):
        what = random.integers(8)
        if what < 4:
            mujoco.mj_step(m, d, int(random.integers(1, 4)))
        elif what == 4:
            mujoco.mj_forward(m, d)
        elif what == 5:
            mujoco.mj_inverse(m, d)
        elif what == 6:
            with suppress(CableError):
                plugin.settle(m, d)
        else:
            for name in plugin.cables(m):
                for read in READERS:
                    with suppress(CableError):
                        read(m, d, name)
            with suppress(CableError):
                plugin.step_limits(m, d)


def random_state(seed: int) -> None:
    """Step a cable from a random `plugin_state`, time step, pose and mocap pose."""
    random = np.random.default_rng(seed)
    m = scene(random.choice(KINDS))
    d, sites = mujoco.MjData(m), m.site_pos.copy()
    m.opt.integrator = int(random.integers(4))
    m.opt.timestep = random.choice([5e-4, 5e-3])
    mujoco.mj_step(m, d, int(random.integers(3)))
    for _ in range(2):
        drawn = random.normal(size=m.npluginstate) * 10.0 ** random.uniform(-6, 16)
        special = random.random(m.npluginstate) < random.choice([0.0, 0.1, 1.0])
        drawn[special] = random.choice(_SPECIAL, special.sum())
        changed = random.random(m.npluginstate) < random.choice([0.02, 0.3, 1.0])
        d.plugin_state[changed] = drawn[changed]
        if random.random() < 0.1:
            m.opt.timestep = random.choice(_SPECIAL)
        for place in (d.qpos, d.mocap_pos[0], m.site_pos[1]):
            if random.random() < 0.05:
                place[:] = random.choice(_SPECIAL, place.size)
        _use(m, d, random)
    m.opt.timestep, m.site_pos[:] = 5e-4, sites


def edited_text(seed: int) -> None:
    """Step a cable whose `plugin_attr` is edited in place."""
    random = np.random.default_rng(seed)
    m = scene(random.choice(KINDS))
    m.opt.integrator = int(random.integers(4))
    kept, d = m.plugin_attr.copy(), mujoco.MjData(m)
    mujoco.mj_step(m, d)
    for _ in range(2):
        places = random.integers(m.npluginattr, size=random.integers(1, 8))
        how = random.integers(6)
        if how == 0:
            m.plugin_attr[places] = 0
        elif how == 1:
            m.plugin_attr[places] = random.integers(-128, 128, size=places.size)
        elif how == 2:
            m.plugin_attr[m.plugin_attr == 0] = ord("1")
        elif how == 3:
            digits = np.frombuffer(b"0123456789.:e- ", np.int8)
            m.plugin_attr[places] = random.choice(digits, places.size)
        elif how == 4:
            other = scene(random.choice(KINDS)).plugin_attr
            size = min(other.size, kept.size)
            m.plugin_attr[:size] = other[:size]
        else:
            m.plugin_attr[:] = np.roll(m.plugin_attr, random.integers(-4, 4))
        _use(m, d, random)
        try:
            mujoco.MjData(m)
        except (mujoco.FatalError, ValueError):
            pass  # refused
    m.plugin_attr[:] = kept


def other_model(seed: int) -> None:
    """Step data of one model under another, and under their own again."""
    random = np.random.default_rng(seed)
    kinds = random.choice(KINDS, 2)
    arrangements = random.choice(5, 2, p=[0.6, 0.1, 0.1, 0.1, 0.1])
    one = scene(kinds[0], int(arrangements[0]))
    # Often a new model takes the place in memory of the one before.
    make: Callable[[str, int], mujoco.MjModel] = (
        _compile if random.random() < 0.2 else scene
    )
    two = make(kinds[1], int(arrangements[1]))
    for m in (one, two):
        # MuJoCo's reset writes as many states as the model has.
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    two.opt.integrator = int(random.integers(4))
    d = mujoco.MjData(one)
    mujoco.mj_step(one, d, int(random.integers(3)))
    _use(two, d, random)
    if one.npluginstate == two.npluginstate and random.random() < 0.5:
        mujoco.mj_resetData(two, d)
        _use(two, d, random)
    _use(one, d, random)
    for m in (one, two):
        m.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
