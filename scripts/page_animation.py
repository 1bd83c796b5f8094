"""Record the animation of the page in the README, and the pictures of the documentation.

    python -m scripts.page_animation   # docs/pictures/page.webp, page-dark.jpg, page-phone.jpg

The system runs on the shipped recording (simulated people) at a fifth of its rate in Chromium; the
animation has the recorded rate. It requires the development tools and Chromium.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, ViewportSize, sync_playwright

from common.transport.ports import free_port
from people4d.messages import U8

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "pictures"
DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"
SIZE_PX = ViewportSize(width=1280, height=800)
PHONE_PX = ViewportSize(width=390, height=1400)
WIDTH_PX = 960  # [px] width of the animation
SPEED = 0.2  # playback speed of the recording
FRAME_S = 0.75  # [s] period of pictures
WAIT_MS = 60_000
SETTLE_MS = 9000  # [ms] time for trajectories and latencies
FLAGS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage")


@contextmanager
def system() -> Iterator[str]:
    """Run the system until the block ends; yield the address of its page."""
    with tempfile.TemporaryDirectory(prefix="p4d") as state:
        environment = {**os.environ, "PEOPLE4D_STATE": state, "OMP_NUM_THREADS": "1"}
        cli, page_port = [sys.executable, "-m", "deploy.cli"], free_port()
        options = ["--source", str(DEMO), "--loop", "--dashboard", "--skeletons", "--predict"]
        ports = ["--port", str(free_port()), "--set", f"dashboard.port={page_port}"]
        ports += ["--set", f"camera.speed={SPEED}"]
        subprocess.run([*cli, "up", *options, *ports, "--detach"], env=environment, check=True)
        try:
            yield f"http://127.0.0.1:{page_port}/"
        finally:
            subprocess.run([*cli, "down"], env=environment, check=True)


def shown(page: Page) -> U8:
    """Return the pixels of a page (HxWx3, blue first)."""
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(image, np.uint8)


def prepare(page: Page, url: str) -> None:
    """Open the page, wait until it shows people, and select one."""
    page.set_default_timeout(WAIT_MS)
    page.goto(url)
    page.locator("#table tbody tr").first.wait_for()
    page.wait_for_timeout(SETTLE_MS)
    page.keyboard.press("n")


def animate(page: Page, seconds: float) -> cv2.Animation:
    """Return an animation of a time of the recording [s]."""
    animation = cv2.Animation()
    frames, durations_ms = [], []
    end_s = time.monotonic() + seconds / SPEED
    while (begin_s := time.monotonic()) < end_s:
        image = shown(page)
        height = image.shape[0] * WIDTH_PX // image.shape[1]
        frames.append(cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA))
        page.wait_for_timeout(max(0.0, 1000 * (FRAME_S - (time.monotonic() - begin_s))))
        durations_ms.append(round(SPEED * 1000 * (time.monotonic() - begin_s)))
    animation.frames, animation.durations = frames, durations_ms
    return animation


def main() -> None:
    """Record the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=4.5)
    parser.add_argument("--quality", type=int, default=45)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    options = parser.parse_args()
    with system() as url, sync_playwright() as playwright:
        path = shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        page = browser.new_page(viewport=SIZE_PX, color_scheme="light")
        prepare(page, url)
        animation = animate(page, options.seconds)
        page.close()
        for name, size in (("dark", SIZE_PX), ("phone", PHONE_PX)):
            page = browser.new_page(viewport=size, color_scheme="dark")
            prepare(page, url)
            quality = [cv2.IMWRITE_JPEG_QUALITY, 80]
            cv2.imwrite(str(options.folder / f"page-{name}.jpg"), shown(page), quality)
            page.close()
        browser.close()
    file = options.folder / "page.webp"
    cv2.imwriteanimation(str(file), animation, [cv2.IMWRITE_WEBP_QUALITY, options.quality])
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB, {len(animation.frames)} frames")


if __name__ == "__main__":
    main()
