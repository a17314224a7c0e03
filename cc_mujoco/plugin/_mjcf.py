"""Cables read from MJCF and written into it.

>>> import mujoco
>>> from cc_mujoco.plugin import from_mjcf, to_mjcf
>>> from cc_mujoco.cable import Cable, Section
>>> spec = mujoco.MjSpec()
>>> for name in ("motor", "wrist"):
...     body = spec.worldbody.add_body(mass=1, inertia=[1, 1, 1])
...     _ = body.add_joint(name=name)
>>> cable = Cable(friction=0.2, conduit=(Section(2.0, 0.28),))
>>> to_mjcf(spec, "flexor", cable, ("motor", -0.02), ("wrist", -0.104))
>>> from_mjcf(spec.compile()) == {"flexor": cable}
True
"""

import math
import re
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.cable._cable import KEYS, PARAMETERS, SPRINGS, Cable
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.plugin._engine import PLUGIN, REQUIRED
from cc_mujoco.plugin._registration import plugin_slot
from cc_mujoco.plugin._spec import add_element, cable_ends, plain_errors, read_spec

End = tuple[Any, float]
"""An end of a cable: joint or tendon, or its name; signed pulley radius [m]."""
SPARE_BYTES = 1000
"""Bytes that `make_room` adds to each cable, for a longer configuration later."""


def from_mjcf(source: mujoco.MjSpec | mujoco.MjModel | str | Path) -> dict[str, Cable]:
    """Return the cables of a model, by instance name, in the order of the model.

    Args:
        source: a specification, a compiled model, the path of an MJCF file, or MJCF
            text.

    Raises:
        CableError: a configuration cannot be used.
    """
    if isinstance(source, mujoco.MjModel):
        return {
            name: cable_of(source, index, name)
            for name, index in instances(source).items()
        }
    with plain_errors():
        if isinstance(source, Path) or (isinstance(source, str) and "<" not in source):
            source = read_spec(source)
        elif isinstance(source, str):
            source = mujoco.MjSpec.from_string(source)
    require_kind("source", source, mujoco.MjSpec)
    for actuator in cable_ends(source):
        if not actuator.plugin.name:
            raise CableError(
                f"plugin `{PLUGIN}`: the configuration inside actuator "
                f"{actuator.name!r} has no partner end; declare an `instance` that two "
                "actuators share"
            )
    return {
        plugin.name: _parse(tuple(dict(plugin.config).items()), plugin.name)
        for plugin in source.plugins
        if plugin.plugin_name == PLUGIN
    }


def to_mjcf(
    spec: mujoco.MjSpec,
    name: str,
    cable: Cable,
    proximal: End | None = None,
    distal: End | None = None,
) -> None:
    """Write a cable into a specification: a new instance, or an existing one anew.

    A new instance gets two actuators, `<name>_proximal` and `<name>_distal`.

    Args:
        spec: the specification to change.
        name: name of the plugin instance.
        cable: its new configuration.
        proximal: joint or tendon of the motor's end, and the signed pulley
            radius [m]; an existing instance keeps its own unless given.
        distal: joint or tendon of the joint's end, and radius, likewise.

    Raises:
        CableError: an end is missing or names no joint or tendon.
    """
    require_kind("spec", spec, mujoco.MjSpec)
    require_kind("cable", cable, Cable)
    found = [p for p in spec.plugins if p.plugin_name == PLUGIN and p.name == name]
    used = [a for a in spec.actuators if found and a.plugin.name == name]
    ends = {"proximal": proximal, "distal": distal}
    targets = {
        end: _target(spec, name, *given)
        for end, given in ends.items()
        if given is not None
    }
    if found and len(used) != 2:
        raise CableError(
            f"plugin `{PLUGIN}`, instance '{name}': it is used by {len(used)} "
            "actuators; it must be used by two before it can be written anew"
        )
    if not found:
        for end in ends:
            if end not in targets:
                raise CableError(
                    f"cable {name!r} is new and has no {end} end; give the joint or "
                    "tendon and the signed pulley radius"
                )
        spec.activate_plugin(PLUGIN)
        found = [spec.add_plugin(name=name, plugin_name=PLUGIN, active=True)]
        for end in ends:
            actuator = add_element(spec, "actuator", name=f"{name}_{end}")
            own = actuator.plugin
            own.name, own.plugin_name, own.active = name, PLUGIN, True
            used.append(actuator)
    found[0].config = cable.to_config()
    for actuator, end in zip(used, ends, strict=True):
        if end in targets:
            actuator.trntype, actuator.target, gear = targets[end]
            actuator.gear = [gear, 0, 0, 0, 0, 0]


def instances(model: mujoco.MjModel) -> dict[str, int]:
    """Return the index of each cable's plugin instance in a compiled model, by name."""
    require_kind("model", model, mujoco.MjModel)
    own = plugin_slot()
    return {
        mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_PLUGIN, index): index
        for index in range(model.nplugin)
        if model.plugin[index] == own
    }


def cable_of(model: mujoco.MjModel, instance: int, name: str) -> Cable:
    return _parse(tuple(_config_of(model, instance).items()), name)


def _config_of(model: mujoco.MjModel, instance: int) -> dict[str, str]:
    start = model.plugin_attradr[instance]
    texts = bytes(model.plugin_attr[start:]).split(b"\0", len(KEYS))
    return {
        key: text.decode(errors="replace")
        for key, text in zip(KEYS, texts, strict=False)
        if text
    }


def make_room(spec: mujoco.MjSpec, spare_bytes: int = SPARE_BYTES) -> None:
    """Pad the configurations of cables so that `write_cable` can write longer ones."""
    require_kind("spec", spec, mujoco.MjSpec)
    for instance in spec.plugins:
        config = dict(instance.config)
        if instance.plugin_name == PLUGIN and "conduit" in config:
            # Of the keys, `conduit` is one whose text may end in blanks.
            spare = config["conduit"] + spare_bytes * " "
            instance.config = {**config, "conduit": spare}


def write_cable(model: mujoco.MjModel, name: str, cable: Cable) -> None:
    """Give a cable of a compiled model another configuration, from the next step on.

    Its state stays, as long as the number of segments does.

    Args:
        model: Compiled model, changed in place.
        name: Name of the cable.
        cable: New configuration, as `from_mjcf(model)[name].replace(friction=0.2)`.

    Raises:
        CableError: There is no such cable, or the shortest text of the configuration is
            longer than what the model was compiled with; see `make_room`.
    """
    instance = look_up("cable", name, instances(model))
    require_kind("cable", cable, Cable)
    config = _config_of(model, instance)
    for key, usual in (("segments", Cable.segments), ("path", Cable.path)):
        if type(usual)(config.get(key, usual)) != getattr(cable, key):
            raise CableError(
                f"cable {name!r} cannot change its `{key}` in a compiled model, on "
                "which its state depends; write it into the MjSpec by `to_mjcf`."
            )
    ends = [*model.plugin_attradr[1:].tolist(), model.plugin_attr.size]
    text = _shortest_text(cable).encode()
    start, end = int(model.plugin_attradr[instance]), ends[instance]
    if len(text) > end - start:
        raise CableError(
            f"cable {name!r} cannot be varied: its configuration is longer than the "
            f"model has room for, by {len(text) - end + start} characters; call "
            "cc_mujoco.plugin.make_room(spec) before it is compiled, or put "
            f"{SPARE_BYTES} blanks at the end of its `conduit`."
        )
    attributes = model.plugin_attr[start:end]
    attributes[:] = 0
    attributes[: len(text)] = np.frombuffer(text, attributes.dtype)


def _shortest_text(cable: Cable) -> str:
    """Return the shortest texts of all keys, empty for defaults, each ended by a 0."""
    (defaults, numbers), found = _defaults(), dict.fromkeys(KEYS, "")
    for key, text in cable.to_config().items():
        if key in REQUIRED or text != defaults.get(key):
            if key in numbers:
                text = re.sub(r"\.0(?!\d)", "", text)  # 10.0
                text = re.sub(r"(?<![\d.])0(?=\.\d)", "", text)  # 0.5
            found[key] = text
    return _block(found)


def _block(texts: Mapping[str, str]) -> str:
    return "".join(f"{texts.get(key, '')}\0" for key in KEYS)


@cache
def _defaults() -> tuple[dict[str, str], set[str]]:
    """Return the texts of a cable's defaults, and the keys whose texts have numbers."""
    return Cable().to_config(), {*(p.name for p in PARAMETERS), "conduit"}


@lru_cache(maxsize=256)
def _parse(config: tuple[tuple[str, str], ...], name: str) -> Cable:
    given = dict(config)
    where = f"plugin `{PLUGIN}`, instance '{name}'"
    for key in REQUIRED:
        if key not in given:
            allowed = {p.name: p.allowed for p in PARAMETERS}
            what = allowed.get(key, "sections `length:radius` in metres")
            raise CableError(f"{where}: key `{key}` is missing; it must be {what}")
    for end, (key, hardening) in enumerate(SPRINGS.items()):
        if ":" in given.get(key, "") and hardening not in given:
            from cc_mujoco.plugin._config import spring  # takes long to load

            block = np.frombuffer(_block(given).encode(), np.uint8)
            soft = spring(block.ctypes.data, end)
            if math.isfinite(soft.compliance):  # else the text is refused
                given |= {key: repr(soft.compliance), hardening: repr(soft.hardening)}
    return Cable.from_config(given, where)


def _target(spec: mujoco.MjSpec, name: str, target: Any, gear: float) -> Any:
    if not (np.isfinite(gear) and gear != 0.0):
        raise CableError(
            f"cable {name!r}: gear {gear!r} is no pulley radius; it must be a signed "
            "length in metres, not 0"
        )
    label = target if isinstance(target, str) else target.name
    joint, tendon = spec.joint(label), spec.tendon(label)
    if joint is not None and (tendon is None or target == joint):
        return mujoco.mjtTrn.mjTRN_JOINT, label, gear
    if tendon is not None and (joint is None or target == tendon):
        return mujoco.mjtTrn.mjTRN_TENDON, label, gear
    if joint is None:
        names = [j.name for j in spec.joints] + [t.name for t in spec.tendons]
        raise CableError.unknown("joint or tendon", str(label), names)
    raise CableError(
        f"cable {name!r}: {label!r} is both a joint and a tendon; pass the element "
        "itself instead of its name"
    )
