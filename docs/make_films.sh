#!/usr/bin/env bash
# Makes the side-by-side films of docs/images/beside: the captured walk left, ours on the same path right.
#   docs/make_films.sh CLIPS [MODEL_DIR]     CLIPS: folder of imported clips (`sport train import`)
set -euo pipefail
cd "$(dirname "$0")/.."
clips=$1
model=()
[ $# -lt 2 ] || model=(--model "$2")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p docs/images/beside
styles=(neutral_bn proud old active masculine2 drunk)
for style in "${styles[@]}"; do
  python -m training.evaluation same-path --clips "$clips" --styles "$style" --bvh "$work" "${model[@]}"
  python -m viewer.tools.film "$work/${style}_captured.bvh" "$work/${style}_ours.bvh" --labels captured ours \
    --fps 15 --size 560 315 --out "docs/images/beside/$style.webp"
done
