"""Descriptions of sessions that can be reopened: name, takes and time of saving."""

import time

from runtime.session.library import SessionSummary
from viewer.gui.widgets import clock


def describe(summary: SessionSummary) -> str:
    """Return the session's name, takes, length and time in a few words."""
    return f"{summary.name}, {_contents(summary)}, {time_text(summary.saved_s)}"


def time_text(since_1970_s: float) -> str:
    """Return a time (seconds since 1970) as day, month, hour and minute."""
    try:
        return time.strftime("%d %b %H:%M", time.localtime(since_1970_s))
    except (OverflowError, ValueError, OSError):  # a wrong clock
        return "at an unknown time"


def _contents(summary: SessionSummary) -> str:
    if summary.damaged:
        return "damaged"
    if summary.takes:
        return f"{count_takes(summary.takes)}, {clock(summary.seconds)}"
    return f"{count_takes(summary.recordings)} to recover" if summary.recordings else "no takes"


def count_takes(takes: int) -> str:
    """Return "1 take", "2 takes" and so on."""
    return f"{takes} take{'s' * (takes != 1)}"
