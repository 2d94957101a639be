"""Generates a BVH from a prompt, a ground and a path, with a file next to it that records how it was made."""

import json
from pathlib import Path

from sport import generate_clip, load_clip_bvh, save_bvh

OUT = Path("soldier.bvh")


def main() -> None:
    """Write `soldier.bvh` and read it back."""
    clip = generate_clip(
        "an exhausted soldier, left arm hanging",
        terrain="hills",
        path="circle",
        gait="walk",
        seconds=3.0,
        seed=1,  # the same arguments and seed give the same file
        report=print,  # how similar the library's nearest prompts are
    )
    save_bvh(clip, OUT, fps=30, unit="cm")

    about = json.loads(OUT.with_name(OUT.name + ".json").read_text(encoding="utf-8"))
    print(f"{OUT}: model {about['model']}, seed {about['seed']}, ground {about['terrain']}")
    for part, sentence in about["prompts"][0]["words"].items():
        print(f"  {part}: {sentence}")

    again = load_clip_bvh(OUT)  # metres and quaternions, whatever the file's unit
    positions, _ = again.world()
    print(
        f"{len(again)} frames at {again.fps:g} fps; the head is {positions[0, 16, 1]:.2f} m up in the first"
    )


if __name__ == "__main__":
    main()
