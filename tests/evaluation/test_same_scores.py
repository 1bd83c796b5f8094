"""Evaluation, live score and report give the same figures for the same tracks."""

from pathlib import Path

import numpy as np
import pytest

from common.io.recording import open_recording
from evaluation.methods import read_method
from evaluation.recordings.detections import read_tracker_input
from evaluation.recordings.ground_truth import read_truth
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.run import EvaluationRun, execute
from people4d.messages import U8, Detections, Message, Score, Tally, Tracks, Truth, TruthPerson
from services.gt_bridge.build import build as build_gt_bridge
from services.gt_bridge.config import GtBridgeConfig
from services.report.config import ReportConfig
from services.report.folder import AnnotatedFrame
from services.report.node import ReportNode
from services.report.page import RunPage
from services.report.statistics import RunSummary
from tests.evaluation import builders

FRAMES = 80
RULES = (
    *("tracker.sort3d.distance_gate_floor_m=100", "tracker.sort3d.t_lost=10"),
    "tracker.publish_lost=true",
)


class SummaryOutput:
    """Output that stores the summary."""

    summary: RunSummary

    def add_frame(self, frame: AnnotatedFrame) -> None:
        pass

    def finish(self, sheet: U8, page: RunPage) -> None:
        self.summary = page.summary


def walker(name: str, frame: float, x_m: float, vy_mps: float) -> TruthPerson:
    """A person walking sideways, starting at y = -1 m."""
    return TruthPerson(
        id=name,
        position_m=np.array([x_m, -1.0 + vy_mps * frame / 10, 0.0]),
        velocity_mps=np.array([0.0, vy_mps, 0.0]),
        yaw_rad=np.pi / 2,
    )


def scene(path: Path) -> Path:
    """Two walkers read 0.1 m too near, one absent for 3 s; a ghost; a person out of view."""
    messages: list[Message] = []
    for k in range(2 * FRAMES + 1):  # truth between the frames, too
        ann, bea = walker("ann", k / 2, 2.0, 0.25), walker("bea", k / 2, 3.5, 0.2)
        eve = walker("eve", 0, 6.0, 0.0)
        stamp_ns = k * builders.STEP_NS // 2 - 20_000_000
        messages.append(
            Truth(stamp_ns=stamp_ns, sequence=k, frame_id="map", people=(ann, bea, eve))
        )
    for k in range(FRAMES):
        # The camera looks along x: left of it is +y, right in the image is -y.
        positions = [(-(-1.0 + 0.2 * k / 10), 0.0, 3.4)]
        positions += [] if 20 <= k < 50 else [(-(-1.0 + 0.25 * k / 10), 0.0, 1.9)]
        positions += [(1.5, 0.0, 4.5)] if 30 <= k < 40 else []
        messages.append(builders.detections(k, *positions))
    return builders.write(path, messages)


def live_scores(path: Path, tracks: dict[int, Tracks]) -> tuple[Tally, RunSummary]:
    """Run the bridge and the report on a recording, as if it were played now."""
    bridge = build_gt_bridge(GtBridgeConfig(truth=str(path)))
    output = SummaryOutput()
    report = ReportNode(ReportConfig(video=False), output)
    scores: list[Score] = []
    for message in read_tracker_input(path, None):
        inputs = [message]
        if isinstance(message, Detections) and message.stamp_ns in tracks:
            inputs.append(tracks[message.stamp_ns])
        for one in inputs:
            answers = bridge.handle(one, 0)
            scores += [answer for answer in answers if isinstance(answer, Score)]
            for sent in (*(a for a in answers if isinstance(a, Truth)), one):
                report.handle(sent, 0)
    (last,) = (m for _, m in list(open_recording(path).messages(Truth))[-1:])
    report.handle(last, 0)  # what the bridge would publish with the next frame
    report.close()
    return scores[-1].total, output.summary


@pytest.mark.slow
def test_every_shared_figure_is_equal_to_the_bit(tmp_path: Path) -> None:
    path = scene(tmp_path / "walk.mcap")
    recording = EvaluationRecording("walk", "walk", path)
    stamps_ns = [m.stamp_ns for _, m in open_recording(path).messages(Detections)]
    method = read_method("seg-sort", RULES)
    asked = EvaluationRun(method, recording, path, None, read_truth(recording, stamps_ns))
    output = execute(asked)
    frames = output.matching.sequence.frames
    totals = [score.totals for score in output.matching.frame_scores]
    offline = sum(totals[1:], start=totals[0]).tally(frames[-1].stamp_ns - frames[0].stamp_ns)
    live, summary = live_scores(path, output.tracks)
    assert offline.frames == FRAMES
    assert offline.id_switches > 0
    assert offline.outside > 0
    assert offline.predicted > 0
    assert offline.false_alarms > 0
    assert 0 < offline.matched < offline.truths
    assert offline.velocity_rmse_mps is not None
    assert live == offline
    assert summary.score == offline
