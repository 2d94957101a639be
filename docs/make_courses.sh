#!/usr/bin/env bash
# Makes docs/images/courses.jpg: six obstacle courses, a moment of each.
#   docs/make_courses.sh
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
moment() { # clip, and where the hips are then: highest, "up" or "ahead" so many metres; a range that begins there
  python - "$@" <<'PYTHON'
import sys
from pathlib import Path

import numpy as np

from runtime.formats.bvh_clip import load_clip_bvh

clip = load_clip_bvh(Path(sys.argv[1]))
hips = clip.hips_positions
where, _, metres = sys.argv[2].partition(" ")
along = hips[:, 2 if where == "ahead" else 1]
frame = int(np.argmax(along) if where == "highest" else np.argmax(along > float(metres) + (where == "up") * along[0]))
start = min(frame / clip.fps, clip.seconds - 0.2)
print(f"{start:.3f}:{start + 0.15:.3f}")
PYTHON
}
shot() { # name, ground, prompt, gait, seconds, the moment that is shown
  python -m sport generate --prompt "$3" --terrain "$2" --path forward --gait "$4" --seconds "$5" --out "$work/$1.bvh"
  python -m sport convert "$work/$1.bvh" "$work/$1.mp4" --terrain "$2" --size 960x540 --camera side --no-captions \
    --range "$(moment "$work/$1.bvh" "$6")"
}
shot 1-hurdle hurdles "an ordinary walk" walk 14 highest
shot 2-wall wall "an ordinary walk" walk 12 "up 0.5"
shot 3-platforms gaps "a happy child" jog 9 "ahead 12.05"
shot 4-beam beam "a happy child" walk 12 "ahead 5"
shot 5-stairs stairs "an old man" walk 12 "ahead 4"
shot 6-hill hills "an exhausted soldier" walk 10 "ahead 4"
python - "$work"/*.mp4 docs/images/courses.jpg <<'PYTHON'
import sys

import av
from PIL import Image

*films, target = sys.argv[1:]
sheet = Image.new("RGB", (1440, 540))
for number, path in enumerate(films):
    with av.open(path) as film:
        picture = next(film.decode(video=0)).to_image().resize((480, 270), Image.Resampling.LANCZOS)
    sheet.paste(picture, (480 * (number % 3), 270 * (number // 3)))
sheet.save(target, quality=85)
PYTHON
