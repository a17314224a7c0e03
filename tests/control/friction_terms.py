"""Every friction term of the library at every device, small and large.

A controller drives the device with a model that knows the term or with one that does
not. Sensors have the device's noise. A row passes where the joint torque exceeds by no
more than `MARGIN` the largest desired torque, or else what the same device has with its
motor let go, and is never unsafe, unless that device is: that much friction alone makes
unavoidable.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.benchmark import WARM_UP
from cc_mujoco.cable import PARAMETERS
from cc_mujoco.control import Unpowered, controller
from cc_mujoco.control._registry import batched_controller
from cc_mujoco.device import Drive, Measuring, Plant, load_device
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import first_unsafe_sample
from cc_mujoco.simulation import Batch, WornDevice

Term = Mapping[str, float]

LARGE: dict[str, Term] = {
    "none": {},
    "static": {"static_friction": 0.4, "critical_slip_distance": 2e-3},
    "viscous": {"viscous_friction": 30.0},
    "grease": {"grease_drag": 5.0},
    "stribeck": {"stribeck_friction": 0.1},
    "load-independent": {"load_independent_friction": 10.0},
    "seals": {"seal_proximal": 15.0, "seal_distal": 15.0},
    "asymmetric": {"friction_asymmetry": 0.4},
    "bristles": {"bristle_length": 5e-4},
    "tension": {"tension_exponent": -0.3},
    "ageing": {"ageing_friction": 0.05, "ageing_time": 0.1},
    "wrap": {"wrap_growth": 30.0},
    "drift": {"friction_drift": 0.2},
    "heating": {"friction_heating": 0.2, "cooling_time": 2.0},
}
"""Friction terms at a size that is large for every device; that of heating counts per
`torque_scale` of the device, as its heat does."""

_ABOVE = {"static_friction"}
"""Terms whose size counts from the friction of the cable on."""
SHARES = 0.02, 1.0  # sizes that are tried, over the large one
MARGIN = 1.1  # joint torque over the largest of desired and unavoidable that passes
DRAG = "viscous", "grease", "load-independent", "seals"  # terms that need no tension


class Row(NamedTuple):
    """Outcome of one episode; torques are largest sizes at the joint [N m]."""

    scene: str
    controller: str
    term: str
    share: float
    known: bool
    rms_error: float
    torque: float
    desired: float
    unavoidable: float
    safe: float
    unsafe: bool

    @property
    def stayed_safe(self) -> bool:
        """Return whether the torque was safe, or friction alone made it unsafe."""
        return not self.unsafe or self.unavoidable > self.safe

    @property
    def passed(self) -> bool:
        """Return whether the joint was not pulled harder than it should be."""
        return self.stayed_safe and self.torque <= MARGIN * max(
            self.desired, self.unavoidable
        )


def sized(term: Term, share: float) -> dict[str, float]:
    """Return a term at a share of its size; lengths and times stay."""
    units = {parameter.name: parameter.unit for parameter in PARAMETERS}
    shapes = {"cooling_time", "ageing_time", "critical_slip_distance", "bristle_length"}
    return {
        name: value if name in shapes else share * value
        for name, value in term.items()
        if name in units
    }


def designs(scene: str, terms: Sequence[str], shares: Sequence[float]) -> list[Any]:
    """Return name, share and design of every device that can be built."""
    device, found = load_device(scene), []
    for name in terms:
        for share in shares if LARGE[name] else (1.0,):
            design = sized(LARGE[name], share)
            if scene == "finger":  # an open path has no seals
                design = {k: v for k, v in design.items() if "seal" not in k}
                if not design and LARGE[name]:
                    continue
            if "friction_heating" in design:
                design["friction_heating"] /= device.description.axis().torque_scale
            design = {
                f"{cable}.{key}": value + (own.friction if key in _ABOVE else 0.0)
                for cable, own in device.cables.items()
                for key, value in design.items()
            }
            found.append((name, share, design))
    return found


def play(
    scene: str,
    law: str,
    cases: Sequence[Any],
    known: bool,
    duration: float,
    seed: int = 0,
) -> list[Row]:
    """Return what becomes of devices with the terms of `designs`, all at once.

    `known` is whether the controller's model has the terms; devices whose terms it
    refuses are left out.
    """
    device = load_device(scene)
    setup = device.description
    axis = setup.axis()

    def exo(design: Term) -> WornDevice:
        model = Plant(device, design).model()
        return WornDevice(setup, model, duration=duration)

    exos = [exo(design) for _, _, design in cases]
    first, count = exos[0], len(exos)
    drives = [one.drive for one in exos]
    if not known:
        believed = exo({}).drive.cables
        drives = [dataclasses.replace(one, cables=believed) for one in drives]
    kept_back = [_refuses(law, setup.sensing.equip(drive)) for drive in drives]
    if any(kept_back):  # a model that has no place for such a term
        cases = [c for c, no in zip(cases, kept_back, strict=True) if not no]
        return play(scene, law, cases, known, duration, seed) if cases else []
    kept = "joint_torque_nm", "desired_torque_nm"
    columns = []
    for name in (law, None):
        variants = [one.device for one in exos]
        batch = Batch([first], [seed], variants, name=name or "")
        measuring = Measuring(
            setup.sensing, drives[0], *first.device.driven, [seed] * count, batch.steps
        )
        control = (
            Unpowered(drives[0])
            if name is None
            else batched_controller(name, [[one] for one in drives], ("",))
        )
        columns.append(batch.play(control, measuring.measure, kept))
    start = round(min(WARM_UP, 0.5 * duration) / first.period)
    torque, desired = (columns[0][name][start:] for name in kept)
    free = columns[1][kept[0]][start:]
    rows = []
    for k, (term, share, _) in enumerate(cases):
        error = torque[:, k] - desired[:, k]
        rows.append(
            Row(
                scene,
                law,
                term,
                share,
                known,
                float(np.sqrt(np.mean(error**2))),
                float(np.max(np.abs(torque[:, k]))),
                float(np.max(np.abs(desired[:, k]))),
                float(np.max(np.abs(free[:, k]))),
                axis.safe_torque,
                first_unsafe_sample(torque[:, k], axis.safe_torque, first.period)
                is not None,
            )
        )
    return rows


def _refuses(law: str, drive: Drive) -> bool:
    try:
        controller(law, drive)
    except CableError:
        return True
    return False
