"""The card of the selected pin over the view, and the row of the scene panel that pins the live character."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from runtime.takes.pins import Pin, Pinned
from viewer.edit.pins import Pins, shown_end
from viewer.gl_bindings import imgui
from viewer.gui import panels, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px

WIDTH, SMALL_WIDTH = 214.0, 158.0  # pixels at scale 1
SMALL_VIEW = 520.0  # in a narrower one the card is small, so that it hides nobody
MIN_VIEW = 230.0
LIVE = (Pinned.LEFT_HAND, Pinned.RIGHT_HAND, Pinned.LEFT_FOOT, Pinned.RIGHT_FOOT, Pinned.LOOK)


def panel(pins: Pins) -> Panel:
    """The card, while a pin is selected; Escape closes it."""
    return Panel(
        "Pin", PanelPlace.VIEW, lambda view: _card(pins, view), shown=lambda: pins.pin is not None,
        close=pins.close,
    )  # fmt: skip


def draw_live(pins: Pins, key_camera: Callable[[], None], width: float) -> None:
    """A button for what the live character holds; chosen parts are pinned where they are, and dragged in the view."""
    held = [pin.what for pin in pins.pins] if pins.live else []
    imgui.begin_disabled(not pins.live)
    hint = "A hand, a foot or the look stays at a point, which is dragged in the view"
    if widgets.toggle("Hold…" if not held else f"Holds {len(held)}", bool(held), width, hint) != bool(held):
        imgui.open_popup("hold")
    imgui.end_disabled()
    if imgui.begin_popup("hold"):
        for what in LIVE:
            if imgui.menu_item(str(what).capitalize(), "", what in held)[0]:
                pins.toggle_live(what)
        imgui.separator()
        if imgui.menu_item("Key the camera", "", False)[0]:
            key_camera()
        imgui.end_popup()


def _card(pins: Pins, view: Rect) -> None:
    pin = pins.pin
    if pin is None or view.width < px(MIN_VIEW):
        return
    with panels.card("Pin", view, SMALL_WIDTH if view.width < px(SMALL_VIEW) else WIDTH, right=True):
        remove = "Let go" if pins.live else "Remove the pin"
        pressed = panels.card_title(str(pin.what).capitalize(), "pin", remove)
        if pin.what is not Pinned.POSE:
            _points(pins, pin)
        if not pins.live:
            _times(pins, pin)
            far = 0.0 if pins.editor.dragging else pins.reach()
            if far:
                widgets.muted(f"{far:.2f} m out of reach at worst", wrap=True)
        if pressed:
            (pins.delete if pressed == "remove" else pins.close)()


def _points(pins: Pins, pin: Pin) -> None:
    """Where it is, by numbers; the handles in the view do the same."""
    x, y, z = _triple(pins, pin, "point", pin.point)
    pins.try_change(lambda: replace(pin, point=(x, y, z)))
    half = widgets.column_width(2)
    hint = "The point goes along with the character instead of staying in the world"
    if widgets.toggle("Along", pin.along, half, hint) != pin.along:
        pins.put_along(pin, not pin.along)
    widgets.same_line()
    rails = pin.what not in (Pinned.LOOK, Pinned.LEFT_FOOT, Pinned.RIGHT_FOOT)
    imgui.begin_disabled(not rails)
    hint = "It slides along a straight rail to a second point"
    if widgets.toggle("Rail", pin.rail is not None, half, hint) != (pin.rail is not None):
        pins.put_rail(pin, pin.rail is None)
    imgui.end_disabled()
    current = pins.pin
    if current is not None and current.rail is not None:
        x, y, z = _triple(pins, current, "rail", current.rail)
        pins.try_change(lambda: replace(current, rail=(x, y, z)))


def _triple(pins: Pins, pin: Pin, name: str, value: tuple[float, float, float]) -> tuple[float, ...]:
    changed = []
    third = widgets.column_width(3)
    hints = ("To its left" if pin.along else "X", "Up", "Ahead" if pin.along else "Z")
    for number, (axis, hint) in enumerate(zip("xyz", hints, strict=True)):
        if number:
            widgets.same_line()
        imgui.set_next_item_width(third)
        _, entry = imgui.drag_float(f"##pin {name} {axis}", value[number], 0.005, -1000.0, 1000.0, "%.2f")
        widgets.tooltip(f"{hint}, metres. Drag, or double-click to type.")
        changed.append(entry if abs(entry - value[number]) > 1e-6 else value[number])
    return tuple(changed)


def _times(pins: Pins, pin: Pin) -> None:
    """From which frame to which, and how slowly it comes and goes."""
    playback = pins.playback
    if playback is None:
        return
    clip = playback.clip
    fps, last = clip.fps, len(clip) - 1
    half = widgets.column_width(2)
    first, end = round(pin.start * fps), round(shown_end(pin, clip) * fps)
    imgui.set_next_item_width(half)
    _, new_first = imgui.drag_int("##pin from", first, 0.3, 0, end, "from %d")
    widgets.tooltip("The first frame in which it holds fully")
    widgets.same_line()
    imgui.set_next_item_width(half)
    _, new_end = imgui.drag_int("##pin to", end, 0.3, first, last, "to %d")
    widgets.tooltip("The last frame in which it holds fully")
    imgui.set_next_item_width(half)
    _, ease_in = imgui.drag_float("##pin in", pin.ease_in, 0.005, 0.0, 5.0, "in %.2f s")
    widgets.tooltip("How long it comes before")
    widgets.same_line()
    imgui.set_next_item_width(half)
    _, ease_out = imgui.drag_float("##pin out", pin.ease_out, 0.005, 0.0, 5.0, "out %.2f s")
    widgets.tooltip("How long it goes after")
    now = pins.pin
    eased = abs(ease_in - pin.ease_in) + abs(ease_out - pin.ease_out) > 1e-6
    if now is None or not (eased or (new_first, new_end) != (first, end)):
        return
    start = new_first / fps if new_first != first else pin.start
    stop = new_end / fps if new_end != end else pin.end
    pins.try_change(
        lambda: replace(
            now, start=start, end=max(stop, start), ease_in=max(ease_in, 0.0), ease_out=max(ease_out, 0.0)
        )
    )
