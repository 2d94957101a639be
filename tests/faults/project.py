"""The process that is killed with a project on its desk: two takes are saved, a third one is autosaved; it reports both."""

from __future__ import annotations

import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def main(folder: Path) -> None:
    """Run until killed."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    from viewer_fakes import fake_services

    from viewer.app import App
    from viewer.options import ViewOptions

    view = ViewOptions(offscreen=True, terrain="flat", width=320, height=240, panels=False)
    app = App(view, fake_services(), config=folder / "config")
    app.sessions.autosaving = True
    app.sessions.clock = lambda: 10.0 * time.monotonic()  # nobody waits six seconds
    for _ in range(3):
        app.takes.toggle_recording()
        for _ in range(10):
            app.frame()
        app.takes.toggle_recording()
        app.frame()
        if len(app.editor.session.takes) == 2:
            app.sessions.save_as(folder / "walks.sport")
            app.frame()
            print("saved", flush=True)
    reported = False
    while True:
        app.frame()
        projects = app.sessions
        if not reported and projects._autosaved == projects.contents.fingerprint():
            reported = True
            print("autosaved", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
