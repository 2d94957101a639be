"""How long the program takes to end, measured from outside: `python -m tests.faults.ending --times 1`.

The real viewer with its shipped model runs in a window on a display of its own. In every state it is ended by SIGTERM, by
Ctrl+C and by the window's close button; counted are the seconds until the process is gone, and whether what was recorded is
in the session's file. The exit code is 1 for more than `LIMIT_S` or a take that is lost.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 2.0
START_S = 120.0
FRAMES = 600  # of a finished take
READY = "ready"
WAYS = ("SIGTERM", "Ctrl+C", "close")
# state: finished takes before it
STATES = {
    "start-up": 0,
    "walking": 0,
    "recording": 0,
    "film under way": 1,
    "export of all": 40,
    "blends measured": 1,
    "a session saved": 40,
    "a take resimulated": 1,
    "a wall of nine": 1,
}

_CLOSE = """
import ctypes, sys
x = ctypes.CDLL("libX11.so.6")
x.XOpenDisplay.restype = ctypes.c_void_p
x.XInternAtom.restype = x.XDefaultRootWindow.restype = ctypes.c_ulong
display = ctypes.c_void_p(x.XOpenDisplay(None))
root, parent, children, count = ctypes.c_ulong(), ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
x.XQueryTree(display, ctypes.c_ulong(x.XDefaultRootWindow(display)), ctypes.byref(root), ctypes.byref(parent),
             ctypes.byref(children), ctypes.byref(count))
atom = lambda name: x.XInternAtom(display, name, 0)
class Message(ctypes.Structure):
    _fields_ = [("type", ctypes.c_int), ("serial", ctypes.c_ulong), ("send_event", ctypes.c_int),
                ("display", ctypes.c_void_p), ("window", ctypes.c_ulong), ("message_type", ctypes.c_ulong),
                ("format", ctypes.c_int), ("data", ctypes.c_long * 5), ("rest", ctypes.c_long * 12)]
assert count.value
for k in range(count.value):
    message = Message(33, 0, 1, display, children[k], atom(b"WM_PROTOCOLS"), 32)
    message.data[0] = atom(b"WM_DELETE_WINDOW")
    x.XSendEvent(display, ctypes.c_ulong(children[k]), 0, 0, ctypes.byref(message))
x.XSync(display, 0)
"""


# --- the program


def program(state: str, folder: Path) -> int:
    """Run the viewer into a state, say so, and stay until something ends it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background job of a shell
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(message)s")
    from runtime.errors import run_command
    from viewer import app as app_module
    from viewer.options import ViewOptions

    shown = app_module.App.frame
    steps: Any = None

    def frame(app: Any) -> None:
        nonlocal steps
        shown(app)
        steps = steps or _into(state, app, folder)
        next(steps, None)

    app_module.App.frame = frame  # type: ignore[method-assign]
    if state == "start-up":
        print(READY, flush=True)
    options = ViewOptions(terrain="flat", width=640, height=400)
    return run_command("sport view", lambda: app_module.run(options, config=folder / "config"))


def _into(state: str, app: Any, folder: Path) -> Any:
    """A step after each frame until the state is reached."""
    app.settings.export_folder = str(folder / "clips")
    while app.scene.controller is None or app.editor.session.live.prompt.a is None:
        yield
    for _ in range(STATES[state]):
        app.takes.toggle_recording()
        while app.takes.recorder.take_seconds * 60 < FRAMES:
            pose, controls = app.scene.simulation.current, _still()
            for _ in range(50):  # faster than the clock
                app.takes.before_steps()
                app.takes.add_poses([pose], controls)
            yield
        app.takes.toggle_recording()
    if state == "recording":
        app.takes.toggle_recording()
        while app.takes.recorder.take_seconds < 2.0:
            yield
    elif state == "film under way":
        app.exporting.state.choose(suffix=".mp4")
        app.exporting.propose()
        app.exporting.export()
        while app.exporting.state.progress[0] < 10:
            yield
    elif state == "export of all":
        app.takes.export_all()
        yield
    elif state == "blends measured":
        from runtime.session.prompt_blend import Side

        for k in range(10):
            app.prompting.submit_prompt(f"a drunk man number {k}", Side.B)
            while app.prompting.pending:
                yield
            yield
        while not app.jobs.busy("blend"):
            yield
    elif state == "a session saved":
        app.sessions.save_as(folder / "named.sport")
        yield
    elif state == "a take resimulated":
        app.takes.play(1)
        while app.takes.playback is None:
            yield
        app.takes.seek_end(first=True)
        app.editing.insert_prompt("an old man")
        for _ in range(20):
            yield
    elif state == "a wall of nine":
        app.compare.toggle()
        for _ in range(8):
            app.compare.add()
            yield
        for _ in range(30):
            yield
    print(READY, flush=True)


def _still() -> Any:
    from runtime.controls import Controls

    return Controls()


# --- outside


def ended(
    state: str, way: str, folder: Path, display_name: str, delay: float
) -> tuple[float, int, list[str]]:
    """Seconds until the program was gone after it was told, its exit code, and what went wrong."""
    environment = {**os.environ, "DISPLAY": display_name, "WAYLAND_DISPLAY": ""}
    environment["TMPDIR"] = str(folder)
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "tests.faults.ending", "--program", state, str(folder)]
    with open(folder / "said", "w", encoding="utf-8") as said:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=said, text=True, env=environment, cwd=ROOT
        )
        timer = threading.Timer(START_S, process.kill)
        timer.start()
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        assert line == READY, (folder / "said").read_text(encoding="utf-8")[-2000:]
        time.sleep(delay)
        begun = time.monotonic()
        if way == "close":
            subprocess.run([sys.executable, "-c", _CLOSE], check=True, env=environment)
            begun = time.monotonic()
        else:
            process.send_signal(signal.SIGTERM if way == "SIGTERM" else signal.SIGINT)
        code = process.wait()
        seconds = time.monotonic() - begun
        timer.cancel()
    words = (folder / "said").read_text(encoding="utf-8")
    problems = [f"{seconds:.1f} s"] * (seconds > LIMIT_S) + ["a traceback"] * ("Traceback" in words)
    takes = STATES[state] + (state == "recording")
    kept = _kept(folder)
    if kept < takes:
        problems.append(f"{kept} of {takes} takes kept")
    return seconds, code, [*problems, *([words[-600:]] if problems else [])]


def _kept(folder: Path) -> int:
    """Takes in the session that was closed, and in the one of the temporary folder."""
    from tests.faults.faults import takes_in

    problems: list[str] = []
    found = [
        takes_in(path, problems)
        for path in (folder, folder / "config" / "sessions", folder / "sport-sessions")
    ]
    print(*problems, sep="\n", file=sys.stderr, end="")
    return max((len(takes) for sessions in found for takes in sessions), default=0)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.ending", description=__doc__)
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--only", default="", help="states whose name holds this")
    parser.add_argument(
        "--nice", type=int, default=0, help="priority of the program (below 0 as root, where others work)"
    )
    parser.add_argument("--program", nargs=2, metavar=("STATE", "FOLDER"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.program:
        return program(options.program[0], Path(options.program[1]))
    from tests.faults.faults import display

    os.nice(options.nice)
    bad = 0
    print("| state | SIGTERM, s | Ctrl+C, s | close, s | exit codes | failures |")
    print("| --- | ---: | ---: | ---: | --- | ---: |", flush=True)
    with display() as (_, name):
        for state in STATES:
            if options.only not in state:
                continue
            slowest, codes, failures = [], set(), 0
            for way in WAYS:
                times = []
                for number in range(options.times):
                    if state == "start-up" and way == "close":
                        continue  # there is no window yet
                    with tempfile.TemporaryDirectory() as folder:
                        delay = 0.2 + 0.8 * number if state == "start-up" else 0.0
                        seconds, code, problems = ended(state, way, Path(folder), name, delay)
                    times.append(seconds)
                    codes.add(code)
                    failures += bool(problems)
                    for problem in problems:
                        print(f"{state}, {way}: {problem}", file=sys.stderr, flush=True)
                slowest.append(f"{max(times):.2f}" if times else "")
            bad += failures
            codes_text = ", ".join(map(str, sorted(codes)))
            print(f"| {state} | {' | '.join(slowest)} | {codes_text} | {failures} |", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
