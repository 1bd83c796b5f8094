"""Zones on the page in Chromium: drawn, saved, refused, deleted."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from tests.dashboard.browser.chromium import MARKS, click, on_map
from tests.dashboard.browser.conftest import Open
from tests.dashboard.browser.stack import HOSTILE, Stack

pytestmark = MARKS

MAP = "#map-canvas"
SQUARE = ((1.0, 1.0), (1.0, -1.0), (5.0, -1.0), (5.0, 1.0))
CROSSED = ((1.0, 1.0), (1.0, -1.0), (5.0, 1.0), (5.0, -1.0))


@pytest.fixture
def page(page: Page) -> Iterator[Page]:
    """The shared page, without zones before and after."""
    delete_zones(page)
    yield page
    delete_zones(page)


def delete_zones(page: Page) -> None:
    page.reload()
    expect(page.locator("#table tbody tr")).not_to_have_count(0)
    zones = page.locator("#zone-list li")
    while count := zones.count():
        zones.first.get_by_role("button").click()
        expect(zones).to_have_count(count - 1)


def draw(page: Page, corners_m: tuple[tuple[float, float], ...], name: str) -> None:
    """Draw a zone by mouse."""
    page.get_by_role("button", name="Draw a zone").click()
    for corner in corners_m:
        click(page, MAP, on_map(page, corner))
    page.get_by_role("button", name="Finish").click()
    page.get_by_label("Name").fill(name)
    page.get_by_role("button", name="Save").click()


def test_zone_is_drawn_saved_and_shown_to_others_after_a_restart(
    page: Page, open_page: Open, stack: Stack
) -> None:
    other = open_page()
    draw(page, SQUARE, HOSTILE)
    for one in (page, other):
        expect(one.locator("#zone-list li")).to_contain_text(HOSTILE)
        expect(one.locator("#zone-list img")).to_have_count(0)
    expect(page.locator("#event-list")).to_contain_text(f"entered {HOSTILE}")
    stack.kill("events")
    stack.kill("dashboard")
    expect(page.locator("#connection")).to_contain_text("no connection")
    stack.start_all()
    page.evaluate("dispatchEvent(new Event('online'))")  # it connects at once
    expect(page.locator("#connection")).to_have_text("connected")
    expect(open_page().locator("#zone-list li")).to_contain_text(HOSTILE)


def test_zone_is_drawn_by_keyboard(page: Page) -> None:
    page.get_by_role("button", name="Draw a zone").focus()
    page.keyboard.press("Enter")
    for key in ("Space", *["ArrowUp"] * 5, "Space", *["ArrowLeft"] * 5, "Space", "Enter"):
        page.keyboard.press(key)
    page.keyboard.type("by keyboard")
    page.get_by_label("Stay longer than").fill("2")
    page.keyboard.press("Enter")
    expect(page.locator("#zone-list li")).to_contain_text("by keyboard (longer than 2 s)")


def test_zone_that_crosses_itself_is_refused_with_a_reason(page: Page) -> None:
    draw(page, CROSSED, "crossed")
    expect(page.locator("#zone-problem")).to_contain_text("cross")
    expect(page.locator("#zone-list li")).to_have_count(0)
