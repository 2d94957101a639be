"""Damage to bytes, text, JSON and the containers that readers take apart; the same generator gives the same damage."""

import json
import random
import struct
import zlib
from collections.abc import Callable
from copy import deepcopy
from typing import Any

Mutator = Callable[[random.Random, bytes], bytes]

_NUMBERS = (
    "0", "-1", "1", "nan", "inf", "-inf", "1e999", "-1e38", "1e300", "1e-320", "2147483648", "4294967295", "-2147483649",
    "9" * 25, "1" + "0" * 500, "0x10", "1_0", "1,5", "٣", "²", "", ".", "-", "1e", "1e5", "1000000", "0.0000001", "True",
)  # fmt: skip
_TOKENS = (
    b"\0", b"\xff", b"\xef\xbb\xbf", b"\xff\xfe", b"\xe9", b"\r", b"\n", b"\t", b" " * 5000, b"[" * 5000, b"{" * 5000,
    b"(" * 500, b'"', b"\\", b"\\ud800", b":", b";", b",", b"/", b"..", b"%s", b"%!PS", b"}" * 50, b"A" * 5000, b"\x7f",
    "é".encode(), "𝄞".encode(), "\u2028".encode(),
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**70), 10**400, 1e300, -1e300, float("nan"), float("inf"), 0.5, "", "x",
    "\ud800", "\0", "a\nb", "x" * 3000, [], {}, [None], [[]], {"": None}, [0] * 3000, ["x", {}], {"a": {"b": []}}, 1.5e9,
)  # fmt: skip


def damaged_bytes(rng: random.Random, data: bytes) -> bytes:
    """One to eight flips, cuts, insertions, repetitions and exchanged numbers anywhere."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        at, length = rng.randrange(len(out) + 1), rng.choice((1, 2, 4, 16, 100))
        kind = rng.randrange(8)
        if kind == 0 and out:
            out[at % len(out)] ^= 1 << rng.randrange(8)
        elif kind == 1 and out:
            out[at % len(out)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0x20, 0x0A, rng.randrange(256)))
        elif kind == 2:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = rng.choice(_TOKENS)
        elif kind == 4:
            out[at:at] = out[at : at + length] * rng.choice((1, 2, 50))
        elif kind == 5:
            value = rng.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, rng.getrandbits(32)))
            out[at : at + 4] = struct.pack(rng.choice(("<I", ">I")), value)
        elif kind == 6:
            out = out[:at]
        else:
            other = rng.randrange(len(out) + 1)
            out[at : at + length] = out[other : other + length]
    return bytes(out)


def damaged_text(rng: random.Random, data: bytes) -> bytes:
    """Numbers and words of a text exchanged, lines lost, repeated and swapped; sometimes damage to the bytes."""
    if rng.random() < 0.3:
        return damaged_bytes(rng, data)
    lines = data.split(b"\n")
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        kind = rng.randrange(6)
        words = lines[at].split(b" ")
        word = rng.randrange(len(words))
        if kind <= 1:
            words[word] = rng.choice(_NUMBERS).encode()
        elif kind == 2:
            words[word] = rng.choice(_TOKENS)
        elif kind == 3:
            words = words[:word]
        elif kind == 4:
            words += words * rng.choice((1, 3, 100))
        lines[at] = b" ".join(words)
        if kind == 5:
            piece = lines[at : at + rng.choice((1, 3, 20))]
            lines[at : at + len(piece)] = piece * rng.choice((0, 2, 50))
            lines = lines or [b""]
    return b"\n".join(lines)


def damaged_value(rng: random.Random, value: Any) -> Any:
    """A copy of a JSON value with one to three values exchanged, lost, repeated or put elsewhere."""
    copy = json.loads(json.dumps(value))
    for _ in range(rng.choice((1, 1, 2, 3))):
        places: list[tuple[Any, Any]] = []
        stack = [copy]
        while stack:
            holder = stack.pop()
            items = list(holder.items() if isinstance(holder, dict) else enumerate(holder))
            # of long lists a few values stand for all, so that the rest of the document is met as well
            for key, item in items if len(items) < 50 else rng.sample(items, 20):
                places.append((holder, key))
                if isinstance(item, dict | list):
                    stack.append(item)
        if not places:
            return deepcopy(rng.choice(_VALUES))
        holder, key = rng.choice(places)
        kind = rng.randrange(6)
        if kind <= 2:
            holder[key] = deepcopy(rng.choice(_VALUES))
        elif kind == 3:
            del holder[key]
        elif kind == 4:
            other, at = rng.choice(places)
            holder[key] = json.loads(json.dumps(other[at])) if _has(other, at) else None
        elif isinstance(holder, list):
            holder[key:key] = [holder[key]] * rng.choice((1, 2, 300))
        elif isinstance(holder[key], int | float) and abs(holder[key]) < 1e200:
            holder[key] = holder[key] * rng.choice((-1, 2, 1000, 1e9)) + rng.choice((0, 1, -1))
    return copy


def _has(holder: Any, key: Any) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def damaged_json(rng: random.Random, data: bytes) -> bytes:
    """Damage to the values of a JSON text, sometimes to its bytes."""
    if rng.random() < 0.25:
        return damaged_bytes(rng, data)
    return json.dumps(damaged_value(rng, json.loads(data))).encode()


def damaged_glb(rng: random.Random, data: bytes) -> bytes:
    """Damage to the document of a GLB, or to its binary chunk, with lengths that fit; sometimes to all bytes."""
    kind = rng.random()
    if kind < 0.2:
        return damaged_bytes(rng, data)
    length = struct.unpack("<I", data[12:16])[0]
    text, blob = data[20 : 20 + length], data[28 + length :]
    if kind < 0.8:
        text = damaged_json(rng, text)
    else:
        blob = damaged_bytes(rng, blob)
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(blob)) + b"BIN\0" + blob
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def damaged_png(rng: random.Random, data: bytes) -> bytes:
    """Damage to a chunk of a PNG whose checksum then fits; sometimes to all bytes, and to other formats."""
    if rng.random() < 0.4 or not data.startswith(b"\x89PNG"):
        return damaged_bytes(rng, data)
    chunks, at = [], 8
    while at + 8 <= len(data):
        length = struct.unpack(">I", data[at : at + 4])[0]
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    number = rng.randrange(len(chunks))
    kind, body = chunks[number]
    chosen = rng.randrange(4)
    if chosen == 0:
        kind = rng.choice(
            (
                b"PLTE",
                b"tRNS",
                b"iCCP",
                b"zTXt",
                b"iTXt",
                b"acTL",
                b"fcTL",
                b"fdAT",
                b"gAMA",
                b"pHYs",
                b"IEND",
            )
        )
    elif chosen == 1:
        chunks.insert(number, (kind, body))
    else:
        body = damaged_bytes(rng, body)
    chunks[number] = (kind, body)
    return data[:8] + b"".join(
        struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b)) for k, b in chunks
    )
