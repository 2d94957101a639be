"""The compare view: variants of the prompt follow one stick, and one of them can become the live character."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from runtime.controls import Controls
from runtime.motion.controller import Controller, Crowd
from runtime.motion.snapshot import take_snapshot
from runtime.pose import Pose
from runtime.session.prompt_blend import Answer, PromptBlend, Side
from runtime.session.session import LIVE, Session, Variant
from runtime.terrain.height_map import Terrain
from viewer.compare.lineup import centre_of, distance_to, names, places
from viewer.edit.path import PathTool
from viewer.editor import Change, Editor
from viewer.input.bindings import Action
from viewer.jobs import Slot
from viewer.messages import Messages
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.questions import quoted, same_answers
from viewer.scene.camera_control import CameraControl
from viewer.scene.scene import Scene
from viewer.scene.simulation import STEP_SECONDS, interpolate, steps_of
from viewer.session.takes import Takes
from viewer.settings import Settings

MIN_CHARACTERS, MAX_CHARACTERS = 2, 9
FIRST_COUNT = 3  # variants of a newly opened view
MIN_PITCH_RAD = 0.3  # seen from lower, the second row is hidden by the first
GLIDE_HALF_LIFE_S = 0.25  # seconds, of target and distance
_LOG = logging.getLogger("sport.viewer")


@dataclass
class CompareView:
    """The compare view; while it is open, the stick drives the session's variants, and the live character waits."""

    editor: Editor
    settings: Settings
    messages: Messages
    scene: Scene
    takes: Takes
    path: PathTool
    prompting: PromptController
    hovered: int = -1  # index of the variant under the mouse
    focus_requested: bool = False
    texts: dict[int, str] = field(default_factory=dict)  # typed text, by the variants' numbers
    pending: set[int] = field(default_factory=set)  # variants whose text has no answer yet
    members: list[Controller] = field(default_factory=list)
    steps: int = 0  # simulation steps of the last frame
    poses: list[Pose] = field(default_factory=list)  # after the last step, one per variant
    _standing: tuple[Variant, ...] = ()  # the variants that the controllers were made for
    _before: list[Pose] = field(default_factory=list)
    _crowd: Crowd | None = None
    _live: Controller | None = None
    _ground: Terrain | None = None
    _left_s: float = 0.0
    _camera: tuple[str, float, float] = ("follow", 0.0, 0.0)  # mode, distance and pitch before it was opened
    _zoom: float = 1.0  # the user's zoom, relative to the distance that shows all
    _distance: float = 0.0  # last camera distance; 0 before

    def __post_init__(self) -> None:
        self._file = self.editor.file
        self.editor.followers.append(self.follow)
        self.editor.withdraw.append(self._withdraw)

    @property
    def open(self) -> bool:
        """Whether the compare view is shown."""
        return bool(self.members)

    @property
    def variants(self) -> tuple[Variant, ...]:
        return self.editor.session.variants

    @property
    def titles(self) -> list[str]:
        """The title of each variant: its prompt and what differs."""
        return [name + rest for name, rest in names(self.variants)]

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        reset = lambda: (self.line_up if self.open else self.scene.reset_character)()  # noqa: E731
        return {Action.COMPARE: self.toggle, Action.RESET: reset}

    # --- variants

    def toggle(self) -> None:
        """Open the compare view, with the stored variants of the prompt or new ones, or close it."""
        if self.open:
            self.close()
        elif any(same_answers(variant.prompt, self.prompting.prompt) for variant in self.variants):
            self._open()
        elif self.prompting.prompt.blended:
            self.blends()
        else:
            self.seeds()

    @property
    def _count(self) -> int:
        return len(self._standing) or FIRST_COUNT

    @property
    def _seed(self) -> int:
        return 0 if self.scene.controller is None else self.scene.controller.seed

    def seeds(self) -> None:
        blend = self.prompting.prompt
        self._compare(
            f"variants of {quoted(blend.prompt(Side.A))}",
            [(blend, self._seed + k) for k in range(self._count)],
        )

    def blends(self) -> None:
        blend, last = self.prompting.prompt, self._count - 1
        weights = [(k / last,) * len(blend.weights) for k in range(self._count)]
        label = f"steps from {quoted(blend.prompt(Side.A))} to {quoted(blend.prompt(Side.B))}"
        self._compare(label, [(replace(blend, weights=weight), self._seed) for weight in weights])

    def last_prompts(self) -> None:
        """Compare the live prompt with the last ones typed, which are answered one by one."""
        blend = self.prompting.prompt
        texts = [text for text in self.settings.prompt_history if text != blend.prompt(Side.A)]
        texts = texts[: self._count - 1]
        first = self._next_number
        if self._compare("comparison of the last prompts", [(blend, self._seed)] * (len(texts) + 1)):
            for number, text in enumerate(texts, first + 1):
                self._ask(number, text, self.editor.revise)  # not undoable: the variants wait for it

    @property
    def _next_number(self) -> int:
        """Return a number unused by the variants of any step."""
        steps = self.editor.history.steps
        return 1 + max((v.number for step in steps for v in step.session.variants), default=0)

    def _compare(self, label: str, moves: Sequence[tuple[PromptBlend, int]]) -> bool:
        """Make variants by prompt and seed, as an undo step; return whether there is a model and enough to compare."""
        if not self._ready:
            return False
        if len(moves) < MIN_CHARACTERS:
            self.messages.warn("Nothing to compare yet: type another prompt.")
            return False
        variants = tuple(Variant(number, *move) for number, move in enumerate(moves, self._next_number))
        self.editor.do(label, lambda session: replace(session, variants=variants))
        if not self.open:
            self._open()
        return True

    def add(self) -> None:
        """Add a variant with the live prompt and the next seed."""
        if len(self.variants) < MAX_CHARACTERS:
            seed = max((variant.seed for variant in self.variants), default=self._seed - 1) + 1
            more = Variant(self._next_number, self.prompting.prompt, seed)
            label = f"variant {len(self.variants) + 1} added"
            self.editor.do(label, lambda session: replace(session, variants=(*session.variants, more)))

    def remove(self, index: int) -> None:
        """Remove a variant, down to two."""
        if len(self.variants) > MIN_CHARACTERS:
            rest = self.variants[:index] + self.variants[index + 1 :]
            self.editor.do(f"variant {index + 1} removed", lambda session: replace(session, variants=rest))

    def reseed(self, index: int, seed: int) -> None:
        """Give a variant another seed, during a drag."""
        change = _with_variant(self.variants[index].number, lambda v: replace(v, seed=max(seed, 0)))
        self.editor.drag(f"seed of variant {index + 1}", change)

    def ask(self, index: int, text: str) -> None:
        label = f"prompt {quoted(text)} of variant {index + 1}"
        self._ask(self.variants[index].number, text, partial(self.editor.do, label))

    def _ask(self, number: int, text: str, put: Callable[[Change], object]) -> None:
        self.texts[number] = text
        self.pending.add(number)

        def answered(answer: Answer) -> None:
            if number in self.pending:
                self._forget(number)
                put(_with_variant(number, lambda v: replace(v, prompt=PromptBlend((answer, None)))))

        self.prompting.jobs.submit(
            Slot("variant", number),
            lambda: self.prompting.answer(text),
            answered,
            lambda _: self._forget(number),
        )

    def _forget(self, number: int) -> None:
        self.pending.discard(number)
        self.texts.pop(number, None)

    def _withdraw(self) -> bool:
        """Cancel the unanswered prompts of variants, with a message; return whether there were any."""
        pending = tuple(self.pending)
        for number in pending:
            self.messages.note(f"Withdrawn: prompt {quoted(self.texts[number])}.")
            self._forget(number)
        return bool(pending)

    # --- opening and closing

    @property
    def _ready(self) -> bool:
        """Whether a model and a prompt are loaded; otherwise shows a message."""
        ready = self.scene.controller is not None and self.prompting.prompt.a is not None
        if not ready:
            self.messages.warn("The compare view needs a model and a prompt: wait until both are loaded.")
        return ready

    def follow(self, before: Session, now: Session) -> None:
        """Show the session's variants after a change of it; close the view if there are none."""
        if self._file is not self.editor.file:  # whose variants have the same numbers
            self._file = self.editor.file
            self.pending.clear()
            self.texts.clear()
        standing = self._standing
        if not self.open or now.variants == standing:
            return
        if len(now.variants) < MIN_CHARACTERS:
            self.close()
        elif [v.number for v in now.variants] != [v.number for v in standing]:
            self._stand()
        else:
            self._standing = now.variants
            for i, (new, old) in enumerate(zip(now.variants, standing, strict=True)):
                if new.prompt != old.prompt:
                    self._set_style(i, self.settings.blend_seconds)
                if new.seed != old.seed:
                    self._restart(i, new.seed)

    def _set_style(self, index: int, seconds: float) -> None:
        style = self._standing[index].prompt.style(self.settings.exact_legs)
        if style is not None:
            self.members[index].set_style(style, seconds)

    def _restart(self, index: int, seed: int) -> None:
        member, pose = self.members[index], self.poses[index]
        member.seed = seed
        member.reset(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)

    def _open(self) -> None:
        """Show the session's variants; ends everything else in progress."""
        if not self._ready:
            return
        self.takes.close_playback()
        self.path.stop()
        self.path.active = False
        if self.takes.recording:
            self.takes.end_recording()
            self.messages.note("Recording stopped by the compare view; the take is in the list.")
        camera = self.scene.camera
        self._live = self.scene.controller
        self._camera = camera.mode, camera.current.distance, camera.current.pitch
        self._zoom, self._distance, self._left_s = 1.0, 0.0, 0.0
        camera.use("orbit")
        camera.orbit.pitch = max(camera.orbit.pitch, MIN_PITCH_RAD)
        self._stand()

    def _stand(self) -> None:
        """Line up a character for each variant at the place of the former ones."""
        if self._live is None:
            return
        centre, yaw = self._middle()
        self._end_crowd()
        self._standing, self.hovered = self.variants, -1
        self.members = [self._live.twin() for _ in self._standing]
        for i, (member, variant) in enumerate(zip(self.members, self._standing, strict=True)):
            member.seed = variant.seed
            member.set_terrain(self.scene.terrain)
            self._set_style(i, 0.0)
        self._crowd = self.scene.services.make_crowd(self.members)
        self._ground = self.scene.terrain
        self._place(centre, yaw)

    def begin_typing(self) -> None:
        """Move the keyboard focus to the first variant's prompt."""
        self.focus_requested = True

    def close(self, note: str = "") -> None:
        """Return to the live character where it was; the session keeps the variants."""
        if not self.open:
            return
        self._end_crowd()
        self._standing, self._live = (), None
        self.members, self.poses, self._before = [], [], []
        self._look_at_live()
        if note:
            self.messages.note(note)

    def _look_at_live(self) -> None:
        self.scene.camera.come_back(*self._camera, self.scene.simulation.current)

    def _end_crowd(self) -> None:
        if self._crowd is not None:
            self._crowd.close()
        self._crowd = None

    def keep(self, index: int) -> None:
        """Make a variant the live character, with its state and prompt, as one step of undo."""
        variant, title = self.variants[index], self.titles[index]
        snapshot, pose = take_snapshot(self.members[index]), self.poses[index]
        before = self.prompting.prompt
        self.close()
        self.scene.go_on_from(snapshot, pose)
        self._look_at_live()
        blend = replace(variant.prompt, locked=before.locked)
        if blend != before:
            self.prompting.adopt(f"choice of “{title}”", lambda s: s.with_take(LIVE, prompt=blend))
            self.takes.mark_style(blend, 0.0, holds=True)
        self.messages.note(f"Kept: {title}.")

    # --- simulation

    def line_up(self) -> None:
        """Line all characters up again at their place, facing the view."""
        self._place(*self._middle())

    def _middle(self) -> tuple[tuple[float, float], float]:
        poses = self.poses or [self.scene.simulation.current]
        x, _, z = centre_of(poses)
        return (float(x), float(z)), poses[0].root_yaw

    def _place(self, centre: tuple[float, float], yaw: float) -> None:
        spots = places(len(self.members), centre, self.scene.camera.current.yaw)
        for member, (x, z) in zip(self.members, spots, strict=True):
            member.reset(x, z, yaw)
        self._step(Controls())
        self._before = self.poses

    def advance(self, seconds: float, controls: Controls) -> bool:
        """Advance all characters and return whether the view is open; it closes when recording starts or the model changes."""
        if not self.open:
            return False
        if self.scene.controller is not self._live:
            self.close("Compare view closed: another model moves the character.")
        elif self.takes.recording:
            self.close("Compare view closed: recording started.")
        if self._crowd is None:
            return False
        if self.scene.terrain is not self._ground:
            self._ground = self.scene.terrain
            self._crowd.set_terrain(self._ground)
        for member in self.members:
            member.temperature, member.strength = self.settings.temperature, self.settings.strength
            member.response = self.settings.response
        step_ms = self.scene.simulation.model_ms
        self.steps, self._left_s = steps_of(self._left_s + seconds, seconds, step_ms)
        for _ in range(self.steps):
            self._step(controls)
        return self.open

    def _step(self, controls: Controls) -> None:
        if self._crowd is None:
            return
        begin = time.perf_counter()
        try:
            poses = self._crowd.step(controls)
        except Exception as error:  # an arbitrary network may fail in any way; the window must survive
            _LOG.exception("the compare view failed")
            self.close()
            self.messages.error(f"Compare view closed: the model failed ({error}).")
            return
        self.scene.simulation.add_cost((time.perf_counter() - begin) * 1e3)
        self._before, self.poses = self.poses, poses
        fault = next((member.message for member in self.members if member.message), "")
        if fault:
            self.messages.error(fault)

    def shown(self, between: bool) -> list[Pose]:
        """Return the poses to draw; `between` interpolates the last two steps for displays with another frame rate."""
        if not between or len(self._before) != len(self.poses):
            return self.poses
        fraction = self._left_s / STEP_SECONDS
        return [interpolate(a, b, fraction) for a, b in zip(self._before, self.poses, strict=True)]

    def frame_all(self, camera: CameraControl, aspect: float, dt: float) -> None:
        """Move the camera smoothly so that all characters fit into a view of aspect ratio `aspect`, keeping the user's zoom."""
        if not self.open:
            return
        orbit, poses = camera.orbit, self.poses
        wanted = distance_to(poses, orbit, aspect)
        fraction = 1.0 - 0.5 ** (dt / GLIDE_HALF_LIFE_S)
        if self._distance:
            self._zoom *= orbit.distance / self._distance
        else:  # just opened
            orbit.distance, fraction = wanted, 1.0
        orbit.target = orbit.target + fraction * (centre_of(poses) - orbit.target)
        orbit.distance += fraction * (wanted * self._zoom - orbit.distance)
        orbit.distance = float(np.clip(orbit.distance, orbit.MIN_DISTANCE, orbit.MAX_DISTANCE))
        self._distance = orbit.distance


def _with_variant(number: int, change: Callable[[Variant], Variant]) -> Change:
    """Convert a change of one variant to a change of the session."""

    def changed(session: Session) -> Session:
        variants = tuple(change(v) if v.number == number else v for v in session.variants)
        return replace(session, variants=variants)

    return changed
