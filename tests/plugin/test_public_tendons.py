"""Motion of public models whose tendons have become cables, and the capstan's law.

The hand is the Aero Hand Open of TetherIA (MuJoCo Playground, MuJoCo Menagerie), the
torso is of `myo_sim`; tests are skipped where they are not installed. Their meshes may
be absent.
"""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.plugin import cables, read, segment_wrap

Array = np.ndarray
HAND = (
    "if_tendon0", "mf_tendon0", "rf_tendon0", "pf_tendon0", "th_tendon1", "th_tendon2",
)  # fmt: skip
"""Driven tendons of the hand."""
BANDS = ("Exo_LS_RL", "Exo_RS_LL")  # elastic bands of the exosuit on the torso


def load(file: str | Path) -> mujoco.MjSpec:
    """Return a model without its meshes and contacts, whose bodies keep their mass."""
    spec = mujoco.MjSpec.from_file(str(file))
    for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for kind in (spec.meshes, spec.textures, spec.skins):
        for asset in list(kind):
            spec.delete(asset)
    for geom in spec.geoms:
        geom.material = ""
        geom.contype = geom.conaffinity = 0
    for other in (*spec.sites, *spec.tendons):
        other.material = ""
    for pair in list(spec.pairs):
        spec.delete(pair)
    for material in list(spec.materials):
        spec.delete(material)
    spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-4)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-7)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec


def spiral(links: int = 10, angle: float = math.radians(30.0)) -> mujoco.MjSpec:
    """Return an arm that curls to a logarithmic spiral r = a exp(b angle).

    A spiral of which every link turns by the same angle has links in geometric
    progression (SpiRobs: Wang, Freris and Wei, Device 3, 2025). A cord along its inside
    is pulled by a motor; joints resist like a beam, by the cube of their width.
    """
    ratio = math.exp(-0.1 * angle * 3.0)
    size, body = 0.05, None
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = 2e-4, [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    cord = spec.add_tendon(name="cord")
    cord.wrap_site(spec.worldbody.add_site(name="mouth", pos=[-0.01, 0, 0.02]).name)
    body = spec.worldbody
    place = 0.0
    for i in range(links):
        body = body.add_body(pos=[place, 0.0, 0.0])
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.5 * size, 0, 0],
            size=[0.45 * size, 0.2 * size, 0.3 * size], contype=0, conaffinity=0,
        )  # fmt: skip
        stiffness = 0.2 * (size / 0.05) ** 3
        body.add_joint(
            name=f"joint_{i}", axis=[0, -1, 0], range=[-0.05, angle],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, stiffness=[stiffness, 0, 0],
            damping=[0.05 * stiffness, 0, 0], armature=1e-5,
        )  # fmt: skip
        for k, share in enumerate((0.2, 0.8)):
            site = body.add_site(
                name=f"hole_{i}_{k}", pos=[share * size, 0, 0.4 * size]
            )
            cord.wrap_site(site.name)
        place, size = size, size * ratio
    motor = spec.add_actuator(name="motor", target="cord")
    motor.trntype = mujoco.mjtTrn.mjTRN_TENDON
    motor.set_to_motor()
    motor.gear[0] = -1.0
    return spec


def play(model: mujoco.MjModel, command: Array, time: float = 2.0) -> Array:
    """Return the joint angles over a time in which a command is ramped (k, joints).

    `command` is that at the beginning and that from half of the time on (2, n).
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hinges = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE]
    steps = round(time / model.opt.timestep)
    found = np.empty((steps, hinges.size))
    for step in range(steps):
        share = min(2.0 * step / steps, 1.0)
        data.ctrl[: command.shape[1]] = command[0] + share * (command[1] - command[0])
        mujoco.mj_step(model, data)
        found[step] = data.qpos[hinges]
    return found


def capstan_error(model: mujoco.MjModel, command: Array, friction: float) -> float:
    """Return the largest error of exp(-friction turn) over cables that slide.

    The error of the last piece's share of the first one's tension, while the command is
    ramped. The share is compared wherever every segment that turns slips towards the
    motor, or infinite if none ever does.
    """
    data = mujoco.MjData(model)
    steps, worst, found = round(1.0 / model.opt.timestep), 0.0, False
    for step in range(steps):
        share = (step + 1) / steps
        data.ctrl[: command.shape[1]] = command[0] + share * (command[1] - command[0])
        mujoco.mj_step(model, data)
        for name in cables(model):
            cable = read(model, data, name)
            bent = segment_wrap(model, data, name) > 1e-9
            if (
                cable.tension_distal > 0.1
                and bent.any()
                and np.all(cable.slip[bent] < 0)
            ):
                turn = float(segment_wrap(model, data, name).sum())
                share = cable.tension_distal / cable.tension_proximal
                worst = max(worst, abs(share / math.exp(-friction * turn) - 1.0))
                found = True
    return worst if found else math.inf


def taken(
    spec: mujoco.MjSpec, tendons: tuple[str, ...], friction: float
) -> mujoco.MjModel:
    """Return a model whose tendons have become cables."""
    tried = spec.copy()
    for tendon in tendons:
        cc_mujoco.add_friction(tried, tendon, friction=friction)
    return tried.compile()


def closing(model: mujoco.MjModel) -> Array:
    """Return the commands of the open and of the closed hand (2, actuators)."""
    low = model.actuator_ctrlrange[:, 0]
    wound = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    rest = model.tendon_length0[model.actuator_trnid[:, 0]]
    return np.where(wound, [rest, low], 0.0)


def installed(package: str, file: str) -> Path:
    """Return a file of a package; skips the test where it is not installed."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        pytest.skip(f"{package} is not installed")
    place = Path(found.origin).parent / file
    if not place.exists():
        pytest.skip(f"{package} has no {file}")
    return place


def test_a_spiral_arm_curls_as_before_and_loses_the_capstan_s_share() -> None:
    spec, command = spiral(links=5), np.array([[0.0], [4.0]])
    before = play(spec.compile(), command, 0.2)
    after = play(taken(spec, ("cord",), 0.0), command, 0.2)
    assert np.ptp(before) > 0.2
    assert np.abs(after[:, : before.shape[1]] - before).max() < 1e-3
    assert capstan_error(taken(spec, ("cord",), 0.1), command, 0.1) < 1e-4


@pytest.mark.filterwarnings("ignore::cc_mujoco.errors.CableWarning")
def test_an_aero_hand_closes_as_before_and_loses_the_capstan_s_share() -> None:
    place = "_src/manipulation/aero_hand/xmls/right_hand.xml"
    spec = load(installed("mujoco_playground", place))
    command = closing(spec.compile())
    before = play(spec.compile(), command)
    after = play(taken(spec, HAND, 0.0), command)
    assert np.ptp(before[:, 0]) > 1.5
    assert np.abs(after[-1, : before.shape[1]] - before[-1]).max() < 0.02
    assert capstan_error(taken(spec, HAND, 0.1), command, 0.1) < 2e-3


def test_the_bands_of_an_exosuit_hold_a_torso_as_before() -> None:
    spec = load(installed("myosuite", "simhive/myo_sim/torso/myotorso_exosuit.xml"))
    command = np.zeros((2, 0))
    before = play(spec.compile(), command)
    after = play(taken(spec, BANDS, 0.0), command)
    assert np.abs(after[:, : before.shape[1]] - before).max() < 1e-3
    assert math.isfinite(before.max())
