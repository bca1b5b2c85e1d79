"""One door to several processes or threads: how many, for how long, and with how much memory, and
that no process outlives its parent.

`SYSID_JOBS` (the command line's `--jobs`) bounds the processes; 1 means none but one's own, and
without it there is one to each core. Within `on_cluster` the jobs go to a Dask cluster.
"""

from sysid.parallel.cluster import LOCAL, Cluster, on_cluster
from sysid.parallel.limits import (
    Failure,
    OutOfTimeError,
    attempt,
    check_time,
    error_of,
    on_its_own,
    time_limit,
)
from sysid.parallel.memory import give_back, share_one_heap
from sysid.parallel.processes import VARIABLE, attempt_all, check_jobs, job_count, run_all
from sysid.parallel.threads import PerThread, attempt_in_threads, kept_per_thread

__all__ = [
    "LOCAL",
    "VARIABLE",
    "Cluster",
    "Failure",
    "OutOfTimeError",
    "PerThread",
    "attempt",
    "attempt_all",
    "attempt_in_threads",
    "check_jobs",
    "check_time",
    "error_of",
    "give_back",
    "job_count",
    "kept_per_thread",
    "on_cluster",
    "on_its_own",
    "run_all",
    "share_one_heap",
    "time_limit",
]
