"""The page of a run: complete in one file, nothing loaded, foreign text escaped."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from common.drawing.topdown import Trajectories, draw_map
from services.report.page import RunPage, map_figure
from services.report.series import RunSeries
from services.report.statistics import Percentiles, RunStatistics
from services.report.svg import Bar, Line, bars, plot


class Elements(HTMLParser):
    """Elements and their attributes; fails at an end tag that closes nothing."""

    EMPTY = frozenset({"meta", "img", "path", "circle", "rect"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag


def page(tmp_path: Path, note: str = "") -> str:
    video = tmp_path / "front.webm"
    video.write_bytes(b"a video")
    series = RunSeries()
    series.add_error(0, 0.02)
    series.add_error(10**9, 0.04)
    path = np.array([[1.0, 0.0], [2.0, 0.5]])
    trajectories = Trajectories(tracks={3: path}, truth={"a": path}, cameras=[np.eye(4)])
    summary = RunStatistics().summary()
    return RunPage(summary, trajectories, series, note, {"front": video}, b"jpeg").html()


def test_page_holds_everything_and_loads_nothing(tmp_path: Path) -> None:
    text = page(tmp_path)
    elements = Elements(text)
    sources = [a[k] for _, a in elements.found for k in ("src", "href", "data") if a.get(k)]
    assert len(sources) == 3
    assert all(str(source).startswith("data:") for source in sources)
    assert base64.b64encode(b"a video").decode() in text
    assert "default-src 'none'" in text
    assert not re.search(r"<script|@import|url\(", text)
    assert "prefers-color-scheme: dark" in text
    assert "$" not in text.replace("$/", "")


def test_foreign_text_is_escaped(tmp_path: Path) -> None:
    text = page(tmp_path, "<script>alert(1)</script>")
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_page_shows_latency_as_multiple_of_inference_and_the_possible_speed() -> None:
    def stage(p50_ms: float) -> Percentiles:
        return Percentiles(p50_ms=p50_ms, p95_ms=p50_ms, p99_ms=2 * p50_ms, count=9)

    latency = {"tracker.wait": stage(90), "detector.inference": stage(25), "end_to_end": stage(60)}
    summary = msgspec.structs.replace(RunStatistics().summary(), latency=latency)
    text = RunPage(summary, Trajectories(), RunSeries()).html()
    assert "<dd>60 <small>ms, p99 120, 2.4 x inference</small>" in text
    # 1000 / 25; waiting does not limit the rate
    assert "<dd>40.0 <small>limited by detector inference</small>" in text
    lockstep = msgspec.structs.replace(summary, lockstep=True)
    assert "x inference" not in RunPage(lockstep, Trajectories(), RunSeries()).html()


def test_large_video_is_a_file_beside(tmp_path: Path) -> None:
    video = tmp_path / "people_front.webm"
    with video.open("wb") as file:
        file.truncate(25 * 2**20)
    summary = RunStatistics().summary()
    text = RunPage(summary, Trajectories(), RunSeries(), videos={"front": video}).html()
    assert 'src="people_front.webm"' in text
    assert len(text) < 2**20


def test_plot_maps_values_to_pixels() -> None:
    text = plot([Line("a", [(0, 0), (2, 5), (4, 10)], "one")], "m", "Title & more")
    assert 'd="M48.0 206.0L338.0 109.0L628.0 12.0"' in text  # 580 x 194 pixels for 4 s and 10 m
    assert "Title &amp; more [m]" in text
    assert plot([Line("a", [], "one")], "m", "t") == ""
    assert plot([Line("a", [(0, 0)], "one")], "m", "t")  # a single point has no extent


@pytest.mark.parametrize(("top", "ticks"), [(5.0, 6), (20.0, 5), (0.25, 6), (1000.0, 6)])
def test_plot_has_round_ticks(top: float, ticks: int) -> None:
    text = plot([Line("a", [(0, 0), (1, top)], "one")], "m", "t")
    assert text.count('text-anchor="end"') == ticks
    assert f">{top:g}</text>" in text


def test_bars_end_at_the_median() -> None:
    text = bars([Bar("a.b", 5.0, 8.0, 10.0), Bar("c<d", 0.0, 0.0, 0.1)], "ms", "t")
    Elements(text)
    first = re.search(r'<rect class="bar" x="([\d.]+)" y="4" width="([\d.]+)"', text)
    assert first
    left = float(first[1])
    assert float(first[2]) == pytest.approx((640 - left - 12 - 52) / 2, abs=0.1)
    assert "c&lt;d" in text
    assert bars([], "ms", "t") == ""


def test_map_of_the_page_equals_the_drawn_map() -> None:
    path = np.array([[0.0, 0.0], [4.0, 1.0]])
    text = map_figure(Trajectories(tracks={1: path}))
    data = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    assert data
    image = np.asarray(
        cv2.imdecode(np.frombuffer(base64.b64decode(data[1]), np.uint8), cv2.IMREAD_COLOR_RGB)
    )
    assert np.array_equal(image, draw_map(Trajectories(tracks={1: path}), *image.shape[:2]))
    assert map_figure(Trajectories()) == ""
