"""The process that faults happen to: the viewer with a model that costs nothing, recording from its first frame.

It reports on its output, a line each, how many frames of the running take it has recorded.
"""

from __future__ import annotations

import argparse
import errno
import logging
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    """Run the viewer until something ends it; the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("config", type=Path)
    parser.add_argument("export", type=Path)
    parser.add_argument("--window", action="store_true", help="in a window, not offscreen")
    parser.add_argument("--takes", type=int, default=0, help="finished takes before the running one")
    parser.add_argument("--slow", type=float, default=0.0, help="seconds that saving a take lasts longer")
    parser.add_argument("--full", action="store_true", help="the export folder's disk is full")
    options = parser.parse_args()
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # both are ignored in a background job of a shell
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(message)s")
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    from viewer_fakes import fake_services

    from viewer import app as app_module
    from viewer.options import ViewOptions

    _spoil_saving(options)
    _record(app_module.App, options)
    frames = None if options.window else 1_000_000
    size = {"width": 320, "height": 240, "panels": False}
    view = ViewOptions(offscreen=not options.window, frames=frames, terrain="flat", **size)
    return app_module.run(view, fake_services(), options.config)


def _record(app_class: Any, options: argparse.Namespace) -> None:
    """Record from the first frame on, at the pace of the simulation."""
    draw = app_class.frame

    def frame(app: Any) -> None:
        begin = time.monotonic()
        if app.frames_shown == 0:
            app.settings.export_folder = str(options.export)
            app.window.draw_interface = lambda: None
            for _ in range(options.takes):
                app.takes.toggle_recording()
                for _ in range(5):
                    draw(app)
                app.takes.toggle_recording()
            app.takes.toggle_recording()
        draw(app)
        print(round(app.takes.recorder.take_seconds * 60), flush=True)
        time.sleep(max(1 / 60 - (time.monotonic() - begin), 0.0))

    app_class.frame = frame


def _spoil_saving(options: argparse.Namespace) -> None:
    from runtime.formats import bvh_clip

    save, write = bvh_clip.save_bvh, Path.write_bytes

    def slow(*about: Any, **more: Any) -> Path:
        time.sleep(options.slow)
        return save(*about, **more)

    def full(path: Path, data: bytes) -> int:
        if options.full and path.is_relative_to(options.export):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, data)

    bvh_clip.save_bvh = slow
    Path.write_bytes = full  # type: ignore[assignment]


if __name__ == "__main__":
    sys.exit(main())
