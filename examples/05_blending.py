"""Blends two styles: four even steps of Z^t, and a blend with a separate weight for each part of the body."""

import numpy as np

from sport import (
    SPORT_SKELETON,
    BlendedPrompt,
    Controller,
    Controls,
    Prompter,
    Terrain,
    generate_clip,
    load_model,
    mix_of_parts,
    parse_weights,
    save_bvh,
)

A, B = "a person walking normally", "a child pretending to be an aeroplane"
STEPS = 4
HANDS = [SPORT_SKELETON.index(name) for name in ("LeftHand", "RightHand")]
HIPS = SPORT_SKELETON.index("Hips")


def main() -> None:
    """Print the height of the hands at each step, and write `blend.bvh`."""
    model = load_model()
    to_style = Prompter(model)
    z_a, z_b = to_style(A), to_style(B)  # (6, 64): a row for each part of the body
    for share in np.linspace(0.0, 1.0, STEPS + 1):
        controller = Controller(model, Terrain.flat(), seed=0)
        controller.set_style(mix_of_parts(z_a, z_b, (float(share),) * 6), transition_seconds=0.0)
        poses = [controller.step(Controls(move=(0.0, 1.0))) for _ in range(70)]
        hands = np.stack([pose.positions[HANDS, 1] - pose.positions[HIPS, 1] for pose in poses[30:]])
        print(f"{share:.2f} of B: hands {100 * hands.mean():+5.1f} cm over the hips")

    weights = parse_weights("torso=1,head=0.5")  # parts that are not named stay with A
    clip = generate_clip(BlendedPrompt("a proud queen", "an exhausted soldier", weights), seconds=2.0)
    print(f"{save_bvh(clip, 'blend.bvh')}: {clip.seconds:.1f} s")


if __name__ == "__main__":
    main()
