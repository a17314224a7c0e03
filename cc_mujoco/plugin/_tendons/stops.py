"""Limits, dry friction and equalities of a winch that are as stiff as the tendon's."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.plugin._tendons.burden import Burden


def keep_constraints(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    original: mujoco.MjModel,
    burdens: Collection[Burden],
) -> None:
    """Make limits, dry friction and equalities of winches as stiff as the tendons'.

    MuJoCo scales the regularisation of a constraint by the inverse of the inertia that
    it moves, of which a winch has little. A constraint also resists like an inertia of
    its own, and what the light winch has of speed would count as the momentum of that:
    limits and dry friction therefore stop a winch within a step, as a spring and a
    dashpot do.
    """
    before, after = _inverse_weights(original), _inverse_weights(model)
    tendon_of = {burden.winch: burden.tendon for burden in burdens}
    movable = [b for b in burdens if before[b.tendon] > 0.0 and after[b.winch] > 0.0]
    for burden in movable:
        _keep_stops(spec, original, burden, before[burden.tendon], after[burden.winch])
    for place in {place for burden in movable for place in burden.equalities}:
        equality = spec.equalities[place]
        pair = [name for name in (equality.name1, equality.name2) if name]
        old = sum(before[tendon_of.get(name, name)] for name in pair)
        new = sum(after[name] for name in pair)
        _rescale(equality, "solimp", "solref", old / max(new, mujoco.mjMINVAL))


def _keep_stops(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    burden: Burden,
    inverse: float,
    winch_inverse: float,
) -> None:
    """Keep limit and dry friction of a winch, by inverse inertias before and after."""
    own, index = spec.tendon(burden.winch), original.tendon(burden.tendon).id
    step = original.opt.timestep
    stop = _as_spring(
        original.tendon_solimp_lim[index],
        original.tendon_solref_lim[index],
        inverse,
        step,
    )
    # A stop that the elastic cable does not bounce from.
    drag = max(2.0 * math.sqrt(stop.stiffness / inverse), 2.0 * stop.stiffness * step)
    stop = dataclasses.replace(stop, damping=drag)
    own.solimp_limit, own.solref_limit = stop.on(winch_inverse, step)
    dry = _as_spring(
        original.tendon_solimp_fri[index],
        original.tendon_solref_fri[index],
        inverse,
        step,
    )
    own.solimp_friction, own.solref_friction = dry.on(winch_inverse, step)


@dataclasses.dataclass(frozen=True)
class _Stop:
    """A constraint as a spring and a dashpot: stiffness [N/m], damping [N s/m]."""

    stiffness: float
    damping: float

    def on(self, inverse: float, step: float) -> tuple[list[float], list[float]]:
        """Return `solimp` and `solref` for an inverse inertia [1/kg] at a step [s]."""
        weight = self.damping * step
        impedance = min(weight * inverse / (1.0 + weight * inverse), mujoco.mjMAXIMP)
        weight = impedance / ((1.0 - impedance) * inverse)
        rate = min(self.stiffness / weight, 0.5 / step**2)
        solimp = [impedance, impedance, 1e-3, 0.5, 2.0]
        return solimp, [-rate * impedance, -impedance / step]


def _as_spring(
    solimp: NDArray[np.float64],
    solref: NDArray[np.float64],
    inverse: float,
    step: float,
) -> _Stop:
    """Return the stiffness and the damping of a constraint, see MuJoCo's `solref`."""
    most = float(np.clip(solimp[1], mujoco.mjMINIMP, mujoco.mjMAXIMP))
    weight = most / ((1.0 - most) * inverse)
    if solref[0] > 0.0:
        time = max(float(solref[0]), 2.0 * step)
        rate = 1.0 / (most * time * float(solref[1])) ** 2
        return _Stop(weight * rate * most, weight * 2.0 / (most * time))
    return _Stop(-weight * float(solref[0]) / most, -weight * float(solref[1]) / most)


def _inverse_weights(model: mujoco.MjModel) -> dict[str, float]:
    weights = model.tendon_invweight0
    return {model.tendon(i).name: float(weights[i]) for i in range(model.ntendon)}


def _rescale(owner: Any, impedance: str, reference: str, ratio: float) -> None:
    """Change an impedance so that it leaves the regularisation as it was."""
    if not ratio > 0.0:
        return
    solimp = np.array(getattr(owner, impedance))
    limits = (mujoco.mjMINIMP, mujoco.mjMAXIMP)
    old = np.clip(solimp[:2], *limits)
    solimp[:2] = np.clip(1.0 / (1.0 + (1.0 / old - 1.0) * ratio), *limits)
    setattr(owner, impedance, solimp)
    solref = np.array(getattr(owner, reference))
    if solref[0] > 0.0:
        # Its time constant is in units of the impedance.
        solref[0] *= old[1] / solimp[1]
        setattr(owner, reference, solref)


def held_tension(original: mujoco.MjModel, burden: Burden) -> float:
    """Return the tension that the dry friction of a tendon holds in `qpos0` [N].

    None where its friction would have to push, or where it has pulleys.
    """
    if "frictionloss" not in burden.fields or burden.has_pulleys:
        return 0.0
    data = mujoco.MjData(original)
    mujoco.mj_forward(original, data)
    own = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON) & (
        data.efc_id == original.tendon(burden.tendon).id
    )
    return max(-float(np.sum(data.efc_force[own])), 0.0)
