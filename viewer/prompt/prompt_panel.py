"""The prompt panel: the prompt, who answered, six editable descriptions, a blend, and prompts to choose from."""

from collections.abc import Callable
from dataclasses import dataclass, field

from runtime.prompts.edit_targets import edited_parts
from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.gpt.settings import GptSettings
from runtime.prompts.phrasing import HARDLY_SHOWN_FRACTION, adherence_of
from runtime.session.prompt_blend import PromptBlend, Side
from runtime.skeleton import PART_NAMES
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt import language_model, prompt_field
from viewer.prompt.answer_view import draw_answer
from viewer.prompt.language_model import LanguageModel
from viewer.prompt.prompt_controller import PromptController, named, part_words
from viewer.prompt.suggestions import Suggester
from viewer.render.looks import packed_tint
from viewer.services import Loaded
from viewer.settings import Settings

HINT = "How should the character move?\nFor example: an exhausted soldier"
HINT_B = "A second prompt to blend with"
EXACT_HINT = (
    "A body edit adds what the network does not show of these words. “Exact edits” in Settings turns it off."
)
WEAK_HINT = "The walk shows little of these words. Other words may show more."
NEAREST_ROWS = 3  # in a tall panel, else one
MIN_LINES, MAX_LINES = 2, 3  # of the field of a body part
# pixels at scale 1
TALL_PANEL_PX = 620.0
MIN_LIST_HEIGHT_PX = 150.0
TOOLS_WIDTH_PX = 3 * 26.0 + 2 * 4.0
LABEL_HEIGHT_PX, ROW_GAP_PX = 17.0, 4.0
PART_WIDTH_PX = 70.0


@dataclass
class PromptPanel:
    settings: Settings
    controller: PromptController
    language_model: LanguageModel
    suggester: Suggester
    compare: Callable[[], object]  # opens the compare view
    model: str = ""  # the loaded one's name
    search: str = ""
    tab_requested: str = ""  # "blend": to show in the next frame
    # `weakly_shown` of each part
    _weak: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(PART_NAMES))
    _exact: frozenset[str] = frozenset()  # parts whose words are shown by an edit
    _weak_of: tuple[object, str] = (None, "")  # answer and model for which these hold

    def use_model(self, loaded: Loaded, given: GptSettings | None, again: bool = True) -> None:
        """Use the prompt workers of a newly loaded model, opened with the language model settings `given`.

        `again`: codes of the session must be encoded anew for this model.
        """
        self.model = loaded.name
        self.controller.measure_blends(loaded.perceptual_weights)
        self.suggester.nearest = loaded.library.nearest
        self.language_model.use(loaded, given, again)

    def panel(self, shown: Callable[[], bool]) -> Panel:
        return Panel(
            "Prompt", PanelPlace.LEFT, self._draw, ICON.prompt, shown,
            tools=self._tools, tools_width=TOOLS_WIDTH_PX, begin_typing=self._begin_typing,
        )  # fmt: skip

    def _begin_typing(self) -> None:
        self.controller.boxes[Side.A].focus_requested = True

    def _tools(self) -> None:
        controller, model = self.controller, self.language_model
        prompt_field.undo_buttons(controller.editor, "", px(widgets.GAP_PX), 26.0, bool(controller.pending))
        widgets.same_line()
        hint = model.problem or f"Who answers prompts: {model.name or 'the library'}"
        tint = theme.WARNING if model.problem else theme.TEXT
        if widgets.icon_button(ICON.gear, "who", hint, tint, size=26.0):
            imgui.open_popup(language_model.POPUP)
        corner = imgui.get_window_pos()
        right = corner.x + imgui.get_window_width() + px(8)
        language_model.draw(model, imgui.ImVec2(right, corner.y))

    def _draw(self, _: Rect) -> None:
        controller = self.controller
        # the button below stays in reach while the list is open
        below = imgui.get_frame_height_with_spacing()
        prompt_field.draw(controller, self.suggester, Side.A, HINT, below=below)
        self._apply()
        blend = controller.prompt
        rows = NEAREST_ROWS if imgui.get_window_height() >= px(TALL_PANEL_PX) else 1
        # items below keep their place when an answer arrives
        top, line = imgui.get_cursor_pos_y(), imgui.get_text_line_height() + px(3)
        height = line * (1 + max(rows, 2)) + px(4)
        near, flags = "", imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
        if imgui.begin_child("answer", imgui.ImVec2(0, height), window_flags=flags):
            if blend.b is not None:
                _no_blend(controller, blend)
                rows = min(rows // 2, 1)
            near = draw_answer(controller, blend, Side.A, rows, 2 if rows > 1 else 1)
        imgui.end_child()
        imgui.set_cursor_pos_y(top + height)
        if near:
            controller.submit_prompt(near)
        self._tabs(blend.blended)

    def _tabs(self, blended: bool) -> None:
        if not imgui.begin_tab_bar("prompt tabs"):
            return
        if widgets.tab("Body parts"):
            _scrolling("parts", self._parts)
            imgui.end_tab_item()
        if widgets.tab("Ready prompts"):
            self._ready()
            imgui.end_tab_item()
        wanted = imgui.TabItemFlags_.set_selected if self.tab_requested == "blend" else 0
        if widgets.tab(f"Blend{' •' if blended else ''}###blend", wanted):
            self.tab_requested = ""
            _scrolling("blend", lambda: _blend(self.controller, self.suggester))
            imgui.end_tab_item()
        imgui.end_tab_bar()

    def _apply(self) -> None:
        width, text = imgui.get_content_region_avail().x, self.controller.boxes[Side.A].text
        hint = "Enter in the box does the same; Ctrl+Enter starts a new line"
        if widgets.button(f"{ICON.wand} Apply", width * 0.29, hint, primary=True) and text.strip():
            self.controller.submit_prompt(text)
        widgets.same_line()
        hint = "Seeds, blends or prompts side by side on one stick (V)"
        if widgets.button("Compare", width * 0.27, hint):
            self.compare()
        widgets.same_line()
        widgets.full_width()
        widgets.setting_slider(self.settings, "blend_seconds")
        widgets.full_width()
        widgets.setting_slider(self.settings, "strength")

    def _parts(self) -> None:
        """Divide the available height among the six fields; they scroll if it is too small."""
        blend, words = self.controller.prompt, part_words(self.controller.prompt)
        if self._weak_of[0] is not blend.a or self._weak_of[1] != self.model:
            self._weak_of = blend.a, self.model
            self._weak = {part: weakly_shown(blend, part, self.model) for part in PART_NAMES}
            self._exact = edited_parts(None if blend.a is None else blend.a.words)
        line, padding = imgui.get_text_line_height(), 2 * imgui.get_style().frame_padding.y
        free = imgui.get_content_region_avail().y / len(PART_NAMES) - px(LABEL_HEIGHT_PX + 2 + ROW_GAP_PX)
        height = min(max(free, MIN_LINES * line + padding), MAX_LINES * line + padding)
        across = imgui.get_style().item_spacing.x
        for part in PART_NAMES:
            imgui.push_id(part)
            imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(across, px(2)))
            self._part_heading(part, blend, words[part])
            imgui.pop_style_var()
            imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(across, px(ROW_GAP_PX)))
            _part_field(part, words[part], height, self.controller)
            imgui.pop_style_var()
            imgui.pop_id()

    def _part_heading(self, part: str, blend: PromptBlend, words: str) -> None:
        """Draw the part's name and marks on the left, reset and lock on the right."""
        top, width = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
        answer, locked = blend.a, part in blend.locked
        said = getattr(answer.said, part) if answer is not None and part in answer.edited else ""
        tint = theme.TEXT if locked else theme.MUTED
        if self.settings.look == "parts":
            tint = packed_tint(PART_NAMES.index(part))
        widgets.label(named(part).capitalize(), tint)
        if self.controller.parts[part] != words:
            _mark("Enter applies", theme.WARNING)
        else:
            if said:
                _mark("kept" if locked else "edited", theme.ACCENT)
            self._adherence(part)
        weight = blend.weights[PART_NAMES.index(part)]
        if blend.b is not None and weight > 0.0:
            _mark(f"{weight:.0%} of B", theme.MUTED)
        _part_buttons(part, said, locked, imgui.ImVec2(top.x + width, top.y - px(2)), self.controller)
        imgui.set_cursor_pos(imgui.ImVec2(top.x, top.y + px(LABEL_HEIGHT_PX + 2)))

    def _adherence(self, part: str) -> None:
        """Mark how closely the body follows the words, if worth mentioning."""
        weak = self._weak[part]
        if self.settings.exact_legs and part in self._exact:
            _mark("by an exact edit", theme.MUTED)
            widgets.tooltip(EXACT_HINT)
        elif weak is not None:
            _mark(f"hardly shown ({weak:.0%})", theme.WARNING)
            widgets.tooltip(WEAK_HINT)

    def _ready(self) -> None:
        widgets.full_width()
        _, self.search = imgui.input_text_with_hint("##search", f"{ICON.search} Search", self.search)
        words = self.search.lower().split()
        lists = {
            "Your last prompts": self.settings.prompt_history,
            "One for each style of the model": self.suggester.ready,
        }
        found = {
            title: [text for text in texts if all(word in text.lower() for word in words)]
            for title, texts in lists.items()
        }
        height = max(imgui.get_content_region_avail().y, px(MIN_LIST_HEIGHT_PX))
        if imgui.begin_child("ready list", imgui.ImVec2(0, height)):
            if not any(found.values()):
                widgets.muted("No prompt has these words. Type it above: any prompt works.", wrap=True)
            for title, texts in found.items():
                if texts:
                    widgets.label(title)
                    self._choices(title, texts)
        imgui.end_child()

    def _choices(self, name: str, texts: list[str]) -> None:
        imgui.indent(px(6))  # a row's highlight begins left of its text
        width = imgui.get_content_region_avail().x
        shown = self.controller.prompt.prompt(Side.A)
        for text in texts:
            fitted = widgets.elided(text, width)
            if imgui.selectable(f"{fitted}##{name}{text}", text == shown)[0]:
                self.controller.submit_prompt(text)
            if fitted != text:
                widgets.tooltip(text)
        imgui.unindent(px(6))


def _scrolling(name: str, contents: Callable[[], None]) -> None:
    """Contents that scroll in the remaining height, or with the whole panel if that is too small."""
    if imgui.get_content_region_avail().y < px(MIN_LIST_HEIGHT_PX):
        contents()
        return
    if imgui.begin_child(name, imgui.ImVec2(0, 0)):
        contents()
    imgui.end_child()


def _mark(text: str, tint: theme.Color) -> None:
    imgui.same_line(0, px(6))
    widgets.label(text, tint)


def _lock_button(name: str, locked: bool, hint: str, size: float = 0.0) -> bool:
    icon, tint = (ICON.lock, theme.ACCENT) if locked else (ICON.unlock, theme.MUTED)
    return widgets.icon_button(icon, name, hint, tint, size=size)


# --- the six fields


def weakly_shown(blend: PromptBlend, part: str, model: str) -> float | None:
    """Return the fraction (0 to 1) of a part's words that a walk of the model shows, if it is very small, else None.

    Always None for the default walk.
    """
    if blend.a is None or (blend.a.prompt == DEFAULT_PROMPT and part not in blend.a.edited):
        return None
    shown = adherence_of(model).of(getattr(blend.a.words, part), part)
    return shown if shown is not None and shown < HARDLY_SHOWN_FRACTION else None


def _part_buttons(
    part: str, said: str, locked: bool, right: imgui.ImVec2, controller: PromptController
) -> None:
    """Draw reset (to the expander's words `said`, if edited) and lock; they end at `right`."""
    size = LABEL_HEIGHT_PX + 3
    if said:
        imgui.set_cursor_pos(imgui.ImVec2(right.x - 2 * px(size) - px(2), right.y))
        if widgets.icon_button(ICON.original, "reset", f"Reset to “{said}”", size=size):
            controller.reset_part(part)
    imgui.set_cursor_pos(imgui.ImVec2(right.x - px(size), right.y))
    free = "Keep these words when the prompt changes"
    if _lock_button("lock", locked, "Locked: a new prompt keeps these words" if locked else free, size):
        controller.toggle_lock(part)


def _part_field(part: str, words: str, height: float, controller: PromptController) -> None:
    field_id, typed = imgui.get_id("##words"), controller.parts[part]
    active = prompt_field.is_active(field_id)
    if active:
        prompt_field.undo_keys(field_id, typed == words, controller.editor)
        typed = controller.parts[part]
    fill = theme.ACCENT_LOCKED if part in controller.prompt.locked else theme.FIELD
    with widgets.color(imgui.Col_.frame_bg, fill):
        _, typed = imgui.input_text_multiline(
            "##words", typed, imgui.ImVec2(-1, height), prompt_field.WRAPPED
        )
    controller.parts[part] = typed
    left = imgui.is_item_deactivated_after_edit()  # by Enter or otherwise
    padding = imgui.get_style().frame_padding
    width = imgui.get_item_rect_size().x - 2 * padding.x
    overflows = imgui.calc_text_size(typed, False, width).y > height - 2 * padding.y + 1.0
    if not active and overflows:
        widgets.tooltip(typed)
    if left and typed != controller.applied(part):
        controller.submit_part(part)


# --- the blend


def _blend(controller: PromptController, suggester: Suggester) -> None:
    widgets.label("Prompt B")
    prompt_field.draw(controller, suggester, Side.B, HINT_B, lines=1)
    blend = controller.prompt
    if blend.b is None and Side.B not in controller.pending:
        widgets.muted("Type a second prompt: each body part is blended by its own slider.", wrap=True)
        return
    draw_answer(controller, blend, Side.B, rows=0, lines=1)
    if blend.b is None:
        return
    imgui.dummy(imgui.ImVec2(0, px(1)))
    right = imgui.get_content_region_avail().x - imgui.calc_text_size("Prompt B").x * 0.87
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + px(PART_WIDTH_PX))
    widgets.label("Prompt A")
    imgui.same_line(imgui.get_cursor_start_pos().x + right)
    widgets.label("Prompt B")
    with widgets.disabled(len(blend.locked) == len(PART_NAMES)):
        moved, weight = _weight_slider("All", "all", blend.master_weight)
    if moved:
        controller.set_all_weights(weight)
    widgets.tooltip("Weight of all unlocked parts")
    imgui.separator()
    words, words_b = part_words(blend), blend.b.words
    for part, weight in zip(PART_NAMES, blend.weights, strict=True):
        _part_weight(part, weight, f"A: {words[part] or '…'}\nB: {getattr(words_b, part)}", controller)
    imgui.dummy(imgui.ImVec2(0, px(1)))
    hint = "Prompt B becomes prompt A, so that its words can be edited"
    if widgets.button(f"{ICON.exchange} Swap A and B", -1, hint, enabled=not controller.pending):
        controller.swap()


def _part_weight(part: str, weight: float, words: str, controller: PromptController) -> None:
    locked = part in controller.prompt.locked
    spare = imgui.get_frame_height() + px(2)
    with widgets.disabled(locked):
        moved, value = _weight_slider(named(part).capitalize(), part, weight, spare)
    if moved:
        controller.set_weight(part, value)
    widgets.tooltip(words)
    widgets.same_line()
    free = "Hold this part's words and weight"
    hint = "Locked: no prompt and no slider changes this part" if locked else free
    if _lock_button(f"lock {part}", locked, hint):
        controller.toggle_lock(part)


def _weight_slider(text: str, name: str, weight: float, spare: float = 0.0) -> tuple[bool, float]:
    start = imgui.get_cursor_pos_x()
    imgui.align_text_to_frame_padding()
    widgets.muted(text)
    imgui.same_line(start + px(PART_WIDTH_PX))
    imgui.set_next_item_width(imgui.get_content_region_avail().x - spare)
    moved, percent = widgets.slider(f"##{name}", 100.0 * weight, 0.0, 100.0, "%.0f%% B")
    return moved, min(max(percent / 100.0, 0.0), 1.0)


def _no_blend(controller: PromptController, blend: PromptBlend) -> None:
    width = px(96)
    left = imgui.get_content_region_avail().x - width
    text = f"B {100 * blend.master_weight:.0f} %: {blend.prompt(Side.B) or 'own words'}"
    imgui.align_text_to_frame_padding()
    shown = widgets.elided(text, left - px(8))
    widgets.muted(shown)
    widgets.tooltip(text if shown != text else "")
    imgui.same_line(imgui.get_cursor_start_pos().x + left)
    if widgets.button(f"{ICON.close} No blend", width, "Back to prompt A alone"):
        controller.drop_blend()
