"""Offer to open the page of the demo: in a terminal on a desktop, and nowhere else."""

import os
import pty
import sys
from pathlib import Path

import pytest

from deploy.cli.system.demo import offer


@pytest.mark.parametrize(
    ("text", "display", "opens"), [(b"\n", ":0", True), (b"n\n", ":0", False), (b"\n", "", False)]
)
def test_offer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: bytes, display: str, opens: bool
) -> None:
    page, opened = tmp_path / "report.html", list[str]()
    page.write_text("<p>")
    monkeypatch.setattr("webbrowser.open", opened.append)
    ours, theirs = pty.openpty()
    try:
        with os.fdopen(theirs) as stdin, os.fdopen(os.dup(theirs), "w") as stdout:
            monkeypatch.setattr(sys, "stdin", stdin)
            monkeypatch.setattr(sys, "stdout", stdout)
            os.write(ours, text)
            offer(page, {"DISPLAY": display})
    finally:
        os.close(ours)
    assert opened == ([page.as_uri()] if opens else [])
