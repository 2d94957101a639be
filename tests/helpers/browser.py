"""A real headless Chromium without a network."""

import base64
import io
import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
ARGUMENTS = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-dev-shm-usage", "--force-prefers-reduced-motion", "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"]  # fmt: skip
needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="no Chromium: apt-get install chromium chromium-driver"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A `selenium` browser for the tests of a file."""
    selenium = pytest.importorskip("selenium.webdriver")
    options = selenium.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ARGUMENTS:
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    window = selenium.Chrome(options, selenium.ChromeService(DRIVER))
    yield window
    window.quit()


def script(browser: Any, text: str) -> Any:
    """Return the value of an expression on the page."""
    return browser.execute_script(f"return {text}")


def key(browser: Any, name: str) -> None:
    """Press a key in the focused element of the page."""
    from selenium.webdriver import ActionChains

    ActionChains(browser).send_keys(name).perform()


def picture(browser: Any) -> np.ndarray:
    """Return the WebGL picture on the page of a take."""
    data = base64.b64decode(script(browser, "take.picture()").split(",")[1])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def until(browser: Any, condition: str, seconds: float = 40.0) -> None:
    """Wait until an expression is true."""
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, seconds, 0.1).until(lambda window: script(window, condition))
