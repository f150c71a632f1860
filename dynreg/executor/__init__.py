"""Independent work, handed out: one noun `Executor` with one verb `map`, on this machine or on workers of Ray.

A function is a module-level name and a job is plain data, so that a worker needs nothing but dynreg of the same version
and the registry. Commands divide their work into jobs; no scheduler is written here.
"""

from dynreg.executor.executor import Executor as Executor
from dynreg.executor.executor import Local as Local
from dynreg.executor.table import LOCAL as LOCAL
from dynreg.executor.table import NAMES as NAMES
from dynreg.executor.table import opened as opened
