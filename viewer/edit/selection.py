"""The selection of items on tracks or in the list of takes, and the commands on it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from runtime.errors import SportError
from runtime.session.session import LIVE, Session
from runtime.takes.input_edits import Edit
from runtime.takes.input_recording import InputRecording
from viewer.edit.resimulation import Resimulation
from viewer.edit.tracks import Item, ItemKind, Items, Key
from viewer.gl_bindings import imgui
from viewer.gui import widgets

KEY_GAP_FRAMES = 10  # between keys and their duplicates
NUDGE_FRAMES = {False: 1, True: 10}  # per arrow key, without and with Shift


@dataclass
class Selection:
    """Selected items of the tracks and the takes list, and copied ones."""

    editing: Resimulation
    kinds: dict[str, ItemKind] = field(default_factory=dict)
    keys: frozenset[Key] = frozenset()
    copied: tuple[Item, ...] = ()
    # the take, and the moved items with their goals, which its tracks show until it is resimulated
    preview: tuple[int, Items, Items] | None = None
    _subject: int = LIVE

    @property
    def number(self) -> int:
        """Number of the take whose tracks are shown."""
        return LIVE if self.editing.take is None else self.editing.take.number

    def all(self, kinds: Iterable[str]) -> list[Item]:
        """Return all items of the given kinds."""
        return [item for kind in kinds for item in self.kinds[kind].items()]

    @property
    def items(self) -> list[Item]:
        """The selected items."""
        if not self.keys:
            return []
        return [item for item in self.all(self.kinds) if item.key in self.keys]

    @property
    def listed(self) -> bool:
        """Whether the selection is in a list rather than on a track."""
        return any(self.kinds[key[0]].listed for key in self.keys)

    def poll(self) -> None:
        """Deselect items on the tracks of another take; call once per frame."""
        if self._subject != self.number:
            self._subject, self.preview = self.number, None
            self.keys = frozenset(key for key in self.keys if self.kinds[key[0]].listed)
        if self.preview is not None and not (self.editing.busy or imgui.is_mouse_down(0)):
            self.preview = None
            if not self.items:
                self.keys = frozenset()

    # --- what is selected

    def pick(self, items: Iterable[Item], extend: bool = False) -> None:
        """Select items; `extend` adds them, or removes them if all are selected already."""
        new = frozenset(item.key for item in items)
        kept = frozenset(
            k for k in self.keys if all(self.kinds[k[0]].listed is self.kinds[n[0]].listed for n in new)
        )
        self.keys = (kept - new if new <= kept else kept | new) if extend else new

    def pick_all(self) -> None:
        """Select all items of the selected kinds, or of all tracks."""
        tracks = {name for name, kind in self.kinds.items() if not kind.listed}
        self.pick(self.all({key[0] for key in self.keys} or tracks))

    def let_go(self) -> bool:
        """Deselect everything; return whether anything was selected."""
        was, self.keys = bool(self.keys), frozenset()
        return was

    # --- commands

    def delete(self) -> None:
        self.replace("removal", self.items, [])

    def copy(self) -> None:
        if self.keys:
            self.copied = tuple(self.items)
            self.editing.takes.messages.note(f"Copied: {self.named(self.copied)}.")

    def cut(self) -> None:
        self.copy()
        self.delete()

    def paste(self) -> None:
        """Paste the copied items, the first at the frame shown."""
        playback = self.editing.playback
        if self.copied and self.kinds[self.copied[0].kind].listed:
            self.replace("paste", [], self.copied)
        elif self.copied and playback is not None:
            self._put_again("paste", self.copied, playback.frame - min(item.start for item in self.copied))

    def duplicate(self) -> None:
        """Duplicate the selected items behind themselves, or before if there is no room."""
        items, playback = self.items, self.editing.playback
        if items and self.listed:
            self.replace("duplicate", [], items)
        elif items and playback is not None:
            first, last = min(item.start for item in items), max(item.end for item in items)
            by = last - first + KEY_GAP_FRAMES * any(item.start == item.end for item in items)
            self._put_again("duplicate", items, by if last + 1 < playback.frames - KEY_GAP_FRAMES else -by)

    def _put_again(self, label: str, items: Items, by: int) -> None:
        end = self._end
        moved = [
            item.at(max(item.start + by, 0), min(item.end + by, end))
            for item in items
            if item.start + by < end and (item.end + by > 0 or item.start + by == 0)
        ]
        if moved:
            self.replace(label, [], moved)
        else:
            self.editing.takes.messages.note("There is no room for that in the take.")

    def moved(self, items: Items, by: int) -> list[Item]:
        """Return the items shifted by `by` frames, as far as the take allows.

        An item ending with the take keeps that end; every item keeps at least one frame.
        """
        end, moving = self._end, [self._edges_that_move(item) for item in items]
        for item, (start, last) in zip(items, moving, strict=True):
            if start or last:
                by = max(by, -item.start if start else item.start + 1 - item.end)
                by = min(by, end - max(item.end, item.start + 1) if last else item.end - 1 - item.start)
        edges = zip(items, moving, strict=True)
        return [item.at(item.start + by * start, item.end + by * last) for item, (start, last) in edges]

    def _edges_that_move(self, item: Item) -> tuple[bool, bool]:
        adjacent = self.kinds[item.kind].adjacent
        return not (adjacent and item.start == 0), not (adjacent and item.end == self._end)

    @property
    def _end(self) -> int:
        return 0 if self.editing.playback is None else self.editing.playback.frames

    def resized(self, item: Item, by: int, start: bool) -> Item:
        """Return the item with its start or end shifted by `by` frames."""
        end = self._end
        if start:
            return item.at(min(max(item.start + by, 0), item.end - 1), item.end)
        return item.at(item.start, max(min(item.end + by, end), item.start + 1))

    def nudge(self, by: int) -> None:
        """Move the selected items by frames, or by positions in a list."""
        items = self.items
        if items:
            listed = [item.at(item.start + by, item.end + by) for item in items]
            self.replace("move", items, listed if self.listed else self.moved(items, by))

    def replace(self, label: str, gone: Items, put: Items, held: bool = False) -> None:
        """Replace items by others and select these, as one step of undo.

        `held` during a drag; an edit that needs resimulation is previewed until the mouse is released.
        """
        if list(gone) == list(put) and not held:
            self.preview = None
            return
        editor, messages = self.editing.takes.editor, self.editing.takes.messages
        names = {item.kind for item in (*gone, *put)}
        kinds = [kind for name, kind in self.kinds.items() if name in names]
        refusal = self._refusal(kinds)
        if refusal:
            messages.warn(refusal)
            return
        try:
            after, now = self._changed(editor.history.present.session, kinds, gone, put)
        except SportError as error:
            messages.error(error)
            return
        self.keys = frozenset(item.key for item in now)
        self._make(f"{label} of {self.named(gone or put)}", kinds, gone, put, after, held)

    def _refusal(self, kinds: Sequence[ItemKind]) -> str:
        """Return why an edit of these kinds is impossible now, or ""."""
        waits = self.editing.busy and not all(kind.listed for kind in kinds)
        return self.editing.fixed if waits or any(kind.edit for kind in kinds) else ""

    def _own(self, kind: ItemKind, *parts: Items) -> list[list[Item]]:
        return [[item for item in items if self.kinds[item.kind] is kind] for items in parts]

    def _changed(
        self, session: Session, kinds: Sequence[ItemKind], gone: Items, put: Items
    ) -> tuple[Session, list[Item]]:
        """Return the session after the immediate changes, and the items added."""
        now = [item for item in put if self.kinds[item.kind].edit is not None]
        for kind in kinds:
            if kind.change is not None:
                session, made = kind.change(session, self.number, *self._own(kind, gone, put))
                now += made
        return session, now

    def _make(
        self,
        what: str,
        kinds: Sequence[ItemKind],
        gone: Items,
        put: Items,
        after: Session,
        held: bool,
    ) -> None:
        """Apply `after`: as a step of undo unless the mouse is held; changed input is resimulated once."""
        editor, take = self.editing.takes.editor, self.editing.take
        driven, listed = [kind for kind in kinds if kind.edit is not None], all(kind.listed for kind in kinds)
        self.preview = (self.number, gone, put) if driven else None

        def edit(inputs: InputRecording) -> Edit:
            made = Edit(inputs, len(inputs))
            for kind in driven:
                assert kind.edit is not None
                now = kind.edit(made.inputs, *self._own(kind, gone, put))
                made = Edit(now.inputs, min(made.first, now.first))
            return made

        if driven and not held:
            editor.drop_drag()
            self.editing.again(what, edit, lambda _: after)
            return
        editor.drag(what if take is None or listed else f"{what} of {take.title}", lambda _: after)
        if not held:
            editor.finish_drag()

    def named(self, items: Items) -> str:
        """Return a phrase for the items: the kind of a single one, the count of several."""
        kinds = {self.kinds[item.kind].name for item in items}
        name = kinds.pop() if len(kinds) == 1 else "item"
        article = "an" if name[0] in "aeiou" else "a"
        return f"{article} {name}" if len(items) == 1 else f"{len(items)} {name}s"

    # --- keys and menu

    def use_keys(self) -> None:
        """Run the commands of keys pressed in this frame."""
        for _, _, chord, act, enabled in self._commands:
            if chord and enabled and imgui.is_key_chord_pressed(chord):
                act()
        across = imgui.Key.left_arrow, imgui.Key.right_arrow
        back, on = (imgui.Key.up_arrow, imgui.Key.down_arrow) if self.listed else across
        by = NUDGE_FRAMES[imgui.get_io().key_shift and not self.listed]
        for key, frames in ((back, -by), (on, by)):
            if self.keys and imgui.is_key_pressed(key):
                self.nudge(frames)

    def menu(self) -> None:
        """Draw the context menu entries."""
        for text, keys, _, act, enabled in self._commands:
            if widgets.item(text, keys, enabled=enabled):
                act()

    @property
    def _commands(self) -> tuple[tuple[str, str, int, Callable[[], None], bool], ...]:
        """Return name, shortcut text, key chord and function of each command, and whether it is enabled."""
        ctrl, key, some = int(imgui.Key.mod_ctrl), imgui.Key, bool(self.keys)
        back, on = ("up", "down") if self.listed else ("back", "on")
        return (
            ("Cut", "Ctrl+X", ctrl | int(key.x), self.cut, some),
            ("Copy", "Ctrl+C", ctrl | int(key.c), self.copy, some),
            ("Paste", "Ctrl+V", ctrl | int(key.v), self.paste, bool(self.copied)),
            ("Duplicate", "Ctrl+D", ctrl | int(key.d), self.duplicate, some),
            ("Delete", "Del", int(key.delete), self.delete, some),
            (f"Move {back}", "Arrow keys", 0, lambda: self.nudge(-1), some),
            (f"Move {on}", "Arrow keys", 0, lambda: self.nudge(1), some),
            ("Select all", "Ctrl+A", ctrl | int(key.a), self.pick_all, True),
        )
