"""Devices: what a scene tells, what its description gives, and what is refused."""

from __future__ import annotations

import pickle
import warnings
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco import Plant, Trajectory, cli, simulate
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.device import Device, DeviceModel, find_device, load_device
from cc_mujoco.device._report import account, write_description
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import TRAJECTORIES, Hold
from cc_mujoco.human._motion import Motion
from cc_mujoco.native import FloatArray
from tests.shared_folder import ABSENT, SHARED

KNEE = """
<mujoco>
  <compiler autolimits="true" angle="{angle}"/>
  <option timestep="{timestep}"><flag contact="disable"/></option>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="cord">
    <config key="conduit" value="0.3:0.12 0.2:inf"/>
    <config key="axial_stiffness" value="30000"/>
    <config key="friction" value="0.1"/>
    <config key="pretension" value="8"/>
  </instance></plugin></extension>
  <worldbody>
    <body pos="-.2 0 1"><joint name="drum" axis="0 1 0" armature="1e-3" damping=".02"/>
      <geom type="cylinder" size=".02 .01"/></body>
    <body name="thigh" pos="0 0 1">{root}<geom size=".05" mass="5"/>
      <site name="clamp" pos=".09 0 -.3"/>
      <body name="shank" pos="0 0 -.4"><joint name="knee" axis="0 1 0" {knee}/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass="4"/>
        <site name="lever" pos=".09 0 -.02"/></body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope"><site site="clamp"/><site site="lever"/></spatial>
  </tendon>
  <actuator>
    {motor}
    {wearer}
    <plugin plugin="cc_mujoco.cable" instance="cord" joint="drum" gear="{gear}"/>
    <plugin plugin="cc_mujoco.cable" instance="cord" tendon="rope" gear="1"/>
  </actuator>
</mujoco>
"""
PARTS = {
    "angle": "radian",
    "timestep": "0.001",
    "root": "",
    "knee": 'range="0 2"',
    "motor": '<motor name="m" joint="drum" ctrlrange="-15 15"/>',
    "wearer": '<position name="human" joint="knee" kp="300" kv="6"/>',
    "gear": "-.02",
}


@dataclass(frozen=True)
class Still(Trajectory):
    """No motion, at an angle."""

    at: float

    def _motion(
        self, time: FloatArray, duration: float, rng: np.random.Generator
    ) -> Motion:
        still = np.zeros_like(time)
        return Motion(time, still + self.at, still, still, time / (duration + 1.0))


def knee(folder: Path, description: str = "", **changes: str) -> Path:
    """Write a scene, and its description, and return its path."""
    path = folder / "knee.xml"
    path.write_text(KNEE.format(**{**PARTS, **changes}))
    if description:
        (folder / "knee.device.toml").write_text(description)
    return path


@pytest.mark.parametrize("name", SCENES)
def test_built_in_devices_load_without_a_warning_and_name_what_exists(
    name: str,
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        device = Device(name)
    description = device.description
    assert description.scene == name
    spec = mujoco.MjSpec.from_file(str(scene_path(name)))
    for axis in description.axes:
        assert spec.joint(axis.joint) is not None
        assert spec.actuator(axis.motor) is not None
        assert all(spec.site(site) is not None for site in axis.lever)
        assert set(axis.units) <= set(MEASURED_COLUMNS)
    for joint, actuator in description.movers.items():
        assert spec.joint(joint) is not None
        assert spec.actuator(actuator) is not None
    assert description.trajectory in TRAJECTORIES


def test_a_scene_tells_motor_joint_wearer_and_ranges(tmp_path: Path) -> None:
    axis = Device(knee(tmp_path)).description.axis()
    assert (axis.motor, axis.drum, axis.joint) == ("m", "drum", "knee")
    assert (axis.name, axis.cables, axis.lever) == ("knee", ("cord",), ("lever",))
    assert (axis.torque, axis.pull_pull) == (15.0, False)
    low, high = axis.centre - axis.reach, axis.centre + axis.reach
    assert 0.0 < low < high < 2.0
    device = Device(knee(tmp_path))
    assert device.description.movers == {"knee": "human"}
    assert device.wearers["knee"].stiffness == 300.0
    model = DeviceModel(device.description, device.spec.compile())
    assert model.axes[0].ratio == pytest.approx(-0.09 / 0.02, rel=0.05)


def test_a_scene_in_degrees_is_the_same_device(tmp_path: Path) -> None:
    first = Device(knee(tmp_path)).description.axis()
    degrees = knee(tmp_path, angle="degree", knee=f'range="0 {np.degrees(2.0)}"')
    second = Device(degrees).description.axis()
    assert second.reach == pytest.approx(first.reach)
    assert second.centre == pytest.approx(first.centre)


def test_a_description_beside_the_scene_and_arguments_take_precedence(
    tmp_path: Path,
) -> None:
    path = knee(tmp_path, 'trajectory = "reach"\n[axis]\nsafe_torque = 40\n')
    assert Device(path).description.axis().safe_torque == 40.0
    assert Device(path).description.trajectory == "reach"
    changed = Device(path, axis={"safe_torque": 30.0}, rope={"diameter": 2e-3})
    assert changed.description.axis().safe_torque == 30.0
    assert changed.description.diameter == 2e-3
    assert changed.description.trajectory == "reach"
    by_file = Device(tmp_path / "knee.device.toml")
    assert by_file.description.axis() == Device(path).description.axis()


@pytest.mark.parametrize("own", [True, False])
def test_arguments_travel_with_a_device_to_other_processes(
    own: bool, tmp_path: Path
) -> None:
    source = knee(tmp_path, "[axis]\n") if own else "wrist"
    first = Device(source, axis={"cuff": {"stiffness": 400.0}, "safe_torque": 21.0})
    again = pickle.loads(pickle.dumps(first))
    assert again.description == first.description
    assert again.description.axes[0].safe_torque == 21.0
    assert again.xml() == first.xml() != Device(source).xml()


def test_what_nobody_says_is_unknown_and_listed_as_missing(tmp_path: Path) -> None:
    device = Device(knee(tmp_path))
    axis = device.description.axis()
    assert axis.safe_is_assumed
    demand = abs(float(axis.task.partition(":")[2]))
    assert axis.safe_torque == axis.slip.safe_torque(demand) >= 2.0 * demand
    assert np.isnan(device.description.strength)
    text = account(device)
    missing = text[text.index("missing") :]
    for key in ("rope.strength", "rope.diameter"):
        assert key in missing
    assert "safe_torque" not in missing


@pytest.mark.parametrize("scene", ["wrist", "exosuit"])
def test_an_account_of_several_axes_says_whose_each_value_is(scene: str) -> None:
    device = find_device(scene)
    names = [line.split()[0] for line in account(device).splitlines() if line]
    for axis in device.description.axes:
        own = axis.name if len(device.description.axes) > 1 else "axis"
        assert names.count(f"{own}.reach") == names.count(f"{own}.task") == 1
        assert names.count(f"{own}.observation.twist") == 1


@pytest.mark.parametrize(
    ("gear", "sense"), [("-0.02", "positive"), ("0.02", "negative")]
)
def test_an_account_says_which_way_a_cable_pulls(
    tmp_path: Path, gear: str, sense: str
) -> None:
    text = account(Device(knee(tmp_path, gear=gear)))
    assert f"cable cord is wound as drum turns in the {sense} sense" in text
    # The lever is in front of the knee, whose axis points to the left.
    assert "and pulls knee towards negative angles" in text


@pytest.mark.parametrize(
    ("written", "sentence"),
    [
        ('"friction" value="-1"', "'-1'; it must be a number in [0, 5]"),
        ('"frictoin" value="0.1"', "'frictoin' in a cable: did you mean 'friction'"),
    ],
)
def test_a_bad_key_of_a_cable_is_one_sentence_once(
    tmp_path: Path, written: str, sentence: str
) -> None:
    path = knee(tmp_path)
    xml = path.read_text().replace('"friction" value="0.1"', written)
    path.write_text(xml)
    with pytest.raises(CableError) as caught:
        Device(path)
    message = str(caught.value)
    assert sentence in message, message
    assert message.count("it must be") <= 1
    assert "plugin->init" not in message and "Element" not in message


def test_a_written_description_reads_as_the_same_device(tmp_path: Path) -> None:
    path = knee(tmp_path)
    (tmp_path / "own.toml").write_text(
        'scene = "knee.xml"\n[sensors]\njoint_sensor = false\n'
    )
    before = Device(tmp_path / "own.toml")
    assert not before.description.sensing.joint_sensor
    write_description(before, tmp_path / "knee.device.toml")
    assert Device(path).description.sensing == before.description.sensing
    (tmp_path / "knee.device.toml").unlink()
    before = Device(path)
    write_description(before, tmp_path / "knee.device.toml")
    assert Device(path).description == before.description
    with pytest.raises(CableError, match="is there already"):
        write_description(before, tmp_path / "knee.device.toml")


@pytest.mark.parametrize("place", ["taken.toml", "nowhere/knee.toml"])
def test_an_output_that_cannot_be_is_refused_before_anything_is_shown(
    tmp_path: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken.toml").touch()
    words = ["device", str(knee(tmp_path)), "--out", str(tmp_path / place)]
    assert cli.main(words) == 2
    assert capsys.readouterr().out == ""


def test_a_wearer_is_added_where_the_scene_has_none(tmp_path: Path) -> None:
    device = Device(knee(tmp_path, wearer=""))
    assert device.description.movers == {"knee": "wearer_knee"}
    assert device.description.sources["wearer.knee"] == "assumed"
    own = Device(
        knee(tmp_path, "[wearer.knee]\nstiffness = 80\ndamping = 2\n", wearer="")
    )
    assert own.wearers["knee"].stiffness == 80.0
    assert own.wearers["knee"].damping == 2.0


@pytest.mark.parametrize(
    "wearer",
    [
        '<position name="human" joint="knee" kp="300" kv="6"/>',
        '<position name="human" joint="knee" kp="3" kv=".06" gear="10"/>',
        '<general name="human" joint="knee" gainprm="100" biastype="affine" '
        'biasprm="0 -300 -6"/>',
        '<general name="human" joint="knee" gainprm="300" biastype="affine" '
        'biasprm="60 -300 -6" ctrlrange="-5 5"/>',
    ],
)
def test_a_wearer_of_any_gear_and_gain_pulls_the_joint_alike(
    tmp_path: Path, wearer: str
) -> None:
    device = Device(knee(tmp_path, wearer=wearer))
    own = device.wearers["knee"]
    assert (own.stiffness, own.damping) == pytest.approx((300.0, 6.0))
    model = device.spec.compile()
    found = DeviceModel(device.description, model)
    data = mujoco.MjData(model)
    mover = found.movers["knee"]
    data.ctrl[mover.control] = mover.command(0.7, 0.0)
    data.qpos[found.axes[0].places.joint_q] = 0.5
    mujoco.mj_forward(model, data)
    assert data.actuator_force[mover.out] * mover.gear == pytest.approx(300.0 * 0.2)


def test_a_missing_range_of_the_wearers_control_does_not_freeze_it(
    tmp_path: Path,
) -> None:
    device = Device(knee(tmp_path))
    mover = device.movers["knee"]
    assert mover.command(1.5, 0.0) == 1.5


def test_muscles_move_the_body_by_themselves(tmp_path: Path) -> None:
    muscle = '<muscle name="biceps" tendon="other"/>'
    path = knee(tmp_path, wearer=muscle)
    text = path.read_text().replace(
        "</tendon>",
        '<spatial name="other" range="0.1 0.6"><site site="back"/><site site="heel"/>'
        "</spatial></tendon>",
    )
    for site, more in (("clamp", "back"), ("lever", "heel")):
        added = f'<site name="{more}" pos="-.1 0 -.1"/><site name="{site}"'
        text = text.replace(f'<site name="{site}"', added)
    path.write_text(text)
    device = Device(path)
    assert device.description.movers == {}


def test_a_cuff_yields_by_torque_over_stiffness(tmp_path: Path) -> None:
    path = knee(tmp_path, "[axis.cuff]\nstiffness = 400\ndamping = 5\n")
    for values, stiffness in (({}, 400.0), ({"cuff_stiffness": 150.0}, 150.0)):
        plant = Plant(Device(path), values)
        log = simulate(
            plant, "pi", trajectory=Still(1.0), task=Hold(-10.0), duration=1.5
        )
        frame, limb = plant.model().joint("knee_frame"), plant.model().joint("knee")
        pose = log["qpos"][-1]
        yielded = pose[frame.qposadr[0]] - pose[limb.qposadr[0]]
        torque = log["joint_torque_nm"][-1]
        assert torque < -5.0
        assert yielded == pytest.approx(torque / stiffness, rel=0.01)
    with pytest.raises(CableError, match="'cuff_stiffness' needs a cuff"):
        Plant(Device(knee(tmp_path, "[axis]\n")), {"cuff_stiffness": 9.0}).check()


@pytest.mark.parametrize("gear", ["-.02", ".02"])
def test_positive_motor_torque_winds_a_cable_whatever_the_sign_of_its_gear(
    tmp_path: Path, gear: str
) -> None:
    device = Device(knee(tmp_path, gear=gear))
    model = DeviceModel(device.description, device.spec.compile())
    (drive,) = model.drives(1e-3)
    assert drive.one_way
    assert drive.cables[0].proximal == -0.02
    data = mujoco.MjData(model.model)
    model.start(data, {"knee": 0.0}, np.zeros(1))
    data.ctrl[model.motor_controls] = 0.2 * model.axes[0].motor_scale
    for _ in range(300):
        mujoco.mj_step(model.model, data)
    (reader,) = model.readers.values()
    distal = reader.outputs[1]
    assert abs(data.actuator_force[distal]) > 50.0


def test_a_step_that_does_not_divide_the_period_warns(tmp_path: Path) -> None:
    path = knee(tmp_path, timestep="0.003")
    with pytest.warns(UserWarning, match="control period of 3 ms instead of 1 ms"):
        assert Device(path).frame_skip == 1
    path = knee(tmp_path, "period = 0.002\n", timestep="0.001")
    assert Device(path).frame_skip == 2
    path = knee(tmp_path, "period = 0.0025\n", timestep="0.001")
    with pytest.raises(CableError, match=r"whole number of time steps of 1 ms"):
        _ = Device(path).frame_skip


def test_a_free_root_is_held_or_free_by_choice(tmp_path: Path) -> None:
    path = knee(tmp_path, root="<freejoint name='float'/>")
    with pytest.warns(UserWarning, match="'float' is held where it is"):
        held = Device(path)
    assert held.spec.compile().nq == 2
    path = knee(tmp_path, 'root = "free"\n', root="<freejoint name='float'/>")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Device(path).spec.compile().nq == 9


DCMOTOR = """<dcmotor name="m" joint="drum" motorconst="0.05" resistance="0.8" gear="2"
{}/>"""


def test_a_dcmotor_is_a_motor_of_its_torque_at_rest(tmp_path: Path) -> None:
    path = knee(tmp_path, motor=DCMOTOR.format('ctrlrange="-24 24"'))
    with pytest.warns(CableWarning, match="at every speed: its amplifier"):
        device = Device(path)
    assert device.description.axes[0].torque == pytest.approx(24.0 * 0.05 / 0.8 * 2.0)
    model = device.spec.compile()
    data = mujoco.MjData(model)
    motor = model.actuator("m").id
    data.ctrl[motor] = 10.0  # more than the range holds
    mujoco.mj_step(model, data)
    assert 2.0 * data.actuator_force[motor] == pytest.approx(
        device.description.axes[0].torque
    )
    plain = DCMOTOR.format("")
    given = knee(tmp_path, "[axis]\ntorque = 2.5\n", motor=plain)
    with pytest.warns(CableWarning, match=r"'m' becomes a motor of 2\.5 N m"):
        device = Device(given)
    assert device.description.axes[0].torque == 2.5


@pytest.mark.parametrize(
    ("changes", "description", "wrong"),
    [
        ({"motor": ""}, "", "no motor winds a cable .*'drum'"),
        ({"motor": '<motor name="m" joint="drum"/>'}, "", "'m' has no limit"),
        ({"motor": DCMOTOR.format("")}, "", "dcmotor 'm' has no largest voltage"),
        (
            {"motor": DCMOTOR.format('ctrlrange="0 12"')},
            "",
            "of dcmotor 'm' goes from 0 to 12 V; it must go from below 0",
        ),
        (
            {"motor": DCMOTOR.format("").replace('gear="2"', 'gear="0"')},
            "",
            "motor 'm' has `gear` 0",
        ),
        (
            {"motor": '<position name="m" joint="drum" ctrlrange="-1 1"/>'},
            "",
            "'m' is no source of torque",
        ),
        ({}, "[axis]\njoint = 'nee'\n", "unknown joint .*did you mean 'knee'"),
        ({}, "[axis]\nsafe_torqe = 3\n", "'safe_torqe' in .*did you mean 'safe"),
        ({}, "[wearer.kne]\nstiffness = 3\n", "unknown joint .*'knee'"),
        ({}, "period = 'fast'\n", "period must be a finite number"),
        ({}, "[axis\n", "is not a TOML file"),
        ({"knee": 'range="0 2" type="slide"'}, "", "'knee', .* must be a hinge"),
    ],
)
def test_what_is_no_device_is_one_sentence(
    tmp_path: Path, changes: dict[str, str], description: str, wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong) as raised:
        Device(knee(tmp_path, description, **changes))
    assert str(raised.value).endswith(".")


def test_an_unknown_name_says_where_a_file_of_ones_own_goes() -> None:
    with pytest.raises(CableError, match=r"did you mean 'wrist'.*by its MJCF file"):
        find_device("wirst")
    with pytest.raises(CableError, match=r"there is no file none\.xml"):
        find_device("none.xml")


def test_a_device_is_read_anew_when_its_files_change(tmp_path: Path) -> None:
    path = knee(tmp_path)
    assert load_device(path) is load_device(path)
    assert load_device(path).description.axis().safe_is_assumed
    (tmp_path / "knee.device.toml").write_text("[axis]\nsafe_torque = 7\n")
    assert load_device(path).description.axis().safe_torque == 7.0


def test_included_files_belong_to_a_device(tmp_path: Path) -> None:
    path = knee(tmp_path, wearer="", knee="")
    whole = path.read_text()
    (tmp_path / "more.xml").write_text("<mujoco><option gravity='0 0 -1'/></mujoco>")
    path.write_text(
        whole.replace("<worldbody>", "<include file='more.xml'/><worldbody>")
    )
    assert Device(path).files == (path, tmp_path / "more.xml")


@pytest.mark.skipif(not SHARED.is_dir(), reason=ABSENT)
@pytest.mark.parametrize("name", ["knee_exo", "knee4", "knee_mid", "elbow"])
def test_scenes_of_other_people_are_devices(name: str) -> None:
    device = Device(SHARED / f"cases/device/{name}.xml")
    assert len(device.description.axes) == 1
    assert device.description.period == 1e-3


def test_a_wearer_that_is_added_takes_nothing_from_the_models_defaults(
    tmp_path: Path,
) -> None:
    path = knee(tmp_path, wearer="")
    text = path.read_text().replace(
        "<worldbody>",
        '<default><motor ctrlrange="-.4 .4" gear="40"/><general gear="3"/></default>'
        "<worldbody>",
        1,
    )
    path.write_text(text)
    mover = Device(path).movers["knee"]
    assert (mover.gear, mover.low, mover.high) == (1.0, -np.inf, np.inf)


@pytest.mark.parametrize("gear", [0.02, -0.02])
def test_cables_that_only_pull_against_each_other_warn(
    tmp_path: Path, gear: float
) -> None:
    path = tmp_path / "pair.xml"
    cables = (
        f'<plugin plugin="cc_mujoco.cable" instance="{name}" joint="{at}" gear="{r}"/>'
        for name, arms in (("bend", (-0.02, -0.05)), ("stretch", (gear, 0.05)))
        for at, r in zip(("drum", "knee"), arms, strict=True)
    )
    cord = """<config key="conduit" value="0.3:0.12 0.2:inf"/>
      <config key="axial_stiffness" value="30000"/> <config key="friction" value="0.1"/>
      <config key="pretension" value="8"/>"""
    path.write_text(f"""<mujoco>
      <extension><plugin plugin="cc_mujoco.cable">
        <instance name="bend">{cord}</instance>
        <instance name="stretch">{cord}</instance></plugin></extension>
      <worldbody>
        <body><joint name="drum" armature="1e-3"/><geom size=".02"/></body>
        <body pos="1 0 0"><joint name="knee"/><geom size=".1"/></body></worldbody>
      <actuator><motor name="m" joint="drum" ctrlrange="-9 9"/>{"".join(cables)}
      </actuator></mujoco>""")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Device(path)
    said = [one for one in caught if "against each other" in str(one.message)]
    assert len(said) == (gear < 0.0)


def test_a_motion_beyond_the_wearers_control_warns(tmp_path: Path) -> None:
    path = knee(
        tmp_path,
        wearer='<position name="human" joint="knee" kp="300" ctrlrange="0 .3"/>',
    )
    with pytest.warns(UserWarning, match=r"'knee' goes from .*`ctrlrange`.* cut there"):
        simulate(path, "none", duration=2.0)


@pytest.mark.parametrize(
    ("description", "wrong"),
    [
        ('scene = "other.xml"\n', "is the description of other.xml, not of knee.xml"),
        ("[[axis]]\nmotor = 'm'\n[[axis]]\nmotor = 'm'\n", "'m' a second time"),
        ("[axis]\nreach = 90\n", r"reach must be at most 6\.283"),
        ("[rope]\ndiameter = 2\n", r"diameter must be at most 0\.1"),
    ],
)
def test_a_description_that_cannot_be_meant_is_refused(
    tmp_path: Path, description: str, wrong: str
) -> None:
    with pytest.raises(CableError, match=wrong):
        Device(knee(tmp_path, description))


@pytest.mark.filterwarnings("ignore:cable 'cord' hardly turns")
def test_degrees_under_radians_and_a_missing_joint_are_named(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="'knee' has a range .* must be degree"):
        Device(knee(tmp_path, knee='range="-30 120"'))
    path = knee(tmp_path)
    path.write_text(path.read_text().replace('joint="drum" gear', 'joint="drumm" gear'))
    with pytest.raises(CableError, match="'drumm': did you mean 'drum'"):
        Device(path)


def test_a_motion_of_a_description_lies_beside_it(tmp_path: Path) -> None:
    path = knee(tmp_path, 'trajectory = "move.csv"\n')
    rows = "\n".join(f"{0.1 * i},{1.0}" for i in range(6))
    (tmp_path / "move.csv").write_text(f"time_s,knee_angle_rad\n{rows}\n")
    assert Device(path).description.trajectory == str(tmp_path / "move.csv")


def test_a_table_of_one_axis_does_not_move_the_others(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.1 * i},{0.01 * i}" for i in range(8))
    table = tmp_path / "hip.csv"
    table.write_text(f"time_s,hip_angle_rad\n{rows}\n")
    log = simulate("exosuit", "none", trajectory=table, duration=0.3)
    assert np.ptp(log["hip.reference_angle_rad"]) > 0.01
    assert np.ptp(log["ankle.reference_angle_rad"]) == 0.0


def test_a_description_that_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "knee.xml").write_text("<mujoco/>")
    (tmp_path / "knee.device.toml").mkdir()
    with pytest.raises(CableError, match=r"knee\.device\.toml.* is no file"):
        Device(tmp_path / "knee.xml")
