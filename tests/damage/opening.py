"""What opening and playing a session costs, in a process of its own: `python -m tests.damage.opening FILE`."""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

from runtime.errors import SportError
from runtime.session.session_file import SessionFile


def main(path: Path) -> None:
    """Open a file, load its first take, and print seconds of both, megabytes, and what was said."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun, opened, said, cpu_begun = time.perf_counter(), 0.0, "", time.process_time()
    try:
        file, history = SessionFile.open(path, path.parent / "cache")
        opened = time.perf_counter() - begun
        said = file.repaired
        takes = history.present.session.takes
        if takes:
            len(takes[0].clip)
        file.close()
    except SportError as error:
        said = str(error)
    seconds = time.perf_counter() - begun
    cpu = time.process_time() - cpu_begun
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"{opened or seconds:.2f} s, {seconds - opened if opened else 0.0:.2f} s, {cpu:.2f} s of the processor, {most >> 10} MB (before {before >> 10}): {said[-150:]}"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
