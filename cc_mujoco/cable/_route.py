"""Route of a cable along a MuJoCo tendon, and its packed parameters."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.native import FloatArray as Floats


def ancestors(model: Any, body: int) -> list[int]:
    """Return a body of an `mjModel` and its parents up to the world."""
    found = [body]
    while found[-1] != 0:
        found.append(int(model.body_parentid[found[-1]]))
    return found


@dataclass(frozen=True)
class Route:
    """Spatial tendon that guides a cable, or bends its conduit."""

    tendon: int
    """Index of the tendon in the model."""
    mouth: int
    """Index in its path of the site at which the conduit ends, 0: none."""
    guided: int
    """Number of segments in the conduit."""
    bends: bool
    """True if the tendon bends the conduit."""
    tied: tuple[bool, bool]
    """True if the proximal, the distal end is tied to a site of the tendon."""
    guides: Floats
    """Guides of an open path, see `_open_path.measure` (n,)."""
    reference: Floats
    """Wrap angles [rad], or shape of `_open_path.measure`, in the pose `qpos0`."""

    def reference_of(self, cable: Cable) -> Floats:
        """Return `reference` with the conduit of `cable`, which may be another one."""
        n, guided, reference = cable.segments, self.guided, self.reference.copy()
        if 0 < guided < n:
            inside = np.empty(kernel.parameter_size(guided))
            sections = np.array(cable.conduit, dtype=np.float64)
            kernel.pack(np.array(cable.scalars), sections, guided, inside)
            open_path.store_conduit(inside, reference, n, guided)
        return reference

    def packed(self, cable: Cable) -> Floats:
        """Return the packed parameters of a cable in the pose `qpos0`."""
        n, prm = cable.segments, packed_parameters(cable)
        if self.guided < n:
            values, reference = np.array(cable.scalars), self.reference_of(cable)
            open_path.pack_reference(values, n, self.guided, reference, prm)
        kernel.expect_change(prm)
        return prm
