"""Binary FBX 7.4: a tree of named nodes with values, and the parts that every file has around its objects.

The same objects are the same bytes: ids are counted, and the time of creation is always the same one.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from runtime.arrays import AnyArray

VERSION = 7400
TICKS = 46_186_158_000  # of a second
_HEAD = b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", VERSION)
# a checksum of this time, and what ends a file of it: readers refuse others
_TIME = "1970-01-01 10:00:00:000"
_TIME_ID = bytes.fromhex("28b32aebb624ccc2bfc8b02aa92bfcf1")
_FOOT_ID = bytes.fromhex("fabcab09d0c8d466b176fb831cf7267e")
_END = bytes(120) + bytes.fromhex("f85a8c6af5ded97eece90ce3758f290b")
_NO_MORE = bytes(13)  # ends the children of a node
_ARRAYS = {"int32": b"i", "int64": b"l", "float32": b"f", "float64": b"d"}
_CREATOR = "SPORT viewer"
# modes of frame rates; another one is mode 14 with its rate
_TIME_MODES = {120.0: 1, 100.0: 2, 60.0: 3, 50.0: 4, 48.0: 5, 30.0: 6, 30000 / 1001: 9, 25.0: 10, 24.0: 11,
               24000 / 1001: 13, 96.0: 15, 72.0: 16, 60000 / 1001: 17}  # fmt: skip
_CUSTOM_MODE = 14
_LABELS = {"int": "Integer", "double": "Number", "KTime": "Time", "ColorRGB": "Color", "Vector3D": "Vector"}
_CLASSES = {"AnimationStack": "AnimStack", "AnimationLayer": "AnimLayer", "AnimationCurveNode": "AnimCurveNode",
            "AnimationCurve": "AnimCurve"}  # fmt: skip


class Node:
    """A node of a file; an `int` among its values has 32 bits, an `np.int64` 64, arrays are packed."""

    __slots__ = ("children", "name", "values")

    def __init__(self, name: str, *values: Any, children: Iterable[Node] = ()) -> None:
        self.name = name.encode()
        self.values = [_encoded(value) for value in values]
        self.children = list(children)

    def write(self, out: bytearray) -> None:
        """Append the node with its children."""
        start, values = len(out), b"".join(self.values)
        out += bytes(12) + bytes([len(self.name)]) + self.name + values
        for child in self.children:
            child.write(out)
        if self.children or not self.values or self.name == b"AnimationLayer":
            out += _NO_MORE
        struct.pack_into("<3I", out, start, len(out), len(self.values), len(values))


def _encoded(value: Any) -> bytes:
    """A value with the letter of its type."""
    if isinstance(value, np.ndarray):
        packed = zlib.compress(np.ascontiguousarray(value).tobytes())
        return _ARRAYS[value.dtype.name] + struct.pack("<3I", value.size, 1, len(packed)) + packed
    if isinstance(value, bytes | str):
        data = value.encode() if isinstance(value, str) else value
        return (b"S" if isinstance(value, str) else b"R") + struct.pack("<I", len(data)) + data
    for kind, letter, form in ((bool, b"C", "<?"), (np.int64, b"L", "<q"), (int, b"I", "<i")):
        if isinstance(value, kind):
            return letter + struct.pack(form, value)
    return b"D" + struct.pack("<d", value)


def properties(*entries: Node) -> Node:
    """The properties of an object, of `prop`."""
    return Node("Properties70", children=entries)


def prop(name: str, kind: str, *values: Any, flags: str = "") -> Node:
    """A property of a type of FBX; flag A can be animated, U is the user's own."""
    return Node("P", name, kind, _LABELS.get(kind, ""), flags, *values)


def matrix(name: str, value: AnyArray) -> Node:
    """A matrix `(4, 4)` of column vectors, column by column."""
    return Node(name, np.asarray(value, np.float64).T.ravel())


def ticks(frames: AnyArray | int, fps: float) -> Any:
    """The time of frames."""
    return np.round(np.asarray(frames) * (TICKS / fps)).astype(np.int64)


class Document:
    """The objects of a file, each with an id, and what is connected to what; 0 is the scene itself."""

    def __init__(self) -> None:
        self._objects: list[Node] = []
        self._connections: list[Node] = []
        self._counts: Counter[str] = Counter(GlobalSettings=1)
        self._takes: list[tuple[str, np.int64]] = []

    def add(self, kind: str, name: str, form: str, children: Iterable[Node], part: str = "") -> np.int64:
        """The id of a new object; `part` is the class in its name where that is not its kind's own."""
        number = np.int64(1_000_000 + len(self._objects))
        titled = f"{name}\0\1{part or _CLASSES.get(kind, kind)}"
        self._objects.append(Node(kind, number, titled, form, children=children))
        self._counts[kind] += 1
        return number

    def connect(self, child: np.int64, parent: np.int64, name: str = "") -> None:
        """Put an object below another, or into the property `name` of it."""
        self._connections.append(Node("C", "OP" if name else "OO", child, parent, *([name] if name else [])))

    def add_take(self, name: str, last: np.int64) -> np.int64:
        """The id of the layer of a new animation that ends at a time."""
        zero = np.int64(0)
        spans = [
            prop(f"{kind}{end}", "KTime", time)
            for kind in ("Local", "Reference")
            for end, time in (("Start", zero), ("Stop", last))
        ]
        stack = self.add("AnimationStack", name, "", [properties(*spans)])
        layer = self.add("AnimationLayer", name, "", [])
        self.connect(layer, stack)
        self._takes.append((name, last))
        return layer

    def to_bytes(self, name: str, units_per_metre: float, fps: float) -> bytes:
        """The file: right-handed, Y up, facing +Z."""
        out = bytearray(_HEAD)
        for node in [
            *_header(),
            self._settings(units_per_metre, fps),
            self._documents(name),
            Node("References"),
            self._definitions(),
            Node("Objects", children=self._objects),
            Node("Connections", children=self._connections),
            self._take_list(),
        ]:
            node.write(out)
        out += _NO_MORE + _FOOT_ID + bytes(4)
        out += bytes(16 - len(out) % 16) + struct.pack("<I", VERSION) + _END
        return bytes(out)

    def _settings(self, units_per_metre: float, fps: float) -> Node:
        mode = next(
            (mode for rate, mode in _TIME_MODES.items() if abs(fps - rate) < 1e-4 * rate), _CUSTOM_MODE
        )
        axes = (("Up", 1), ("Front", 2), ("Coord", 0), ("OriginalUp", 1))
        unit = 100.0 / units_per_metre  # of the file in centimetres
        last = max((last for _, last in self._takes), default=np.int64(0))
        entries = [
            prop(f"{axis}Axis{end}", "int", value)
            for axis, number in axes
            for end, value in (("", number), ("Sign", 1))
        ]
        entries += [prop(f"{of}UnitScaleFactor", "double", unit) for of in ("", "Original")]
        entries += [prop("TimeMode", "enum", mode), prop("TimeSpanStart", "KTime", np.int64(0))]
        entries += [prop("TimeSpanStop", "KTime", last), prop("CustomFrameRate", "double", fps)]
        return Node("GlobalSettings", children=[Node("Version", 1000), properties(*entries)])

    def _documents(self, name: str) -> Node:
        active = self._takes[0][0] if self._takes else ""
        facts = properties(prop("SourceObject", "object"), prop("ActiveAnimStackName", "KString", active))
        scene = Node("Document", np.int64(999_999), name, "Scene",
                     children=[facts, Node("RootNode", np.int64(0))])  # fmt: skip
        return Node("Documents", children=[Node("Count", 1), scene])

    def _definitions(self) -> Node:
        types = [
            Node("ObjectType", kind, children=[Node("Count", count)]) for kind, count in self._counts.items()
        ]
        total = [Node("Version", 100), Node("Count", sum(self._counts.values()))]
        return Node("Definitions", children=[*total, *types])

    def _take_list(self) -> Node:
        takes = []
        for name, last in self._takes:
            spans = [Node(kind, np.int64(0), last) for kind in ("LocalTime", "ReferenceTime")]
            takes.append(Node("Take", name, children=[Node("FileName", f"{name}.tak"), *spans]))
        return Node("Takes", children=[Node("Current", self._takes[0][0] if takes else ""), *takes])


def _header() -> list[Node]:
    """What a file says of itself."""
    year, month, day, hour = 1970, 1, 1, 10
    stamp = {"Version": 1000, "Year": year, "Month": month, "Day": day, "Hour": hour, "Minute": 0, "Second": 0,
             "Millisecond": 0}  # fmt: skip
    texts = ("Title", "Subject", "Author", "Keywords", "Revision", "Comment")
    about = [Node("Version", 100), *(Node(text, "") for text in texts)]
    urls = [prop(name, "KString", "take.fbx") for name in ("DocumentUrl", "SrcDocumentUrl")]
    programs = [
        entry
        for when in ("Original", "LastSaved")
        for entry in (
            prop(when, "Compound"),
            prop(f"{when}|ApplicationVendor", "KString", _CREATOR),
            prop(f"{when}|ApplicationName", "KString", _CREATOR),
            prop(f"{when}|ApplicationVersion", "KString", ""),
            prop(f"{when}|DateTime_GMT", "DateTime", ""),
        )
    ]
    info = Node("SceneInfo", "GlobalInfo\0\1SceneInfo", "UserData", children=[
        Node("Type", "UserData"), Node("Version", 100), Node("MetaData", children=about),
        properties(*urls, *programs),
    ])  # fmt: skip
    extension = Node("FBXHeaderExtension", children=[
        Node("FBXHeaderVersion", 1003), Node("FBXVersion", VERSION), Node("EncryptionType", 0),
        Node("CreationTimeStamp", children=[Node(part, value) for part, value in stamp.items()]),
        Node("Creator", _CREATOR), info,
    ])  # fmt: skip
    return [extension, Node("FileId", _TIME_ID), Node("CreationTime", _TIME), Node("Creator", _CREATOR)]
