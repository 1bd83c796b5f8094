"""One system and one browser for all tests of the page, and one page for short tests."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.dashboard.browser.chromium import WAIT_S, chromium, stored
from tests.dashboard.browser.stack import OPERATOR, PEOPLE, Stack

Open = Callable[..., Page]


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Chromium."""
    expect.set_options(timeout=WAIT_S * 1000)
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="package")
def stack(browser: Browser) -> Iterator[Stack]:
    """The system."""
    with TemporaryDirectory(prefix="p4d") as folder, Stack(Path(folder)) as stack:
        yield stack


@contextmanager
def pages(browser: Browser, stack: Stack) -> Iterator[Open]:
    """Open pages, each in a context of its own, and check that they had no error."""
    contexts: list[BrowserContext] = []
    errors: list[str] = []

    def open_page(
        token: str = OPERATOR, width: int = 1280, script: str = "", **options: Any
    ) -> Page:
        context = browser.new_context(viewport={"width": width, "height": 900}, **options)
        contexts.append(context)
        page = context.new_page()
        page.add_init_script(script)
        page.set_default_timeout(WAIT_S * 1000)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"{stack.url}?token={token}")
        expect(page.locator("#table tbody tr")).to_have_count(PEOPLE)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert errors == []


@pytest.fixture
def open_page(browser: Browser, stack: Stack) -> Iterator[Open]:
    """Opens pages for one test."""
    with pages(browser, stack) as open_page:
        yield open_page


@pytest.fixture(scope="package")
def shared_page(browser: Browser, stack: Stack) -> Iterator[Page]:
    """A page opened once for all tests."""
    with pages(browser, stack) as open_page:
        yield open_page()


@pytest.fixture
def page(shared_page: Page) -> Iterator[Page]:
    """The shared page, live and without a selection before and after a test."""
    yield shared_page
    shared_page.set_viewport_size({"width": 1280, "height": 900})
    if stored(shared_page, "paused"):
        shared_page.locator("#pause").click()
    shared_page.evaluate("document.activeElement.blur()")
    if stored(shared_page, "selected") is not None:
        shared_page.keyboard.press("Escape")
