"""Control input of the character for one frame, independent of devices."""

from dataclasses import dataclass
from enum import IntEnum

from runtime.errors import UsageError

MAX_STICK = 1e6


class Gait(IntEnum):
    """Gait labels in the order of the network's one-hot input g (Sec. III-A)."""

    STAND = 0
    WALK = 1
    JOG = 2
    CROUCH = 3
    JUMP = 4
    OTHER = 5

    @property
    def label(self) -> str:
        """The gait's lower-case name, as used in files and commands: "walk"."""
        return self.name.lower()


REQUESTS = (Gait.STAND, Gait.WALK, Gait.JOG, Gait.CROUCH, Gait.JUMP)  # gaits that a person can request
STAND_SPEED_M_PER_S = 0.12  # m/s; slower requests mean standing


@dataclass(frozen=True)
class Controls:
    """Requested movement of one character in world space; the viewer has already rotated stick axes by the camera's heading.

    `move` is the direction in the XZ plane, its length 0 (stand) to 1 (full stick, the style's own speed), up to 2 for
    programs that ask for more. `facing` is a unit XZ direction to look at while strafing, or None to face forward. `gait`
    is WALK, JOG, CROUCH or JUMP; standing follows from `move` alone. Raises UsageError for an invalid number or gait.
    """

    move: tuple[float, float] = (0.0, 0.0)
    facing: tuple[float, float] | None = None
    gait: Gait = Gait.WALK

    def __post_init__(self) -> None:
        for field, pair in (("move", self.move), ("facing", self.facing)):
            if pair is not None and not _is_direction(pair):
                raise UsageError(
                    f"Controls: {field} {str(pair)[:40]}: expected two finite numbers.", "Try 0, 1."
                )
        if self.move is None or (
            not isinstance(self.gait, Gait) and (type(self.gait) is not int or not 0 <= self.gait < len(Gait))
        ):
            raise UsageError(
                f"Controls: gait {str(self.gait)[:40]}: expected one of {', '.join(g.name for g in Gait)}.",
                "Use Gait.WALK.",
            )


def _is_direction(pair: tuple[float, float]) -> bool:
    try:
        return len(pair) == 2 and abs(pair[0]) <= MAX_STICK and abs(pair[1]) <= MAX_STICK
    except (TypeError, ValueError):  # ValueError: arrays in place of numbers
        return False
