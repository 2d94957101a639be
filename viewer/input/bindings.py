"""What keys and buttons do: one table that the input mapper obeys and the help overlay prints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from enum import Enum, auto

from runtime.controls import Controls, Gait
from viewer.input.gamepad import GamepadState, radial_dead_zone

ZOOM_STEPS_PER_S = 9.0  # wheel steps per second of a held key
HOLD_S = 0.35  # a crouch key that is held longer stands up when it is let go
JUMP_PRESS_S = 0.05  # a press lasts at least this long: one shorter than a step must not be lost
TRIGGER_PRESSED_FRACTION = 0.3


# Keys that work while a text field has the focus: they type nothing.
NEVER_TYPED = frozenset(f"f{i}" for i in range(1, 13))
MODIFIERS = frozenset({"ctrl", "shift", "alt"})


@dataclass
class Keyboard:
    """Holds the keys that are down and the presses since the last `take_pressed`, as names: "w", "shift", "f1"."""

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
        """Return the names of the keys pressed since the last call, in order."""
        pressed, self._pressed = self._pressed, []
        return pressed


class Action(Enum):
    """Lists everything a key or button can do, each with what triggers it: any of `keys`, or the pad's `button`.

    While a take plays `take_key` comes before the keys. HELD actions act while down, the others once per press.
    """

    def __init__(self, keys: str, button: str = "", take_key: str = "") -> None:
        self.keys = tuple(keys.split())
        self.button = button
        self.take_key = take_key

    FORWARD = "w"
    LEFT = "a"
    BACK = "s"
    RIGHT = "d"
    JOG = "shift"
    STRAFE = "x alt", "left_bumper"
    LOOK_LEFT = "q left"
    LOOK_RIGHT = "e right"
    LOOK_UP = "up"
    LOOK_DOWN = "down"
    ZOOM_IN = "page_up equal", "dpad_up"
    ZOOM_OUT = "page_down minus", "dpad_down"
    JUMP = "space", "a"
    CROUCH = "c", "b"
    RECORD = "r", "y"
    SAVE_LAST = "t", "x"
    PLAY = "p", "", "space"
    FRAME_BACK = "comma", "", "left"
    FRAME_ON = "period", "", "right"
    FIRST_FRAME = "", "", "home"
    LAST_FRAME = "", "", "end"
    FIT_TIMELINE = "", "", "z"
    TRIM_IN = "", "", "i"
    TRIM_OUT = "", "", "o"
    PLAY_BACKWARDS = "", "", "j"
    STOP_PLAYING = "", "", "k"
    PLAY_FORWARDS = "", "", "l"
    KEY_POSE = "", "", "s"
    RESET = "home", "left_thumb"
    CAMERA = "o", "right_thumb"
    FRAME = "0"
    FRAME_SELECTION = "f kp_decimal"
    FRONT = "1 kp_1"
    SIDE = "2 kp_3"
    THREE_QUARTERS = "3"
    FEET = "4"
    TOP = "5 kp_7"
    KEYED_CAMERA = "kp_0"
    HELP = "f1", "start"
    TRAJECTORY = "f2"
    SKELETON = "f3"
    CONTACTS = "f4"
    GRID = "f5"
    PANELS = "f10", "back"
    FULLSCREEN = "f11"
    SCREENSHOT = "f12"
    PROMPT = "enter"
    COMPARE = "v"
    NEXT_PANEL = "f6 tab"


# Views of the character, in the order of `viewer.scene.camera_control.VIEWS`.
VIEW_ACTIONS = (Action.FRONT, Action.SIDE, Action.THREE_QUARTERS, Action.FEET, Action.TOP)


class Drag(Enum):
    ORBIT = auto()
    PAN = auto()
    ZOOM = auto()


# What a drag with a button and a modifier does, in the habits of some programs; right orbits in all of them.
NAVIGATION: dict[str, dict[tuple[str, str], Drag]] = {
    "sport": {
        ("left", ""): Drag.ORBIT, ("right", ""): Drag.ORBIT, ("right", "shift"): Drag.PAN,
        ("middle", ""): Drag.PAN, ("middle", "shift"): Drag.ORBIT, ("middle", "ctrl"): Drag.ZOOM,
    },
    "blender": {
        ("middle", ""): Drag.ORBIT, ("middle", "shift"): Drag.PAN, ("middle", "ctrl"): Drag.ZOOM,
        ("right", ""): Drag.ORBIT,
    },
    "maya": {
        ("left", "alt"): Drag.ORBIT, ("middle", "alt"): Drag.PAN, ("right", "alt"): Drag.ZOOM,
        ("right", ""): Drag.ORBIT,
    },
}  # fmt: skip
_TAKE_KEYS = frozenset(action.take_key for action in Action) - {""}

BUTTON_NAMES = {
    "a": "A", "b": "B", "x": "X", "y": "Y", "left_bumper": "Left shoulder", "right_bumper": "Right shoulder",
    "back": "Back", "start": "Start", "left_thumb": "Left stick press", "right_thumb": "Right stick press",
    "dpad_up": "D-pad up", "dpad_down": "D-pad down", "dpad_left": "D-pad left", "dpad_right": "D-pad right",
}  # fmt: skip


def pad_buttons(changes: str = "") -> dict[Action, str]:
    """Return the pad's button of each action that has one; `changes` is text such as "jump=x crouch=a", whose unknown words are passed over."""
    buttons = {action: action.button for action in Action if action.button}
    by_name = {action.name.lower(): action for action in buttons}
    for change in changes.split():
        name, _, button = change.partition("=")
        if name in by_name and button in BUTTON_NAMES:
            buttons[by_name[name]] = button
    return buttons


def changed_buttons(changes: str, action: Action, button: str) -> str:
    """Return the changes with another button for an action; the action that had it gets the old one."""
    buttons, before = pad_buttons(changes), pad_buttons()
    for other, theirs in buttons.items():
        if theirs == button and other is not action:
            buttons[other] = buttons[action]
    buttons[action] = button
    return " ".join(f"{a.name.lower()}={b}" for a, b in buttons.items() if before[a] != b)


# What the help overlay prints: heading, then rows of what, keyboard and mouse, gamepad: {action} is its button.
HELP: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    ("Move", (
        ("Walk", "W  A  S  D", "Left stick"),
        ("Jog", "Shift (hold)", "Right trigger"),
        ("Crouch", "C (press or hold)", "{crouch} (press or hold)"),
        ("Jump", "Space", "{jump}"),
        ("Strafe, face the camera", "X or Alt (hold)", "{strafe} (hold)"),
        ("Back to the start", "Home", "{reset}"),
    )),
    ("Camera", (
        ("Turn", "Q  E, arrows, right drag", "Right stick"),
        ("Pan, orbit", "Middle drag, Shift+middle", ""),
        ("Zoom", "Wheel, Page Up / Down", "{zoom_in}, {zoom_out}"),
        ("Follow or orbit", "O", "{camera}"),
        ("Front, side, 3/4, feet, top", "1, 2, 3, 4, 5", ""),
        ("Frame the selection, the character", "F, 0", ""),
    )),
    ("Record", (
        ("Start or stop", "R", "{record}"),
        ("Keep the last seconds", "T", "{save_last}"),
        ("Play or pause the clip", "P, or Space while it plays", ""),
        ("One frame back, one on", "Left, Right, or comma, full stop", ""),
        ("First frame, last frame", "Home, End", ""),
        ("Back, stop, on (again: faster)", "J, K, L", ""),
        ("In, out, key", "I, O, S", ""),
        ("Timeline: zoom, scroll, fit", "Wheel, Shift+wheel, Z", ""),
        ("Delete, copy, cut, paste, duplicate", "Del, Ctrl+C, X, V, D", ""),
        ("Move, select all, let go", "Left / Right, Ctrl+A, Esc", ""),
        ("Screenshot", "F12", ""),
    )),
    ("Show", (
        ("This help", "F1", "{help}"),
        ("Trajectory, skeleton, contacts", "F2, F3, F4", ""),
        ("Grid, panels", "F5, F10", "{panels} (panels)"),
        ("Full screen", "F11", ""),
        ("Next panel, back to the view", "F6, Esc", ""),
        ("Session: save, save as, open", "Ctrl+S, Ctrl+Shift+S, Ctrl+O", ""),
        ("Export in any format", "Ctrl+E", ""),
    )),
    ("Prompt", (
        ("Write a prompt, leave the field", "Enter, Esc", ""),
        ("Choose a suggestion, take it", "Up / Down, Tab or Enter", ""),
        ("Last prompts, in an empty field", "Up / Down", ""),
        ("Compare side by side", "V", ""),
        ("Undo, redo", "Ctrl+Z, Ctrl+Y", ""),
    )),
)  # fmt: skip


def pad_text(text: str, changes: str) -> str:
    """Return the help's text on the pad with its buttons as they were changed."""
    buttons = pad_buttons(changes).items()
    names = {action.name.lower(): BUTTON_NAMES[button] for action, button in buttons}
    return text.format_map(names).replace("D-pad up, D-pad down", "D-pad up / down")


@dataclass(frozen=True)
class Intent:
    """Holds what the user asks for in one frame, relative to the camera.

    `move` is (right, forward) and `look` the camera stick (right, up), both with a length of 0..1; `zoom` is in wheel
    steps per second (positive comes nearer); `pressed` are the actions that began in this frame.
    """

    move: tuple[float, float] = (0.0, 0.0)
    look: tuple[float, float] = (0.0, 0.0)
    zoom: float = 0.0
    gait: Gait = Gait.WALK
    strafe: bool = False
    pressed: tuple[Action, ...] = ()


@dataclass
class InputMapper:
    """Turns devices into an `Intent`; remembers the crouch toggle, the running jump and the pad's last buttons."""

    crouching: bool = False
    _jump_left_s: float = 0.0
    _crouch_held_s: float = 0.0
    _last_buttons: frozenset[str] = field(default_factory=frozenset)

    def read(
        self,
        keyboard: Keyboard,
        pad: GamepadState | None,
        dt: float,
        dead_zone: float = 0.15,
        invert: bool = False,
        take: bool = False,
        changes: str = "",
    ) -> Intent:
        """Return the intent of this frame of `dt` seconds.

        `take`: a take is shown, and some keys move its playhead; `changes`: see `pad_buttons`.
        """
        buttons = pad_buttons(changes)
        held = _held_actions(keyboard.held - _TAKE_KEYS if take else keyboard.held, pad, buttons)
        pressed = self._pressed(keyboard, pad, take, buttons)
        move, look = _key_axes(held)
        if pad is not None:
            stick = radial_dead_zone(pad.left, dead_zone)
            move = stick if stick != (0.0, 0.0) else move
            turn = radial_dead_zone(pad.right, dead_zone)
            look = turn if turn != (0.0, 0.0) else look
        return Intent(
            move=move,
            look=(look[0], -look[1] if invert else look[1]),
            zoom=ZOOM_STEPS_PER_S * ((Action.ZOOM_IN in held) - (Action.ZOOM_OUT in held)),
            gait=self._gait(held, pressed, pad, dt),
            strafe=Action.STRAFE in held,
            pressed=pressed,
        )

    def _pressed(
        self, keyboard: Keyboard, pad: GamepadState | None, take: bool, bound: Mapping[Action, str]
    ) -> tuple[Action, ...]:
        keys = keyboard.take_pressed()
        buttons = pad.buttons if pad is not None else frozenset()
        fresh = buttons - self._last_buttons
        self._last_buttons = buttons
        from_keys = [
            action
            for key in keys
            for action in Action
            if (key == action.take_key if take and key in _TAKE_KEYS else key in action.keys)
        ]
        from_pad = [action for action, button in bound.items() if button in fresh]
        return tuple(from_keys + from_pad)

    def _gait(
        self, held: frozenset[Action], pressed: tuple[Action, ...], pad: GamepadState | None, dt: float
    ) -> Gait:
        for action in pressed:
            if action is Action.CROUCH:
                self.crouching = not self.crouching
            elif action is Action.JUMP:
                self._jump_left_s = JUMP_PRESS_S
        self._release_crouch(Action.CROUCH in held, dt)
        jumping = self._jump_left_s > 0.0
        self._jump_left_s = max(self._jump_left_s - dt, 0.0)
        if jumping:
            return Gait.JUMP
        if self.crouching:
            return Gait.CROUCH
        trigger = pad is not None and pad.right_trigger > TRIGGER_PRESSED_FRACTION
        return Gait.JOG if trigger or Action.JOG in held else Gait.WALK

    def _release_crouch(self, held: bool, dt: float) -> None:
        """Stand up when a crouch key that was held for some time is let go."""
        if not held and self._crouch_held_s > HOLD_S:
            self.crouching = False
        self._crouch_held_s = self._crouch_held_s + dt if held else 0.0


def _held_actions(held: Set[str], pad: GamepadState | None, bound: Mapping[Action, str]) -> frozenset[Action]:
    buttons = pad.buttons if pad is not None else frozenset()
    by_pad = [action for action, button in bound.items() if button in buttons]
    return frozenset([*by_pad, *(a for a in Action if not held.isdisjoint(a.keys))])


def _key_axes(held: frozenset[Action]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return move and look of the held keys; diagonals keep unit length."""

    def axis(towards: Action, back: Action) -> float:
        return float((towards in held) - (back in held))

    x, y = axis(Action.RIGHT, Action.LEFT), axis(Action.FORWARD, Action.BACK)
    length = max(math.hypot(x, y), 1.0)
    look = axis(Action.LOOK_RIGHT, Action.LOOK_LEFT), axis(Action.LOOK_UP, Action.LOOK_DOWN)
    return (x / length, y / length), look


def to_controls(intent: Intent, heading: float) -> Controls:
    """Return the world-space controls of an intent seen by a camera that looks along yaw `heading` (0 is +Z, positive to +X)."""
    forward = (math.sin(heading), math.cos(heading))
    right = (-forward[1], forward[0])  # Y up, right-handed: facing +Z, the right hand is at -X
    x, y = intent.move
    move = (right[0] * x + forward[0] * y, right[1] * x + forward[1] * y)
    return Controls(move=move, facing=forward if intent.strafe else None, gait=intent.gait)
