"""A band brake with a force at both ends of the band, as a rig to diagnose.

    python scripts/diagnosis_study/band_brake.py DATA --out runs/band
    cc-mujoco diagnose runs/band/band.xml runs/band/data --out runs/band/diagnosis

DATA holds recordings of the public repository ARTS-Laboratory/
Dataset-Friction-Damper-with-Backlash (D. Coble, P. Huggins, L. Cao, J. Ricles,
A. Downey, 2022; CC BY-SA 4.0) as `.npz` with an array `data` (samples, 6): time [s],
displacement at the rim [m], friction force [N], speed [m/s], force at either end of
the band [N].

Both ends of the band are held and the drum turns. Seen from the drum, the band is a
cable in a conduit whose two ends move alike, so the drum's angle is the angle of both
ends. Every preload is an occasion of its own.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np

RADIUS = 0.15  # radius of the drum [m]; only the displacement at its rim is measured
WRAP = 4.7
"""Angle that the band covers [rad]; only its product with friction can be fitted."""
SCENE = f"""<mujoco model="band brake">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.0001" integrator="implicitfast"/>
  <extension>
    <plugin plugin="cc_mujoco.cable">
      <instance name="band">
        <config key="conduit" value="{RADIUS * WRAP:g}:{RADIUS:g}"/>
        <config key="segments" value="20"/>
        <config key="axial_stiffness" value="1e5"/>
        <config key="pretension" value="500"/>
        <config key="friction" value="0.5"/>
      </instance>
    </plugin>
  </extension>
  <worldbody>
    <body name="end_2">
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <joint name="end_2" type="hinge" axis="1 0 0"/>
    </body>
    <body name="end_1" pos="0 1 0">
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <joint name="end_1" type="hinge" axis="-1 0 0"/>
    </body>
  </worldbody>
  <actuator>
    <plugin name="band_proximal" joint="end_2" gear="-{RADIUS:g}"
      plugin="cc_mujoco.cable" instance="band"/>
    <plugin name="band_distal" joint="end_1" gear="-{RADIUS:g}"
      plugin="cc_mujoco.cable" instance="band"/>
  </actuator>
</mujoco>
"""
DATASET = """name = "band brake"

[columns.motor_angle_rad]       # the drum turns under both ends alike
name = "drum_angle_rad"

[columns.joint_angle_rad]
name = "drum_angle_rad"

[columns.tension_proximal_n]    # zeros of the cells drift by tens of newtons
noise = 15

[columns.tension_distal_n]
noise = 15

[rig]                           # the tension at rest is that of the slack end only
pretension = { value = 500, uncertainty = 500 }
friction = { value = 0.9, uncertainty = 0.1 }   # the slack end is within its zero: the
                                # ratio of the forces is only known to be about 70
"""
HEAD = "time_s,drum_angle_rad,tension_proximal_n,tension_distal_n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/band"))
    parser.add_argument("--only", default=".", help="pattern of the recordings")
    parser.add_argument("--seconds", type=float, default=1e9, help="of each, at most")
    given = parser.parse_args()
    (given.out / "data").mkdir(parents=True, exist_ok=True)
    (given.out / "band.xml").write_text(SCENE, encoding="utf-8")
    facts = [DATASET]
    for path in sorted(given.folder.glob("*.npz")):
        if not re.search(given.only, path.name):
            continue
        time, place, _, _, end_1, end_2 = np.load(path)["data"].T.astype(float)
        keep = time - time[0] <= given.seconds
        rows = np.array([time - time[0], place / RADIUS, end_2, end_1]).T[keep]
        name = path.stem.replace("characterization_datasets__", "").replace(".", "p")
        file = given.out / "data" / f"{name}.csv"
        form = ["%.5f", "%.7f", "%.2f", "%.2f"]
        np.savetxt(file, rows, form, ",", header=HEAD, comments="")
        load = re.search(r"(\d+)lb", path.name)
        if load:
            facts.append(f'[trials."{name}"]\noccasion = "{load[1]} lb"\n')
    text = "\n".join(facts)
    (given.out / "data" / "dataset.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
