"""Keys, pads and scripts become the commands that drive the character."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import Gait
from runtime.errors import UsageError
from viewer.input.bindings import (
    BUTTONS,
    HOLD_S,
    JUMP_PRESS_S,
    KEYS,
    Action,
    InputMapper,
    Intent,
    Keyboard,
    bound,
    help_text,
    rebound,
    to_controls,
)
from viewer.input.devices import KeyScript
from viewer.input.gamepad import GamepadState, GlfwGamepads, radial_dead_zone

KNOWN_KEYS = frozenset({"w", "a", "s", "d", "shift", "r"})
DT = 1 / 60


def pressed_keys(*names: str) -> Keyboard:
    keyboard = Keyboard()
    for name in names:
        keyboard.key(name, True)
    return keyboard


axis = st.floats(-1.0, 1.0, allow_nan=False)


@given(axis, axis, st.floats(0.01, 0.5))
def test_dead_zone_keeps_direction_and_rises_from_zero_to_one(x: float, y: float, dead: float) -> None:
    out = radial_dead_zone((x, y), dead)
    length, before = math.hypot(*out), math.hypot(x, y)
    assert length <= 1.0 + 1e-9
    if before <= dead:
        assert out == (0.0, 0.0)
    else:
        assert out[0] * y == pytest.approx(out[1] * x, abs=1e-9)
        assert out[0] * x + out[1] * y > 0
    if before >= 1.0:
        assert length == pytest.approx(1.0)


def test_dead_zone_refuses_numbers_that_are_not_finite() -> None:
    assert radial_dead_zone((math.nan, 0.5), 0.1) == (0.0, 0.0)
    assert radial_dead_zone((math.inf, 0.5), 0.1) == (0.0, 0.0)


@given(st.floats(-10, 10))
def test_forward_goes_where_the_camera_looks_and_right_is_to_its_right(heading: float) -> None:
    forward = np.array(to_controls(Intent(move=(0.0, 1.0)), heading).move)
    right = np.array(to_controls(Intent(move=(1.0, 0.0)), heading).move)
    assert forward == pytest.approx([math.sin(heading), math.cos(heading)])
    # Y up, right-handed: forward x right = -Y, so looking along +Z the right hand is at -X
    up = np.cross([right[0], 0, right[1]], [forward[0], 0, forward[1]])
    assert up == pytest.approx([0, 1, 0])


def test_strafe_faces_the_camera_direction() -> None:
    assert to_controls(Intent(move=(1.0, 0.0)), 0.0).facing is None
    assert to_controls(Intent(move=(1.0, 0.0), strafe=True), 0.0).facing == pytest.approx((0.0, 1.0))


@pytest.mark.parametrize(
    ("keys", "move", "gait"),
    [
        ("w", (0.0, 1.0), Gait.WALK),
        ("w shift", (0.0, 1.0), Gait.JOG),
        ("w d", (0.5**0.5, 0.5**0.5), Gait.WALK),  # no faster than one
        ("w s", (0.0, 0.0), Gait.WALK),
    ],
)
@pytest.mark.parametrize("resting", [None, GamepadState("pad", left=(0.05, -0.04), right=(0.02, 0.0))])
def test_keys_walk_beside_a_pad_that_rests(
    keys: str, move: tuple[float, float], gait: Gait, resting: GamepadState | None
) -> None:
    intent = InputMapper().read(pressed_keys(*keys.split(" ")), resting, DT)
    assert intent.move == pytest.approx(move)
    assert intent.gait is gait


def test_keys_of_a_shortcut_do_nothing_of_their_own() -> None:
    keyboard, mapper = pressed_keys("w", "ctrl", "c", "r", "s"), InputMapper()
    intent = mapper.read(keyboard, None, DT)
    assert (intent.gait, intent.move, mapper.crouching) == (Gait.WALK, (0.0, 1.0), False)
    assert intent.pressed == (Action.FORWARD,)
    keyboard.key("f12", True)
    assert mapper.read(keyboard, None, DT).pressed == (Action.SCREENSHOT,)


def test_a_crouch_key_that_is_held_stands_up_when_it_is_let_go() -> None:
    mapper, keyboard = InputMapper(), pressed_keys("c")
    frames = round(2 * HOLD_S / DT)
    assert {mapper.read(keyboard, None, DT).gait for _ in range(frames)} == {Gait.CROUCH}
    keyboard.key("c", False)
    assert mapper.read(keyboard, None, DT).gait is Gait.WALK


def test_crouch_is_a_toggle_and_jump_lasts() -> None:
    mapper, keyboard = InputMapper(), pressed_keys("c")
    assert mapper.read(keyboard, None, DT).gait is Gait.CROUCH
    keyboard.key("c", False)
    assert mapper.read(keyboard, None, DT).gait is Gait.CROUCH
    keyboard.key("space", True)
    keyboard.key("space", False)  # both within one frame
    frames = [mapper.read(keyboard, None, DT).gait for _ in range(round(JUMP_PRESS_S * 60) + 3)]
    assert frames.count(Gait.JUMP) == pytest.approx(JUMP_PRESS_S * 60, abs=1)
    assert frames[-1] is Gait.CROUCH
    keyboard.key("c", True)
    assert mapper.read(keyboard, None, DT).gait is Gait.WALK


def test_pad_drives_everything() -> None:
    mapper, keyboard = InputMapper(), Keyboard()
    held = {"right_trigger": 1.0, "buttons": frozenset({"left_bumper"})}
    pad = GamepadState("pad", left=(0.0, 1.0), right=(0.6, 0.0), **held)
    intent = mapper.read(keyboard, pad, DT)
    assert intent.move == pytest.approx((0.0, 1.0))
    assert intent.gait is Gait.JOG
    assert intent.strafe
    assert 0.0 < intent.look[0] < 1.0
    button = GamepadState("pad", buttons=frozenset({"y"}))
    assert mapper.read(keyboard, button, DT).pressed == (Action.RECORD,)
    assert mapper.read(keyboard, button, DT).pressed == ()  # held, not pressed again
    assert mapper.read(keyboard, None, DT).pressed == ()  # unplugged
    assert mapper.read(keyboard, button, DT).pressed == (Action.RECORD,)


def test_typing_does_not_drive_but_function_keys_work() -> None:
    keyboard = Keyboard()
    keyboard.key("w", True, typing=True)
    keyboard.key("f1", True, typing=True)
    assert keyboard.held == {"f1"}
    assert keyboard.take_pressed() == ["f1"]
    keyboard.key("f1", False, typing=True)
    assert not keyboard.held


def test_a_take_has_some_keys_while_it_is_shown() -> None:
    intent = InputMapper().read(pressed_keys("space", "left", "home", "w"), None, DT, take=True)
    assert set(intent.pressed) == {Action.PLAY, Action.FRAME_BACK, Action.FIRST_FRAME, Action.FORWARD}
    assert intent.look == (0.0, 0.0)
    assert intent.gait is Gait.WALK
    assert intent.move == (0.0, 1.0)


def test_script_holds_chords_for_their_time() -> None:
    script = KeyScript.parse("w 0.5; W+Shift 1; idle 0.25; r 0.1;", KNOWN_KEYS)
    assert script.keys_at(1.8) == {"r"}
    assert script.keys_at(1.85) == frozenset()
    assert script.keys_at(0.0) == {"w"}
    assert script.keys_at(0.5) == {"w", "shift"}
    assert script.keys_at(1.6) == frozenset()
    assert script.keys_at(1.8) == {"r"}
    assert script.keys_at(99.0) == frozenset()


@pytest.mark.parametrize(
    ("text", "part"), [("w", "w"), ("w x", "x"), ("w -1", "-1"), ("w nan", "nan"), ("q 1", "q")]
)
def test_a_bad_script_names_its_step(text: str, part: str) -> None:
    with pytest.raises(UsageError, match=f'"{part}"'):
        KeyScript.parse(text, KNOWN_KEYS)


class StubGlfw:
    """Two joysticks: 0 has a mapping, 1 has not."""

    JOYSTICK_LAST = 3

    def __init__(self) -> None:
        self.present = {0: True, 1: False}
        self.axes = [0.0, -1.0, 0.0, 0.0, -1.0, -1.0]
        self.buttons = [0] * 15
        self.raw = [0.0, 0.0, -1.0, 0.0, 0.0, -1.0]
        self.mappings = ""

    def joystick_present(self, pad: int) -> bool:
        return self.present.get(pad, False)

    def joystick_is_gamepad(self, pad: int) -> bool:
        return pad == 0

    def get_gamepad_state(self, pad: int) -> SimpleNamespace:
        return SimpleNamespace(axes=self.axes, buttons=self.buttons)

    def get_gamepad_name(self, pad: int) -> bytes:
        return b"Test Pad"

    def get_joystick_name(self, pad: int) -> bytes:
        return b"Odd Pad"

    def get_joystick_axes(self, pad: int) -> tuple[list[float], int]:
        return self.raw, len(self.raw)

    def get_joystick_buttons(self, pad: int) -> tuple[list[int], int]:
        return [0] * 10, 10

    def update_gamepad_mappings(self, text: str) -> int:
        self.mappings += text
        return 1


def test_pads_come_and_go_and_the_touched_one_drives() -> None:
    glfw = StubGlfw()
    pads = GlfwGamepads(glfw)
    state = pads.poll()
    assert (state.name, state.left, state.right_trigger) == ("Test Pad", (0.0, 1.0), 0.0)
    glfw.present[1], glfw.axes[1] = True, 0.0
    pads.poll()
    glfw.raw[1] = -0.9
    raw = pads.poll()
    assert raw.name.startswith("Odd Pad")
    assert raw.left == pytest.approx((0.0, 0.9))
    glfw.present = {}
    assert pads.poll() is None


def test_a_raw_axis_that_never_rests_is_ignored() -> None:
    glfw = StubGlfw()
    glfw.present = {1: True}
    glfw.raw[0] = -1.0  # dead: always at its end
    assert GlfwGamepads(glfw).poll().left == (0.0, 0.0)


@pytest.mark.parametrize("axis", [2, 5])
def test_a_raw_trigger_counts_once_it_was_seen_released(axis: int) -> None:
    glfw = StubGlfw()
    glfw.present = {1: True}
    glfw.raw = [0.0] * 6  # something else at the place of the triggers: it rests in its middle
    pads, mapper = GlfwGamepads(glfw), InputMapper()
    for value in (0.0, 1.0, -0.5):
        glfw.raw[axis] = value
        state = pads.poll()
        assert (state.left_trigger, state.right_trigger, state.touched) == (0.0, 0.0, False)
        assert mapper.read(pressed_keys("w"), state, DT).gait is Gait.WALK
    glfw.raw[axis] = -1.0  # a trigger: let go
    pads.poll()
    glfw.raw[axis] = 0.0
    state = pads.poll()
    assert (state.left_trigger, state.right_trigger) == ((0.5, 0.0) if axis == 2 else (0.0, 0.5))
    glfw.present = {}
    pads.poll()
    glfw.present = {1: True}  # another pad in its place has to show it again
    state = pads.poll()
    assert not state.touched


def test_a_raw_pad_of_four_axes_has_no_triggers() -> None:
    glfw = StubGlfw()
    glfw.present, glfw.raw = {1: True}, [0.0] * 4
    pads = GlfwGamepads(glfw)
    pads.poll()
    glfw.raw[2] = 0.8  # the right stick
    state = pads.poll()
    assert (state.right, state.left_trigger, state.right_trigger) == ((0.8, 0.0), 0.0, 0.0)


def test_a_persons_mappings_are_added_and_garbage_is_named(tmp_path: Path) -> None:
    glfw, pads = StubGlfw(), GlfwGamepads(StubGlfw())
    assert pads.add_mappings(tmp_path / "missing.txt") == ""
    file = tmp_path / "gamecontrollerdb.txt"
    file.write_text("# mine\n03000000,Pad,a:b0,platform:Linux,\nrubbish\n", encoding="utf-8")
    pads = GlfwGamepads(glfw)
    assert "1 lines" in pads.add_mappings(file)
    assert "03000000,Pad" in glfw.mappings
    assert "rubbish" not in glfw.mappings


@pytest.mark.parametrize(
    ("table", "action", "key", "changes", "had", "text", "said"),
    [
        (BUTTONS, Action.JUMP, "b", "jump=b crouch=a", [Action.CROUCH], "{crouch} (hold)", "A (hold)"),
        (KEYS, Action.JUMP, "g", "jump=g", [], "{jump}", "G"),
        (KEYS, Action.JUMP, "c", "jump=c crouch=space", [Action.CROUCH], "{crouch}", "Space"),
        # a key of a take may do something else in the view
        (KEYS, Action.TRIM_IN, "w", "trim_in=w", [], "{trim_in} {forward}", "W W"),
        (KEYS, Action.TRIM_IN, "k", "stop_playing=i trim_in=k", [Action.STOP_PLAYING], "{trim_in}", "K"),
    ],
)  # fmt: skip
def test_keys_and_buttons_are_chosen_and_exchanged(
    table: dict[Action, str], action: Action, key: str, changes: str, had: list[Action], text: str, said: str
) -> None:
    made, others = rebound(table, "", action, key)
    assert (set(made.split()), others) == (set(changes.split()), had)
    assert bound(table, f"{made} nothing=at all=1 record=none")[Action.RECORD] == table[Action.RECORD]
    assert help_text(text, table, made) == said
    for other in had:
        made, _ = rebound(table, made, other, key)
    assert made == "" if had else made


def test_a_chosen_key_is_the_only_one_of_its_action_and_its_alone() -> None:
    def gait(key: str, take: bool = False) -> tuple[Gait, tuple[Action, ...]]:
        keyboard = Keyboard()
        keyboard.key(key, True)
        intent = InputMapper().read(keyboard, None, DT, take=take, keys="jump=equal trim_in=w")
        return intent.gait, intent.pressed

    assert gait("equal") == (Gait.JUMP, (Action.JUMP,))  # no longer one of the keys that zoom
    assert gait("space") == (Gait.WALK, ())
    assert gait("w", take=True)[1] == (Action.TRIM_IN,)
    assert gait("w")[1] == (Action.FORWARD,)
    pad = GamepadState("pad", buttons=frozenset({"b"}))
    assert InputMapper().read(Keyboard(), pad, DT, buttons="jump=b crouch=a").gait is Gait.JUMP
