"""Offer to open the page of the demo: in a terminal on a desktop, and nowhere else."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

WAIT_S = 60.0
CODE = "import sys; from pathlib import Path; from deploy.cli.system.demo import offer; "
CODE += "offer(Path(sys.argv[1]))"

pytestmark = pytest.mark.processes


def answer(folder: Path, text: bytes, display: str) -> str:
    """Run the offer in a terminal, answer it, and return what the browser was given."""
    page, opened, browser = folder / "report.html", folder / "opened", folder / "browser"
    page.write_text("<p>")
    browser.write_text(f'#!/bin/sh\nprintf "%s" "$1" > {opened}\n')
    browser.chmod(0o755)
    environment = os.environ | {"BROWSER": f"{browser} %s", "DISPLAY": display}
    environment.pop("WAYLAND_DISPLAY", None)
    ours, theirs = pty.openpty()
    try:
        with subprocess.Popen(
            [sys.executable, "-c", CODE, str(page)], env=environment, stdin=theirs, stdout=theirs
        ) as process:
            os.write(ours, text)
            assert process.wait(WAIT_S) == 0
    finally:
        os.close(ours)
        os.close(theirs)
    return opened.read_text() if opened.exists() else ""


@pytest.mark.parametrize(
    ("text", "display", "opens"),
    [(b"\n", ":0", True), (b"n\n", ":0", False), (b"\n", "", False)],
)
def test_offer(tmp_path: Path, text: bytes, display: str, opens: bool) -> None:
    url = (tmp_path / "report.html").as_uri() if opens else ""
    assert answer(tmp_path, text, display) == url
