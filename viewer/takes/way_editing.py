"""The way of the take that plays in the path tool's hands: its points are moved, slowed down or ended, and it is driven again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from runtime.errors import SportError
from viewer.stage.path_tool import PathTool
from viewer.takes.editing import TakeEditing
from viewer.takes.state import ClipItem

if TYPE_CHECKING:
    from runtime.motion.point_path import Waypoint
    from runtime.takes.clip import Clip
    from runtime.takes.drive import Drivable, Drive


WAY = "way"  # the name of the edit


@dataclass
class WayEditing:
    """Lends the path tool to the take that plays; the live character's path comes back after."""

    editing: TakeEditing
    tool: PathTool
    _item: ClipItem | None = None  # whose way the tool has
    _clip: Clip | None = None  # the version of it
    _driven: tuple[Waypoint, ...] = ()  # the points that the take was driven along last
    _lent: list[Waypoint] = field(default_factory=list)  # the live character's points meanwhile

    def poll(self) -> None:
        """Load the way when the tool is taken up, give it back when the take is left; call once a frame."""
        item = self.editing.state.played
        drivable = item is not None and item.drive is not None and item.maker is not None
        self.tool.drive = self.drive if drivable else None
        if self._item is not None and (self._item is not item or not self.tool.active):
            self._give_back()
        elif item is not None and drivable and self.tool.active and self._clip is not item.clip:
            self._load(item)

    def _load(self, item: ClipItem) -> None:
        """Put the way of the version that is shown into the tool."""
        from runtime.takes.way import way_of

        assert item.drive is not None
        if self._item is None:
            self._lent = list(self.tool.points)
        elif item.label == WAY and self._driven == tuple(self.tool.points):
            self._clip = item.clip  # the points that it was just driven along stay as they were set
            return
        self._item, self._clip = item, item.clip
        try:
            self.tool.points[:] = way_of(item.driven, item.drive)
        except SportError as error:
            self.editing.messages.error(error)
            self._give_back()
            return
        self.tool.selected = len(self.tool.points) - 1

    def _give_back(self) -> None:
        self.tool.points[:] = self._lent
        self.tool.active, self.tool.selected = False, -1
        self._item, self._clip = None, None

    def drive(self) -> None:
        """Drive the take again along the points."""
        points = self._driven = tuple(self.tool.points)

        def work(
            driven: Clip, drive: Drive, maker: Drivable, progress: Callable[[float], None]
        ) -> tuple[Clip, Drive]:
            from runtime.takes.way import walked_again

            return walked_again(driven, drive, maker, points, 0, progress)

        if points:
            self.editing.run(WAY, work)
