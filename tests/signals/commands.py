"""A command in folders of its own, ended by a signal; and what is wrong with how it ended."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
SPORT = (sys.executable, "-m", "sport")
# shader caches of the driver, what finished runs leave too, and frames that are whole: each is what was asked for
KEPT = re.compile(
    r"mesa_shader_cache|\.sport-batch\.lock|manifest\.jsonl|settings\.json|characters|^work/frames(/frame_\d+\.png)?$"
    r"|^work/clips(/\d+\.bvh(\.json)?)?$|__pycache__"
)

_GENERATE = "generate --prompt zombie --seconds 2 --out"
COMMANDS: dict[str, str] = {
    "view --offscreen": "view --offscreen --frames 90 --keys 'w 5'",
    "view --save-frames": "view --offscreen --frames 90 --save-frames frames",
    "view --session": "view --offscreen --frames 90 --session one.sport",
    "generate bvh": f"{_GENERATE} new/a.bvh",
    "generate mp4": f"{_GENERATE} a.mp4 --size 320x180",
    "generate --batch": "generate --batch list.csv --out clips --workers 2 --seconds 2",
    **{
        f"convert {suffix}": f"convert take.bvh out{suffix} --size 320x180"
        for suffix in (".mp4", ".png", ".webp", ".gif")
    },
    **{
        f"convert {suffix}": f"convert long.bvh out{suffix}"
        for suffix in (".usdz", ".usd", ".html", ".parquet", ".csv", ".npz", ".glb", ".fbx", ".vrma", ".bvh")
    },
    "restyle": "restyle take.bvh --prompt zombie --out out.bvh",
    "bench": "bench --frames 20 --json bench.json",
    "evaluate": "evaluate --clips capture --quick --styles neutral old --seconds 3 --json scores.json",
    "study": "-m benchmarks.study make study --model a=compact --model b=open --seconds 2",
}


def words(line: str) -> list[str]:
    """The command line of an entry of `COMMANDS`."""
    import shlex

    found = shlex.split(line)
    return [sys.executable, *found] if found[0] == "-m" else [*SPORT, *found]


@dataclass
class Ended:
    """How a command ended after a signal."""

    code: int
    seconds: float  # from the signal on
    said: str
    left: list[str] = field(default_factory=list)  # files that were not there before
    running: int = 0  # processes of it that run on

    def problems(self, number: int, limit_s: float) -> list[str]:
        """What is wrong; a command that was over before the signal came has its own code and its files."""
        if self.code == 0:
            return [self.said] if "Traceback" in self.said else []
        found = []
        if self.code != 128 + number:
            found.append(f"code {self.code}")
        lines = [line for line in self.said.splitlines() if "stopped by" in line]
        if (
            len(lines) != 1
            or "Traceback" in self.said
            or "terminate called" in self.said
            or "Error" in self.said
        ):
            found.append(f"said {self.said[-600:]!r}")
        if self.left:
            found.append(f"left {self.left[:6]}")
        if self.running:
            found.append(f"{self.running} processes run on")
        if self.seconds > limit_s:
            found.append(f"{self.seconds:.2f} s")
        return found


class Place:
    """Folders for a command: where it works, the home and the temporary folder that it sees."""

    def __init__(self, folder: Path, inputs: Path | None = None) -> None:
        self.folder = folder
        for name in ("work", "home", "tmp"):
            (folder / name).mkdir(parents=True)
        if inputs:
            shutil.copytree(inputs, folder / "work", dirs_exist_ok=True)
        self.before = self.files()

    def environment(self) -> dict[str, str]:
        """The environment of the command."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "SPORT_"))}
        own = {"HOME": str(self.folder / "home"), "TMPDIR": str(self.folder / "tmp")}
        return kept | own | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}

    def files(self) -> set[str]:
        """All files and folders of the work and temporary folders, and the files of the home."""
        found = set()
        for path in self.folder.rglob("*"):
            name = path.relative_to(self.folder).as_posix()
            if not KEPT.search(name) and (path.is_file() or not name.startswith("home")):
                found.add(name)
        return found

    def start(self, command: list[str]) -> subprocess.Popen[str]:
        """Begin the command, as leader of a session of its own; its output is in the files "out" and "err"."""
        out, err = (self.folder / name for name in ("out", "err"))
        self.before |= {"out", "err"}
        with out.open("w") as stdout, err.open("w") as stderr:
            return subprocess.Popen(
                command, cwd=self.folder / "work", env=self.environment(), stdin=subprocess.DEVNULL,
                stdout=stdout, stderr=stderr, text=True, start_new_session=True, preexec_fn=_heed,
            )  # fmt: skip

    def ended(self, process: subprocess.Popen[str], since: float, limit_s: float = 60.0) -> Ended:
        """Wait for the command; what it left. `since` is the time of the signal."""
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
        seconds = time.monotonic() - since
        end, running = time.monotonic() + 3.0, others(process.pid)
        while running and time.monotonic() < end:
            time.sleep(0.05)
            running = others(process.pid)
        left = sorted(self.files() - self.before)
        said = (self.folder / "err").read_text(errors="replace")
        return Ended(code if code >= 0 else 128 - code, seconds, said, left, len(running))


def _heed() -> None:
    """Take the signals as a command in the foreground does: a shell has its background jobs ignore Ctrl+C."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def others(session: int) -> list[int]:
    """Processes of a session that live."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(status.parent.name))
    return found


def run_signalled(place: Place, command: list[str], after_s: float, number: int, group: bool) -> Ended:
    """Begin a command, send a signal to it (or to all of its processes) so long after, and wait."""
    process = place.start(command)
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        (os.killpg if group else os.kill)(process.pid, number)
    return place.ended(process, time.monotonic())
