"""The physics of cables in conduits: parameters, friction, kernel, pulleys, replay."""

from cc_mujoco.transmission.conduit import Conduit, Replay, replay, rest_state
from cc_mujoco.transmission.parameter import Parameter, Term
from cc_mujoco.transmission.parameters import PARAMETERS, TERMS, Cable, Section
from cc_mujoco.transmission.pulleys import Driven, Transmission

__all__ = [
    "PARAMETERS",
    "TERMS",
    "Cable",
    "Conduit",
    "Driven",
    "Parameter",
    "Replay",
    "Section",
    "Term",
    "Transmission",
    "replay",
    "rest_state",
]
