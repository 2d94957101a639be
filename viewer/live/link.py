"""Sends the shown poses to another program, without waiting for it."""

import math
import socket
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from ipaddress import ip_address

import numpy as np

from runtime.errors import SportError, UsageError
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON, Skeleton
from viewer.messages import Messages

MAGIC = b"SPRT"
VERSION = 1
SKELETON, POSE = 1, 2
_HEADER = struct.Struct("<4sBBHII")  # magic, version, kind, joints, sequence, skeleton
_ROOT = struct.Struct("<d3f")  # seconds, position of the root joint
_JOINT = struct.Struct("<h3fB")  # parent, offset, bytes of the name
_SEQUENCES = 1 << 32
ANNOUNCE_S = 1.0  # interval, after which a receiver that joins later knows the skeleton
STEP_S = 1.0 / 60.0  # between poses of the simulation
DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 9763
_FORM = "Write an IP address and a port, such as 127.0.0.1:9763."


@dataclass(frozen=True)
class Address:
    """An IP address and UDP port."""

    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT

    @property
    def loopback(self) -> bool:
        """Return whether the address is on this computer."""
        return ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_address(text: str, port_number: int = DEFAULT_PORT, flag: str = "--live-link") -> Address:
    """Parse "HOST:PORT", "HOST", "PORT", ":PORT" or ""; HOST is an IP address or localhost.

    `port_number` is the default, `flag` the argument's name for the UsageError.
    """
    text = text.strip()
    if text.isdigit():
        host, port = "", text
    elif text.startswith("["):
        host, _, rest = text[1:].partition("]")
        port = rest.removeprefix(":")
    else:
        host, _, port = text.partition(":")
    host = DEFAULT_HOST if host in ("", "localhost") else host
    try:
        address = Address(str(ip_address(host)), int(port) if port else port_number)
    except ValueError:
        raise UsageError(f"{flag} {text[:60]}: not an address.", _FORM) from None
    if not 1 <= address.port <= 65535:
        raise UsageError(f"{flag} {text[:60]}: expected a port of 1 to 65535.", _FORM)
    return address


def skeleton_joints(skeleton: Skeleton) -> bytes:
    """Return names, parents and offsets of all joints, in the format of a skeleton message's body."""
    found = []
    for name, parent, offset in zip(skeleton.names, skeleton.parents, skeleton.offsets, strict=True):
        text = name.encode("utf-8")
        found.append(_JOINT.pack(parent, *(float(v) for v in offset), len(text)) + text)
    return b"".join(found)


def skeleton_number(joints: bytes) -> int:
    """Return the id of a skeleton, which pose messages carry too."""
    return zlib.crc32(joints)


def skeleton_message(joints: bytes, count: int, sequence: int) -> bytes:
    """Return the message that announces a skeleton of `count` joints; `sequence` is the number of the next pose."""
    header = _HEADER.pack(MAGIC, VERSION, SKELETON, count, sequence % _SEQUENCES, skeleton_number(joints))
    return header + joints


def pose_message(pose: Pose, skeleton: int, sequence: int, seconds: float) -> bytes:
    """Return the message of a pose after `seconds` of motion: hips position in metres, local rotations w, x, y, z."""
    rotations = np.ascontiguousarray(pose.local_rotations, "<f4")
    header = _HEADER.pack(MAGIC, VERSION, POSE, len(rotations), sequence % _SEQUENCES, skeleton)
    return header + _ROOT.pack(seconds, *(float(v) for v in pose.hips_position)) + rotations.tobytes()


@dataclass
class LiveLink:
    """Sends poses from `start` to `stop`, without blocking: poses that the system does not accept at once are `dropped`."""

    messages: Messages
    clock: Callable[[], float] = time.perf_counter
    address: Address = field(default_factory=Address)
    sent: int = 0
    dropped: int = 0
    name: str = "Live link"
    receivers: str = "Blender or another program"
    _socket: socket.socket | None = None
    _joints: bytes = b""
    _size: float = 1.0
    _motion_s: float = 0.0  # of what was sent
    _announced_s: float = -math.inf

    @property
    def on(self) -> bool:
        return self._socket is not None

    def begin(self, typed: str | None) -> None:
        """Start sending to a typed address; None leaves the link off. Raises UsageError."""
        if typed is not None:
            self.start(parse_address(typed, self.address.port, f"--{self.name.lower().replace(' ', '-')}"))

    def start(self, address: Address | None = None) -> None:
        """Start sending; UsageError if the address is unreachable."""
        self.stop()
        self.address = address or self.address
        family = socket.AF_INET6 if ":" in self.address.host else socket.AF_INET
        try:
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise UsageError(f"{self.name}: {error.strerror or error}.", "Use 127.0.0.1.") from error
        self._socket.setblocking(False)  # a full buffer must not delay a frame
        self._joints, self._size = skeleton_joints(SPORT_SKELETON), 1.0
        self.sent = self.dropped = 0
        self._motion_s, self._announced_s = 0.0, -math.inf
        if self.address.loopback:
            self.messages.note(f"{self.name}: poses go to {self.address}.")
        else:
            self.messages.warn(f"{self.name}: poses leave this computer, to {self.address}.")

    def stop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def switch(self) -> None:
        if not self.on:
            try:
                self.start()
            except SportError as error:
                self.messages.error(error)
            return
        self.stop()
        self.messages.note(f"{self.name} is off; {self.sent} poses were sent.")

    def publish(self, poses: Sequence[Pose], step_s: float = STEP_S, size: float = 1.0) -> None:
        """Send the poses of one frame, oldest first and `step_s` apart; nothing while the link is off.

        `size` scales the poses' lengths to metres, see `Terrain.seen_by`.
        """
        if self._socket is None:
            return
        if size != self._size:
            larger = replace(SPORT_SKELETON, offsets=SPORT_SKELETON.offsets * np.float32(size))
            self._joints, self._size = skeleton_joints(larger), size
            self._announced_s = -math.inf
        now, number = self.clock(), skeleton_number(self._joints)
        if now - self._announced_s >= ANNOUNCE_S:
            message = skeleton_message(self._joints, len(SPORT_SKELETON), self.sent + self.dropped)
            self._announced_s = now if self._send(message) else self._announced_s
        for pose in poses:
            pose = replace(pose, hips_position=pose.hips_position * np.float32(size))
            self._send_pose([pose_message(pose, number, self.sent + self.dropped, self._motion_s)], step_s)

    def _send_pose(self, messages: Sequence[bytes], step_s: float) -> None:
        """Send a pose; it counts as sent if all its messages were."""
        went = all([self._send(message) for message in messages])
        self._motion_s += step_s
        self.sent, self.dropped = self.sent + went, self.dropped + (not went)

    def _send(self, data: bytes) -> bool:
        """Send a message; return whether the system accepted it. Any failure but a full buffer ends the link, with a message."""
        if self._socket is None:
            return False
        try:
            self._socket.sendto(data, (self.address.host, self.address.port))
        except (BlockingIOError, ConnectionError):  # no room, or no program listens there
            return False
        except OSError as error:
            self.stop()
            self.messages.error(f"{self.name} to {self.address} ended: {error.strerror or error}.")
            return False
        return True
