"""Jobs on a Dask cluster: one that exists, or a local one for the time of a block.

Dask's own client sends the jobs, not joblib's Dask backend: that backend keeps large arguments on
one worker alone (`client.scatter`), and they would be lost with it. A job is sent with its data,
and the scheduler gives it to another worker if one dies.
"""

from __future__ import annotations

import gc
import importlib
import logging
import os
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from sysid.errors import input_error, one_line

Result = TypeVar("Result")

LOCAL = "local"
_HERE = "127.0.0.1"
_CONNECT_S = 10.0
VARIABLE = "SYSID_JOBS"
# A process has one of each: matplotlib's settings, jax's compiled programs.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Cluster:
    """A Dask client in use: the scheduler's `address`, its `dashboard` (empty without one)."""

    client: Any
    address: str
    dashboard: str

    def workers(self) -> int:
        """The number of its threads that work."""
        return int(sum(self.client.ncores().values()))


_CLUSTER: ContextVar[Cluster | None] = ContextVar("cluster", default=None)


def cluster_in_force() -> Cluster | None:
    """The cluster of the present context; None where jobs run in processes of this machine."""
    return _CLUSTER.get()


@contextmanager
def on_cluster(scheduler: str, workers: int) -> Iterator[Cluster]:
    """`run_all` and `attempt_all` send their jobs to a Dask cluster within the block.

    `scheduler` is the address of a running one, `tcp://host:8786`, or "local": a scheduler and
    `workers` processes of one thread each on this machine, stopped at the end. That one is heard
    on 127.0.0.1 only, and takes work only from this process: both have a certificate that is made
    for the block. What is shown to a running one, Dask's configuration says
    (`distributed.comm.tls`). Raises InputError where dask is not installed, no scheduler answers,
    or it has no workers.
    """
    distributed = _distributed()
    with _client(distributed, scheduler, workers) as client:
        made = Cluster(client, client.scheduler.address, client.dashboard_link or "")
        token = _CLUSTER.set(made)
        try:
            yield made
        finally:
            _CLUSTER.reset(token)


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise input_error(
            "--scheduler", "needs dask, which is not installed", "pip install 'sysid[cluster]'"
        ) from None


def _own(distributed: Any) -> Any:
    """A certificate for one cluster. Whoever sends it work runs code as this user."""
    try:
        return distributed.Security.temporary()
    except ImportError:
        raise input_error(
            f"--scheduler {LOCAL}",
            "needs cryptography, which is not installed",
            "pip install 'sysid[cluster]'",
        ) from None


@contextmanager
def collector_off() -> Iterator[None]:
    """No garbage is collected within the block.

    A client that could not connect is closed when it is collected, and waits there for a lock that
    one being made holds: where the collector ran in between, both stood still for ever.
    """
    gc.collect()
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextmanager
def _client(distributed: Any, scheduler: str, workers: int) -> Iterator[Any]:
    if scheduler == LOCAL:
        made = {"n_workers": workers, "threads_per_worker": 1, "processes": True}
        heard = {"host": _HERE, "dashboard_address": f"{_HERE}:0", "security": _own(distributed)}
        with collector_off():
            cluster = distributed.LocalCluster(**made, **heard, silence_logs=logging.CRITICAL)
        with cluster:
            with collector_off():
                client = distributed.Client(cluster, set_as_default=False)
            with client:
                yield client
        return
    try:
        # What is bad leaves no client behind, which waits for 20 s where it is collected.
        distributed.comm.get_address_host_port(scheduler)
        _require_keys(distributed, scheduler)
        with collector_off():
            client = distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        said = one_line(str(error))[:120]
        raise input_error(
            f"--scheduler {scheduler}",
            f"no Dask scheduler answers ({said})",
            f'start one with `dask scheduler`, or give "{LOCAL}"',
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_S)
        except (TimeoutError, distributed.TimeoutError):
            raise input_error(
                f"--scheduler {scheduler}", "has no workers", f"start `dask worker {scheduler}`"
            ) from None
        yield client


def _require_keys(distributed: Any, scheduler: str) -> None:
    """Raises InputError for an encrypted address where Dask's configuration names no keys."""
    is_encrypted = scheduler.partition("://")[0] in ("tls", "wss")
    if is_encrypted and not distributed.Security().get_connection_args("client")["ssl_context"]:
        raise input_error(
            f"--scheduler {scheduler}",
            "no Dask scheduler answers without keys, and Dask's configuration names none",
            f'name the files of the keys there (docs: how-to/many-rigs), or give "{LOCAL}"',
        )


def collect_on(
    cluster: Cluster,
    found: dict[int, Result],
    waiting: Mapping[int, Callable[[], Result]],
) -> None:
    """Put each job's result into `found`, by its number, as it comes.

    Where a job raises or dies with its workers, the others are waited for all the same: Dask cannot
    interrupt what runs, and a job that is sent again would run twice at once. Then raises what the
    first of them raised.
    """
    distributed = _distributed()
    numbers = {
        cluster.client.submit(
            partial(_alone, job), key=f"sysid-{uuid.uuid4().hex}", pure=False
        ): number
        for number, job in waiting.items()
    }
    errors: list[Exception] = []
    try:
        loop = cluster.client.loop
        for future in distributed.as_completed(list(numbers), loop=loop):
            try:
                found[numbers[future]] = future.result()
            except Exception as error:
                errors.append(error)
    finally:
        cluster.client.cancel([f for f in numbers if not f.done()])
    if errors:
        raise errors[0]


def _alone(job: Callable[[], Result]) -> Result:
    """A job on a worker: no further processes, one thread of BLAS, one job at a time."""
    from threadpoolctl import threadpool_limits

    with _ONE_AT_A_TIME, threadpool_limits(1), _one_process():
        return job()


@contextmanager
def _one_process() -> Iterator[None]:
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


__all__ = [
    "LOCAL",
    "VARIABLE",
    "Cluster",
    "cluster_in_force",
    "collect_on",
    "collector_off",
    "on_cluster",
]
