"""People on the page in Chromium: shown, selected, gone back to, followed by keyboard."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.dashboard.browser.chromium import (
    IMAGE,
    MARKS,
    click,
    on_map,
    pixel,
    pixels,
    shows_image,
    stored,
    until,
    wait_past,
)
from tests.dashboard.browser.conftest import Open
from tests.dashboard.browser.stack import PEOPLE, WIDTH_PX

pytestmark = MARKS

MAP, SPACE = "#map-canvas", "#space-canvas"
ROW = "#table tbody tr"
MARGIN_PX = 12  # between boxes that do not touch
WHITE, INK = (255, 255, 255), (24, 32, 42)


# Live scenes in transit are newer than the pause; the answer to the pause is not.
PAUSED = """async () => {
  const { on, store } = await import("/js/store.js");
  const atMs = store.atMs;
  return new Promise((resolve) => {
    on("scene", (scene) => { if (store.paused && scene.at_ms <= atMs) resolve(scene); });
    document.getElementById("pause").click();
  });
}"""


def pause(page: Page) -> dict[str, Any]:
    """Pause a page that shows an image, and return the scene that is drawn."""
    until(lambda: shows_image(page), page)
    scene: dict[str, Any] = page.evaluate(PAUSED)
    expect(page.locator(IMAGE)).to_have_attribute("data-frame", scene["frame"])
    return scene


def alone(scene: dict[str, Any]) -> list[int]:
    """Return the people with boxes that touch no other box, with a margin."""
    boxes = {one["id"]: one["box_px"] for one in scene["boxes"] if one["id"] is not None}

    def apart(one: int, other: int) -> bool:
        first, second = boxes[one], boxes[other]
        return any(
            a[k + 2] + MARGIN_PX < b[k]
            for k in (0, 1)
            for a, b in ((first, second), (second, first))
        )

    visible = [one for one in boxes if boxes[one][0] > MARGIN_PX]
    return [one for one in visible if all(apart(one, other) for other in boxes if other != one)]


def position_of(scene: dict[str, Any], number: int) -> tuple[float, float]:
    """Return the position of a person of a scene [m]."""
    x, y, _ = next(one["position_m"] for one in scene["people"] if one["id"] == number)
    return x, y


def test_people_are_shown_in_image_map_and_table(page: Page) -> None:
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator("#count")).to_have_text(f"{PEOPLE} people")
    expect(page.locator("#latency")).to_contain_text("ms from image to people")
    for number in range(1, PEOPLE + 1):
        row = page.locator(f"{ROW}[data-id='{number}']")
        expect(row).to_contain_text("confirmed")
        expect(row).to_contain_text("followed 97 % no other person is near")
    until(lambda: shows_image(page), page)
    expect(page.locator("#processes tbody tr")).not_to_have_count(0)


def test_person_is_selected_in_image_map_and_table_at_once(open_page: Open) -> None:
    page = open_page(color_scheme="light")
    while not (found := alone(scene := pause(page))):
        page.locator("#pause").click()
        wait_past(page, scene["at_ms"])
    number = found[0]
    scale = page.locator(IMAGE).evaluate("(canvas) => canvas.clientWidth") / WIDTH_PX
    box = next(one for one in scene["boxes"] if one["id"] == number)["box_px"]
    left, top, right, bottom = (value * scale for value in box)
    position = position_of(scene, number)
    u, v = on_map(page, position)
    row = page.locator(f"{ROW}[data-id='{number}']")

    def is_ringed() -> bool:
        # The arrow of the person's heading covers at most one of two points of the ring.
        return INK in (pixel(page, MAP, u - 16, v)[:3], pixel(page, MAP, u, v + 16)[:3])

    def press_n() -> None:
        for _ in range(number):
            page.keyboard.press("n")

    choices: list[Callable[[], None]] = [
        lambda: click(page, IMAGE, ((left + right) / 2, (top + bottom) / 2)),
        lambda: click(page, MAP, (u, v)),
        lambda: row.locator("td").nth(3).click(),
        press_n,
    ]
    for choose in choices:
        choose()
        expect(row.get_by_role("button")).to_have_attribute("aria-pressed", "true")
        expect(page.locator(f"{ROW}.chosen")).to_have_count(1)
        until(lambda: pixel(page, IMAGE, left - 3, (top + bottom) / 2)[:3] == WHITE, page)
        until(is_ringed, page)
        page.keyboard.press("Escape")
        expect(page.locator(f"{ROW}.chosen")).to_have_count(0)
    assert on_map(page, position) == (u, v)  # a paused map stays still


def test_paused_page_goes_back_and_is_live_again(page: Page) -> None:
    wait_past(page, stored(page, "atMs") + 2500)
    now = pause(page)
    page.locator("#time").fill("-2")
    expect(page.locator("#when")).to_have_text("-2.0 s")
    until(lambda: stored(page, "atMs") < now["at_ms"] - 500, page)
    then = {"people": stored(page, "people")}
    moved = [math.dist(position_of(then, n), position_of(now, n)) for n in range(1, PEOPLE + 1)]
    assert min(moved) > 0.1  # they walk at 0.35 m/s or more
    page.keyboard.press(" ")
    expect(page.locator("#when")).to_have_text("live")
    wait_past(page, now["at_ms"])


def test_comma_and_full_stop_go_back_and_forward(page: Page) -> None:
    page.keyboard.press(",")
    page.keyboard.press(",")
    expect(page.locator("#when")).to_have_text("-2.0 s")
    page.keyboard.press(".")
    expect(page.locator("#when")).to_have_text("-1.0 s")
    expect(page.get_by_role("button", name="Live")).to_have_attribute("aria-pressed", "true")


def test_skeletons_and_cloud_are_drawn_in_3d(page: Page) -> None:
    page.locator(SPACE).scroll_into_view_if_needed()
    until(lambda: has_people(page), page)
    page.get_by_label("Depth cloud").uncheck()
    until(lambda: len(colours(page)) < 1000, page)
    page.get_by_label("Depth cloud").check()
    until(lambda: len(colours(page)) > 1000, page)


def colours(page: Page) -> set[tuple[int, ...]]:
    """Return the colours of the 3D view: red, green, blue."""
    return {tuple(one) for one in pixels(page, SPACE).reshape(-1, 3)[:, ::-1].tolist()}


def has_people(page: Page) -> bool:
    """Check that the 3D view shows every person in the person's colour."""
    script = "async (id) => (await import('/js/colours.js')).colourOf(id)"
    expected = [page.evaluate(script, n + 1).lstrip("#") for n in range(PEOPLE)]
    return {tuple(bytes.fromhex(one)) for one in expected} <= colours(page)


def test_cloud_goes_back_with_the_people(page: Page) -> None:
    page.locator(SPACE).scroll_into_view_if_needed()
    until(lambda: cloud_frame(page), page)
    wait_past(page, stored(page, "atMs") + 2500)
    before = pause(page)["frame"]
    until(lambda: cloud_frame(page) == before, page)
    page.locator("#time").fill("-2")
    frame = until(lambda: cloud_frame(page) not in ("", before) and cloud_frame(page), page)
    assert int(before) - int(frame) > 1e9
    until(lambda: stored(page, "frames") == {"front": frame}, page)


def cloud_frame(page: Page) -> str:
    """Return the frame whose depth cloud is shown, empty for none."""
    return page.locator(SPACE).get_attribute("data-cloud") or ""


# Decoding takes 0.3 s, in which newer people arrive; drawings are recorded.
SLOW = """
const frames = new Map(), boxes = new Map();
const sum = (bytes) => bytes.reduce((one, other) => (31 * one + other) % 1000003, 0);
window.drawn = [];
let real;
const property = { configurable: true, set(value) { real = value; }, get() {
  return real && new Proxy(real, { get: (pack, name) => name !== "decode" ? pack[name] : (data) => {
    const message = pack.decode(data);
    if (message.type === "image") frames.set(sum(message.jpeg), message.frame);
    if (message.type === "scene") {
      const lefts = message.boxes.map(({ box_px }) => box_px[0]);
      boxes.set(message.frame, [...(boxes.get(message.frame) ?? []), lefts]);
    }
    return message;
  } });
} };
Object.defineProperty(window, "MessagePack", property);
window.createImageBitmap = ((get) => async (blob) => {
  await new Promise((done) => setTimeout(done, 300));
  const bitmap = await get(blob);
  bitmap.frame = frames.get(sum(new Uint8Array(await blob.arrayBuffer())));
  return bitmap;
})(window.createImageBitmap);
let last = null;
const context = CanvasRenderingContext2D.prototype;
context.drawImage = ((get) => function (image, ...rest) {
  last = { frame: image.frame, scale: rest[2] / image.width, lefts: [] };
  window.drawn.push(last);
  get.call(this, image, ...rest);
})(context.drawImage);
context.clearRect = ((get) => function (...rest) { last = null; get.call(this, ...rest); })(
  context.clearRect);
context.strokeRect = ((get) => function (left, ...rest) {
  if (last) last.lefts.push(left / last.scale);
  get.call(this, left, ...rest);
})(context.strokeRect);
window.expected = (frame) => boxes.get(frame);
"""


def test_boxes_are_drawn_on_the_image_of_their_frame_under_load(open_page: Open) -> None:
    page = open_page(script=SLOW)
    until(lambda: page.evaluate("window.drawn.length") > 6, page)
    drawn = page.evaluate(
        "window.drawn.map((one) => ({ ...one, expected: window.expected(one.frame) }))"
    )
    assert max(len(one["lefts"]) for one in drawn) == PEOPLE
    for one in drawn:  # a frame is drawn twice if its image or its boxes arrived late
        assert any(one["lefts"] == pytest.approx(lefts, abs=0.1) for lefts in one["expected"])


def test_space_pauses_after_a_click_on_a_button(page: Page) -> None:
    page.locator(f"{ROW}[data-id='1']").get_by_role("button").click()
    page.keyboard.press(" ")
    expect(page.locator("#when")).to_have_text("paused")
    expect(page.locator(f"{ROW}.chosen")).to_have_count(1)


def test_browser_without_webgl_shows_a_hint_and_everything_else(open_page: Open) -> None:
    without = "HTMLCanvasElement.prototype.getContext = ((get) => function (kind, ...rest) {\
        return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest); })(\
        HTMLCanvasElement.prototype.getContext);"
    page = open_page(script=without)
    page.locator(SPACE).scroll_into_view_if_needed()
    expect(page.locator("#space-hint")).to_have_text(
        "3D needs WebGL, which this browser does not offer."
    )
    until(lambda: shows_image(page), page)
