"""Poses a skinned glTF by a clip: joints by name or by a joint map, posed vertices for every frame.

python examples/04_own_character.py [CHARACTER.glb [JOINT_MAP.json]]
"""

import sys
from pathlib import Path

import trimesh

from sport import asset_path, generate_clip, load_character, read_joint_map, skin_vertices

# SPORT joint to joint of the file, only for those with unknown names. In a file: {"Hips": "Root_M", ...}
JOINT_MAP = {"Hips": "Hips", "Head": "Head"}
FRAMES = (0, 30, 60)


def main(arguments: list[str]) -> None:
    """Write `posed_0.obj` and so on."""
    path = Path(arguments[0]) if arguments else asset_path("character/mannequin.glb")
    joint_map = read_joint_map(arguments[1]) if len(arguments) > 1 else {} if arguments else JOINT_MAP
    character = load_character(path, joint_map)
    driven = int((character.sport_joints >= 0).sum())
    print(f"{path.name}: {len(character.positions)} vertices, {driven} of its joints are driven")

    clip = generate_clip("a proud, self-important person", seconds=1.5)
    for frame in FRAMES:
        matrices = character.skin_matrices(clip.pose(frame))  # (K, 4, 4)
        vertices = skin_vertices(character, matrices)  # (V, 3) metres
        mesh = trimesh.Trimesh(vertices, character.triangles.reshape(-1, 3), process=False)
        mesh.export(f"posed_{frame}.obj")
        low, high = mesh.bounds
        print(f"posed_{frame}.obj: {high[1] - low[1]:.2f} m high, at z = {vertices[:, 2].mean():.2f} m")


if __name__ == "__main__":
    main(sys.argv[1:])
