"""All undoable edits, as functions from a session to the next one."""

from dataclasses import replace

from runtime.session.motion import Motion
from runtime.session.session import LIVE, MIN_FRAMES, Session, Take

MAX_NAME_CHARACTERS = 60


def with_number(session: Session) -> Session:
    """Return the session with its take counter increased, to reserve the number of a take that is still being made."""
    return replace(session, counter=session.counter + 1)


def with_new_take(session: Session, take: Take, number: int = LIVE) -> Session:
    """Return the session with a take appended and selected; `number` if one was reserved."""
    number = number or session.counter + 1
    takes = (*session.takes, replace(take, number=number))
    return replace(session, takes=takes, counter=max(number, session.counter), selected=number)


def without_take(session: Session, number: int) -> Session:
    """Return the session without a take: the next take is selected if it was, and a reference to it is removed."""
    at = session.index(number)
    if at < 0:
        return session
    takes = session.takes[:at] + session.takes[at + 1 :]
    selected, reference = session.selected, session.reference
    if selected == number:
        selected = takes[min(at, len(takes) - 1)].number if takes else LIVE
    if reference is not None and not reference.video and reference.take == number:
        reference = None
    return replace(session, takes=takes, selected=selected, reference=reference)


def renamed(session: Session, number: int, name: str) -> Session:
    """Return the session with a take renamed; an empty name restores the motion's."""
    take = session.take(number)
    name = " ".join(name.split())[:MAX_NAME_CHARACTERS]
    if take is None or name == take.title:
        return session
    return session.with_take(number, name="" if name == replace(take, name="").title else name)


def copied(take: Take) -> Take:
    """Return a copy of a take, named as such, for the list."""
    return replace(take, name=f"{take.title}, copy"[:MAX_NAME_CHARACTERS])


def mirrored_copy(session: Session, number: int) -> Session:
    """Return the session with a mirrored copy of a take appended; pose edits are not copied."""
    take = session.take(number)
    if take is None or take.motion is None:
        return session
    made = Take(motion=take.motion, mirrored=not take.mirrored, recorded=True, ground=take.ground)
    name = "" if not take.name else f"{take.name}, mirrored"[:MAX_NAME_CHARACTERS]
    return with_new_take(session, replace(made, name=name))


def trimmed(session: Session, number: int, first: int, last: int) -> Session:
    """Return the session with a take trimmed to frames `first` to `last`, at least `MIN_FRAMES`; the full range removes the trim."""
    take = session.take(number)
    if take is None or take.motion is None:
        return session
    end = take.frames - 1
    first = max(min(first, end - MIN_FRAMES + 1), 0)
    last = min(max(last, first + MIN_FRAMES - 1), end)
    return session.with_take(number, trim=None if (first, last) == (0, end) else (first, last))


def split(session: Session, number: int, frame: int) -> Session:
    """Return the session with a take split at `frame` into two takes that share its motion."""
    take = session.take(number)
    if take is None or take.motion is None:
        return session
    first, last = take.range
    if not first + MIN_FRAMES - 1 <= frame <= last - MIN_FRAMES + 1:
        return session
    at, name = session.index(number) + 1, f"{take.title}, rest"[:MAX_NAME_CHARACTERS]
    rest = replace(take, number=session.counter + 1, name=name, trim=(frame, last), numbered_from=frame)
    takes = (*session.takes[:at], rest, *session.takes[at:])
    session = replace(session, takes=takes, counter=rest.number)
    return session.with_take(number, trim=(first, frame))


def resimulated(session: Session, number: int, motion: Motion) -> Session:
    """Return the session with a take's motion replaced; a trim up to its end stays at the new end, if that is not before it."""
    take = session.take(number)
    if take is None or take.motion is None:
        return session
    trim, end = take.trim, motion.header.frames - 1
    if trim is not None and trim[1] >= take.frames - 1:
        trim = (trim[0], end) if trim[0] < end else None
    return session.with_take(number, motion=motion, trim=trim)


def moved(session: Session, number: int, by: int) -> Session:
    at = session.index(number)
    to = at + by
    if at < 0 or not 0 <= to < len(session.takes):
        return session
    takes = list(session.takes)
    takes.insert(to, takes.pop(at))
    return replace(session, takes=tuple(takes))


def selected(session: Session, number: int) -> Session:
    known = number == LIVE or session.take(number) is not None
    return replace(session, selected=number) if known else session
