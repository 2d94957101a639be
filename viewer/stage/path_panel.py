"""The path's part of the scene panel: draw it, speed and gait of the selected leg, walk it."""

from __future__ import annotations

from collections.abc import Callable

from runtime.controls import Gait
from runtime.motion.paths import PlanarPose
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.stage.path_tool import PathTool
from viewer.stage.stage import Stage

GAITS = [(gait, gait.label.capitalize()) for gait in (Gait.WALK, Gait.JOG, Gait.CROUCH)]


def draw(stage: Stage, draw_pins: Callable[[float], None]) -> None:
    """Contents of this part; `draw_pins` fills the end of its first row, of a width."""
    tool = stage.path
    third = (imgui.get_content_region_avail().x - 2 * px(4)) / 3
    hint = "A drag on the ground draws the path, a click adds a point. Drag a point to move it, Delete removes it."
    if tool.drive is not None:
        hint = "The way of the take: drag its points, choose speed and gait of each leg, delete the last ones to end there"
    tool.active = widgets.toggle(
        "Draw a path" if tool.drive is None else "Edit its way", tool.active, third, hint
    )
    imgui.same_line(0, px(4))
    imgui.begin_disabled(not tool.points or (tool.drive is not None and not tool.active))
    if tool.drive is not None:
        if widgets.button(
            f"{ICON.walk} Drive it###drive path", third, "Drive the take again along these points"
        ):
            tool.drive()
    elif tool.walk is not None:
        if widgets.button(f"{ICON.stop} Stop###walk path", third, "Give the stick back"):
            tool.stop()
    elif widgets.button(
        f"{ICON.walk} Walk it###walk path", third, "From where the character stands; any key of yours ends it"
    ):
        pose = stage.state.simulation.current
        tool.start(PlanarPose(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw))
    imgui.end_disabled()
    imgui.same_line(0, px(4))
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
    text = f"to point {tool.selected + 1}: %.0f %%%%"
    moved, speed = widgets.slider(
        "##path speed", point.speed * 100.0, 10.0, 100.0, text.replace("%%%%", "%%")
    )
    widgets.tooltip("How far the stick is pushed on the way to this point")
    if gait != point.gait or moved:
        tool.change(gait=gait, speed=speed / 100.0)
    imgui.same_line(0, px(4))
    if widgets.button("Delete", px(62), "Remove this point (Delete)"):
        tool.delete()
    imgui.same_line(0, px(4))
    if widgets.button("Clear", px(62), "Remove every point"):
        tool.clear()
