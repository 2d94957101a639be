"""The row of the settings window that chooses the model: one of the shipped ones, or a folder."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from runtime.assets import model_folder, shipped_models
from runtime.motion.model_files import read_metadata
from runtime.safe_read import printable
from viewer.desk.desk import Desk
from viewer.gl_bindings import imgui
from viewer.gui import overlay, theme, widgets
from viewer.gui.dialogs import Kind
from viewer.gui.theme import ICON
from viewer.gui.widgets import px

FREE, BOUND = "free to publish with credits", "non-commercial"


@lru_cache(8)
def choices() -> tuple[tuple[Path, str], ...]:
    """Folder of every shipped model, and what is said of it."""
    return tuple((folder, f"{name}: {use_of(folder)}") for name, folder in shipped_models().items())


def use_of(folder: Path) -> str:
    """What the licence of a shipped model allows, in a few words; ModelError when its metadata are damaged."""
    licence = str(read_metadata(folder).get("notes", {}).get("licence", ""))
    return FREE if licence.startswith("CC BY 4.0") else BOUND


def draw(desk: Desk) -> None:
    """The list, and a button for another folder."""
    state, side = desk.stage.state, imgui.get_frame_height()
    overlay.row("Model", "Takes that were recorded stay with the model that made them")
    now = model_folder(state.model_folder)
    options: list[tuple[object, str]] = list(choices())
    if now not in dict(options):
        options.append((now, printable(f"{state.model_name or 'none'}: {now}")))
    imgui.begin_disabled(desk.jobs.busy("model"))
    imgui.set_next_item_width(imgui.get_content_region_avail().x - side - px(4))
    chosen = overlay.combo("##model", options, now)
    imgui.end_disabled()
    if chosen != now:
        desk.choose_model(Path(str(chosen)))
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.folder, "browse model", "Choose the folder of an exported model", theme.TEXT):
        desk.dialogs.ask(Kind.FOLDER, "Folder of an exported model", desk.model_home, desk.choose_model)
