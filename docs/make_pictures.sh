#!/usr/bin/env bash
# Makes every picture of the README with the installed program. Needs no display; takes some minutes.
#   docs/make_pictures.sh [MODEL_DIR]        a model folder in place of the shipped one
set -euo pipefail
cd "$(dirname "$0")/.."
export SPORT_CONFIG_DIR  # nobody's own settings in the pictures
SPORT_CONFIG_DIR=$(mktemp -d)
clips=$(mktemp -d)
trap 'rm -rf "$SPORT_CONFIG_DIR" "$clips"' EXIT
model=()
[ $# -eq 0 ] || model=(--model "$1")
images=docs/images
mkdir -p "$images"

shot() { # PICTURE SIZE FRAMES OPTIONS...
  local picture=$images/$1 size=$2 frames=$3
  shift 3
  sport view --offscreen "${model[@]}" --quality high --size "$size" --frames "$frames" "$@" --screenshot "$picture"
  echo "$picture"
}

# Prompts that follow each other in one walk, as a film
sport generate "${model[@]}" --terrain hills --path circle --seconds 21 --seed 3 --out "$clips/film.bvh" --prompts \
  "0:walking in a relaxed, everyday way; 4:an exhausted soldier, left arm hanging; 8.5:a child pretending to be an aeroplane; \
13:a proud queen, hands on her hips; 17:walking in a relaxed, everyday way"
sport convert "$clips/film.bvh" "$images/film.webp" --fps 15 --size 640x360 --camera front

shot viewer.png 1280x720 230 --character walker --terrain hills --prompt "an exhausted soldier, left arm hanging" --keys "3 0.1; s+d 3.8"
shot blend.png 1280x720 110 --terrain flat --prompt "a proud queen" --blend "an exhausted soldier" \
  --blend-weights "left_leg=0.3,right_leg=0.3,torso=1,head=0.5" --keys "w 1.3; w+q 0.6"
shot help.png 1280x720 3 --keys "f1 0.2" --terrain flat
small=(640x400 210 --no-panels --keys "w+shift 2; w 0.8; w+q 0.7")
shot stairs.png "${small[@]}" --terrain stairs --prompt "a proud, self-important person"
shot platforms.png "${small[@]}" --terrain platforms --prompt "an energetic, sporty person"
shot rough.png "${small[@]}" --terrain rough --prompt "someone feeling their way through the dark"
shot height_map.png "${small[@]}" --terrain assets/terrains/bowl.png --prompt "a lively young person"

# Six styles at the same controls, path and seed
styles=(
  "a person walking normally"
  "a child pretending to be an aeroplane"
  "someone strutting like a chicken"
  "someone feeling their way through the dark"
  "a proud, self-important person"
  "a karate fighter chopping"
)
files=()
for i in "${!styles[@]}"; do
  sport generate "${model[@]}" --prompt "${styles[$i]}" --path forward --seconds 6 --seed 1 --out "$clips/$i.bvh"
  files+=("$clips/$i.bvh")
done
python -m viewer.tools.contact_sheet "${files[@]}" --labels "${styles[@]}" --start 4 --interval 0.2 --out "$images/styles.png"
echo "$images/styles.png"

# Words about single parts, in combinations that training never showed
words=(
  "a queen with her hands on her hips"
  "arms crossed, head down"
  "a zombie, both arms stretched out in front"
  "a tired waiter, left hand on the head"
)
files=()
for i in "${!words[@]}"; do
  sport generate "${model[@]}" --prompt "${words[$i]}" --path forward --seconds 6 --seed 1 --out "$clips/words$i.bvh"
  files+=("$clips/words$i.bvh")
done
python -m viewer.tools.contact_sheet "${files[@]}" --labels "${words[@]}" --start 4 --interval 0.2 --out "$images/words.png"
echo "$images/words.png"

# As small as they get without a loss; the viewer's, first in the README, in 256 colours
python - "$images"/*.png <<'PYTHON'
import sys

from PIL import Image

for path in sys.argv[1:]:
    picture = Image.open(path).convert("RGB")
    if path.endswith("/viewer.png"):
        picture = picture.quantize(palette=picture.quantize(256, kmeans=3), dither=Image.Dither.FLOYDSTEINBERG)
    picture.save(path, optimize=True)
PYTHON
