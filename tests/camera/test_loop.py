"""Length of a round of a looping source."""

import pytest

from services.camera.config import CameraConfig
from services.camera.playback import loop_period_s, play
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from tests import ROOT

DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"


def test_the_period_is_what_a_looping_camera_adds_to_its_stamps() -> None:
    # 135 frames at 15 Hz last 8.933333333 s; 66 666 666 ns more begin the next round.
    assert loop_period_s(str(DEMO)) == pytest.approx(8.999999999, abs=1e-12)


@pytest.mark.slow
def test_the_period_is_that_of_the_frames_played() -> None:
    source = open_source(str(DEMO), options={"depth_sensor": "off"})
    frames = (
        item for item in play(source, CameraConfig(loop=True)) if isinstance(item, SourceFrame)
    )
    stamps_ns = [next(frames).stamp_ns for _ in range(136)]
    assert stamps_ns[135] - stamps_ns[0] == round(loop_period_s(str(DEMO)) * 1e9)


def test_a_camera_does_not_end() -> None:
    assert loop_period_s("my.camera:Camera") == 0.0
