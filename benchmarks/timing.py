"""Common timing functions of the benchmarks."""

import platform
import time
from collections.abc import Callable
from pathlib import Path


def times_ms(work: Callable[[], object], count: int, warm_up: int = 0) -> list[float]:
    """Measure the milliseconds of each of `count` calls, after `warm_up` calls."""
    return clock_and_processor_ms(work, count, warm_up)[0]


def clock_and_processor_ms(
    work: Callable[[], object], count: int, warm_up: int = 0
) -> tuple[list[float], list[float]]:
    """Measure wall and total CPU milliseconds of each call; the latter hardly depend on other load."""
    times, processor = [], []
    for number in range(warm_up + count):
        begin, used = time.perf_counter(), time.process_time()
        work()
        if number >= warm_up:
            times.append(1e3 * (time.perf_counter() - begin))
            processor.append(1e3 * (time.process_time() - used))
    return times, processor


def cpu_name() -> str:
    """Return the system's name of the CPU."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()
