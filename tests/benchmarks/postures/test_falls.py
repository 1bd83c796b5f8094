"""True falls and events are matched in time; detections are given relative to the image."""

import numpy as np
import pytest

from benchmarks.lib.postures.falls import match_falls, rows_of
from benchmarks.lib.postures.run import Frame
from people4d.messages import Detection, Detections


def test_event_within_the_window_finds_its_fall_and_others_are_false() -> None:
    """Falls end at 5 and 20 s; 6.5 s is late for the first, 40 s is near no fall."""
    assert match_falls([5.0, 20.0], [6.5, 19.5, 40.0], late_s=1.0) == (1, 2)
    assert match_falls([5.0, 20.0], [6.5, 19.5, 40.0], late_s=3.0) == (2, 1)


def test_two_events_of_one_fall_count_once() -> None:
    assert match_falls([5.0], [5.2, 5.6], late_s=1.0) == (1, 0)


def test_rows_are_relative_to_the_image() -> None:
    """The middle of 640x480 is 0.5; the box ends at the right edge."""
    joints = np.tile(np.array([320.0, 240.0, 0.9], np.float32), (17, 1))
    box = np.array([320.0, 120.0, 700.0, 360.0], np.float32)
    detection = Detection(box_xyxy_px=box, score=0.9, keypoints=joints)
    found = Detections(
        stamp_ns=0,
        sequence=0,
        camera="camera",
        frame_id="optical",
        model="m",
        width=640,
        height=480,
        detections=(detection,),
    )
    (row,) = rows_of([Frame(1.5, found, (), [], [], [])])
    assert row[:5] == pytest.approx([1.5, 0.5, 0.25, 1.0, 0.75])
    assert row[5:].reshape(17, 3) == pytest.approx(np.tile([0.5, 0.5, 0.9], (17, 1)))
