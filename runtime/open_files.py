"""How many files this process may hold open: each take that is nowhere else holds its journal, for the lock on it."""

from __future__ import annotations

import contextlib

try:
    import resource
except ImportError:  # Windows has no such limit below some thousands
    resource = None  # type: ignore[assignment]

MOST = 65_536  # asked for where there is no limit at all


def allow_many_files() -> None:
    """Raise the limit that programs begin with, often 256 or 1,024, to what the system lets this one have."""
    if resource is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST if hard == resource.RLIM_INFINITY else hard
    if soft != resource.RLIM_INFINITY and soft < most:
        for wanted in (most, 10_240):  # macOS has a smaller one that it does not tell
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(resource.RLIMIT_NOFILE, (max(wanted, soft), hard))
                return
