"""State as data: dataclasses of numbers, tuples, arrays and nested records, and their form in a file.

The annotations are the schema. `read_record` trusts nothing: it checks every name, kind, length and shape, and that
numbers are finite and at most `MAX_NUMBER`, or the field's metadata `most`. An array's field gives
its shape after the leading axis of N characters, `field(metadata={"shape": (31, 3)})`, or its `whole` shape; text its `choices`.
A file holds one character.
"""

from __future__ import annotations

import types
import typing
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np

from runtime.errors import FileError

Record = TypeVar("Record")
Tree = Any  # JSON; arrays are referred to by index
MAX_NUMBER = 1e6  # metres, seconds, radians and the like
MAX_TUPLE_ITEMS = 64
REMEDY = "Record the take again."


def copied(record: Record) -> Record:
    """Return a copy of a record and its nested records, sharing their arrays, which are never modified."""
    kind: Any = type(record)
    made: Record = object.__new__(kind)
    values = made.__dict__ = record.__dict__.copy()
    for name in _inside(kind):
        value = values[name]
        values[name] = tuple(map(copied, value)) if isinstance(value, tuple) else copied(value)
    return made


@cache
def _inside(kind: Any) -> tuple[str, ...]:
    """Return the fields that are mutable records, or tuples of them."""
    return tuple(name for name, hint, _ in _schema(kind) if _changes((typing.get_args(hint) or (hint,))[0]))


def _changes(kind: Any) -> bool:
    return is_dataclass(kind) and not kind.__dataclass_params__.frozen  # type: ignore[union-attr]


def joined(records: typing.Sequence[Record]) -> Record:
    """Join N records of one character each into one: arrays along their first axis, tuples concatenated."""
    first = records[0]
    if len(records) == 1:
        return first
    made: Record = object.__new__(type(first))
    for name, value in vars(first).items():
        values = [getattr(record, name) for record in records]
        if isinstance(value, np.ndarray):
            made.__dict__[name] = np.concatenate(values)
        elif isinstance(value, tuple):
            made.__dict__[name] = tuple(item for each in values for item in each)
        else:
            made.__dict__[name] = joined(values)
    return made


def part(record: Record, index: int) -> Record:
    """Return the record of one character, sharing its values with the joined record."""
    made: Record = object.__new__(type(record))
    for name, value in vars(record).items():
        kept = value[index : index + 1] if isinstance(value, np.ndarray | tuple) else part(value, index)
        made.__dict__[name] = kept
    return made


def write_record(record: Any, arrays: list[np.ndarray]) -> Tree:
    """Return the JSON tree of a record; its arrays are appended to `arrays` and referenced by index."""
    return {f.name: _written(getattr(record, f.name), arrays) for f in fields(record)}


def _written(value: Any, arrays: list[np.ndarray]) -> Tree:
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value))
        return len(arrays) - 1
    if isinstance(value, tuple):
        return [_written(item, arrays) for item in value]
    return write_record(value, arrays) if is_dataclass(value) else value


@cache
def _schema(kind: Any) -> tuple[tuple[str, Any, Any], ...]:
    hints = typing.get_type_hints(kind)
    return tuple((f.name, hints[f.name], f.metadata) for f in fields(kind))


def read_record(kind: type[Record], tree: Tree, arrays: typing.Sequence[np.ndarray], path: str) -> Record:
    """Read a record written by `write_record`; FileError names an invalid field."""
    schema = _schema(typing.cast(Any, kind))
    if not isinstance(tree, dict) or not set(tree) <= {name for name, _, _ in schema}:
        raise _error(path, f"not the fields of a {kind.__name__}")
    made: Record = object.__new__(kind)
    for name, hint, metadata in schema:
        if name in tree:
            made.__dict__[name] = _read(hint, tree[name], arrays, f"{path}.{name}", metadata)
        elif isinstance(getattr(kind, name, None), float):  # a number added later has its default
            made.__dict__[name] = getattr(kind, name)
        elif metadata.get("later"):  # and so does a record
            made.__dict__[name] = hint()
        else:
            raise _error(path, f"not the fields of a {kind.__name__}")
    return made


def _error(path: str, problem: str) -> FileError:
    return FileError(f"{path}: {problem}.", REMEDY)


def _read(hint: Any, value: Tree, arrays: typing.Sequence[np.ndarray], path: str, metadata: Any) -> Any:
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in inside:
            return None
        (hint,) = set(inside) - {type(None)}
        return _read(hint, value, arrays, path, metadata)
    if origin is tuple:
        kinds = _kinds(inside, value, path)
        pairs = enumerate(zip(kinds, value, strict=True))
        return tuple(_read(kind, item, arrays, f"{path}[{k}]", metadata) for k, (kind, item) in pairs)
    if origin is np.ndarray:
        return _array(value, arrays, path, metadata)
    if is_dataclass(hint):
        return read_record(typing.cast(Any, hint), value, arrays, path)
    return (_chosen if hint in (bool, str) else _number)(hint, value, path, metadata)


def _kinds(inside: tuple[Any, ...], value: Tree, path: str) -> typing.Sequence[Any]:
    """Return the kind of each item of a tuple's values."""
    if not isinstance(value, list) or len(value) > MAX_TUPLE_ITEMS:
        raise _error(path, "expected a list")
    kinds = [inside[0]] * len(value) if inside[-1] is Ellipsis else inside
    if len(kinds) != len(value):
        raise _error(path, f"expected {len(kinds)} values")
    return kinds


def _chosen(hint: Any, value: Tree, path: str, metadata: Any) -> Any:
    """Return a flag, or one of the texts allowed for a field."""
    if hint is bool and not isinstance(value, bool):
        raise _error(path, "expected true or false")
    if hint is str and not (isinstance(value, str) and value in metadata["choices"]):
        raise _error(path, f"expected one of {', '.join(map(repr, metadata['choices']))}")
    return value


def _number(hint: Any, value: Tree, path: str, metadata: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int if hint is int else int | float):
        raise _error(path, "expected a whole number" if hint is int else "expected a number")
    if not abs(value) <= metadata.get("most", MAX_NUMBER):
        raise _error(path, "a number out of range")
    return value if hint is int else float(value)


def _array(value: Tree, arrays: typing.Sequence[np.ndarray], path: str, metadata: Any) -> np.ndarray:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < len(arrays):
        raise _error(path, "refers to no array")
    array = arrays[value]
    shape = metadata["whole"] if "whole" in metadata else (1, *metadata["shape"])
    kind = np.dtype(metadata.get("dtype", np.float64))
    if array.shape != shape:
        raise _error(path, f"shape {array.shape}, expected {shape}")
    if array.dtype != kind:
        raise _error(path, f"kind {array.dtype}, expected {kind}")
    if kind.kind == "f" and not (np.abs(array) <= metadata.get("most", MAX_NUMBER)).all():
        raise _error(path, "numbers out of range")
    return array.copy()
