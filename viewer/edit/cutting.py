"""Cut, split, repeat and join takes: a menu of the playing take."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import LIVE, Session, Take
from runtime.takes.clip import Clip
from runtime.takes.joined import joined, repeated, without
from runtime.takes.loop import make_loop
from runtime.takes.root import root_track
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.jobs import Slot
from viewer.session.takes import Takes

CUTTING = Slot("cut of a take")
TIMES = (2, 3, 4, 8)
MAX_FRAMES = 216_000  # of the result: an hour
CUT_HINT = "A new take without the frames between the trim handles, blended over the gap"
SPLIT_HINT = "Two takes; the handles of each can be dragged back"
REPEAT_HINT = "A new take that repeats the trimmed range"
LOOP_HINT = "A new take of the best cycle, as an export with “Loop” writes it"
JOIN_HINT = "A new take: this one, then another one"


def _ground(take: Take) -> Terrain | None:
    return None if take.ground is None else take.ground.terrain


@dataclass
class Cutting:
    takes: Takes

    def split(self) -> None:
        """Split the playing take at the frame shown."""
        playback, take = self.takes.playback, self.takes.played
        if playback is None or take is None:
            return
        frame, messages = playback.frame, self.takes.messages
        if self.takes.editor.do(f"split of {take.title}", lambda s: edits.split(s, take.number, frame)):
            messages.note(f"{take.title} ends at frame {playback.number_shown}; the rest is the next take.")
        else:
            messages.note("Go to a frame between the trim handles to split the take there.")

    def cut(self) -> None:
        """Create a take without the range between the trim handles."""
        take = self.takes.played
        if take is not None and not take.trimmed:
            self.takes.messages.note("Set the trim handles around the part to cut out.")
        elif take is not None:
            first, last = take.range
            self._make(
                take, f"{take.title}, cut", lambda: without(take.clip, first, last, _ground(take)), begin=0
            )

    def repeat(self, times: int) -> None:
        """Create a take that repeats the trimmed range `times` times."""
        take = self.takes.played
        if take is not None:
            name = f"{take.title} x {times}"
            self._make(
                take, name, lambda: repeated(take.exported, times, _ground(take)), take.range[0], times
            )

    def loop(self) -> None:
        """Create a take of the best cycle in the trimmed range, as an export with "Loop" does."""
        take = self.takes.played
        if take is not None:

            def work() -> Clip:
                clip = take.exported
                return make_loop(clip, root_track(clip))[0]

            self._make(take, f"{take.title}, loop", work, take.range[0])

    def join(self, number: int) -> None:
        """Create a take of the playing one followed by another."""
        take, other = self.takes.played, self.takes.session.take(number)
        if take is not None and other is not None and number != LIVE:
            name, own, theirs = f"{take.title} + {other.title}", _ground(take), _ground(other)
            grounds = None if own is None or theirs is None else (own, theirs)
            self._make(take, name, lambda: joined(take.exported, other.exported, grounds), take.range[0])

    def _make(self, take: Take, name: str, work: Callable[[], Clip], begin: int, times: int = 1) -> None:
        """Make a take from another one on a worker; camera keys are kept from frame `begin` on."""
        if times * take.frames > MAX_FRAMES:
            self.takes.messages.note("That take would last more than an hour.")
            return
        start = begin / take.made.header.fps
        cameras = tuple(replace(k, seconds=k.seconds - start) for k in take.cameras if k.seconds >= start)
        name = name[: edits.MAX_NAME_CHARACTERS]

        editor, number = self.takes.editor, self.takes.session.counter + 1

        def make() -> Take:
            motion = Motion.of(replace(work(), name=name))
            return Take(motion=motion, cameras=cameras, ground=take.ground)

        def add(made: Take, session: Session) -> Session:
            return edits.with_new_take(session, made, number)

        def done(_: Take) -> None:
            self.takes.play(number)
            self.takes.messages.note(f"{name} is in the list.")

        slot = replace(CUTTING, of=number)
        editor.run(self.takes.jobs, name, slot, make, add, edits.with_number, done, doing=f"Making {name}")

    def menu(self) -> None:
        take = self.takes.played
        others = [other for other in self.takes.session.takes if other is not take]
        for text, hint, act in (
            ("Split here", SPLIT_HINT, self.split), ("Cut out the trimmed range", CUT_HINT, self.cut),
            ("Loop", LOOP_HINT, self.loop),
        ):  # fmt: skip
            if widgets.item(text, hint):
                act()
        self._several(others)

    def _several(self, others: list[Take]) -> None:
        if imgui.begin_menu("Repeat"):
            for times in TIMES:
                if widgets.item(f"{times} times", REPEAT_HINT):
                    self.repeat(times)
            imgui.end_menu()
        if imgui.begin_menu("Join with", bool(others)):
            for other in others:
                if widgets.item(widgets.named(other.title, f"join {other.number}"), JOIN_HINT):
                    self.join(other.number)
            imgui.end_menu()
