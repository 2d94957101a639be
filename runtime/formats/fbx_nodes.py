"""Binary FBX 7.4: a tree of named nodes with values, and the fixed parts of every file.

Equal scenes give equal bytes: ids are counted, and the creation time is constant.
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
TICKS_PER_S = 46_186_158_000  # per second
CREATOR = "SPORT viewer"
Id = np.int64  # of an object
ZERO = np.int64(0)  # id of the scene, and start time of takes
_HEAD = b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", VERSION)
# a creation time, its checksum, and the matching footer: readers refuse other combinations
_TIME = "1970-01-01 10:00:00:000"
_TIME_ID = bytes.fromhex("28b32aebb624ccc2bfc8b02aa92bfcf1")
_FOOT_ID = bytes.fromhex("fabcab09d0c8d466b176fb831cf7267e")
_END = bytes(120) + bytes.fromhex("f85a8c6af5ded97eece90ce3758f290b")
_NO_MORE = bytes(13)  # ends the children of a node
_ARRAYS = {"int32": b"i", "int64": b"l", "float32": b"f", "float64": b"d"}
_SCALARS: tuple[tuple[type, str, str], ...] = (
    (bool, "C", "?"), (np.int64, "L", "q"), (int, "I", "i"), (float, "D", "d"),
)  # fmt: skip
_TIME_MODES = {120.0: 1, 100.0: 2, 60.0: 3, 50.0: 4, 48.0: 5, 30.0: 6, 30000 / 1001: 9, 25.0: 10, 24.0: 11,
               24000 / 1001: 13, 96.0: 15, 72.0: 16, 60000 / 1001: 17}  # fmt: skip
_CUSTOM_MODE = 14  # for any other rate
_LABELS = {"int": "Integer", "double": "Number", "KTime": "Time", "ColorRGB": "Color", "Vector3D": "Vector"}
_CLASSES = {"AnimationStack": "AnimStack", "AnimationLayer": "AnimLayer", "AnimationCurveNode": "AnimCurveNode",
            "AnimationCurve": "AnimCurve"}  # fmt: skip


class Node:
    """A node of an FBX file. Python `int` values are written as 32 bits, `np.int64` as 64; arrays are compressed."""

    __slots__ = ("children", "name", "values")

    def __init__(self, name: str, *values: Any, children: Iterable[Node] = ()) -> None:
        self.name, self.children = name.encode(), list(children)
        self.values = [_encoded(value) for value in values]

    def write(self, out: bytearray) -> None:
        """Append the binary form of the node and its children to `out`."""
        start, values = len(out), b"".join(self.values)
        out += bytes(12) + bytes([len(self.name)]) + self.name + values
        for child in self.children:
            child.write(out)
        if self.children or not self.values or self.name == b"AnimationLayer":
            out += _NO_MORE
        struct.pack_into("<3I", out, start, len(out), len(self.values), len(values))


def _encoded(value: Any) -> bytes:
    """Return a value in binary, after the letter of its type."""
    if isinstance(value, np.ndarray):
        packed = zlib.compress(np.ascontiguousarray(value).tobytes())
        return _ARRAYS[value.dtype.name] + struct.pack("<3I", value.size, 1, len(packed)) + packed
    if isinstance(value, bytes | str):
        data = value.encode() if isinstance(value, str) else value
        return (b"S" if isinstance(value, str) else b"R") + struct.pack("<I", len(data)) + data
    letter, form = next((letter, form) for kind, letter, form in _SCALARS if isinstance(value, kind))
    return letter.encode() + struct.pack(f"<{form}", value)


def leaves(**values: Any) -> list[Node]:
    """Return one node for each keyword, each with a single value and no children."""
    return [Node(name, value) for name, value in values.items()]


def properties(*entries: Node) -> Node:
    """Return the Properties70 node of an object, with entries made by `prop`."""
    return Node("Properties70", children=entries)


def prop(name: str, kind: str, *values: Any, flags: str = "") -> Node:
    """Return a typed FBX property; flag A makes it animatable, U marks it as user-defined."""
    return Node("P", name, kind, _LABELS.get(kind, ""), flags, *values)


def matrix(name: str, value: AnyArray) -> Node:
    """Return a node with a transform `(4, 4)` in column-major order."""
    return Node(name, np.asarray(value, np.float64).T.ravel())


class Document:
    """The objects of an FBX file, each with an id, and their connections."""

    def __init__(self) -> None:
        self._objects: list[Node] = []
        self._connections: list[Node] = []
        self._counts: Counter[str] = Counter(GlobalSettings=1)
        self._takes: dict[str, np.int64] = {}  # with their end times

    def add(
        self, kind: str, name: str, form: str, parts: Iterable[Node], above: Id | None = None, part: str = ""
    ) -> Id:
        """Add an object, connected to its parent `above`, and return its id; `part` is the class in its name if different."""
        number = np.int64(1_000_000 + len(self._objects))
        titled = f"{name}\0\1{part or _CLASSES.get(kind, kind)}"
        self._objects.append(Node(kind, number, titled, form, children=parts))
        self._counts[kind] += 1
        if above is not None:
            self.connect(number, above)
        return number

    def connect(self, child: np.int64, above: np.int64, name: str = "") -> None:
        """Connect an object to its parent, or to the parent's property `name`."""
        self._connections.append(Node("C", *(("OP", child, above, name) if name else ("OO", child, above))))

    def add_take(self, name: str, last: np.int64, note: str) -> np.int64:
        """Add an animation that ends at FBX time `last`, and return the id of its layer."""
        ends = {"LocalStart": ZERO, "LocalStop": last, "ReferenceStart": ZERO, "ReferenceStop": last}
        spans = [prop(end, "KTime", time) for end, time in ends.items()]
        stack = self.add(
            "AnimationStack", name, "", [properties(*spans, prop("sport", "KString", note, flags="U"))]
        )
        self._takes[name] = last
        return self.add("AnimationLayer", name, "", [], stack)

    def to_bytes(self, units_per_metre: float, fps: float) -> bytes:
        """Return the binary FBX file: right-handed, Y up, facing +Z."""
        first = next(iter(self._takes), "")
        scene = properties(prop("SourceObject", "object"), prop("ActiveAnimStackName", "KString", first))
        document = Node(
            "Document", np.int64(999_999), "Scene", "Scene", children=[scene, Node("RootNode", ZERO)]
        )
        types = [Node("ObjectType", kind, children=leaves(Count=n)) for kind, n in self._counts.items()]
        definitions = [*leaves(Version=100, Count=sum(self._counts.values())), *types]
        takes = [
            Node("Take", name, children=[Node("FileName", f"{name}.tak"), Node("LocalTime", ZERO, last),
                                         Node("ReferenceTime", ZERO, last)])
            for name, last in self._takes.items()
        ]  # fmt: skip
        out = bytearray(_HEAD)
        for node in (
            _header(),
            *leaves(FileId=_TIME_ID, CreationTime=_TIME, Creator=CREATOR),
            _settings(units_per_metre, fps, max(self._takes.values(), default=ZERO)),
            Node("Documents", children=[*leaves(Count=1), document]),
            Node("References"),
            Node("Definitions", children=definitions),
            Node("Objects", children=self._objects),
            Node("Connections", children=self._connections),
            Node("Takes", children=[*leaves(Current=first), *takes]),
        ):
            node.write(out)
        out += _NO_MORE + _FOOT_ID + bytes(4)
        out += bytes(16 - len(out) % 16) + struct.pack("<I", VERSION) + _END
        return bytes(out)


def _header() -> Node:
    """Return the header: version, creation time, creator."""
    stamp = leaves(Version=1000, Year=1970, Month=1, Day=1, Hour=10, Minute=0, Second=0, Millisecond=0)
    about = leaves(Version=100, Title="", Subject="", Author="", Keywords="", Revision="", Comment="")
    facts = [prop(name, "KString", "take.fbx") for name in ("DocumentUrl", "SrcDocumentUrl")]
    for when in ("Original", "LastSaved"):
        facts.append(prop(when, "Compound"))
        facts += [prop(f"{when}|Application{what}", "KString", CREATOR) for what in ("Vendor", "Name")]
    info = [*leaves(Type="UserData", Version=100), Node("MetaData", children=about), properties(*facts)]
    return Node("FBXHeaderExtension", children=[
        *leaves(FBXHeaderVersion=1003, FBXVersion=VERSION, EncryptionType=0),
        Node("CreationTimeStamp", children=stamp), *leaves(Creator=CREATOR),
        Node("SceneInfo", "GlobalInfo\0\1SceneInfo", "UserData", children=info),
    ])  # fmt: skip


def _settings(units_per_metre: float, fps: float, last: np.int64) -> Node:
    """Return axes, unit and rate."""
    axes = {"Up": 1, "Front": 2, "Coord": 0, "OriginalUp": 1}
    facts = [
        prop(f"{axis}Axis{end}", "int", value)
        for axis, number in axes.items()
        for end, value in (("", number), ("Sign", 1))
    ]
    unit = 100.0 / units_per_metre  # in centimetres
    facts += [prop(f"{of}UnitScaleFactor", "double", unit) for of in ("", "Original")]
    mode = next((mode for rate, mode in _TIME_MODES.items() if abs(fps - rate) < 1e-4 * rate), _CUSTOM_MODE)
    facts += [prop("TimeMode", "enum", mode), prop("CustomFrameRate", "double", float(fps))]
    facts += [prop("TimeSpanStart", "KTime", ZERO), prop("TimeSpanStop", "KTime", last)]
    return Node("GlobalSettings", children=[Node("Version", 1000), properties(*facts)])
