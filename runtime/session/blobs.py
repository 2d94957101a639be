"""Arrays and bytes of a session file, each content stored once, under its hash.

A reference is text: kind, shape and hash. Reads are charged to the file's memory budget before they allocate.
"""

import hashlib
import math
import re
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FileError
from runtime.session.sqlite_file import Budget

MAX_CONTENT_VALUES = 1 << 29
REMEDY = "Choose another file, or a copy of this one."
Made = TypeVar("Made")
# kind, shape, hash
_REFERENCE = re.compile(r"(<f4|<f8|\|i1|\|u1) ((?:[0-9]{1,10}(?:x[0-9]{1,10})*)?) ([^ ]*)")


class Once:
    """A cache of values derived from immutable objects, for as long as these objects live."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, int], tuple[weakref.ref[Any], Any]] = {}

    def get(self, what: str, thing: Any, make: Callable[[], Made]) -> Made:
        """Return the cached result of `make` for an object."""
        key = what, id(thing)
        known = self._known.get(key)
        if known is None or known[0]() is not thing:
            known = weakref.ref(thing, lambda _: self._known.pop(key, None)), make()
            self._known[key] = known
        return known[1]


@dataclass
class BlobWriter:
    """Stores each content once by calling `put(hash, bytes)`."""

    put: Callable[[str, bytes], None]

    def array(self, values: Any, kind: str = "<f4") -> str:
        """Store an array of a dtype known to `_REFERENCE` and return its reference."""
        plain = np.ascontiguousarray(values, np.dtype(kind))
        content = plain.tobytes()
        key = hashlib.blake2b(content, digest_size=16).hexdigest()
        self.put(key, content)
        return f"{plain.dtype.str} {'x'.join(map(str, plain.shape))} {key}"

    def data(self, content: bytes) -> str:
        return self.array(np.frombuffer(content, np.uint8), "|u1")

    def text(self, content: str) -> str:
        return self.data(content.encode("utf-8", "surrogatepass"))


@dataclass
class BlobReader:
    """Reads what a `BlobWriter` stored; equal references give the same read-only array."""

    path: Path
    fetch: Callable[[str], bytes]
    budget: Budget
    _made: dict[Any, Any] = field(default_factory=dict)

    def once(self, what: str, key: Any, make: Callable[[], Made]) -> Made:
        """Return the result of `make`, which is called only once per key."""
        if (what, key) not in self._made:
            self._made[what, key] = make()
        return self._made[what, key]

    def array(self, reference: Any, kind: str, shape: Sequence[int | None]) -> NDArray[Any]:
        """Return the array of a reference; FileError unless it has this dtype and shape (None: any length)."""
        named, sides, key = self._parts(reference)
        fits = named == kind and len(sides) == len(shape)
        if not fits or any(b not in (None, a) for a, b in zip(sides, shape, strict=True)):
            raise FileError(f"{self.path}: an array {named} {sides}, expected {kind} {list(shape)}.", REMEDY)

        def made() -> NDArray[Any]:
            size = math.prod(sides) * np.dtype(kind).itemsize
            self.budget.spend(size)
            content = self.fetch(key)
            if len(content) != size:
                raise FileError(f"{self.path}: {len(content)} bytes where {size} were expected.", REMEDY)
            return np.frombuffer(content, kind).reshape(sides)

        return self.once("array", reference, made)

    def data(self, reference: Any) -> bytes:
        return self.array(reference, "|u1", (None,)).tobytes()

    def text(self, reference: Any) -> str:
        """Return the text of a reference; ValueError if it is not text."""
        return self.data(reference).decode("utf-8", "surrogatepass")

    def size(self, reference: Any) -> int:
        """Return the size in bytes that a reference states."""
        kind, sides, _ = self._parts(reference)
        return math.prod(sides) * np.dtype(kind).itemsize

    def _parts(self, reference: Any) -> tuple[str, list[int], str]:
        found = (
            _REFERENCE.fullmatch(reference) if isinstance(reference, str) and len(reference) < 200 else None
        )
        if found is None:
            raise FileError(f"{self.path}: {str(reference)[:40]!r} names no content.", REMEDY)
        sides = [int(text) for text in found[2].split("x") if text]
        if math.prod(sides) > MAX_CONTENT_VALUES:
            raise FileError(f"{self.path}: content of {math.prod(sides)} values.", REMEDY)
        return found[1], sides, found[3]
