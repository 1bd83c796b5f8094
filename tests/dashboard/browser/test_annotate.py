"""The annotation page in Chromium, on the shipped recording of simulated people."""

import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from common.geometry.transforms import apply, invert, project
from common.io.recording import open_recording
from evaluation.annotations.agreement import agreement
from evaluation.annotations.images import AnnotatedImages, read_images
from evaluation.annotations.marks import read_annotations
from evaluation.annotations.truth import annotated_truth
from evaluation.annotations.web import AnnotationApp
from people4d.messages import CompressedRgbdFrame, StaticTransform, Truth
from services.camera.config import CameraConfig
from services.dashboard.config import DashboardConfig
from services.dashboard.server import WebServer
from tests import DEMO, ROOT
from tests.dashboard.browser.chromium import MARKS, WAIT_S, until
from tests.dashboard.browser.test_layout import PHONE_PX, faults

pytestmark = MARKS

CAMERA = CameraConfig(source=str(DEMO))
EVERY, FRAMES = 13, 10
IMAGE = "#image"


@pytest.fixture(scope="module")
def images() -> AnnotatedImages:
    return read_images(CAMERA, EVERY, lambda _: None)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "annotations.json"


@contextmanager
def served(images: AnnotatedImages, file: Path) -> Iterator[str]:
    """Serve the page; yield its address."""
    app, config = AnnotationApp("recording", images, file), DashboardConfig(port=0)
    server = WebServer(config, lambda tokens: app.guarded(config, tokens))
    yield server.address.url
    server.close()


@pytest.fixture
def url(images: AnnotatedImages, file: Path) -> Iterator[str]:
    """Address of a page that annotates the recording."""
    with served(images, file) as url:
        yield url


def open_page(browser: Browser, url: str, width: int = 1280) -> Page:
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="light")
    page.set_default_timeout(WAIT_S * 1000)
    page.goto(url)
    expect(page.locator("#saved")).not_to_have_text("loading …")
    return page


def add(page: Page, name: str) -> None:
    page.keyboard.press("n")
    page.get_by_label("New person").fill(name)
    page.keyboard.press("Enter")
    expect(page.locator("#people")).to_contain_text(name)


def click(page: Page, u_px: float, v_px: float, width_px: int) -> None:
    scale = page.locator(IMAGE).evaluate("(canvas) => canvas.clientWidth") / width_px
    page.locator(IMAGE).click(position={"x": u_px * scale, "y": v_px * scale})


def frame_is(page: Page, frame: int) -> None:
    expect(page.locator(IMAGE)).to_have_attribute("data-frame", str(frame))


def torsos(images: AnnotatedImages) -> dict[int, dict[str, tuple[float, float, float, float]]]:
    """Return u, v [px] and x, y [m] of the people with a clear view of the torso, by frame."""
    recorded = [message for _, message in open_recording(DEMO).messages()]
    pose = next(m for m in recorded if isinstance(m, StaticTransform))
    truths = [message for message in recorded if isinstance(message, Truth)]
    found = {}
    for frame, image in images.images.items():
        truth = min(truths, key=lambda one: abs(one.stamp_ns - image.stamp_ns))
        found[frame] = dict[str, tuple[float, float, float, float]]()
        for person in truth.people:
            point_m = np.asarray(apply(invert(pose.matrix), person.position_m))
            ((u, v),) = project(point_m, images.info)
            depth_m = images.depth_mm(frame)[round(v), round(u)] / 1000 if 0 <= u < 640 else 0
            if abs(depth_m - point_m[2]) < 0.2:
                found[frame][person.id] = u, v, *person.position_m[:2].tolist()
    return found


def test_ten_annotated_frames_are_ground_truth_for_evaluation(
    browser: Browser, url: str, file: Path, images: AnnotatedImages
) -> None:
    """The torsos of the simulation are clicked; positions agree with the simulation's."""
    page, visible = open_page(browser, url), torsos(images)
    frames = list(images.images)[:FRAMES]
    people = sorted({person for frame in frames for person in visible[frame]})
    assert sum(map(len, (visible[frame] for frame in frames))) > FRAMES
    for frame in frames:
        frame_is(page, frame)
        for person, (u, v, _, _) in visible[frame].items():
            if f"person {person}" in page.locator("#people").inner_text():
                page.locator("#people button", has_text=f"person {person}").click()
            else:
                add(page, f"person {person}")
            click(page, u, v, images.info.width)
            expect(page.locator("#people button[aria-pressed='true']")).to_contain_text(" m")
        page.keyboard.press(".")
    frame_is(page, list(images.images)[FRAMES])
    page.close()
    messages = [message for _, message in open_recording(DEMO).messages()]
    stamps_ns = [m.stamp_ns for m in messages if isinstance(m, CompressedRgbdFrame)]
    truth = annotated_truth(file, CAMERA, messages, stamps_ns, "map")
    assert set(truth.ids) == {f"person {person}" for person in people}
    assert sum(frame is not None for frame in truth.frames) == FRAMES
    for frame in frames:
        known = truth.frames[frame]
        assert known is not None
        for one in known.people:
            if one.id in known.captured and (at := visible[frame].get(one.id.split()[1])):
                assert np.linalg.norm(one.position_m[:2] - at[2:]) < 0.15


def test_ten_frames_of_real_people_agree_with_their_annotations(
    browser: Browser, shared: Path, file: Path
) -> None:
    """Two annotators of felix: here the points of the first frame are kept by the keyboard."""
    folder = shared / "data" / "rgbd" / "felix"
    options = {"calibration": str(folder / "cam_params_realsense.json")}
    camera = CameraConfig(source=str(folder), options=options)
    images = read_images(camera, 4, lambda _: None)
    other = ROOT / "benchmarks" / "real_people_marks" / "felix.json"
    with served(images, file) as url:
        page = open_page(browser, url)
        for mark, facing in zip(read_annotations(other).frames[0], ("s", "a"), strict=True):
            add(page, mark.person)
            click(page, mark.u_px, mark.v_px, images.info.width)
            page.keyboard.press(facing)
        for frame in list(images.images)[1:]:
            page.keyboard.press(".")
            frame_is(page, frame)
            page.keyboard.press("1")
            page.keyboard.press("2")
            expect(page.locator("#people .absent")).to_have_count(0)
        expect(page.locator("#saved")).to_have_text("saved")
        page.close()
    found = agreement(camera, file, other)
    assert (found.frames, found.pairs, found.same_identity) == (FRAMES, 2 * FRAMES, 2 * FRAMES)
    assert np.median(found.distances_m) < 0.05
    assert sorted(found.differences_deg) == [0.0] * FRAMES + [105.0] * FRAMES


def test_marks_are_made_by_keyboard_saved_at_once_and_resumed(
    browser: Browser, url: str, file: Path
) -> None:
    page = open_page(browser, url)
    add(page, "anna")  # in the middle of the image
    for key in ("ArrowLeft", "Shift+ArrowUp", "w", "q", "q", "h"):
        page.keyboard.press(key)
    page.keyboard.press(".")  # second image: empty
    frame_is(page, EVERY)
    page.keyboard.press(".")
    frame_is(page, 2 * EVERY)
    page.keyboard.press("1")  # at the last point, with the last facing
    page.keyboard.press("e")
    expect(page.locator("#degrees")).to_have_text("15°")
    expect(page.locator("#saved")).to_have_text("saved")
    page.close()
    marks = read_annotations(file).frames
    assert [(frame, len(people)) for frame, people in marks.items()] == [(0, 1), (13, 0), (26, 1)]
    anna = marks[0][0]
    assert (anna.person, anna.u_px, anna.v_px) == ("anna", 319, 230)
    assert (anna.yaw_deg, anna.hidden) == (30, "partly")
    assert (marks[26][0].u_px, marks[26][0].yaw_deg) == (319, 15)
    page = open_page(browser, url)  # resumes at the first image without annotation
    frame_is(page, 3 * EVERY)
    page.keyboard.press(",")
    frame_is(page, 2 * EVERY)
    page.keyboard.press("Delete")
    expect(page.locator("#people button")).to_contain_text("absent")
    expect(page.locator("#saved")).to_have_text("saved")
    assert read_annotations(file).frames[26] == ()
    page.close()


def test_change_of_an_image_that_another_page_changed_is_refused(
    browser: Browser, url: str, file: Path
) -> None:
    first, second = open_page(browser, url), open_page(browser, url)
    add(first, "anna")
    expect(first.locator("#saved")).to_have_text("saved")
    add(second, "bo")
    expect(second.locator("#problem")).to_contain_text("Another page changed this frame")
    expect(second.locator("#people")).to_contain_text("anna")
    assert [mark.person for mark in read_annotations(file).frames[0]] == ["anna"]
    second.locator("#people button", has_text="bo").click()
    expect(second.locator("#saved")).to_have_text("saved")
    assert [mark.person for mark in read_annotations(file).frames[0]] == ["anna", "bo"]
    first.close()
    second.close()


def test_point_without_depth_has_a_remedy(
    browser: Browser, url: str, images: AnnotatedImages
) -> None:
    inside = images.depth_mm(0)[20:-20, 20:-20]  # the corners of the image are round
    v, u = np.argwhere(cv2.dilate(inside, np.ones((5, 5))) == 0)[0] + 20
    page = open_page(browser, url)
    add(page, "anna")
    click(page, float(u), float(v), images.info.width)
    expect(page.locator("#problem")).to_contain_text("No depth at the point of anna: move it")
    page.close()


def test_pages_of_desktop_and_telephone_have_no_serious_fault(browser: Browser, url: str) -> None:
    page = open_page(browser, url)
    add(page, "anna")
    until(lambda: page.locator("#saved").inner_text() == "saved", page)
    for width in (1280, PHONE_PX):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert (width, faults(page)) == (width, [])
    page.close()


def test_hostile_requests_are_refused(url: str, file: Path) -> None:
    httpx2 = pytest.importorskip("httpx2")
    anna = {"person": "anna", "u_px": 5, "v_px": 5, "yaw_deg": None}
    own = {"origin": url.rstrip("/")}
    for body, headers, status, text in (
        ({"base": None, "people": [anna | {"u_px": 640}]}, own, 400, "outside the image"),
        ({"base": None, "people": [anna, anna]}, own, 400, "two marks of one person"),
        ({"base": None, "people": [anna | {"yaw_deg": 270}]}, own, 400, "<= 180"),
        ({"base": None, "people": [anna]}, {"origin": "http://evil.org"}, 403, "another site"),
        ({"base": None, "people": [anna]}, own | {"host": "evil.org"}, 421, "Host"),
    ):
        data = msgspec.json.encode(body)
        answer = httpx2.put(f"{url}frames/0", content=data, headers=headers)
        assert (answer.status_code, text in answer.text) == (status, True), answer.text
    assert httpx2.get(f"{url}frames/1").status_code == 404
    assert not file.exists()


def test_command_serves_the_page_until_interrupted(file: Path) -> None:
    command = [sys.executable, "-m", "deploy.cli", "annotate", str(DEMO), "--every", "60"]
    with subprocess.Popen(
        [*command, "--port", "0", "--out", str(file)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        line = next(line for line in process.stdout if "http://" in line)
        with urllib.request.urlopen(f"{line.split()[2]}frames") as answer:
            about = msgspec.json.decode(answer.read())
        assert (about["frames"], about["file"]) == ([0, 60, 120], str(file))
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 0
