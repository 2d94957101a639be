"""Reference images of tests, compared with a tolerance; differences are written to tests/failures.

After an intended change of the look: SPORT_UPDATE_GOLDEN=1 pytest tests/viewer/render/test_render.py tests/viewer/render/test_golden.py, and look at
tests/golden.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from viewer.render.offscreen import save_png

GOLDEN = Path(__file__).parents[1] / "golden"
FAILURES = Path(__file__).parents[1] / "failures"
UPDATE = " After an intended change: SPORT_UPDATE_GOLDEN=1, and look at the new reference."


def check_golden(name: str, picture: np.ndarray, mean: float = 1.5, far: float = 0.01) -> None:
    """Compare with tests/golden; on a mismatch write picture, golden and difference to tests/failures.

    `mean` is the allowed mean difference, `far` the allowed fraction of pixels that are far off: drivers differ by single
    pixels on edges.
    """
    path = GOLDEN / f"{name}.png"
    if os.environ.get("SPORT_UPDATE_GOLDEN"):
        GOLDEN.mkdir(exist_ok=True)
        save_png(picture, path)
    golden = np.asarray(Image.open(path).convert("RGB")).astype(int)
    assert golden.shape == picture.shape, f"{name}: {picture.shape}, the reference is {golden.shape}"
    difference = np.abs(picture.astype(int) - golden)
    far_off = float(np.mean(difference.max(-1) > 32))
    if difference.mean() > mean or far_off > far:
        FAILURES.mkdir(exist_ok=True)
        shown = np.clip(4 * difference, 0, 255).astype(np.uint8)
        save_png(np.hstack([picture, golden.astype(np.uint8), shown]), FAILURES / f"{name}.png")
        told = f"mean difference {difference.mean():.2f}, {far_off:.1%} far off"
        pytest.fail(f"{name}: {told}; see {FAILURES}.{UPDATE}")
