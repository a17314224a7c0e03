"""Capstan tendons of newton on the CPU, by its solvers XPBD and VBD.

A bend is a roller, or `pinholes` points on its arc. A rope that never slips has
`mu` = 10, as in newton's examples. A drum is such a roller between the rope and a tail,
which a light weight keeps taut.
"""

from __future__ import annotations

import math

import newton
import numpy as np
import warp as wp

from tendon_suite.tasks import ALONG_Y, Array, Bend, Body, Machine, Setting, vector

wp.config.quiet = True
_STICKS, _TAIL = 10.0, 0.02
"""`mu` of a rope that does not slip, and the pull of the tail of a drum [N]."""


class _Simulation:
    def __init__(self, machine: Machine, setting: Setting) -> None:
        self.timestep, self.count = setting["timestep"], len(machine.bodies)
        bodies, bends, first = [*machine.bodies], [*machine.bends], machine.pull
        if machine.drum:
            on = bodies[0]
            quarter = math.pi / 2
            bends.insert(
                0, Bend(on.place, machine.drum, -quarter, quarter, body=on.name)
            )
            first = "tail", vector(np.add(bends[0].point(0.0), (0.0, 0.0, -1.0)))
            bodies.append(Body(*first, "slide", 5e-3))
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        index, places = {"": -1}, {"": np.zeros(3)}
        trees: dict[str, list[int]] = {}
        for body in bodies:
            places[body.name] = np.array(body.place)
            index[body.name] = builder.add_link(
                xform=wp.transform(body.place), mass=body.mass,
                inertia=wp.mat33(body.inertia * np.eye(3)), lock_inertia=True,
            )  # fmt: skip
            kind = {"slide": "prismatic", "hinge": "revolute"}[body.joint]
            joint = getattr(builder, f"add_joint_{kind}")(
                index[body.parent], index[body.name], axis=body.axis,
                parent_xform=wp.transform(places[body.name] - places[body.parent]),
            )  # fmt: skip
            trees[body.name] = trees.get(body.parent, [])
            trees[body.name].append(joint)
        for tree in {id(tree): tree for tree in trees.values()}.values():
            builder.add_articulation(tree)

        kinds, route, end = newton.TendonGuideType, [], None

        def guide(
            body: str, centre: Array, at: Array, leave: Array, **keys: object
        ) -> None:
            nonlocal end
            if end is not None:
                pull = _TAIL if machine.drum and len(route) == 1 else machine.tension
                stretched = float(np.linalg.norm(np.subtract(at, end)))
                keys |= {key: setting[key] for key in ("compliance", "damping")}
                keys["rest_length"] = stretched - setting["compliance"] * pull
            offset = vector(np.subtract(centre, places[body]))
            own = newton.TendonGuide(
                body=index[body], offset=offset, axis=ALONG_Y, **keys
            )
            route.append(own)
            end = leave

        guide(*first, first[1], first[1])
        for bend in bends:
            drum = bool(machine.drum) and bend is bends[0]
            mu = _STICKS if drum else setting["mu"] or min(machine.friction, _STICKS)
            pins = 0 if drum else setting["pinholes"]
            for at in map(bend.point, np.linspace(0.0, 1.0, pins)):
                guide(bend.body, at, at, at, mu=mu, guide_type=kinds.PINHOLE)
            if not pins:
                guide(
                    bend.body, bend.centre, bend.point(0.0), bend.point(1.0), mu=mu,
                    guide_type=kinds.ROLLER, radius=bend.radius,
                    orientation=int(math.copysign(1, bend.turn)),
                )  # fmt: skip
        guide(*machine.load, machine.load[1], machine.load[1])
        builder.add_tendon(route)
        builder.color()
        self.model = builder.finalize(device="cpu")
        solver = getattr(newton.solvers, f"Solver{setting['solver']}")
        self.solver = solver(self.model, **setting["options"])
        self.states = [self.model.state(), self.model.state()]
        self.joints = [
            wp.zeros(len(bodies), dtype=float, device="cpu") for _ in range(2)
        ]
        self.control = self.model.control()
        self.force = self.control.joint_f.numpy()  # a view
        self.force[:] = _TAIL

    def step(self, forces: Array) -> None:
        self.force[: self.count] = forces
        self.solver.step(*self.states, self.control, None, self.timestep)
        self.states.reverse()

    def state(self) -> tuple[Array, Array]:
        newton.eval_ik(self.model, self.states[0], *self.joints)
        place, speed = (joint.numpy()[: self.count].copy() for joint in self.joints)
        return place, speed


class _Engine:
    def __init__(self, solver: str, **options: float) -> None:
        self.best = {
            "solver": solver, "options": options, "timestep": 1e-3,
            "compliance": 1e-5, "damping": 1.0, "pinholes": 0, "mu": 0.0,
        }  # fmt: skip

    def settings(self, task: str, tune: bool) -> list[Setting]:
        return [self.best]

    def build(self, machine: Machine, setting: Setting) -> _Simulation:
        return _Simulation(machine, setting)


ENGINES = {
    "newton XPBD": _Engine("XPBD", iterations=8, joint_linear_relaxation=0.7),
    "newton VBD": _Engine("VBD", iterations=8, rigid_joint_linear_ke=1e6),
}
