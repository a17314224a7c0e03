from ._cables import AttachedCables as AttachedCables
from ._cables import attach as attach
from ._model import HeldCable as HeldCable
from ._model import add_end as add_end
from ._spec import without_plugin as without_plugin
