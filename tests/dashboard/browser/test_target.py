"""The followed person on the page in Chromium: chosen, shown, given up."""

import time
from typing import Any

from playwright.sync_api import Page, expect
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from people4d.messages import Target, TargetCommand
from tests.dashboard.browser.chromium import MARKS, until
from tests.dashboard.browser.conftest import Open
from tests.dashboard.browser.stack import HOSTILE, Stack
from tests.network import Watcher

pytestmark = MARKS

CLICK_MS = 500.0  # maximum wait for an enabled button between two messages [ms]


def publish(stack: Stack, **fields: Any) -> None:
    """Publish a state of the chosen person."""
    header: dict[str, Any] = {"stamp_ns": time.time_ns(), "sequence": 0}
    stack.bus.publish(Target(**header, frame_id="map", camera="front", **fields))


def show(page: Page, stack: Stack, text: str, **fields: Any) -> None:
    """Publish a state of the chosen person until the page shows it."""
    state = page.locator("#target-state")

    def is_shown() -> bool:
        publish(stack, **fields)
        return state.text_content() == text

    until(is_shown, page)


def click(page: Page, stack: Stack, name: str, **fields: Any) -> None:
    """Publish a state until a button is clicked; without messages the page disables it."""
    button = page.get_by_role("button", name=name)

    def is_clicked() -> bool:
        publish(stack, **fields)
        try:
            button.click(timeout=CLICK_MS)
        except PlaywrightTimeoutError:
            return False
        return True

    until(is_clicked, page)


def test_click_follows_the_selected_person_and_another_one_stops(
    open_page: Open, stack: Stack
) -> None:
    commands, page = Watcher(stack.bus, TargetCommand), open_page()
    show(page, stack, "no person is followed", state="none")
    expect(page.locator("#follow")).to_be_disabled()
    expect(page.locator("#unfollow")).to_be_hidden()
    page.keyboard.press("n")
    click(page, stack, "Follow #1", state="none")
    command = commands.wait(TargetCommand, lambda one: one.action == "id")
    assert (command.id, command.chooser) == (1, "dashboard")
    show(page, stack, "follows #1: locked", state="locked", id=1, stop=False)
    expect(page.locator("tr.target button")).to_have_text("#1")
    click(page, stack, "Stop following", state="locked", id=1, stop=False)
    commands.wait(TargetCommand, lambda one: one.action == "none")


def test_state_of_the_followed_person_is_shown_with_its_reason(
    open_page: Open, stack: Stack
) -> None:
    page = open_page()
    show(page, stack, "follows #2: occluded", state="occluded", id=2, stop=False)
    expect(page.locator("tr.target button")).to_have_text("#2")
    show(page, stack, "followed person: searching", state="searching", reason=HOSTILE)
    expect(page.locator("#target-reason")).to_have_text(HOSTILE)
    expect(page.locator("tr.target")).to_have_count(0)
    show(page, stack, "followed person: lost", state="lost")


def test_without_the_service_the_control_is_hidden_and_its_end_is_shown(
    open_page: Open, stack: Stack
) -> None:
    page = open_page()
    expect(page.locator("#target")).to_be_hidden()
    page.keyboard.press("n")
    show(page, stack, "follows #1: locked", state="locked", id=1, stop=False)
    expect(page.locator("#target-state")).to_have_text("state of the followed person unknown")
    expect(page.locator("#follow")).to_be_disabled()
    expect(page.locator("#unfollow")).to_be_hidden()
