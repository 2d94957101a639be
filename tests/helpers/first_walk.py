"""`python -m tests.helpers.first_walk LINE FOLDER`: runs a line of shell in a folder until the character in its window walks.

The window is on a virtual screen (Xvfb, xdotool). W is held, and T keeps the last seconds as a take of the session.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from runtime.errors import SportError
from runtime.session.session_file import SessionFile
from tests.faults.faults import display

MIN_WALKED_M = 1.0
END_S = 600.0  # including downloads of the line


def main() -> None:
    """Print the distance walked; exit with an error if the line ends early, or nobody walks."""
    line, folder = sys.argv[1], Path(sys.argv[2])
    with display() as (_, name), tempfile.TemporaryDirectory() as home:
        env = {**os.environ, "DISPLAY": name, "WAYLAND_DISPLAY": "", "SPORT_CONFIG_DIR": home}
        process = subprocess.Popen(["bash", "-c", line], cwd=folder, env=env, start_new_session=True)
        try:
            end, metres = time.monotonic() + END_S, 0.0
            while metres < MIN_WALKED_M:
                if process.poll() is not None or time.monotonic() > end:
                    sys.exit(f"nobody walked (exit code {process.poll()})")
                for key in (["keydown", "w"], ["sleep", "3", "keyup", "w"], ["key", "t"]):
                    subprocess.run(["xdotool", *key], env=env, check=False, stderr=subprocess.DEVNULL)
                metres = walked(Path(home))
            print(f"walked {metres:.1f} m")
        finally:
            os.killpg(process.pid, signal.SIGKILL)


def walked(home: Path) -> float:
    """Return the longest distance, m, between first and last frame of a take in the sessions of a running program."""
    ways = [0.0]
    for path in home.rglob("*.sport"):
        copy = path.with_suffix(".copy")
        try:
            SessionFile.copy(path, copy)
            file, history = SessionFile.open(copy, home)
            clips = [take.made.clip for take in history.present.session.takes]
            ways += [float(np.linalg.norm(np.ptp(clip.hips_positions[[0, -1]], axis=0))) for clip in clips]
            file.close()
        except SportError:  # it is still being created
            continue
        finally:
            copy.unlink(missing_ok=True)
    return max(ways)


if __name__ == "__main__":
    main()
