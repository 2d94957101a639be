"""The status line: the last message on the left, the machine on the right."""

from __future__ import annotations

from sport.viewer.gl_bindings import imgui
from sport.viewer.gui import theme, widgets
from sport.viewer.gui.theme import ICON, Fonts
from sport.viewer.gui.widgets import px
from sport.viewer.messages import Level
from sport.viewer.state import AppState

_LOOKS = {
    Level.NOTE: (ICON.note, theme.ACCENT),
    Level.WARNING: (ICON.warning, theme.WARNING),
    Level.ERROR: (ICON.error, theme.ERROR),
}
MIN_MESSAGE_WIDTH = 260.0


def draw(state: AppState, fonts: Fonts) -> None:
    """Contents of the line; facts drop off from the left when the window is narrow."""
    width = imgui.get_content_region_avail().x
    facts = _facts(state)
    gap = px(18)
    while facts and _width(facts, gap) > width - px(MIN_MESSAGE_WIDTH):
        facts.pop(0)
    facts_width = _width(facts, gap)
    _message(state, width - facts_width - gap)
    imgui.same_line(width - facts_width + imgui.get_style().window_padding.x)
    for i, (text, hint) in enumerate(facts):
        if i:
            imgui.same_line(0, gap)
        widgets.muted(text)
        widgets.tooltip(hint)


def _width(facts: list[tuple[str, str]], gap: float) -> float:
    return sum(imgui.calc_text_size(text).x for text, _ in facts) + gap * max(len(facts) - 1, 0)


def _facts(state: AppState) -> list[tuple[str, str]]:
    """What is known about model, speed and device, the most important last."""
    stats, simulation = state.stats, state.simulation
    model = f"{ICON.chip} {state.model_name or 'no model'}"
    if state.provider:
        model += f"  {state.provider}"
    icon = ICON.keyboard if state.device == "keyboard" else ICON.gamepad
    return [
        (model, "The motion model and what runs it"),
        (f"model {simulation.model_ms:.1f} ms", "Time of one step of the model, with foot lock"),
        (f"frame {stats.frame_ms:.0f} ms", "Work of one displayed frame"),
        (f"{stats.fps:.0f} fps", "Pictures shown a second, by the clock"),
        (
            f"sim {stats.steps_per_s:.0f} Hz",
            "Steps of the simulation a second, by the clock; 60 is real time",
        ),
        (f"{icon} {state.device[:24]}", "The device that drives the character"),
    ]


def _message(state: AppState, width: float) -> None:
    message = state.messages.current
    if message is None:
        text = "W A S D or the left stick to move,  F1 for all controls"
        widgets.muted(widgets.elided(f"{ICON.help} {text}", width))
        return
    icon, color = _LOOKS[message.level]
    with widgets.color(imgui.Col_.text, color):
        imgui.text_unformatted(icon)
        imgui.same_line(0, px(5))
    plain = theme.TEXT if message.level is Level.NOTE else color
    with widgets.color(imgui.Col_.text, plain):
        shown = widgets.elided(message.text, width - px(26))
        imgui.text_unformatted(shown)
    if shown != message.text and imgui.is_item_hovered():
        widgets.tooltip(message.text)
