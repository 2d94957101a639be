"""A real headless Chromium without a network, driven by the WebDriver protocol alone."""

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
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
ARGUMENTS = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-dev-shm-usage", "--force-prefers-reduced-motion", "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"]  # fmt: skip
needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no Chromium: apt-get install chromium chromium-driver",
)


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
    """A browser that ends with the test."""
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
