"""The settings window: interface, takes, controls and the model."""

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from runtime.assets import DEFAULT_MODEL, model_folder, model_name, shipped_models
from runtime.errors import FileError
from runtime.motion.model_files import read_metadata
from runtime.options import spec_of
from runtime.safe_read import expanded, printable
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.input.bindings import BUTTON_NAMES, BUTTONS, KEY_TEXTS, KEYS, Action, bound, rebound
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.panels.guide import Guide
from viewer.scene.scene import Scene
from viewer.settings import Settings, remembered, under_home

FREE, BOUND = "free to publish with credits", "non-commercial"
RESET = (
    "ui_scale", "text_size", "keep_seconds", "dead_zone", "invert_look", "navigation", "pad_buttons", "keys",
    "exact_legs",
)  # fmt: skip
WIDTH_PX = 470.0  # at scale 1
SCALES = (
    (0.0, "As the monitor says"), (0.75, "75 %"), (1.0, "100 %"), (1.25, "125 %"), (1.5, "150 %"), (2.0, "200 %"),
    (3.0, "300 %"),
)  # fmt: skip


@dataclass
class SettingsWindow:
    """The settings window: its dependencies, and whether it is open."""

    settings: Settings
    messages: Messages
    jobs: Jobs
    dialogs: Dialogs
    scene: Scene
    guide: Guide
    load_model: Callable[[Path | None, int], None]
    use_scale: Callable[[float], None]  # of the interface
    shown: bool = False

    def toggle(self) -> None:
        """Open or close the window."""
        self.shown = not self.shown

    def panel(self) -> Panel:
        return Panel(
            "Settings",
            PanelPlace.WINDOW,
            self._draw,
            ICON.gear,
            lambda: self.shown,
            WIDTH_PX,
            close=self.toggle,
        )

    def chosen_model(self) -> Path | None:
        """Return the model to start with: the one in the settings if it still exists, else None."""
        text = self.settings.model_folder
        if not text:
            return None
        with suppress(FileError):  # of a name that is shipped no more
            if os.path.isdir(model_folder(text)):
                return model_folder(text)
        self.messages.warn(f"The model {text} is missing: {DEFAULT_MODEL} is used.")
        return None

    def choose_model(self, folder: Path | None) -> None:
        """Load another model now and at the next start; None is the default."""
        controller = self.scene.controller
        folder = None if model_name(folder) == DEFAULT_MODEL else folder
        self.settings.model_folder = "" if folder is None else model_name(folder) or str(folder)
        if folder is not None and not model_name(folder):
            self.settings.known_models = remembered(str(folder), self.settings.known_models)
        self.load_model(folder, 0 if controller is None else controller.seed)

    def _draw(self, _: Rect) -> None:
        settings = self.settings
        self._interface()
        self._export_folder()
        widgets.row("Seconds kept", "Length of takes kept with T")
        widgets.setting_slider(settings, "keep_seconds")
        self._model()
        widgets.row("Navigation", "Mouse navigation as in another program")
        widgets.setting_choice(settings, "navigation")
        widgets.row("Dead zone", "Of the gamepad's sticks")
        widgets.setting_slider(settings, "dead_zone")
        for title, name, table, texts in (
            ("Gamepad buttons", "pad_buttons", BUTTONS, BUTTON_NAMES),
            ("Keys", "keys", KEYS, KEY_TEXTS),
        ):
            with widgets.section(title) as opened:
                if opened:
                    self._bindings(name, table, texts)
        widgets.setting_toggle(settings, "invert_look", px(104))
        widgets.same_line()
        widgets.setting_toggle(settings, "exact_legs", px(124))
        widgets.same_line()
        if widgets.button("Show the first minute", -1, "First steps, shown over the view"):
            self.guide.begin()
            self.shown = False
        if widgets.button("Back to the defaults", -1, "All settings here, except folders and model"):
            for name in RESET:
                setattr(settings, name, getattr(Settings(), name))
            self.use_scale(settings.ui_scale)

    def _interface(self) -> None:
        settings = self.settings
        widgets.row("Interface", "Size of the whole interface")
        scale = float(str(widgets.combo("##ui scale", SCALES, settings.ui_scale)))
        if scale != settings.ui_scale:
            settings.ui_scale = scale
            self.use_scale(scale)
        widgets.row("Text", "Text size")
        sizes = list((spec_of(Settings, "text_size").choices or {}).items())
        settings.text_size = float(str(widgets.combo("##text size", sizes, settings.text_size)))

    def _export_folder(self) -> None:
        settings = self.settings
        widgets.row("Export folder")
        imgui.set_next_item_width(imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4))
        _, text = imgui.input_text("##export folder", printable(settings.export_folder))
        if text.strip() and text != printable(settings.export_folder):
            settings.export_folder = text.strip()
        widgets.same_line()
        if widgets.icon_button(ICON.folder, "browse folder", "Browse…", theme.TEXT):

            def chosen(path: Path) -> None:
                settings.export_folder = under_home(path)
                self.messages.note(f"Exports go to {path}.")

            start = expanded(settings.export_folder)
            self.dialogs.ask(DialogKind.FOLDER, "Folder of exports", start, chosen)

    def _bindings(self, setting: str, table: Mapping[Action, str], texts: Mapping[str, str]) -> None:
        """Draw the action of each button or key; binding one in use swaps the two, with a message."""
        changes = getattr(self.settings, setting)
        for action, key in bound(table, changes).items():
            widgets.row(_named(action))
            chosen = str(widgets.combo(f"##{setting} {action.name.lower()}", tuple(texts.items()), key))
            if chosen != key:
                changes, had = rebound(table, changes, action, chosen)
                setattr(self.settings, setting, changes)
                others = " and ".join(map(_named, had))
                gets = f" {others} is now on {texts[key]}." if had else ""
                self.messages.note(f"{_named(action)}: {texts[chosen]}.{gets}")

    def _model(self) -> None:
        scene = self.scene
        widgets.row("Model", "Recorded takes keep the model that made them")
        now = model_folder(scene.model_folder)
        options: list[tuple[object, str]] = list(choices())
        if now not in dict(options):
            options.append((now, printable(f"{scene.model_name or 'none'}: {now}")))
        imgui.set_next_item_width(imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4))
        with widgets.disabled(self.jobs.busy(Slot("model"))):
            chosen = widgets.combo("##model", options, now)
        if chosen != now:
            self.choose_model(Path(str(chosen)))
        widgets.same_line()
        hint = "Choose the folder of an exported model"
        if widgets.icon_button(ICON.folder, "browse model", hint, theme.TEXT):
            start = Path.home() if scene.model_folder is None else scene.model_folder.parent
            self.dialogs.ask(DialogKind.FOLDER, "Folder of an exported model", start, self.choose_model)


def _named(action: Action) -> str:
    return action.name.replace("_", " ").capitalize()


@lru_cache(8)
def choices() -> tuple[tuple[Path, str], ...]:
    """Return the folder of every shipped model, with a description."""
    return tuple((folder, f"{name}: {use_of(folder)}") for name, folder in shipped_models().items())


def use_of(folder: Path) -> str:
    """Return a short statement of a shipped model's licence terms; ModelError if its metadata is damaged."""
    licence = str(read_metadata(folder).get("notes", {}).get("licence", ""))
    return FREE if licence.startswith("CC BY 4.0") else BOUND
