"""One system and one browser for all tests of the page."""

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.dashboard.browser.chromium import WAIT_S, chromium
from tests.dashboard.browser.stack import OPERATOR, PEOPLE, Stack

Open = Callable[..., Page]
REMEMBER = "import('/js/store.js').then(({ on }) => on('scene', (s) => { window.scene = s; }))"


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


@pytest.fixture
def open_page(browser: Browser, stack: Stack) -> Iterator[Open]:
    """Opens pages, each of a browser of its own; none may have had an error at the end."""
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
        page.evaluate(REMEMBER)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert errors == []
