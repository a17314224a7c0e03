from ._cables import AttachedCables as AttachedCables
from ._cables import attach as attach
from ._spec import without_plugin as without_plugin
