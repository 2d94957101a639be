"""Where rows are made: processes of this machine, or a Ray cluster behind the same interface, `concurrent.futures.Executor`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from typing import Any, TypeVar

from runtime.errors import UsageError

RETRIES = 2  # of a row whose machine is gone
# one thread in each process: the rows are what runs side by side
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
_T = TypeVar("_T")


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processes(workers: int) -> ProcessPoolExecutor:
    """Processes of this machine, each with one thread."""
    os.environ.update(THREADS)  # for the processes that begin here
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin)


def _begin() -> None:
    """A worker ends with the process that leads, however that went; Ctrl+C is for the latter."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    leader = multiprocessing.parent_process()
    assert leader is not None

    def follow() -> None:
        leader.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


class RayExecutor(Executor):
    """The cores of a Ray cluster; the address "local" starts one of `workers` here. UsageError without one."""

    def __init__(self, address: str, workers: int) -> None:
        try:
            import ray
        except ModuleNotFoundError as error:
            raise UsageError(
                ": the Python package 'ray' is not installed.", "Run pip install -e '.[ray]'.", "ray"
            ) from error
        own = {"num_cpus": workers, "include_dashboard": False} if address == "local" else {}
        try:
            ray.init(
                address,
                log_to_driver=False,
                configure_logging=False,
                runtime_env={"env_vars": THREADS},
                **own,
            )
        except Exception as error:  # Ray raises that itself where a node does not start in time
            said = (str(error) or type(error).__name__).splitlines()[0][:200]
            raise UsageError(f" {address}: {said}.", "Name a cluster that runs, or local.", "ray") from error
        self._ray = ray
        self.workers = max(int(ray.cluster_resources().get("CPU", 1)), 1)

    def submit(self, fn: Callable[..., _T], /, *args: Any, **kwargs: Any) -> Future[_T]:
        """Call a function on a core of the cluster."""
        future: Future[_T] = (
            self._ray.remote(num_cpus=1, max_retries=RETRIES)(fn).remote(*args, **kwargs).future()
        )
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster."""
        self._ray.shutdown()
