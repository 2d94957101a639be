"""A take as a web page, in a real headless Chromium without a network: pictures, keys, a phone's size."""

from __future__ import annotations

import base64
import io
import json
import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from walker import walk

from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain

CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
CLIP = Clip("</script><b>walk", 60.0, *walk(120),
            prompts=(PromptEvent(0.0, "</script> proud"), PromptEvent(1.0, "drunk")))  # fmt: skip
ARGUMENTS = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-dev-shm-usage", "--force-prefers-reduced-motion", "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"]  # fmt: skip
needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no Chromium: apt-get install chromium chromium-driver",
)


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


class Browser:
    """A session of WebDriver, by its protocol alone."""

    def __init__(self, port: int) -> None:
        self._at = f"http://127.0.0.1:{port}"
        options = {"args": ARGUMENTS, "binary": CHROMIUM}
        wanted = {
            "capabilities": {
                "alwaysMatch": {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
            }
        }
        self._at += f"/session/{self.send('/session', wanted)['sessionId']}"

    def send(self, path: str, value: dict | None = None, method: str = "POST") -> Any:
        data = None if value is None else json.dumps(value).encode()
        request = urllib.request.Request(
            self._at + path, data, {"Content-Type": "application/json"}, method=method
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def script(self, text: str) -> Any:
        return self.send("/execute/sync", {"script": text, "args": []})

    def key(self, key: str) -> None:
        pressed = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.send("/actions", {"actions": [{"type": "key", "id": "keys", "actions": pressed}]})

    def picture(self) -> np.ndarray:
        """What WebGL draws."""
        data = base64.b64decode(self.script("return take.picture()").split(",")[1])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)

    def until(self, condition: str, seconds: float = 40.0) -> None:
        end = time.monotonic() + seconds
        while not self.script(f"return {condition}"):
            assert time.monotonic() < end, condition
            time.sleep(0.1)


@pytest.fixture
def browser() -> Iterator[Browser]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert DRIVER is not None
    process = subprocess.Popen(
        [DRIVER, f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        end = time.monotonic() + 30.0
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 0.2).close()
                break
            except OSError:
                assert time.monotonic() < end
                time.sleep(0.1)
        session = Browser(port)
        yield session
        session.send("", method="DELETE")
    finally:
        process.terminate()
        process.wait(10)


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
