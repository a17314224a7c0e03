"""Requirements on a scene so that any effect can be added, checked before the work.

    require_repairable(Bench.of("bench.xml"))

What is known to go wrong has a sentence of its own. For the rest the repair is
rehearsed: with every effect at once the scene must be written and load again, and as
it is it must show what its cables do by themselves.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._scene.mechanical import Values
from cc_mujoco.diagnosis._scene.realisation import is_realisable, realisations
from cc_mujoco.diagnosis._scene.repair import repair_scene, write
from cc_mujoco.diagnosis._scene.rollout import rollout
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.errors import CableError
from cc_mujoco.report._html import list_words

_REQUIRED_FLAGS = ("actuation", "constraint", "damper", "limit", "sensor", "spring")
"""Parts of MuJoCo that cables, instruments or effects are made of."""
_COMPILER_SETTINGS = ("settotalmass", "boundmass", "boundinertia")
"""Settings of the compiler that change the bodies that effects add."""
_REHEARSAL_TIME, _REHEARSAL_STEPS = 0.3, (200, 5000)
_REHEARSAL_SWING = 0.3  # of the joint in the rehearsal [rad]
_TORQUE_TOLERANCE = 1e-3  # of the largest torque


def require_repairable(bench: Bench) -> None:
    """Require that the scene of a bench can have any effect.

    Raises:
        CableError: it cannot; the sentence says what to change in it.
    """
    spec = mujoco.MjSpec.from_file(str(bench.path))
    _check_settings(spec, bench)
    plain = _rehearse_repair(bench, {})
    everything = {
        name: {
            parameter: typical.get(
                parameter, 0.01
            )  # offsets have no entry in the library
            for parameter in realisation.parameters
        }
        for name, realisation in realisations().items()
        if is_realisable(bench, name)
        for typical in [_typical_values(name)]
    }
    full = _rehearse_repair(bench, everything)
    with TemporaryDirectory() as folder:
        try:
            write(Path(folder) / "scene.xml", full)
        except CableError as error:
            reason = str(error).partition("cannot be written: ")[2]
            raise CableError(
                f"scene {bench.path} would not load again once it is written: {reason}"
            ) from None
    # What a lever's cable does is looked up in its file.
    _rehearse_motion(bench.path if bench.lever else plain, plain.option.timestep, bench)


def _rehearse_repair(bench: Bench, effects: Mapping[str, Values]) -> mujoco.MjSpec:
    try:
        return repair_scene(bench, bench.cables, effects)
    except CableError as error:
        taken = re.search(r"repeated name '(.+)' in (\w+)", str(error))
        if taken is None:
            raise
        raise CableError(
            f"scene {bench.path} has {taken[2]} {taken[1]!r}, and a repaired scene may "
            "need that name for its own; rename it"
        ) from None


def _typical_values(effect: str) -> dict[str, float]:
    parameters = EFFECTS[effect].parameters if effect in EFFECTS else ()
    return {parameter.name: parameter.typical for parameter in parameters}


def _check_settings(spec: mujoco.MjSpec, bench: Bench) -> None:
    """Check the options of the whole scene."""
    off = [
        name
        for name in _REQUIRED_FLAGS
        if spec.option.disableflags
        & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}"))
    ]
    if off:
        raise CableError(
            f"scene {bench.path} disables {list_words(off)} in <flag>; cables, sensors "
            "and the effects that are added need them enabled"
        )
    for name in _COMPILER_SETTINGS:
        if getattr(spec.compiler, name) > 0.0:
            raise CableError(
                f"scene {bench.path} has {name} in <compiler>, which would change the "
                "bodies that effects add; give the bodies their masses instead"
            )


def _rehearse_motion(scene: mujoco.MjSpec | Path, step: float, bench: Bench) -> None:
    """Play a short motion through the scene and through its cables alone."""
    count = min(
        max(round(_REHEARSAL_TIME / step), _REHEARSAL_STEPS[0]), _REHEARSAL_STEPS[1]
    )
    phase = np.linspace(0.0, 4.0 * math.pi, count)
    low, high = bench.span
    swing = min(_REHEARSAL_SWING, 0.45 * (high - low))
    middle = min(max(0.0, low + swing), high - swing)
    joint = middle + swing * np.sin(phase)
    wind_up = 0.1 * _REHEARSAL_SWING * bench.joint_radius / bench.motor_radius
    motor = bench.following(joint) + wind_up * np.sin(1.7 * phase)
    shown = rollout(
        scene,
        step * np.arange(count),
        motor,
        joint,
        cables=bench.names,
        driven=bench.joint,
    )
    alone = bench.replay(step, motor, joint)
    for side, torque, own in zip(
        ("motor", "joint"), shown, (alone.motor_torque, alone.joint_torque), strict=True
    ):
        difference, most = np.abs(torque - own).max(), np.abs(own).max()
        if not difference <= _TORQUE_TOLERANCE * most:
            sums = "" if bench.lever else f", and other parts of the <tuple> {side}"
            raise CableError(
                f"scene {bench.path}: played by MuJoCo, {side}_torque_nm differs from "
                f"what its cables do alone by {difference:.2g} N m, with torques of "
                f"{most:.2g} N m; take out of the scene whatever changes the cables' "
                f"forces{sums and sums + '_torque_nm'}"
            )
