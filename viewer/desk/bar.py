"""The bar over the view: the project's menu and its name."""

from __future__ import annotations

from runtime.safe_read import printable
from viewer.desk.desk import Desk
from viewer.desk.undo import Undo
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.projects.projects import Projects

POPUP = "project menu"
NAME_WIDTH = 110.0  # pixels at scale 1
MENU_WIDTH = 240.0
MARGIN = 10.0
MIN_VIEW = 200.0  # a narrower view has no room for the bar
# plain numbers: Python 3.11.2, Debian 12's, raises where two of these keys are joined as the enumeration they are
_CTRL, _SHIFT = int(imgui.Key.mod_ctrl), int(imgui.Key.mod_shift)
_SAVE, _OPEN, _EXPORT = (_CTRL | int(key) for key in (imgui.Key.s, imgui.Key.o, imgui.Key.e))
_SAVE_AS = _SHIFT | _SAVE


def panel(desk: Desk, undo: Undo) -> Panel:
    """The bar, and the keys with Ctrl."""

    def act_on_keys() -> None:
        keys(desk)
        undo.keys()

    return Panel("Desk", PanelPlace.VIEW, lambda view: draw(desk, view), keys=act_on_keys)


def draw(desk: Desk, view: Rect) -> None:
    """The bar at the top left of the view, and what opens from it."""
    if view.width < px(MIN_VIEW):
        return
    imgui.set_next_window_pos(imgui.ImVec2(view.x + px(MARGIN), view.y + px(MARGIN)))
    flags = (
        imgui.WindowFlags_.no_decoration
        | imgui.WindowFlags_.always_auto_resize
        | imgui.WindowFlags_.no_move
        | imgui.WindowFlags_.no_saved_settings
        | imgui.WindowFlags_.no_bring_to_front_on_focus
        | imgui.WindowFlags_.no_focus_on_appearing
    )
    imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(4), px(4)))
    imgui.begin("Desk", None, flags)
    _buttons(desk)
    imgui.pop_style_var()
    _menu(desk)
    imgui.end()


def keys(desk: Desk) -> None:
    """Ctrl+S, Ctrl+Shift+S, Ctrl+O and Ctrl+E; also while a prompt is typed."""
    if desk.dialogs.question is not None:
        return
    if imgui.is_key_chord_pressed(_SAVE_AS):
        desk.projects.ask_save()
    elif imgui.is_key_chord_pressed(_SAVE):
        desk.projects.save()
    elif imgui.is_key_chord_pressed(_OPEN):
        desk.projects.ask_open()
    elif imgui.is_key_chord_pressed(_EXPORT):
        desk.exporting.open()


def _buttons(desk: Desk) -> None:
    state = desk.state.projects
    mark = " •" if state.changed else ""
    name = widgets.elided(printable(state.name), px(NAME_WIDTH))
    left = f"  {ICON.warning}" if state.cut_off is not None else ""
    hint = "Project: open, save, recent ones"
    if state.path is not None:
        hint = f"{printable(state.path)}\n{'Changed since it was saved' if state.changed else 'Saved'}"
    if widgets.button(f"{ICON.folder} {name}{mark}{left}###project", 0.0, hint):
        imgui.open_popup(POPUP)
    imgui.same_line(0, px(4))
    if widgets.button(f"{ICON.gear}###settings", px(30), "Settings"):
        desk.state.settings_open = not desk.state.settings_open


def _menu(desk: Desk) -> None:
    corner = imgui.get_window_pos()
    imgui.set_next_window_pos(imgui.ImVec2(corner.x, corner.y + imgui.get_window_height() + px(4)))
    imgui.set_next_window_size_constraints(imgui.ImVec2(px(MENU_WIDTH), 0), imgui.ImVec2(px(420), px(2000)))
    if not imgui.begin_popup(POPUP):
        return
    projects = desk.projects
    _left_behind(projects)
    if imgui.menu_item("New project", "", False)[0]:
        projects.new()
    if imgui.menu_item("Open…", "Ctrl+O", False)[0]:
        projects.ask_open()
    _recent(projects)
    imgui.separator()
    if imgui.menu_item("Save", "Ctrl+S", False)[0]:
        projects.save()
    if imgui.menu_item("Save as…", "Ctrl+Shift+S", False)[0]:
        projects.ask_save()
    imgui.separator()
    if imgui.menu_item("Export the take…", "Ctrl+E", False)[0]:
        desk.exporting.open()
    if imgui.menu_item("Settings…", "", False)[0]:
        desk.state.settings_open = True
    if imgui.menu_item("First minute", "", False)[0]:
        desk.guide.begin()
    imgui.end_popup()


def _recent(projects: Projects) -> None:
    recent = [path for path in projects.recent if path != projects.state.path]
    if not recent:
        return
    if imgui.menu_item(f"Reopen {printable(recent[0].stem)}", "", False)[0]:
        projects.open(recent[0])
    widgets.tooltip(printable(recent[0]))
    if len(recent) > 1 and imgui.begin_menu("Recent"):
        for number, path in enumerate(recent):
            if imgui.menu_item(f"{printable(path.stem)}##{number}", "", False)[0]:
                projects.open(path)
            widgets.tooltip(printable(path))
        imgui.end_menu()


def _left_behind(projects: Projects) -> None:
    """Sessions of other runs: one that was cut off can be discarded too."""
    for number, left in enumerate(list(projects.state.left)[:2]):
        imgui.push_id(f"left {number}")
        what = "Last session" if left.ended else "Cut off"
        with widgets.color(imgui.Col_.text, theme.MUTED if left.ended else theme.WARNING):
            imgui.text_unformatted(f"{what}: {printable(left.describe())}")
        if widgets.button("Reopen", px(110), "Put it on the desk", primary=not left.ended):
            projects.reopen(left)
            imgui.close_current_popup()
        imgui.same_line(0, px(4))
        if widgets.button("Discard", px(110), "Remove it for good"):
            projects.discard(left)
        imgui.pop_id()
        imgui.separator()
