"""Lost items, which no step of a session refers to: the file keeps them for `LOST_DAYS`, and they can be restored until then."""

import logging
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from runtime.safe_read import parse_json
from runtime.session.document import MAX_ITEMS
from runtime.session.sqlite_file import MAX_FILE_BYTES
from runtime.session.stored_rows import Writer
from runtime.session.tables import INPUT, TAIL

LOST_DAYS = 30
MAX_RECOVERED_TAKES = 2000  # at once; further ones follow next time
MAX_STORED_BYTES = MAX_FILE_BYTES // 2  # file size above which the oldest lost items are removed early
_REFERENCE = re.compile(r"(<f[48]|\|[iu]1) [0-9x]* ([0-9a-f]{32})")
_LOG = logging.getLogger("sport.session")


@dataclass(frozen=True)
class LostTake:
    """A motion that no step refers to any more."""

    key: str
    name: str
    seconds: float
    since_s: int  # since 1970


def settle(writer: Writer, held: Iterable[str], now_s: int) -> set[str]:
    """Record which motions nothing refers to, remove those lost for `LOST_DAYS`, and return the removed keys."""
    named = _named(writer)
    used = named | _inputs(writer, set(held))
    motions, blobs = writer.kept()
    noted = {key: since_s for key, since_s, _ in writer.lost()}
    writer.find(named & noted.keys())
    unused = [key for key in dict.fromkeys((*noted, *motions, *blobs)) if key not in used]
    writer.lose(unused, now_s)  # items already recorded keep their time
    due = [key for key in unused if noted.get(key, now_s) < now_s - 86400 * LOST_DAYS]
    _remove(writer, due)
    rest = [key for key in unused if key not in due]
    while rest and writer.stored_bytes() > MAX_STORED_BYTES:
        early, rest = rest[: len(rest) // 8 + 1], rest[len(rest) // 8 + 1 :]
        _remove(writer, early)
        due += early
    return set(due)


def _remove(writer: Writer, keys: list[str]) -> None:
    """Remove lost items, keeping their texts in the log."""
    texts = {key: text for key, _, text in writer.lost()}
    for key in keys:
        text = texts.get(key) or writer.motion(key)
        if text:
            _LOG.info("no step has named %s for %d days, it is removed: %s", key, LOST_DAYS, text)
    writer.remove(keys)


def _named(writer: Writer) -> set[str]:
    """Return keys of the motions and blobs that steps refer to."""
    steps, inner = _Names(), _Names()
    for document in writer.documents():
        steps.add(document)
    for key in steps.texts | steps.characters:
        inner.add(writer.blob(key).decode("utf-8", "replace"))
    return steps.blobs | inner.blobs | steps.characters | _inputs(writer, inner.motions)


def _inputs(writer: Writer, motions: set[str]) -> set[str]:
    """Return keys of motions including their parts, and of the blobs that their inputs refer to."""
    names = _Names()
    for key in motions:
        names.add(writer.motion(key + INPUT))
    return names.blobs | {key + part for key in motions for part in ("", INPUT, TAIL)}


class _Names:
    """The references in a session's texts."""

    def __init__(self) -> None:
        self.blobs, self.texts = set[str](), set[str]()  # all contents, and those that may be texts
        self.characters, self.motions = set[str](), set[str]()

    def add(self, text: str) -> None:
        """Add all references in a JSON text; invalid JSON has none."""
        try:
            left = [parse_json(text, MAX_ITEMS)] if text[:1] in ("{", "[") else []
        except ValueError:
            return
        while left:
            value = left.pop()
            if isinstance(value, dict):
                self._add_fields(value)
                left += value.values()
            elif isinstance(value, list):
                left += value
            elif isinstance(value, str) and (found := _REFERENCE.fullmatch(value)):
                self.blobs.add(found[2])
                if found[1] == "|u1":
                    self.texts.add(found[2])

    def _add_fields(self, value: dict[str, Any]) -> None:
        for name, kept, begin in (("key", self.characters, "character "), ("motion", self.motions, "")):
            if isinstance(value.get(name), str) and value[name]:
                kept.add(begin + value[name])
