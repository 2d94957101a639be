"""A take as a web page, in a real headless Chromium without a network: pictures, keys, a phone's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from tests.helpers.browser import Browser, needs_browser
from tests.helpers.walker import walk

CLIP = Clip("</script><b>walk", 60.0, *walk(120),
            prompts=(PromptEvent(0.0, "</script> proud"), PromptEvent(1.0, "drunk")))  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "take.html"
    save_motion(CLIP, path, ExportOptions(), load_terrain("hills"))
    return path


def test_the_page_is_one_small_file_that_needs_no_network(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 4_000_000
    assert "<title>&lt;/script&gt;&lt;b&gt;walk</title>" in text
    assert text.count("</script>") == 4, "what was typed ends no script"
    assert 'src="' not in text
    assert "three.js" in text


@needs_browser
def test_a_browser_shows_plays_and_obeys(page: Path, browser: Browser) -> None:
    browser.send("/window/rect", {"width": 640, "height": 520})
    browser.send("/url", {"url": page.as_uri()})
    browser.until("window.take && window.take.ready")
    if browser.script("return take.playing"):
        browser.key(" ")
    assert browser.script("return take.playing") is False
    browser.key("\ue011")  # Home
    assert browser.script("return take.seconds") == 0
    first = browser.picture()
    middle = first[60:300, 220:420]
    assert middle.std() > 15.0, "somebody stands in the middle"
    browser.key(".")
    assert browser.script("return take.seconds") == pytest.approx(1 / 60, abs=1e-4)
    browser.key("\ue010")  # End
    assert browser.script("return take.seconds") == pytest.approx(119 / 60, abs=1e-3)
    assert "drunk" in browser.script("return document.getElementById('words').textContent")
    browser.key("2")
    assert browser.script("return take.camera") == "side"
    side = browser.picture()
    assert np.abs(side - first).max() > 60, "another pose from another side"
    light = side[2, 300].mean()
    browser.key("t")
    assert abs(browser.picture()[2, 300].mean() - light) > 100, "dark and light"
    assert browser.script("return document.querySelectorAll('#marks button').length") == 2
    browser.script("document.querySelectorAll('#marks button')[1].click()")
    assert browser.script("return take.seconds") == pytest.approx(1.0)
    browser.key(" ")
    browser.until("take.seconds !== 1")
    severe = [
        entry["message"]
        for entry in browser.send("/se/log", {"type": "browser"})
        if entry["level"] == "SEVERE"
    ]
    assert severe == []
    browser.send("/window/rect", {"width": 500, "height": 844})
    assert browser.script("return document.documentElement.scrollWidth <= innerWidth")
    footer = browser.script(
        "return document.querySelector('footer').getBoundingClientRect().top / innerHeight"
    )
    assert footer > 0.6, "the take has most of a narrow window"
