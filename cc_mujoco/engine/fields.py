"""Reading `mjModel` and `mjData` in compiled code, at the offsets of `layout.py`."""

from __future__ import annotations

from numba import njit

from cc_mujoco.engine.layout import offset, structure
from cc_mujoco.engine.memory import Bytes, floats, integers, text, words


def _model(field: str) -> int:
    return offset("mjModel", field)


def _data(field: str) -> int:
    return offset("mjData", field)


_OPTION = _model("opt")
_TIMESTEP = _OPTION + structure("mjOption").timestep.offset
_INTEGRATOR = _OPTION + structure("mjOption").integrator.offset
_NACTUATOR = _model("nactuator")
_NTENDON = _model("ntendon")
_NAMES = _model("names")
_PLUGIN_NAME = _model("name_pluginadr")
_ACTUATOR_NAME = _model("name_actuatoradr")
_TENDON_NAME = _model("name_tendonadr")
_PLUGIN_ATTR = _model("plugin_attr")
_PLUGIN_ATTRADR = _model("plugin_attradr")
_PLUGIN_STATEADR = _model("plugin_stateadr")
_PLUGIN_STATE = _data("plugin_state")
_PLUGIN_DATA = _data("plugin_data")
_TIME = _data("time")

ACTUATOR_PLUGIN = _model("actuator_plugin")
ACTUATOR_TRNTYPE = _model("actuator_trntype")
ACTUATOR_TRNID = _model("actuator_trnid")
ACTUATOR_OUTADR = _model("actuator_outadr")
ACTUATOR_GEAR = _model("actuator_gear")
ACTUATOR_LENGTH0 = _model("actuator_length0")
JNT_TYPE = _model("jnt_type")
TENDON_ADR = _model("tendon_adr")
WRAP_TYPE = _model("wrap_type")
LENGTH = _data("actuator_length")
FORCE = _data("actuator_force")


@njit(nogil=True)
def pointer(struct: int, field: int) -> int:
    """Address that a pointer field holds."""
    return words(struct + field, 1)[0]


@njit(nogil=True)
def integer(struct: int, field: int, index: int) -> int:
    """Element of an int array field."""
    return integers(pointer(struct, field) + 4 * index, 1)[0]


@njit(nogil=True)
def real(struct: int, field: int, index: int) -> float:
    """Element of an mjtNum array field."""
    return floats(pointer(struct, field) + 8 * index, 1)[0]


@njit(nogil=True)
def timestep(model: int) -> float:
    """Time step of the model [s]."""
    return floats(model + _TIMESTEP, 1)[0]


@njit(nogil=True)
def integrator(model: int) -> int:
    """Integrator of the model, an `mjtIntegrator`."""
    return integers(model + _INTEGRATOR, 1)[0]


@njit(nogil=True)
def time(data: int) -> float:
    """Simulation time [s]."""
    return floats(data + _TIME, 1)[0]


@njit(nogil=True)
def actuators(model: int) -> int:
    """Number of actuators."""
    return words(model + _NACTUATOR, 1)[0]


@njit(nogil=True)
def tendons(model: int) -> int:
    """Number of tendons."""
    return words(model + _NTENDON, 1)[0]


@njit(nogil=True)
def _name(model: int, field: int, index: int) -> Bytes:
    return text(pointer(model, _NAMES) + integer(model, field, index))


@njit(nogil=True)
def plugin_name(model: int, instance: int) -> Bytes:
    """Name of a plugin instance."""
    return _name(model, _PLUGIN_NAME, instance)


@njit(nogil=True)
def actuator_name(model: int, actuator: int) -> Bytes:
    """Name of an actuator."""
    return _name(model, _ACTUATOR_NAME, actuator)


@njit(nogil=True)
def tendon_name(model: int, tendon: int) -> Bytes:
    """Name of a tendon."""
    return _name(model, _TENDON_NAME, tendon)


@njit(nogil=True)
def attributes(model: int, instance: int) -> int:
    """Address of the attribute block of a plugin instance."""
    return pointer(model, _PLUGIN_ATTR) + integer(model, _PLUGIN_ATTRADR, instance)


@njit(nogil=True)
def state(model: int, data: int, instance: int) -> int:
    """Address of the state of a plugin instance."""
    start = integer(model, _PLUGIN_STATEADR, instance)
    return pointer(data, _PLUGIN_STATE) + 8 * start


@njit(nogil=True)
def block(data: int, instance: int) -> int:
    """Address that `plugin_data` holds for an instance."""
    return words(pointer(data, _PLUGIN_DATA) + 8 * instance, 1)[0]


@njit(nogil=True)
def set_block(data: int, instance: int, address: int) -> None:
    """Store an address in `plugin_data`."""
    words(pointer(data, _PLUGIN_DATA) + 8 * instance, 1)[0] = address
