"""Access to the page in Chromium: tokens, roles, two pages, restarts, text of others."""

from playwright.sync_api import Browser, Page, expect

from tests.dashboard.browser.chromium import (
    IMAGE,
    MARKS,
    pixel,
    shows_image,
    stored,
    until,
    wait_past,
)
from tests.dashboard.browser.conftest import Open
from tests.dashboard.browser.stack import HOSTILE, OPERATOR, PLANNER, Stack

pytestmark = MARKS


def test_wrong_token_is_refused_and_the_right_one_opens_the_page(
    browser: Browser, stack: Stack
) -> None:
    page = browser.new_page()
    page.goto(stack.url)
    expect(page).to_have_url(f"{stack.url}login.html")
    expect(page.locator("#wrong")).to_be_hidden()
    page.get_by_label("Token").fill("wrong")
    page.get_by_role("button", name="Open").click()
    expect(page.locator("#wrong")).to_be_visible()
    page.get_by_label("Token").fill(OPERATOR)
    page.get_by_role("button", name="Open").click()
    expect(page.locator("#connection")).to_have_text("connected")
    assert page.evaluate("document.cookie") == ""  # scripts cannot read it
    assert OPERATOR not in page.url
    page.close()


def test_planner_gets_people_but_neither_images_nor_zones_to_draw(open_page: Open) -> None:
    page = open_page(token=PLANNER)
    expect(page.get_by_role("button", name="Draw a zone")).to_be_hidden()
    assert not stored(page, "images")
    assert pixel(page, IMAGE, 3, 3)[3] == 0


def test_two_pages_select_and_pause_each_for_itself(open_page: Open) -> None:
    first, second = open_page(), open_page()
    first.keyboard.press("n")
    first.get_by_role("button", name="Pause").click()
    expect(first.locator("tr.chosen")).to_have_count(1)
    wait_past(second, stored(second, "atMs"))
    expect(second.locator("tr.chosen")).to_have_count(0)
    expect(second.locator("#when")).to_have_text("live")


def test_page_connects_again_after_service_and_router_restart(
    open_page: Open, stack: Stack
) -> None:
    page = open_page()
    stack.kill("dashboard")
    expect(page.locator("#connection")).to_contain_text("no connection")
    stack.start("dashboard")
    expect(page.locator("#connection")).to_have_text("connected")
    wait_past(page, stored(page, "atMs"))
    stack.network.stop_router()
    until(lambda: is_still(page), page)
    before_ms = stored(page, "atMs")
    stack.network.start_router()
    wait_past(page, before_ms)
    expect(page.locator("#connection")).to_have_text("connected")
    until(lambda: shows_image(page), page)


def is_still(page: Page) -> bool:
    """Check that no people arrive."""
    before_ms = stored(page, "atMs")
    page.wait_for_timeout(1000)
    return bool(stored(page, "atMs") == before_ms)


def test_text_of_others_is_shown_as_text(page: Page) -> None:
    expect(page.locator("#table tbody")).to_contain_text(HOSTILE)
    expect(page.locator("#processes tbody")).to_contain_text(HOSTILE)
    expect(page.locator("img[src=x]")).to_have_count(0)
    assert page.evaluate("window.hacked") is None
