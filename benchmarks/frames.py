"""Frames of the real window by part: `xvfb-run -a python -m benchmarks.frames --quality fast --size 1280x720`.

Each part waits until its drawing is done, which a window does not do: the parts are what each of them costs, the frames
a second are measured without waiting. A window with its own folder of settings; needs a display.
"""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from benchmarks.timing import cpu_name, times_ms
from runtime.atomic import temporary_folder
from runtime.errors import run_command
from training.evaluation.experiment import Experiment, Setting, entry, option
from viewer.app import App
from viewer.options import ViewOptions
from viewer.settings import QUALITIES

WARM_UP, LOAD_S = 30, 60.0  # frames, and seconds that loading may take
Times = dict[str, list[float]]  # milliseconds by part, one entry a frame


def frame_figures(setting: Setting) -> dict[str, Any]:
    """Of a window that walks: what it is, its frames a second, and its times."""
    args = setting.args
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
    """The median of each part, the longest first."""
    medians = {part: statistics.median(ms) for part, ms in figures["times"].items()}
    lines = [f"{figures['about']}: {figures['fps']:.1f} frames a second"]
    lines += [f"{ms:8.2f} ms  {part}" for part, ms in sorted(medians.items(), key=lambda entry: -entry[1])]
    return "\n".join(lines)


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


FRAMES = Experiment(
    __doc__,
    frame_figures,
    frame_table,
    "frames",
    options=(
        option("--quality", choices=[q for q in QUALITIES if q], default="fast"),
        option("--size", default="1280x720", metavar="WxH"),
        option("--frames", type=int, default=150),
    ),
)
main = entry(FRAMES, "python -m benchmarks.frames")

if __name__ == "__main__":
    raise SystemExit(run_command("frames", main))
