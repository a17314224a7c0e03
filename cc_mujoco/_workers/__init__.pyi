from .cluster import WORKER_TIMEOUT as WORKER_TIMEOUT
from .cluster import run_on_cluster as run_on_cluster
from .local_executor import Job as Job
from .local_executor import Progress as Progress
from .local_executor import Tick as Tick
from .local_executor import run_here as run_here
