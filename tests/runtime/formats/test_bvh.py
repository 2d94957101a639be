"""BVH text in and out, and the errors of damaged files."""

from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import format_bvh, parse_bvh
from runtime.skeleton import SPORT_SKELETON, J

SMALL = Path(__file__).with_name("small.bvh").read_text()


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
    text = format_bvh(SPORT_SKELETON, {0: hips}, local, 60.0, units_per_metre=units, order=order)
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
        ("Frame Time: 0.0333333", "Frame Time: 0", "0.0 s"),
        ("Frame Time: 0.0333333", "Frame Time: soon", "line 16: after MOTION expected a line 'Frames: 120'"),
        ("Frames: 2", "Frames", "line 16: after MOTION expected a line 'Frames: 120'"),
        ("-12 4 5", "-12 nan 5", "line 20: .nan. in MOTION"),
        ("-12 4 5", "-12 1.5-2.5 5", "line 20: .1.5-2.5. in MOTION"),
        ("1 2 3 90", "1 2 390", "line 19: 11 values; expected 12"),
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


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n{", " {"),
        ("\n  {", "{"),
        ("End Site\n    {", "End Site {"),
        ("\n      OFFSET 0 -5 1\n    }", "\n      OFFSET 0 -5 1 }"),
        ("0.0333333", "0,0333333"),
        ("1 2 3 90", "1,0 2,0 3 90"),
        ("5 1\n    }\n  }\n}\n", "5 1}}}\n"),
        ("HIERARCHY\nROOT hip\n{\n  OFFSET 0 0 0\n", "HIERARCHY ROOT hip { OFFSET 0 0 0 "),
        ("}\nMOTION", "} MOTION"),
        ("MOTION\nFrames: 2\nFrame Time", "Motion\nframes : 2\n\nFRAMETIME"),
        ("ROOT", "root"),
        ("End Site", "END SITE"),
        ("HIERARCHY", "Hierarchy"),
        ("\n", "\r"),
        ("\n", "\r\n"),
    ],
)
def test_other_ways_to_write_a_file_are_the_same_motion(old: str, new: str) -> None:
    assert old in SMALL
    motion, same = parse_bvh(SMALL.replace(old, new)), parse_bvh(SMALL)
    assert motion.skeleton.names == same.skeleton.names
    assert motion.frame_seconds == same.frame_seconds
    np.testing.assert_array_equal(motion.positions, same.positions)
    np.testing.assert_array_equal(motion.end_offsets[1], same.end_offsets[1])


@pytest.mark.parametrize(
    ("text", "fps"),
    [("1/30", 30), ("1 / 30", 30), ("1.0/30.0", 30), ("1,0/29,97", 29.97), ("1001/30000", 30000 / 1001)],
)
def test_the_time_of_a_frame_may_be_a_fraction(text: str, fps: float) -> None:
    motion = parse_bvh(SMALL.replace("0.0333333", text))
    assert motion.fps == pytest.approx(fps)
    assert len(motion.positions) == 2


def test_a_joint_may_be_called_motion() -> None:
    assert parse_bvh(SMALL.replace("knee", "MOTION_knee")).skeleton.names == ("hip", "MOTION_knee_joint")


@pytest.mark.parametrize("frames", ["0", "2"])
def test_a_file_without_frames_says_so(frames: str) -> None:
    head = SMALL[: SMALL.index("\n1 2 3 90")].replace("Frames: 2", f"Frames: {frames}")
    with pytest.raises(FileError, match=r"take\.bvh: it has no frames"):
        parse_bvh(head, "take.bvh")


@pytest.mark.parametrize("cut", range(0, len(SMALL) - 30, 23))
def test_a_truncated_file_is_an_error_not_a_crash(cut):
    if cut < SMALL.index("\n1 2 3 0"):
        with pytest.raises(FileError, match=r"take\.bvh"):
            parse_bvh(SMALL[:cut], "take.bvh")
    else:  # a whole frame is there, and what is missing is said
        assert "2 frames and has 1" in parse_bvh(SMALL[:cut], "take.bvh").note


@pytest.mark.parametrize("said", [-5, 0, 1, 3, 10**12])
def test_a_wrong_number_of_frames_is_noted(said):
    motion = parse_bvh(SMALL.replace("Frames: 2", f"Frames: {said}", 1), "take.bvh")
    np.testing.assert_array_equal(motion.positions, parse_bvh(SMALL).positions)
    assert motion.note == f"take.bvh: the file says {said} frames and has 2."


def test_a_truncated_last_row_is_left_out_with_a_note():
    motion = parse_bvh(SMALL.rstrip().rsplit(" ", 2)[0], "take.bvh")
    assert len(motion.positions) == 1
    assert motion.note == "take.bvh: the file says 2 frames and has 1 and a partial one, which is ignored."
