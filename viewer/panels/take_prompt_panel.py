"""The prompt panel of the playing take, in place of the live one, with the prompt at the frame shown."""

from runtime.prompts.expander import MAX_PROMPT_CHARACTERS
from runtime.skeleton import PART_NAMES
from runtime.takes.metadata import title
from viewer.edit.resimulation import Resimulation, restyle
from viewer.edit.tracks import Mark, mark_at, words_of
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.prompt.prompt_field import wrapped_text


def panel(editing: Resimulation) -> Panel:
    """Return the prompt panel of the playing take, which replaces the live one."""
    return Panel(
        "Prompt", PanelPlace.LEFT, lambda _: draw(editing), ICON.prompt,
        shown=lambda: editing.playback is not None, begin_typing=lambda: _begin_typing(editing),
    )  # fmt: skip


def _begin_typing(editing: Resimulation) -> None:
    editing.focus_requested = True


def draw(editing: Resimulation) -> None:
    tracks, playback = editing.tracks, editing.playback
    if tracks is None or playback is None:
        return
    index = mark_at(tracks.prompts, playback.frame)
    if index < 0:
        _restyle(editing)
        return
    mark = tracks.prompts[index]
    if editing.shown is not mark:
        event = mark.of.event
        words = words_of(event)
        editing.shown, editing.prompt = mark, title(event, MAX_PROMPT_CHARACTERS)  # Enter sends what is there
        editing.parts = dict.fromkeys(PART_NAMES, "") if words is None else dict(words.to_mapping())
    take = editing.take
    zero = 0 if take is None else take.numbered_from
    frames = f", frames {mark.start - zero} to {mark.end - 1 - zero}"
    room = imgui.get_content_region_avail().x - imgui.calc_text_size(frames).x
    widgets.muted("" if take is None else widgets.elided(take.title, room) + frames)
    fixed = editing.fixed
    with widgets.disabled(fixed):
        _prompt(editing, index)
    widgets.muted(fixed or "Enter resimulates the take.", wrap=True)
    _parts(editing, index, mark, bool(fixed))


def _restyle(editing: Resimulation) -> None:
    """Draw a prompt field for a motion without prompts, to restyle it."""
    if editing.shown is not None:
        editing.shown, editing.prompt = None, ""
    widgets.muted("This motion has no prompt. Type one to walk its path again in another style.", wrap=True)
    with widgets.disabled(editing.busy):
        entered, editing.prompt, _ = wrapped_text("##restyle prompt", editing.prompt)
        _hold(editing)
        if widgets.button(f"{ICON.wand} Restyle", -1, primary=True) or entered:
            restyle(editing, editing.prompt)
    widgets.muted("The new take is added to the list, on the ground shown.", wrap=True)


def _prompt(editing: Resimulation, index: int) -> None:
    if editing.focus_requested:
        imgui.set_keyboard_focus_here()
    editing.focus_requested = False
    entered, editing.prompt, _ = wrapped_text("##take prompt", editing.prompt)
    _hold(editing)
    if widgets.button(f"{ICON.wand} Apply to the take", -1, primary=True) or entered:
        editing.reword(index, editing.prompt)


def _parts(editing: Resimulation, index: int, mark: Mark, fixed: bool) -> None:
    if words_of(mark.of.event) is None:
        widgets.muted("A blend, or unknown descriptions: type one prompt to edit body parts.", wrap=True)
        return
    if imgui.begin_child("take parts", imgui.ImVec2(0, 0)):
        for part in PART_NAMES:
            widgets.label(part.replace("_", " ").capitalize())
            with widgets.disabled(fixed):
                entered, editing.parts[part], _ = wrapped_text(f"##take {part}", editing.parts[part])
            _hold(editing)
            if entered:
                editing.reword_part(index, part, editing.parts[part])
    imgui.end_child()


def _hold(editing: Resimulation) -> None:
    """Pause while a field is edited: playing on would switch to another prompt's text."""
    if imgui.is_item_active() and editing.playback is not None:
        editing.playback.playing = False
