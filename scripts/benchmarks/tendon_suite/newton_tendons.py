"""Capstan tendons of newton on the CPU, by its solvers XPBD and VBD.

A bend is a roller, or `pinholes` points on its arc. A rope that never slips has
`mu` = 10, as in newton's examples. A drum is such a roller between the rope and a tail,
which a light weight keeps taut.
"""

from __future__ import annotations

import math
from functools import partial

import newton
import numpy as np
import warp as wp

from tendon_suite.tasks import (
    ALONG_Y,
    Array,
    Bend,
    Body,
    Engine,
    Machine,
    Setting,
    vector,
)

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
        self.solver = solver(
            self.model, iterations=setting["iterations"], **setting["options"]
        )
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


_FIRST = {"timestep": 1e-3, "iterations": 8, "damping": 1.0, "pinholes": 0, "mu": 0.0}
_FINE = {"tendon_settle_tol": 1e-6}
_STIFF = {"rigid_joint_linear_ke": 1e6}
_FULL = {"joint_linear_relaxation": 1.0, "joint_angular_relaxation": 1.0}
_XPBD = {
    "": {"solver": "XPBD", "compliance": 1e-5, "options": {}},
    "turning pulley": {"mu": 10.0},
    "ladder": {"options": _FINE},
    "helix": {"pinholes": 5},
    "finger": {"compliance": 1e-3, "damping": 0.0, "options": _FULL},
    "hoist": {"timestep": 2e-4, "compliance": 2e-4},
}
_VBD = {
    "": {"solver": "VBD", "compliance": 1e-4, "options": _STIFF},
    "turning pulley": {"mu": 10.0},
    "ladder": {"compliance": 1e-5, "options": _STIFF | _FINE},
    "cycles": {"compliance": 3e-5},
    "helix": {"pinholes": 5, "compliance": 1e-5},
    "hoist": {"compliance": 5e-4},
}
_TRIED = [
    {"iterations": 4}, {"iterations": 32}, {"timestep": 5e-4}, {"timestep": 2e-4},
    {"compliance": 1e-5}, {"compliance": 1e-4}, {"pinholes": 5}, {"mu": 10.0},
]  # fmt: skip


def _settings(best: dict[str, Setting], task: str, tune: bool) -> list[Setting]:
    first = _FIRST | best[""] | best.get(task, {})
    return [first, *(first | change for change in _TRIED if tune)]


ENGINES = {
    "newton XPBD": Engine(partial(_settings, _XPBD), _Simulation),
    "newton VBD": Engine(partial(_settings, _VBD), _Simulation),
}
