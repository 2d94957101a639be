#!/usr/bin/env bash
# Makes docs/images/courses.jpg: six obstacle courses, a moment of each.
#   docs/make_courses.sh
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
shot() { # name, ground, prompt, gait, seconds, the second that is shown
  python -m sport generate --prompt "$3" --terrain "$2" --path forward --gait "$4" --seconds "$5" --out "$work/$1.bvh"
  python -m sport convert "$work/$1.bvh" "$work/$1.mp4" --terrain "$2" --size 960x540 --camera side --no-captions --range "$6"
}
shot 1-hurdle hurdles "an ordinary walk" walk 14 12.4:12.55
shot 2-wall wall "an ordinary walk" walk 15 13.1:13.25
shot 3-platforms gaps "a happy child" jog 9 5.05:5.2
shot 4-beam beam "a happy child" walk 12 5.9:6.05
shot 5-stairs stairs "an old man" walk 12 7.5:7.65
shot 6-hill hills "an exhausted soldier" walk 10 6.45:6.6
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
sheet.save(target, quality=88)
PYTHON
