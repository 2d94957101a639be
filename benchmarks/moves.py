"""How many files, functions and calls of the project one action goes through: `python -m benchmarks.moves`."""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType

from runtime.controls import Controls
from runtime.formats.glb import save_glb
from runtime.formats.prepare import ExportOptions, prepare
from runtime.generate import clip_of
from runtime.motion.controller import Controller
from runtime.motion.model import load_model
from runtime.terrain.height_map import Terrain
from viewer.app import App
from viewer.options import ViewOptions

ROOT = Path(__file__).resolve().parents[1]
WARM_UP = 90  # frames, after which a character walks steadily
FORWARD = Controls(move=(0.0, 1.0))


def moves(action: Callable[[], object]) -> tuple[int, int, int]:
    """Files, functions and calls that an action goes through, of the project alone, without comprehensions and lambdas."""
    calls: Counter[CodeType] = Counter()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        path = Path(code.co_filename)
        # an environment may lie in the clone
        own = path.is_relative_to(ROOT) and "site-packages" not in path.parts
        if event == "call" and own and not code.co_name.startswith("<"):
            calls[code] += 1

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return len({code.co_filename for code in calls}), len(calls), calls.total()


def main() -> int:
    """Count and print; the exit code."""
    controller = Controller(load_model(None), Terrain.flat())
    for _ in range(WARM_UP):
        controller.step(FORWARD)
    counts = {"a step of the controller": moves(lambda: controller.step(FORWARD))}
    clip = clip_of([controller.step(FORWARD) for _ in range(60)], "walk", (), "flat")
    with tempfile.TemporaryDirectory() as folder:
        options = ExportOptions()
        save_glb(prepare(clip, options), Path(folder) / "first.glb", options, None)
        counts["a second of a take to a GLB"] = moves(
            lambda: save_glb(prepare(clip, options), Path(folder) / "take.glb", options, None)
        )
        app = App(ViewOptions(offscreen=True, controls="walk 60"), config=Path(folder))
        for _ in range(WARM_UP):
            app.frame()
        counts["a frame of the window, walking"] = moves(app.frame)
        app.takes.save_last()
        app.takes.play(app.editor.session.takes[-1].number)
        for _ in range(WARM_UP):
            app.frame()
        counts["a frame of the window, a take playing"] = moves(app.frame)
        app.close()
    for what, (files, functions, total) in counts.items():
        print(f"{what}: {files} files, {functions} functions, {total} calls")
    return 0


if __name__ == "__main__":
    sys.exit(main())
