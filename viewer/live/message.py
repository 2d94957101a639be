"""Messages of the live link, version 1, little-endian: the form is described in docs/guide/blender.md."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from runtime.pose import Pose
from runtime.skeleton import Skeleton

MAGIC = b"SPRT"
VERSION = 1
SKELETON, POSE = 1, 2
_HEADER = struct.Struct("<4sBBHII")  # magic, version, kind, joints, sequence, skeleton
_ROOT = struct.Struct("<d3f")  # seconds, position of the uppermost joint
_JOINT = struct.Struct("<h3fB")  # parent, offset, bytes of the name
_SEQUENCES = 1 << 32


def skeleton_joints(skeleton: Skeleton) -> bytes:
    """Names, parents and offsets of all joints; what a skeleton message holds behind its header."""
    found = []
    for name, parent, offset in zip(skeleton.names, skeleton.parents, skeleton.offsets, strict=True):
        text = name.encode("utf-8")
        found.append(_JOINT.pack(parent, *(float(v) for v in offset), len(text)) + text)
    return b"".join(found)


def skeleton_number(joints: bytes) -> int:
    """What tells one skeleton from another: poses carry it, too."""
    return zlib.crc32(joints)


def skeleton_message(joints: bytes, count: int, sequence: int) -> bytes:
    """The announcement of `count` joints from `skeleton_joints`; `sequence` is that of the pose that comes next."""
    header = _HEADER.pack(MAGIC, VERSION, SKELETON, count, sequence % _SEQUENCES, skeleton_number(joints))
    return header + joints


def pose_message(pose: Pose, skeleton: int, sequence: int, seconds: float) -> bytes:
    """A pose after `seconds` of motion: position of the hips in metres, local rotations w, x, y, z."""
    rotations = np.ascontiguousarray(pose.local_rotations, "<f4")
    header = _HEADER.pack(MAGIC, VERSION, POSE, len(rotations), sequence % _SEQUENCES, skeleton)
    return header + _ROOT.pack(seconds, *(float(v) for v in pose.hips_position)) + rotations.tobytes()
