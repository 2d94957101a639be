"""The graph editor: pose and camera curves over the frames of a take, with keys to select, drag and ease."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from runtime.arrays import Array
from runtime.errors import SportError
from runtime.takes.key_curves import CAMERA_AXES, POSE_AXES, Channel, Curve, CurveKey, KeyedCurves, span_of
from runtime.takes.pose_layer import MAX_EASE_S, PoseLayer, Tangent
from viewer.edit.handles import AXES
from viewer.edit.pins import Pins
from viewer.edit.posing import NAMES
from viewer.editor import Editor
from viewer.gl_bindings import imgui, implot
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px
from viewer.session.playback import Playback
from viewer.session.takes import Takes

SIZE_PX = (760.0, 300.0)  # initial size of the window, at scale 1
MIN_SIZE_PX = (420.0, 200.0)
OPENING_HEIGHT_FRACTION = 0.6  # of the view, limit of the initial height
MIN_PLOT_PX = (80.0, 60.0)
LIST_WIDTH_PX, FIELD_WIDTH_PX, FIELDS = 132.0, 74.0, 5  # fields in the line above the plot
GRAB_PX = 9.0  # distance at which a click takes a key
KEY_PX, CHOSEN_KEY_PX = 4.0, 5.5  # radii
SAMPLES = 240  # of a curve across the plot
MIN_SPAN = {"°": 10.0, "cm": 4.0, "m": 0.5}  # minimum range of the values shown
_FLAGS = imgui.WindowFlags_
_SCROLLS_NOT = _FLAGS.no_scrollbar | _FLAGS.no_scroll_with_mouse
CAMERA_TINTS = ((0.95, 0.78, 0.42, 1.0), (0.80, 0.55, 0.92, 1.0), (0.45, 0.80, 0.86, 1.0), *AXES)
HELP = (
    "Click or box-select keys, Shift adds. Drag to move them; Ctrl locks the direction.\n"
    "Double-click adds a key. Del deletes, Ctrl+A selects all.\n"
    "Wheel zooms, middle drag scrolls; the line is the frame shown."
)


@dataclass(frozen=True)
class Grab:
    """What is being dragged: keys, the playhead, or a selection box."""

    what: str  # "keys", "frame" or "box"
    frame: float  # where the drag began,
    value: float  # in the plot's axes
    before: KeyedCurves  # the curves at that time
    chosen: frozenset[CurveKey]  # the selection at that time


@dataclass
class GraphEditor:
    """State of the graph editor: visible curves, selected keys, and the drag in progress."""

    editor: Editor
    takes: Takes
    pins: Pins
    open: bool = False
    chosen: frozenset[CurveKey] = frozenset()
    hidden: set[tuple[Curve, int]] = field(default_factory=set)
    _grab: Grab | None = None
    _fits: bool = True  # show everything in the next frame
    _take: int = 0  # take of the selected keys
    _field_width: float = 0.0

    @property
    def curves(self) -> KeyedCurves:
        """The curves of the playing take."""
        playback = self.takes.playback
        if playback is None:
            return KeyedCurves(PoseLayer(), (), 1.0, 1)
        take = playback.take
        return KeyedCurves(take.poses.layer, take.cameras, playback.clip.fps, playback.frames)

    def show(self) -> None:
        """Open the window with all keys in view."""
        self.open = self._fits = True

    def toggle(self) -> None:
        """Open or close the window."""
        self.open, self._fits = not self.open, True

    def close(self) -> None:
        """Deselect the keys, or close the window if none are selected."""
        self.open, self.chosen, self._grab = self.open and bool(self.chosen), frozenset(), None

    def panel(self) -> Panel:
        """Return the graph editor's window, initially over the view; Escape closes it."""
        return Panel(
            "Curves", PanelPlace.VIEW, self._draw,
            shown=lambda: self.open and self.takes.playback is not None, close=self.close,
        )  # fmt: skip

    # --- edits

    def put(self, label: str, change: Callable[[], KeyedCurves], held: bool = False) -> None:
        """Replace the take's curves, as a step of undo."""
        playback = self.takes.playback
        if playback is None or self.pins.fixed:
            return
        take = playback.take
        try:
            made = change()
            poses = replace(take.poses, layer=made.layer)
        except SportError as error:
            self.editor.messages.error(error)
            return
        label = f"{label} of {take.title}"
        self.editor.put(label, take.number, held, poses=poses, cameras=made.cameras)

    def remove(self) -> None:
        """Delete the selected keys."""
        chosen, self.chosen = self.chosen, frozenset()
        if chosen:
            self.put("removal of keys", lambda: self.curves.removed(chosen))

    def insert(self, channel: Channel, frame: int) -> None:
        """Insert a key on a channel's curve and select it."""
        self.put("new key", lambda: self.curves.inserted(channel, frame))
        self.chosen = frozenset({CurveKey(channel, frame)})

    def move(self, frames: int, value: float) -> None:
        """Move the dragged keys from their original places by frames, and by a value on the plot's axis."""
        grab = self._grab
        if grab is None:
            return
        moved = grab.before.moved(grab.chosen, 0, lambda _: 0.0)  # unchanged if the move is impossible
        frames = grab.before.bounded(grab.chosen, frames)

        def change() -> KeyedCurves:
            return grab.before.moved(grab.chosen, frames, lambda channel: value)

        if frames or value:
            self.put("move of keys", change, held=True)
        elif moved != self.curves:
            self.put("move of keys", lambda: moved, held=True)
        self.chosen = frozenset(key._replace(frame=key.frame + frames) for key in grab.chosen)

    # --- the window

    def _draw(self, view: Rect) -> None:
        playback = self.takes.playback
        if playback is None:
            return
        if self._take != playback.number:
            self._take, self.chosen, self._grab, self._fits = playback.number, frozenset(), None, True
        curves = self.curves
        self.chosen = frozenset(key for key in self.chosen if key.frame in curves.keys(key.channel))
        size = imgui.ImVec2(
            min(px(SIZE_PX[0]), view.width - px(20)),
            min(px(SIZE_PX[1]), OPENING_HEIGHT_FRACTION * view.height),
        )
        place = imgui.ImVec2(view.x + px(10), view.y + px(56))
        imgui.set_next_window_pos(place, imgui.Cond_.appearing)
        imgui.set_next_window_size(size, imgui.Cond_.appearing)
        imgui.set_next_window_size_constraints(
            imgui.ImVec2(px(MIN_SIZE_PX[0]), px(MIN_SIZE_PX[1])), imgui.ImVec2(4096, 4096)
        )
        flags = _FLAGS.no_saved_settings | _FLAGS.no_collapse | _SCROLLS_NOT
        shown, keep = imgui.begin("Curves", True, flags)
        try:
            if shown:
                self._tools(curves)
                self._list(curves)
                imgui.same_line()
                self._plot(curves, playback)
                self._keys()
        finally:
            imgui.end()
        if not keep:
            self.open = False

    def _keys(self) -> None:
        """Handle key presses while the mouse is over the window."""
        over = imgui.is_window_hovered(imgui.HoveredFlags_.root_and_child_windows)
        if not over or imgui.get_io().want_text_input:
            return
        if imgui.is_key_pressed(imgui.Key.delete, False):
            self.remove()
        if imgui.get_io().key_ctrl and imgui.is_key_pressed(imgui.Key.a, False):
            curves = self.curves
            self.chosen = frozenset(
                CurveKey(c, frame) for c in self._shown(curves) for frame in curves.keys(c)
            )

    def _shown(self, curves: KeyedCurves) -> list[Channel]:
        return [each for each in curves.channels() if (each.curve, each.joint) not in self.hidden]

    def _tools(self, curves: KeyedCurves) -> None:
        if widgets.button("Fit##curves", 0.0, f"Show every key\n{HELP}"):
            self._fits = True
        imgui.same_line()
        gap = imgui.get_style().item_spacing.x
        room = (imgui.get_content_region_avail().x - FIELDS * gap) / FIELDS
        self._field_width = min(px(FIELD_WIDTH_PX), room)
        self._chosen_key(curves)
        self._tangents(curves)
        self._eases(curves)

    def _chosen_key(self, curves: KeyedCurves) -> None:
        """Draw frame and value of a single selected key."""
        (first, *others) = self.chosen or (None,)
        frame = value = 0.0
        if first is not None:
            frame, value = float(first.frame), curves.keys(first.channel)[first.frame]
        with widgets.disabled(first is None or others):
            new_frame = self._number("frame", frame, "frame %.0f", "Frame of the selected key")
            unit = first.channel.unit if first is not None else ""
            new_value = self._number("value", value, f"%.1f {unit}", "Value of the selected key")
        if first is not None and (round(new_frame) != first.frame or abs(new_value - value) > 1e-4):
            by, chosen = round(new_frame) - first.frame, self.chosen
            change = new_value - value
            self.put("move of keys", lambda: curves.moved(chosen, by, lambda _: change), held=True)
            self.chosen = frozenset({first._replace(frame=first.frame + curves.bounded(chosen, by))})

    def _tangents(self, curves: KeyedCurves) -> None:
        tangents = {curves.tangent(key) for key in self.chosen} - {None}
        with widgets.disabled(not tangents):
            imgui.set_next_item_width(self._field_width)
            options = [(tangent, str(tangent).capitalize()) for tangent in Tangent]
            now = next(iter(tangents)) if len(tangents) == 1 else None
            picked = widgets.combo("##curve tangent", options, now)
            widgets.tooltip("Tangents of the selected pose keys")
        if isinstance(picked, Tangent) and tangents != {picked} and tangents:
            self.put("tangent of keys", lambda: curves.with_tangent(self.chosen, picked))
        imgui.same_line()

    def _number(self, name: str, value: float, text: str, hint: str) -> float:
        imgui.set_next_item_width(self._field_width)
        _, made = imgui.drag_float(f"##curve {name}", value, 0.1, 0.0, 0.0, text)
        widgets.tooltip(hint)
        imgui.same_line()
        return float(made)

    def _eases(self, curves: KeyedCurves) -> None:
        layer = curves.layer
        with widgets.disabled(not layer):
            eases = [
                self._number(name, getattr(layer, name), f"{text} %.2f s", hint)
                for name, text, hint in (
                    ("ease_in", "in", "Ease in before a joint's first key"),
                    ("ease_out", "out", "Ease out after its last key"),
                )
            ]
        bounded = [min(max(ease, 0.0), MAX_EASE_S) for ease in eases]
        if layer and np.abs(np.subtract(bounded, (layer.ease_in, layer.ease_out))).max() > 1e-6:
            made = replace(layer, ease_in=bounded[0], ease_out=bounded[1])
            self.put("ease of the pose layer", lambda: replace(curves, layer=made), held=True)
        imgui.new_line()
        imgui.set_cursor_pos_y(imgui.get_cursor_pos_y() - imgui.get_style().item_spacing.y)

    def _list(self, curves: KeyedCurves) -> None:
        if imgui.begin_child("channels", imgui.ImVec2(px(LIST_WIDTH_PX), 0)):
            groups = dict.fromkeys((each.curve, each.joint) for each in curves.channels())
            for curve, joint in groups:
                on = (curve, joint) not in self.hidden
                name = "Camera" if curve is Curve.CAMERA else f"{NAMES.get(joint, joint)} {curve}"
                clicked, on = imgui.checkbox(f"{name}##channel {curve} {joint}", on)
                if clicked:
                    (self.hidden.discard if on else self.hidden.add)((curve, joint))
            if not groups:
                widgets.muted("No keys yet. Pose a joint, or key the camera.", wrap=True)
        imgui.end_child()

    # --- the plot

    def _plot(self, curves: KeyedCurves, playback: Playback) -> None:
        flags = implot.Flags_
        chosen = flags.no_title | flags.no_legend | flags.no_menus | flags.no_box_select | flags.no_mouse_text
        implot.get_input_map().pan = 2  # the middle button: the left one selects and drags
        implot.get_style().plot_min_size = imgui.ImVec2(*map(px, MIN_PLOT_PX))
        if not implot.begin_plot("##curves", imgui.ImVec2(-1, -1), chosen):
            return
        try:
            channels = self._shown(curves)
            self._fit(curves, channels)
            implot.setup_axes("", "", implot.AxisFlags_.no_label, implot.AxisFlags_.no_label)
            implot.setup_finish()
            for channel in channels:
                self._curve(curves, channel)
            self._mouse(curves, channels, playback)
            self._overlay(playback)
        finally:
            implot.end_plot()

    def _fit(self, curves: KeyedCurves, channels: list[Channel]) -> None:
        if not self._fits:
            return
        self._fits = False
        keys = [(frame, value) for each in channels for frame, value in curves.keys(each).items()]
        least = max((MIN_SPAN[each.unit] for each in channels), default=10.0)
        low, high = span_of([value for _, value in keys], least)
        first, last = span_of([float(frame) for frame, _ in keys], 60.0)
        implot.setup_axes_limits(first, last, low, high, imgui.Cond_.always)

    def _curve(self, curves: KeyedCurves, channel: Channel) -> None:
        limits = implot.get_plot_limits()
        frames = np.linspace(max(limits.x.min, 0.0), min(limits.x.max, curves.frames - 1.0), SAMPLES)
        if frames[-1] <= frames[0]:
            return
        tint = imgui.ImVec4(*_tint(channel))
        name = (CAMERA_AXES if channel.curve is Curve.CAMERA else POSE_AXES)[channel.axis]
        values = np.asarray(curves.values(channel, frames / curves.fps), np.float64)
        spec = implot.Spec()
        spec.line_color, spec.line_weight = tint, px(1.4)
        implot.plot_line(f"{channel.curve} {channel.joint} {name}", frames, values, spec)
        drawing = implot.get_plot_draw_list()
        implot.push_plot_clip_rect()
        for key, at in _on_screen(curves, [channel]).items():
            own = key in self.chosen
            color = theme.TEXT if own else _tint(channel)
            drawing.add_circle_filled(at, px(CHOSEN_KEY_PX if own else KEY_PX), widgets.packed(color))
        implot.pop_plot_clip_rect()

    def _overlay(self, playback: Playback) -> None:
        """Draw the line of the frame shown, and the selection box."""
        limits, drawing = implot.get_plot_limits(), implot.get_plot_draw_list()
        implot.push_plot_clip_rect()
        low = implot.plot_to_pixels(playback.frame, limits.y.min)
        high = implot.plot_to_pixels(playback.frame, limits.y.max)
        drawing.add_line(low, high, widgets.packed(theme.TEXT), px(1))
        if self._grab is not None and self._grab.what == "box":
            corner, mouse = implot.plot_to_pixels(self._grab.frame, self._grab.value), imgui.get_mouse_pos()
            drawing.add_rect_filled(corner, mouse, widgets.packed(theme.ACCENT_DIM))
            drawing.add_rect(corner, mouse, widgets.packed(theme.ACCENT))
        implot.pop_plot_clip_rect()

    def _mouse(self, curves: KeyedCurves, channels: list[Channel], playback: Playback) -> None:
        mouse = implot.get_plot_mouse_pos()
        if self.editor.dragger is not self:
            self._grab = None
        if self._grab is None and implot.is_plot_hovered():
            near = self._near(curves, channels)
            if imgui.is_mouse_double_clicked(0) and near is None:
                self._insert_under(curves, channels, mouse.x, mouse.y)
            elif imgui.is_mouse_clicked(0):
                self._press(curves, near, playback, mouse)
        if self._grab is not None:
            self._carry(self._grab, playback, mouse)
            if not imgui.is_mouse_down(0):
                self._let_go(self._grab, curves, channels)

    def _near(self, curves: KeyedCurves, channels: list[Channel]) -> CurveKey | None:
        mouse, keys = imgui.get_mouse_pos(), _on_screen(curves, channels)
        away = {key: math.hypot(at.x - mouse.x, at.y - mouse.y) for key, at in keys.items()}
        near = min(away, key=away.__getitem__, default=None)
        return near if near is not None and away[near] <= px(GRAB_PX) else None

    def _press(
        self, curves: KeyedCurves, near: CurveKey | None, playback: Playback, mouse: implot.Point
    ) -> None:
        adds = imgui.get_io().key_shift
        if near is not None:
            if adds:
                self.chosen = self.chosen ^ {near}
            elif near not in self.chosen:
                self.chosen = frozenset({near})
            what = "keys" if near in self.chosen else ""
        else:
            line = implot.plot_to_pixels(playback.frame, mouse.y)
            what = "frame" if abs(line.x - imgui.get_mouse_pos().x) <= px(GRAB_PX) else "box"
        if what == "box" and not adds:
            self.chosen = frozenset()
        self.editor.begin_drag(self)
        self._grab = Grab(what, mouse.x, mouse.y, curves, self.chosen) if what else None

    def _carry(self, grab: Grab, playback: Playback, mouse: implot.Point) -> None:
        if grab.what == "frame":
            playback.seek(min(max(round(mouse.x), 0), playback.frames - 1))
        if grab.what != "keys":
            return
        frames, value = round(mouse.x - grab.frame), mouse.y - grab.value
        if imgui.get_io().key_ctrl:  # only the direction dragged farther on the screen
            drag = imgui.get_mouse_drag_delta(0)
            frames, value = (frames, 0.0) if abs(drag.x) >= abs(drag.y) else (0, value)
        if imgui.is_mouse_dragging(0):
            self.move(frames, value)

    def _let_go(self, grab: Grab, curves: KeyedCurves, channels: list[Channel]) -> None:
        self._grab = None
        if grab.what != "box":
            return
        corner, mouse = implot.plot_to_pixels(grab.frame, grab.value), imgui.get_mouse_pos()
        left, right = sorted((corner.x, mouse.x))
        top, bottom = sorted((corner.y, mouse.y))
        keys = _on_screen(curves, channels).items()
        self.chosen = grab.chosen | {k for k, at in keys if left <= at.x <= right and top <= at.y <= bottom}

    def _insert_under(self, curves: KeyedCurves, channels: list[Channel], frame: float, value: float) -> None:
        """Insert a key on the curve nearest to a point of the plot."""
        at = min(max(round(frame), 0), curves.frames - 1)
        seconds: Array = np.array([at / curves.fps])
        away = [abs(float(curves.values(channel, seconds)[0]) - value) for channel in channels]
        if away:
            self.insert(channels[int(np.argmin(away))], at)


def _on_screen(curves: KeyedCurves, channels: list[Channel]) -> dict[CurveKey, imgui.ImVec2]:
    """Return the screen positions of the channels' keys in the current plot."""
    return {
        CurveKey(channel, frame): implot.plot_to_pixels(frame, value)
        for channel in channels
        for frame, value in curves.keys(channel).items()
    }


def _tint(channel: Channel) -> theme.Color:
    return (CAMERA_TINTS if channel.curve is Curve.CAMERA else AXES)[channel.axis]
