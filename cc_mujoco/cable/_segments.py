"""Segments of a cable with Coulomb friction, as arrays for NumPy.

    mesh = Mesh.of(Cable(friction=0.2, conduit=(Section(2.0, 0.28),), segments=10))
    mesh.growth(pattern)      # ratio of the tensions at both ends of every segment
    mesh.compliance(pattern)  # stretch of every segment per newton

Equation numbers are those of A. Borowski's thesis, chapter 2.
"""

from dataclasses import dataclass

import numpy as np

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters, segment_lengths
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.cable._parameter import Term
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class Mesh:
    """Segments of a cable (2.1.1).

    A `pattern` (n,) has the direction of motion of every segment: 1 distal, -1, or 0.
    """

    angle: FloatArray  # mu_d dx / R, kinetic friction times wrap of every segment (n,)
    static_angle: FloatArray  # mu_s dx / R, with static friction (n,)
    length: FloatArray  # dx of every segment (n,) [m]
    stiffness: float  # k_c of Hooke's law T = k_c du/dx [N]

    @classmethod
    def of(cls, cable: Cable) -> "Mesh":
        """Return the segments of the kernel, each with the mean curvature of its part.

        They are equal, as in the thesis, if the conduit has constant curvature.

        Raises:
            CableError: the cable has a friction term that chapter 2 does not have.
        """
        cable.require_terms(_is_coulomb, "chapter 2 knows Coulomb friction only")
        wrap = segment_angles(packed_parameters(cable), cable.segments)
        static = cable.static_friction or cable.friction
        length = segment_lengths(cable)
        return cls(cable.friction * wrap, static * wrap, length, cable.axial_stiffness)

    @property
    def segments(self) -> int:
        return self.angle.size

    def part(self, first: int, last: int) -> "Mesh":
        """Return the segments from `first` up to, but without, `last`."""
        span = slice(first, last)
        return Mesh(
            self.angle[span], self.static_angle[span], self.length[span], self.stiffness
        )

    def mirrored(self) -> "Mesh":
        """Return the same cable seen from its distal end (footnote 3)."""
        return Mesh(
            self.angle[::-1], self.static_angle[::-1], self.length[::-1], self.stiffness
        )

    def growth(self, pattern: FloatArray) -> FloatArray:
        """Return T_{i+1}/T_i of every segment if it slips (2.10)."""
        return np.exp(self.angle * pattern)

    def compliance(self, pattern: FloatArray) -> FloatArray:
        """Return (u_{i+1} - u_i)/T_i of every segment if it slips (2.12) [m/N]."""
        signed = self.angle * pattern
        mean = np.ones_like(signed)
        np.divide(np.expm1(signed), signed, out=mean, where=signed != 0.0)
        return mean * self.length / self.stiffness


def _is_coulomb(term: Term) -> bool:
    """Return whether Coulomb's law, (2.6) and (2.7), still holds with a term."""
    return term.acts_on == "pulley" or (
        term.acts_on == "coefficient" and not term.depends_on
    )
