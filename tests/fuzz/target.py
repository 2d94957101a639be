"""What a fuzz target is: a reader, good inputs for it, the damage that fits them, and what must hold of what it reads."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .mutate import Mutator


@dataclass(frozen=True)
class Target:
    """`read(folder, data)` reads a damaged input; anything but an answer or a SportError is a failure.

    `seeds(folder)` are good inputs, made once; `folder` is empty at first and the target's own. `weight` is the
    target's share of a run, smaller for slow ones; `seconds` of the processor are what an input may take.
    """

    name: str
    seeds: Callable[[Path], list[bytes]]
    damage: Mutator
    read: Callable[[Path, bytes], object]
    weight: float = 1.0
    seconds: float = 2.0


def put(folder: Path, name: str, data: bytes) -> Path:
    """The input as a file."""
    path = folder / name
    path.write_bytes(data)
    return path
