"""Takes that are resimulated: the same frames before an edit and without one, others after it, and the way back."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel
from runtime.motion.snapshot import take_snapshot
from runtime.motion.style import StyleMix
from runtime.takes import input_edits, input_recording
from runtime.takes.clip import Clip
from runtime.takes.input_recording import (
    InputFrame,
    InputFrames,
    InputRecorder,
    InputRecording,
    Keyframe,
    StyleChange,
    resimulate,
    resimulated_take,
)
from runtime.takes.metadata import PromptEvent, gait_of
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from tests.helpers.walker import WalkerModel

Take = tuple[Clip, InputRecording]
STYLES = np.random.default_rng(0).normal(size=(4, 6, 64)).astype(np.float32) * 0.4


class Studio:
    """Drives a controller as the viewer does: changes, keyframes, then one to three steps with the same stick."""

    def __init__(self, controller: Controller) -> None:
        self.controller, self.clips, self.inputs = controller, ClipRecorder(), InputRecorder()
        self.ground("hills")

    def ground(self, name: str) -> None:
        terrain = make_terrain(name)
        self.controller.set_terrain(terrain)
        self.inputs.mark_ground(name, terrain)

    def style(self, k: int, seconds: float = 0.5) -> None:
        z = StyleMix((0.4, 0.6), (STYLES[0], STYLES[1])) if k == 1 else STYLES[k]
        self.controller.set_style(z, seconds)
        self.inputs.mark_style(StyleChange(0, z, seconds, PromptEvent(0.0, f"style {k}", seconds)))
        self.clips.mark_prompt(f"style {k}", seconds)

    def restart(self) -> None:
        self.controller.reset(0.0, 0.0, 0.0)
        self.controller.step(Controls())
        self.inputs.mark_restart(0.0, 0.0, 0.0)

    def walk(self, frames: int) -> None:
        done = 0
        while done < frames:
            at = self.inputs.next_frame
            gait = Gait.JUMP if 80 <= at < 83 else Gait.JOG if at % 100 > 60 else Gait.WALK
            controls = Controls((float(np.sin(at / 40)), float(np.cos(at / 40))), None, gait)
            self.inputs.before_steps(self.controller)
            for _ in range(min(1 + at % 3, frames - done)):
                self.clips.add(self.controller.step(controls), gait_of(controls))
                self.inputs.add(controls, self.controller)
                done += 1

    def take(self, frames: int) -> Take:
        clip = self.clips.last(frames / 60)
        inputs = self.inputs.cut(self.clips.next_frame - len(clip))
        assert inputs is not None
        return clip, inputs


KEYFRAME_STEPS = 180


@pytest.fixture(scope="module", autouse=True)
def near_keyframes() -> Iterator[None]:
    """Keyframes lie three seconds apart."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(input_recording, "KEYFRAME_STEPS", KEYFRAME_STEPS)
        yield


@pytest.fixture(scope="module")
def studio(model: MotionModel) -> Studio:
    studio = Studio(Controller(model, make_terrain("flat"), seed=3))
    studio.style(0, 0.0)
    studio.walk(60)
    studio.style(1)
    studio.walk(10)
    studio.controller.strength = 0.8  # in the middle of the blend
    studio.walk(60)
    studio.restart()
    studio.style(2, 0.1)
    studio.walk(4)
    studio.style(3, 0.1)
    studio.walk(KEYFRAME_STEPS - 110)  # the next keyframe lies 24 frames before the end
    return studio


@pytest.fixture(scope="module")
def take(studio: Studio) -> Take:
    return studio.take(studio.clips.next_frame - 20)  # begins 20 frames after the keyframe


def same(a: Clip, b: Clip, first: int = 0, last: int | None = None) -> bool:
    keep = slice(first, last)
    arrays = ("hips_positions", "local_rotations", "contacts")
    return all(np.array_equal(getattr(a, name)[keep], getattr(b, name)[keep]) for name in arrays)


def style(frame: int, k: int = 2, seconds: float = 0.4) -> StyleChange:
    return StyleChange(frame, STYLES[k], seconds, PromptEvent(0.0, f"new {k}", seconds))


def test_without_an_edit_the_frames_are_the_same(take: Take, studio: Studio) -> None:
    clip, inputs = take
    assert len(inputs) == len(clip)
    assert inputs.start == -20
    again, made = resimulated_take(clip, inputs, studio.controller.twin(), 0)
    assert same(again, clip)
    assert again.prompts == clip.prompts
    assert np.array_equal(again.gaits, clip.gaits)
    middle = [k.frame for k in made.keyframes]
    poses, _ = resimulate(made, studio.controller.twin(), middle[-1] + 3, middle[-1] + 6)  # from a keyframe
    assert len(poses) == 4
    assert np.array_equal(poses[0].hips_position, clip.hips_positions[middle[-1] + 3])


def test_a_new_prompt_changes_nothing_before_its_frame_and_undo_is_the_old_take(
    take: Take, studio: Studio
) -> None:
    clip, inputs = take
    edit = input_edits.with_prompt(inputs, style(150))
    assert edit.first == 150
    new, made = resimulated_take(clip, edit.inputs, studio.controller.twin(), edit.first)
    assert same(new, clip, 0, 150)
    assert not same(new, clip, 152)
    assert [e.prompt for e in new.prompts] == ["style 0", "style 1", "style 3", "new 2"]
    assert len(new) == len(clip)
    span = input_edits.prompt_spans(made)[-1]
    back = input_edits.reworded(made, span, replace(style(0), z=span.changes[0].z))
    again, _ = resimulated_take(new, back.inputs, studio.controller.twin(), back.first)
    assert same(again, new)  # the same words again are the same frames again
    gone, _ = resimulated_take(new, inputs, studio.controller.twin(), 150)
    assert same(gone, clip)


def test_other_words_for_the_first_prompt_hold_from_the_first_frame(take: Take, studio: Studio) -> None:
    clip, inputs = take
    edit = input_edits.reworded(inputs, input_edits.prompt_spans(inputs)[0], style(0))
    new, made = resimulated_take(clip, edit.inputs, studio.controller.twin(), edit.first)
    assert not same(new, clip, 0, 40)
    assert new.prompts[0].prompt == "new 2"
    assert input_edits.prompt_spans(made)[0].start == 0
    again, _ = resimulated_take(new, made, studio.controller.twin(), 0)
    assert same(again, new)


def test_a_take_that_begins_with_a_keyframe_can_be_reworded_at_its_start(model: MotionModel) -> None:
    studio = Studio(Controller(model, make_terrain("flat")))
    studio.style(0)
    studio.walk(12)
    clip, inputs = studio.take(12)
    assert inputs.start == 0
    edit = input_edits.reworded(inputs, input_edits.prompt_spans(inputs)[0], style(0))
    new, made = resimulated_take(clip, edit.inputs, studio.controller.twin(), edit.first)
    assert not same(new, clip)
    later = input_edits.with_prompt(made, style(8, 3))
    assert same(resimulated_take(new, later.inputs, studio.controller.twin(), 8)[0], new, 0, 8)


def test_a_moved_prompt_and_a_new_gait(take: Take, studio: Studio) -> None:
    clip, inputs = take
    spans = input_edits.prompt_spans(inputs)
    assert [(s.start, len(s.changes)) for s in spans] == [(0, 1), (40, 1), (110, 2)]  # a slider is one span
    edit = input_edits.prompts_laid(inputs, [1], [replace(spans[1], start=30)])
    assert (edit.first, input_edits.prompt_spans(edit.inputs)[1].start) == (30, 30)
    edit = input_edits.with_gait(edit.inputs, 130, 160, Gait.CROUCH)
    new, _ = resimulated_take(clip, edit.inputs, studio.controller.twin(), 30)
    assert same(new, clip, 0, 30)
    assert set(new.gaits[130:161]) == {Gait.CROUCH}  # type: ignore[index]
    assert dict(new.gait_seconds)["crouch"] == pytest.approx(31 / 60)


def test_a_gait_where_the_stick_rests_goes_on_as_it_pointed(take: Take) -> None:
    _, inputs = take
    rest = input_edits.with_gait(inputs, 100, 140, Gait.STAND).inputs
    assert rest.frame(120).controls.move == (0.0, 0.0)
    walk = input_edits.with_gait(rest, 120, 130, Gait.JOG).inputs.frame(120).controls
    assert np.hypot(*walk.move) == pytest.approx(1.0)
    assert np.dot(walk.move, inputs.frame(99).controls.move) > 0.99
    with pytest.raises(UsageError, match=r"frame 9999: the take has frames 0 to"):
        input_edits.with_gait(inputs, 9999, 9999, Gait.JOG)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 6), st.integers(-400, 900), st.integers(-400, 900))
def test_moved_gaits_still_fill_the_take(index: int, start: int, end: int) -> None:
    asked = [Gait.WALK] * 90 + [Gait.JOG] * 60 + [Gait.WALK] * 50 + [Gait.CROUCH] * 20
    frames = InputFrames.of(InputFrame(Controls((0.0, 1.0), None, gait), 1.0, 1.0) for gait in asked)
    key = Keyframe(-20, take_snapshot(Controller(WalkerModel(), Terrain.flat())))
    inputs = InputRecording(frames, (), (key,))
    spans = input_edits.gait_spans(inputs.gaits())
    span = spans[index % len(spans)]
    edit = input_edits.gaits_laid(inputs, [index % len(spans)], [replace(span, start=start, end=end)])
    wanted, now = inputs.gaits(), edit.inputs.gaits()
    inside = slice(max(start, 0), max(end, 0))
    assert set(now[inside]) <= {span.gait}
    outside = np.ones(len(inputs), bool)
    outside[inside], outside[span.start : span.end] = False, False
    slivers = [s for s in input_edits.gait_spans(now) if s.end - s.start < input_edits.SLIVER_FRAMES]
    assert not slivers or len(input_edits.gait_spans(now)) == 1
    for s in input_edits.gait_spans(np.where(outside & (now != wanted), 1, 0)):
        assert s.gait == 0 or s.end - s.start < input_edits.SLIVER_FRAMES
    before = slice(-inputs.start, -inputs.start + edit.first)
    assert edit.inputs.frames[before] == inputs.frames[before]


@pytest.mark.parametrize(
    ("gone", "put", "left"),
    [
        ([1], None, [(0, 0), (110, 2)]),  # its frames go to the one before
        ([0], None, [(0, 1), (110, 2)]),  # the next one begins with the take
        ([2], None, [(0, 0), (40, 1)]),
        ([0, 2], None, [(0, 1)]),
        ([1], (60, 130), [(0, 0), (60, 1), (130, 2)]),
        ([], (120, 140), [(0, 0), (40, 1), (110, 2), (120, 1), (140, 2)]),  # the one below goes on behind it
        ([1], (2, 107), [(0, 1), (110, 2)]),  # no sliver of the first one is left
    ],
)
def test_prompts_are_deleted_moved_and_pasted(
    take: Take, gone: list[int], put: tuple[int, int] | None, left: list[tuple[int, int]]
) -> None:
    _, inputs = take
    spans = input_edits.prompt_spans(inputs)
    laid = [] if put is None else [replace(spans[1], start=put[0], end=put[1])]
    made = input_edits.prompts_laid(inputs, gone, laid)
    words = {span.event.prompt: i for i, span in enumerate(spans)}
    assert [(s.start, words[s.event.prompt]) for s in input_edits.prompt_spans(made.inputs)] == left
    before = [change for change in inputs.changes if change.frame < made.first]
    assert made.first == 0 or before == [c for c in made.inputs.changes if c.frame < made.first]


def test_what_cannot_be_made_again_says_so_and_old_frames_are_let_go() -> None:
    studio = Studio(Controller(WalkerModel(), make_terrain("flat")))
    studio.style(0)
    studio.walk(30)
    studio.inputs.forget()
    assert studio.inputs.cut(10) is None
    studio.walk(2 * KEYFRAME_STEPS)
    assert studio.inputs.cut(29) is None
    studio.inputs.drop_before(30 + KEYFRAME_STEPS + 9)
    assert studio.inputs.cut(31) is None
    inputs = studio.inputs.cut(30 + KEYFRAME_STEPS + 10)
    assert -10 >= inputs.start >= -13
    assert [event.prompt for event in inputs.prompts()] == ["style 0"]  # it still holds
