"""A Bowden cable as an element of an MJCF file: what friction takes on the way.

python cable_in_mjcf.py
"""

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import cc_mujoco

SCENE = """
<mujoco><option timestep="0.0005"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="flexor">
    <config key="conduit" value="0.8:0.15 0.6:inf 0.6:0.4"/>
    <config key="axial_stiffness" value="4000"/> <config key="pretension" value="10"/>
    <config key="friction" value="0.1"/> <config key="segments" value="20"/>
  </instance></plugin></extension>
  <worldbody>
    <body><joint name="motor" armature="1e-4"/><geom size="0.02"/></body>
    <body pos="1 0 0"><joint name="wrist" stiffness="2" springref="-30" damping="0.02"/>
      <geom size="0.05"/></body>
  </worldbody>
  <actuator>
    <position joint="motor" kp="20" kv="0.1"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="motor" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="wrist" gear="-0.104"/>
  </actuator>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
times, proximal, distal = [], [], []
for _ in range(800):
    # The motor, a servo of its angle, winds the cable to and fro.
    data.ctrl[0] = 0.8 * np.sin(2.0 * np.pi * data.time)
    mujoco.mj_step(model, data, 5)
    cable = cc_mujoco.read(model, data, "flexor")
    times.append(data.time)
    proximal.append(cable.tension_proximal)
    distal.append(cable.tension_distal)
print(f"at the motor: {max(proximal):.1f} N, at the joint: {max(distal):.1f} N")

plt.plot(times, proximal, label="at the motor")
plt.plot(times, distal, label="at the joint")
plt.xlabel("time [s]")
plt.ylabel("tension [N]")
plt.legend()
plt.savefig("cable_in_mjcf.png")
