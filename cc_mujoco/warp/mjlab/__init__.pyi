from ._actuator import CableActuator as CableActuator
from ._actuator import CableActuatorCfg as CableActuatorCfg
from ._actuator import DrivenCable as DrivenCable
from ._terms import cable_tension as cable_tension
from ._terms import capture_cables as capture_cables
from ._terms import randomize_cables as randomize_cables
