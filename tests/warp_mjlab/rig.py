"""A rig of two motors, a wrist and a lever, in mjlab and in MuJoCo with the plugin.

    python tests/warp_mjlab/rig.py OUT.npy

writes the tensions (steps, cables, 2) [N] of the plugin for the commands of `efforts`.
"""

from __future__ import annotations

import sys

import mujoco
import numpy as np

from cc_mujoco.cable import Cable, Section

MJCF = """
<mujoco>
  <worldbody>
    <body name="stand">
      <geom type="box" size="0.05 0.05 0.05" pos="0 0 -0.5" contype="0"
        conaffinity="0"/>
      <site name="exit" pos="0.2 0 0.1"/>
      <body name="drum" pos="0 0.1 0"><joint name="motor" axis="0 1 0" armature="5e-4"
        damping="0.02"/><geom type="cylinder" size="0.02 0.01" mass="0.2" contype="0"
        conaffinity="0"/></body>
      <body name="winch" pos="0 -0.1 0"><joint name="second" axis="0 1 0"
        armature="1e-3" damping="0.02"/><geom type="cylinder" size="0.02 0.01"
        mass="0.2" contype="0"
        conaffinity="0"/></body>
      <body name="hand" pos="0.3 0.1 0"><joint name="wrist" axis="0 1 0" damping="0.1"
        stiffness="3"/><geom type="box" size="0.04 0.04 0.02" mass="0.5" contype="0"
        conaffinity="0"/></body>
      <body name="lever" pos="0.3 -0.1 0"><joint name="hinge" axis="0 1 0" damping="0.1"
        stiffness="5"/><geom type="box" size="0.08 0.02 0.02" mass="0.5" contype="0"
        conaffinity="0"/><site name="tip" pos="-0.08 0 0"/></body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope"><site site="exit"/><site site="tip"/></spatial>
  </tendon>
</mujoco>
"""
CABLES = {
    "flexor": Cable(friction=0.15, segments=12, conduit=(Section(1.0, 0.3),)),
    "puller": Cable(
        friction=0.1, viscous_friction=20.0, segments=16, conduit=(Section(1.5, 0.5),)
    ),
}
ENDS = {
    "flexor": (("motor", -0.02), ("wrist", -0.06)),
    "puller": (("second", -0.02), ("rope", 1.0)),
}
"""Joint or tendon and gear at the proximal and distal end of each cable."""
SIGN = {"proximal": 1.0, "distal": -1.0}
"""Sign of the force of an end that is its tension."""
STEP, DECIMATION, ACTIONS = 1e-3, 5, 120


def efforts(action: int) -> list[float]:
    """Return the torques of both motors during an action [N m]."""
    time = action * DECIMATION * STEP
    return [0.4 - 0.3 * np.cos(9 * time), 0.3 * np.sin(7 * time) + 0.35]


def plugin_tensions() -> np.ndarray:
    """Return the tensions (steps, cables, 2) of the plugin [N]."""
    from cc_mujoco.plugin import to_mjcf

    spec = mujoco.MjSpec.from_string(MJCF)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in ("motor", "second"):
        spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    for name, cable in CABLES.items():
        to_mjcf(spec, name, cable, *ENDS[name])
    model = spec.compile()
    data = mujoco.MjData(model)
    found = []
    for action in range(ACTIONS):
        data.ctrl[:2] = efforts(action)
        for _ in range(DECIMATION):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        # A reading is of the step before; the forces are of now.
        for name in CABLES:
            pulls = (data.actuator(f"{name}_{end}").force[0] for end in SIGN)
            found.append(
                [sign * pull for sign, pull in zip(SIGN.values(), pulls, strict=True)]
            )
    return np.array(found).reshape(ACTIONS, len(CABLES), 2)


if __name__ == "__main__":
    np.save(sys.argv[1], plugin_tensions())
