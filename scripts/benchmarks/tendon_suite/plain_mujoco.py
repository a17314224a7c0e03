"""Spatial tendons of MuJoCo, with the constant dry friction that an expert would add.

A spatial tendon has one tension. Its own `frictionloss` acts on its length, which does
not change where a rope runs over a bend; so the friction is on the joint `pull`, that
of a rope on a pulley on a fixed tendon, their slip. Lengths are equalities.
"""

from __future__ import annotations

import mujoco
import numpy as np

from tendon_suite.tasks import NO_SLIP, Array, Engine, Machine, Setting

ROPE = "rope"
_EQUALITY = {"type": mujoco.mjtEq.mjEQ_TENDON, "objtype": mujoco.mjtObj.mjOBJ_TENDON}


def specify(machine: Machine, timestep: float) -> mujoco.MjSpec:
    """Return the machine with its rope as a plain spatial tendon."""
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    bodies, places, parents = {"": spec.worldbody}, {"": np.zeros(3)}, {"": ""}
    for body in machine.bodies:
        places[body.name], parents[body.name] = np.array(body.place), body.parent
        bodies[body.name] = bodies[body.parent].add_body(
            name=body.name, pos=places[body.name] - places[body.parent],
            mass=body.mass, inertia=[body.inertia] * 3, ipos=np.zeros(3),
            explicitinertial=True,
        )  # fmt: skip
        kind = getattr(mujoco.mjtJoint, f"mjJNT_{body.joint.upper()}")
        bodies[body.name].add_joint(name=body.name, type=kind, axis=body.axis)

    def site(name: str, body: str, place: Array) -> str:
        bodies[body].add_site(name=name, pos=np.subtract(place, places[body]))
        return name

    rope = spec.add_tendon(name=ROPE)
    first, place = machine.pull
    rope.wrap_site(site("first", parents[first] if machine.drum else first, place))
    for i, bend in enumerate(machine.bends):
        if i:  # MuJoCo wants a site between two geoms; it lies on the straight piece
            between = 0.5 * (machine.bends[i - 1].point(1.0) + bend.point(0.0))
            rope.wrap_site(site(f"between{i}", bend.body, between))
        bodies[bend.body].add_geom(
            name=f"bend{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[bend.radius, 0.5, 0.0], pos=bend.centre - places[bend.body],
            quat=[1.0, 1.0, 0.0, 0.0], mass=0.0, contype=0, conaffinity=0,
        )  # fmt: skip
        # A side that turned with a pulley would lead the path around the other side.
        on = parents[bend.body] if machine.turns(bend) else bend.body
        rope.wrap_geom(f"bend{i}", site(f"side{i}", on, bend.point(0.5, 3.0)))
    rope.wrap_site(site("last", *machine.load))
    return spec


class InMuJoCo:
    """Simulation of a machine by MuJoCo; see `Simulation` in `tasks.py`."""

    def __init__(self, machine: Machine, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.timestep = float(model.opt.timestep)
        joints = [model.joint(body.name) for body in machine.bodies]
        self.place = [int(joint.qposadr[0]) for joint in joints]
        self.dof = [int(joint.dofadr[0]) for joint in joints]

    def step(self, forces: Array) -> None:
        self.data.qfrc_applied[self.dof] = forces
        mujoco.mj_step(self.model, self.data)

    def state(self) -> tuple[Array, Array]:
        return self.data.qpos[self.place], self.data.qvel[self.dof]


class _Simulation(InMuJoCo):
    def __init__(self, machine: Machine, setting: Setting) -> None:
        spec = specify(machine, setting["timestep"])
        hard = [2.0 * setting["timestep"], 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0]
        stiff = _EQUALITY | dict(zip(("solref", "solimp"), hard, strict=True))
        length = spec.add_equality(name1=ROPE, **stiff)
        if machine.drum:
            wound = spec.add_tendon(name="wound")
            wound.wrap_joint("pull", -machine.drum)
            length.name2, length.data[1] = "wound", 1.0
        rubbing, loss = spec.joint("pull"), setting["frictionloss"]
        for bend in filter(machine.turns, machine.bends):
            rubbing = spec.add_tendon(name="slip")
            rubbing.wrap_joint("load", 1.0)
            rubbing.wrap_joint(bend.body, -np.sign(bend.turn) * bend.radius)
        if machine.friction == NO_SLIP:
            spec.add_equality(name1="slip", **stiff)
        else:
            rubbing.frictionloss = loss * (machine.drum or 1.0)
            rubbing.solref_friction, rubbing.solimp_friction = hard
        super().__init__(machine, spec.compile())


_BEST = {
    "capstan": 20.0, "turning pulley": 10.0, "ladder": 40.0, "cycles": 6.33,
    "helix": 15.9, "finger": 0.796, "hoist": 10.0,
}  # fmt: skip
"""Dry friction by task [N]; `noslip_iterations` change none of the errors."""


def _settings(task: str, tune: bool) -> list[Setting]:
    tried = np.geomspace(0.1, 40.0, 27).round(3) if tune else []
    losses = [_BEST.get(task, 0.0), *map(float, tried)]
    return [{"timestep": 1e-3, "frictionloss": loss} for loss in losses]


ENGINES = {"mujoco": Engine(_settings, _Simulation)}
