"""A second take beside the one that plays, or over it: in sync, shifted in time and to the side."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.pose import Pose
from runtime.takes.clip import Clip
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.stage.simulation import make_pose
from viewer.takes.playback import Playback
from viewer.takes.state import ClipItem, TakesState

ASIDE_M = 1.0
WIDTH, MARGIN = 214.0, 10.0  # of the card, pixels at scale 1
MIN_VIEW = 330.0  # a narrower view has no room for it beside the bar


@dataclass
class Reference:
    """What is shown beside the take that plays, from where that begins."""

    state: TakesState
    item: ClipItem | None = None
    offset_s: float = 0.0  # the reference is shown so much later
    aside_m: float = ASIDE_M  # to the right of the take
    over: bool = False  # translucent, in the same place
    _placed: tuple[Clip, Clip, Array, float] | None = field(default=None, init=False)

    def show(self, item: ClipItem) -> None:
        """Compare with a take of the list; the same again shows none."""
        self.item = None if self.item is item else item
        self.offset_s = 0.0

    def forget(self, item: ClipItem) -> None:
        """A take left the list."""
        self.item = None if self.item is item else self.item

    @property
    def shown(self) -> bool:
        """Whether there is one to show."""
        playback = self.state.playback
        return playback is not None and self.item is not None and self.item.clip is not playback.clip

    def pose(self, playback: Playback) -> Pose | None:
        """The reference at the time that is shown of the take; None where there is none."""
        if not self.shown or self.item is None:
            return None
        clip = self.item.clip
        move, turn = self._place(playback.clip, clip)
        pose = clip.sample(playback.time_s - playback.start_s + self.offset_s)
        hips = rotations.rotate(rotations.from_yaw(turn), pose.hips_position) + move
        local = np.array(pose.local_rotations)
        local[0] = rotations.multiply(rotations.from_yaw(turn), local[0])
        ground = float(playback.terrain.height(float(hips[0]), float(hips[2])))
        hips[1] += ground - float(playback.terrain.height(*self._start(playback.clip)))
        return make_pose(hips, local, pose.contacts, ground, pose.root_yaw + turn)

    def _place(self, take: Clip, clip: Clip) -> tuple[Array, float]:
        """The shift `(3,)` and the turn that let the reference begin where the take does, beside it."""
        if self._placed is None or self._placed[0] is not take or self._placed[1] is not clip:
            ours, theirs = take.pose(0), clip.pose(0)
            turn = math.remainder(ours.root_yaw - theirs.root_yaw, math.tau)
            moved = rotations.rotate(rotations.from_yaw(turn), np.asarray(theirs.hips_position, float))
            shift = np.asarray(ours.hips_position, float) - moved
            shift[1] = float(ours.hips_position[1] - theirs.hips_position[1]) if abs(shift[1]) > 0.3 else 0.0
            self._placed = take, clip, shift, turn
        *_, shift, turn = self._placed
        yaw = take.pose(0).root_yaw
        right = np.array([-math.cos(yaw), 0.0, math.sin(yaw)])
        return shift + (0.0 if self.over else self.aside_m) * right, turn

    @staticmethod
    def _start(take: Clip) -> tuple[float, float]:
        return float(take.hips_positions[0, 0]), float(take.hips_positions[0, 2])


def panel(reference: Reference) -> Panel:
    """The card of the reference, while there is one."""

    def close() -> bool:
        was, reference.item = reference.shown, None if reference.shown else reference.item
        return was

    return Panel(
        "Reference", PanelPlace.VIEW, lambda view: _card(reference, view), shown=lambda: reference.shown,
        close=close,
    )  # fmt: skip


def _card(reference: Reference, view: Rect) -> None:
    item, playback = reference.item, reference.state.playback
    if item is None or playback is None or view.width < px(MIN_VIEW):
        return
    corner = imgui.ImVec2(view.x + px(MARGIN), view.y + view.height - px(MARGIN))
    imgui.set_next_window_pos(corner, imgui.Cond_.always, imgui.ImVec2(0.0, 1.0))
    imgui.set_next_window_size(imgui.ImVec2(px(WIDTH), 0))
    flags = (
        imgui.WindowFlags_.no_decoration
        | imgui.WindowFlags_.no_move
        | imgui.WindowFlags_.no_saved_settings
        | imgui.WindowFlags_.no_focus_on_appearing
    )
    imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(10), px(8)))
    imgui.begin("Reference", None, flags)
    imgui.pop_style_var()
    side = imgui.get_frame_height()
    imgui.align_text_to_frame_padding()
    widgets.label(widgets.elided(f"Beside: {item.name}", px(WIDTH) - side - px(20)), theme.ACCENT)
    imgui.same_line(imgui.get_content_region_avail().x + imgui.get_style().window_padding.x - side)
    if widgets.icon_button(ICON.close, "close reference", "Show the take alone", theme.TEXT):
        reference.item = None
    reference.over = widgets.segmented(
        "reference place", [(False, "Beside"), (True, "Over it")], reference.over
    )
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    fps = playback.clip.fps
    imgui.set_next_item_width(half)
    _, frames = imgui.drag_int(
        "##reference offset", round(reference.offset_s * fps), 0.3, -36000, 36000, "%+d frames"
    )
    reference.offset_s = frames / fps
    widgets.tooltip("How much later the reference is. Drag, or double-click to type.")
    imgui.same_line(0, px(4))
    imgui.set_next_item_width(half)
    imgui.begin_disabled(reference.over)
    _, reference.aside_m = imgui.drag_float(
        "##reference aside", reference.aside_m, 0.01, -20.0, 20.0, "%.1f m aside"
    )
    imgui.end_disabled()
    imgui.end()
