"""Key and button bindings: one table used by the input mapper and the help overlay."""

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import lru_cache

from runtime.controls import Controls, Gait
from viewer.input.gamepad import GamepadState, radial_dead_zone

ZOOM_STEPS_PER_S = 9.0  # wheel steps per second of a held key
HOLD_S = 0.35  # releasing a crouch key held longer stands up
JUMP_PRESS_S = 0.05  # minimum length of a press, so that one shorter than a simulation step is not lost
TRIGGER_PRESSED_FRACTION = 0.3


# Keys that work while a text field has the focus, since they type nothing.
NEVER_TYPED = frozenset(f"f{i}" for i in range(1, 13))
MODIFIERS = frozenset({"ctrl", "shift", "alt"})


@dataclass
class Keyboard:
    """The keys that are down, and those pressed since the last `take_pressed`, by name: "w", "shift", "f1"."""

    held: set[str] = field(default_factory=set)
    _pressed: list[str] = field(default_factory=list)

    def key(self, name: str, down: bool, typing: bool = False) -> None:
        """Handle a key event; while `typing`, only keys that produce no text count.

        Keys pressed while Ctrl is down belong to shortcuts (Ctrl+Z) and are ignored.
        """
        if not down:
            self.held.discard(name)
        elif "ctrl" in self.held and name not in NEVER_TYPED | MODIFIERS:
            return
        elif not typing or name in NEVER_TYPED:
            self.held.add(name)
            self._pressed.append(name)

    def release_all(self) -> None:
        """Release every key, when the window loses the focus or a text field takes it."""
        self.held.clear()

    def take_pressed(self) -> list[str]:
        """Return the names of the keys pressed since the last call, in order."""
        pressed, self._pressed = self._pressed, []
        return pressed


class Action(Enum):
    """Everything that a key or button can do, with its triggers: any of `keys`, or the gamepad's `button`.

    While a take plays, `take_key` has priority. HELD actions act while down, the others once per press, through the
    `actions` of their tool.
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


# views of the character, in the order of `viewer.scene.camera_control.VIEWS`
VIEW_ACTIONS = (Action.FRONT, Action.SIDE, Action.THREE_QUARTERS, Action.FEET, Action.TOP)


class Drag(Enum):
    ORBIT = auto()
    PAN = auto()
    ZOOM = auto()


# Mouse drags by button and modifier, as in several programs; the right button always orbits.
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

BUTTON_NAMES = {
    "a": "A", "b": "B", "x": "X", "y": "Y", "left_bumper": "Left shoulder", "right_bumper": "Right shoulder",
    "back": "Back", "start": "Start", "left_thumb": "Left stick press", "right_thumb": "Right stick press",
    "dpad_up": "D-pad up", "dpad_down": "D-pad down", "dpad_left": "D-pad left", "dpad_right": "D-pad right",
}  # fmt: skip


KEY_TEXTS = {
    **{letter: letter.upper() for letter in "abcdefghijklmnopqrstuvwxyz"},
    **{digit: digit for digit in "0123456789"},
    **{f"f{i}": f"F{i}" for i in range(1, 13)},
    **{f"kp_{name}": f"Numpad {name}" for name in ("0", "1", "3", "7", "decimal")},
    "space": "Space", "enter": "Enter", "tab": "Tab", "shift": "Shift", "alt": "Alt", "left": "Left", "right": "Right",
    "up": "Up", "down": "Down", "home": "Home", "end": "End", "page_up": "Page Up", "page_down": "Page Down",
    "equal": "=", "minus": "-", "comma": "comma", "period": "full stop",
}  # fmt: skip
BUTTONS = {action: action.button for action in Action if action.button}
KEYS = {action: (*action.keys, action.take_key)[0] for action in Action}


def bound(table: Mapping[Action, str], changes: str) -> dict[Action, str]:
    """Return `BUTTONS` or `KEYS` with changes such as "jump=x crouch=a"; unknown words are ignored."""
    made, by_name = dict(table), {action.name.lower(): action for action in table}
    names = BUTTON_NAMES if table is BUTTONS else KEY_TEXTS
    for change in changes.split():
        name, _, key = change.partition("=")
        if name in by_name and key in names:
            made[by_name[name]] = key
    return made


def rebound(table: Mapping[Action, str], changes: str, action: Action, key: str) -> tuple[str, list[Action]]:
    """Return the changes with a new key or button for an action, and the actions that had it, which get the old one."""
    made = bound(table, changes)
    had = [
        other for other, theirs in made.items()
        if theirs == key and other is not action and bool(other.keys) is bool(action.keys)
    ]  # fmt: skip
    made.update({**dict.fromkeys(had, made[action]), action: key})
    return " ".join(f"{a.name.lower()}={b}" for a, b in made.items() if table[a] != b), had


@lru_cache(8)
def key_tables(changes: str = "") -> tuple[dict[Action, frozenset[str]], dict[str, Action]]:
    """Return the keys of each action in the view, and the actions of keys with priority while a take plays.

    A key chosen by the user is its action's only key, and belongs to that action alone.
    """
    own = bound(KEYS, changes)
    in_view = [action for action in Action if action.keys]
    chosen = {action: own[action] for action in in_view if own[action] != KEYS[action]}
    view = {
        action: frozenset({chosen[action]} if action in chosen else {*action.keys} - {*chosen.values()})
        for action in in_view
    }
    take = {action.take_key if action.keys else own[action]: action for action in Action if action.take_key}
    return view, take


# The help overlay: heading, then rows of action, keyboard and mouse, gamepad; {action} is replaced by its key or button.
HELP: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    ("Move", (
        ("Walk", "{forward}  {left}  {back}  {right}", "Left stick"),
        ("Jog", "{jog} (hold)", "Right trigger"),
        ("Crouch", "{crouch} (press or hold)", "{crouch} (press or hold)"),
        ("Jump", "{jump}", "{jump}"),
        ("Strafe, face the camera", "X or Alt (hold)", "{strafe} (hold)"),
        ("Back to the start", "{reset}", "{reset}"),
    )),
    ("Camera", (
        ("Turn", "Q  E, arrows, right drag", "Right stick"),
        ("Pan, orbit", "Middle drag, Shift+middle", ""),
        ("Zoom", "Wheel, Page Up / Down", "{zoom_in}, {zoom_out}"),
        ("Follow or orbit", "{camera}", "{camera}"),
        ("Front, side, 3/4, feet, top", "{front}, {side}, {three_quarters}, {feet}, {top}", ""),
        ("Frame the selection, the character", "{frame_selection}, {frame}", ""),
    )),
    ("Record", (
        ("Start or stop", "{record}", "{record}"),
        ("Keep the last seconds", "{save_last}", "{save_last}"),
        ("Play or pause the clip", "{play}, or Space while it plays", ""),
        ("One frame back, one forward", "Left, Right, or {frame_back}, {frame_on}", ""),
        ("First frame, last frame", "{first_frame}, {last_frame}", ""),
        ("Reverse, stop, play (again: faster)", "{play_backwards}, {stop_playing}, {play_forwards}", ""),
        ("In, out, key", "{trim_in}, {trim_out}, {key_pose}", ""),
        ("Timeline: zoom, scroll, fit", "Wheel, Shift+wheel, {fit_timeline}", ""),
        ("Delete, copy, cut, paste, duplicate", "Del, Ctrl+C, X, V, D", ""),
        ("Move, select all, deselect", "Left / Right, Ctrl+A, Esc", ""),
        ("Screenshot", "{screenshot}", ""),
    )),
    ("Show", (
        ("This help", "{help}", "{help}"),
        ("Trajectory, skeleton, contacts", "{trajectory}, {skeleton}, {contacts}", ""),
        ("Grid, panels", "{grid}, {panels}", "{panels} (panels)"),
        ("Full screen", "{fullscreen}", ""),
        ("Next panel, back to the view", "{next_panel}, Esc", ""),
        ("Session: save, save as, open", "Ctrl+S, Ctrl+Shift+S, Ctrl+O", ""),
        ("Export in any format", "Ctrl+E", ""),
    )),
    ("Prompt", (
        ("Write a prompt, leave the field", "{prompt}, Esc", ""),
        ("Choose a suggestion, accept it", "Up / Down, Tab or Enter", ""),
        ("Last prompts, in an empty field", "Up / Down", ""),
        ("Compare side by side", "{compare}", ""),
        ("Undo, redo", "Ctrl+Z, Ctrl+Y", ""),
    )),
)  # fmt: skip


def help_text(text: str, table: Mapping[Action, str], changes: str) -> str:
    """Return a help text with its placeholders replaced by the keys or buttons in use."""
    names = BUTTON_NAMES if table is BUTTONS else KEY_TEXTS
    shown = {action.name.lower(): names[key] for action, key in bound(table, changes).items()}
    return text.format_map(shown).replace("D-pad up, D-pad down", "D-pad up / down")


@dataclass(frozen=True)
class Intent:
    """The user's input in one frame, relative to the camera.

    `move` is (right, forward) and `look` the camera stick (right, up), both of length 0..1; `zoom` is in wheel steps
    per second (positive is closer); `pressed` are the actions that began in this frame.
    """

    move: tuple[float, float] = (0.0, 0.0)
    look: tuple[float, float] = (0.0, 0.0)
    zoom: float = 0.0
    gait: Gait = Gait.WALK
    strafe: bool = False
    pressed: tuple[Action, ...] = ()


@dataclass
class InputMapper:
    """Converts device input to an `Intent`; remembers the crouch toggle, the running jump and the gamepad's last buttons."""

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
        listed: bool = False,
        buttons: str = "",
        keys: str = "",
    ) -> Intent:
        """Return the intent of a frame of `dt` seconds.

        `take`: a take is shown, and some keys move its playhead; `listed`: a take is selected in the list, and the play
        key plays it; `buttons` and `keys` are the user's changes, see `bound`.
        """
        by_view, by_take = key_tables(keys)
        if not take:
            by_take = {key: act for key, act in by_take.items() if listed and act is Action.PLAY}
        pad_buttons = bound(BUTTONS, buttons)
        held = _held_actions(keyboard.held - by_take.keys(), by_view, pad, pad_buttons)
        pressed = self._pressed(keyboard, by_view, by_take, pad, pad_buttons)
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
        self,
        keyboard: Keyboard,
        by_view: Mapping[Action, Set[str]],
        by_take: Mapping[str, Action],
        pad: GamepadState | None,
        pad_buttons: Mapping[Action, str],
    ) -> tuple[Action, ...]:
        buttons = pad.buttons if pad is not None else frozenset()
        fresh = buttons - self._last_buttons
        self._last_buttons = buttons
        from_keys = [
            action
            for key in keyboard.take_pressed()
            for action in (
                [by_take[key]] if key in by_take else [a for a, keys in by_view.items() if key in keys]
            )
        ]
        from_pad = [action for action, button in pad_buttons.items() if button in fresh]
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
        if not held and self._crouch_held_s > HOLD_S:
            self.crouching = False
        self._crouch_held_s = self._crouch_held_s + dt if held else 0.0


def _held_actions(
    held: Set[str],
    by_view: Mapping[Action, Set[str]],
    pad: GamepadState | None,
    pad_buttons: Mapping[Action, str],
) -> frozenset[Action]:
    buttons = pad.buttons if pad is not None else frozenset()
    by_pad = [action for action, button in pad_buttons.items() if button in buttons]
    return frozenset([*by_pad, *(action for action, keys in by_view.items() if not held.isdisjoint(keys))])


def _key_axes(held: frozenset[Action]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return move and look of the held keys; diagonals keep unit length."""

    def axis(towards: Action, back: Action) -> float:
        return float((towards in held) - (back in held))

    x, y = axis(Action.RIGHT, Action.LEFT), axis(Action.FORWARD, Action.BACK)
    length = max(math.hypot(x, y), 1.0)
    look = axis(Action.LOOK_RIGHT, Action.LOOK_LEFT), axis(Action.LOOK_UP, Action.LOOK_DOWN)
    return (x / length, y / length), look


def to_controls(intent: Intent, heading: float) -> Controls:
    """Return the world-space controls for an intent, with the camera looking along yaw `heading` (0 is +Z, positive to +X)."""
    forward = (math.sin(heading), math.cos(heading))
    right = (-forward[1], forward[0])  # Y up, right-handed: facing +Z, the right hand is at -X
    x, y = intent.move
    move = (right[0] * x + forward[0] * y, right[1] * x + forward[1] * y)
    return Controls(move=move, facing=forward if intent.strafe else None, gait=intent.gait)
