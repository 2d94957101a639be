"""Reference images of the panels at three sizes, with a fake model behind them."""

import pytest

from tests.helpers.app_driver import Start, run
from tests.helpers.golden_images import check_golden


@pytest.mark.parametrize(("width", "height", "scale"), [(1280, 720, 1.0), (800, 500, 1.0), (1600, 900, 1.5)])
def test_panels(start: Start, width: int, height: int, scale: float) -> None:
    app = start(drawn=True, prompt="a proud king", width=width, height=height, ui_scale=scale)
    run(app, 4)
    check_golden(f"panels_{width}x{height}", app.window.read_pixels())
