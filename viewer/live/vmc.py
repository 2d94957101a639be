"""The VMC protocol: the shown pose for every program that receives it, as OSC messages over UDP.

https://protocol.vmc.info: Unity's axes (left-handed, the character's right on +X), names of Unity's HumanBodyBones.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.formats.engines import ENGINES
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from viewer.live.link import STEP_S, Address, LiveLink

VMC_PORT = 39539
MAX_BYTES = 1400  # of a datagram that no network splits
# joints that are bones of a humanoid, and the bone above each; -1: the root
_NAMES = {ours: bone for ours, bone in ENGINES["unity"].bones.items() if ours != "Root"}
JOINTS = tuple(SPORT_SKELETON.index(name) for name in _NAMES)
BONES = tuple(_NAMES.values())


def _bone_above(joint: int) -> int:
    above = SPORT_SKELETON.parents[joint]
    while above >= 0 and above not in JOINTS:
        above = SPORT_SKELETON.parents[above]
    return above


PARENTS = tuple(_bone_above(joint) for joint in JOINTS)


def osc_message(address: str, *values: str | int | float) -> bytes:
    """An OSC 1.0 message of strings, whole numbers and floats."""

    def text(value: str) -> bytes:
        data = value.encode("utf-8") + b"\0"
        return data + b"\0" * (-len(data) % 4)

    tags = ["s" if isinstance(v, str) else "i" if isinstance(v, int) else "f" for v in values]
    packed = [
        text(v) if isinstance(v, str) else struct.pack(f">{tag}", v)
        for tag, v in zip(tags, values, strict=True)
    ]
    return text(address) + text("," + "".join(tags)) + b"".join(packed)


def osc_bundles(messages: Sequence[bytes]) -> list[bytes]:
    """Messages as bundles of at most `MAX_BYTES`, to be applied at once."""
    head = b"#bundle\0" + struct.pack(">Q", 1)
    bundles = [head]
    for message in messages:
        part = struct.pack(">i", len(message)) + message
        if len(bundles[-1]) + len(part) > MAX_BYTES:
            bundles.append(head)
        bundles[-1] += part
    return bundles


def vmc_bones(pose: Pose) -> dict[str, tuple[Array, Array]]:
    """Position `(3,)` in metres and rotation `(4,)` x, y, z, w of each bone against the bone above it, in Unity's axes."""
    positions, world = pose.positions.astype(np.float64), pose.world_rotations.astype(np.float64)
    found = {}
    for joint, bone, above in zip(JOINTS, BONES, PARENTS, strict=True):
        at, turn = positions[joint], world[joint]
        if above >= 0:
            back = rotations.inverse(world[above])
            at, turn = rotations.rotate(back, at - positions[above]), rotations.multiply(back, turn)
        w, x, y, z = turn
        found[bone] = (at * (-1.0, 1.0, 1.0), np.array([x, -y, -z, w]))
    return found


def vmc_messages(pose: Pose, seconds: float) -> list[bytes]:
    """The messages of a pose after `seconds` of motion."""
    messages = [osc_message("/VMC/Ext/OK", 1), osc_message("/VMC/Ext/T", float(seconds))]
    still = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    messages.append(osc_message("/VMC/Ext/Root/Pos", "root", *still))
    for bone, (at, turn) in vmc_bones(pose).items():
        messages.append(osc_message("/VMC/Ext/Bone/Pos", bone, *map(float, (*at, *turn))))
    return messages


@dataclass
class VmcLink(LiveLink):
    """The live link by VMC; a pose is `sent` when all its bundles were."""

    name: str = "VMC"
    receivers: str = "Unity, Warudo, VSeeFace and other VMC receivers"
    address: Address = field(default_factory=lambda: Address(port=VMC_PORT))

    def publish(self, poses: Sequence[Pose], step_s: float = STEP_S, size: float = 1.0) -> None:
        """Send the poses of one frame, oldest first and `step_s` apart; nothing while the link is off.

        Receivers have avatars of their own size: lengths stay those of our skeleton, whatever `size` is.
        """
        for pose in poses if self.on else ():
            self._send_pose(osc_bundles(vmc_messages(pose, self._motion_s)), step_s)
