"""What a film costs beside drawing alone, and what loops come to: python -m benchmarks.exports [--seconds 12] [--json FILE]."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

from runtime.atomic import write_atomic
from runtime.errors import run_command
from runtime.formats.prepare import ExportOptions, prepare
from runtime.generate import generate_clip
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.filming.film import FilmOptions, film_frames, make_film, studio

PROMPTS = ("walk normally", "an old man", "march like a soldier")


def measure_film(clip: Clip, size: tuple[int, int]) -> dict[str, float]:
    """Seconds of drawing a clip twice, once alone and once as a film, at 30 frames a second."""
    ground, options = Terrain.flat(), FilmOptions(*size)
    before = time.perf_counter()
    with studio(options.size, ground) as draw:
        frames = sum(1 for _ in film_frames(clip, ground, options, draw))
    between = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        make_film(clip, ground, Path(folder) / "film.mp4", options)
    drawing, film = between - before, time.perf_counter() - between
    return {"frames": frames, "drawing_s": drawing, "film_s": film, "film_to_drawing": film / drawing}


def measure_loop(clip: Clip) -> dict[str, float]:
    """What `--loop` reports of a clip."""
    report = prepare(clip, ExportOptions(loop=True), Terrain.flat()).loop
    return {} if report is None else {name: float(v) for name, v in vars(report).items()}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.exports", description=__doc__)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720), metavar=("W", "H"))
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    clips = {prompt: generate_clip(prompt, seconds=args.seconds) for prompt in PROMPTS}
    figures = {
        "film": measure_film(clips[PROMPTS[0]], tuple(args.size)),
        "loops": {prompt: measure_loop(clip) for prompt, clip in clips.items()},
    }
    text = json.dumps(figures, indent=1)
    print(text)
    if args.json is not None:
        write_atomic(args.json, text + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("exports", main))
