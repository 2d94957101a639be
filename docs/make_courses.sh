#!/bin/sh
# The six obstacle courses as one picture: docs/images/courses.jpg. Needs ffmpeg. Run from the repository's root.
set -eu
work=$(mktemp -d)
shot() { # name, ground, prompt, gait, seconds, the second that is shown
    sport generate --prompt "$3" --terrain "$2" --path forward --gait "$4" --seconds "$5" --out "$work/$1.bvh"
    sport convert "$work/$1.bvh" "$work/$1.mp4" --terrain "$2" --size 960x540 --camera side --no-captions --range "$6"
    ffmpeg -v error -y -i "$work/$1.mp4" -frames:v 1 "$work/$1.png"
}
shot hurdle hurdles "an ordinary walk" walk 14 12.0:12.2
shot wall wall "an ordinary walk" walk 14 11.0:11.2
shot platforms gaps "a happy child" jog 8 3.6:3.8
shot beam beam "a drunk" walk 14 11.0:11.2
shot stairs stairs "an old man" walk 12 10.0:10.2
shot hill hills "an exhausted soldier" walk 10 6.0:6.2
ffmpeg -v error -y -i "$work/hurdle.png" -i "$work/wall.png" -i "$work/platforms.png" \
    -i "$work/beam.png" -i "$work/stairs.png" -i "$work/hill.png" -filter_complex \
    "[0][1][2][3][4][5]xstack=inputs=6:layout=0_0|w0_0|w0+w0_0|0_h0|w0_h0|w0+w0_h0,scale=1440:-1" \
    -frames:v 1 -q:v 3 docs/images/courses.jpg
rm -r "$work"
