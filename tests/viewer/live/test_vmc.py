"""The VMC protocol over real UDP, decoded by python-osc's own parser and by Unity's axes written out again."""

import socket
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON
from tests.helpers.app_driver import Start, run
from tests.viewer.live.test_live_link import some_pose
from viewer.live.link import Address
from viewer.live.vmc import BONES, JOINTS, ORIGIN, VmcLink, osc_bundles, vmc_messages
from viewer.messages import Messages

osc_bundle = pytest.importorskip("pythonosc.osc_bundle", reason="python-osc is not installed")


def decoded(bundles: list[bytes]) -> list[tuple[str, list]]:
    return [(part.address, part.params) for data in bundles for part in osc_bundle.OscBundle(data)]


@pytest.mark.parametrize("yaw", [None, 0.7])
def test_a_receiver_in_unitys_axes_sees_every_bone_where_it_is(yaw: float | None) -> None:
    """Whether the way is the hips' or the root's."""
    pose = some_pose(3)
    root = ORIGIN if yaw is None else (np.array([0.4, 0.2, -3.0]), rotations.from_yaw(yaw))
    messages = decoded(osc_bundles(vmc_messages(pose, 1.5, root)))
    assert ("/VMC/Ext/OK", [1]) in messages
    assert ("/VMC/Ext/T", [1.5]) in messages
    placed = [params for address, params in messages if address == "/VMC/Ext/Bone/Pos"]
    bones = {params[0]: np.array(params[1:]) for params in placed}
    assert set(bones) == set(BONES)
    assert {"Hips", "LeftUpperLeg", "RightHand", "UpperChest", "LeftToes"} <= set(bones)
    (ground,) = (np.array(params[1:]) for address, params in messages if address == "/VMC/Ext/Root/Pos")
    base, heading = ground[:3] * (-1, 1, 1), Rotation.from_quat(ground[3:] * (1, -1, -1, 1))
    assert np.abs(base - root[0]).max() < 1e-5
    names = dict(zip(JOINTS, BONES, strict=True))
    for joint, bone in names.items():  # the hierarchy as a receiver walks it; a mirror makes it ours again
        point, turn, above = np.zeros(3), Rotation.identity(), joint
        while above >= 0:
            if above in names:
                values = bones[names[above]]
                here = Rotation.from_quat(values[3:] * (1, -1, -1, 1))
                point = values[:3] * (-1, 1, 1) + here.apply(point)
                turn = here * turn
            above = SPORT_SKELETON.parents[above]
        point, turn = base + heading.apply(point), heading * turn
        assert np.abs(point - pose.positions[joint]).max() < 1e-5, bone
        wanted = Rotation.from_quat(pose.world_rotations[joint][[1, 2, 3, 0]])
        assert (turn.inv() * wanted).magnitude() < 1e-5, bone


def test_a_second_at_60_hertz_arrives_whole() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60.0)
        link = VmcLink(Messages(), address=Address(*receiver.getsockname()))
        link.publish([some_pose()])
        assert link.sent == 0, "off until it is started"
        link.start()
        poses, times = [some_pose(k) for k in range(4)], []
        for k in range(60):
            link.publish([poses[k % 4]])
            time.sleep(0.002)
            for _ in osc_bundles(vmc_messages(poses[k % 4], 0.0)):
                data = receiver.recv(2000)
                assert len(data) <= 1400
                times += [params[0] for address, params in decoded([data]) if address == "/VMC/Ext/T"]
        link.stop()
    assert (link.sent, link.dropped) == (60, 0)
    assert np.allclose(np.diff(times), 1 / 60, atol=1e-5)


def test_the_viewer_sends_its_walker(start: Start) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60.0)
        app = start(vmc=f"127.0.0.1:{receiver.getsockname()[1]}")
        run(app, 4)
        assert not app.scene.live.on
        assert osc_bundle.OscBundle(receiver.recv(2000)).num_contents > 3
        assert app.scene.vmc.address.loopback
