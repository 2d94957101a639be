"""First-run guide: five steps that are ticked off as they are done; shown once, until skipped or finished."""

from collections.abc import Callable
from dataclasses import dataclass

from viewer.editor import Editor
from viewer.exports.bvh_export import BvhExport
from viewer.gui import panels, theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.settings import Settings

ARMS = ("left_arm", "right_arm")
WALK_SECONDS = 1.0
DONE_SECONDS = 6.0  # for which the finished list stays
STEPS = (
    ("Walk", "W A S D or the left stick"),
    ("Prompt", "Press Enter and type, for example: an old king"),
    ("Edit an arm", "Under Body parts, type other words for an arm, then Enter"),
    ("Record", "R starts a take, R ends it"),
    ("Export", "Under Takes, or Ctrl+E for every format"),
)
WIDTH_PX, SMALL_WIDTH_PX = 210.0, 150.0  # at scale 1
BELOW_BAR_PX = 50.0
SMALL_VIEW_PX = 560.0
MIN_VIEW_HEIGHT_PX = 330.0  # hidden in a lower view


@dataclass
class Guide:
    settings: Settings
    editor: Editor
    bvh: BvhExport
    shown: bool = False
    done: int = 0  # bit mask of the steps
    _walked_s: float = 0.0
    _left_s: float = DONE_SECONDS
    _first_prompt: str = ""  # the prompt at the beginning
    _takes: int = 0

    def begin(self) -> None:
        """Show the steps from the first one."""
        self.shown, self.done = True, 0
        self._walked_s, self._left_s = 0.0, DONE_SECONDS
        self._first_prompt, self._takes = self._prompt, len(self.editor.session.takes)

    def skip(self) -> None:
        """Close the guide for good."""
        self.shown, self.settings.first_minute_seen = False, True

    @property
    def _prompt(self) -> str:
        answer = self.editor.session.live.prompt.a
        return "" if answer is None else answer.prompt

    def is_done(self, step: int) -> bool:
        return bool(self.done >> step & 1)

    def watch(self, dt: float, moving: bool) -> None:
        """Tick off the steps that the user has done; call once per frame."""
        if not self.shown:
            return
        self.settings.first_minute_seen = True  # it does not come back by itself
        self._walked_s += dt * moving
        self._first_prompt = self._first_prompt or self._prompt  # the first answer comes by itself
        answer, takes = self.editor.session.live.prompt.a, self.editor.session.takes
        signs = (
            self._walked_s >= WALK_SECONDS,
            self._prompt != self._first_prompt,
            answer is not None and any(arm in answer.edited for arm in ARMS),
            len(takes) > self._takes,
            any(self.bvh.exported(take) for take in takes[self._takes :]),
        )
        for step, sign in enumerate(signs):
            self.done |= sign << step
        if self.done == (1 << len(STEPS)) - 1:
            self._left_s -= dt
            self.shown = self._left_s > 0.0


def panel(guide: Guide, covered: Callable[[], bool]) -> Panel:
    """Return the guide's card; hidden while it is `covered` or would cover too much."""

    def draw(view: Rect) -> None:
        if view.height >= px(MIN_VIEW_HEIGHT_PX) and view.width >= px(WIDTH_PX + 4 * panels.CARD_MARGIN_PX):
            _draw(guide, view)

    return Panel("First minute", PanelPlace.VIEW, draw, shown=lambda: guide.shown and not covered())


def _draw(guide: Guide, view: Rect) -> None:
    small = min(view.height, view.width) < px(SMALL_VIEW_PX)
    # in a small view beside the feet, so that no head is covered
    width = SMALL_WIDTH_PX if small else WIDTH_PX
    with panels.card("First minute", view, width, bottom=small, below=BELOW_BAR_PX, behind=True):
        left = [step for step in range(len(STEPS)) if not guide.is_done(step)]
        if left:
            place = f"{left[0] + 1} of {len(STEPS)}"
            widgets.label(f"Step {place}" if small else f"The first minute, step {place}", theme.ACCENT)
        else:
            widgets.muted("Done. Name the session in its menu.", wrap=True)
        for step in left[:1] if small else range(len(STEPS)):
            _step(step, step not in left, step in left[:1])
        if widgets.button("Skip##guide" if left else "Close", -1):
            guide.skip()


def _step(step: int, done: bool, current: bool) -> None:
    name, how = STEPS[step]
    tint = theme.ACCENT if done else theme.TEXT if current else theme.MUTED
    widgets.text(f"{ICON.check if done else ICON.on if current else '    '}  {name}", tint)
    if current:
        widgets.muted(how, wrap=True)
