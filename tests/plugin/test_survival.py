"""Whatever data MuJoCo hands to the plugin, the process lives on.

Each script runs in a process of its own, so that a crash fails one test.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from plugin.processes import Ended, processes
from plugin.scenes import pull_pull

SLEDGE = 'type="slide" axis="1 0 0" damping="1" stiffness="50"'
LIMITED = pull_pull().replace(SLEDGE, SLEDGE + ' limited="true" range="-0.2 0.2"')
ASLEEP = pull_pull(extra='<option><flag sleep="enable"/></option>')
DAMAGE = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from plugin import damage
"""
START = f"""
import ctypes
from pathlib import Path
import mujoco
import numpy as np
import cc_mujoco
from cc_mujoco.plugin._mj_offsets import structure
from cc_mujoco.plugin._engine import LIBRARY
XML = {pull_pull()!r}
LIMITED = {LIMITED!r}
ASLEEP = {ASLEEP!r}
def build(xml=XML):
    m = mujoco.MjModel.from_xml_string(xml)
    return m, mujoco.MjData(m)
def works(m, d, steps=50):
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d, steps)
    ends = d.actuator_force[1:5]
    assert np.isfinite(ends).all() and (ends[::2] > 0).any(), ends
def warnings():
    log = Path("MUJOCO_LOG.TXT")
    lines = log.read_text().splitlines() if log.exists() else []
    return [line for line in lines if "plugin `cc_mujoco" in line]
def state(m, d):
    out = np.empty(mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(m, d, out, mujoco.mjtState.mjSTATE_INTEGRATION)
    return out
def blocks(d):
    return structure("mjData").from_address(d._address).plugin_data
"""
SCRIPTS = {
    "muscle beside a cable": """
muscle = '<muscle name="pull" joint="sledge"/></actuator>'
m, d = build(LIMITED.replace("</actuator>", muscle))
assert np.allclose(m.actuator_lengthrange[-1], (-0.2, 0.2), atol=0.02)
works(m, d)
""",
    "muscle in the defaults": """
limited = '<joint limited="true" range="-170 170"/>'
defaults = "<default><muscle/>" + limited + "</default><worldbody>"
xml = LIMITED.replace('type="ball"', "").replace("<worldbody>", defaults)
m, d = build(xml)
assert m.actuator_lengthrange[1:].all()
mujoco.mj_step(m, d, 50)
assert (d.actuator_force[1:5:2] > 0).all()
""",
    "length range asked for": """
m, d = build(LIMITED)
option = mujoco.MjLROpt()
option.mode = mujoco.mjtLRMode.mjLRMODE_ALL
option.uselimit = 1
mujoco.mj_resetData(m, d)
try:
    mujoco.mj_setLengthRange(m, d, 0, option)
    mujoco.mj_setLengthRange(m, d, 1, option)
except mujoco.FatalError:
    pass
mujoco.mj_resetData(m, d)
works(m, d)
""",
    "data without a block": """
m, d = build()
works(m, d)
held = blocks(d)[:2]
blocks(d)[0] = blocks(d)[1] = 0
for integrator in range(4):
    m.opt.integrator = integrator
    mujoco.mj_resetData(m, d)
    mujoco.mj_step(m, d, 10)
    mujoco.mj_inverse(m, d)
    assert not d.actuator_force[1:5].any()
for use in (cc_mujoco.plugin.step_limits, cc_mujoco.plugin.settle):
    try:
        use(m, d)
    except cc_mujoco.CableError as error:
        assert "'flexor'" in str(error) and "make new data" in str(error), error
    else:
        raise SystemExit(4)
whole = mujoco.MjData(m)
mujoco.mj_copyData(whole, m, d)
mujoco.mj_copyData(d, m, whole)
del d
m.opt.integrator = 0
mujoco.mj_resetData(m, whole)
works(m, whole)
""",
    "failed load": """
bad = XML.replace('value="0.15"', 'value="much"')
for _ in range(3):
    try:
        build(bad)
    except ValueError as error:
        assert "friction" in str(error), error
    else:
        raise SystemExit(3)
works(*build())
""",
    "configuration broken after the load": """
m, d = build()
works(m, d)
kept = m.plugin_attr.copy()
m.plugin_attr[:] = ord("x")
m.plugin_attr[-1] = 0
try:
    mujoco.MjData(m)
except (mujoco.FatalError, ValueError) as error:
    print(error)
else:
    raise SystemExit(3)
mujoco.mj_resetData(m, d)
mujoco.mj_step(m, d, 3)
mujoco.mj_forward(m, d)
m.plugin_attr[:] = kept
mujoco.mj_resetData(m, d)
works(m, d)
works(m, mujoco.MjData(m))
""",
    "time step that is none": """
m, d = build()
works(m, d)
kept, before = m.opt.timestep, d.plugin_state.copy()
for step in (np.nan, -1.0, 0.0, np.inf, 1e300):
    m.opt.timestep = step
    mujoco.mj_step(m, d, 3)
    cc_mujoco.plugin.settle(m, d)
    assert step == 1e300 or np.isinf(cc_mujoco.plugin.step_limits(m, d)["flexor"]).all()
none = [line for line in warnings() if "`timestep` must be" in line]
assert len(none) == 2 and "'flexor'" in none[0] and "'extensor'" in none[1], none
m.opt.timestep = kept
mujoco.mj_resetData(m, d)
works(m, d)
""",
    "state that is no number": """
m, d = build()
for value in (np.nan, np.inf, -1e14, 1e300, -5.0):
    mujoco.mj_resetData(m, d)
    d.plugin_state[:] = value
    mujoco.mj_step(m, d, 3)
none = [line for line in warnings() if "no finite number" in line]
assert len(none) == 2 and "`plugin_state`" in none[0], warnings()
mujoco.mj_resetData(m, d)
works(m, d)
""",
    "data of another kind of path": f"""{DAMAGE}
for one in damage.KINDS:
    for two in damage.KINDS:
        own, other = damage.scene(one), damage.scene(two)
        d = mujoco.MjData(own)
        mujoco.mj_step(own, d, 2)
        before, count = d.plugin_state.copy(), len(warnings())
        mujoco.mj_step(other, d, 3)
        same = damage.path_of(one) == damage.path_of(two)
        for read in damage.READERS[:3]:
            try:
                read(other, d, "cable")
            except cc_mujoco.CableError as error:
                assert not same and "another kind of path" in str(error), error
            else:
                assert same, (one, two, read)
        size = own.plugin_statenum[0]
        assert same == d.actuator_force[:2].any(), (one, two, d.actuator_force)
        assert same != np.array_equal(d.plugin_state[:size], before[:size])
        mujoco.mj_resetData(own, d)
        mujoco.mj_step(own, d, 2)
        assert np.array_equal(d.plugin_state, before)
other = [line for line in warnings() if "another kind of path" in line]
assert 2 <= len(other) <= len(damage.KINDS) * 2, other
""",
    "print": """
m, d = build()
works(m, d)
mujoco.mj_printModel(m, "model.txt")
mujoco.mj_printData(m, d, "data.txt")
mujoco.mj_printData(m, mujoco.MjData(m), "fresh.txt")
blocks(d)[0] = 0
mujoco.mj_printData(m, d, "none.txt")
works(*build())
""",
    "inverse dynamics": """
m, d = build()
works(m, d)
before = d.plugin_state.copy()
mujoco.mj_inverse(m, d)
m.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_FWDINV
m.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_INVDISCRETE
mujoco.mj_forward(m, d)
mujoco.mj_inverse(m, d)
assert np.array_equal(d.plugin_state, before)
works(m, d)
""",
    "finite differences": """
m, d = build()
works(m, d)
before = state(m, d)
size = 2 * m.nv + m.na
for centred in (False, True):
    A, B = np.empty((size, size)), np.empty((size, m.nu))
    mujoco.mjd_transitionFD(m, d, 1e-6, centred, A, B, None, None)
    assert np.isfinite(A).all() and np.isfinite(B).all()
    # The cables hold the motor: turned, it has another velocity a step later.
    dof = m.joint("motor").dofadr[0]
    assert A[m.nv + dof, dof] < -1e-3, A[m.nv + dof, dof]
assert np.array_equal(state(m, d), before)
DfDq, DfDv, DfDa = (np.empty((m.nv, m.nv)) for _ in range(3))
mujoco.mjd_inverseFD(
    m, d, 1e-6, False, DfDq, DfDv, DfDa, None, None, None, None
)
works(m, d)
""",
    "sleep": """
m, d = build(ASLEEP)
motor = m.body_treeid[m.body("motor").id]
mujoco.mj_step(m, d, 3000)
assert d.tree_asleep[motor] < 0
works(m, d)
""",
    "made, copied and deleted in C": """
m, d = build()
works(m, d)
for name in ("mj_makeData", "mj_copyData"):
    getattr(LIBRARY, name).restype = ctypes.c_void_p
address = ctypes.c_void_p
for _ in range(20):
    one = LIBRARY.mj_makeData(address(m._address))
    two = LIBRARY.mj_copyData(None, address(m._address), address(d._address))
    LIBRARY.mj_step(address(m._address), address(one))
    LIBRARY.mj_step(address(m._address), address(two))
    LIBRARY.mj_copyData(address(one), address(m._address), address(two))
    LIBRARY.mj_step(address(m._address), address(one))
    LIBRARY.mj_deleteData(address(two))
    LIBRARY.mj_deleteData(address(one))
works(m, d)
""",
}


SCRIPTS |= {
    f"site of a cable of kind {kind} that is no number": f"""{DAMAGE}
m = damage.scene({kind!r})
d, kept = mujoco.MjData(m), m.site_pos.copy()
mujoco.mj_step(m, d, 2)
for place in (np.nan, np.inf):
    m.site_pos[m.site("m").id] = place
    mujoco.mj_step(m, d, 3)
m.site_pos[:] = kept
(none,) = [line for line in warnings() if "no finite number" in line]
assert "its route or the" in none, none
mujoco.mj_resetData(m, d)
mujoco.mj_step(m, d, 2)
assert np.isfinite(d.actuator_force[:2]).all() and d.actuator_force[0] > 0
"""
    for kind in ("route", "open", "mixed", "band")
}
DAMAGES = ("random_state", "edited_text", "other_model")


SCRIPTS |= {
    f"{kind} a hundred times": f"""{DAMAGE}
for seed in range(100):
    damage.{kind}(seed)
"""
    for kind in DAMAGES
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    return processes(START, SCRIPTS, tmp_path_factory.mktemp("scripts"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_survives(name: str, ended: dict[str, Ended]) -> None:
    assert ended[name].code == 0, ended[name].said
    # Python prints so what compiled code raises where nobody can catch it.
    assert "Exception ignored" not in ended[name].said


@pytest.mark.study
def test_survives_damage_ten_thousand_times(tmp_path: Path) -> None:
    scripts = {
        kind: f"for seed in range(3400): damage.{kind}(seed)" for kind in DAMAGES
    }
    ended = processes(DAMAGE, scripts, tmp_path, timeout=3600)
    for kind, end in ended.items():
        assert end.code == 0, f"{kind}: {end.said[-2000:]}"
        assert "Exception ignored" not in end.said, kind
