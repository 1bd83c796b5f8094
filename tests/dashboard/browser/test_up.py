"""The page of a system that `people4d up --dashboard` started, fed by the whole pipeline."""

from pathlib import Path

from playwright.sync_api import Browser, expect

from common.transport.ports import free_port
from deploy.cli.live.page import page_address
from deploy.launcher.state import State
from tests.dashboard.browser.chromium import MARKS, WAIT_S, shows_image, until
from tests.integration.system import ROBOT, running

STANDING = "tests.attacks.standing:StandingPeople"

pytestmark = MARKS


def test_page_shows_the_people_of_a_system_that_was_just_started(
    browser: Browser, tmp_path: Path
) -> None:
    settings = ("--dashboard", "--set", f"dashboard.port={free_port()}")
    with running(tmp_path, *settings, source=STANDING):
        address = page_address(State(tmp_path / ROBOT))
        assert address is not None
        page = browser.new_page()
        page.set_default_timeout(WAIT_S * 1000)
        page.goto(address.login)
        people = page.locator("#table tbody tr")
        people.first.wait_for()
        until(lambda: shows_image(page), page)
        expect(page.locator("#processes")).to_contain_text("tracker-1")
        people.first.get_by_role("button").click()
        expect(page.locator("tr.chosen")).to_have_count(1)
        page.close()
