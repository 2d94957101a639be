#!/usr/bin/env bash
# Makes docs/images/courses.jpg: six obstacle courses, a moment of each. Needs ffmpeg.
#   docs/make_courses.sh
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
shot() { # name, ground, prompt, gait, seconds, the second that is shown
  python -m sport generate --prompt "$3" --terrain "$2" --path forward --gait "$4" --seconds "$5" --out "$work/$1.bvh"
  python -m sport convert "$work/$1.bvh" "$work/$1.mp4" --terrain "$2" --size 960x540 --camera side --no-captions --range "$6"
  ffmpeg -v error -y -i "$work/$1.mp4" -frames:v 1 "$work/$1.png"
}
shot hurdle hurdles "an ordinary walk" walk 14 10.15:10.3
shot wall wall "an ordinary walk" walk 15 11.15:11.3
shot platforms gaps "a happy child" jog 9 4.45:4.6
shot beam beam "a happy child" walk 12 5.9:6.05
shot stairs stairs "an old man" walk 12 7.5:7.65
shot hill hills "an exhausted soldier" walk 10 6.45:6.6
ffmpeg -v error -y -i "$work/hurdle.png" -i "$work/wall.png" -i "$work/platforms.png" \
  -i "$work/beam.png" -i "$work/stairs.png" -i "$work/hill.png" -filter_complex \
  "[0][1][2][3][4][5]xstack=inputs=6:layout=0_0|w0_0|w0+w0_0|0_h0|w0_h0|w0+w0_h0,scale=1440:-2" \
  -frames:v 1 -q:v 3 docs/images/courses.jpg
