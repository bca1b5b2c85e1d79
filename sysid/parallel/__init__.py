"""One door to several processes or threads: how many, how much work or processor time they may
take, and with how much memory, and that no process outlives its parent.

`SYSID_JOBS` (the command line's `--jobs`) bounds the processes, and the threads in which batches
are simulated; 1 means none but one's own, and without it there is one to each core. Within
`on_cluster` the jobs go to a Dask cluster.
"""

from sysid.parallel.clock import processor_seconds
from sysid.parallel.cluster import LOCAL, Cluster, on_cluster
from sysid.parallel.limits import (
    LATE,
    Limit,
    attempt,
    limited,
    spend,
)
from sysid.parallel.memory import give_back, share_one_heap
from sysid.parallel.processes import VARIABLE, attempt_all, check_jobs, job_count, run_all
from sysid.parallel.threads import PerThread, attempt_in_threads, in_threads, kept_per_thread

__all__ = [
    "LATE",
    "LOCAL",
    "VARIABLE",
    "Cluster",
    "Limit",
    "PerThread",
    "attempt",
    "attempt_all",
    "attempt_in_threads",
    "check_jobs",
    "give_back",
    "in_threads",
    "job_count",
    "kept_per_thread",
    "limited",
    "on_cluster",
    "processor_seconds",
    "run_all",
    "share_one_heap",
    "spend",
]
