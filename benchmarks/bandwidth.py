"""How fast this machine reads memory: the least time in which a network's weights can be gone through."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

BYTES = 256 << 20  # well beyond any cache


def read_bandwidth(threads: int, repeats: int = 8) -> float:
    """GB/s at which `threads` threads read together: the best of `repeats` searches for a maximum."""
    parts = np.array_split(np.ones(BYTES // 4, np.int32), threads)
    best = float("inf")
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(repeats):
            begin = time.perf_counter()
            list(pool.map(np.max, parts))
            best = min(best, time.perf_counter() - begin)
    return BYTES / best / 1e9
