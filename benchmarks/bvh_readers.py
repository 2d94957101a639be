"""Does an exported BVH mean the same to other programs? Two steps, as the readers live in environments of their own.

    python -m benchmarks.bvh_readers make DIR              a generated clip as BVH, and its joints by our kinematics
    python benchmarks/bvh_readers.py check DIR bvhio       pip install bvhio
    python benchmarks/bvh_readers.py check DIR blender     pip install bpy==5.0.1 (python 3.11, numpy < 2)

`check` prints the largest joint distance in millimetres, frame rate, frame count and root path; it exits with 1 when
they differ by more than a millimetre. It needs numpy and the reader only.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

TOLERANCE_MM = 1.0
FRAMES_CHECKED = 60


def make(folder: Path) -> None:
    """Generate a clip and write `clip.bvh` (centimetres) with `clip.npz` (joint positions in metres)."""
    from runtime.formats.bvh_clip import save_bvh
    from runtime.generate import generate_clip

    folder.mkdir(parents=True, exist_ok=True)
    clip = generate_clip("an angry person stomping", "hills", "figure8", "walk", 8.0, 1)
    save_bvh(clip, folder / "clip.bvh")
    positions, _ = clip.world()
    from runtime.skeleton import SPORT_SKELETON

    np.savez(folder / "clip.npz", positions=positions, fps=clip.fps, names=np.array(SPORT_SKELETON.names))


def read_bvhio(path: Path, frames: np.ndarray, names: list[str]) -> tuple[np.ndarray, float, int]:
    """Joint positions `(n, J, 3)` in metres, frames per second and frame count as bvhio reads them."""
    import bvhio

    container = bvhio.readAsBvh(str(path))
    root = bvhio.convertBvhToHierarchy(container.Root)
    joints = {joint.Name: joint for joint, _, _ in root.layout()}
    result = np.empty((len(frames), len(names), 3))
    for k, frame in enumerate(frames):
        root.loadPose(int(frame))
        for j, name in enumerate(names):
            result[k, j] = list(joints[name].PositionWorld)
    return result / 100.0, 1.0 / container.FrameTime, container.FrameCount


def read_blender(path: Path, frames: np.ndarray, names: list[str]) -> tuple[np.ndarray, float, int]:
    """The same as Blender imports it; Blender frame 1 is BVH frame 0, and its Z axis points up."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_anim.bvh(
        filepath=str(path), global_scale=0.01, update_scene_fps=True, update_scene_duration=True
    )
    armature = bpy.context.object
    scene = bpy.context.scene
    result = np.empty((len(frames), len(names), 3))
    for k, frame in enumerate(frames):
        scene.frame_set(int(frame) + 1)
        for j, name in enumerate(names):
            x, y, z = armature.matrix_world @ armature.pose.bones[name].head
            result[k, j] = x, z, -y
    first, last = armature.animation_data.action.frame_range
    return result, scene.render.fps / scene.render.fps_base, round(last - first) + 1


def check(folder: Path, reader: str) -> int:
    """Compare and print; 1 when a bar is missed."""
    reference = np.load(folder / "clip.npz", allow_pickle=False)
    positions, names = reference["positions"], [str(n) for n in reference["names"]]
    frames = np.unique(np.linspace(0, len(positions) - 1, FRAMES_CHECKED).astype(int))
    read = {"bvhio": read_bvhio, "blender": read_blender}[reader]
    theirs, fps, count = read(folder / "clip.bvh", frames, names)
    distance = 1000.0 * np.linalg.norm(theirs - positions[frames], axis=-1)
    root = 1000.0 * np.abs(theirs[:, 0] - positions[frames, 0]).max()
    print(f"{reader}: joints {distance.max():.4f} mm, root path {root:.4f} mm, {fps:.3f} fps, {count} frames")
    same = count == len(positions) and abs(fps - float(reference["fps"])) < 0.01
    return 0 if same and distance.max() <= TOLERANCE_MM else 1


def main(argv: list[str] | None = None) -> int:
    """Parse the step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    steps = parser.add_subparsers(dest="step", required=True)
    steps.add_parser("make").add_argument("folder", type=Path)
    checker = steps.add_parser("check")
    checker.add_argument("folder", type=Path)
    checker.add_argument("reader", choices=("bvhio", "blender"))
    options = parser.parse_args(argv)
    if options.step == "make":
        make(options.folder)
        return 0
    return check(options.folder, options.reader)


if __name__ == "__main__":
    sys.exit(main())
