"""`sport bench`: times of frames, prompts, exports and starts on this machine."""

import importlib.util
import json
import os
import platform
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.timing import clock_and_processor_ms, cpu_name, times_ms
from runtime.atomic import check_target, temporary_folder, write_atomic
from runtime.controls import Controls
from runtime.errors import SportError, UsageError
from runtime.interrupts import run_child
from runtime.motion.controller import Controller, Crowd
from runtime.motion.features import FPS, INPUT_SIZE
from runtime.motion.model import MotionModel, load_model
from runtime.prompts.prompter import Prompter
from runtime.session.motion import MotionHeader
from runtime.session.recording import FRAME_NUMBERS
from runtime.session.session_file import SessionFile
from runtime.takes.input_recording import COLUMNS, KEYFRAME_STEPS, InputRecorder, resimulate
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from viewer.filming.film import make_film
from viewer.filming.shots import FilmOptions

WARM_UP = 60  # frames
RECORDED_FRAMES = 10  # that the viewer writes together
FILMED_FRAMES, FILM_S = 31, 6.0
GENERATED_S = 12
CROWDS = (1, 9, 32)  # characters
BUSY_RATIO = 1.3  # median over fastest network call, above which other programs use the CPU
FORWARD = Controls(move=(0.0, 1.0))
PROMPTS = (
    "an exhausted soldier, left arm hanging",
    "a proud queen",
    "walk like a drunk",
    "an angry man with clenched fists",
    "a happy child skipping along",
    "sneak carefully, head down",
    "an old man with a bad back",
    "a model on the catwalk",
)
_EXPLAINED = {
    "model_ms": "motion network, one frame, one thread, median",
    "model_ms_p99": "the same, 99th percentile",
    "model_ms_fastest": "the same, fastest: far below the median if other programs use the CPU",
    "step_ms": "control, network, foot lock and IK, median",
    "crowd_1_ms": "the same for a crowd of 1 character, each with its own style, median",
    "crowd_9_ms": "for 9 characters",
    "crowd_32_ms": "for 32 characters",
    "frame_cpu_ms": "one character and the interface, without rasterising, median",
    "frame_cpu_ms_p99": "the same, 99th percentile",
    "step_over_model": "step_ms over model_ms; omitted on a busy machine, where it would differ",
    "crowd_9_over_model": "crowd_9_ms over model_ms",
    "crowd_32_over_model": "crowd_32_ms over model_ms",
    "frame_cpu_over_model": "frame_cpu_ms over model_ms",
    "step_processor_over_model": "the same by CPU time, also valid on a busy machine",
    "crowd_9_processor_over_model": "for 9 characters, both threads",
    "crowd_32_processor_over_model": "for 32 characters",
    "frame_processor_over_model": "one character and the interface",
    "recording_ms": "added cost of recording a frame to disk at 60 Hz: queue and writing thread, mean",
    "recording_queue_ms_p99": "queueing ten frames in the frame loop, 99th percentile",
    "prompt_ms": "prompt to style without network, median",
    "prompt_first_ms": "the first prompt, including loading",
    "first_frame_s": "from program start to first frame, offscreen",
    "generate_s": "`sport generate` of 12 s as BVH, the whole process",
    "resimulate_s": "a second of a take resimulated from the middle between two keyframes",
    "film_s": "a film of 6 s at 1280x720, 30 frames per second, MP4, high quality; from 30 of its frames",
    "moves_s": "and to a character that walks by its prompt",
    "quit_s": "and from closing that program to its end",
    "rss_mb": "peak memory of that program after 120 frames",
}


def run(json_path: Path | None, frames: int = 1000, model: Path | None = None) -> int:
    """Measure, print a table and write `json_path`; returns the exit code."""
    if not 10 <= frames <= 1_000_000:
        raise UsageError(f"--frames {frames}: expected 10 to 1000000.", "Choose another number.")
    if json_path is not None:
        check_target(json_path)
    with temporary_folder() as folder, patch.dict(os.environ, SPORT_CONFIG_DIR=str(folder)):
        figures = measure(frames, model)  # without user settings, in a temporary folder
    print(
        f"model {figures['model']} in {figures['precision']} on {figures['cpu']}, {figures['threads']} thread"
    )
    for name, meaning in _EXPLAINED.items():
        value = figures[name]
        print(f"{name:20} {'-' if value is None else f'{value:.3f}':>10}  {meaning}")
    for note in figures["notes"]:
        print(f"note: {note}")
    if json_path is not None:
        write_atomic(json_path, json.dumps(figures, indent=1) + "\n")
    return 0


def measure(frames: int, model: Path | None) -> dict[str, Any]:
    """Return all figures by name; a figure that cannot be measured is None, with the reason in `notes`."""
    network = load_model(model)
    figures: dict[str, Any] = {"notes": [], **dict.fromkeys(_EXPLAINED)}
    figures |= _step_times(network, frames)
    figures |= _crowd_times(network, frames)
    figures |= _recording_times(min(frames, 600))
    figures |= _resimulation_times(network)
    figures |= _prompt_times(network)
    for name, part in (
        ("frame_cpu_ms", partial(_frame_times, frames, model)),
        ("film_s", partial(_film_times, network)),
        ("generate_s", partial(_generation_times, model)),
        ("first_frame_s", partial(_start_times, model)),
    ):
        try:
            figures |= part()
        except SportError as error:
            figures["notes"].append(f"{name}: {error}")
    about = {
        "model": network.name,
        "precision": network.precision,
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "threads": 1,
        "python": platform.python_version(),
        "frames": frames,
    }
    busy = figures["model_ms"] > BUSY_RATIO * figures["model_ms_fastest"]
    if busy:
        figures["notes"].append("This machine is busy: times are too long, and their ratios are omitted.")
    for name in _EXPLAINED:
        what, over, _ = name.partition("_over_model")
        used = what.endswith("_processor")
        time_ms = figures.get(f"{what}_ms")
        if over and time_ms is not None and (used or not busy):
            figures[name] = time_ms / figures["model_processor_ms" if used else "model_ms"]
    return figures | about


def _summary(name: str, ms: list[float]) -> dict[str, float]:
    return {name: float(np.median(ms)), f"{name}_p99": float(np.percentile(ms, 99))}


def _step_times(network: MotionModel, frames: int) -> dict[str, float]:
    x = np.zeros((1, INPUT_SIZE), np.float32)
    noise = np.random.default_rng(0).standard_normal((1, *network.noise_shape), np.float32)
    style = network.fold_style(np.zeros((6, 64), np.float32))
    alone, alone_used = clock_and_processor_ms(lambda: network.step(x, noise, style), frames, WARM_UP)
    controller = Controller(network, Terrain.flat())
    steps, steps_used = clock_and_processor_ms(lambda: controller.step(FORWARD), frames, WARM_UP)
    return {
        **_summary("model_ms", alone),
        "model_ms_fastest": min(alone),
        "model_processor_ms": float(np.median(alone_used)),
        "step_ms": float(np.median(steps)),
        "step_processor_ms": float(np.median(steps_used)),
    }


def _crowd_times(network: MotionModel, frames: int) -> dict[str, float]:
    """Time a step of characters with a shared stick, side by side, on two threads: ms for all of them."""
    ground = Terrain.flat()
    codes = np.random.default_rng(0).normal(0.0, 0.5, (CROWDS[-1], *network.style_shape)).astype(np.float32)
    figures = {}
    for count in CROWDS:
        members = [Controller(network, ground, seed) for seed in range(count)]
        for member, code in zip(members, codes, strict=False):
            member.set_style(code, 0.0)
        crowd = Crowd(members)
        number = max(frames // (count + 2), 10)
        times, used = clock_and_processor_ms(partial(crowd.step, FORWARD), number, min(WARM_UP, number))
        crowd.close()
        figures[f"crowd_{count}_ms"] = float(np.median(times))
        figures[f"crowd_{count}_processor_ms"] = float(np.median(used))
    return figures


def _recording_times(frames: int) -> dict[str, float]:
    """Time a recording at the rate of the simulation: ms per frame, including CPU time of the writing thread."""
    rows = np.zeros((RECORDED_FRAMES, FRAME_NUMBERS), np.float32)
    sticks = np.zeros((RECORDED_FRAMES, COLUMNS))
    rows[:, 3:-5:4] = 1.0  # unit rotations
    times: list[float] = []
    with temporary_folder() as folder:
        file = SessionFile.create(folder / "bench.sport", folder / "characters")
        recording = file.begin_recording(MotionHeader("bench", 60.0, 0))
        elsewhere = time.process_time() - time.thread_time()
        for _ in range(max(frames // RECORDED_FRAMES, 1)):
            times += times_ms(lambda: recording.add(rows, sticks), 1)
            time.sleep(RECORDED_FRAMES / 60)
        elsewhere = time.process_time() - time.thread_time() - elsewhere
        if not file.close():
            raise SportError(file.problem, "Choose a temporary folder (TMPDIR) that can be written.")
    mean = (sum(times) + 1e3 * elsewhere) / (RECORDED_FRAMES * len(times))
    return {"recording_ms": mean, "recording_queue_ms_p99": float(np.percentile(times, 99))}


def _resimulation_times(network: MotionModel) -> dict[str, float]:
    controller, recorder = Controller(network, Terrain.flat()), InputRecorder()
    for _ in range(2 * KEYFRAME_STEPS):
        recorder.before_steps(controller)
        controller.step(FORWARD)
        recorder.add(FORWARD, controller)
    inputs, first = recorder.cut(0), 3 * KEYFRAME_STEPS // 2
    assert inputs is not None
    times = times_ms(lambda: resimulate(inputs, controller, first, first + FPS - 1), 3)
    return {"resimulate_s": 1e-3 * float(np.median(times))}


def _generation_times(model: Path | None) -> dict[str, float]:
    named = [] if model is None else ["--model", str(model)]
    with temporary_folder() as folder:
        clip = ["--prompt", PROMPTS[1], "--seconds", str(GENERATED_S), "--out", f"{folder}/clip.bvh"]
        begin = time.perf_counter()
        _run([sys.executable, "-m", "sport", "generate", *clip, *named])
    return {"generate_s": time.perf_counter() - begin}


def _prompt_times(network: MotionModel) -> dict[str, float]:
    begin = time.perf_counter()
    to_style = Prompter(network)
    to_style("walk normally, please")
    first = 1e3 * (time.perf_counter() - begin)
    times = [times_ms(partial(to_style, prompt), 1)[0] for prompt in PROMPTS]  # repetitions would be cached
    return {"prompt_first_ms": first, "prompt_ms": float(np.median(times))}


def _frame_times(frames: int, model: Path | None) -> dict[str, float]:
    """Time frames of the walking viewer without any drawing of pixels."""
    from viewer.app import App
    from viewer.options import ViewOptions

    controls = f"walk {(WARM_UP + frames) / 60:.3f}"
    app = App(ViewOptions(offscreen=True, frames=frames, model=model, controls=controls))
    try:
        app.scene.renderer.render = lambda *_: None
        app.window.draw_interface = lambda: None  # type: ignore[method-assign]
        app.window.present = lambda: None  # type: ignore[method-assign]
        times, used = clock_and_processor_ms(app.frame, frames, WARM_UP)
        return {**_summary("frame_cpu_ms", times), "frame_processor_ms": float(np.median(used))}
    finally:
        app.close()


def _film_times(network: MotionModel) -> dict[str, float]:
    """Time a film of a walk on flat ground, from the time per frame and of finishing the file."""
    controller, recorder, ground = Controller(network, Terrain.flat()), ClipRecorder(), Terrain.flat()
    for _ in range(FILMED_FRAMES * 2):
        recorder.add(controller.step(FORWARD))
    drawn: list[float] = []
    with temporary_folder() as folder:
        clip, path = recorder.last(FILM_S), folder / "film.mp4"
        make_film(clip, ground, path, FilmOptions(), progress=lambda *_: drawn.append(time.perf_counter()))
    seconds = (time.perf_counter() - drawn[0]) / (len(drawn) - 1)
    return {"film_s": FILM_S * FilmOptions.fps * seconds}


# loaders run in parallel to the frames, as in a window; offscreen, loading would finish before the first frame
_START = """
import gc, sys, time
from sport.cli import NEW_OBJECTS
gc.set_threshold(NEW_OBJECTS)
import viewer.workspace
from viewer.app import App
from viewer.jobs import Jobs
from viewer.options import ViewOptions
begin, *model = sys.argv[1:]
viewer.workspace.Jobs = lambda messages, blocking: Jobs(messages)
app = App(ViewOptions(offscreen=True, model=model[0] if model else None))
app.frame()
print(time.monotonic() - float(begin))
while app.scene.controller is None or any(app.prompting.questions):
    app.rest()
    app.frame()
app.frame()
print(time.monotonic() - float(begin))
begin = time.monotonic()
app.interrupt()
app.end()
app.close()
print(time.monotonic() - begin)
"""


def _start_times(model: Path | None) -> dict[str, float | None]:
    """Measure seconds from start to first frame of a new process (second of two starts), and peak memory."""
    named = [str(model)] if model else []
    command = [sys.executable, "-m", "sport", "view", "--offscreen", "--frames", "120"]
    with temporary_folder() as folder:
        # modules are compiled in the first start, as for a user who starts the program again
        compiled = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        compiled["PYTHONPYCACHEPREFIX"] = str(folder)
        for _ in range(2):
            begin = str(time.monotonic())
            shown = _run([sys.executable, "-c", _START, begin, *named], compiled)
        memory = peak_memory_mb([*command, *(["--model", *named] if named else [])])
    first, moves, quits = map(float, shown.split()[-3:])
    return {"first_frame_s": first, "moves_s": moves, "quit_s": quits, "rss_mb": memory}


# Linux includes the memory of the parent at the start in a child's peak, and this benchmark contains a whole viewer, so an
# empty process starts the measured one
_MEASURE = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""


def peak_memory_mb(command: list[str]) -> float | None:
    """Return the peak memory of `command` in MB, None if unknown (Windows); SportError if it fails."""
    if importlib.util.find_spec("resource") is None:
        return None
    peak = float(_run([sys.executable, "-c", _MEASURE, *command]))
    return peak / (1 << 20) if sys.platform == "darwin" else peak / 1024


def _run(command: list[str], environment: dict[str, str] | None = None) -> str:
    done = run_child(command, env=environment)
    if done.returncode != 0:
        shown = " ".join(command[1:])[:80]
        raise SportError(f"`{shown}` failed: {done.stderr.strip()[-300:]}", "Fix that first.")
    return done.stdout
