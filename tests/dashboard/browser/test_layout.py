"""The page in Chromium on a telephone, in dark and light, and for assistive technology."""

import itertools

from playwright.sync_api import Browser, Page, expect

from people4d.messages import Event
from tests import ROOT
from tests.dashboard.browser.chromium import MARKS, shows_image, stored, until
from tests.dashboard.browser.conftest import Open
from tests.dashboard.browser.stack import Stack

pytestmark = MARKS

AXE = ROOT / "tests/dashboard/vendor/axe.min.js"
FAULTS = """async () => (await axe.run()).violations
  .filter(({ impact }) => impact === "serious" || impact === "critical")
  .map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html).join("; ")}`)
"""
PHONE_PX = 390
GROUND = "getComputedStyle(document.body).backgroundColor"
DARK, LIGHT = "rgb(14, 19, 25)", "rgb(238, 241, 244)"


def faults(page: Page) -> list[str]:
    """Return the serious and critical faults of accessibility."""
    page.evaluate(AXE.read_text())
    found: list[str] = page.evaluate(FAULTS)
    return found


def test_page_has_no_serious_fault_of_accessibility(open_page: Open, stack: Stack) -> None:
    page = open_page()
    stack.bus.publish(Event(stamp_ns=1, sequence=10**6, kind="identity_uncertain", id=1))
    expect(page.locator("#event-list")).to_contain_text("identity uncertain")
    expect(page.locator("#diagnostics li")).not_to_have_count(0)
    expect(page.locator("#processes tbody tr")).not_to_have_count(0)
    page.keyboard.press("n")
    page.keyboard.press(",")
    for width in (1280, PHONE_PX):
        page.set_viewport_size({"width": width, "height": 900})
        for scheme in ("dark", "light"):
            page.emulate_media(color_scheme=scheme)
            assert (width, scheme, faults(page)) == (width, scheme, [])


def test_login_has_no_serious_fault_of_accessibility(browser: Browser, stack: Stack) -> None:
    page = browser.new_page()
    page.goto(stack.url + "login.html#wrong")
    assert faults(page) == []
    page.close()


def test_telephone_shows_everything_without_scrolling_sideways(open_page: Open) -> None:
    page = open_page(width=PHONE_PX, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE_PX
    for part in ("cameras", "people", "map", "space", "events", "health"):
        box = page.locator(f"#{part}").bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE_PX
        assert box["height"] > 40
    for button in page.get_by_role("button").all():
        box = button.bounding_box()
        assert box is None or min(box["width"], box["height"]) >= 24
    page.locator("#table tbody tr").first.get_by_role("button").tap()
    expect(page.locator("tr.chosen")).to_have_count(1)
    until(lambda: shows_image(page), page)


def test_page_follows_the_system_to_dark_and_light(page: Page) -> None:
    drawn = "import('/js/colours.js').then(({ css }) => css('ground'))"
    page.emulate_media(color_scheme="dark")
    assert (page.evaluate(GROUND), page.evaluate(drawn)) == (DARK, "#0e1319")
    page.emulate_media(color_scheme="light")
    assert (page.evaluate(GROUND), page.evaluate(drawn)) == (LIGHT, "#eef1f4")


def test_everything_is_reached_by_the_tab_key(page: Page) -> None:
    names = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        names.add(page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert {"pause", "time", "#1", "event-log", "map-canvas", "draw"} <= names
    assert {"space-canvas", "cloud", "reset"} <= names
    page.get_by_role("link", name="Skip to the people").focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "people"
    assert stored(page, "selected") is None


def test_stages_of_the_latency_chart_have_colours_of_their_own(open_page: Open) -> None:
    page = open_page()
    colours = page.evaluate("""async () => {
      const { emit } = await import("/js/store.js");
      const stage = (name, ms) => ({ stage: name, p50_ms: ms, parallel: false });
      const process = { instance: "x", service: "x", state: "ready", rates_hz: {}, losses: {},
        cpu_percent: null, memory_mb: null };
      for (let k = 1; k < 30; k++) { // other stages become the longest, one after the other
        const stages = Array.from({ length: 12 }, (_, n) => stage(`s${k + n}`, 10 * k + n));
        emit("message:health", { at_ms: 1e15 + 20000 * k, processes: [{ ...process, stages }],
          end_to_end: null });
      }
      return [...document.querySelectorAll("#latency-legend .dot")].map((d) => d.style.background);
    }""")
    assert len(colours) == 9
    assert len(set(colours)) == 9


def test_labels_of_people_close_together_do_not_hide_one_another(page: Page) -> None:
    taken = page.evaluate("""async () => {
      const { label } = await import("/js/canvas.js");
      const context = document.createElement("canvas").getContext("2d"), taken = [];
      for (let k = 0; k < 6; k++) label(context, `#${k} 3.0 m`, 5 * k, 60, "#000", "#fff", taken);
      return taken;
    }""")
    tops = sorted((one["y"] - one["height"], one["y"]) for one in taken)
    assert all(low <= top for (_, low), (top, _) in itertools.pairwise(tops))
    assert tops[0][0] >= 0


def test_no_column_of_a_wide_page_is_half_empty(page: Page) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    ends = page.evaluate("""() => [...document.querySelectorAll(".column")].map((column) =>
      column.lastElementChild.getBoundingClientRect().bottom)""")
    height = page.evaluate("document.documentElement.scrollHeight")
    assert abs(ends[0] - ends[1]) < 0.25 * height
