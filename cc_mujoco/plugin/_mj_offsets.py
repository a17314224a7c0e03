"""Memory layout of the fields of MuJoCo's C structures.

The layout follows from `mujoco.introspect`, MuJoCo's own machine-made description of
its headers, with the platform's alignment rules (through `ctypes`). `verify` compares
it with the addresses that the Python bindings report and refuses a MuJoCo where they
differ, so a wrong offset is an import error and never a stray write.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import mujoco
from mujoco.introspect.ast_nodes import AnonymousStructDecl, ArrayType, PointerType
from mujoco.introspect.structs import STRUCTS

_SCALARS: dict[str, Any] = {
    "char": ctypes.c_char,
    "float": ctypes.c_float,
    "int": ctypes.c_int,
    "mjtBool": ctypes.c_bool,
    "mjtByte": ctypes.c_uint8,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
}
_structures: dict[str, type[ctypes.Structure]] = {}


def structure(name: str) -> type[ctypes.Structure]:
    """Return the `ctypes` structure of a MuJoCo struct, for `.field.offset`."""
    if name not in _structures:
        _structures[name] = _build(name, STRUCTS[name].fields)
    return _structures[name]


def offset(struct: str, field: str) -> int:
    """Return the offset of a field in bytes."""
    return int(getattr(structure(struct), field).offset)


def _build(name: str, fields: Any) -> type[ctypes.Structure]:
    members = [(field.name, _type(field.type)) for field in fields]
    return type(name, (ctypes.Structure,), {"_fields_": members})


def _type(node: Any) -> Any:
    if isinstance(node, PointerType):
        return ctypes.c_void_p
    if isinstance(node, ArrayType):
        return _type(node.inner_type) * math.prod(node.extents)
    if isinstance(node, AnonymousStructDecl):
        return _build("anonymous", node.fields)
    return _SCALARS.get(node.name) or structure(node.name)


_PROBE_XML = """
<mujoco>
  <option timestep="0.0123" integrator="RK4"/>
  <size nuserdata="3"/>
  <extension>
    <plugin plugin="mujoco.pid">
      <instance name="p"><config key="kp" value="1"/></instance>
    </plugin>
  </extension>
  <worldbody>
    <site name="a"/>
    <geom type="plane" size="1 1 .1"/>
    <body mocap="true"/>
    <body>
      <joint name="j" range="1 2" limited="true"/>
      <geom size=".1"/>
      <site name="b" pos="0 0 1"/>
    </body>
  </worldbody>
  <tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>
  <equality><tendon tendon1="t"/></equality>
  <actuator><plugin joint="j" instance="p"/></actuator>
  <sensor><clock/></sensor>
</mujoco>
"""
_MODEL_ARRAYS = (
    "qpos0", "jnt_type", "geom_type", "geom_bodyid", "site_bodyid", "tendon_adr",
    "tendon_num", "tendon_length0", "wrap_type", "wrap_objid", "body_pos", "body_quat",
    "body_mocapid", "body_weldid", "actuator_forcelimited", "actuator_trntype",
    "actuator_trnid", "actuator_outadr", "actuator_gear", "actuator_length0",
    "actuator_plugin", "actuator_outnum", "actuator_biastype", "actuator_biasprm",
    "actuator_gaintype", "actuator_gainprm", "actuator_ctrladr", "actuator_forcerange",
    "jnt_dofadr", "jnt_actgravcomp", "jnt_actfrclimited", "jnt_actfrcrange",
    "jnt_bodyid", "body_parentid", "actuator_group", "tendon_actfrclimited",
    "tendon_armature", "eq_type", "eq_obj1id", "eq_obj2id",
    "dof_damping", "dof_armature", "dof_invweight0", "tendon_invweight0",
    "tendon_damping",
    "tendon_stiffness", "tendon_frictionloss", "tendon_limited",
    "ten_J_rownnz", "ten_J_rowadr", "ten_J_colind", "plugin", "plugin_attr",
    "plugin_attradr", "plugin_stateadr",
    "name_actuatoradr", "name_pluginadr", "name_tendonadr", "name_siteadr",
    "name_bodyadr", "body_treeid", "tree_sleep_policy", "jnt_qposadr", "jnt_limited",
    "jnt_range", "actuator_ctrllimited", "actuator_ctrlrange",
)  # fmt: skip
_DATA_ARRAYS = (
    "qpos", "mocap_pos", "mocap_quat", "qfrc_passive", "qvel", "qacc_warmstart",
    "qfrc_bias", "qfrc_applied", "qfrc_gravcomp", "xfrc_applied", "xipos",
    "actuator_velocity", "ctrl", "sensordata", "xpos", "geom_xpos", "geom_xmat",
    "site_xpos",
    "ten_wrapadr", "ten_wrapnum", "ten_length", "wrap_obj", "wrap_xpos",
    "actuator_length", "actuator_force", "actuator_moment", "moment_rownnz",
    "moment_rowadr", "moment_colind", "ten_J", "efc_type", "efc_id", "efc_J",
    "efc_J_rownnz", "efc_J_rowadr", "efc_J_colind", "efc_frictionloss", "efc_D",
    "efc_aref", "qfrc_actuator", "qfrc_spring", "qfrc_damper", "userdata", "qacc",
)  # fmt: skip


def verify() -> None:
    """Compare the layout with the addresses that the bindings report.

    `mjData.plugin_state` is empty in the probe and `plugin_data` has no address in
    Python; the fields on both sides of them do, and the latter must hold an address.

    Raises:
        ImportError: it differs, so the engine plugin cannot run on this MuJoCo.
    """
    model = mujoco.MjModel.from_xml_string(_PROBE_XML)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    m = structure("mjModel").from_address(model._address)
    d = structure("mjData").from_address(data._address)
    seen = {name: getattr(m, name) for name in _MODEL_ARRAYS}
    seen |= {f"mjData.{name}": getattr(d, name) for name in _DATA_ARRAYS}
    true = {name: getattr(model, name).ctypes.data for name in _MODEL_ARRAYS}
    true |= {f"mjData.{name}": getattr(data, name).ctypes.data for name in _DATA_ARRAYS}
    for name in (
        "signature",
        "nq",
        "nv",
        "nbody",
        "njnt",
        "nactuator",
        "ntendon",
        "neq",
        "nmocap",
        "nplugin",
        "npluginstate",
        "nuserdata",
    ):
        seen[name], true[name] = getattr(m, name), getattr(model, name)
    seen["nefc"], true["nefc"] = d.nefc, data.nefc
    contact = structure("mjContact").from_address(d.contact)
    for name in ("dist", "dim", "efc_address"):
        seen[f"mjContact.{name}"] = getattr(contact, name)
        true[f"mjContact.{name}"] = getattr(data.contact[0], name)
    seen["names"] = ctypes.string_at(m.names, len(model.names))
    true["names"] = model.names
    seen["timestep"], true["timestep"] = m.opt.timestep, model.opt.timestep
    seen["integrator"], true["integrator"] = m.opt.integrator, model.opt.integrator
    model.opt.disableflags = flags = 1 << 11
    seen["disableflags"], true["disableflags"] = m.opt.disableflags, flags
    model.opt.enableflags = flags = 1 << 3
    seen["enableflags"], true["enableflags"] = m.opt.enableflags, flags
    model.opt.disableactuator = groups = 1 << 5
    seen["disableactuator"], true["disableactuator"] = m.opt.disableactuator, groups
    data.time = 0.75
    seen["time"], true["time"] = d.time, data.time
    held = ctypes.c_size_t.from_address(d.plugin_data).value
    seen["plugin_data"], true["plugin_data"] = held != 0, True
    wrong = [name for name in true if seen[name] != true[name]]
    if wrong:
        raise ImportError(
            f"cc_mujoco cannot run on mujoco {mujoco.__version__}: its structures are "
            f"laid out differently than described (fields {', '.join(wrong)}); "
            "install a mujoco of a release that cc_mujoco supports"
        )
