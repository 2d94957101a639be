"""Which keys are down and which were just pressed, by name and free of any window library."""

from __future__ import annotations

from dataclasses import dataclass, field

# Keys that work while a text field has the focus: they type nothing.
NEVER_TYPED = frozenset(f"f{i}" for i in range(1, 13))
MODIFIERS = frozenset({"ctrl", "shift", "alt"})


@dataclass
class Keyboard:
    """Held keys and the presses since the last `take_pressed`, as names: "w", "shift", "f1"."""

    held: set[str] = field(default_factory=set)
    _pressed: list[str] = field(default_factory=list)

    def key(self, name: str, down: bool, typing: bool = False) -> None:
        """Take one key event; while `typing`, a press counts only for keys that type nothing.

        A key pressed while Ctrl is held belongs to a shortcut (Ctrl+Z), and neither moves nor acts.
        """
        if not down:
            self.held.discard(name)
        elif "ctrl" in self.held and name not in NEVER_TYPED | MODIFIERS:
            return
        elif not typing or name in NEVER_TYPED:
            self.held.add(name)
            self._pressed.append(name)

    def release_all(self) -> None:
        """Forget every held key: the window lost the focus, or a text field took it."""
        self.held.clear()

    def take_pressed(self) -> list[str]:
        """Names of the keys pressed since the last call, in order."""
        pressed, self._pressed = self._pressed, []
        return pressed
