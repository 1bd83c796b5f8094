"""Anonymised recordings: heads of the demo are black, everything else stays."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from common.io.images import compress, decompress
from common.io.recording import RecordingWriter, open_recording
from deploy.anonymise.colourless import without_colour
from deploy.cli import app
from people4d.messages import CompressedRgbdFrame, Crops, Message, RgbdFrame
from people4d.messages.people import Crop
from tests import DEMO, builders
from tests.contract.examples import BY_NAME

RGB = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)


def frames(path: Path) -> list[RgbdFrame]:
    return [
        decompress(message)
        for _, message in open_recording(path).messages(CompressedRgbdFrame)
        if isinstance(message, CompressedRgbdFrame)
    ]


@pytest.mark.slow
def test_heads_are_black_and_the_rest_stays(tmp_path: Path) -> None:
    part, target = tmp_path / "part.mcap", tmp_path / "covered.mcap"
    cut = ["cut", str(DEMO), str(part), "--start", "4", "--end", "4.3"]
    assert CliRunner().invoke(app, cut).exit_code == 0
    result = CliRunner().invoke(app, ["anonymise", str(part), str(target)])
    assert result.exit_code == 0, result.output
    before, after = frames(part), frames(target)
    assert len(before) == len(after) > 3
    for old, new in zip(before, after, strict=True):
        black = new.rgb.max(axis=2) < 12
        assert 0.005 < black.mean() < 0.35
        assert (old.depth_mm == new.depth_mm).all()
        rest = ~black
        assert np.abs(old.rgb[rest].astype(int) - new.rgb[rest]).mean() < 4
    assert open_recording(target).metadata == open_recording(part).metadata
    again = CliRunner().invoke(app, ["anonymise", str(part), str(target)])
    assert "exists" in again.stderr


def test_no_colour_leaves_depth_and_people(tmp_path: Path) -> None:
    source, target = tmp_path / "x.mcap", tmp_path / "grey.mcap"
    frame = builders.rgbd_frame(rgb=RGB, depth_mm=np.full((48, 64), 900, np.uint16))
    crops = Crops(stamp_ns=0, sequence=0, camera="front", crops=(Crop(detection=0, rgb=RGB),))
    with RecordingWriter(source) as writer:
        for message in (frame, crops, BY_NAME["Embeddings"], builders.tracks()):
            writer.write(message, 0)
    result = CliRunner().invoke(app, ["anonymise", str(source), str(target), "--no-colour"])
    assert "left out: 2 messages" in result.output
    (grey,) = frames(target)
    assert np.ptp(grey.rgb) == 0
    assert (grey.depth_mm == 900).all()
    assert open_recording(target).summary.topics.keys() == {"people", "raw/front/compressed"}


def test_messages_without_colour() -> None:
    frame = builders.rgbd_frame(rgb=RGB, depth_mm=np.zeros((48, 64), np.uint16))
    shown: list[Message | None] = [without_colour(frame), without_colour(compress(frame))]
    assert isinstance(shown[0], RgbdFrame)
    assert np.ptp(shown[0].rgb) == 0
    assert isinstance(shown[1], CompressedRgbdFrame)
    assert np.ptp(decompress(shown[1]).rgb) == 0
    assert without_colour(BY_NAME["Crops"]) is None
    tracks = builders.tracks()
    assert without_colour(tracks) is tracks
