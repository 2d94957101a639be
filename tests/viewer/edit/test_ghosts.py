"""What is drawn around a take, and its mirror image."""

import numpy as np
import pytest

from runtime.session.motion import Motion
from runtime.session.session import Take
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.takes.mirror import mirrored, other_side
from runtime.terrain.height_map import Terrain
from tests.helpers.app_driver import do
from tests.helpers.walker import walk
from tests.viewer.edit.test_timeline import record, seek
from viewer.app import App
from viewer.edit.view_overlays import JOINTS, Trails, ghosts, speeds
from viewer.render.marks import trail_strokes
from viewer.session.playback import Playback

CLIP = Clip("walk", 60.0, *walk(90), prompts=(PromptEvent(0.0, "left arm in a sling, turns right"),))


def paused(trim: tuple[int, int] | None = None) -> Playback:
    take = Take(1, Motion.of(CLIP), trim=trim)
    return Playback(take, CLIP, Terrain.flat(), Terrain.flat(), playing=False)


def test_ghosts_stand_at_frames_of_the_take_within_its_trim() -> None:
    playback = paused(trim=(10, 70))
    playback.seek(31)
    apart = [np.abs(CLIP.hips_positions - g.hips_position).sum(1) for g in ghosts(playback, 10)]
    found = [int(np.argmin(distances)) for distances in apart]
    assert found == [10, 20, 40, 50, 60]  # 30 is too near to the pose shown, 0 is trimmed off


def test_trails_go_through_the_joints_and_know_their_speeds() -> None:
    playback = paused()
    playback.seek(45)
    trails = Trails().around(playback)
    positions = playback.pose().positions[list(JOINTS)]
    assert trails.points[trails.now] == pytest.approx(positions, abs=1e-4)
    assert len(trail_strokes(trails, 1.0)) == (len(trails.points) - 1) * len(JOINTS)
    straight = np.arange(30)[:, None, None] * np.array([0.0, 0.0, 2.0 / 60.0])
    assert speeds(straight, 60.0) == pytest.approx(2.0)


def test_a_mirror_image_twice_is_the_take() -> None:
    once = mirrored(CLIP)
    twice = mirrored(once)
    assert twice.hips_positions == pytest.approx(CLIP.hips_positions, abs=1e-4)
    there, here = twice.world()[0], CLIP.world()[0]
    assert there == pytest.approx(here, abs=1e-3)
    assert np.array_equal(once.contacts[:, :2], CLIP.contacts[:, 2:])
    assert once.prompts[0].prompt == "right arm in a sling, turns left"
    heights = once.world()[0][..., 1].min(1)
    assert heights == pytest.approx(here[..., 1].min(1), abs=1e-4)  # as near to the ground
    assert other_side("left_arm: upright, bright, Left") == "right_arm: upright, bright, Right"


def test_ghosts_trails_and_mirror_in_the_window(app: App) -> None:
    record(app, 30)
    do(app, "click Ghosts; click Trails")
    seek(app, 30)
    overlays = app.scene.renderer.overlays
    assert len(overlays.frames) == 5  # of the 60 frames
    assert overlays.trails is not None
    do(app, "mirror 1; run 2")
    assert len(app.editor.session.takes) == 2
    do(app, "close; run 2; click Ghosts; click Trails")
    assert app.scene.renderer.overlays.frames == []
    assert app.scene.renderer.overlays.trails is None
