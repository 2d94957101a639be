"""Sessions of others that name what is not theirs: `python -m tests.damage.hostile` opens 200 and counts what is touched."""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from runtime.assets import PROJECT_ROOT
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import CharacterChoice, Ground, ModelName, Reference, Session, Take
from runtime.session.sqlite_file import lock_of, unwritten_files
from runtime.terrain.height_map import Terrain
from tests.helpers.full_session import history_of, still, written

FOREIGN = "foreign-folder"  # everything there belongs to somebody else
ADDRESS = "127.0.0.1:9"
# what a system call of the traced program must not have
TOUCHED = re.compile(rf"{FOREIGN}|sa_family=AF_INET6?|\"/dev/(?!null|urandom|random|shm|dri|tty|pts)|/net/")


def named(foreign: Path) -> list[str]:
    """Files, addresses and devices that a session may name."""
    return [
        f"http://{ADDRESS}/a.mp4", f"tcp://{ADDRESS}", f"ftp://{ADDRESS}/a.mp4", f"udp://{ADDRESS}", f"rtmp://{ADDRESS}/a",
        f"concat:{foreign}/a.mp4|{foreign}/b.mp4", f"file://{foreign}/a.mp4", f"subfile,,start,0,end,9,,:{foreign}/a.mp4",
        "/dev/video0", "/dev/zero", "/dev/stdin", "/net/host/a.mp4", "//host/share/a.mp4", r"\\host\share\a.mp4",
        f"{foreign}/a.mp4", f"{foreign}/link.mp4", f"{foreign}/pipe.mp4", f"{foreign}", "../../../etc/passwd", "~/a.mp4",
    ]  # fmt: skip


def make(folder: Path, foreign: Path, count: int, first: int) -> None:
    """Write the sessions, each into a folder of its own."""
    foreign.mkdir(parents=True)
    (foreign / "a.mp4").write_bytes(b"\0" * 100)
    (foreign / "link.mp4").symlink_to("a.mp4")
    os.mkfifo(foreign / "pipe.mp4")
    (foreign / "metadata.json").write_text(json.dumps({"sha256": {"step": "ab" * 32}}))
    for number in range(first, first + count):
        rng, path = random.Random(number), folder / f"{number}" / "a.sport"
        names = named(foreign)
        film, ground, character, model, terrain = (rng.choice(names) for _ in range(5))
        link = path.parent / "inside.mp4"
        motion = Motion.of(replace(still(30, "x"), terrain=terrain))
        session = edits.with_new_take(Session(), Take(motion=motion))
        choice, video = CharacterChoice(path=character), str(link) if number % 10 == 0 else film
        session = replace(
            session, reference=Reference(video=video, character=choice), ground=Ground.of(ground, Terrain.flat()),
            character=choice, model=ModelName(model, "mine", rng.choice(["ab" * 32, "0" * 64]), 1),
        )  # fmt: skip
        written(path, history_of(session), path.parent)
        link.symlink_to(foreign / "a.mp4")
        _plant(rng, path, foreign)


def _plant(rng: random.Random, path: Path, foreign: Path) -> None:
    """Links of another program next to a session."""
    file = rng.choice([None, unwritten_files(path)[0], lock_of(path)])
    if file is not None:
        file.symlink_to(foreign / "a.mp4")


def open_all(folder: Path) -> None:
    """Open every session in the application, one after the other."""
    from tests.conftest import opened
    from tests.helpers.viewer_fakes import fake_services

    app = opened(folder / "config", {}, fake_services(drawn=False), False)
    for path in sorted(folder.glob("*/a.sport")):
        app.sessions.open(path)
        for _ in range(3):
            app.frame()
        if app.editor.session.takes:
            app.takes.play(app.editor.session.takes[0].number)
            app.frame()
    print([message.text for message in app.messages.recent][-1], flush=True)
    app.close()


def main() -> int:
    """Make the sessions, open them under strace, and print what was touched."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--open", type=Path, help="open the sessions of a folder, to be traced")
    options = parser.parse_args()
    if options.open is not None:
        open_all(options.open)
        return 0
    home = Path(tempfile.mkdtemp(prefix="hostile-"))
    try:
        make(home / "sessions", home / FOREIGN, options.count, options.first)
        trace = home / "trace"
        command = [sys.executable, "-m", "tests.damage.hostile", "--open", str(home / "sessions")]
        environment = {**os.environ, "HOME": str(home / "own"), "SPORT_CONFIG_DIR": str(home / "own")}
        done = subprocess.run(
            ["strace", "-f", "-qq", "-s", "300", "-e", "trace=%network,%file", "-o", str(trace), *command],
            cwd=PROJECT_ROOT, env=environment, check=False,
        )  # fmt: skip
        text = trace.read_text(errors="replace")
        lines = [line for line in text.splitlines() if TOUCHED.search(line)]
        opened = text.count('a.sport", {')
        for line in lines[:40]:
            print(line[:240])
        print(
            f"{options.count} sessions, exit {done.returncode}, {opened} looks at a session, {len(lines)} forbidden system calls"
        )
        return int(bool(lines) or done.returncode != 0)
    finally:
        shutil.rmtree(home)


if __name__ == "__main__":
    raise SystemExit(main())
