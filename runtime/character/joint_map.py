"""The user's map of a character's joints: a JSON file next to the character."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

from runtime.atomic import write_atomic
from runtime.errors import FileError
from runtime.safe_read import is_text, parse_json, read_bounded, reason
from runtime.skeleton import SPORT_SKELETON

MAX_MAP_BYTES = 1024 * 1024
MAP_ENDING = ".joints.json"


def joint_map_path(character: str | Path) -> Path:
    """Return the path of the joint map of a character: FILE.joints.json next to it."""
    path = Path(character)
    return path.with_name(path.name + MAP_ENDING)


def read_joint_map(path: str | Path) -> dict[str, str]:
    """Read a JSON map of SPORT joint names to joint names of the user's character ("" for no joint)."""
    path = Path(path)
    form = 'Expected {"LeftArm": "name in the file", ...}.'
    try:
        data = parse_json(read_bounded(path, MAX_MAP_BYTES, form))
    except ValueError as error:
        raise FileError(f"{path}: not JSON ({reason(error)}).", form) from error
    if not isinstance(data, dict):
        raise FileError(f"{path}: not a JSON object.", form)
    known = SPORT_SKELETON.names
    wrong = sorted(
        key for key, value in data.items() if key not in known or not (value == "" or is_text(value))
    )
    if wrong:
        found = ", ".join(ascii(key[:40]) for key in wrong[:4])
        problem = f"{path}: expected SPORT joint names mapped to text, found {found}."
        raise FileError(problem, f"Known joints: {', '.join(known)}.")
    return data


def save_joint_map(character: str | Path, joints: Mapping[str, str]) -> Path:
    """Save the joint map next to its character file and return the path written. Raises FileError."""
    path = joint_map_path(character)
    ordered = {name: joints[name] for name in SPORT_SKELETON.names if name in joints}
    write_atomic(path, json.dumps(ordered, indent=2, ensure_ascii=False) + "\n")
    return path


def saved_joint_map(character: str | Path) -> dict[str, str]:
    """Return the joint map next to a character file, empty if there is none; FileError if it is damaged."""
    path = joint_map_path(character)
    return read_joint_map(path) if os.path.isfile(path) else {}
