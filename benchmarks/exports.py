"""What a film costs over drawing alone: python -m benchmarks.exports [--seconds 12]."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from benchmarks.timing import times_ms
from runtime.errors import run_command
from runtime.generate import generate_clip
from runtime.terrain.height_map import Terrain
from viewer.filming.film import FilmOptions, film_frames, make_film, studio


def main() -> int:
    """Draw a clip twice at 30 frames a second, alone and as a film, and print the seconds."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.exports", description=__doc__)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720), metavar=("W", "H"))
    args = parser.parse_args()
    clip = generate_clip("walk normally", seconds=args.seconds)
    ground, options = Terrain.flat(), FilmOptions(*args.size)

    def drawing() -> None:
        with studio(options.size, ground) as draw:
            for _ in film_frames(clip, ground, options, draw):
                pass

    drawn = times_ms(drawing, 1)[0]
    with tempfile.TemporaryDirectory() as folder:
        film = times_ms(lambda: make_film(clip, ground, Path(folder) / "film.mp4", options), 1)[0]
    print(f"drawing {drawn / 1e3:.2f} s, film {film / 1e3:.2f} s, ratio {film / drawn:.2f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("exports", main))
