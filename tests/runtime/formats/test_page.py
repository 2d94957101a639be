"""A take as a web page, in a real headless Chromium without a network: pictures, keys, a phone's size."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from tests.helpers.browser import key, needs_browser, picture, script, until
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


def facts_of(page: Path) -> dict[str, Any]:
    text = page.read_text(encoding="utf-8")
    return json.loads(re.findall(r'<script[^>]*id="facts"[^>]*>(.*?)</script>', text, re.S)[0])


def longer_page(folder: Path) -> Path:
    """A page of a take of 2 s and a further one of 3 s."""
    save_motion(Clip("long", 60.0, *walk(181)), folder / "long.bvh", ExportOptions())
    save_motion(CLIP, folder / "two.html", ExportOptions(with_takes=(folder / "long.bvh",)))
    return folder / "two.html"


def test_a_page_plays_until_its_longest_take_ends(tmp_path: Path) -> None:
    facts = facts_of(longer_page(tmp_path))
    assert facts["seconds"] == pytest.approx(3.0)
    assert len(facts["contacts"]) == 181
    assert set(facts["contacts"][120:]) == {"0"}, "the shorter one waits"


@needs_browser
def test_a_browser_shows_a_longer_take_to_its_end(tmp_path: Path, browser: Any) -> None:
    browser.get(longer_page(tmp_path).as_uri())
    until(browser, "window.take && window.take.ready")
    key(browser, "\ue010")  # End
    assert script(browser, "take.seconds") == pytest.approx(3.0, abs=1e-3)


@needs_browser
def test_a_browser_shows_plays_and_obeys(page: Path, browser: Any) -> None:
    browser.set_window_size(640, 520)
    browser.get(page.as_uri())
    until(browser, "window.take && window.take.ready")
    if script(browser, "take.playing"):
        key(browser, " ")
    assert script(browser, "take.playing") is False
    key(browser, "\ue011")  # Home
    assert script(browser, "take.seconds") == 0
    first = picture(browser)
    assert first[60:300, 220:420].std() > 15.0, "somebody stands in the middle"
    key(browser, ".")
    assert script(browser, "take.seconds") == pytest.approx(1 / 60, abs=1e-4)
    key(browser, "\ue010")  # End
    assert script(browser, "take.seconds") == pytest.approx(119 / 60, abs=1e-3)
    assert "drunk" in script(browser, "document.getElementById('words').textContent")
    key(browser, "2")
    assert script(browser, "take.camera") == "side"
    side = picture(browser)
    assert np.abs(side - first).max() > 60, "another pose from another side"
    light = side[2, 300].mean()
    key(browser, "t")
    assert abs(picture(browser)[2, 300].mean() - light) > 100, "dark and light"
    assert script(browser, "document.querySelectorAll('#marks button').length") == 2
    script(browser, "document.querySelectorAll('#marks button')[1].click()")
    assert script(browser, "take.seconds") == pytest.approx(1.0)
    key(browser, " ")
    until(browser, "take.seconds !== 1")
    severe = [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert severe == []
    browser.set_window_size(500, 844)
    assert script(browser, "document.documentElement.scrollWidth <= innerWidth")
    footer = script(browser, "document.querySelector('footer').getBoundingClientRect().top / innerHeight")
    assert footer > 0.6, "the take has most of a narrow window"
