"""Fastest step of a hand on the character over that of the motion: `python -m tests.hand_steps take.bvh ...`.

`sport generate --seconds 600 --path random --out take.bvh` makes a take. A factor of 1 says that no contact of hand and body makes a
hand faster than the motion does, 1.3 is too much.
"""

import argparse
from pathlib import Path

import numpy as np

from runtime.assets import asset_path
from runtime.character.character import Character, load_character
from runtime.formats.glb import CHUNK_FRAMES
from runtime.formats.glb_skeleton import HANDS_FRAMES
from runtime.formats.reference import open_take
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip

HANDS = [SPORT_SKELETON.index(name) for name in ("LeftHand", "RightHand")]
MAX_FACTOR = 1.3


def factor(character: Character, clip: Clip) -> tuple[float, int]:
    """The fastest step of a hand over the fastest one of the motion, and its frame; in parts, as exports are made."""
    positions, world = (array.astype(np.float64) for array in clip.world())
    shown = np.empty((len(clip), len(HANDS), 3))
    for first in range(0, len(clip), CHUNK_FRAMES):
        begin, end = max(first - HANDS_FRAMES, 0), first + CHUNK_FRAMES + HANDS_FRAMES
        contacts = np.asarray(clip.contacts[begin:end], np.float64)
        at, _ = character.adapted(positions[begin:end], world[begin:end], contacts)
        shown[first : first + CHUNK_FRAMES] = at[first - begin :][:CHUNK_FRAMES, HANDS]
    steps, own = (np.linalg.norm(np.diff(hands, axis=0), axis=-1) for hands in (shown, positions[:, HANDS]))
    return float(steps.max() / own.max()), int(steps.max(axis=1).argmax())


def main() -> int:
    """Print a line for each take; 1 where a hand is faster than it may be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("takes", type=Path, nargs="+", metavar="TAKE")
    character = load_character(asset_path("character/mannequin.glb"))
    worst = 0.0
    for path in parser.parse_args().takes:
        clip = open_take(path).clip
        found, frame = factor(character, clip)
        worst = max(worst, found)
        print(f"{path.name}: {len(clip)} frames, x{found:.2f} at frame {frame}", flush=True)
    print(f"worst x{worst:.2f}")
    return int(worst > MAX_FACTOR)


if __name__ == "__main__":
    raise SystemExit(main())
