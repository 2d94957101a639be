"""`python -m tests.signals [--only NAME] [--moments N]`: SIGINT and SIGTERM at moments of each command, as a table."""

import argparse
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.signals.commands import COMMANDS, Place, run_signalled, words

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def make_inputs(folder: Path) -> Path:
    """The takes, session and list that the commands read."""
    folder.mkdir()
    from runtime.formats.bvh_clip import save_bvh
    from runtime.takes.clip import Clip
    from tests.helpers.synthetic_clips import save_motion
    from tests.helpers.walker import walk

    for name, seconds in (("take", 2), ("long", 20)):
        save_bvh(Clip(name, 60.0, *walk(60 * seconds)), folder / f"{name}.bvh")
    capture = folder / "capture"
    capture.mkdir()
    for style, pace in (("neutral", 1.0), ("old", 0.5)):
        for number in range(6):
            motion = walk(300, speed_share=pace + 0.02 * number)
            save_motion(
                capture, f"{style}_{number}", motion, style=style, split="train" if number else "held_out"
            )
    (folder / "list.csv").write_text("prompt,out\n" + "".join(f"zombie,{k}.bvh\n" for k in range(12)))
    from runtime.session.session_file import SessionFile

    SessionFile.create(folder / "one.sport", folder / "characters").close()
    return folder


def start_of_python() -> float:
    """Seconds from the start of a process until it can take signals: until then nobody can."""
    begin = time.monotonic()
    subprocess.run([sys.executable, "-c", "import runtime.interrupts"], check=True)
    return time.monotonic() - begin


def main() -> int:
    """Print a row for each command and signal; 1 when anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="commands whose name holds this")
    parser.add_argument("--exact", help="one command by its whole name")
    parser.add_argument("--moments", type=int, default=12)
    parser.add_argument("--limit", type=float, default=2.0, help="seconds from the signal to the end")
    parser.add_argument("--group", action="store_true", help="to all processes, as a terminal does")
    options = parser.parse_args()
    print(
        "| command | lasts (s) | signal | moments | slowest end (s) | wrong |\n| --- | --- | --- | --- | --- | --- |"
    )
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inputs = make_inputs(folder / "inputs")
        for label, line in COMMANDS.items():
            if options.only not in label or options.exact not in (None, label):
                continue
            whole, begin = Place(folder / "whole", inputs), time.monotonic()
            ended = whole.ended(whole.start(words(line)), begin, 120.0)
            lasts = min(time.monotonic() - begin, 120.0)
            if ended.code not in (0, 137):
                print(f"{label}: {ended.said[-500:]}", file=sys.stderr)
            shutil.rmtree(folder / "whole")
            started_s = 1.5 * max(start_of_python() for _ in range(3))
            for number in SIGNALS:
                slowest, wrong = 0.0, []
                for k in range(options.moments):
                    after_s = started_s + (lasts - started_s) * (k / options.moments) ** 1.5
                    place = Place(folder / "run", inputs)
                    ended = run_signalled(place, words(line), after_s, number, options.group)
                    slowest = max(slowest, ended.seconds)
                    wrong += [f"{after_s:.2f} s: {text}" for text in ended.problems(number, options.limit)]
                    shutil.rmtree(folder / "run")
                bad += len(wrong)
                print(
                    f"| {label} | {lasts:.1f} | {signal.Signals(number).name} | {options.moments} | {slowest:.2f} | {len(wrong)} |",
                    flush=True,
                )
                for text in wrong:
                    print(f"{label}: {signal.Signals(number).name} after {text}", file=sys.stderr, flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
