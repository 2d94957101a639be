"""The real application without a display: a path is drawn on the ground by mouse, changed, and walked."""

import numpy as np
import pytest

from runtime.controls import Gait
from tests.helpers import hand
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    controller,
    do,
    message,
    point,
    press,
    run,
    run_until,
    screen_point,
)
from viewer.app import App


def test_a_drag_draws_a_path(app: App) -> None:
    app.scene.camera.current.yaw = 0.0
    do(app, "run 5; click Draw a path")
    point(app, *screen_point(app, -1.0, 2.0))
    hand.mouse(app.window, *screen_point(app, -1.0, 2.0), 0, True)
    for x in np.linspace(-1.0, 1.2, 23):
        hand.mouse(app.window, *screen_point(app, float(x), 2.0 + 0.5 * (float(x) + 1.0)))
        run(app)
    point(app, *screen_point(app, 1.2, 3.1), 0, False)
    points = np.array([(p.x, p.z) for p in app.path.points])
    assert 3 <= len(points) <= 5
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.all((gaps > 0.65) & (gaps < 1.0))
    assert np.allclose(points[:, 1], 2.0 + 0.5 * (points[:, 0] + 1.0), atol=0.1)


def test_a_path_is_drawn_changed_and_walked(start: Start) -> None:
    app = start(terrain="hills")
    app.scene.camera.current.yaw = 0.0  # from behind: every place lies between the panels
    run(app, 5)
    yaw = app.scene.camera.current.yaw
    click_on(app, "Draw a path")
    for place in ((0.0, 2.0), (0.6, 3.0), (-0.5, 3.5)):
        click(app, *screen_point(app, *place))
    tool = app.path
    drawn = ((0.0, 2.0), (0.6, 3.0), (-0.5, 3.5))
    near = [(pytest.approx(x, abs=0.02), pytest.approx(z, abs=0.1)) for x, z in drawn]
    assert [(p.x, p.z) for p in tool.points] == near
    assert app.scene.camera.current.yaw == yaw  # the camera stays
    click(app, *screen_point(app, 0.6, 3.0))  # takes the point that is there
    assert (len(tool.points), tool.selected) == (3, 1)
    x, y = screen_point(app, 0.6, 3.0)
    point(app, x, y, 0, True)
    point(app, *screen_point(app, 1.0, 3.0))
    point(app, *screen_point(app, 1.0, 3.0), 0, False)
    assert tool.points[1].x == pytest.approx(1.0, abs=0.05)
    click_on(app, "Jog")
    assert tool.points[1].gait is Gait.JOG
    press(app, "delete")
    assert len(tool.points) == 2
    click_on(app, "Walk it")
    run_until(app, lambda: tool.walk is None)
    assert message(app) == "Path completed."
    assert np.hypot(controller(app).x + 0.5, controller(app).z - 3.5) < 0.5
    click_on(app, "Walk it")
    assert tool.walk is not None
    app.window.inject_key("w", True)
    run(app, 2)
    assert tool.walk is None  # the user's own stick
    app.window.inject_key("w", False)
    click_on(app, "Clear")
    assert tool.points == ()
