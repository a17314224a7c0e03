"""A tendon over sites with Coulomb friction at each, written without the product.

Straight pieces are springs, `stiffness` over their length in the first pose; at a site
the cable slips as far as the tensions beside it would differ by more than
exp(friction * turn). One site after another is put right until none is wrong, which is
slow and knows neither kernel nor fronts.
"""

from __future__ import annotations

import mujoco
import numpy as np

Array = np.ndarray


class Chain:
    """The tendon of a model along sites, wound on a drum of `radius` at its first."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        sites: list[str],
        *,
        stiffness: float,
        pretension: float,
        friction: float,
    ) -> None:
        self.model, self.friction = model, friction
        self.sites = [model.site(name).id for name in sites]
        rest = self.lengths(data)
        self.length = rest
        self.spring = stiffness / rest
        # What each piece would have to be shortened by to have no tension.
        self.stretch = pretension / self.spring
        self.wound = 0.0

    def points(self, data: mujoco.MjData) -> Array:
        return data.site_xpos[self.sites]

    def lengths(self, data: mujoco.MjData) -> Array:
        return np.linalg.norm(np.diff(self.points(data), axis=0), axis=1)

    def tension(self, data: mujoco.MjData, wound: float) -> Array:
        """Tension of the pieces (n,) after the pose or the drum [m] changed."""
        now = self.lengths(data)
        stretch = self.stretch + now - self.length
        stretch[0] += wound - self.wound
        self.length, self.wound = now, wound
        along = np.diff(self.points(data), axis=0) / now[:, None]
        cosine = np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0)
        most = np.exp(self.friction * np.arccos(cosine))
        k = self.spring
        for _ in range(20000):
            worst = 0.0
            for j, ratio in enumerate(most):
                for a, b in ((j, j + 1), (j + 1, j)):
                    # Slip from a to b, so that b is no tighter than friction holds.
                    excess = k[b] * stretch[b] - ratio * max(k[a] * stretch[a], 0.0)
                    if excess > 0.0 and k[b] * stretch[b] > 0.0:
                        slack = min(stretch[a], 0.0)
                        slip = excess / (k[b] + ratio * k[a])
                        if k[b] * (stretch[b] - slip) < 0.0 or slack < 0.0:
                            slip = min(excess / k[b], slip - slack)
                        stretch[a] += slip
                        stretch[b] -= slip
                        worst = max(worst, excess)
            if worst < 1e-6 * (1.0 + np.max(k * np.abs(stretch))):
                break
        self.stretch = stretch
        return np.maximum(k * stretch, 0.0)

    def torque(self, data: mujoco.MjData, tension: Array) -> Array:
        """Forces of these tensions on the degrees of freedom (nv,)."""
        points = self.points(data)
        along = np.diff(points, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        total = np.zeros(self.model.nv)
        for i, site in enumerate(self.sites):
            force = np.zeros(3)
            if i < len(along):
                force += tension[i] * along[i]
            if i > 0:
                force -= tension[i - 1] * along[i - 1]
            jacobian = np.zeros((3, self.model.nv))
            mujoco.mj_jacSite(self.model, data, jacobian, None, site)
            total += jacobian.T @ force
        return total
