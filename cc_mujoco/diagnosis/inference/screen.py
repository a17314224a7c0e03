"""Which effects could explain the error: signatures once the baseline is retuned.

The signature of an effect is the change that it makes in the simulated torques, less
whatever the free parameters could make as well (the score test of its presence). It
costs a simulation or two, and tells what an effect could explain, whether these data
could show it at all, and which effects look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EFFECTS, EffectParameter
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem
from cc_mujoco.diagnosis.inference.jacobian import Jacobian
from cc_mujoco.errors import CableError
from cc_mujoco.estimation.least_squares import THREADS

_NEAR = 1e-3
PIECE = 1e-9
"""Part of a signature's square below which nothing of it is left."""


class Signature(NamedTuple):
    """What one start of one effect could do for the error.

    Attributes:
        id: of the effect.
        start: its parameters where it would explain most, amplitudes solved for.
        explained: share of the squared error that it would take, to first order.
        visible: RMS of its plausible size over the floor, after retuning.
        basis: (residuals, k) orthonormal, of its signatures.
    """

    id: str
    start: dict[str, float]
    explained: float
    visible: float
    basis: FloatArray


def screen(
    problem: Problem, x: FloatArray, masks: Masks, ids: Sequence[str]
) -> list[Signature]:
    """Signatures of effects, the most helpful first; the best start of each.

    Args:
        problem: the model so far.
        x: where it was fitted.
        masks: samples that count.
        ids: of the effects to try.
    """
    error = problem.residual(x, masks)
    jacobian = Jacobian(problem).jacobian(x, masks)
    size = np.linalg.norm(jacobian, axis=0)
    # Parameters without any influence stay out, and those that stand at a bound: they
    # cannot do more than they have done.
    inside = np.array(
        [
            p.low + _NEAR < place < p.high - _NEAR
            for p, place in zip(problem.tuned, x, strict=True)
        ]
    )
    free = inside & (size > 0.0)
    tangent, _ = np.linalg.qr(jacobian[:, free] / size[free])
    rest = error - tangent @ (tangent.T @ error)

    def best(name: str) -> Signature | None:
        found = [
            signature
            for start in EFFECTS[name].starts
            if (
                signature := _sign(
                    problem, x, masks, name, dict(start), error, tangent, rest
                )
            )
        ]
        return max(found, key=lambda s: s.explained, default=None)

    with ThreadPoolExecutor(THREADS) as pool:
        every = list(pool.map(best, ids))
    return sorted(
        (signature for signature in every if signature is not None),
        key=lambda signature: -signature.explained,
    )


def _amplitudes(name: str) -> list[EffectParameter]:
    """Parameters whose 0 is off; the others only shape the effect."""
    return [parameter for parameter in EFFECTS[name].parameters if parameter.low <= 0.0]


def _sign(
    problem: Problem,
    x: FloatArray,
    masks: Masks,
    name: str,
    start: dict[str, float],
    error: FloatArray,
    tangent: FloatArray,
    rest: FloatArray,
) -> Signature | None:
    wider = problem.with_effect(name, start)
    shapes = {p.name: 0.0 for p in wider.tuned[x.size :]}
    columns, parameters = [], _amplitudes(name)
    for parameter in parameters:
        places = shapes | {parameter.name: start[parameter.name] / parameter.typical}
        try:
            moved = wider.residual(np.concatenate([x, list(places.values())]), masks)
        except CableError:
            return None
        change = (moved - error) / places[parameter.name]
        columns.append(change - tangent @ (tangent.T @ change))
    signature = np.column_stack(columns)
    lengths = np.linalg.norm(signature, axis=0)
    visible = float(lengths.max()) / np.sqrt(error.size) / problem.weight
    if lengths.max() <= PIECE:
        return Signature(name, start, 0.0, 0.0, np.zeros((error.size, 0)))
    kept = lengths > PIECE
    solved = np.zeros(len(parameters))
    solved[kept] = np.linalg.lstsq(signature[:, kept], -rest, rcond=1e-6)[0]
    low = np.array([parameter.low / parameter.typical for parameter in parameters])
    high = np.array([parameter.high / parameter.typical for parameter in parameters])
    solved = np.clip(solved, np.maximum(low, -20.0), np.minimum(high, 20.0))
    left = rest + signature @ solved
    explained = 1.0 - float(left @ left) / float(error @ error)
    gained = explained - (1.0 - float(rest @ rest) / float(error @ error))
    for parameter, amount in zip(parameters, solved.tolist(), strict=True):
        start[parameter.name] = amount * parameter.typical
    basis, _ = np.linalg.qr(signature[:, kept])
    return Signature(name, start, max(gained, 0.0), visible, basis)


def signature_cosine(one: Signature, other: Signature) -> float:
    """Largest cosine between the signatures of two effects, 0 to 1."""
    if one.basis.shape[1] == 0 or other.basis.shape[1] == 0:
        return 0.0
    cosines = np.linalg.svd(one.basis.T @ other.basis, compute_uv=False)
    return float(min(cosines[0], 1.0))
