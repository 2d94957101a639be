"""Joint hierarchies, forward kinematics, and the 31-joint PFNN / CMU skeleton that every network here uses."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array


@dataclass(frozen=True)
class Skeleton:
    """A joint hierarchy in its rest pose, parents before children.

    `offsets` `(J, 3)` are metres from each joint's parent to the joint, in the rest pose, where all local rotations are
    the identity; the root's own offset is ignored by `forward_kinematics`.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the index of the joint `name`; ValueError if there is none."""
        return self.names.index(name)

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """Direct children of each joint."""
        return tuple(tuple(c for c, p in enumerate(self.parents) if p == j) for j in range(len(self)))

    @cached_property
    def rest_positions(self) -> Array:
        """Joint positions `(J, 3)` of the rest pose with the root at the origin."""
        return self.forward_kinematics(np.zeros(3, np.float32), rotations.identity((len(self),)))[0]

    def forward_kinematics(self, root_position: Array, local: Array) -> tuple[Array, Array]:
        """Return world positions `(..., J, 3)` and rotations `(..., J, 4)` of a pose.

        `root_position` `(..., 3)` in metres, `local` `(..., J, 4)` rotations relative to the parent.
        """
        local = np.asarray(local)
        order, places, levels = self._by_depth
        ordered = local.take(order, -2)[..., None]
        world = ordered.copy()
        for joints, parents in levels:
            above = rotations.left_matrix(world[..., 0].take(parents, -2))
            np.matmul(above, ordered[..., joints, :, :], out=world[..., joints, :, :])
        world = world[..., 0].take(places, -2)
        bones = rotations.rotate(world.take(self._parents, -2), self.offsets)
        positions = np.asarray(root_position)[..., None, :] + self._above[bones.dtype.char] @ bones
        return positions.astype(local.dtype, copy=False), world

    def oriented(self, root_position: Array, world: Array) -> tuple[Array, Array]:
        """Return local rotation matrices `(..., J, 3, 3)` and world positions `(..., J, 3)` for world rotation matrices."""
        above = world.take(self._parents, -3)
        bones = (above @ self.offsets[:, :, None])[..., 0]
        local = above.swapaxes(-1, -2) @ world
        local[..., self._roots, :, :] = world[..., self._roots, :, :]
        return local, np.asarray(root_position)[..., None, :] + self._above[bones.dtype.char] @ bones

    @cached_property
    def _parents(self) -> NDArray[np.int64]:
        """Return the parent of each joint; the root is its own parent."""
        return np.maximum(np.array(self.parents), 0)

    @cached_property
    def _roots(self) -> NDArray[np.int64]:
        """Joints without a parent."""
        return np.flatnonzero(np.array(self.parents) < 0)

    @cached_property
    def _above(self) -> dict[str, Array]:
        """`(J, J)`: 1 if the second joint is on the path from the root to the first, including the first but not the root.

        In both dtypes, as mixed products take several times as long.
        """
        above = np.zeros((len(self), len(self)), np.float32)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                above[joint] = above[parent]
                above[joint, joint] = 1.0
        return {"f": above, "d": above.astype(np.float64)}

    @cached_property
    def _by_depth(self) -> tuple[NDArray[np.int64], NDArray[np.int64], list[tuple[slice, NDArray[np.int64]]]]:
        """Joints sorted by depth, each joint's index in that order, and the slices of each depth with their parents' indices."""
        depths: list[int] = []
        for parent in self.parents:
            depths.append(depths[parent] + 1 if parent >= 0 else 0)
        order = np.argsort(depths, kind="stable")
        places = np.argsort(order)
        parents, ends = places[self._parents[order]], np.bincount(depths).cumsum().tolist()
        return order, places, [(slice(a, b), parents[a:b]) for a, b in pairwise(ends)]

    def local_rotations(self, world: Array) -> Array:
        """Return rotations relative to the parent `(..., J, 4)` for world rotations `(..., J, 4)`."""
        local = rotations.multiply(rotations.inverse(world[..., self._parents, :]), world)
        local[..., self._roots, :] = world[..., self._roots, :]
        return local


# name, parent, offset in metres. Lengths are those of the PFNN character (Holden et al. 2017), made symmetric;
# the rest pose is a T-pose with vertical legs and flat feet, facing +Z, the character's left on +X.
_SPORT_JOINTS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Hips", "", (0.0, 0.0, 0.0)),
    ("LHipJoint", "Hips", (0.0, 0.0, 0.0)),
    ("LeftUpLeg", "LHipJoint", (0.0753, -0.1013, 0.0474)),
    ("LeftLeg", "LeftUpLeg", (0.0, -0.4118, 0.0)),
    ("LeftFoot", "LeftLeg", (0.0, -0.4233, 0.0)),
    ("LeftToeBase", "LeftFoot", (0.0, -0.0380, 0.1294)),
    ("RHipJoint", "Hips", (0.0, 0.0, 0.0)),
    ("RightUpLeg", "RHipJoint", (-0.0753, -0.1013, 0.0474)),
    ("RightLeg", "RightUpLeg", (0.0, -0.4118, 0.0)),
    ("RightFoot", "RightLeg", (0.0, -0.4233, 0.0)),
    ("RightToeBase", "RightFoot", (0.0, -0.0380, 0.1294)),
    ("LowerBack", "Hips", (0.0, 0.0, 0.0)),
    ("Spine", "LowerBack", (0.0, 0.1149, -0.0109)),
    ("Spine1", "Spine", (0.0, 0.1156, -0.0024)),
    ("Neck", "Spine1", (0.0, 0.0, 0.0)),
    ("Neck1", "Neck", (0.0, 0.0986, 0.0097)),
    ("Head", "Neck1", (0.0, 0.0994, -0.0070)),
    ("LeftShoulder", "Spine1", (0.0, 0.0, 0.0)),
    ("LeftArm", "LeftShoulder", (0.1842, 0.0678, -0.0176)),
    ("LeftForeArm", "LeftArm", (0.2813, 0.0, 0.0)),
    ("LeftHand", "LeftForeArm", (0.1966, 0.0, 0.0)),
    ("LeftFingerBase", "LeftHand", (0.0, 0.0, 0.0)),
    ("LeftHandIndex1", "LeftFingerBase", (0.0404, 0.0, 0.0)),
    ("LThumb", "LeftHand", (0.0, 0.0, 0.0)),
    ("RightShoulder", "Spine1", (0.0, 0.0, 0.0)),
    ("RightArm", "RightShoulder", (-0.1842, 0.0678, -0.0176)),
    ("RightForeArm", "RightArm", (-0.2813, 0.0, 0.0)),
    ("RightHand", "RightForeArm", (-0.1966, 0.0, 0.0)),
    ("RightFingerBase", "RightHand", (0.0, 0.0, 0.0)),
    ("RightHandIndex1", "RightFingerBase", (-0.0404, 0.0, 0.0)),
    ("RThumb", "RightHand", (0.0, 0.0, 0.0)),
)


def _build_sport_skeleton() -> Skeleton:
    names = tuple(name for name, _, _ in _SPORT_JOINTS)
    parents = tuple(names.index(parent) if parent else -1 for _, parent, _ in _SPORT_JOINTS)
    return Skeleton(names, parents, np.array([offset for *_, offset in _SPORT_JOINTS], np.float32))


SPORT_SKELETON = _build_sport_skeleton()
J = len(SPORT_SKELETON)

# Body parts in the order of the paper's six descriptions (Sec. III-C); every joint belongs to exactly one.
PART_NAMES = ("left_arm", "right_arm", "left_leg", "right_leg", "torso", "head")
PART_JOINTS: dict[str, tuple[int, ...]] = {
    "left_arm": tuple(range(17, 24)),
    "right_arm": tuple(range(24, 31)),
    "left_leg": tuple(range(1, 6)),
    "right_leg": tuple(range(6, 11)),
    "torso": (0, 11, 12, 13),
    "head": (14, 15, 16),
}


def _mirror_of(name: str) -> str:
    pairs = (("Left", "Right"), ("LHip", "RHip"), ("LThumb", "RThumb"))
    for a, b in pairs:
        if name.startswith(a):
            return b + name[len(a) :]
        if name.startswith(b):
            return a + name[len(b) :]
    return name


MIRROR_JOINTS = np.array([SPORT_SKELETON.index(_mirror_of(n)) for n in SPORT_SKELETON.names])


def mirror_motion(hips: Array, local: Array) -> tuple[Array, Array]:
    """Reflect a motion of the SPORT skeleton through the plane X = 0: `hips` `(..., 3)`, `local` `(..., 31, 4)`."""
    mirrored = local[..., MIRROR_JOINTS, :] * np.array([1, 1, -1, -1], np.float32)
    return hips * np.array([-1, 1, 1], np.float32), mirrored


# Heights of ankle and toe joint above the ground with a flat sole, metres (medians of captured stances).
ANKLE_HEIGHT = 0.066
TOE_HEIGHT = 0.028
REST_HIPS_HEIGHT = 0.1013 + 0.4118 + 0.4233 + ANKLE_HEIGHT
