"""Cells of the scoreboard, and its units of boxes in images."""

import numpy as np
import pytest

from benchmarks.lib.odometry.rides import Ride
from benchmarks.lib.peers.boxes import track
from benchmarks.lib.peers.run import PeerRun
from benchmarks.scoreboard import COLUMNS, Column, sections
from common.metrics.record import GroundTruth
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.image_sort import BoxFrame

SHARE = Column("found %", "recall", factor=100, high=100)
BOX = np.array([[10.0, 10.0, 50.0, 110.0]])


@pytest.mark.parametrize(
    ("interval", "expected"),
    [
        (None, "-"),
        ((0.5, 0.25, 0.75), "50.0 [25.0, 75.0]"),
        ((0.95, 0.85, 1.05), "95.0 [85.0, 100.0]"),
        ((1.0, np.nan, np.nan), "100.0"),
    ],
)
def test_cell_has_its_interval_within_the_possible_values(
    interval: tuple[float, float, float] | None, expected: str
) -> None:
    assert SHARE.cell(interval) == expected


def test_speed_has_no_interval() -> None:
    (rate,) = (column for column in COLUMNS if column.key == "rate_hz")
    assert rate.cell((800.0, 700.0, 900.0)) == "800"


def test_figures_of_some_units_leave_out_the_frames_of_others() -> None:
    """A person stands for 4 s at 10 Hz, and the detector misses the second half: units of 2 s."""
    frames = [
        BoxFrame(k * 100_000_000, BOX[: int(k < 20)], np.ones(int(k < 20))) for k in range(40)
    ]
    truth = (GroundTruth(ids=(1,), boxes_xyxy_px=BOX),) * 40
    tracked = track(ImageSortConfig(), [Ride("stands", tuple(frames), truth, (), 60.0)])
    assert [frames for _, frames in tracked.blocks] == [list(range(20)), list(range(20, 40))]
    first, second = (tracked.row([unit])["recall"] for unit in (0, 1))
    assert first == pytest.approx(1.0, abs=0.15)  # SORT publishes from the third match on
    assert second == 0.0
    assert tracked.row([0, 1])["recall"] == pytest.approx((first or 0) / 2)


def test_own_settings_of_another_package_are_named_so() -> None:
    run = PeerRun("2.6.1: gate 0.0", {}, {})
    assert (run.words(0), run.words(3)) == ("2.6.1: own settings", "2.6.1: gate 0.0")


def test_table_of_an_input_has_no_column_without_figures() -> None:
    empty = ["-"] * (len(COLUMNS) - 1)
    lines = [["a", "one", "4", "1.0", *empty], ["a", "two", "4", "-", *empty]]
    heading, table, other, last = sections([*lines, ["b", "three", "2", *empty, "9"]])
    assert (heading, table.splitlines()[0]) == ("## a", "| method | units | found % |")
    assert (other, last.splitlines()[0]) == ("## b", "| method | units | frames/s |")
