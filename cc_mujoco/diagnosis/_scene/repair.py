"""Scene with the identified effects, as plain MJCF.

    spec = repair_scene(bench, cables, {"backlash": {"backlash": 0.02}})
    write("scene.xml", spec)

The given cables contain the changes by effects; everything else is realised by
`realisation`. The file loads wherever `cc_mujoco` is imported; a comment at its top
names effects and values.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjSpec

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.cable import Cable
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._scene.realisation import (
    REALISATIONS,
    Values,
    add_instruments,
    is_realisable,
    realisations,
    rim_stiffness,
    unrealisable_reason,
)
from cc_mujoco.diagnosis._scene.rollout import rollout
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import step_limits, to_mjcf
from cc_mujoco.plugin._spec import read_spec
from cc_mujoco.report._html import list_words


def repair_scene(
    bench: Bench,
    cables: Sequence[Cable],
    effects: Mapping[str, Values],
    left_out: Mapping[str, Values] | None = None,
) -> MjSpec:
    """Return the scene of a bench with other cables, and with effects.

    Args:
        bench: whose scene it is; its radii become the gears.
        cables: in place of `Bench.cables`, already with what effects change in them.
        effects: parameters by id; those that act in the cables are only named in the
            comment of the file.
        left_out: parameters, by id, of effects that the scene cannot have, for the
            comment of the file.

    Raises:
        CableError: another number of cables, a value that is missing, unknown or not
            finite, or a scene that cannot have the effect.
    """
    if len(cables) != len(bench.cables):
        raise CableError(
            f"the scene {bench.path} has {len(bench.cables)} cables, got {len(cables)}"
        )
    beyond = [name for name in effects if not is_realisable(bench, name)]
    if beyond:
        raise CableError(
            f"the scene {bench.path} cannot have {', '.join(beyond)}: "
            f"{unrealisable_reason(bench, beyond[0])}; take the values from "
            "verdict.json"
        )
    table = realisations()
    in_cables = [name for name in effects if name not in table]
    if in_cables and tuple(cables) == bench.cables:
        raise CableError(
            f"effects {', '.join(in_cables)} act in the cables, but the cables are "
            "those of the scene; give changed ones"
        )
    bench = replace(bench, cables=tuple(cables))
    spec = MjSpec.from_file(str(bench.path))
    for name, cable, sign in zip(bench.names, cables, (-1.0, 1.0), strict=False):
        proximal = (bench.motor, sign * bench.motor_radius)
        distal = (bench.joint, sign * bench.joint_radius)
        to_mjcf(spec, name, cable, proximal, None if bench.lever else distal)
    if bench.lever is not None and not bench.tied:
        (_, end) = [a for a in spec.actuators if a.plugin.name == bench.names[0]]
        end.gear[0] *= bench.joint_radius / bench.drawn_radius
    try:
        # A divisor of the scene's own step, so that a control period stays a multiple.
        own, largest = spec.option.timestep, _largest_step(spec, bench)
        spec.option.timestep = own / max(math.ceil(own / largest), 1)
        if bench.lever is None:
            add_instruments(spec, bench)
        for name, realisation in table.items():
            if name in effects:
                _check(name, realisation.parameters, effects[name])
                if any(effects[name][key] != 0.0 for key in realisation.parameters):
                    realisation.apply(spec, bench, effects[name])
        spec.comment = _comment(bench, effects, left_out or {})
        spec.compile()
    except CableError:
        raise
    except ValueError as error:
        reason = str(error).strip().splitlines()[0]
        additions = ", ".join(["sensors", *effects])
        raise CableError(
            f"scene {bench.path} cannot have what is added ({additions}): {reason}"
        ) from None
    return spec


def existing_effects(scene: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return effects outside the cables that a scene has from an earlier diagnosis."""
    named = re.findall(r"^ {4}(\w+): ", read_spec(scene).comment, re.MULTILINE)
    keyed = {
        name
        for name, effect in EFFECTS.items()
        if name not in REALISATIONS and effect.edit_spec is None
    }
    return tuple(name for name in named if name not in keyed)


def write(path: str | os.PathLike[str], spec: MjSpec) -> None:
    """Write a scene atomically, so that it loads from any folder.

    Raises:
        CableError: the scene is incomplete, or the file would not load again.
    """
    with replacing(path) as partial:
        try:
            spec.compile()
            partial.write_text(_text(spec), encoding="utf-8")
            MjModel.from_xml_path(str(partial))
        except ValueError as error:
            reason = str(error).strip().splitlines()[0]
            raise CableError(f"scene {path} cannot be written: {reason}") from None


def _text(spec: MjSpec) -> str:
    """Return the MJCF of a compiled scene that loads from any folder."""
    origin = Path(spec.modelfiledir).absolute()
    before = spec.meshdir, spec.texturedir
    if any(asset.file for asset in [*spec.meshes, *spec.hfields, *spec.skins]):
        spec.meshdir = str(origin / spec.meshdir)
    if any(texture.file or any(texture.cubefiles) for texture in spec.textures):
        spec.texturedir = str(origin / spec.texturedir)
    try:
        return str(spec.to_xml())
    finally:
        spec.meshdir, spec.texturedir = before


def _largest_step(spec: MjSpec, bench: Bench) -> float:
    """Return half of the time step that makes the cables' ends unstable [s]."""
    model = spec.compile()
    if bench.tied:  # its pieces are the springs
        found = step_limits(model, MjData(model))
        return 0.5 * min(min(found[name]) for name in bench.names)
    pulleys = (bench.motor, bench.motor_radius), (bench.joint, bench.joint_radius)
    limits = []
    for joint, radius in pulleys:
        inertia = model.dof_M0[model.joint(joint).dofadr[0]]
        limits.append(2.0 * math.sqrt(inertia / rim_stiffness(bench, radius)))
    return 0.5 * min(limits)


def _check(name: str, parameters: Sequence[str], values: Values) -> None:
    for given in values:
        if given not in (*parameters, "joint_angle_offset"):
            raise CableError.unknown(f"parameter of {name}", given, parameters)
    for wanted in parameters:
        if wanted not in values:
            raise CableError(f"effect {name} needs a value for `{wanted}`")
        if not math.isfinite(values[wanted]):
            raise CableError(f"effect {name}: `{wanted}` is not finite")


def _comment(
    bench: Bench, effects: Mapping[str, Values], left_out: Mapping[str, Values]
) -> str:
    lines, table = [], realisations()
    for name, values in {**effects, **left_out}.items():
        written = ", ".join(f"{key} {value:.6g}" for key, value in values.items())
        how = table[name].note if name in table else "keys of the cable plugin"
        lines.append(
            f"    {name}: {written} ({how})"
            if name in effects
            else f"    not in this scene, {name}: {written}"
        )
    head = f" {bench.path.name}, sha256 {bench.sha256[:16]}, refitted"
    return ";\n".join([head, *lines]).replace("--", "- -") + " "


def require_repairable(bench: Bench) -> None:
    """Require that a scene can have any effect, or say what to change in it."""
    spec = MjSpec.from_file(str(bench.path))
    _check_settings(spec, bench)
    typical = {p.name: p.typical for e in EFFECTS.values() for p in e.parameters}
    everything = {  # offsets have no entry in the library
        name: {key: typical.get(key, 0.01) for key in realisation.parameters}
        for name, realisation in realisations().items()
        if is_realisable(bench, name)
    }
    try:
        plain, full = (
            repair_scene(bench, bench.cables, each) for each in ({}, everything)
        )
    except CableError as error:
        taken = re.search(r"repeated name '(.+)' in (\w+)", str(error))
        if taken is None:
            raise
        raise CableError(
            f"scene {bench.path} has {taken[2]} {taken[1]!r}, and a repaired scene may "
            "need that name for its own; rename it"
        ) from None
    with TemporaryDirectory() as folder:
        try:
            write(Path(folder) / "scene.xml", full)
        except CableError as error:
            reason = str(error).partition("cannot be written: ")[2]
            raise CableError(
                f"scene {bench.path} would not load again once it is written: {reason}"
            ) from None
    # The cable of a lever is interpolated in its file.
    _rehearse_motion(bench.path if bench.lever else plain, plain.option.timestep, bench)


def _check_settings(spec: MjSpec, bench: Bench) -> None:
    # Parts of MuJoCo that cables, instruments or effects are made of.
    flags = "actuation constraint damper limit sensor spring".split()
    bits = (getattr(mujoco.mjtDisableBit, f"mjDSBL_{f.upper()}") for f in flags)
    pairs = zip(flags, bits, strict=True)
    off = [flag for flag, bit in pairs if spec.option.disableflags & int(bit)]
    if off:
        raise CableError(
            f"scene {bench.path} disables {list_words(off)} in <flag>; cables, sensors "
            "and the effects that are added need them enabled"
        )
    for name in ("settotalmass", "boundmass", "boundinertia"):
        if getattr(spec.compiler, name) > 0.0:
            raise CableError(
                f"scene {bench.path} has {name} in <compiler>, which would change the "
                "bodies that effects add; give the bodies their masses instead"
            )


def _rehearse_motion(scene: MjSpec | Path, step: float, bench: Bench) -> None:
    """Play a short motion through the scene and through its cables alone."""
    count = min(max(round(0.3 / step), 200), 5000)
    phase = np.linspace(0.0, 4.0 * math.pi, count)
    low, high = bench.span
    swing = min(Limit.rehearsal_swing, 0.45 * (high - low))
    middle = min(max(0.0, low + swing), high - swing)
    joint = middle + swing * np.sin(phase)
    wind_up = 0.1 * Limit.rehearsal_swing * bench.joint_radius / bench.motor_radius
    motor = bench.following(joint) + wind_up * np.sin(1.7 * phase)
    time = step * np.arange(count)
    cables, driven = bench.names, bench.joint
    shown = rollout(scene, time, motor, joint, cables=cables, driven=driven)
    alone = bench.replay(step, motor, joint)
    for side, torque, own in zip(
        ("motor", "joint"), shown, (alone.motor_torque, alone.joint_torque), strict=True
    ):
        difference, most = np.abs(torque - own).max(), np.abs(own).max()
        if not difference <= Limit.torque_tolerance * most:
            parts = f", and other parts of the <tuple> {side}_torque_nm"
            raise CableError(
                f"scene {bench.path}: played by MuJoCo, {side}_torque_nm differs from "
                f"what its cables do alone by {difference:.2g} N m, with torques of "
                f"{most:.2g} N m; take out of the scene whatever changes the cables' "
                f"forces{'' if bench.lever else parts}"
            )
