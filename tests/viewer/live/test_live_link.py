"""The live link: messages, the sender in the real application, and the add-on's receiver over real UDP."""

import itertools
import time
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain
from sport import cli
from tests.helpers.app_driver import Start, do, run
from tests.helpers.blender_addon import load_addon
from viewer.live.link import (
    Address,
    LiveLink,
    parse_address,
    pose_message,
    skeleton_joints,
    skeleton_message,
    skeleton_number,
)
from viewer.messages import Messages
from viewer.scene.simulation import make_pose, rest_pose

JOINTS = skeleton_joints(SPORT_SKELETON)
NUMBER = skeleton_number(JOINTS)


def some_pose(seed: int = 0) -> Pose:
    random = np.random.default_rng(seed)
    local = random.normal(size=(J, 4))
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return make_pose(random.normal(size=3), local, np.ones(4), 0.0, 0.0)


@pytest.fixture(scope="module")
def addon() -> ModuleType:
    return load_addon()


@pytest.fixture
def receiver(addon: ModuleType) -> Iterator[Any]:
    found = addon.Receiver("127.0.0.1", 0)
    yield found
    found.close()


@pytest.fixture
def link(receiver: Any) -> Iterator[LiveLink]:
    """A sender to that receiver."""
    found = LiveLink(Messages(), address=Address(*receiver.address))
    found.start()
    yield found
    found.stop()


def drain(receiver: Any, count: int) -> list:
    """Poses, as soon as so many datagrams of any kind have come."""
    poses, end = [], time.monotonic() + 60.0
    while receiver.received + receiver.refused < count and time.monotonic() < end:
        poses += receiver.drain()
    return poses


def test_a_pose_comes_back_as_it_was_sent(addon: ModuleType) -> None:
    pose = some_pose()
    found = addon.decode(pose_message(pose, NUMBER, 2**32 + 7, 1.25))
    assert (found.sequence, found.skeleton, found.seconds) == (7, NUMBER, 1.25)
    assert np.array_equal(np.float32(found.position), pose.hips_position)
    assert np.array_equal(np.float32(found.rotations), pose.local_rotations)


def test_the_skeleton_is_announced_with_names_and_hierarchy(addon: ModuleType) -> None:
    found = addon.decode(skeleton_message(JOINTS, J, 0))
    assert found.names == SPORT_SKELETON.names
    assert found.parents == SPORT_SKELETON.parents
    assert np.array_equal(np.float32(found.offsets), SPORT_SKELETON.offsets)
    assert found.number == NUMBER


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: b"JUNK" + data[4:], "not a message"),
        (lambda data: data[:4] + b"\2" + data[5:], "version 2"),
        (lambda data: data[:5] + b"\7" + data[6:], "unknown kind"),
        (lambda data: data[:-1], "damaged"),
        (lambda data: data + b"\0", "damaged"),
        (lambda data: data[:-4] + np.float32(np.nan).tobytes(), "damaged"),
        (lambda data: data[:10], "not a message"),
        (lambda data: b"", "not a message"),
    ],
)
def test_what_is_no_message_is_refused(addon: ModuleType, change: Any, said: str) -> None:
    with pytest.raises(addon.MessageError, match=said):
        addon.decode(change(pose_message(some_pose(), NUMBER, 0, 0.0)))


def test_damaged_skeletons_are_refused(addon: ModuleType) -> None:
    whole = skeleton_message(JOINTS, J, 0)
    random = np.random.default_rng(1)
    for _ in range(300):
        data = bytearray(whole[: random.integers(len(whole))])
        for at in random.integers(len(data), size=3) if data else ():
            data[at] = random.integers(256)
        with pytest.raises(addon.MessageError):
            addon.decode(bytes(data))


def test_poses_arrive_over_udp_in_order_and_losses_are_counted(link: LiveLink, receiver: Any) -> None:
    poses = [some_pose(seed) for seed in range(60)]
    for pose in poses:
        link.publish([pose])
    found = drain(receiver, 60)
    assert link.sent == len(found) == receiver.received == 60
    assert receiver.lost == 0
    assert np.array_equal(np.float32([f.position for f in found]), [p.hips_position for p in poses])
    link.sent += 20  # as if twenty had been lost
    link.publish(poses[:20])
    drain(receiver, 80)
    assert (receiver.lost, receiver.lost_share) == (20, 0.2)
    link.start()  # a sender that was switched on again counts from 0, and nothing is lost
    link.publish(poses[:1])
    drain(receiver, 81)
    assert receiver.lost == 20


def test_a_flood_does_not_hold_a_receiver_up(addon: ModuleType, receiver: Any) -> None:
    class Endless:
        """Has a datagram whenever one is asked for."""

        def __init__(self, data: bytes) -> None:
            self.data, self.taken = data, 0

        def recvfrom(self, _: int) -> tuple[bytes, str]:
            self.taken += 1
            return self.data, "somebody"

        def close(self) -> None:
            pass

    receiver.close()
    for data in (b"no message", skeleton_message(JOINTS, J, 0), pose_message(some_pose(), NUMBER, 0, 0.0)):
        receiver.socket = Endless(data)
        assert len(receiver.drain()) <= addon.MAX_DATAGRAMS
        assert receiver.socket.taken == addon.MAX_DATAGRAMS


def test_a_receiver_that_comes_later_learns_the_skeleton_within_a_second(receiver: Any) -> None:
    ticks = itertools.count(0.0, 1.0 / 60.0)
    link = LiveLink(Messages(), lambda: next(ticks), Address(*receiver.address))
    link.start()
    link.publish([some_pose()])
    drain(receiver, 1)
    receiver.skeleton = None  # it was not there for the first announcement
    for _ in range(61):
        link.publish([some_pose()])
    poses = drain(receiver, 62)
    assert receiver.skeleton.names == SPORT_SKELETON.names
    assert 1 <= len(poses) <= 3, "those before the announcement cannot be shown"
    link.stop()


def test_time_is_that_of_the_motion_however_late_the_frames_are(link: LiveLink, receiver: Any) -> None:
    link.publish([some_pose(k) for k in range(3)])
    link.publish([some_pose(3)], 0.25)  # of a take that plays at the rate of the display
    link.publish([some_pose(4)])
    assert [round(p.seconds, 4) for p in drain(receiver, 5)] == [0.0, 0.0167, 0.0333, 0.05, 0.3]


def test_a_network_that_fails_ends_the_link_with_a_message() -> None:
    log = Messages()
    link = LiveLink(log, address=Address("255.255.255.255", 9))  # a broadcast that was not allowed
    link.start()
    assert log.recent[-1].text == "Live link: poses leave this computer, to 255.255.255.255:9."
    link.publish([some_pose()])
    assert not link.on
    assert "Live link to 255.255.255.255:9 ended" in log.recent[-1].text


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", "127.0.0.1:9763"),
        ("localhost", "127.0.0.1:9763"),
        ("9000", "127.0.0.1:9000"),
        (":9000", "127.0.0.1:9000"),
        ("192.168.0.7", "192.168.0.7:9763"),
        ("[::1]:9000", "[::1]:9000"),
    ],
)
def test_addresses(text: str, wanted: str) -> None:
    assert str(parse_address(text)) == wanted
    assert parse_address(text).loopback == (not text.startswith("192"))


@pytest.mark.parametrize("text", ["example.org", "127.0.0.1:x", "1.2.3.4:0", "1.2.3.4:70000", "[::1", "-1"])
def test_what_is_no_address_is_said(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    if text != "[::1":  # which is forgiven
        with pytest.raises(UsageError, match="--live-link"):
            parse_address(text)
        assert cli.main(["view", "--offscreen", f"--live-link={text}"]) == 2
        assert "--live-link" in capsys.readouterr().err


def test_the_viewer_sends_every_step_and_the_pose_of_playback(start: Start, receiver: Any) -> None:
    app = start(live_link=f"127.0.0.1:{receiver.address[1]}")
    run(app, 30)
    found = drain(receiver, 30)
    assert len(found) == 30
    assert np.allclose(found[-1].position, app.scene.simulation.current.hips_position)
    do(app, "stand 20; play 1")
    drain(receiver, 50)
    run(app, 10)
    shown = drain(receiver, 60)
    assert np.allclose(shown[-1].position, app.takes.playback.pose().hips_position)
    assert receiver.lost == 0


def test_what_the_file_prints_without_blender(addon: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert addon.main(["127.0.0.1:0", "0.01"]) == 0
    assert capsys.readouterr().out == "0 poses, 0 lost; nothing\n"
    assert addon.parse_address("[::1]:9000") == ("::1", 9000)
    assert addon.parse_address("9000") == ("127.0.0.1", 9000)
    assert addon.parse_address("10.0.0.2") == ("10.0.0.2", 9763)


def test_standing_is_sent_too_on_a_ground_of_its_own_height(link: LiveLink, receiver: Any) -> None:
    """The position is that of the hips in the world, metres, Y up."""
    link.publish([rest_pose(Terrain.flat(), 2.0, -3.0)])
    (pose,) = drain(receiver, 1)
    assert pose.position[::2] == (2.0, -3.0)
    assert 0.9 < pose.position[1] < 1.1
