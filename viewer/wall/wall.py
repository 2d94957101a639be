"""The wall's actions: who stands there, how they move, and which of them becomes the walker."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from runtime.controls import Controls
from runtime.motion.snapshot import take_snapshot
from runtime.pose import Pose
from viewer.input.bindings import Action
from viewer.jobs import Slot
from viewer.messages import Messages
from viewer.prompt.prompting import Prompting
from viewer.prompt.style_edit import Side, StyleEdit
from viewer.services import ControllerLike, CrowdLike
from viewer.settings import Settings
from viewer.stage.camera_control import CameraControl
from viewer.stage.simulation import STEP_SECONDS, interpolate
from viewer.stage.stage import Stage
from viewer.takes.takes import Takes
from viewer.wall.state import FEWEST, MOST, Candidate, WallState, centre_of, distance_to, places

if TYPE_CHECKING:
    from runtime.terrain.height_map import Terrain

FIRST_COUNT = 3  # characters of a wall that was just opened
MAX_STEPS = 15  # per displayed frame
LOWEST_PITCH = 0.3  # rad; from lower, a second row hides behind the first
GLIDE_HALF_LIFE = 0.25  # seconds, of target and distance
_LOG = logging.getLogger("sport.viewer")


@dataclass
class Wall:
    """While it is open, the stick drives its characters in place of the walker, who waits."""

    state: WallState
    settings: Settings
    messages: Messages
    stage: Stage
    takes: Takes
    prompting: Prompting
    members: list[ControllerLike] = field(default_factory=list)
    steps: int = 0  # of the last frame
    poses: list[Pose] = field(default_factory=list)  # after the last step, one for each candidate
    _before: list[Pose] = field(default_factory=list)
    _crowd: CrowdLike | None = None
    _walker: ControllerLike | None = None
    _ground: Terrain | None = None
    _left_s: float = 0.0
    _camera: tuple[str, float, float] = ("follow", 0.0, 0.0)  # mode, distance, pitch before it was opened
    _zoom: float = 1.0  # of the user, over the distance that shows all
    _distance: float = 0.0  # given to the camera last; 0 before
    _numbers: Iterator[int] = field(default_factory=itertools.count)

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        """What keys and buttons do here."""
        return {Action.COMPARE: self.toggle, Action.RESET: self._reset}

    def _reset(self) -> None:
        """All side by side, or the walker back to the start."""
        (self.line_up if self.state.open else self.stage.reset_character)()

    # --- who stands there

    def toggle(self) -> None:
        """Open the wall with variants of the prompt, or leave it."""
        if self.state.open:
            self.close()
        elif self.prompting.state.edit.blended:
            self.blends()
        else:
            self.variants()

    @property
    def _count(self) -> int:
        return len(self.state.candidates) or FIRST_COUNT

    @property
    def _seed(self) -> int:
        return 0 if self.stage.state.controller is None else self.stage.state.controller.seed

    def variants(self) -> None:
        """The prompt that holds with as many seeds."""
        edit, first = self.prompting.state.edit, self._seed
        self._open([self._candidate(edit, first + k) for k in range(self._count)])

    def blends(self) -> None:
        """Steps from prompt A to prompt B."""
        edit, last = self.prompting.state.edit, self._count - 1
        shares = [(k / last,) * len(edit.weights) for k in range(self._count)]
        self._open(
            [self._candidate(dataclasses.replace(edit, weights=share), self._seed) for share in shares]
        )

    def last_prompts(self) -> None:
        """The prompt that holds and the ones typed before it."""
        edit = self.prompting.state.edit
        others = [text for text in self.settings.prompt_history if text != edit.prompt(Side.A)]
        candidates = [self._candidate(edit, self._seed) for _ in others[: self._count - 1]]
        self._open([self._candidate(edit, self._seed), *candidates])
        for candidate, text in zip(candidates, others, strict=False):
            self.ask(candidate, text)

    def _candidate(self, edit: StyleEdit, seed: int) -> Candidate:
        return Candidate(next(self._numbers), edit, seed, edit.prompt(Side.A))

    def add(self) -> None:
        """One more with the prompt that holds and the next seed."""
        seeds = [candidate.seed for candidate in self.state.candidates]
        more = self._candidate(self.prompting.state.edit, max(seeds, default=self._seed - 1) + 1)
        if len(seeds) < MOST:
            self._open([*self.state.candidates, more])

    def remove(self, index: int) -> None:
        """One less; two stay."""
        if len(self.state.candidates) > FEWEST:
            rest = [c for i, c in enumerate(self.state.candidates) if i != index]
            self._open(rest)

    def reseed(self, candidate: Candidate, seed: int) -> None:
        """Another seed for one of them, from now on."""
        candidate.seed = max(seed, 0)
        i = self.state.candidates.index(candidate)
        pose = self.poses[i]
        self.members[i].seed = candidate.seed
        self.members[i].reset(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)

    def ask(self, candidate: Candidate, text: str) -> None:
        """Another prompt for one of them."""
        candidate.text, candidate.asked = text, True
        self.takes.jobs.submit(
            Slot("compare view", candidate.number),
            lambda: self.prompting.answer(text),
            lambda answer: self._answered(candidate, StyleEdit((answer, None))),
            lambda _: self._unanswered(candidate),
        )

    def _answered(self, candidate: Candidate, edit: StyleEdit) -> None:
        candidate.edit, candidate.asked = edit, False
        if any(candidate is c for c in self.state.candidates):
            self._style(self.state.candidates.index(candidate), self.settings.blend_seconds)

    def _unanswered(self, candidate: Candidate) -> None:
        candidate.text, candidate.asked = candidate.edit.prompt(Side.A), False

    def _style(self, index: int, seconds: float) -> None:
        self.members[index].set_style(self.state.candidates[index].edit.style(), seconds)

    # --- opening and leaving

    def _open(self, candidates: list[Candidate]) -> None:
        walker, edit = self.stage.state.controller, self.prompting.state.edit
        if walker is None or edit.a is None:
            self.messages.warn("The wall needs a model and a prompt: wait until they are there.")
            return
        if len(candidates) < FEWEST:
            self.messages.warn("There is nothing to compare with yet: type another prompt.")
            return
        if not self.state.open:
            self._prepare(walker)
        centre, yaw = self._middle()
        self._end_crowd()
        self.state.candidates, self.state.hovered = candidates, -1
        self.members = [walker.twin() for _ in candidates]
        for i, (member, candidate) in enumerate(zip(self.members, candidates, strict=True)):
            member.seed = candidate.seed
            member.set_terrain(self.stage.state.terrain)
            self._style(i, 0.0)
        self._crowd = self.stage.services.make_crowd(self.members)
        self._ground = self.stage.state.terrain
        self._place(centre, yaw)

    def _prepare(self, walker: ControllerLike) -> None:
        """Whatever else was going on ends."""
        self.takes.close_playback()
        self.stage.path.stop()
        self.stage.path.active = False
        if self.takes.state.recording:
            self.takes.toggle_recording()
            self.messages.note("The recording ended where the wall was opened, and is in the list.")
        camera = self.stage.camera
        self._walker = walker
        self._camera = camera.mode, camera.current.distance, camera.current.pitch
        self._zoom, self._distance, self._left_s = 1.0, 0.0, 0.0
        camera.use("orbit")
        camera.orbit.pitch = max(camera.orbit.pitch, LOWEST_PITCH)

    def close(self, note: str = "") -> None:
        """Back to the walker, who stands where the wall was opened; nothing happens where it is closed."""
        if not self.state.open:
            return
        self._end_crowd()
        self.state.candidates, self.members, self.poses, self._before = [], [], [], []
        self._look_at_walker()
        if note:
            self.messages.note(note)

    def _look_at_walker(self) -> None:
        self.stage.camera.come_back(*self._camera, self.stage.state.simulation.current)

    def _end_crowd(self) -> None:
        if self._crowd is not None:
            self._crowd.close()
        self._crowd = None

    def keep(self, index: int) -> None:
        """Let one of them be the walker: it goes on from here, and its prompt is the current one, as a step of undo."""
        candidate, title = self.state.candidates[index], self.state.titles[index]
        snapshot, pose = take_snapshot(self.members[index]), self.poses[index]  # type: ignore[arg-type]
        before = self.prompting.state.edit
        self.close()
        self.stage.go_on_from(snapshot, pose, None)
        self._look_at_walker()
        edit = dataclasses.replace(candidate.edit, locked=before.locked)
        if edit != before:
            self.prompting.adopt(edit, f"choice of “{title}”")
            style = edit.style()
            if style is not None:
                words = edit.prompt_text, edit.spelled_out()
                self.takes.recorder.mark_prompt(words[0], 0.0, words[1], edit.typed())
                self.stage.drives.mark_style(style, 0.0, *words, edit, holds=True)
        self.messages.note(f"Kept: {title}.")

    # --- moving

    def line_up(self) -> None:
        """Put all of them side by side again where they are, across the view."""
        self._place(*self._middle())

    def _middle(self) -> tuple[tuple[float, float], float]:
        first = self.stage.state.simulation.current
        x, _, z = centre_of(self.poses or [first])
        return (float(x), float(z)), (self.poses or [first])[0].root_yaw

    def _place(self, centre: tuple[float, float], yaw: float) -> None:
        spots = places(len(self.members), centre, self.stage.camera.current.yaw)
        for member, (x, z) in zip(self.members, spots, strict=True):
            member.reset(x, z, yaw)
        self._step(Controls())
        self._before = self.poses

    def advance(self, seconds: float, controls: Controls) -> bool:
        """Let time pass on the wall, and whether it is open; it is left when a take or another model begins."""
        if not self.state.open:
            return False
        if self.stage.state.controller is not self._walker:
            self.close("The wall was left: another model moves the character.")
        elif self.takes.state.recording:
            self.close("The wall was left: a take records the walker.")
        if self._crowd is None:
            return False
        if self.stage.state.terrain is not self._ground:
            self._ground = self.stage.state.terrain
            self._crowd.set_terrain(self._ground)
        for member in self.members:
            member.temperature, member.strength = self.settings.temperature, self.settings.strength
            member.response = self.settings.response
        self._left_s += seconds
        steps = int(self._left_s / STEP_SECONDS + 1e-6)
        self._left_s = min(max(self._left_s - steps * STEP_SECONDS, 0.0), STEP_SECONDS)
        self.steps = min(steps, MAX_STEPS)
        for _ in range(self.steps):
            self._step(controls)
        return self.state.open

    def _step(self, controls: Controls) -> None:
        if self._crowd is None:
            return
        begin = time.perf_counter()
        try:
            poses = self._crowd.step(controls)
        except Exception as error:  # a foreign network may fail in any way; the window must live on
            _LOG.exception("the wall failed")
            self.close()
            self.messages.error(f"The wall was left: the model failed ({error}).")
            return
        ms, simulation = (time.perf_counter() - begin) * 1e3, self.stage.state.simulation
        simulation.model_ms += 0.05 * (ms - simulation.model_ms)
        self._before, self.poses = self.poses, poses
        fault = next((member.message for member in self.members if member.message), "")
        if fault:
            self.messages.error(fault)

    def shown(self, between: bool) -> list[Pose]:
        """The poses to draw; `between` the last two steps where the display has its own rate."""
        if not between or len(self._before) != len(self.poses):
            return self.poses
        share = self._left_s / STEP_SECONDS
        return [interpolate(a, b, share) for a, b in zip(self._before, self.poses, strict=True)]

    def frame_all(self, camera: CameraControl, aspect: float, dt: float) -> None:
        """Glide to where a free view of `aspect` times the window's height holds all of them, nearer or farther by zoom."""
        if not self.state.open:
            return
        orbit, poses = camera.orbit, self.poses
        wanted = distance_to(poses, orbit, aspect)
        share = 1.0 - 0.5 ** (dt / GLIDE_HALF_LIFE)
        if self._distance:
            self._zoom *= orbit.distance / self._distance
        else:  # just opened
            orbit.distance, share = wanted, 1.0
        orbit.target = orbit.target + share * (centre_of(poses) - orbit.target)
        orbit.distance += share * (wanted * self._zoom - orbit.distance)
        orbit.distance = float(np.clip(orbit.distance, orbit.MIN_DISTANCE, orbit.MAX_DISTANCE))
        self._distance = orbit.distance
