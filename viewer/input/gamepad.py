"""Gamepads: one state per frame from an injectable source, so that tests and other devices can stand in."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from runtime.errors import FileError
from runtime.safe_read import read_bounded

BUTTONS = (
    "a", "b", "x", "y", "left_bumper", "right_bumper", "back", "start", "guide",
    "left_thumb", "right_thumb", "dpad_up", "dpad_right", "dpad_down", "dpad_left",
)  # fmt: skip
MAX_MAPPING_BYTES = 4_000_000
FULL_STICK_RADIUS = 0.95  # length of a fully deflected stick
# a raw axis counts once it was seen this near its centre: dead and shifted axes never do
_REST_DISTANCE = 0.3
_MAX_RELEASED = -0.7  # a raw trigger counts once it was seen below; resting axes are not triggers


@dataclass(frozen=True)
class GamepadState:
    """A gamepad reading: raw sticks as (x right, y up) in -1..1, triggers 0..1."""

    name: str
    left: tuple[float, float] = (0.0, 0.0)
    right: tuple[float, float] = (0.0, 0.0)
    left_trigger: float = 0.0
    right_trigger: float = 0.0
    buttons: frozenset[str] = frozenset()

    @property
    def touched(self) -> bool:
        """Return whether any button, trigger or stick is in use."""
        axes = (*self.left, *self.right, self.left_trigger, self.right_trigger)
        return bool(self.buttons) or any(abs(a) > 0.4 for a in axes)


class GamepadSource(Protocol):
    """A source of gamepad readings."""

    def poll(self) -> GamepadState | None:
        """Return the reading of the gamepad in use, or None."""


def radial_dead_zone(stick: tuple[float, float], dead: float) -> tuple[float, float]:
    """Return a stick (x, y) with a radial dead zone: length 0 below `dead`, rising to 1 at `FULL_STICK_RADIUS`, same direction."""
    x, y = stick
    length = math.hypot(x, y)
    if not math.isfinite(length) or length <= dead:
        return 0.0, 0.0
    scale = min((length - dead) / max(FULL_STICK_RADIUS - dead, 1e-6), 1.0) / length
    return x * scale, y * scale


@dataclass
class GlfwGamepads:
    """Reads gamepads through glfw, by their SDL mapping or the usual raw axes; the one last touched is in use."""

    glfw: Any
    _current: int = -1
    _live_axes: dict[int, set[int]] = field(default_factory=dict)

    def poll(self) -> GamepadState | None:
        """Read all connected gamepads and return the one in use."""
        states: dict[int, GamepadState] = {}
        for pad in range(self.glfw.JOYSTICK_LAST + 1):
            state = self._read(pad)
            if state is None:
                self._live_axes.pop(pad, None)
            else:
                states[pad] = state
        touched = [pad for pad, state in states.items() if state.touched]
        if self._current not in states or (touched and self._current not in touched):
            self._current = (touched or sorted(states) or [-1])[0]
        return states.get(self._current)

    def _read(self, pad: int) -> GamepadState | None:
        if not self.glfw.joystick_present(pad):
            return None
        if self.glfw.joystick_is_gamepad(pad):
            mapped = self.glfw.get_gamepad_state(pad)
            return None if mapped is None else _from_mapping(_text(self.glfw.get_gamepad_name(pad)), mapped)
        return self._read_raw(pad)

    def _read_raw(self, pad: int) -> GamepadState | None:
        """Return the reading of an unmapped pad by the axis order of Linux' xpad driver."""
        pointer, count = self.glfw.get_joystick_axes(pad)
        button_pointer, button_count = self.glfw.get_joystick_buttons(pad)
        if count < 4 or button_count < 6:
            return None  # a wheel, a sensor or a keyboard that reports as a joystick
        triggers, right = ((2, 5), 3) if count >= 6 else ((), 2)
        live = self._live_axes.setdefault(pad, set())
        axes = [_axis(i, float(pointer[i]), i in triggers, live) for i in range(count)]
        pulled = ((axes[2] + 1) / 2, (axes[5] + 1) / 2) if triggers else (0.0, 0.0)
        buttons = zip(BUTTONS[:8], button_pointer[:button_count], strict=False)
        return GamepadState(
            _text(self.glfw.get_joystick_name(pad)) + " (unmapped)",
            (axes[0], -axes[1]),
            (axes[right], -axes[right + 1]),
            *pulled,
            frozenset(button for button, down in buttons if down),
        )

    def add_mappings(self, path: Path) -> str:
        """Load the user's SDL mapping file if it exists; return an error message, or ""."""
        if not path.exists():
            return ""
        try:
            lines = read_bounded(path, MAX_MAPPING_BYTES).decode("utf-8", "replace").splitlines()
        except FileError as error:
            return f"{error.problem} The built-in gamepad mappings are used."
        said = [line for line in lines if line.strip() and not line.startswith("#")]
        good = list(filter(_is_mapping, said))
        if good:
            self.glfw.update_gamepad_mappings("\n".join(good) + "\n")
        bad = len(said) - len(good)
        return f"{path}: {bad} lines are not SDL gamepad mappings and were ignored." if bad else ""


def _is_mapping(line: str) -> bool:
    """Return whether a line looks like an SDL mapping; glfw accepts anything."""
    return line.count(",") >= 2 and "\0" not in line


def _axis(number: int, value: float, trigger: bool, live: set[int]) -> float:
    """Return the value of a raw axis, or its rest value until the axis was seen there."""
    if value < _MAX_RELEASED if trigger else abs(value) < _REST_DISTANCE:
        live.add(number)
    return value if number in live else -float(trigger)


def _from_mapping(name: str, mapped: Any) -> GamepadState:
    axes, pressed = mapped.axes, mapped.buttons
    return GamepadState(
        name,
        (float(axes[0]), -float(axes[1])),
        (float(axes[2]), -float(axes[3])),
        (float(axes[4]) + 1) / 2,
        (float(axes[5]) + 1) / 2,
        frozenset(button for button, down in zip(BUTTONS, pressed, strict=False) if down),
    )


def _text(name: bytes | str | None) -> str:
    if isinstance(name, bytes):
        name = name.decode("utf-8", errors="replace")
    return name or "gamepad"
