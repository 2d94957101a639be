"""What is written onto the disk, and the process that does it for one format with less and less room."""

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

ROOM_KB = (0, 1, 2, 4, 6, 8, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128, 160, 192, 224, 256)
OLD = b"the file that was there"
Write = Callable[[Path], object]


def writers(copied: Path) -> dict[str, Write]:
    """What writes a file of each ending: all formats of the program, a session, and a copy of one."""
    from runtime.formats.options import ExportOptions
    from runtime.formats.table import FORMATS, save_motion
    from runtime.session.session_file import SessionFile
    from runtime.terrain.height_map import Terrain
    from tests.fuzz.files import clip
    from viewer.filming.shots import FilmOptions
    from viewer.filming.writers import open_writer

    long = clip().resampled(1000.0)

    def film(path: Path) -> None:
        from concurrent.futures import ThreadPoolExecutor

        noise = np.random.default_rng(0).integers(0, 255, (20, 90, 160, 3), np.uint8)
        size = FilmOptions(160, 90).size
        with open_writer(path, size, 30.0) as write, ThreadPoolExecutor(1) as pool:
            for done in [pool.submit(write, frame) for frame in noise]:  # as `make_film` queues them
                done.result()

    def motion(path: Path) -> None:
        save_motion(long, path, ExportOptions(fps=long.fps), Terrain.flat())

    formats = {suffix: film if format.film else motion for suffix, format in FORMATS.items()}
    return {**formats, ".sport": session, "copy.sport": partial(SessionFile.copy, copied)}


def session(path: Path) -> None:
    """Make a session with a recording of ten seconds, and close it; SportError where not all is in the file."""
    from runtime.errors import FileError
    from runtime.session.motion import MotionHeader
    from runtime.session.recording import FRAME_NUMBERS
    from runtime.session.session_file import SessionFile
    from runtime.takes.input_recording import COLUMNS

    file = SessionFile.create(path, path.parent / "characters")
    recording = file.begin_recording(MotionHeader("full", 60.0, 0))
    rows = np.random.default_rng(0).normal(size=(10, FRAME_NUMBERS)).astype(np.float32)
    for _ in range(60):
        recording.add(rows, np.zeros((10, COLUMNS)))
    if not file.close(2.0):
        raise FileError(file.problem, "")


def main(ending: str, disk: Path, copied: Path) -> None:
    """Write with each room, an old file there or not; print what came out, a line of JSON each."""
    from runtime.errors import SportError

    write = writers(copied)[ending]
    for room_kb in ROOM_KB:
        for old in (False, True):
            for path in disk.iterdir():
                path.unlink()
            target = disk / f"out{ending}"
            if old:
                target.write_bytes(OLD)
            fill(disk, room_kb)
            before = sorted(path.name for path in disk.iterdir())
            said = ""
            print(json.dumps({"begin": room_kb}), flush=True)
            try:
                write(target)
            except SportError as error:
                said = str(error)
            except Exception as error:
                said = f"DEFECT {type(error).__name__}: {error}"
            after = sorted(path.name for path in disk.iterdir())
            kept = not old or (target.is_file() and (target.read_bytes() == OLD or not said))
            left = sorted(set(after) - set(before)) if said else []
            row = {"kb": room_kb, "old": old, "said": said, "left": left, "kept": kept}
            print(json.dumps(row), flush=True)


def fill(disk: Path, room_kb: int) -> None:
    """Leave so much room."""
    import os

    free = os.statvfs(disk)
    size = free.f_bavail * free.f_frsize - 1024 * room_kb
    with (disk / "filler").open("wb") as file:
        file.write(bytes(max(size, 0)))


if __name__ == "__main__":
    main(sys.argv[1], *map(Path, sys.argv[2:]))
