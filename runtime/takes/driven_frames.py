"""What every simulated step of a take was asked for, as one array: 64 bytes a frame, however long the list of takes is."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from runtime.controls import MAX_STICK, Controls, Gait

COLUMNS = 8  # stick x and z, facing x and z (NaN without), gait, temperature, strength, response
LARGEST_SETTING = 10.0
_NOWHERE = (math.nan, math.nan)


@dataclass(frozen=True)
class DrivenFrame:
    """What one simulated step was asked for, and the settings that may change while it runs."""

    controls: Controls
    temperature: float
    strength: float
    response: float = 0.0

    @property
    def row(self) -> tuple[float, ...]:
        """The frame as `COLUMNS` numbers."""
        asked = self.controls
        facing = asked.facing or _NOWHERE
        return (*asked.move, *facing, int(asked.gait), self.temperature, self.strength, self.response)


class DrivenFrames(Sequence[DrivenFrame]):
    """The frames of a take; they do not change, and a part of them shares their memory."""

    def __init__(self, rows: NDArray[np.float64]) -> None:
        """Rows `(T, COLUMNS)` as `DrivenFrame.row` has them; they must not be changed later."""
        self.rows = rows.view()
        self.rows.flags.writeable = False

    @staticmethod
    def of(frames: Iterable[DrivenFrame]) -> DrivenFrames:
        """Frames one by one."""
        return DrivenFrames(np.array([frame.row for frame in frames], np.float64).reshape(-1, COLUMNS))

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, at: int) -> DrivenFrame: ...
    @overload
    def __getitem__(self, at: slice) -> DrivenFrames: ...
    def __getitem__(self, at: int | slice) -> DrivenFrame | DrivenFrames:
        if isinstance(at, slice):
            return DrivenFrames(self.rows[at])
        x, z, facing_x, facing_z, gait, *settings = self.rows[at].tolist()
        facing = None if math.isnan(facing_x) else (facing_x, facing_z)
        return DrivenFrame(Controls((x, z), facing, Gait(int(gait))), *settings)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DrivenFrames) and np.array_equal(self.rows, other.rows, equal_nan=True)

    __hash__ = None  # type: ignore[assignment]

    def __add__(self, later: DrivenFrames) -> DrivenFrames:
        """These frames and then others."""
        return DrivenFrames(np.concatenate([self.rows, later.rows]))

    def gaits(self) -> NDArray[np.int8]:
        """What each frame asked for `(T,)`, as `metadata.gait_of` counts gaits."""
        asked = self.rows[:, 4].astype(np.int8)
        moves = (self.rows[:, :2] != 0.0).any(axis=1)
        return np.where(moves | (asked == Gait.JUMP), asked, np.int8(Gait.STAND))


def are_asked(rows: NDArray[np.float64]) -> bool:
    """Whether rows `(T, COLUMNS)` of a file are what a step can be asked for."""
    move, facing, gait, settings = rows[:, :2], rows[:, 2:4], rows[:, 4], rows[:, 5:]
    turned = (np.abs(facing) <= MAX_STICK).all(axis=1) | np.isnan(facing).all(axis=1)
    return bool(
        (np.abs(move) <= MAX_STICK).all()  # nor NaN
        and turned.all()
        and np.isin(gait, [float(each) for each in Gait]).all()
        and (np.abs(settings) <= LARGEST_SETTING).all()
    )


class KeptFrames:
    """The newest frames while they are made."""

    def __init__(self) -> None:
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // COLUMNS

    def add(self, frame: DrivenFrame) -> None:
        """One frame more."""
        self._numbers.extend(frame.row)

    def drop(self, count: int) -> None:
        """Forget the oldest frames."""
        del self._numbers[: count * COLUMNS]

    def since(self, first: int) -> DrivenFrames:
        """The frames from one on, counted from the oldest that is kept."""
        return DrivenFrames(np.array(self._numbers[first * COLUMNS :]).reshape(-1, COLUMNS))
