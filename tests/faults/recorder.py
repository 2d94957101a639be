"""The process that faults happen to: the viewer with a model that costs nothing, recording from its first frame.

It reports on its output, a line each, how many frames of the running take it has recorded, or how many edits it has made.
"""

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
    parser.add_argument("--window", action="store_true", help="in a window, not offscreen")
    parser.add_argument("--takes", type=int, default=0, help="finished takes before the running one")
    parser.add_argument("--edits", action="store_true", help="rename a take in every frame, and record none")
    parser.add_argument("--slow", type=float, default=0.0, help="seconds that writing lasts longer")
    parser.add_argument("--full", action="store_true", help="the disk is full from the second take on")
    options = parser.parse_args()
    # both are ignored in a background job of a shell
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(message)s")
    sys.path.insert(0, str(ROOT))
    from tests.helpers.viewer_fakes import fake_services
    from viewer import app as app_module
    from viewer import process
    from viewer.options import ViewOptions

    # a busy machine must not decide whether all is written or handed over to the next start
    app_module.END_S, app_module.SESSION_S = 30.0, 29.8
    process.FRAME_S = 30.0
    _spoil_writing(options)
    _record(app_module.App, options)
    frames = None if options.window else 1_000_000
    size = {"width": 320, "height": 240, "panels": False}
    view = ViewOptions(offscreen=not options.window, frames=frames, terrain="flat", **size)
    return app_module.run(view, fake_services(), options.config)


def _record(app_class: Any, options: argparse.Namespace) -> None:
    """Record from the first frame with a model on, or edit in every one, at the pace of the simulation."""
    draw, begun = app_class.frame, []

    def frame(app: Any) -> None:
        begin = time.monotonic()
        if not begun and app.scene.controller is None:  # in a window it is loaded meanwhile
            draw(app)
            return
        if not begun:
            begun.append(True)
            app.window.draw_interface = lambda: None
            for _ in range(options.takes + options.edits):
                app.takes.toggle_recording()
                for _ in range(5):
                    draw(app)
                app.takes.toggle_recording()
            app.editor.file.flush(10.0)
            if not options.edits:
                app.takes.toggle_recording()
        _keep_pace(app)
        draw(app)
        if options.edits:
            app.takes.rename(1, f"name {app.frames_shown}")
        done = app.frames_shown if options.edits else round(app.takes.recorder.take_seconds * 60)
        print(done, flush=True)
        time.sleep(max(1 / 60 - (time.monotonic() - begin), 0.0))

    app_class.frame = frame


def _keep_pace(app: Any) -> None:
    """Wait for a writer that is a transaction behind: a busy machine must not decide how much is lost."""
    database, end = app.editor.file.database, time.monotonic() + 60.0
    while database._submitted - database._written > 1 and not database.problem and time.monotonic() < end:
        time.sleep(0.005)


def _spoil_writing(options: argparse.Namespace) -> None:
    from runtime.session.database import Database
    from runtime.session.stored_rows import Writer

    keep, put = Database._keep_there, Writer.put_frames

    def slow(database: Database) -> None:
        time.sleep(options.slow)
        keep(database)

    def full(writer: Writer, key: str, *about: Any) -> None:
        put(writer, key, *about)
        if options.full and writer._run("SELECT count(DISTINCT motion) FROM frames").fetchone()[0] > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    Database._keep_there = slow  # type: ignore[method-assign]
    Writer.put_frames = full  # type: ignore[method-assign]


if __name__ == "__main__":
    sys.exit(main())
