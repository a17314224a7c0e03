"""Compiled access to `mjModel` and `mjData`, at the offsets of `_mj_offsets.py`."""

from __future__ import annotations

import math

from cc_mujoco.plugin._ffi import (
    Bytes,
    internal,
    load_byte,
    load_integer,
    load_real,
    load_word,
    store_real,
    store_word,
    text,
)
from cc_mujoco.plugin._mj_offsets import offset, size


def _model(field: str) -> int:
    return offset(f"mjModel.{field}")


def _data(field: str) -> int:
    return offset(f"mjData.{field}")


_TIMESTEP = _model("opt.timestep")
_INTEGRATOR = _model("opt.integrator")
_DISABLED = _model("opt.disableflags")
_ENABLED = _model("opt.enableflags")
_DISABLED_GROUPS = _model("opt.disableactuator")
_SIGNATURE = _model("signature")
_NQ = _model("nq")
_NV = _model("nv")
_NBODY = _model("nbody")
_NJNT = _model("njnt")
_NPLUGIN = _model("nplugin")
_NACTUATOR = _model("nactuator")
_NTENDON = _model("ntendon")
_NEQ = _model("neq")
_NUSERDATA = _model("nuserdata")
_NMOCAP = _model("nmocap")
_NAMES = _model("names")
_BODY_NAME = _model("name_bodyadr")
_PLUGIN_NAME = _model("name_pluginadr")
_ACTUATOR_NAME = _model("name_actuatoradr")
_SITE_NAME = _model("name_siteadr")
_GEOM_NAME = _model("name_geomadr")
_TENDON_NAME = _model("name_tendonadr")
_PLUGIN_ATTR = _model("plugin_attr")
_PLUGIN_ATTRADR = _model("plugin_attradr")
STATE_ADDRESS = _model("plugin_stateadr")
STATE_SIZE = _model("plugin_statenum")
PLUGIN_STATE = _data("plugin_state")
_PLUGIN_DATA = _data("plugin_data")
_DATA_PLUGIN = _data("plugin")
_DATA_NPLUGIN = _data("nplugin")
_TIME = _data("time")

PLUGIN = _model("plugin")
ACTUATOR_PLUGIN = _model("actuator_plugin")
ACTUATOR_TRNTYPE = _model("actuator_trntype")
ACTUATOR_TRNID = _model("actuator_trnid")
ACTUATOR_OUTADR = _model("actuator_outadr")
ACTUATOR_OUTNUM = _model("actuator_outnum")
ACTUATOR_GEAR = _model("actuator_gear")
ACTUATOR_GROUP = _model("actuator_group")
ACTUATOR_BIASTYPE = _model("actuator_biastype")
ACTUATOR_BIASPRM = _model("actuator_biasprm")
ACTUATOR_GAINTYPE = _model("actuator_gaintype")
ACTUATOR_GAINPRM = _model("actuator_gainprm")
ACTUATOR_CTRLADR = _model("actuator_ctrladr")
ACTUATOR_LENGTH0 = _model("actuator_length0")
FORCE_LIMITED = _model("actuator_forcelimited")
FORCE_RANGE = _model("actuator_forcerange")
ACTUATOR_DAMPING = _model("actuator_damping")
ACTUATOR_DAMPINGPOLY = _model("actuator_dampingpoly")
ACTUATOR_ARMATURE = _model("actuator_armature")
JNT_TYPE = _model("jnt_type")
JNT_BODY = _model("jnt_bodyid")
JNT_DOFADR = _model("jnt_dofadr")
JNT_ACTGRAVCOMP = _model("jnt_actgravcomp")
JNT_ACTFRCLIMITED = _model("jnt_actfrclimited")
JNT_ACTFRCRANGE = _model("jnt_actfrcrange")
JNT_POSITION = _model("jnt_qposadr")
JNT_LIMITED = _model("jnt_limited")
JNT_RANGE = _model("jnt_range")
CTRL_LIMITED = _model("actuator_ctrllimited")
CTRL_RANGE = _model("actuator_ctrlrange")
DOF_DAMPING = _model("dof_damping")
DOF_ARMATURE = _model("dof_armature")
DOF_INVWEIGHT0 = _model("dof_invweight0")
TENDON_INVWEIGHT0 = _model("tendon_invweight0")
TENDON_DAMPING = _model("tendon_damping")
TENDON_STIFFNESS = _model("tendon_stiffness")
TENDON_FRICTIONLOSS = _model("tendon_frictionloss")
TENDON_LIMITED = _model("tendon_limited")
TENDON_ARMATURE = _model("tendon_armature")
TENDON_ACTFRCLIMITED = _model("tendon_actfrclimited")
TENDON_ACTFRCRANGE = _model("tendon_actfrcrange")
EQ_TYPE = _model("eq_type")
EQ_OBJECT_1 = _model("eq_obj1id")
EQ_OBJECT_2 = _model("eq_obj2id")
TEN_J_ROWNNZ = _model("ten_J_rownnz")
TEN_J_ROWADR = _model("ten_J_rowadr")
TEN_J_COLIND = _model("ten_J_colind")
TENDON_ADR = _model("tendon_adr")
TENDON_NUM = _model("tendon_num")
TENDON_LENGTH0 = _model("tendon_length0")
WRAP_TYPE = _model("wrap_type")
WRAP_OBJID = _model("wrap_objid")
GEOM_BODY = _model("geom_bodyid")
SITE_BODY = _model("site_bodyid")
QPOS0 = _model("qpos0")
BODY_PARENT = _model("body_parentid")
BODY_TREE = _model("body_treeid")
TREE_SLEEP = _model("tree_sleep_policy")
BODY_POS = _model("body_pos")
BODY_QUAT = _model("body_quat")
_WELD = _model("body_weldid")
BODY_MOCAP = _model("body_mocapid")
QPOS = _data("qpos")
MOCAP_POS = _data("mocap_pos")
MOCAP_QUAT = _data("mocap_quat")
QFRC_PASSIVE = _data("qfrc_passive")
QFRC_BIAS = _data("qfrc_bias")
QFRC_APPLIED = _data("qfrc_applied")
QFRC_GRAVCOMP = _data("qfrc_gravcomp")
QFRC_FLUID = _data("qfrc_fluid")
XFRC_APPLIED = _data("xfrc_applied")
XIPOS = _data("xipos")
CTRL = _data("ctrl")
QACC_WARMSTART = _data("qacc_warmstart")
NEFC = _data("nefc")
EFC_TYPE = _data("efc_type")
EFC_ID = _data("efc_id")
EFC_J = _data("efc_J")
EFC_ROWNNZ = _data("efc_J_rownnz")
EFC_ROWADR = _data("efc_J_rowadr")
EFC_COLIND = _data("efc_J_colind")
EFC_FRICTIONLOSS = _data("efc_frictionloss")
EFC_D = _data("efc_D")
EFC_AREF = _data("efc_aref")
CONTACT = _data("contact")
CONTACT_SIZE = size("mjContact")
CONTACT_FRICTION = offset("mjContact.friction")
CONTACT_EFC = offset("mjContact.efc_address")
GEOM_TYPE = _model("geom_type")
GEOM_XPOS = _data("geom_xpos")
SITE_XPOS = _data("site_xpos")
XANCHOR = _data("xanchor")
GEOM_XMAT = _data("geom_xmat")
TEN_LENGTH = _data("ten_length")
TEN_VELOCITY = _data("ten_velocity")
TEN_J = _data("ten_J")
TEN_WRAPADR = _data("ten_wrapadr")
TEN_WRAPNUM = _data("ten_wrapnum")
WRAP_OBJ = _data("wrap_obj")
WRAP_XPOS = _data("wrap_xpos")
ACTUATOR_LENGTH = _data("actuator_length")
ACTUATOR_VELOCITY = _data("actuator_velocity")
ACTUATOR_MOMENT = _data("actuator_moment")
MOMENT_ROWNNZ = _data("moment_rownnz")
MOMENT_ROWADR = _data("moment_rowadr")
MOMENT_COLIND = _data("moment_colind")
QVEL = _data("qvel")
QACC = _data("qacc")
QFRC_ACTUATOR = _data("qfrc_actuator")
QFRC_SPRING = _data("qfrc_spring")
QFRC_DAMPER = _data("qfrc_damper")
USERDATA = _data("userdata")
ACTUATOR_FORCE = _data("actuator_force")


@internal
def integer(struct: int, field: int, index: int) -> int:
    return load_integer(load_word(struct + field) + 4 * index)


@internal
def real(struct: int, field: int, index: int) -> float:
    """Return an element of an mjtNum array field."""
    return load_real(load_word(struct + field) + 8 * index)


@internal
def byte(struct: int, field: int, index: int) -> int:
    return load_byte(load_word(struct + field) + index)


@internal
def set_force(data: int, output: int, force: float) -> None:
    """Set an element of `actuator_force`."""
    store_real(load_word(data + ACTUATOR_FORCE) + 8 * output, force)


@internal
def timestep(model: int) -> float:
    """Return the time step of the model [s]."""
    return load_real(model + _TIMESTEP)


@internal
def has_timestep(model: int) -> bool:
    """Return whether the time step of the model is a positive finite number."""
    return 0.0 < timestep(model) < math.inf


@internal
def integrator(model: int) -> int:
    """Return the integrator of the model, an `mjtIntegrator`."""
    return load_integer(model + _INTEGRATOR)


@internal
def disabled(model: int, flag: int) -> bool:
    """Return whether a part of the engine is disabled, an `mjtDisableBit`."""
    return load_integer(model + _DISABLED) & flag != 0


@internal
def enabled(model: int, flag: int) -> bool:
    """Return whether an optional part of the engine is enabled, an `mjtEnableBit`."""
    return load_integer(model + _ENABLED) & flag != 0


@internal
def disabled_groups(model: int) -> int:
    """Return the disabled groups of actuators, a bit for each."""
    return load_integer(model + _DISABLED_GROUPS)


@internal
def time(data: int) -> float:
    return load_real(data + _TIME)


@internal
def signature(model: int) -> int:
    return load_word(model + _SIGNATURE)


@internal
def dofs(model: int) -> int:
    return load_word(model + _NV)


@internal
def positions(model: int) -> int:
    return load_word(model + _NQ)


@internal
def bodies(model: int) -> int:
    return load_word(model + _NBODY)


@internal
def joints(model: int) -> int:
    return load_word(model + _NJNT)


@internal
def mocaps(model: int) -> int:
    return load_word(model + _NMOCAP)


@internal
def is_movable(model: int, body: int) -> bool:
    """Return whether a body is not fixed to the world."""
    return integer(model, _WELD, body) != 0


@internal
def plugins(model: int) -> int:
    return load_word(model + _NPLUGIN)


@internal
def actuators(model: int) -> int:
    return load_word(model + _NACTUATOR)


@internal
def tendons(model: int) -> int:
    return load_word(model + _NTENDON)


@internal
def equalities(model: int) -> int:
    return load_word(model + _NEQ)


@internal
def has_userdata(model: int) -> bool:
    """Return whether a simulation has numbers that belong to its user."""
    return load_word(model + _NUSERDATA) > 0


@internal
def _name(model: int, field: int, index: int) -> Bytes:
    return text(load_word(model + _NAMES) + integer(model, field, index))


@internal
def plugin_name(model: int, instance: int) -> Bytes:
    return _name(model, _PLUGIN_NAME, instance)


@internal
def actuator_name(model: int, actuator: int) -> Bytes:
    return _name(model, _ACTUATOR_NAME, actuator)


@internal
def tendon_name(model: int, tendon: int) -> Bytes:
    return _name(model, _TENDON_NAME, tendon)


@internal
def body_name(model: int, body: int) -> Bytes:
    return _name(model, _BODY_NAME, body)


@internal
def site_name(model: int, site: int) -> Bytes:
    return _name(model, _SITE_NAME, site)


@internal
def geom_name(model: int, geom: int) -> Bytes:
    return _name(model, _GEOM_NAME, geom)


@internal
def force(data: int, output: int) -> float:
    """Return an element of `actuator_force`."""
    return real(data, ACTUATOR_FORCE, output)


@internal
def attributes(model: int, instance: int) -> int:
    """Return the address of the attribute block of a plugin instance."""
    return load_word(model + _PLUGIN_ATTR) + integer(model, _PLUGIN_ATTRADR, instance)


@internal
def state(model: int, data: int, instance: int) -> int:
    start = integer(model, STATE_ADDRESS, instance)
    return load_word(data + PLUGIN_STATE) + 8 * start


@internal
def first_cable(model: int, instance: int) -> int:
    """Return the first instance of the plugin that this instance belongs to."""
    kind = integer(model, PLUGIN, instance)
    other = 0
    while integer(model, PLUGIN, other) != kind:
        other += 1
    return other


@internal
def block(data: int, instance: int) -> int:
    """Return the address that `plugin_data` holds for an instance."""
    return load_word(load_word(data + _PLUGIN_DATA) + 8 * instance)


@internal
def is_plugin(data: int, instance: int, kind: int) -> bool:
    """Return whether data were made with an instance of the plugin of this number."""
    return (
        instance < load_integer(data + _DATA_NPLUGIN)
        and integer(data, _DATA_PLUGIN, instance) == kind
    )


@internal
def set_block(data: int, instance: int, address: int) -> None:
    """Store an address in `plugin_data`."""
    store_word(load_word(data + _PLUGIN_DATA) + 8 * instance, address)
