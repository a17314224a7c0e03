"""Checks of effects that the user requested, before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig
from cc_mujoco.diagnosis.effects import EFFECTS, Effect, EffectError
from cc_mujoco.native import FloatArray

_SMALL_SHARE = 3e-4
"""Share of a typical size at which the derivative near 0 is taken, over as much."""
_MAX_SLOPE_RATIO = 15.0
"""Derivative near 0 over the mean one to the typical size beyond which there is none;
it is 24 for a square root and 1e-3 for a square."""
_MIN_SLOPE_RATIO = 0.01
_ROUNDING = 1e-9
"""Change of the torques over their size that another way of solving makes, too."""
MAX_CHECKED_RECORDS = 3
"""Records on which effects are checked."""


def check_effects(
    plant: SimulatedRig, values: Mapping[str, float], ids: Sequence[str]
) -> tuple[str, ...]:
    """Check effects on the data, and return a sentence for each that they cannot show.

    Args:
        plant: the rig with its records.
        values: parameters of the baseline.
        ids: of the effects; others are not checked.

    Raises:
        EffectError: an effect is not off where its sizes are 0, its torques are not
            finite, or have no derivative with respect to a size at 0.
    """
    notes = []
    effects = plant.library.effects
    few = plant.limited(plant.records[:MAX_CHECKED_RECORDS])
    plain = few.simulate(values) if ids else []
    for name in ids:
        if name not in effects:
            library = plant.library
            why = library.hidden.get(name) or library.declared.get(name, "")
            notes.append(f"Effect {name!r} is not looked for: {why}.")
        elif not _check(effects[name], few, values, plain) and not _check(
            effects[name], plant, values, plant.simulate(values)
        ):
            notes.append(
                f"Effect {name!r} changes nothing in these data; it takes "
                f"{EFFECTS[name].required_excitation}."
            )
    return tuple(notes)


def _check(
    effect: Effect,
    plant: SimulatedRig,
    values: Mapping[str, float],
    plain: Sequence[FloatArray],
) -> bool:
    """Check one effect; return whether a typical size changes a torque."""
    shows = False
    least = _ROUNDING * float(
        np.linalg.norm(np.concatenate([p.ravel() for p in plain]))
    )
    for start in effect.starts:
        sizes = [p for p in effect.parameters if p.linear]
        off = {**values, **start, **{p.name: 0.0 for p in sizes}}
        for record, before, after in zip(
            plant.records, plain, plant.simulate(off, (effect.id,)), strict=True
        ):
            if not np.array_equal(before, after):
                most = np.abs(after - before).max()
                raise EffectError(
                    f"effect {effect.id!r} is not off where its sizes are 0: it "
                    f"changes trial {record.trial} by {most:.3g} N m; "
                    "return the signals or cables unchanged there"
                )
        for parameter in sizes:
            full = start[parameter.name]
            # At 0 itself the kernel may change from one way of solving to another.
            first, second, whole = (
                _change(effect, plant, plain, {**off, parameter.name: share * full})
                for share in (_SMALL_SHARE, 2.0 * _SMALL_SHARE, 1.0)
            )
            small = float(np.linalg.norm(second - first)) / _SMALL_SHARE
            large = float(np.linalg.norm(whole - first))
            shows |= large > least and parameter.size
            if parameter.size and large > least:
                _require_slope(effect, parameter.name, small / large)
    return shows


def _change(
    effect: Effect,
    plant: SimulatedRig,
    plain: Sequence[FloatArray],
    values: Mapping[str, float],
) -> FloatArray:
    """Return the change of all torques by an effect [N m].

    Raises:
        EffectError: it is not finite.
    """
    changes = []
    for record, before, after in zip(
        plant.records, plain, plant.simulate(values, (effect.id,)), strict=True
    ):
        if not np.isfinite(after).all():
            raise EffectError(
                f"effect {effect.id!r} makes a torque that is not finite in trial "
                f"{record.trial}"
            )
        changes.append((after - before).ravel())
    return np.concatenate(changes)


def _require_slope(effect: Effect, name: str, ratio: float) -> None:
    """Refuse a size whose derivative at 0 is infinite or 0.

    Args:
        effect: the effect.
        name: of the size.
        ratio: of the derivative at 0 over that at the typical size.
    """
    if _MIN_SLOPE_RATIO <= ratio <= _MAX_SLOPE_RATIO:
        return
    what = "infinite" if ratio > 1.0 else "0"
    advice = "its root" if ratio < 1.0 else "a power of it"
    raise EffectError(
        f"effect {effect.id!r}: the derivative of the torques with respect to "
        f"{name!r} is {what} where that is 0, so no fit finds it; use {advice} as the "
        "size, so that the change begins in proportion to it"
    )
