"""Joints of a character that its user names by hand: what is guessed, what is chosen, and keeping it in the file's folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from runtime.character.character import joints_of
from runtime.character.guess import JointGuess
from runtime.character.joint_map import joint_map_path, save_joint_map, saved_joint_map
from runtime.character.joints import NEEDED
from runtime.skeleton import SPORT_SKELETON
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages


@dataclass
class JointMapping:
    """The joints window; `chosen` are SPORT joints -> joints of the file, "" for none of them. `load` shows a character."""

    messages: Messages
    jobs: Jobs
    load: Callable[[Path], None]  # with the map in the file's folder
    open: bool = False
    path: Path | None = None
    guess: JointGuess | None = None
    chosen: dict[str, str] = field(default_factory=dict)
    selected: str = ""  # the SPORT joint whose row was used last
    problem: str = ""  # why it could not be applied

    def guessed(self, joint: str) -> str:
        """Return the joint of the file that names or rest pose tell, "" for none."""
        found = {} if self.guess is None else self.guess.found
        return self.guess.names[found[joint]] if self.guess is not None and joint in found else ""

    def plays(self, joint: str) -> str:
        """Return the joint of the file that plays a SPORT joint, "" for none."""
        return self.chosen.get(joint, self.guessed(joint))

    @property
    def missing(self) -> list[str]:
        """SPORT joints without which nothing can be driven."""
        return [joint for joint in NEEDED if not self.plays(joint)]

    @property
    def shown(self) -> Path | None:
        """The file whose joints are in the window, None while it is closed."""
        return self.path if self.open else None

    def begin(self, path: Path) -> None:
        """Open the window with what is found in a character file."""
        self.jobs.submit(
            Slot("joints", path),
            lambda: (joints_of(path, {}), saved_joint_map(path)),
            lambda found: self._show(path, *found),
        )

    def _show(self, path: Path, guess: JointGuess, saved: dict[str, str]) -> None:
        known = {joint: name for joint, name in saved.items() if not name or name in guess.names}
        lost = len(saved) - len(known)
        self.open, self.path, self.guess, self.chosen = True, path, guess, known
        self.selected = self.problem = ""
        if lost:
            self.problem = f"{lost} names of {joint_map_path(path).name} are not in the skeleton."

    def choose(self, joint: str, name: str | None) -> None:
        """Let a joint of the file play a SPORT joint: "" for none, None for what is guessed.

        It can play one only: another SPORT joint that had it has none.
        """
        chosen = {key: value for key, value in self.chosen.items() if key != joint}
        name = self.guessed(joint) if name is None else name
        if name != self.guessed(joint):
            chosen[joint] = name
        others = [key for key in SPORT_SKELETON.names if key != joint and name and self.plays(key) == name]
        chosen |= dict.fromkeys(others, "")
        self.chosen, self.selected, self.problem = chosen, joint, ""

    def guess_all(self) -> None:
        self.chosen, self.problem = {}, ""

    def apply(self) -> None:
        """Keep the map in the file's folder and show the character by it."""
        if self.path is None or self.missing:
            return
        path, chosen = self.path, dict(self.chosen)

        def keep() -> Path | None:
            if chosen:
                return save_joint_map(path, chosen)
            joint_map_path(path).unlink(missing_ok=True)
            return None

        def kept(written: Path | None) -> None:
            where = f"Joints of {path.name} kept in {written.name}." if written else "Joints as guessed."
            self.messages.note(where)
            self.load(path)

        self.jobs.submit(Slot("joints", path), keep, kept, self.refused, writing=f"the joints of {path.name}")

    def refused(self, error: Exception) -> None:
        """Say why the character could not be shown by what was chosen, or that not be kept."""
        self.problem = str(error)

    def close(self) -> bool:
        """Leave the window; what was not applied is forgotten. Whether it was open."""
        was, self.open = self.open, False
        return was
