"""What a written take must be for readers that are not ours: steady angles, the take's own rate, unit and heading."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from runtime import rotations
from runtime.errors import UsageError
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.formats.table import format_of, save_motion
from runtime.pose import video_rate
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from sport import cli
from tests.helpers.walker import walk
from tests.runtime.formats.test_reference import foreign
from viewer.filming.film import draw_caption
from viewer.filming.shots import SHOTS, FilmOptions, camera_path
from viewer.filming.writers import open_writer

FLAT = Terrain.flat()


def turning(degrees_a_second: float = 90.0, frames: int = 300) -> Clip:
    """A walk whose heading goes once round and on, with a body that sways."""
    hips, local, contacts = walk(frames)
    seconds = np.arange(frames) / 60.0
    sway = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), 0.2 * np.sin(7.0 * seconds))
    heading = rotations.from_yaw(np.deg2rad(degrees_a_second) * seconds)
    local = local.copy()
    local[:, 0] = rotations.multiply(heading, rotations.multiply(sway, local[:, 0]))
    return Clip("turn", 60.0, hips, local, contacts)


def channels(path: Path, joint: str) -> tuple[str, np.ndarray]:
    """Order and angles `(T, 3)` of a joint, by the text alone."""
    head, _, motion = path.read_text().partition("MOTION")
    column = 0
    for line in head.splitlines():
        words = line.split()
        if words[:1] in (["ROOT"], ["JOINT"]):
            name = words[1]
        elif words[:1] == ["CHANNELS"]:
            at = [k for k, word in enumerate(words[2:]) if word.endswith("rotation")]
            if name == joint:
                rows = np.array([row.split() for row in motion.strip().splitlines()[2:]], float)
                return "".join(words[2 + k][0] for k in at), rows[:, [column + k for k in at]]
            column += int(words[1])
    raise AssertionError(joint)


@pytest.mark.parametrize("rooted", [False, True])
def test_a_reader_that_interpolates_angles_turns_as_the_body_does(tmp_path: Path, rooted: bool) -> None:
    path = tmp_path / "turn.bvh"
    save_motion(turning(), path, ExportOptions(ground_root=rooted), FLAT)
    for joint in ("Root", "Hips") if rooted else ("Hips",):
        order, angles = channels(path, joint)
        turned = Rotation.from_euler(order.upper(), angles, degrees=True)
        between = Rotation.from_euler(order.upper(), (angles[:-1] + angles[1:]) / 2, degrees=True)
        middle = turned[:-1] * Rotation.from_rotvec((turned[:-1].inv() * turned[1:]).as_rotvec() / 2)
        assert np.rad2deg((between.inv() * middle).magnitude()).max() < 0.1, joint
        assert np.abs(np.diff(angles, axis=0)).max() < 8.0, "no jump from frame to frame"
    assert np.allclose(load_clip_bvh(path).world()[0], turning().world()[0], atol=1e-4)


@pytest.mark.parametrize("order", ["XYZ", "ZYX"])
def test_an_order_that_is_chosen_holds_for_all_joints(tmp_path: Path, order: str) -> None:
    path = tmp_path / "turn.bvh"
    save_motion(turning(), path, ExportOptions(euler_order=order), FLAT)
    for joint in ("Hips", "LeftArm"):
        assert channels(path, joint)[0] == order
    assert np.allclose(load_clip_bvh(path).world()[0], turning().world()[0], atol=1e-4)


def test_an_arm_that_passes_the_pole_goes_on_without_a_jump(tmp_path: Path) -> None:
    clip = turning(0.0, 200)
    local = clip.local_rotations.copy()
    turns = Rotation.from_rotvec(np.linspace(0.0, 3.05, 200)[:, None] * (0.0, 1.0, 0.0))
    local[:, 20] = turns.as_quat()[:, [3, 0, 1, 2]]
    path = save_bvh(Clip("arm", 60.0, clip.hips_positions, local, clip.contacts), tmp_path / "arm.bvh")
    _, angles = channels(path, SPORT_SKELETON.names[20])
    assert np.abs(np.diff(angles, axis=0)).max() < 2.0


def test_convert_keeps_rate_and_unit(tmp_path: Path) -> None:
    source = save_bvh(turning(), tmp_path / "a.bvh", 30.0, "m")
    assert cli.main(["convert", str(source), str(tmp_path / "b.bvh")]) == 0
    for text in (source.read_text(), (tmp_path / "b.bvh").read_text()):
        assert "Frame Time: 0.0333333333" in text
        assert float(text.split("JOINT Spine")[1].split("OFFSET")[1].split()[1]) < 1.0
    assert cli.main(["convert", str(source), str(tmp_path / "c.bvh"), "--fps", "60", "--unit", "cm"]) == 0
    assert "Frame Time: 0.0166666667" in (tmp_path / "c.bvh").read_text()


def test_a_rate_of_video_is_exact(tmp_path: Path) -> None:
    rates = [video_rate(v) for v in (29.97, 1 / 0.0083333, 23.976, 15.0)]
    assert rates == [30000 / 1001, 120.0, 24000 / 1001, 15.0]
    path = save_bvh(turning(), tmp_path / "a.bvh", video_rate(29.97))
    assert "Frame Time: 0.0333666667" in path.read_text()
    assert load_clip_bvh(path).fps == 30000 / 1001


def test_a_resampled_motion_lies_on_the_curve_and_not_on_its_chords() -> None:
    """A hand on a circle: straight lines between 60 frames a second cut it by up to 14 mm."""

    def at(seconds: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(20.0 * seconds), 1.0 + np.cos(20.0 * seconds), seconds], 1)

    local, contacts = rotations.identity((61, 31)).astype(np.float32), np.zeros((61, 4), np.float32)
    clip = Clip("circle", 60.0, at(np.arange(61) / 60.0).astype(np.float32), local, contacts)
    for fps in (24.0, 50.0, 120.0):
        other = clip.resampled(fps)
        gap = np.linalg.norm(other.hips_positions - at(np.arange(len(other)) / fps), axis=1)
        assert gap.max() < 2.5e-3, fps


def test_a_loop_in_place_stands_at_the_origin() -> None:
    clip = Clip("walk", 60.0, *walk(400))
    take = prepare(clip, ExportOptions(loop=True, in_place=True, start_s=3.0), FLAT)
    assert np.abs(take.root.positions).max() < 1e-6
    assert np.abs(take.clip.hips_positions[:, [0, 2]]).max() < 0.1


@pytest.mark.parametrize("yaw", [0.0, 95.0, 179.0])
def test_a_motion_of_another_skeleton_keeps_its_way_in_the_world(tmp_path: Path, yaw: float) -> None:
    turn = rotations.from_yaw(np.deg2rad(yaw))
    clip = open_take(foreign(tmp_path / "other.bvh", turn)).reference.clip
    way = clip.hips_positions[-1] - clip.hips_positions[1]
    wanted = rotations.rotate(turn, np.array([0.0, 0.0, 1.0]))
    assert np.dot(way / np.linalg.norm(way), wanted) > 0.995


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_an_animation_lasts_as_long_as_its_frames(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    with open_writer(path, (16, 16), 30.0) as write:
        for k in range(30):
            write(np.full((16, 16, 3), 8 * k, np.uint8))
    milliseconds = 0
    with Image.open(path) as image:
        for k in range(image.n_frames):
            image.seek(k)
            image.load()
            milliseconds += image.info["duration"]
    assert milliseconds == 1000


@pytest.mark.parametrize("name", SHOTS)
@pytest.mark.parametrize("height", [0.0, 2.4, 3.0])
def test_a_caption_covers_no_foot(name: str, height: float) -> None:
    clip = Clip("walk", 60.0, *walk(200))
    see = camera_path(FilmOptions(fps=60.0, camera=name), clip, FLAT, height)
    edge = 1.0 - 2.0 * draw_caption((1280, 720), "“walk”")[1] / 720
    for k in range(len(clip)):
        camera = see(clip.pose(k))
        toes = clip.pose(k).positions[[4, 5, 9, 10]] * (1.0, 0.0, 1.0)
        matrix = camera.projection_matrix(16 / 9) @ camera.view_matrix()
        seen = np.column_stack([toes, np.ones(4)]) @ matrix.T
        assert (seen[:, 1] / seen[:, 3]).min() > edge, k


def test_a_name_longer_than_a_disk_can_hold_is_one_sentence() -> None:
    with pytest.raises(UsageError, match="a name without an ending"):
        format_of(Path("x" * 100_000))
