"""Frames of the real window by part: `xvfb-run -a python -m benchmarks.frames --quality fast --size 1280x720`.

Each part waits until its drawing is done, which a window does not do: the parts are what each of them costs, the frames
a second are measured without waiting. A window with its own folder of settings; needs a display.
`--against CLONE` measures another clone of the project in turns with this one, and prints the ratio of each turn.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.timing import cpu_name, times_ms
from runtime.assets import PROJECT_ROOT
from runtime.atomic import temporary_folder
from viewer.app import App
from viewer.options import ViewOptions
from viewer.settings import QUALITIES

WARM_UP, LOAD_S = 30, 60.0  # frames, and seconds that loading may take
TURNS = 5  # of each of two clones
Times = dict[str, list[float]]  # milliseconds by part, one entry a frame


def main() -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quality", choices=[q for q in QUALITIES if q], default="fast")
    parser.add_argument("--size", default="1280x720", metavar="WxH")
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--against", type=Path, metavar="CLONE")
    options = parser.parse_args()
    width, height = options.size.split("x")
    if options.against is not None:
        return compare(options.against, [width, height, str(options.frames), options.quality])
    with temporary_folder() as folder:
        view = ViewOptions(
            width=int(width), height=int(height), quality=options.quality, controls="walk 3600"
        )
        app = App(view, config=folder)
        app.settings.max_fps = 1000.0
        deadline = time.monotonic() + LOAD_S
        while app.scene.simulation.controller is None and time.monotonic() < deadline:
            app.frame()
        fps = 1e3 / statistics.mean(times_ms(app.frame, options.frames, WARM_UP))
        times = measure(app, options.frames)
        drawn_by = app.window.ctx.info["GL_RENDERER"]
        app.close()
    print(f"{cpu_name()}, {drawn_by}, {options.quality}, {options.size}: {fps:.1f} frames a second")
    for part, ms in sorted(times.items(), key=lambda entry: -statistics.median(entry[1])):
        print(f"{statistics.median(ms):8.2f} ms  {part}")
    return 0


def compare(other: Path, arguments: list[str]) -> int:
    """Measure another clone and this one in turns, so that what else the machine does meets both; the exit code."""
    ratios = []
    for _ in range(TURNS):
        fps = [_fps(folder, arguments) for folder in (other, PROJECT_ROOT)]
        ratios.append(fps[1] / fps[0])
        print(f"{fps[0]:6.1f} and {fps[1]:6.1f} frames a second: {ratios[-1]:.2f}", flush=True)
    print(f"median {statistics.median(ratios):.2f}")
    return 0


# of any version of the project: walks, and prints frames a second
_WALK = """
import sys, tempfile, time
from pathlib import Path
from viewer.app import App
from viewer.options import ViewOptions
width, height, frames, quality = *map(int, sys.argv[1:4]), sys.argv[4]
with tempfile.TemporaryDirectory() as folder:
    app = App(ViewOptions(width=int(width), height=int(height), quality=quality, controls="walk 3600"), config=Path(folder))
    app.settings.max_fps = 1000.0
    while app.scene.simulation.controller is None:
        app.frame()
    for number in range(20 + frames):
        if number == 20:
            begin = time.perf_counter()
        app.frame()
    print(frames / (time.perf_counter() - begin))
    app.close()
"""


def _fps(clone: Path, arguments: list[str]) -> float:
    """Frames a second of a clone."""
    command = [sys.executable, "-c", _WALK, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(clone)}
    done = subprocess.run(command, cwd=clone, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return float(done.stdout.split()[-1])


def measure(app: App, frames: int) -> Times:
    """Times of frames, of parts of them and of all else; the app's methods are replaced meanwhile."""
    timed: dict[str, tuple[Any, str]] = {
        "motion": (app.scene, "advance"),
        "scene": (app.scene.renderer, "render"),
        "panels": (app.shell, "draw"),
        "panels' drawing": (app.window, "draw_interface"),
        "showing": (app.window, "present"),
    }
    now: dict[str, float] = defaultdict(float)
    times: Times = defaultdict(list)

    def watched(part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def work_and_wait(*given: Any) -> Any:
            begin = time.perf_counter()
            result = work(*given)
            app.window.ctx.finish()
            now[part] += 1e3 * (time.perf_counter() - begin)
            return result

        return work_and_wait

    for part, (owner, name) in timed.items():
        setattr(owner, name, watched(part, getattr(owner, name)))
    for number in range(WARM_UP + frames):
        now.clear()
        frame = times_ms(app.frame, 1)[0]
        if number >= WARM_UP:
            for part, ms in {"frame": frame, "all else": frame - sum(now.values()), **now}.items():
                times[part].append(ms)
    for owner, name in timed.values():
        delattr(owner, name)
    return dict(times)


if __name__ == "__main__":
    sys.exit(main())
