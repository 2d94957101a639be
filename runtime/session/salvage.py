"""Recovers rows of a damaged session from its pages, without SQLite, verifying each by its checksum.

A row with one wrong bit is repaired: the checksum identifies that bit.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from runtime.session.sqlite_file import side_files
from runtime.session.tables import PAGE_BYTES, TABLES, TAIL, Row, Value, checksum, sealed

LEAF_PAGE, INDEX_PAGES = 13, (2, 10)  # page types: table leaf; index pages
# limit of the pages searched byte by byte for rows, because their directory is damaged
MAX_SEARCHED_PAGES = 400
MAX_SEARCHED_BITS = 40_000_000  # of rows with a wrong bit: about 2 s
MAX_READ_RATIO = 2  # bytes of all rows over the file's: damaged pages may refer to each other endlessly
_WAL_MAGIC = (0x377F0682, 0x377F0683)
_SIZES = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)  # bytes of a value by its serial type
_COLUMNS = {table: columns.count(",") + 2 for table, columns in TABLES.items()}
_UNDER_LOG = ("blobs", "motions", "frames")  # tables in which an outdated row does no harm
_NUMBERED = ("steps", "motions")  # tables whose first column is the row number, which is stored separately
_POLYNOMIAL = 0xEDB88320  # of CRC-32
# whether the row number is stored separately, the row's values with texts as bytes, and its checksum
Cell = tuple[bool, list[Value], Value | None]


def salvaged(path: Path) -> Iterator[tuple[str, Row]]:
    """Yield (table, row) for every row of a file and its log with a valid checksum; OSError if it cannot be read."""
    with path.open("rb") as file:
        yield from _Pages(file, path.stat().st_size, _logged(path)).rows()


def _logged(path: Path) -> dict[int, bytes]:
    """Return the newest committed version of every page in a file's log."""
    log = side_files(path)[0]
    data = log.read_bytes() if log.is_file() else b""
    pages, waiting = dict[int, bytes](), dict[int, bytes]()
    if len(data) < 32 or struct.unpack_from(">I", data)[0] not in _WAL_MAGIC:
        return {}
    for at in range(32, len(data) - PAGE_BYTES - 23, PAGE_BYTES + 24):
        number, committed = struct.unpack_from(">II", data, at)
        if data[at + 8 : at + 16] != data[16:24]:  # belongs to an earlier log in the same file
            break
        waiting[number] = data[at + 24 : at + 24 + PAGE_BYTES]
        if committed:
            pages |= waiting
            waiting = {}
    return pages


class _Pages:
    """The pages of a database, the first of which is number 1."""

    def __init__(self, file: BinaryIO, size: int, logged: dict[int, bytes]) -> None:
        self.file, self.logged = file, logged
        self.count = max(-(-size // PAGE_BYTES), *logged, 1)
        self.size = size + PAGE_BYTES * len(logged)
        self.left, self.bits = MAX_READ_RATIO * self.size, MAX_SEARCHED_BITS
        self.used: set[int] = set()  # pages that belong to rows already found

    def page(self, number: int) -> bytes:
        if number in self.logged:
            return self.logged[number]
        self.file.seek((number - 1) * PAGE_BYTES)
        return self.file.read(PAGE_BYTES)

    def rows(self) -> Iterator[tuple[str, Row]]:
        """Yield rows as of the log, then frames and the rows they need from pages that the log has replaced."""
        yield from self._rows()
        if self.logged:
            self.logged = {}
            for number in range(1, self.count + 1):
                found = (self._row(cell, repairs=False) for cell in self._cells(number))
                yield from (row for row in found if row and row[0] in _UNDER_LOG and _is_whole(row[1]))

    def _rows(self) -> Iterator[tuple[str, Row]]:
        doubtful = []
        for number in range(1, self.count + 1):
            cells = list(map(self._row, self._cells(number)))
            found = list(filter(None, cells))
            yield from found
            if not found or len(found) < len(cells):
                doubtful.append(number)
        searched = [number for number in doubtful if number not in self.used and self._is_unclear(number)]
        for number in searched[:MAX_SEARCHED_PAGES]:
            page = self.page(number)
            anywhere = (self._row(self._cell(page, at), repairs=False) for at in range(len(page) - 4))
            yield from filter(None, anywhere)

    def _is_unclear(self, number: int) -> bool:
        """Return whether a page may contain rows that its directory does not list: it is neither empty nor an index page."""
        page = self.page(number)
        return bool(page.strip(b"\0")) and page[0] not in INDEX_PAGES

    def _cells(self, number: int) -> Iterator[Cell | None]:
        """Yield the rows in a page's directory; None for an invalid entry."""
        page, head = self.page(number), 100 * (number == 1)
        if len(page) < head + 8 or page[head] != LEAF_PAGE:
            return
        (count,) = struct.unpack_from(">H", page, head + 3)
        for k in range(min(count, (len(page) - head - 8) // 2)):
            (at,) = struct.unpack_from(">H", page, head + 8 + 2 * k)
            yield self._cell(page, at)

    def _cell(self, page: bytes, at: int) -> Cell | None:
        """Return the row at an offset of a page; None if there is none."""
        try:
            size, at = _varint(page, at)
            number, at = _varint(page, at)
            head, _ = _varint(page, at)
            if not 4 <= head <= 60 or size < head:
                return None
            kinds = _kinds(page, at)
            if len(kinds) not in _COLUMNS.values() or head + sum(map(_size, kinds)) != size:
                return None
            *values, known = _values(kinds, self._payload(page, at, size)[head:])
            number -= number >> 63 << 64
            return values[0] is None, [number if value is None else value for value in values], known
        except (IndexError, struct.error, ValueError):
            return None

    def _payload(self, page: bytes, at: int, size: int) -> bytes:
        """Return the bytes of a row, including overflow pages; ValueError if they are missing."""
        inside, room = size, PAGE_BYTES - 4
        if size > PAGE_BYTES - 35:
            least = (PAGE_BYTES - 12) * 32 // 255 - 23
            inside = least + (size - least) % room
            inside = inside if inside <= PAGE_BYTES - 35 else least
        parts, left = [page[at : at + inside]], size - inside
        self.left -= size
        if self.left < 0 or size > self.size:
            raise ValueError("more than the file holds")
        following = struct.unpack_from(">I", page, at + inside)[0] if left else 0
        chain = []
        while left > 0:
            if not 1 < following <= self.count:
                raise ValueError("no such page")
            page = self.page(following)
            chain.append(following)
            parts.append(page[4 : 4 + left])
            left -= room
            following = struct.unpack_from(">I", page)[0]
        self.used.update(chain)
        return b"".join(parts)

    def _row(self, cell: Cell | None, repairs: bool = True) -> tuple[str, Row] | None:
        """Return a row of a known table whose checksum matches, if need be after flipping one bit; else None."""
        numbered, values, known = cell or (False, [], None)
        if not isinstance(known, int):
            return None
        for table, columns in _COLUMNS.items():
            if len(values) == columns - 1 and numbered == (table in _NUMBERED):
                row = list(values)
                wrong = checksum(table, row) ^ known & 0xFFFFFFFF
                if wrong and repairs:
                    wrong = self._repair(table, row, wrong)
                if not wrong and (texts := _texts(row)) is not None:
                    return table, sealed(table, texts)
        return None

    def _repair(self, table: str, row: list[Value], difference: int) -> int:
        """Flip the bit of a row that explains this difference in its CRC-32; 0 on success.

        Flipping a bit changes the CRC-32 by the polynomial, shifted once for each bit that follows it.
        """
        if difference.bit_count() == 1:  # the wrong bit is in the checksum itself
            return 0
        change = _POLYNOMIAL
        for column in range(len(row) - 1, int(table == "motions") - 1, -1):
            content, head = _content(row[column]), b"" if isinstance(row[column], int) else bytes(8)
            for bit in range(8 * len(content)):
                if change == difference:
                    row[column] = _turned(row[column], bit)
                    return 0
                change = change >> 1 ^ (_POLYNOMIAL if change & 1 else 0)
            self.bits -= 8 * len(content)
            if self.bits < 0:
                break
            for _ in range(8 * (len(head) + 1)):  # length and type of the value
                change = change >> 1 ^ (_POLYNOMIAL if change & 1 else 0)
        return difference


class _Text(bytes):
    """The bytes of a text, which a wrong bit may have made invalid."""


def _content(value: Value) -> bytes:
    return struct.pack("<q", value) if isinstance(value, int) else bytes(value)  # type: ignore[arg-type]


def _turned(value: Value, bit: int) -> Value:
    """Return a value with one bit flipped, counted from the end."""
    data = bytearray(_content(value))
    data[len(data) - 1 - bit // 8] ^= 0x80 >> bit % 8
    return struct.unpack("<q", data)[0] if isinstance(value, int) else type(value)(data)


def _texts(row: list[Value]) -> list[Value] | None:
    """Return the values of a row with its texts decoded; None if one is invalid."""
    try:
        return [value.decode("utf-8") if isinstance(value, _Text) else value for value in row]
    except UnicodeDecodeError:
        return None


def _is_whole(row: Row) -> bool:
    """Return whether a row does not hold the newest frames of a recording, which are packed again later."""
    return not str(row[0]).endswith(TAIL)


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return SQLite's variable-length integer at an offset, and the offset after it."""
    value = 0
    for k in range(8):
        value = value << 7 | data[at + k] & 0x7F
        if data[at + k] < 0x80:
            return value, at + k + 1
    return value << 8 | data[at + 8], at + 9


def _kinds(page: bytes, at: int) -> list[int]:
    """Return the serial types of the values of a row whose header begins at an offset."""
    size, place = _varint(page, at)
    end, kinds = at + size, []
    while place < end:
        kind, place = _varint(page, place)
        kinds.append(kind)
    return kinds


def _size(kind: int) -> int:
    return _SIZES[kind] if kind < 10 else (kind - 12) // 2


def _values(kinds: list[int], data: bytes) -> list[Value | None]:
    values, at = list[Value | None](), 0
    for kind in kinds:
        part = data[at : at + _size(kind)]
        at += len(part)
        if kind == 0:
            values.append(None)
        elif kind in (8, 9):
            values.append(kind - 8)
        elif kind < 12:
            values.append(int.from_bytes(part, "big", signed=True))
        else:
            values.append(_Text(part) if kind % 2 else part)
    return values
