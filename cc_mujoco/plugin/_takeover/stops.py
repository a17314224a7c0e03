"""Limits, dry friction and equalities of a winch that are as stiff as the tendon's."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.plugin._spec import compile_spec
from cc_mujoco.plugin._takeover.survey import Burden


def keep_constraints(
    spec: mujoco.MjSpec, original: mujoco.MjModel, burden: Burden
) -> None:
    """Make limits, dry friction and equalities of a winch as stiff as the tendon's.

    MuJoCo scales the regularisation of a constraint by the inverse of the inertia that
    it moves, of which a winch has little. A constraint also resists like an inertia of
    its own, and what the light winch has of speed would count as the momentum of that:
    limits and dry friction therefore stop a winch within a step, as a spring and a
    dashpot do.
    """
    model = compile_spec(spec.copy())
    before = {
        t: original.tendon_invweight0[original.tendon(t).id] for t in _names(original)
    }
    after = {t: model.tendon_invweight0[model.tendon(t).id] for t in _names(model)}
    own, index = spec.tendon(burden.winch), original.tendon(burden.tendon).id
    inverse, step = before[burden.tendon], original.opt.timestep
    if not inverse > 0.0 or not after[burden.winch] > 0.0:
        return
    stop = _as_spring(
        original.tendon_solimp_lim[index],
        original.tendon_solref_lim[index],
        inverse,
        step,
    )
    # A stop that the elastic cable does not bounce from.
    drag = max(2.0 * math.sqrt(stop.stiffness / inverse), 2.0 * stop.stiffness * step)
    stop = dataclasses.replace(stop, damping=drag)
    own.solimp_limit, own.solref_limit = stop.on(after[burden.winch], step)
    dry = _as_spring(
        original.tendon_solimp_fri[index],
        original.tendon_solref_fri[index],
        inverse,
        step,
    )
    own.solimp_friction, own.solref_friction = dry.on(after[burden.winch], step)
    for place in burden.equalities:
        equality = spec.equalities[place]
        pair = [name for name in (equality.name1, equality.name2) if name]
        old = sum(before.get(n, before[burden.tendon]) for n in pair)
        new = sum(after[n] for n in pair)
        _rescale(equality, "solimp", "solref", old / max(new, mujoco.mjMINVAL))


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


def _names(model: mujoco.MjModel) -> list[str]:
    return [model.tendon(i).name for i in range(model.ntendon)]


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
