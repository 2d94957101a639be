"""Repairs of an incomplete session: motions with missing pieces, and takes that no step refers to."""

import json
import sqlite3
import zlib
from collections import Counter

import numpy as np

from runtime.safe_read import parse_json
from runtime.session.document import header_text
from runtime.session.frames import PACKED_FRAME_BYTES, packed_frames, unpacked_frames
from runtime.session.motion import MotionHeader
from runtime.session.stored_rows import Writer
from runtime.session.tables import TAIL

MAX_HELD_FRAMES = 100_000  # limit per session of missing frames that are filled: half an hour
MAX_MENDED_MOTIONS = 10_000  # per opening, as many as a list of takes may hold; the next opening continues
UNKNOWN_NAME, UNKNOWN_FPS = "Recovered take", 60.0  # of a motion whose header is lost
Piece = tuple[str, int, int]  # key of the motion, number of the first frame, count


def fill_gaps(connection: sqlite3.Connection) -> tuple[int, int]:
    """Fill missing frames with the pose before them and correct the frame counts of motions.

    Returns how many motions were changed, and how many frames were filled.
    """
    writer = Writer(connection, set())
    there, whole = Counter[str](), set[str]()  # frames of each motion, and motions of a single piece
    totals = "SELECT motion, sum(count), count(*) = 1 AND min(number) = 0 FROM frames GROUP BY motion"
    for key, count, one in connection.execute(totals):
        there[key.removesuffix(TAIL)] += count
        if one:
            whole.add(key)
    changed = held = 0
    for key in there:
        if changed == MAX_MENDED_MOTIONS:
            break
        gaps, fits = ([], True) if key in whole else _gaps(_pieces(connection, key))
        if not fits:
            continue
        made = 0
        if held + sum(count for _, count, _ in gaps) <= MAX_HELD_FRAMES:
            made = sum(_hold(connection, writer, key, *gap) for gap in gaps)
        held += made
        changed += _set_header(writer, key, there[key] + made, bool(gaps))
    return changed, held


def _pieces(connection: sqlite3.Connection, key: str) -> list[Piece]:
    where = "WHERE motion = ? ORDER BY number"
    return connection.execute(f"SELECT motion, number, count FROM frames {where}", (key,)).fetchall()


def _gaps(pieces: list[Piece]) -> tuple[list[tuple[int, int, Piece]], bool]:
    """Return first frame, count and nearest piece of each gap between pieces, and whether no pieces overlap."""
    gaps, end, fits = [], 0, True
    for at, piece in enumerate(pieces):
        _, first, count = piece
        if first > end:
            gaps.append((end, first - end, pieces[max(at - 1, 0)]))
        fits = fits and first >= end
        end = max(end, first + count)
    return gaps, fits


def _hold(
    connection: sqlite3.Connection, writer: Writer, key: str, first: int, count: int, near: Piece
) -> int:
    """Add a piece of frames that repeat one pose; return how many there are."""
    where = "SELECT content FROM frames WHERE motion = ? AND number = ?"
    (content,) = connection.execute(where, near[:2]).fetchone()
    try:
        data = zlib.decompressobj().decompress(content, PACKED_FRAME_BYTES * near[2])
        parts = unpacked_frames(data, near[2])
    except (zlib.error, ValueError):
        return 0
    pose = -1 if near[1] < first else 0
    made = packed_frames(*(np.repeat(part[pose][None], count, axis=0) for part in parts))
    writer.put_frames(key, first, count, made)
    return count


def _set_header(writer: Writer, key: str, frames: int, gaps: bool) -> bool:
    """Correct the frame count in the header of a motion, and mark it as not resimulable if frames are missing.

    Returns whether the header has changed.
    """
    try:
        value = parse_json(writer.motion(key))
    except ValueError:
        value = None
    if not isinstance(value, dict):
        text = header_text(MotionHeader(UNKNOWN_NAME, UNKNOWN_FPS, frames))
    elif gaps or value.get("frames") != frames:
        text = json.dumps(value | {"frames": frames, "resimulable": False}, ensure_ascii=True)
    else:
        return False
    writer.put_motion(key, text)
    return True
