from ._bench import Bench as Bench
from ._smoothing import velocity as velocity
from ._trials import Dataset as Dataset
from ._trials import Noise as Noise
from ._trials import Trial as Trial
from ._trials import TrialFacts as TrialFacts
