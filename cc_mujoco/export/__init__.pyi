from ._controllers import EXPORTED as EXPORTED
from ._controllers import ExportPlan as ExportPlan
from ._controllers import Field as Field
from ._files import EXPORT_FILES as EXPORT_FILES
from ._files import require_ours as require_ours
from ._files import write as write
from ._targets import TARGETS as TARGETS
from ._targets import Target as Target
