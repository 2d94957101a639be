"""Makes many clips on all cores, one per row, with a manifest; an interrupted run can be continued.

python examples/06_batch.py [FOLDER]
"""

import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from sport import SportError

ROWS: list[dict[str, Any]] = [
    {"name": f"{style.split()[-1]}_{seed}", "prompt": style, "seed": seed, "seconds": 1.0}
    for style in ("a proud queen", "a frail old man")
    for seed in (0, 1)
] + [{"name": "broken", "prompt": "a proud queen", "terrain": "the moon"}]  # a failure stops no other clip


def make(row: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Generate and write one row; return its line of the manifest."""
    from runtime.formats.bvh_clip import save_bvh
    from runtime.generate import generate_clip

    arguments = {key: value for key, value in row.items() if key != "name"}
    try:
        clip = generate_clip(**arguments, name=row["name"])
        save_bvh(clip, folder / f"{row['name']}.bvh")
    except SportError as error:
        return row | {"error": str(error)}
    return row | {"file": f"{row['name']}.bvh", "frames": len(clip)}


def main(arguments: list[str]) -> None:
    """Make what is missing, and write `manifest.json`."""
    folder = Path(arguments[0] if arguments else "clips")
    folder.mkdir(parents=True, exist_ok=True)
    manifest = folder / "manifest.json"
    done = json.loads(manifest.read_text(encoding="utf-8")) if manifest.exists() else {}
    waiting = [row for row in ROWS if "file" not in done.get(row["name"], {})]
    print(f"{len(ROWS) - len(waiting)} of {len(ROWS)} are there")
    context = multiprocessing.get_context("spawn")  # onnxruntime's threads do not survive a fork
    with ProcessPoolExecutor(min(len(waiting), os.cpu_count() or 1) or 1, context) as pool:
        for future in as_completed([pool.submit(make, row, folder) for row in waiting]):
            made = future.result()
            done[made["name"]] = made
            manifest.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")
            print(made.get("file") or f"{made['name']}: {made['error']}")


if __name__ == "__main__":
    main(sys.argv[1:])
