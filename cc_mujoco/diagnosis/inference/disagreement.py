"""Disagreement between parts of the data about each parameter, beyond what noise makes.

Every trial is left out in turn, by one Gauss-Newton step from the fit: its Jacobian and
residuals are at hand, so nothing is fitted again. How far a parameter then moves is
divided by how far noise would move it, so that a trial which alone tells a parameter
counts as one of many, whatever its leverage: the parameter moves far without it, and
noise would do that, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.folds import PIECES
from cc_mujoco.diagnosis.inference.records import Record
from cc_mujoco.estimation.least_squares import covariance

LEAST = 3
"""Trials from which on they tell how much they disagree; of fewer their pieces do."""
_TELLS = 1e-9
"""Share of a variance that a part has to take off to tell of a parameter."""


class Disagreement(NamedTuple):
    """Result of leaving out parts of the data.

    Attributes:
        factor: (parameters,) mean square of the moves over what noise makes of it; 1
            where noise is all there is.
        freedom: (parameters,) degrees of freedom with which that is known.
    """

    factor: FloatArray
    freedom: FloatArray


def disagreement(
    slopes: FloatArray, residual: FloatArray, parts: NDArray[np.int64]
) -> Disagreement:
    r"""Moves of a least-squares fit whose parts are left out in turn.

    With J the Jacobian of the residuals r, H = J^T J, and H_g, s_g = J_g^T r_g those of
    a part, the fit moves by d_g = (H - H_g)^-1 s_g without it (Cook 1977), of which
    noise makes the variance (H - H_g)^-1 - H^-1. The factor is the mean of
    d_g^2 / variance, an overdispersion as of Birge (Phys. Rev. 40, 1932), and of
    Hartung and Knapp (Stat. Med. 20, 2001) where trials tell one number each. Its
    freedom is Satterthwaite's, G^2 over the sum of the squared correlations of the
    moves (Bell and McCaffrey, Survey Methodology 28, 2002): G - 1 for G equal parts.

    Args:
        slopes: (residuals, parameters) of the residuals, priors last.
        residual: (residuals,) in units of their noise.
        parts: (data,) number of the part of each residual; those of priors have none.
    """
    whole = covariance(slopes)
    root: list[FloatArray] = []
    pull: list[FloatArray] = []
    for part in np.unique(parts):
        rows = np.flatnonzero(parts == part)
        # A triangle has the same square as the rows, which may be many.
        root.append(np.asarray(np.linalg.qr(slopes[rows], mode="r")))
        pull.append(slopes[rows].T @ residual[rows])
    square = [each.T @ each for each in root]
    known = slopes[parts.size :]
    without = [
        covariance(np.concatenate([*root[:place], *root[place + 1 :], known]))
        for place in range(len(root))
    ]
    factor = np.ones(slopes.shape[1])
    freedom = np.full(slopes.shape[1], np.inf)
    for k in range(factor.size):
        row = [each[k] for each in without]
        told = np.array([a @ b for a, b in zip(row, square, strict=True)])
        moved = np.array([a @ b for a, b in zip(row, pull, strict=True)])
        joint = -told @ whole @ told.T
        joint[np.diag_indices_from(joint)] += np.sum(told * np.array(row), axis=1)
        size = np.diag(joint)
        tells = size > _TELLS * whole[k, k]
        if np.sum(tells) < 2:
            continue
        deviation = np.sqrt(size[tells])
        alike = joint[np.ix_(tells, tells)] / np.outer(deviation, deviation)
        factor[k] = float(np.mean((moved[tells] / deviation) ** 2))
        freedom[k] = deviation.size**2 / float(np.sum(alike**2))
    return Disagreement(factor, freedom)


def parts_of(
    records: Sequence[Record], masks: Sequence[NDArray[np.bool_]]
) -> NDArray[np.int64]:
    """Number of the part of each residual (data,): its trial, with its repetitions.

    Of fewer trials than `LEAST` it is one of the pieces of every record.
    """
    used = [bool(mask.any()) for mask in masks]
    groups = sorted({r.group for r, some in zip(records, used, strict=True) if some})
    found = []
    for place, (record, mask) in enumerate(zip(records, masks, strict=True)):
        count = int(np.sum(mask))
        if len(groups) >= LEAST:
            own = np.full(count, groups.index(record.group) if count else 0)
        else:
            own = place * PIECES + np.arange(count) * PIECES // max(count, 1)
        found.append(np.tile(own, len(record.measured)))
    return np.concatenate(found).astype(np.int64)
