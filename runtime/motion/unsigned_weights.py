"""Converts the 8-bit weights of an ONNX graph from signed to unsigned, for processors on which signed products overflow.

x86 processors without VNNI add pairs of unsigned times signed products in 16 bits, which saturates; onnxruntime widens
unsigned times unsigned products. Its own option (session.x64quantprecision) fails on weights shared by several products.
A weight w with zero point z becomes w + 128 with z + 128, so that every product is identical to the last bit. The
graph is edited in its protobuf encoding, because the runtime does not depend on the package `onnx`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

# field numbers and element types of onnx.proto
_GRAPH = 7  # of a ModelProto
_INITIALIZER, _VALUE_INFO = 5, 13  # of a GraphProto
_DATA_TYPE, _INT32_DATA, _RAW_DATA = 2, 5, 9  # of a TensorProto
_UINT8, _INT8 = 2, 3
_VARINT, _FIXED_64, _BYTES, _FIXED_32 = 0, 1, 2, 5  # wire types of fields
_PAYLOAD_BITS, _PAYLOAD, _MORE, _MAX_BITS = 7, 0x7F, 0x80, 70  # of each byte of a varint, and of a whole one


class _Field(NamedTuple):
    number: int
    kind: int
    value: int  # of a varint; the length of bytes
    start: int  # of the field
    content: int  # offset of the content after field number and length
    end: int


def unsigned_weights(data: bytes) -> bytes:
    """Convert the int8 initializers of an ONNX model to uint8, adding 128; ValueError if `data` is not a model."""
    out = bytearray()
    for field in _fields(data):
        if (field.number, field.kind) == (_GRAPH, _BYTES):
            out += _encoded(_GRAPH, _graph(data[field.content : field.end]))
        else:
            out += data[field.start : field.end]
    return bytes(out)


def _graph(data: bytes) -> bytes:
    out = bytearray()
    for field in _fields(data):
        if (field.number, field.kind) == (_INITIALIZER, _BYTES):
            out += _encoded(_INITIALIZER, _tensor(data[field.content : field.end]))
        elif field.number != _VALUE_INFO:  # intermediate types, which onnxruntime infers
            out += data[field.start : field.end]
    return bytes(out)


def _tensor(data: bytes) -> bytes:
    fields = list(_fields(data))
    if not any(field.number == _DATA_TYPE and field.value == _INT8 for field in fields):
        return data
    out, values = bytearray(), bytearray()
    for field in fields:
        if field.number == _DATA_TYPE:
            out += _varint(_DATA_TYPE << 3 | _VARINT) + _varint(_UINT8)
        elif field.number in (_RAW_DATA, _INT32_DATA):
            values += _values(field, data[field.content : field.end])
        else:
            out += data[field.start : field.end]
    shifted = np.frombuffer(values, np.uint8) ^ 0x80
    return bytes(out) + _encoded(_RAW_DATA, shifted.tobytes())


def _values(field: _Field, content: bytes) -> bytes:
    """Return the 8-bit numbers of a field, stored as bytes or as one or many integers."""
    if field.number == _RAW_DATA:
        return content
    numbers = _varints(content) if field.kind == _BYTES else [field.value]
    return bytes(value & 0xFF for value in numbers)


def _fields(data: bytes) -> Iterator[_Field]:
    """Yield the fields of a protobuf message."""
    position = 0
    while position < len(data):
        start = position
        key, position = _read_varint(data, position)
        kind, value, content = key & 7, 0, position
        if kind == _VARINT:
            value, position = _read_varint(data, position)
        elif kind == _BYTES:
            value, content = _read_varint(data, position)
            position = content + value
        elif kind in (_FIXED_64, _FIXED_32):
            position += 8 if kind == _FIXED_64 else 4
        else:
            raise ValueError("a field of an unknown kind")
        if position > len(data):
            raise ValueError("a field that ends behind its message")
        yield _Field(key >> 3, kind, value, start, content, position)


def _varints(data: bytes) -> Iterator[int]:
    position = 0
    while position < len(data):
        value, position = _read_varint(data, position)
        yield value


def _read_varint(data: bytes, position: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, _MAX_BITS, _PAYLOAD_BITS):
        if position >= len(data):
            break
        byte = data[position]
        position += 1
        value |= (byte & _PAYLOAD) << shift
        if byte < _MORE:
            return value, position
    raise ValueError("a number without an end")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > _PAYLOAD:
        out.append(value & _PAYLOAD | _MORE)
        value >>= _PAYLOAD_BITS
    out.append(value)
    return bytes(out)


def _encoded(number: int, content: bytes) -> bytes:
    """Return a length-delimited field."""
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content
