"""`python -m tests.faults.endpoint`: times of a frame while a language model's endpoint answers without end, and without one.

The application walks offscreen at 60 frames a second with its panels, a model that costs nothing and an empty view. What is
compared is measured in turn, in rounds, so that what else the machine does meets all. The endless body is an error's
(status 500) or an answer's (200).
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
FRAME_S = 1.0 / 60.0


class _Endless(BaseHTTPRequestHandler):
    """A body without end, until the client hangs up."""

    status = 500
    sent = 0  # bytes, of all requests

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(self.status)
        self.send_header("Content-Length", str(1 << 40))
        self.end_headers()
        try:
            while True:
                type(self).sent += self.wfile.write(b" " * 65_536)
        except OSError:
            self.close_connection = True

    def log_message(self, *_: Any) -> None:
        pass


def main() -> int:
    """Measure and print a table; 1 where no endless body was read."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each row of a round")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(SPORT_CACHE_DIR=f"{folder}/cache", NO_PROXY="127.0.0.1")
        server = ThreadingHTTPServer(("127.0.0.1", 0), _Endless)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        times = _measure(Path(folder), f"http://127.0.0.1:{server.server_port}/v1", options)
        server.shutdown()
    print("| endpoint | frames | median, ms | p99, ms | longest, ms |\n| --- | ---: | ---: | ---: | ---: |")
    for name, frames in times.items():
        milliseconds = 1000.0 * np.array(frames)
        figures = np.median(milliseconds), np.percentile(milliseconds, 99), milliseconds.max()
        print(f"| {name} | {len(frames)} | " + " | ".join(f"{figure:.2f}" for figure in figures) + " |")
    print(f"{_Endless.sent / 1e6:.1f} MB were sent")
    return int(_Endless.sent == 0)


def _measure(folder: Path, url: str, options: argparse.Namespace) -> dict[str, list[float]]:
    from tests.helpers.slow_model import load_model
    from tests.helpers.viewer_fakes import fake_services
    from viewer.app import App
    from viewer.options import ViewOptions

    services = dataclasses.replace(fake_services(), load_model=load_model)
    view = ViewOptions(offscreen=True, terrain="flat", width=640, height=360, prompt="a proud king")
    app = App(view, services, config=folder / "config")
    app.prompting.blocking = app.jobs.blocking = False
    app.settings.gpt_base_url, app.settings.gpt_model = url, "m"
    for _ in range(30):
        app.frame()
    times: dict[str, list[float]] = {"none": [], "error without end": [], "answer without end": []}
    for number in range(options.rounds):
        for name, frames in times.items():
            _Endless.status = 200 if name.startswith("answer") else 500
            app.expanders.choose("library" if name == "none" else "gpt")
            end = time.monotonic() + options.seconds
            while time.monotonic() < end:
                if len(frames) % 60 == 0:  # a new prompt each second, so that one is always being asked
                    app.prompting.submit_prompt(f"a proud king {number} {len(frames)}")
                begun = time.perf_counter()
                app.frame()
                frames.append(time.perf_counter() - begun)
                time.sleep(max(FRAME_S - frames[-1], 0.0))
    app.close()
    return times


if __name__ == "__main__":
    sys.exit(main())
