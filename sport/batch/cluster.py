"""Rows on a Ray cluster: the same function of a task; files come back to the machine that asked."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from runtime.errors import UsageError
from sport.batch.manifest import entry
from sport.batch.plan import Task
from sport.batch.work import THREADS, Maker, put

RETRIES = 2  # of a row whose machine is gone
AHEAD = 2  # rows that wait for each core


def run_ray(
    tasks: Sequence[Task], target: Path, scratch: Path, address: str, workers: int
) -> Iterator[dict[str, Any]]:
    """The line of each task as it is finished, its files in place; `address` "local" starts a cluster of `workers` here.

    UsageError without ray or where no cluster answers.
    """
    ray = _connect(address, workers)
    try:
        remote = ray.remote(num_cpus=1, max_retries=RETRIES)(make_remote)
        waiting = list(reversed(tasks))
        under_way: dict[Any, Task] = {}
        room = AHEAD * max(int(ray.cluster_resources().get("CPU", 1)), 1)
        while waiting or under_way:
            while waiting and len(under_way) < room:
                task = waiting.pop()
                under_way[remote.remote(task)] = task
            (done,), _ = ray.wait(list(under_way), num_returns=1)
            yield _received(ray, done, under_way.pop(done), target, scratch)
    finally:
        ray.shutdown()


def make_remote(task: Task) -> tuple[dict[str, Any], dict[str, bytes]]:
    """On a worker of the cluster: a task's line and its files."""
    with tempfile.TemporaryDirectory(prefix="sport-batch-") as name:
        folder = Path(name) / "row"
        line = _maker().make(task, folder)
        return line, {name: (folder / name).read_bytes() for name in line["files"]}


@lru_cache(maxsize=1)
def _maker() -> Maker:
    """One for each process of the cluster, so that models are read once."""
    return Maker()


def _connect(address: str, workers: int) -> Any:
    try:
        import ray
    except ModuleNotFoundError as error:
        raise UsageError(
            ": the Python package 'ray' is not installed.", "Run pip install -e '.[ray]'.", "ray"
        ) from error
    own = {"num_cpus": workers, "include_dashboard": False} if address == "local" else {}
    try:
        ray.init(
            address=address, log_to_driver=False, configure_logging=False, runtime_env={"env_vars": dict(THREADS)}, **own
        )  # fmt: skip
    except Exception as error:  # Ray raises that itself where a node does not start in time
        said = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise UsageError(f" {address}: {said}.", "Name a cluster that runs, or local.", "ray") from error
    return ray


def _received(ray: Any, done: Any, task: Task, target: Path, scratch: Path) -> dict[str, Any]:
    """The line of a task that came back, its files written."""
    try:
        line, files = ray.get(done)
    except ray.exceptions.RayError as error:
        said = str(error).strip().splitlines() or [type(error).__name__]
        return entry(task.number, task.values, task.key, f"Ray: {said[0][:200]}")
    folder = scratch / f"{task.number}"
    try:
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        if not line["error"]:
            put(folder, line, target)
    except OSError as error:
        return entry(task.number, task.values, task.key, f"{error.filename}: {error.strerror or error}")
    return dict(line)
