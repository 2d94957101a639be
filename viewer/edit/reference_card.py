"""The card of the reference compared with the playing take, a film's picture, and the menu to choose it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from runtime.character.read import MOTIONS
from runtime.character.read import SUFFIXES as CHARACTERS
from viewer.edit.reference import LIMITS, Look, References
from viewer.edit.video import SUFFIXES as VIDEOS
from viewer.edit.video import Video
from viewer.gl_bindings import imgui
from viewer.gui import panels, theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.session.opening import open_reference
from viewer.session.playback import Playback

WIDTH_PX, SMALL_WIDTH_PX = 292.0, 178.0  # minimum width of a film's card, at scale 1
SMALL_VIEW_PX = 520.0
MIN_VIEW_PX = 230.0  # a narrower view has no room for it
# of the line without a film: long or short labels, and characters of the name before them
LINE_WIDTH_PX, SMALL_LINE_WIDTH_PX, NAME_WIDTH_PX, MIN_NAME_PX = 318.0, 242.0, 120.0, 36.0
Browse = Callable[[str, tuple[str, ...], Callable[[Path], None]], None]  # title, endings, called with file


@dataclass
class ReferenceCard:
    """The card of a reference and its menu; `browse` shows a file dialog."""

    reference: References
    browse: Browse
    ctx: Any  # OpenGL context
    corner_taken: Callable[[], bool] = lambda: False  # another card occupies the top right of the view
    _texture: Any = field(default=None, init=False)
    _shown: tuple[Video, int] | None = field(default=None, init=False)

    def panel(self) -> Panel:

        shown = lambda: self.reference.shown  # noqa: E731
        return Panel(
            "Reference",
            PanelPlace.VIEW,
            self._draw,
            shown=shown,
            close=self.reference.close,
            covers=self._film_width,
        )

    def menu(self) -> None:
        """Draw the menu entries: the other takes, and a file."""
        reference = self.reference
        played = reference.takes.played
        others = [take for take in reference.takes.session.takes if played and take.number != played.number]
        for take in others:
            label = widgets.named(take.title, f"compare {take.number}")
            if widgets.item(label, chosen=reference.take == take):
                reference.show(take.number)
        if others:
            imgui.separator()
        hint = "BVH, GLB or FBX of any two-legged skeleton, MP4, WebM, GIF, WebP"
        if widgets.item("A take or film from a file…", hint):
            self.browse("Compare the take with", (*MOTIONS, *VIDEOS), self.open)
        if reference.shown and widgets.item("Nothing"):
            reference.close()

    def open(self, path: Path) -> None:
        if path.suffix.lower() in MOTIONS:
            open_reference(self.reference.takes, path)
        else:
            self.reference.open_video(path)

    # --- the card

    @property
    def _film(self) -> Video | None:
        return None if self.reference.reference.over else self.reference.video

    def _film_width(self, view: Rect) -> float:
        """Return the width of a film's card over the view's left side, in screen units."""
        if self._film is None or self.reference.takes.playback is None or view.width < px(MIN_VIEW_PX):
            return 0.0
        least = SMALL_WIDTH_PX if view.width < px(SMALL_VIEW_PX) else WIDTH_PX
        return max(px(least), self.reference.reference.size * view.width) + px(panels.CARD_MARGIN_PX)

    def _draw(self, view: Rect) -> None:
        reference, playback, film = self.reference, self.reference.takes.playback, self._film
        if playback is None:
            return
        if reference.video is not None and film is None:
            self._over(reference.video, playback, view)
        if view.width < px(MIN_VIEW_PX):
            return
        if film is None:
            self._line(playback, view)
            return
        width = self._film_width(view) / px(1.0) - panels.CARD_MARGIN_PX
        with panels.card("Reference", view, width, bottom=True):
            if panels.card_title(reference.name, "reference"):
                reference.close()
            side = imgui.get_content_region_avail().x
            size = imgui.ImVec2(side, side * film.size[1] / film.size[0])
            imgui.image(self._picture(film, playback), size)
            self._fields(playback, wide=width >= WIDTH_PX)

    def _line(self, playback: Playback, view: Rect) -> None:
        """Draw name, fields and close button at the top of the view next to the session bar, where no character is.

        Below the view if that place is taken or too narrow.
        """
        reference = self.reference
        bar = imgui.internal.find_window_by_name("Session")
        taken = 0.0 if bar is None or not bar.active else bar.size.x + px(panels.CARD_MARGIN_PX)
        room = (view.width - 2 * px(panels.CARD_MARGIN_PX) - taken) / px(1.0)
        at_top = room >= SMALL_LINE_WIDTH_PX and not self.corner_taken()
        room = room if at_top else view.width / px(1.0) - 2 * panels.CARD_MARGIN_PX
        wide = room >= LINE_WIDTH_PX + MIN_NAME_PX
        fields = LINE_WIDTH_PX if wide else SMALL_LINE_WIDTH_PX
        name = min(
            imgui.calc_text_size(reference.name).x / px(1.0) + 2 * widgets.GAP_PX,
            NAME_WIDTH_PX,
            room - fields,
        )
        name = name if name >= MIN_NAME_PX else 0.0
        if not at_top:  # close to the timeline: feet are right above it
            view = replace(view, height=view.height + px(panels.CARD_MARGIN_PX - widgets.GAP_PX))
        with panels.card("Reference", view, min(fields + name, room), right=at_top, bottom=not at_top):
            if name:
                imgui.align_text_to_frame_padding()
                left = imgui.get_cursor_pos_x()
                widgets.label(widgets.elided(reference.name, px(name - widgets.GAP_PX)), theme.ACCENT)
                widgets.tooltip(reference.name)
                imgui.same_line(left + px(name))
            self._fields(playback, wide, imgui.get_frame_height() + px(widgets.GAP_PX))
            widgets.same_line()
            if widgets.icon_button(ICON.close, "close reference", "Close (Esc)", theme.TEXT):
                reference.close()

    def _fields(self, playback: Playback, wide: bool, spare: float = 0.0) -> None:
        """Draw offset, placement and look in one line, leaving `spare` screen units free."""
        reference = self.reference
        side, over = imgui.get_frame_height(), px(60 if wide else 44)
        others = over + px(widgets.GAP_PX) + (side + px(widgets.GAP_PX) if reference.video is None else 0.0)
        each = (imgui.get_content_region_avail().x - spare - others - px(widgets.GAP_PX)) / 2
        imgui.push_item_width(each)
        self._offset(playback.clip.fps, wide)
        widgets.same_line()
        if reference.video is None:
            self._aside(wide)
        else:
            self._fraction("opacity" if reference.reference.over else "size", wide)
        imgui.pop_item_width()
        widgets.same_line()
        hint = "In the same place, translucent" if reference.video is None else "Across the view, translucent"
        is_over = reference.reference.over
        if widgets.toggle("Over it" if wide else "Over", is_over, over, hint) != is_over:
            reference.set(over=not is_over)
        if reference.video is None:
            widgets.same_line()
            self._looks()

    def _offset(self, fps: float, wide: bool) -> None:
        low, high = LIMITS["offset_s"]
        limits, frames = (round(low * fps), round(high * fps)), round(self.reference.reference.offset_s * fps)
        hint = "Delay of the reference in frames. Drag, or double-click to type."
        text = "%+d frames" if wide else "%+d"
        moved, later = widgets.drag("##reference offset", frames, limits, text, hint, 0.3)
        if moved:
            self.reference.set(held=True, offset_s=later / fps)

    def _aside(self, wide: bool) -> None:
        reference, limits = self.reference.reference, LIMITS["aside_m"]
        text = "%.1f m aside" if wide else "%.1f m"
        hint = "Distance to the right of the take. Drag, or double-click to type."
        with widgets.disabled(reference.over):
            moved, aside_m = widgets.drag("##reference aside", reference.aside_m, limits, text, hint, 0.01)
        if moved:
            self.reference.set(held=True, aside_m=min(max(aside_m, limits[0]), limits[1]))

    def _fraction(self, name: str, wide: bool) -> None:
        (low, high), text = LIMITS[name], f"{name} %.0f %%" if wide else "%.0f %%"
        value = getattr(self.reference.reference, name) * 100.0
        moved, value = widgets.slider(f"##reference {name}", value, low * 100.0, high * 100.0, text)
        if moved:
            self.reference.set(held=True, **{name: min(max(value / 100.0, low), high)})
        widgets.tooltip(f"The picture's {name}")

    def _looks(self) -> None:
        reference, choice = self.reference, self.reference.reference.character
        hint = "The body that shows it: another character, its own skeleton"
        if widgets.icon_button(ICON.more, "reference look", hint):
            imgui.open_popup("look")
        if not imgui.begin_popup("look"):
            return
        for look in reference.looks:
            own = look is Look.CHARACTER and choice is not None
            name = Path(choice.path).name if own and choice is not None else str(look)
            if widgets.item(f"{name}##look {look}", chosen=look is reference.look):
                reference.set(look=str(look))
        imgui.separator()
        if widgets.item("Another character…"):
            self.browse("The reference's character", tuple(CHARACTERS), reference.open_character)
        imgui.end_popup()

    # --- the picture

    def _over(self, video: Video, playback: Playback, view: Rect) -> None:
        """Draw the film across the view, behind every panel, with the chosen opacity."""
        by = min(view.width / video.size[0], view.height / video.size[1])
        wide, high = video.size[0] * by, video.size[1] * by
        left, top = view.x + (view.width - wide) / 2, view.y + (view.height - high) / 2
        tint = widgets.packed((1.0, 1.0, 1.0, self.reference.reference.opacity))
        low, end = imgui.ImVec2(left, top), imgui.ImVec2(left + wide, top + high)
        corners = imgui.ImVec2(0, 0), imgui.ImVec2(1, 1)  # of the picture
        imgui.get_background_draw_list().add_image(self._picture(video, playback), low, end, *corners, tint)

    def _picture(self, video: Video, playback: Playback) -> Any:
        """Return the texture with the picture at the time shown."""
        index = video.index(self.reference.time_s(playback))
        if self._shown is None or self._shown[0] is not video or self._texture.size != video.size:
            if self._texture is not None:
                self._texture.release()
            self._texture, self._shown = self.ctx.texture(video.size, 3, alignment=1), None
        if self._shown is None or self._shown[1] != index:
            self._texture.write(video.picture(index).tobytes())
            self._shown = video, index
        return imgui.ImTextureRef(self._texture.glo)
