"""Names over the characters of the compare view, and the mouse that chooses one of them."""

from __future__ import annotations

import math

import numpy as np

from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from viewer.compare.compare_view import CompareView
from viewer.compare.lineup import LONGEST_ROW, names
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px
from viewer.render.camera import Camera

HEAD = SPORT_SKELETON.index("Head")
OVER_HEAD_M = 0.34
HALF_WIDTH_M = 0.4  # of a character, to be clicked
WIDEST, NARROWEST = 190.0, 60.0  # pixels at scale 1
PAD, LEAST_NAME = 6.0, 56.0
NUMBERS_ALONE = 110.0  # where there is less room for a name


def panel(compare: CompareView) -> Panel:
    """The names; a click on a character keeps it."""

    def draw_names(view: Rect) -> None:
        clicked = draw(compare, compare.scene.camera.current, view)
        if clicked >= 0:
            compare.keep(clicked)

    return Panel("Names", PanelPlace.SIGN, draw_names, shown=lambda: compare.open)


def draw(compare: CompareView, camera: Camera, view: Rect) -> int:
    """Draw the names behind the panels; the index of the character that was clicked in this frame, -1 for none."""
    io, poses = imgui.get_io(), compare.poses
    heads = [on_screen(camera, _over(pose), io.display_size) for pose in poses]
    feet = [on_screen(camera, np.asarray(pose.root_position, float), io.display_size) for pose in poses]
    free = not io.want_capture_mouse
    compare.hovered = _under_mouse(heads, feet) if free else -1
    widths = _widths([head for head in heads if head is not None])
    for i, ((name, seed), head) in enumerate(zip(names(compare.variants), heads, strict=False)):
        if head is not None and view.x <= head[0] <= view.x + view.width:
            texts = ("…", "") if compare.variants[i].number in compare.asked else (name, seed)
            # of two rows the first has its names under the feet: over the heads they would cover the second
            foot = feet[i] if i < (len(poses) + 1) // 2 and len(poses) > LONGEST_ROW else None
            hovered = i == compare.hovered
            if widths < px(NUMBERS_ALONE) and not hovered:  # the panel has the names
                text = f"{i + 1}"
            else:
                room = px(WIDEST) if hovered else widths
                text = _fitted(f"{i + 1}", *texts, room - 2 * px(PAD))
            _label(text, _below(foot) or head, hovered, view)
    if compare.hovered >= 0:
        imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
    return compare.hovered if free and imgui.is_mouse_clicked(0) else -1


def _over(pose: Pose) -> np.ndarray:
    return np.asarray(pose.positions[HEAD] + np.array([0.0, OVER_HEAD_M, 0.0]))


def _below(foot: tuple[float, float] | None) -> tuple[float, float] | None:
    """Where the name of a character stands under its feet."""
    return None if foot is None else (foot[0], foot[1] + 2.0 * imgui.get_text_line_height())


def _widths(heads: list[tuple[float, float]]) -> float:
    """Pixels for one name, so that neighbours at about the same height do not overlap."""
    line = 1.5 * imgui.get_text_line_height()
    gaps = [abs(a[0] - b[0]) for k, a in enumerate(heads) for b in heads[:k] if abs(a[1] - b[1]) < line]
    return min(max(min(gaps, default=px(WIDEST)) - px(6), px(NARROWEST)), px(WIDEST))


def _under_mouse(heads: list[tuple[float, float] | None], feet: list[tuple[float, float] | None]) -> int:
    """The nearest character whose box or name is under the mouse; -1 for none."""
    mouse, best = imgui.get_io().mouse_pos, (math.inf, -1)
    for i, (head, foot) in enumerate(zip(heads, feet, strict=True)):
        if head is None or foot is None:
            continue
        height = foot[1] - head[1]
        half = max(HALF_WIDTH_M / 2.0 * height, px(10))
        aside = abs(mouse.x - head[0])
        if aside < half and head[1] - px(14) < mouse.y < foot[1] + 0.05 * height:
            best = min(best, (aside, i))
    return best[1]


def _fitted(number: str, name: str, seed: str, width: float) -> str:
    """The name cut to a width; the seed, which tells it from others of that name, stays whole."""
    room = width - imgui.calc_text_size(seed).x
    if room < px(LEAST_NAME):
        return widgets.elided(f"{number}  {seed.lstrip(', ') or name}", width)
    return widgets.elided(f"{number}  {name}", room) + seed


def _label(text: str, head: tuple[float, float], hovered: bool, view: Rect) -> None:
    drawing, pad = imgui.get_background_draw_list(), px(PAD)
    size = imgui.calc_text_size(text)
    left = min(max(head[0] - size.x / 2, view.x + pad), view.x + view.width - size.x - pad)
    low = imgui.ImVec2(left - pad, head[1] - size.y - px(3))
    high = imgui.ImVec2(left + size.x + pad, head[1] + px(3))
    drawing.add_rect_filled(low, high, widgets.packed(theme.ACCENT if hovered else theme.PANEL), px(5))
    tint = theme.ON_ACCENT if hovered else theme.TEXT
    drawing.add_text(imgui.ImVec2(left, low.y + px(3)), widgets.packed(tint), text)
