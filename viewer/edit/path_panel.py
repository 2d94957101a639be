"""The path's part of the scene panel: draw it, speed and gait of the selected leg, walk it."""

from __future__ import annotations

from collections.abc import Callable

from runtime.controls import Gait
from viewer.edit.path import PathTool
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px

GAITS = [(gait, gait.label.capitalize()) for gait in (Gait.WALK, Gait.JOG, Gait.CROUCH)]


def draw(tool: PathTool, draw_pins: Callable[[float], None]) -> None:
    """Contents of this part; `draw_pins` fills the end of its first row, of a width."""
    third = widgets.column_width(3)
    hint = "A drag on the ground draws the path, a click adds a point. Drag a point to move it, Delete removes it."
    if tool.of_take:
        hint = "The path of the take: drag its points, choose speed and gait of each leg, delete the last ones to end there"
    text = "Edit its path" if tool.of_take else "Draw a path"
    tool.active = widgets.toggle(text, tool.active, third, hint)
    widgets.same_line()
    imgui.begin_disabled(not tool.points or (tool.of_take and not tool.active))
    if tool.of_take:
        if widgets.button("Resimulate###drive path", third, "Resimulate the take along these points"):
            tool.resimulate()
    elif tool.walk is not None:
        if widgets.button(f"{ICON.stop} Stop###walk path", third, "Give the stick back"):
            tool.stop()
    elif widgets.button(
        f"{ICON.walk} Walk it###walk path", third, "From where the character stands; any key of yours ends it"
    ):
        tool.start()
    imgui.end_disabled()
    widgets.same_line()
    draw_pins(third)
    if tool.active:
        _selected(tool)


def _selected(tool: PathTool) -> None:
    """Speed and gait of the leg that leads to the selected point."""
    if not 0 <= tool.selected < len(tool.points):
        widgets.muted("Click on the ground to set points.", wrap=True)
        return
    point = tool.points[tool.selected]
    gait = widgets.segmented("path gait", GAITS, point.gait)
    width = imgui.get_content_region_avail().x
    imgui.set_next_item_width(width - 2 * px(62) - 2 * px(4))
    text = f"to point {tool.selected + 1}: %.0f %%"
    moved, speed = widgets.slider("##path speed", point.speed * 100.0, 10.0, 100.0, text)
    widgets.tooltip("How far the stick is pushed on the way to this point")
    if gait != point.gait or moved:
        tool.change(gait=gait, speed=speed / 100.0)
    widgets.same_line()
    if widgets.button("Delete", px(62), "Remove this point (Delete)"):
        tool.delete()
    widgets.same_line()
    if widgets.button("Clear", px(62), "Remove every point"):
        tool.clear()
