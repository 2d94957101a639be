"""Frame times of the real window by part: `xvfb-run -a python -m benchmarks.frames --quality fast --size 1280x720`.

Each part waits until its drawing is finished, unlike in normal use, to give its own cost; frames per second are measured
without waiting. The window uses a temporary settings folder; a display is needed.
`--against CLONE` measures another clone of the project alternately with this one, and prints the ratio of each turn.
"""

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
from training.evaluation.experiment import Experiment, Setting, option, run_alone
from viewer.app import App
from viewer.options import ViewOptions
from viewer.settings import QUALITIES

WARM_UP, LOAD_S = 30, 60.0  # frames; time limit of loading
TURNS = 5  # measurements of each of two clones
Times = dict[str, list[float]]  # milliseconds by part, one entry per frame


def frame_figures(setting: Setting) -> dict[str, Any]:
    """Measure the window while walking; returns its description, frames per second and times."""
    args = setting.args
    if args.against is not None:
        return {"turns": turns(args.against, [*args.size.split("x"), str(args.frames), args.quality])}
    width, height = (int(side) for side in args.size.split("x"))
    with temporary_folder() as folder:
        view = ViewOptions(width=width, height=height, quality=args.quality, controls="walk 3600")
        app = App(view, config=folder)
        app.settings.max_fps = 1000.0
        deadline = time.monotonic() + LOAD_S
        while app.scene.simulation.controller is None and time.monotonic() < deadline:
            app.frame()
        fps = 1e3 / statistics.mean(times_ms(app.frame, args.frames, WARM_UP))
        times = measure(app, args.frames)
        drawn_by = app.window.ctx.info["GL_RENDERER"]
        app.close()
    return {"about": f"{cpu_name()}, {drawn_by}, {args.quality}, {args.size}", "fps": fps, "times": times}


def frame_table(figures: dict[str, Any]) -> str:
    """Format the median of each part, longest first; for two clones the figures of each turn, and the median ratio."""
    if "turns" in figures:
        rows = [(other, own, own / other) for other, own in figures["turns"]]
        lines = [f"{other:6.1f} and {own:6.1f} frames per second: {ratio:.2f}" for other, own, ratio in rows]
        return "\n".join([*lines, f"median {statistics.median(ratio for *_, ratio in rows):.2f}"])
    medians = {part: statistics.median(ms) for part, ms in figures["times"].items()}
    lines = [f"{figures['about']}: {figures['fps']:.1f} frames per second"]
    lines += [f"{ms:8.2f} ms  {part}" for part, ms in sorted(medians.items(), key=lambda entry: -entry[1])]
    return "\n".join(lines)


def turns(other: Path, arguments: list[str]) -> list[list[float]]:
    """Measure frames per second of another clone and this one alternately, so that other load affects both."""
    return [[_fps(folder, arguments) for folder in (other, PROJECT_ROOT)] for _ in range(TURNS)]


# runs in any version of the project: walks, and prints frames per second
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
    """Measure the frames per second of a clone."""
    command = [sys.executable, "-c", _WALK, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(clone)}
    done = subprocess.run(command, cwd=clone, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return float(done.stdout.split()[-1])


def measure(app: App, frames: int) -> Times:
    """Measure times of frames, of their parts and of the rest, by temporarily wrapping the app's methods."""
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


FRAMES = Experiment(
    __doc__,
    frame_figures,
    frame_table,
    "frames",
    options=(
        option("--quality", choices=[q for q in QUALITIES if q], default="fast"),
        option("--size", default="1280x720", metavar="WxH"),
        option("--frames", type=int, default=150),
        option("--against", type=Path, metavar="CLONE", help="compare with another clone, alternately"),
    ),
)

if __name__ == "__main__":
    raise SystemExit(run_alone(FRAMES, "frames"))
