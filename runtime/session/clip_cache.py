"""Clips that stay in memory when nothing shows them: the ones used last, within so many bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

from runtime.session.frames import CLIP_FRAME_BYTES
from runtime.takes.clip import Clip

MAX_KEPT_FRAMES = (128 << 20) // CLIP_FRAME_BYTES  # half an hour, or one clip of any length


@dataclass
class ClipCache:
    """Clips by what they were made of; any thread."""

    _clips: OrderedDict[Hashable, Clip] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, key: Hashable, make: Callable[[], Clip]) -> Clip:
        """Return the clip of a key, made where it is not kept."""
        with self._lock:
            if key in self._clips:
                self._clips.move_to_end(key)
                return self._clips[key]
        made = make()
        with self._lock:
            self._clips[key] = made
            while len(self._clips) > 1 and sum(map(len, self._clips.values())) > MAX_KEPT_FRAMES:
                self._clips.popitem(last=False)
        return made
