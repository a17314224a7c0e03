"""Changes to a specification: elements without defaults, errors in one sentence."""

import os
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from cc_mujoco.cable._cable import KEYS
from cc_mujoco.errors import CableError, require_utf8
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._registration import warned_digests


def add_element(owner: Any, kind: str, **fields: Any) -> Any:
    element = getattr(owner, f"add_{kind}")()
    for field, value in (pristine_fields(kind) | fields).items():
        setattr(element, field, value)
    return element


@cache
def pristine_fields(kind: str) -> dict[str, Any]:
    spec = mujoco.MjSpec()
    owner = spec if kind in ("actuator", "tendon") else spec.worldbody.add_body()
    element = getattr(owner, f"add_{kind}")()
    found = {}
    own = {  # which no default gives it
        "alt", "classname", "compiler", "frame", "fromto", "id", "info", "name",
        "parent", "path", "plugin", "signature", "userdata",
    }  # fmt: skip
    for field in dir(element):
        if not field.startswith("_") and field not in own:
            value = getattr(element, field)
            if isinstance(value, np.ndarray):
                found[field] = value.copy()
            elif not callable(value):
                found[field] = value
    return found


def cable_ends(spec: mujoco.MjSpec) -> list[Any]:
    """Return the actuators of a specification whose force is the plugin's."""
    # Actuators of a scene that `to_xml` has written name the instance alone.
    names = {x.name for x in spec.plugins if x.name and x.plugin_name == PLUGIN}
    # MuJoCo crashes on `plugin` of an actuator whose instance has been deleted, as in
    # `without_plugin`; the force of such an end is that of a callback.
    callback = mujoco.mjtBias.mjBIAS_USER
    own = [(a, a.plugin) for a in spec.actuators if a.biastype != callback]
    return [a for a, p in own if p.plugin_name == PLUGIN or p.name in names]


def delete_actuator(spec: mujoco.MjSpec, model: mujoco.MjModel, index: int) -> None:
    """Delete an actuator and its values in keyframes.

    MuJoCo 3 would leave its controls and activations to the actuators behind it.
    """
    parts = {
        "ctrl": (model.actuator_ctrladr[index], model.actuator_ctrlnum[index]),
        "act": (model.actuator_actadr[index], model.actuator_actnum[index]),
    }
    kept = []
    for key in spec.keys:
        for field, (first, count) in parts.items():
            values = np.array(getattr(key, field))
            if values.size:
                own = np.arange(first, first + count)
                kept.append((key, field, values.size, np.delete(values, own)))
    spec.delete(spec.actuators[index])
    for key, field, size, values in kept:
        if len(getattr(key, field)) == size:
            setattr(key, field, values)


def find_element(kind: str, which: Any, elements: Sequence[Any]) -> Any:
    """Return the element of a specification with a name or an index.

    Raises:
        CableError: there is none; the message lists the names.
    """
    count = len(elements)
    named = {x.name: x for x in elements if x.name}
    if isinstance(which, str) and which in named:
        return named[which]
    if isinstance(which, int) and which is not True and 0 <= which < count:
        return elements[which]
    if not isinstance(which, str | int):
        raise CableError(
            f"a {kind} must be given by its name or its index, not {which!r}."
        )
    unnamed = count - len(named)
    if not unnamed and isinstance(which, str):
        raise CableError.unknown(kind, which, named)
    there = f"{unnamed} of the {count} {kind}s here have no name"
    if not count:
        there = f"there is no {kind} here"
    elif not named:
        there = f"none of the {count} {kind}s here has a name"
    elif not unnamed:
        there = f"there are {count} {kind}s here"
    by_index = f"; give an index, 0 to {count - 1}" if count else ""
    near = f"; names are {', '.join(map(repr, sorted(named)))}" if named else ""
    raise CableError(f"unknown {kind} {which!r}: {there}{by_index}{near}.")


def require_parameters(given: Iterable[str], left_out: Collection[str]) -> None:
    """Raise a `CableError` for a name that is no cable parameter or in `left_out`."""
    allowed = [key for key in KEYS if key not in left_out]
    for key in given:
        if key not in allowed:
            raise CableError.unknown("cable parameter", key, allowed)


@contextmanager
def plain_errors() -> Iterator[None]:
    """Turn a `ValueError` of MuJoCo into a `CableError` of one sentence."""
    try:
        yield
    except CableError:
        raise
    except (ValueError, RuntimeError) as error:
        raise CableError(error_sentence(error)) from None


@contextmanager
def muted_warnings() -> Iterator[None]:
    """Discard MuJoCo's warnings on trial models; the real one gives them again."""
    handler, said = mujoco.get_mju_user_warning(), warned_digests()
    before = said.raw
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(handler)
        said.raw = before


def read_spec(path: str | os.PathLike[str]) -> mujoco.MjSpec:
    """Return the scene of an MJCF, MJZ or URDF file; raise a `CableError` of others."""
    require_utf8(os.fspath(path))
    try:
        return mujoco.MjSpec.from_file(os.fspath(path))
    except (ValueError, RuntimeError) as error:
        reason = error_sentence(error)
    name, ending = os.path.splitext(os.path.basename(path))
    if ending == ".mjz" and "archive" in reason and os.path.isfile(path):
        reason = (
            f"it must be a zip archive with the model in {name}.xml, "
            f"{name}/{name}.xml or model.xml"
        )
    elif "XML parse error" in reason and ending != ".mjz":
        try:  # MuJoCo gives a number
            ElementTree.parse(path)
        except ElementTree.ParseError as error:
            reason = f"it is no XML: {error}"
    raise CableError(f"scene {path} does not load: {reason}")


def compile_spec(spec: mujoco.MjSpec, scene: object = "") -> mujoco.MjModel:
    """Return the model of a specification, and name its `scene` in errors."""
    keys = len(spec.keys)
    try:
        _find_packages(spec)
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        where = f"scene {scene} does not load: " if scene else ""
        raise CableError(where + error_sentence(error)) from None
    # MuJoCo adds keyframes up to `nkey`, which have no name and cannot be attached.
    for key in [*spec.keys][keys:]:
        spec.delete(key)
    return model


def _find_packages(spec: mujoco.MjSpec) -> None:
    """Find meshes at `package://NAME/...` in a folder NAME above the URDF's folder."""
    folder = Path(spec.modelfiledir).absolute()
    for mesh in spec.meshes:
        scheme, _, rest = mesh.file.partition("package://")
        if rest and not scheme:
            tried = (parent / rest for parent in (folder, *folder.parents))
            found = [str(file) for file in tried if file.is_file()]
            if not found:
                raise CableError(
                    f"there is no {mesh.file}: {folder} and the folders above it "
                    f"contain no {rest}"
                )
            mesh.file = found[0]


def no_cable(scene: object) -> CableError:
    return CableError(
        f"scene {scene} has no cable: give `mujoco.MjSpec.from_file({str(scene)!r})` a "
        "motor and a cable by `cc_mujoco.add_cable`, or its tendons friction by "
        "`add_friction`, `compile()` it, and keep it by its `encode('NEW.mjz')`; or "
        f"write a `plugin` {PLUGIN!r} into the MJCF."
    )


def error_sentence(error: Exception) -> str:
    """Return MuJoCo's message without repetition, or the plugin's sentence in it."""
    lines: list[str] = []
    for line in str(error).split("\n"):
        # MuJoCo gives the message of a plugin twice, and cuts a long one off.
        if not any(known.startswith(line) for known in lines):
            lines.append(line)
    message = " ".join(lines)
    unknown = rf"unrecognized attribute 'plugin:(.*?)' for plugin {PLUGIN}"
    if misspelt := re.search(unknown, message):
        return str(CableError.unknown("key", misspelt[1], KEYS, "a cable"))
    _, found, own = message.partition(f"plugin `{PLUGIN}`, instance ")
    return f"cable {own}" if found else message
