"""Cables by other equations than the engine's: chains of nodes that bristles hold.

    batch.transmission = BristleChains(batch, known, seeds)

A node at a bend of angle a carries the mean tension T of both sides. Its bristle, of
length d, yields as the node moves by x (Dahl, Aerospace Corp. TOR-0158, 1968):

    friction = 2 tanh(mu a / 2) T z,        dz/dx = (sign(x) - z) / d,   |z| < 1

Where all nodes slide, the tensions at the ends are as exp(mu wrap) to 1, exactly. Nodes
have no mass. Newton's method finds all at once, once in a physics step. The engine has
other nodes, the friction of which does not yield, and finds where they turn.

Displacements are positive from the motor to the joint. Chains pull by applied forces on
a device whose own cables are unplugged (`device.UNPLUGGED`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.cable import PATHS, Cable
from cc_mujoco.device import Device, DeviceModel, Plant
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._batch import Batch

NODES = 12
LENGTH = 0.2e-3  # of bristles: how far a liner of plastic gives under its cable [m]
UNEVENNESS = 0.5  # largest relative deviation of a bend from the mean
ITERATIONS = 60
MOST_TURN = 0.5
"""Natural frequency of a motor or joint on the stiffness of an end, times the physics
step, up to which applied forces are stable with a margin of 4."""


class Chains(NamedTuple):
    """Constants of n chains."""

    pretension: Array  # (n, 1) [N]
    stiffness: Array  # of every piece (n, NODES + 1) [N/m]
    grip: Array  # friction over mean tension of a node that slides (n, NODES)

    @classmethod
    def of(cls, cables: Sequence[Cable], seeds: Sequence[int]) -> "Chains":
        """Return chains of the cables, with bends that differ by their seeds."""
        pieces, grips = [], []
        for cable, seed in zip(cables, seeds, strict=True):
            random = np.random.default_rng([seed, 6])
            bends = 1.0 + UNEVENNESS * random.uniform(-1.0, 1.0, NODES)
            bends *= cable.wrap / bends.sum()
            grips.append(2.0 * np.tanh(0.5 * cable.friction * bends))
            soft = np.full(NODES + 1, 1.0 / end_stiffness(cable))
            soft[0] += cable.proximal_compliance
            soft[-1] += cable.end_compliance
            pieces.append(1.0 / soft)
        tight = np.array([[cable.pretension] for cable in cables])
        return cls(tight, np.array(pieces), np.array(grips))

    def tensions(self, place: Array) -> Array:
        """Return tensions of the pieces (n, NODES + 1) for nodes with ends [m]."""
        stretched = self.pretension + self.stiffness * np.diff(place, axis=1)
        return np.maximum(stretched, 0.0)

    def move(self, place: Array, lean: Array, ends: Array) -> tuple[Array, Array]:
        """Return places (n, NODES + 2) [m] and deflections over the length (n, NODES).

        `place` and `lean` are those before, `ends` (n, 2) the displacements now [m].
        """
        found, whole = place.copy(), np.arange(NODES)
        found[:, [0, -1]] = ends
        for turn in range(ITERATIONS):
            moved = found[:, 1:-1] - place[:, 1:-1]
            way, left = np.sign(moved), np.exp(-np.abs(moved) / LENGTH)
            leaning = way - (way - lean) * left
            tension = self.tensions(found)
            near, far = tension[:, :-1], tension[:, 1:]
            half = 0.5 * self.grip * leaning
            rest = far - near - half * (near + far)
            size = 1e-9 * self.pretension.max() + 1e-7 * tension.max(axis=1)
            wrong = ~(np.abs(rest).max(axis=1) <= size) & np.isfinite(tension[:, 0])
            if not wrong.any():
                return found, leaning
            # A slack piece is a little stiff in the slope, which changes no solution.
            slope = np.where(tension > 0.0, 1.0, 1e-6) * self.stiffness
            matrix = np.zeros((*leaning.shape, NODES))
            yields = (1.0 - way * lean) * left / LENGTH
            drag = 0.5 * self.grip * yields * (near + far)
            rise, fall = slope[:, 1:] * (1.0 - half), slope[:, :-1] * (1.0 + half)
            matrix[:, whole, whole] = -rise - fall - drag
            matrix[:, whole[:-1], whole[1:]] = rise[:, :-1]
            matrix[:, whole[1:], whole[:-1]] = fall[:, 1:]
            step = np.linalg.solve(matrix[wrong], rest[wrong, :, None])[..., 0]
            # Bristles that turn make the slope jump; shorter steps do not go around.
            found[wrong, 1:-1] -= step * (1.0 if turn < 8 else 0.5)
        raise CableError("the nodes of a chain of bristles are not found.")


def end_stiffness(cable: Cable) -> float:
    """Return the stiffness of a piece of a chain [N/m]."""
    return (NODES + 1) * cable.axial_stiffness / cable.length


def can_have_chains(device: Device) -> bool:
    """Return whether all cables are in conduits, and soft enough for the time step."""
    model = DeviceModel.of(device)
    if any(cable.path != PATHS[0] for cable in model.cables.values()):
        return False
    for drive in model.drives(1.0):
        ends = [(end_stiffness(c.cable), c.proximal, c.distal) for c in drive.cables]
        motor = sum(stiff * near**2 for stiff, near, _ in ends) / drive.inertia
        joint = sum(stiff * far**2 for stiff, _, far in ends) / drive.joint_inertia
        if model.model.opt.timestep * max(motor, joint) ** 0.5 > MOST_TURN:
            return False
    return True


class BristleChains:
    """Chains of all cables of a batch; see `Batch.transmission`."""

    def __init__(
        self, batch: Batch, known: Sequence[Plant], seeds: Sequence[int]
    ) -> None:
        """Take over from the unplugged cables of a batch that has not started.

        `known` has the cables of each device, and `seeds` give their bends.
        """
        self._batch, self._model = batch, batch.devices[0].model
        names = batch.cables
        cables = [plant.cables[name] for plant in known for name in names]
        seeded = np.random.SeedSequence
        each = [
            int(seeded([seed, n]).generate_state(1)[0])
            for seed in seeds
            for n in range(len(names))
        ]
        self._chains = Chains.of(cables, each)
        self._applied = batch.simulations.batch.bind("qfrc_applied")
        outs = [reader.outputs for reader in batch.devices[0].readers.values()]
        self._outs = np.array(outs)  # (cables, 2)
        self._place: Array | None = None
        self._lean = np.zeros((len(cables), NODES))

    def _arms(self) -> Array:
        """Return what ends move by velocities, (devices, cables, 2, velocities)."""
        data, now = self._batch.simulations.batch, self._batch.simulations.physics
        arms = np.zeros((len(self._applied), *self._outs.shape, self._model.nv))
        first, count, at = (
            data.bind(f"moment_{name}")[0] for name in ("rowadr", "rownnz", "colind")
        )
        for place in np.ndindex(*self._outs.shape):
            out = self._outs[place]
            row = slice(first[out], first[out] + count[out])
            arms[:, *place, at[row]] = now.actuator_moment[:, row]
        return arms

    def pull(self) -> None:
        """Move the nodes to the present ends, and apply the tensions there."""
        now, model = self._batch.simulations.physics, self._model
        arms = self._arms()
        # Lengths are those before the last step of the physics.
        length = now.actuator_length[:, self._outs] - model.actuator_length0[self._outs]
        length = length + model.opt.timestep * np.einsum("nceq,nq->nce", arms, now.qvel)
        ends = length.reshape(-1, 2)
        if self._place is None:  # at rest: evenly stretched
            share = np.linspace(0.0, 1.0, NODES + 2)
            self._place = ends[:, :1] + share * np.diff(ends, axis=1)
        self._place, self._lean = self._chains.move(self._place, self._lean, ends)
        self._tension = self._chains.tensions(self._place)
        pulled = self._tension[:, [0, -1]] * (1.0, -1.0)
        self._torque = pulled.reshape(*length.shape, 1) * arms
        self._applied[:] = self._torque.sum(axis=(1, 2))

    def show(self, columns: dict[str, Any]) -> None:
        """Write the torques and tensions of the chains over those of the engine."""
        if self._place is None:
            self.pull()
        batch = self._batch
        acted = self._torque[:, :, 1].sum(axis=1)
        for axis, prefix in zip(batch.devices[0].axes, batch.prefixes, strict=True):
            columns[f"{prefix}joint_torque_nm"] = acted[:, axis.places.joint_v]
        each = self._tension.reshape(len(acted), len(batch.cables), NODES + 1)
        columns["least_tension_n"] = each.min(axis=2)
        columns["tension_n"] = each[:, :, [0, -1]].reshape(len(acted), -1)
        for place, name in enumerate(batch.cables):
            column = f"tension_{name}_nodes_n"
            count = columns[column].shape[1]
            nearest = np.linspace(0.0, NODES, count).round().astype(int)
            columns[column] = each[:, place, nearest]
