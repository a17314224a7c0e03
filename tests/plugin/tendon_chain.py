"""A tendon over sites with Coulomb friction at each, written without the product.

Each straight piece of path holds some unstretched length of cable, m, and has the
tension EA (l / m - 1). At a site the cable slips, from one piece to the next, as far as
the tensions beside it would differ by more than exp(friction * turn). One site after
another is put right until none is wrong, which is slow and knows neither kernel nor
fronts.
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
        self.stiffness = stiffness
        self.mounted = self.first = 1.0 + pretension / stiffness
        self.cable = self.lengths(data) / self.mounted
        self.wound = 0.0
        self.layers: list[list[float]] = []

    def points(self, data: mujoco.MjData) -> Array:
        return data.site_xpos[self.sites]

    def lengths(self, data: mujoco.MjData) -> Array:
        return np.linalg.norm(np.diff(self.points(data), axis=0), axis=1)

    def tension(self, data: mujoco.MjData, wound: float) -> Array:
        """Tension of the pieces (n,) after the pose or the drum [m] changed."""
        now = self.lengths(data)
        m = self.cable
        m[0] -= self.take_in(wound - self.wound)
        self.wound = wound
        along = np.diff(self.points(data), axis=0) / now[:, None]
        cosine = np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0)
        most = np.exp(self.friction * np.arccos(cosine))
        pull = self.stiffness * (now / m - 1.0)
        for _ in range(20000):
            worst = 0.0
            for j, ratio in enumerate(most):
                for a, b in ((j, j + 1), (j + 1, j)):
                    # Slip from a to b, so that b is no tighter than friction holds.
                    excess = pull[b] - ratio * max(pull[a], 0.0)
                    if excess > 0.0 and pull[b] > 0.0:
                        stiff = [self.stiffness * now[i] / m[i] ** 2 for i in (a, b)]
                        slip = excess / (stiff[1] + ratio * stiff[0])
                        if pull[a] < 0.0:
                            slip = min(excess / stiff[1], slip - pull[a] / stiff[0])
                        m[a] -= slip
                        m[b] += slip
                        for i in (a, b):
                            pull[i] = self.stiffness * (now[i] / m[i] - 1.0)
                        worst = max(worst, excess)
            if worst < 1e-6 * (1.0 + np.max(np.abs(pull))):
                break
        self.first = 1.0 + max(pull[0], 0.0) / self.stiffness
        return np.maximum(pull, 0.0)

    def take_in(self, length: float) -> float:
        """Return the unstretched cable that the drum takes in with a length [m].

        It keeps the strain of the first piece and gives it back, last in, first out;
        below lies cable at the strain of the pretension.
        """
        if length > 0.0:
            self.layers.append([length, self.first])
            return length / self.first
        left, given = -length, 0.0
        while left > 0.0 and self.layers:
            part = min(left, self.layers[-1][0])
            given += part / self.layers[-1][1]
            self.layers[-1][0] -= part
            left -= part
            if self.layers[-1][0] <= 0.0:
                self.layers.pop()
        return -(given + left / self.mounted)

    def torque(self, data: mujoco.MjData, tension: Array) -> Array:
        """Return the forces of these tensions on the degrees of freedom (nv,)."""
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
