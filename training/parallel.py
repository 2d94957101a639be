"""Training in several processes, one per GPU or core: `sport train --processes`, or torchrun with several GPUs.

    torchrun --nproc-per-node 4 -m sport train stage2 --preset paper-rotations --clips DIR --out RUN --batch 2048

Every process draws its part of a batch, and gradients are averaged, so that all keep the same weights. The first
process writes checkpoints and log.
"""

import logging
import os
import socket
from collections.abc import Callable, Iterable
from typing import ParamSpec

import torch
import torch.distributed as distributed
from torch import nn

from runtime.errors import UsageError

Arguments = ParamSpec("Arguments")
STAGES = ("stage2", "stage3", "ground")  # the others are quick, or every process would write the same files


def rank() -> int:
    """Return the number of this process, 0 if there is only one."""
    return int(os.environ.get("RANK", "0"))


def workers() -> int:
    """Return the number of processes that train together."""
    return int(os.environ.get("WORLD_SIZE", "1"))


def join(stage: str) -> torch.device | None:
    """Join the other processes and return this one's device, None if there is only one; UsageError for other stages."""
    if workers() == 1:
        return None
    if stage not in STAGES:
        raise UsageError(
            f"train {stage}: cannot be run in several processes.", f"Run it alone; {', '.join(STAGES)} can."
        )
    cuda = torch.cuda.is_available()
    local = int(os.environ.get("LOCAL_RANK", "0"))
    if cuda:
        torch.cuda.set_device(local)
    if not distributed.is_initialized():
        distributed.init_process_group("nccl" if cuda else "gloo")
    return torch.device("cuda", local) if cuda else torch.device("cpu")


def run_together(
    count: int, work: Callable[Arguments, object], *args: Arguments.args, **options: Arguments.kwargs
) -> None:
    """Call `work(*args, **options)` in `count` processes of this machine, which share its cores and meet in `join`.

    An exception of a process is raised here, with its traceback.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    torch.multiprocessing.spawn(_process, (count, port, work, args, options), nprocs=count)


def _process(
    number: int, count: int, port: int, work: Callable[..., object], args: tuple, options: dict
) -> None:
    os.environ |= {"RANK": str(number), "LOCAL_RANK": str(number), "WORLD_SIZE": str(count)}
    os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    torch.set_num_threads(max(1, (os.cpu_count() or 1) // count))
    work(*args, **options)
    wait()  # the first process hosts the rendezvous: it must not exit before the others
    if distributed.is_initialized():
        distributed.destroy_process_group()
    logging.shutdown()
    os._exit(0)  # gloo's threads sometimes abort the process during interpreter shutdown


@torch.no_grad()
def same_weights(module: nn.Module) -> None:
    """Broadcast the weights and buffers of the first process."""
    if workers() > 1:
        for value in module.state_dict().values():
            distributed.broadcast(value, 0)


@torch.no_grad()
def average_gradients(parameters: Iterable[nn.Parameter]) -> None:
    """Replace the gradients by their mean over all processes, in one exchange."""
    gradients = [p.grad for p in parameters if p.grad is not None]
    if workers() == 1 or not gradients:
        return
    flat = torch.cat([g.flatten() for g in gradients])
    distributed.all_reduce(flat)
    flat /= workers()
    for gradient, mean in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
        gradient.copy_(mean.view_as(gradient))


def wait() -> None:
    """Wait for all processes, for example for a file that the first one writes."""
    if workers() > 1:
        distributed.barrier()


def of_first(number: float) -> float:
    """Broadcast a number of the first process."""
    if workers() == 1:
        return number
    known = torch.tensor([number], device="cuda" if torch.cuda.is_available() else "cpu", dtype=torch.float64)
    distributed.broadcast(known, 0)
    return float(known.item())
