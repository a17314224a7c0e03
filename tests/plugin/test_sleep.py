"""Sleeping islands: what a cable pulls stays awake, and all else sleeps as before."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cc_mujoco.plugin import read
from plugin.open_scenes import end

BLOCK = (
    '<body name="block" pos="0 0 0.5" gravcomp="1">'
    '<joint name="block" type="slide" axis="0 0 1" damping="30"/>'
    '<geom name="block" type="cylinder" size="0.05 0.03" '
    'zaxis="0 1 0" mass="2"/><site name="l" pos="-0.05 0 0"/>'
    '<site name="r" pos="0.05 0 0"/><site name="under" pos="0 0 -0.06"/></body>'
)
DRUMS = "".join(
    f'<body pos="{x} 0 1"><joint name="{name}" axis="0 1 0" armature="1e-3" '
    'damping="0.5"/><geom size="0.02" mass="0.1"/></body>'
    for name, x in (("w", -0.4), ("v", 0.4))
)
FIXED = '<site name="a" pos="-0.1 0 1"/><site name="b" pos="0.1 0 1"/>'
LEVER = (
    '<body name="lever" pos="0.3 0 0.5"><joint name="lever" axis="0 1 0" '
    'stiffness="2" damping="0.1"/><geom size="0.03" mass="0.5" pos="0.1 0 0"/>'
    '<site name="tip" pos="0.1 0 0"/></body>'
)
SITES = '<site site="a"/><site site="l"/><site site="r"/><site site="b"/>'
GEOM = '<site site="a"/><geom geom="block" sidesite="under"/><site site="b"/>'
BOTH = end("joint", "w", -0.02) + end("joint", "v", 0.02)
CASES = {
    "sites": (SITES, {"path": "open"}, BOTH),
    "geom": (GEOM, {"path": "open"}, BOTH),
    "mixed": (SITES, {"path": "mixed", "mouth": "l"}, BOTH),
    "tied": (
        SITES,
        {"path": "open"},
        end("joint", "w", -0.02) + end("tendon", "rope", 1),
    ),
    "guided": (SITES, {}, end("joint", "w", -0.02) + end("joint", "lever", 0.02)),
    "held": (SITES, {}, end("joint", "w", -0.02) + end("tendon", "reach", 1)),
}


def model(case: str, sleep: str, own: str = "") -> mujoco.MjModel:
    """Return a winch that pulls a block, or a lever, after two seconds of rest."""
    rope, keys, ends = CASES[case]
    world = BLOCK.replace('name="block" pos', f'name="block" {own} pos')
    world += FIXED + DRUMS + LEVER
    tendon = (
        f'<tendon><spatial name="rope">{rope}</spatial>'
        '<spatial name="reach"><site site="b"/><site site="tip"/></spatial></tendon>'
    )
    text = (
        '<mujoco><option timestep="2e-3">'
        f'<flag sleep="{sleep}" contact="disable"/></option>{{}}'
        f"<worldbody>{world}</worldbody>{tendon}<actuator>"
        '<position name="pw" joint="w" kp="20"/>'
        '<position name="pv" joint="v" kp="20"/>{}</actuator></mujoco>'
    )
    probe = mujoco.MjModel.from_xml_string(text.format("", ""))
    length = probe.tendon_length0[0] if keys.get("path") == "open" else 1.0
    given = {
        "axial_stiffness": 2e4,
        "pretension": 10,
        "friction": 0.05,
        "route": "rope",
        "segments": 8,
        "conduit": f"{length}:inf",
    } | keys
    lines = "".join(f'<config key="{k}" value="{v}"/>' for k, v in given.items())
    cable = (
        '<extension><plugin plugin="cc_mujoco.cable">'
        f'<instance name="rope">{lines}</instance></plugin></extension>'
    )
    return mujoco.MjModel.from_xml_string(text.format(cable, ends))


def pull(m: mujoco.MjModel, steps: int = 1400) -> mujoco.MjData:
    d = mujoco.MjData(m)
    for i in range(steps):
        d.ctrl[0] = 5.0 * min(max(i - 1000, 0) / 400, 1.0)
        mujoco.mj_step(m, d)
    return d


@pytest.mark.parametrize("case", CASES)
def test_what_a_cable_pulls_does_not_sleep(case: str) -> None:
    pulled = "block" if case in ("sites", "geom", "mixed", "tied") else "lever"
    m = model(case, "enable")
    awake, asleep = pull(model(case, "disable")), pull(m)
    held = [m.joint(name).qposadr[0] for name in (pulled, "w")]
    assert np.array_equal(awake.qpos[held], asleep.qpos[held])
    tensions = [read(m, d, "rope").tension for d in (awake, asleep)]
    assert np.array_equal(*tensions)
    assert abs(awake.joint(pulled).qpos[0]) > 5e-3
    assert asleep.tree_asleep[m.body_treeid[m.body(pulled).id]] < 0


def test_what_only_holds_a_conduit_sleeps() -> None:
    """A conduit pulls no body that it bends around; what rests stays asleep."""
    m = model("guided", "enable")
    d = pull(m)
    assert d.tree_asleep[m.body_treeid[m.body("block").id]] >= 0
    assert read(m, d, "rope").tension[0] > 20.0


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("policy", ["allowed", "init"])
def test_a_body_that_is_pulled_must_not_be_allowed_to_sleep(
    case: str, policy: str
) -> None:
    own = f'sleep="{policy}"'
    if case in ("guided", "held"):
        assert model(case, "enable", own).nplugin == 1
        return
    with pytest.raises(ValueError, match="body 'block' has a `sleep` of `allowed`"):
        model(case, "enable", own)


def test_the_policy_outlives_what_is_changed_after_loading() -> None:
    m = model("sites", "disable")
    m.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    mujoco.mj_setConst(m, mujoco.MjData(m))
    assert pull(m).joint("block").qpos[0] > 5e-3
