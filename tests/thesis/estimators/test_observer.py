"""A model of the cable that tension sensors correct."""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import Cable, Section, replay
from cc_mujoco.device import Sensors
from thesis.estimators._directions import observe

CABLE = Cable(friction=0.21, conduit=(Section(2.0, 0.28),), segments=10, pretension=20)


def test_observer_follows_without_directions_and_within_the_noise() -> None:
    dt = 0.005
    time = np.arange(0.0, 3.0, dt)
    proximal = -0.02 * np.sin(np.pi * time)
    distal = -0.012 * np.sin(np.pi * time)
    true = replay(CABLE, dt, u_proximal=proximal, u_distal=distal, profile=True)
    assert true.tension is not None and true.direction is not None
    random = np.random.default_rng(6)
    reading = true.tension + random.normal(size=true.tension.shape)
    sensors = Sensors.everywhere(CABLE, 1.0)
    output = observe(CABLE, sensors, dt, proximal, reading, 300.0)[:, -1]
    assert np.sqrt(np.mean((output - true.tension[:, -1]) ** 2)) < 1.0
