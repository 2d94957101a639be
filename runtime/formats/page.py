"""A take as a web page: one file that works offline in any browser, with the character, ground and player in it."""

import base64
import gzip
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime.assets import asset_path
from runtime.atomic import write_atomic
from runtime.formats.glb import further_takes, glb_document
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.formats.sidecar import markers
from runtime.safe_read import printable
from runtime.terrain.height_map import Terrain

GROUND_VERTICES, GROUND_MARGIN_M = 24_000, 5.0  # of the ground around the take: keeps a page small


def save_page(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> None:
    """Write a take as a web page, with its `terrain` if it has a place on it. Raises FileError."""
    ground = terrain is not None and take.clip.placed is not None
    options = replace(options, with_ground=ground)
    takes = [take, *further_takes(options, terrain)]
    buffer, hips = glb_document(takes, options, terrain, check, GROUND_VERTICES, GROUND_MARGIN_M)
    seconds = max(each.clip.seconds for each in takes)
    frames = max(len(take.clip), round(seconds * take.clip.fps) + 1)
    contacts = np.pad(take.clip.contacts > 0.5, ((0, frames - len(take.clip)), (0, 0)))
    feet = np.stack([contacts[:, :2].any(axis=1), contacts[:, 2:].any(axis=1)], axis=1) @ np.array([1, 2])
    facts = {
        "fps": take.clip.fps,
        "seconds": seconds,
        "hips": hips,
        "markers": markers(take.clip),
        "contacts": "".join(str(bits) for bits in feet.tolist()),
        "yaw": np.round(take.root.yaw, 3).tolist(),
    }
    parts = {
        "title": html.escape(printable(take.clip.name)),
        # no text of a take may end the script: "<" is escaped
        "facts": json.dumps(facts, ensure_ascii=False).replace("<", "\\u003c"),
        "glb": base64.b64encode(gzip.compress(buffer.to_bytes(), 9, mtime=0)).decode("ascii"),
        "three": asset_path("web/three.min.js").read_text(encoding="utf-8"),
        "script": asset_path("web/take.js").read_text(encoding="utf-8"),
    }
    page = asset_path("web/page.html").read_text(encoding="utf-8")
    text = re.sub(r"\{\{(\w+)\}\}", lambda name: parts[name[1]], page)
    check()
    write_atomic(path, text)
