"""Live scores of tracks: equal to numbers by hand and to the metrics of the whole."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import transform_from
from common.metrics.live import MAX_WAITING, LiveScorer
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import score
from common.metrics.similarity import GroundDistance
from people4d.messages import Message, MovingTransform, Odometry, Score, Tracks, Truth, TruthPerson
from services.gt_bridge.alignment import EstimatedAlignment
from services.gt_bridge.config import GtBridgeConfig
from tests import builders
from tests.gt_bridge.scene import INFO, MS, POSE, person, track, tracks, truth


class Bench:
    """A scorer with its camera, fed in any order."""

    def __init__(self, camera: bool = True, **settings: Any) -> None:
        self.counters: Counter[str] = Counter()
        self.frames = TransformBuffer()
        config = GtBridgeConfig(**settings)
        alignment = EstimatedAlignment(config, self.frames) if settings else None
        self.scorer = LiveScorer(self.frames, self.counters, config.gate_m, alignment)
        if camera:
            self.frames.add_transform(POSE)
            self.scorer.views.add_camera(INFO)

    def feed(self, messages: Iterable[Message]) -> list[Score]:
        scores = []
        for message in messages:
            if isinstance(message, Truth):
                self.scorer.add_truth(message)
            elif isinstance(message, Tracks):
                self.scorer.add_tracks(message)
            scores += self.scorer.due()
        return scores


def still(*people: TruthPerson) -> list[Truth]:
    """The same truth every 100 ms for half a second."""
    return [truth(ms, *people) for ms in range(0, 501, 100)]


def test_three_frames_by_hand() -> None:
    a, b = person("a", 2.0, 0.0, vx=0.0, yaw_deg=170), person("b", 3.0, 1.5)
    first, second, third = Bench().feed(
        [
            *still(a, b),
            # a: 0.3 and 0.4 m off are 0.5 m; 0.6 m/s off; 170 to -170 is 20 degrees.
            tracks(0, track(1, 2.3, 0.4, vx=0.6, yaw_deg=-170), track(2, 3.0, 1.5)),
            tracks(100, track(1, 2.0, 0.0, yaw_deg=170), track(9, 4.0, -2.0)),  # b is missed
            tracks(200, track(7, 2.0, 0.0), track(2, 3.3, 1.5, lost=True)),  # a is now 7
        ]
    )
    one, other = first.people
    assert (one.id, one.track, one.view, one.switched) == ("a", 1, "inside", False)
    assert one.position_error_m == pytest.approx([0.3, 0.4])
    assert one.velocity_error_mps == pytest.approx([0.6, 0.0])
    assert one.yaw_error_rad == pytest.approx(math.radians(20))
    assert other.velocity_error_mps is None  # the truth of b knows neither
    assert other.yaw_error_rad is None
    assert second.people[1].track is None
    assert second.false_alarms == (9,)
    assert (third.people[0].switched, third.people[1].predicted) == (True, True)
    assert third.people[0].consistency == pytest.approx(2 / 3)  # 1, 1, 7
    assert third.id_consistency == pytest.approx(4 / 5)  # and 2, 2 of b

    total = third.total
    assert (total.frames, total.duration_s) == (3, 0.2)
    assert (total.truths, total.matched, total.predicted) == (6, 5, 1)
    assert (total.outside, total.false_alarms, total.id_switches) == (0, 1, 1)
    assert total.position_rmse_m == pytest.approx(math.sqrt((0.25 + 0.09) / 5))
    assert total.velocity_rmse_mps == pytest.approx(math.sqrt(0.36 / 3))  # of a's three matches
    assert total.yaw_rmse_rad == pytest.approx(math.radians(20) / math.sqrt(2))  # 20 and 0
    assert total.yaw_correlation == pytest.approx((math.cos(math.radians(20)) + 1) / 2)
    assert third.recent == total


def test_a_person_out_of_view_is_marked_and_no_miss() -> None:
    far, behind, here = person("far", 5.5, 0.0), person("behind", -2.0, 0.0), person("a", 2.0, 0.0)
    (got,) = Bench().feed([*still(far, behind, here), tracks(0, track(3, 5.4, 0.0))])
    assert [(p.id, p.view) for p in got.people] == [
        ("far", "outside"),
        ("behind", "outside"),
        ("a", "inside"),
    ]
    assert got.people[0].track == 3  # recognised, but neither match nor false alarm
    assert got.people[0].position_error_m is None
    assert got.false_alarms == ()
    assert (got.total.truths, got.total.matched, got.total.outside) == (1, 0, 2)


def test_the_view_is_that_of_a_robot_where_it_is_by_then() -> None:
    # The robot drives 1 m/s along x and turns left by 90 degrees within the second second. Ahead
    # of the start: at first 2 m off, later behind its back. To the left: in view after the turn.
    bench = Bench(camera=False)
    bench.frames.add_transform(
        msgspec.structs.replace(POSE, parent="base_link", matrix=POSE.matrix)
    )
    bench.scorer.views.add_camera(INFO)
    for ms in range(0, 2001, 20):
        bench.frames.add_transform(drive(ms, ms / 1000, math.radians(max(ms - 1000, 0) * 0.09)))
    ahead, left = person("ahead", 2.0, 0.0), person("left", 2.0, 3.0)
    scores = bench.feed(
        [
            *(truth(ms, ahead, left) for ms in range(0, 2001, 100)),
            *(tracks(ms) for ms in (10, 1950)),
        ]
    )
    assert [[p.view for p in score.people] for score in scores] == [
        ["inside", "outside"],  # 2 m ahead; 56 degrees to the left
        ["outside", "inside"],  # the robot is at x = 1.95 and looks 85 degrees to the left
    ]
    assert scores[-1].total.outside == 2


def test_truth_is_brought_to_a_frame_that_moves() -> None:
    # Tracks are in odom, which localisation puts 1 m farther ahead in the map each second.
    bench = Bench(camera=False)
    for ms in (0, 1000):
        matrix = transform_from((ms / 1000, 0, 0), np.eye(3))
        bench.frames.add_transform(
            MovingTransform(stamp_ns=ms * MS, sequence=0, parent="map", child="odom", matrix=matrix)
        )
    (got,) = bench.feed(
        [
            *(truth(ms, person("a", 2.0, 0.0)) for ms in range(0, 1001, 100)),
            tracks(500, track(1, 1.6, 0.0), frame_id="odom"),
        ]
    )
    # At 500 ms x = 2 of the map is 1.5 of odom.
    assert got.people[0].position_error_m == pytest.approx([0.1, 0.0])


def drive(ms: int, x_m: float, theta_rad: float) -> Odometry:
    return builders.odometry(stamp_ns=ms * MS, frame_id="map", x_m=x_m, theta_rad=theta_rad)


def test_without_a_camera_everyone_counts_and_the_score_says_so() -> None:
    (got,) = Bench(camera=False).feed([*still(person("behind", -2.0, 0.0)), tracks(0)])
    assert got.people[0].view == "unknown"
    assert (got.total.truths, got.total.matched, got.total.outside) == (1, 0, 0)


def test_truth_is_interpolated_to_the_stamp_of_the_tracks() -> None:
    # 1 m/s from x = 2: at 30 ms at 2.03, where the track is; yaw half-way through 180.
    walk = [truth(0, person("a", 2.0, 0.0, 1.0, 170)), truth(60, person("a", 2.06, 0.0, 1.0, -170))]
    (got,) = Bench().feed([*walk, tracks(30, track(1, 2.03, 0.0, vx=1.0, yaw_deg=180))])
    assert got.people[0].position_error_m == pytest.approx([0.0, 0.0])
    assert got.people[0].yaw_error_rad == pytest.approx(0.0)


def walks(seed: int) -> tuple[list[Truth], list[Tracks]]:
    """Three people on random walks, with truth at 100 Hz and tracks that err, miss and swap."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform((1.0, -2.0), (3.0, 2.0), (3, 2)), rng.uniform(-0.8, 0.8, (3, 2))
    truths, tracked = [], []
    for ms in range(0, 4001, 10):
        people = [
            TruthPerson(
                id=f"p{k}",
                position_m=np.array([*(start[k] + speed[k] * ms / 1000), 1.0]),
                velocity_mps=np.array([*speed[k], 0.0]),
                yaw_rad=float(np.pi - 0.001 * ms),
            )
            for k in range(3)
        ]
        truths.append(truth(ms, *people))
        if ms % 30 == 0:
            found = [
                track(
                    k + 1 + 10 * (ms // 1500),  # another identity every 1.5 s
                    float(p.position_m[0] + rng.normal(0, 0.1)),
                    float(p.position_m[1] + rng.normal(0, 0.1)),
                    vx=float(rng.normal(0, 0.2)),
                    yaw_deg=float(rng.uniform(-180, 180)),
                    lost=bool(rng.random() < 0.2),
                )
                for k, p in enumerate(people)
                if rng.random() < 0.8
            ]
            found += [track(99, 4.0, 0.0)] * (ms % 300 == 0)  # a false alarm
            tracked.append(tracks(ms, *found))
    return truths, tracked


def as_sequence(truths: Sequence[Truth], tracked: Sequence[Tracks]) -> EvaluationSequence:
    """The same as one sequence for `common.metrics`."""
    at = {message.stamp_ns: message for message in truths}
    frames = []
    for message in tracked:
        people, found = at[message.stamp_ns].people, message.tracks
        positions = np.array([p.position_m for p in people])
        # 45 degrees to either side, up to 5 m: written out for this camera.
        outside = (positions[:, 0] > 5) | (np.abs(positions[:, 1]) > 0.995 * positions[:, 0])
        frames.append(
            EvaluationFrame(
                stamp_ns=message.stamp_ns,
                truth=GroundTruth(
                    ids=tuple(p.id for p in people),
                    positions_m=positions,
                    velocities_mps=np.array([p.velocity_mps for p in people]),
                    yaws_rad=np.array([p.yaw_rad for p in people]),
                    out_of_view=outside,
                ),
                hypotheses=Hypotheses(
                    ids=tuple(t.id for t in found),
                    positions_m=np.array([t.position_m for t in found]).reshape(-1, 3),
                    velocities_mps=np.array([t.velocity_mps for t in found]).reshape(-1, 3),
                    yaws_rad=np.array([t.yaw_rad for t in found], np.float64),
                ),
            )
        )
    return EvaluationSequence("walks", tuple(frames))


@pytest.mark.parametrize("seed", range(3))
def test_live_totals_equal_the_offline_metrics(seed: int) -> None:
    truths, tracked = walks(seed)
    total = Bench().feed([*truths, *tracked[:60], *tracked[60:]])[-1].total
    want = score(as_sequence(truths, tracked), GroundDistance(1.0))
    assert total.frames == len(tracked)
    assert total.outside > 0
    assert total.false_alarms > 0
    assert total.truths == want.clear.truths
    assert total.matched == want.clear.matches
    assert total.false_alarms == want.clear.false_alarms
    assert total.id_switches == want.clear.id_switches > 0
    row = want.row()
    squares = [row["position_rmse_x_m"], row["position_rmse_y_m"]]
    assert total.position_rmse_m == pytest.approx(math.hypot(*(x or 0 for x in squares)))
    squares = [row["velocity_rmse_x_mps"], row["velocity_rmse_y_mps"]]
    assert total.velocity_rmse_mps == pytest.approx(math.hypot(*(x or 0 for x in squares)))
    assert math.degrees(total.yaw_rmse_rad or 0) == pytest.approx(row["yaw_rmse_deg"])
    assert total.yaw_correlation == pytest.approx(row["yaw_correlation"])


@pytest.mark.slow
def test_either_stream_may_be_ahead() -> None:
    truths, tracked = walks(0)
    merged = sorted([*truths, *tracked], key=lambda message: message.stamp_ns)
    truth_first, in_turn = Bench().feed([*truths, *tracked]), Bench().feed(merged)
    assert in_turn[-1].total == truth_first[-1].total


def test_recent_forgets_what_is_older_than_10_s() -> None:
    bench = Bench()
    here = person("a", 2.0, 0.0)
    scores = bench.feed(
        message
        for ms in range(0, 12_001, 100)
        # 0.5 m off for the first second, then exact.
        for message in (truth(ms, here), tracks(ms, track(1, 2.5 if ms < 1000 else 2.0, 0.0)))
    )
    assert scores[-1].total.frames == 121
    assert scores[-1].total.position_rmse_m == pytest.approx(math.sqrt(10 * 0.25 / 121))
    assert scores[-1].recent.frames == 100  # 2.1 to 12 s
    assert scores[-1].recent.position_rmse_m == 0.0


def test_tracks_from_before_begin_a_new_playback() -> None:
    bench = Bench()
    round_ = [*still(person("a", 2.0, 0.0)), tracks(300, track(1, 2.0, 0.0))]
    first = bench.feed(round_)
    again = bench.feed(m for m in [truth(5000), tracks(5000), *round_])
    assert first[-1].total.matched == 1
    assert again[-1].total == first[-1].total
    assert again[-1].sequence > first[-1].sequence  # numbering continues


def test_tracks_of_the_round_before_are_not_scored() -> None:
    bench = Bench()
    bench.feed(still(person("a", 2.0, 0.0)))
    bench.scorer.restart(200 * MS)
    (got,) = bench.feed([tracks(100, track(1, 2.0, 0.0)), tracks(200, track(2, 2.0, 0.0))])
    assert (got.total.frames, got.total.id_switches) == (1, 0)
    assert bench.counters["late_tracks"] == 1


def test_tracks_a_little_late_are_counted() -> None:
    bench = Bench()
    assert len(bench.feed([*still(), tracks(300), tracks(200)])) == 1
    assert bench.counters["late_tracks"] == 1


def test_tracks_that_cannot_be_scored_are_counted() -> None:
    bench = Bench()
    assert bench.feed([truth(0), truth(900), tracks(400)]) == []  # truth has a gap
    assert bench.counters["without_truth"] == 1
    other = [truth(1000, frame_id="mocap"), truth(1100, frame_id="mocap"), tracks(1050)]
    assert bench.feed(other) == []
    assert bench.counters["without_transform"] == 1


def test_tracks_do_not_wait_for_ever() -> None:
    bench = Bench()
    assert bench.feed([truth(0), *(tracks(10 + ms) for ms in range(MAX_WAITING + 3))]) == []
    assert bench.counters["without_truth"] == 3


def test_without_truth_nothing_waits() -> None:
    bench = Bench()
    assert bench.feed(tracks(ms) for ms in range(100)) == []
    assert not bench.counters


def test_absurd_people_are_left_out() -> None:
    absurd = [person("far", 9e6, -9e6), person("fast", 2.0, 0.0, vx=9e6)]
    (got,) = Bench().feed([*still(*absurd, person("a", 2.0, 0.0)), tracks(0, track(1, 9e6, 9e6))])
    assert [p.id for p in got.people] == ["a"]
    assert got.false_alarms == ()


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.metrics.live.MAX_IDENTITIES", 100)
    bench, numbers = Bench(), itertools.count(1)
    for ms in range(11):  # 10 new tracks each: more than 100 after 11
        crowd = [track(next(numbers), 2.0, 0.0) for _ in range(10)]
        scores = bench.feed([truth(ms), tracks(ms, *crowd)])
        assert scores[-1].total.frames == ms + 1
    assert bench.feed([truth(11), tracks(11)])[-1].total.frames == 1
    assert bench.counters["recounts"] == 1


def crossing(ms: float) -> tuple[TruthPerson, TruthPerson]:
    """Two people cross repeatedly in front of the camera, at 0.8 m/s."""
    y = 1.6 * math.asin(math.sin(math.pi * ms / 4000)) / (math.pi / 2)
    return person("a", 3.0, y), person("b", 3.5, -y)


def late_truth(offset_ms: float, shift_m: float = 0.0) -> list[Message]:
    """12 s in which the truth's clock is behind and its frame is shifted to the left."""
    messages: list[Message] = []
    for ms in range(0, 12_001, 10):
        moved = [
            TruthPerson(id=p.id, position_m=p.position_m + np.array([0.0, shift_m, 0.0]))
            for p in crossing(ms + offset_ms)
        ]
        messages.append(truth(ms, *moved))
        if ms % 40 == 0 and ms >= 200:
            tracked = [
                track(k + 1, *(p.position_m[:2] - (0.1, 0.0))) for k, p in enumerate(crossing(ms))
            ]
            messages.append(tracks(ms, *tracked))
    return messages


@pytest.mark.slow
def test_a_clock_offset_is_reported_but_not_applied() -> None:
    last = Bench(align_clock_s=0.5).feed(late_truth(80))[-1]
    assert last.alignment is not None
    assert last.alignment.clock_offset_s == pytest.approx(0.08, abs=0.005)
    assert not last.alignment.applied
    # 0.1 m of bias along x and 0.08 s * 0.8 m/s = 0.064 m along y.
    assert last.recent.position_rmse_m == pytest.approx(math.hypot(0.1, 0.064), abs=0.003)


@pytest.mark.slow
def test_a_clock_offset_is_applied_if_wanted() -> None:
    last = Bench(align_clock_s=0.5, apply_alignment=True).feed(late_truth(80))[-1]
    assert last.alignment is not None
    assert last.alignment.applied
    error = last.people[0].position_error_m
    assert error is not None
    assert error == pytest.approx([-0.1, 0.0], abs=0.004)  # only the bias is left


@pytest.mark.slow
def test_clock_and_frame_are_found_together() -> None:
    bench = Bench(align_clock_s=0.5, align_space="2d", apply_alignment=True)
    last = bench.feed(late_truth(80, shift_m=0.3))[-1]
    assert last.alignment is not None
    assert last.alignment.clock_offset_s == pytest.approx(0.08, abs=0.005)
    assert last.alignment.matrix is not None
    # Truth 0.3 m to the left and tracks 0.1 m to the front of it.
    assert last.alignment.matrix[:2, 3] == pytest.approx([-0.1, -0.3], abs=0.01)
    assert (last.alignment.rmse_after_m or 1.0) < 0.01 < (last.alignment.rmse_before_m or 0.0)
    error = last.people[0].position_error_m
    assert error == pytest.approx([0.0, 0.0], abs=0.01)


@pytest.mark.slow
def test_alignment_is_absent_unless_asked_for() -> None:
    assert Bench().feed(late_truth(80))[-1].alignment is None
