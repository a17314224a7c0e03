"""Friction at each bend of a tendon that a model already has.

python tendon_friction.py
"""

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import cc_mujoco

FINGER = """
<mujoco><option timestep="0.001"/>
  <worldbody>
    <site name="palm" pos="-.06 0 .012"/> <site name="knuckle" pos="-.005 0 .012"/>
    <body><joint name="base" axis="0 1 0" stiffness=".3" damping=".01"/>
      <geom type="capsule" fromto="0 0 0 .05 0 0" size=".008" mass=".03"/>
      <site name="phalanx" pos=".02 0 .012"/> <site name="middle" pos=".045 0 .012"/>
      <body pos=".05 0 0"><joint name="tip" axis="0 1 0" stiffness=".3" damping=".01"/>
        <geom type="capsule" fromto="0 0 0 .04 0 0" size=".007" mass=".02"/>
        <site name="hook" pos=".015 0 .012"/></body></body>
  </worldbody>
  <tendon><spatial name="cord"><site site="palm"/><site site="knuckle"/>
    <site site="phalanx"/><site site="middle"/><site site="hook"/></spatial></tendon>
  <actuator><motor name="pull" tendon="cord" gear="-1"/></actuator>
</mujoco>
"""


def pulled(friction):
    """Return pull and tip angle during one slow stroke to and fro."""
    spec = mujoco.MjSpec.from_string(FINGER)
    if friction:
        cc_mujoco.add_friction(spec, "cord", friction=friction)
    model = spec.compile()
    data = mujoco.MjData(model)
    pulls = 7.0 - 7.0 * np.cos(np.linspace(0.0, 2.0 * np.pi, 300))
    angles = []
    for pull in pulls:
        data.actuator("pull").ctrl = pull
        mujoco.mj_step(model, data, 10)
        angles.append(float(data.joint("tip").qpos[0]))
    return pulls, np.degrees(angles)


for friction in (0.0, 0.15):
    pulls, angles = pulled(friction)
    print(f"friction {friction:g}: the tip bends by {np.ptp(angles):.0f} deg")
    plt.plot(pulls, angles, label=f"friction {friction:g}")
plt.xlabel("pull [N]")
plt.ylabel("angle of the tip [deg]")
plt.legend()
plt.savefig("tendon_friction.png")
