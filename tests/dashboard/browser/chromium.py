"""Chromium for tests of the page, and readings from the page."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from people4d.messages import U8

MARKS = [
    *(pytest.mark.processes, pytest.mark.network, pytest.mark.timeout(300)),
    pytest.mark.xdist_group("browser"),  # share one system and one browser
]
REQUIRE = "PEOPLE4D_REQUIRE_CHROMIUM"  # set where a missing Chromium must fail the tests
WAIT_S = 100.0
# The processor draws everything, 3D by SwiftShader; root has no sandbox. No name is looked up.
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
)
IMAGE = "#images canvas"
STORE = "async (name) => (await import('/js/store.js')).store[name]"


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Chromium; skip the test where there is none, unless it is required."""
    path = shutil.which("chromium")
    if path is None:
        if os.environ.get(REQUIRE):
            pytest.fail(f"{REQUIRE} is set, and there is no chromium")
        pytest.skip("Chromium is not installed (on Debian: apt install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


def until(condition: Callable[[], Any], page: Page) -> Any:
    """Return the first true value of a condition; TimeoutError if it stays false."""
    end_s = time.monotonic() + WAIT_S
    while not (value := condition()):
        if time.monotonic() > end_s:
            raise TimeoutError(f"{condition} stayed {value}")
        page.wait_for_timeout(50)
    return value


def stored(page: Page, name: str) -> Any:
    """Return a value of the page's store."""
    return page.evaluate(STORE, name)


def wait_past(page: Page, at_ms: float) -> None:
    """Wait until the page shows people of a later time."""
    until(lambda: stored(page, "atMs") > at_ms, page)


def on_map(page: Page, position_m: tuple[float, float]) -> tuple[float, float]:
    """Return the pixel of the map's canvas at a position, once the newest scene is drawn."""
    script = """async (at) => {
      await new Promise(requestAnimationFrame);
      return (await import('/js/map.js')).toScreen(at);
    }"""
    u, v = page.evaluate(script, list(position_m))
    return u, v


def click(page: Page, canvas: str, at_px: tuple[float, float]) -> None:
    """Click on a pixel of a canvas."""
    page.locator(canvas).click(position={"x": at_px[0], "y": at_px[1]})


def pixels(page: Page, part: str) -> U8:
    """Return the pixels of a part of the page on the screen (HxWx3, blue first)."""
    box = page.locator(part).bounding_box()
    assert box is not None
    data = np.frombuffer(page.screenshot(clip=box), np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image, np.uint8)


def shows_image(page: Page) -> bool:
    """Check that the first camera's canvas has an image up to its corner."""
    return page.locator(IMAGE).count() > 0 and pixel(page, IMAGE, 3, 3)[3] == 255


def pixel(page: Page, canvas: str, u: float, v: float) -> tuple[int, ...]:
    """Return the colour of a pixel of a canvas: red, green, blue, opacity."""
    script = """(canvas, [u, v]) => {
      const ratio = canvas.width / canvas.clientWidth;
      return [...canvas.getContext("2d").getImageData(u * ratio, v * ratio, 1, 1).data];
    }"""
    return tuple(page.locator(canvas).evaluate(script, [u, v]))
