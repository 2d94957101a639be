"""What opening and playing a session costs, in a process of its own: `python -m tests.damage.opening FILE [--window]`."""

import argparse
import gc
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from runtime.errors import SportError
from runtime.session.session_file import SessionFile
from sport.cli import NEW_OBJECTS

PATIENCE_S = 120.0
FRAME_S = 1.0 / 60.0  # of a display


def main() -> None:
    """Open a file, by itself or in the application without a display, and print seconds, megabytes and what was said."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--window", action="store_true", help="in the application, and play its first take")
    options = parser.parse_args()
    gc.set_threshold(NEW_OBJECTS)  # as the program has it
    begun = time.process_time()
    seconds, said = (in_window if options.window else alone)(options.file)
    most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    numbers = [*seconds, time.process_time() - begun]
    print(" | ".join([*(f"{value:.2f}" for value in numbers), str(most_mb), said[-150:]]))


def alone(path: Path) -> tuple[list[float], str]:
    """Seconds of opening and of loading the first take, and what was said."""
    begun, times, said = time.perf_counter(), list[float](), ""
    try:
        file, history = SessionFile.open(path, path.parent / "cache")
        times, said = [time.perf_counter() - begun], file.repaired
        for take in history.present.session.takes[:1]:
            len(take.clip)
        times.append(time.perf_counter() - begun - times[0])
        file.close()
    except SportError as error:
        said = str(error)
    return [*times, time.perf_counter() - begun, 0.0][:2], said


def in_window(path: Path) -> tuple[list[float], str]:
    """Seconds until the window answers, of the processor until then, until the first take plays, of the longest frame; what was said."""
    from tests.conftest import opened
    from tests.helpers.viewer_fakes import fake_services

    with tempfile.TemporaryDirectory() as folder:
        app = opened(Path(folder), {}, fake_services(drawn=False), False)
        app.frame()
        app.jobs.blocking = False  # as in a window
        frames, before = [0.0], app.editor.session

        def until(done: Callable[[], bool]) -> float:
            begun = last = time.perf_counter()
            while not done() and last - begun < PATIENCE_S:
                app.frame()
                frames.append(time.perf_counter() - last)
                time.sleep(max(last + FRAME_S - time.perf_counter(), 0.0))
                last = time.perf_counter()
            return last - begun

        def answered() -> bool:
            said = [message.text for message in app.messages.recent if "Reading" not in message.text]
            return app.editor.session is not before or any(path.name in text for text in said)

        begun = time.process_time()
        app.sessions.open(path)
        times = [until(answered), time.process_time() - begun]
        said = app.messages.recent[-1].text if app.messages.recent else ""
        takes = app.editor.session.takes
        if takes:
            app.takes.play(takes[0].number)
            times.append(
                until(lambda: app.takes.playback is not None or app.messages.recent[-1].text != said)
            )
            settled = time.perf_counter() + 1.0
            until(lambda: time.perf_counter() > settled)
        app.close()
        return [*times[:2], sum(times[2:]), max(frames)], said


if __name__ == "__main__":
    main()
