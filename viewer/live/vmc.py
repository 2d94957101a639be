"""The VMC protocol: sends the shown pose as OSC messages over UDP.

https://protocol.vmc.info: Unity's axes (left-handed, the character's right on +X) and names of Unity's HumanBodyBones.
"""

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
MAX_DATAGRAM_BYTES = 1400  # of a datagram that networks do not split
# joints that are humanoid bones, and each one's parent bone; -1: the root
_NAMES = {ours: bone for ours, bone in ENGINES["unity"].bones.items() if ours != "Root"}
JOINTS = tuple(SPORT_SKELETON.index(name) for name in _NAMES)
BONES = tuple(_NAMES.values())


def _bone_above(joint: int) -> int:
    above = SPORT_SKELETON.parents[joint]
    while above >= 0 and above not in JOINTS:
        above = SPORT_SKELETON.parents[above]
    return above


PARENTS = tuple(_bone_above(joint) for joint in JOINTS)


def osc_message(address: str, *values: str | float) -> bytes:
    """Return an OSC 1.0 message with strings, integers and floats."""

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
    """Pack messages into bundles of at most `MAX_DATAGRAM_BYTES`, to be applied at once; five times as fast as python-osc."""
    head = b"#bundle\0" + struct.pack(">Q", 1)
    bundles = [head]
    for message in messages:
        part = struct.pack(">i", len(message)) + message
        if len(bundles[-1]) + len(part) > MAX_DATAGRAM_BYTES:
            bundles.append(head)
        bundles[-1] += part
    return bundles


Place = tuple[Array, Array]  # position (3,) in metres and rotation (4,) w, x, y, z
ORIGIN: Place = np.zeros(3), rotations.identity()


def vmc_messages(pose: Pose, seconds: float, root: Place = ORIGIN) -> list[bytes]:
    """Return the messages of a pose after `seconds` of motion: each bone relative to its parent, the hips to `root`."""
    messages = [osc_message("/VMC/Ext/OK", 1), osc_message("/VMC/Ext/T", float(seconds))]
    places = [
        *zip(pose.positions.astype(np.float64), pose.world_rotations.astype(np.float64), strict=True),
        root,
    ]
    messages.append(osc_message("/VMC/Ext/Root/Pos", "root", *_unity(root, ORIGIN)))
    for joint, bone, above in zip(JOINTS, BONES, PARENTS, strict=True):
        messages.append(osc_message("/VMC/Ext/Bone/Pos", bone, *_unity(places[joint], places[above])))
    return messages


def _unity(place: Place, above: Place) -> list[float]:
    """Return a transform relative to its parent as x, y, z and a rotation x, y, z, w in Unity's axes."""
    back = rotations.inverse(above[1])
    x, y, z = rotations.rotate(back, place[0] - above[0]).tolist()
    w, i, j, k = rotations.multiply(back, place[1]).tolist()
    return [-x, y, z, i, -j, -k, w]


@dataclass
class VmcLink(LiveLink):
    """Sends poses by the VMC protocol; a pose counts as `sent` when all its bundles were."""

    name: str = "VMC"
    receivers: str = "Unity, Warudo, VSeeFace and other VMC receivers"
    address: Address = field(default_factory=lambda: Address(port=VMC_PORT))
    on_root: bool = False  # movement over the ground is sent as the root's, and the hips stay above it

    def publish(self, poses: Sequence[Pose], step_s: float = STEP_S, size: float = 1.0) -> None:
        """Send the poses of one frame, oldest first and `step_s` apart; nothing while the link is off.

        Receivers scale to their own avatars, so lengths stay those of our skeleton and `size` is ignored.
        """
        for pose in poses if self.on else ():
            root = (pose.root_position, rotations.from_yaw(pose.root_yaw)) if self.on_root else ORIGIN
            self._send_pose(osc_bundles(vmc_messages(pose, self._motion_s, root)), step_s)
