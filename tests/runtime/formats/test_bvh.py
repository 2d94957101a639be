"""BVH text in and out, and the errors of damaged files."""

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import format_bvh, parse_bvh
from runtime.skeleton import SPORT_SKELETON, J

SMALL = """HIERARCHY
ROOT hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT knee joint
  {
    OFFSET 0 -10 0
    CHANNELS 6 Yposition Xposition Zposition Xrotation Yrotation Zrotation
    End Site
    {
      OFFSET 0 -5 1
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 2 3 90 0 0   -10 0 0  0 0 0
1 2 3 0 0 0    -12 4 5  0 0 90
"""


def test_channels_are_read_by_name_in_their_own_order():
    motion = parse_bvh(SMALL)
    assert motion.skeleton.names == ("hip", "knee_joint")
    assert motion.skeleton.parents == (-1, 0)
    assert motion.fps == pytest.approx(30.0, abs=1e-3)
    np.testing.assert_allclose(motion.positions[1], [[1, 2, 3], [4, -12, 5]])
    np.testing.assert_allclose(motion.end_offsets[1], [0, -5, 1])
    world, _ = motion.world()
    np.testing.assert_allclose(world[0, 1], [11, 2, 3], atol=1e-5)  # 90 degrees about Z turn -Y into +X


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
@pytest.mark.parametrize("units", [1.0, 100.0])
def test_written_motion_reads_back(order, units):
    rng = np.random.default_rng(1)
    hips = rng.normal(size=(7, 3)) * 5
    local = rotations.normalize(rng.normal(size=(7, J, 4)))
    text = format_bvh(SPORT_SKELETON, hips, local, 60.0, units_per_metre=units, order=order)
    back = parse_bvh(text)
    joints = [back.skeleton.index(name) for name in SPORT_SKELETON.names]
    expected, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    world, _ = back.world()
    np.testing.assert_allclose(world[:, joints] / units, expected, atol=1e-4)
    assert back.fps == pytest.approx(60.0, abs=1e-5)
    assert not any(" " in line.split(None, 1)[1] for line in text.splitlines() if "JOINT" in line)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("MOTION", "MUTATION", "HIERARCHY and MOTION"),
        ("Frames: 2", "Frames: 3", "MOTION values"),
        ("Frames: 2", "Frames: 0", "0 frames"),
        ("Frames: 2", "Frames: -5", "-5 frames"),
        ("Frame Time: 0.0333333", "Frame Time: 0", "0.0 s"),
        ("-12 4 5", "-12 nan 5", "not finite"),
        ("-12 4 5", "-12 x 5", "not a number"),
        ("OFFSET 0 -10 0", "OFFSET 0 -10", "line 8"),
        ("CHANNELS 6 Y", "CHANNELS 5 Y", "CHANNELS"),
        ("Yposition Xposition", "Yposition Uposition", "CHANNELS"),
        ("      OFFSET 0 -5 1\n    }\n", "      OFFSET 0 -5 1\n", "closed"),
    ],
)
def test_damage_is_named(old, new, expected):
    assert old in SMALL
    with pytest.raises(FileError, match=expected):
        parse_bvh(SMALL.replace(old, new, 1), "take.bvh")


@pytest.mark.parametrize("cut", range(0, len(SMALL) - 30, 23))
def test_a_truncated_file_is_an_error_not_a_crash(cut):
    with pytest.raises(FileError, match=r"take\.bvh"):
        parse_bvh(SMALL[:cut], "take.bvh")
