"""Yaw of tracks: the filter by hand, the velocity, and through the node."""

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from common.config import load
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from, wrap
from people4d.errors import ConfigError
from people4d.messages import F64, Detection, Message, Track, Tracks
from services.tracker.build import build, make_tracker
from services.tracker.config import TrackerConfig, YawFilterConfig
from services.tracker.interface import Measurement
from services.tracker.motion.yaw import (
    KeypointYaw,
    VelocityYaw,
    YawState,
    is_from_behind,
    make_yaw,
)
from services.tracker.observe import yaw_of
from tests import builders
from tests.tracker.scene import FRAME_NS, frame, person, published, published_config

CONFIG = YawFilterConfig(
    sigma_acceleration_radps2=6.0,
    acceleration_s=math.inf,
    sigma_measurement_rad=0.5,
    sigma_start_rate_radps=1.0,
    measured_sigma=False,
    sigma_max_rad=math.inf,
    sigma_unknown_rad=math.inf,
    reversal_s=0.0,
    sigma_walk_rad=math.inf,
    outlier_sigmas=math.inf,
    rate_decay_s=math.inf,
)
FILTER = KeypointYaw(CONFIG)
AT_REST = np.zeros(3)


def facing(yaw_rad: float | None, sigma_rad: float | None = None, **at: float) -> Measurement:
    x, y = at.get("x", 3.0), at.get("y", 0.0)
    detected = person(x, y)
    return Measurement(
        index=detected.index,
        box_xyxy_px=detected.box_xyxy_px,
        score=detected.score,
        position_m=detected.position_m,
        forward_m=detected.forward_m,
        yaw_rad=yaw_rad,
        yaw_sigma_rad=sigma_rad,
    )


def state(psi_rad: float, rate_radps: float = 0.0, variance: float = 0.25) -> YawState:
    return YawState(psi_rad, rate_radps, variance, 0.0, 1.0)


def predict(before: YawState, dt_s: float, filter_: KeypointYaw = FILTER) -> YawState:
    (after,) = filter_.predict([before], dt_s)
    assert after is not None
    return after


def update(
    before: YawState | None,
    detected: Measurement,
    filter_: KeypointYaw = FILTER,
    velocity_mps: F64 = AT_REST,
) -> YawState:
    (after,) = filter_.update([before], [detected], velocity_mps[None])
    assert after is not None
    return after


# The filter


def test_the_first_measurement_begins_the_state() -> None:
    begun = update(None, facing(7.0))
    np.testing.assert_allclose(begun[:2], [7.0 - 2 * math.pi, 0.0])
    np.testing.assert_allclose(begun[2:5], [0.25, 0.0, 1.0])
    assert FILTER.read(begun, AT_REST) == pytest.approx(7.0 - 2 * math.pi)
    assert FILTER.read(None, np.ones(3)) is None
    assert FILTER.update([None], [facing(None)], np.ones((1, 3))) == [None]


def test_prediction_by_hand() -> None:
    # psi = 1 + 0.1 * 0.5. P00 = 0.25 + 0.1^2 * 1 + 6^2 * 0.1^4 / 4 = 0.25 + 0.01 + 0.0009,
    # P01 = 0.1 * 1 + 36 * 0.1^3 / 2 = 0.118, P11 = 1 + 36 * 0.1^2 = 1.36.
    after = predict(state(1.0, 0.5), 0.1)
    np.testing.assert_allclose(after[:2], [1.05, 0.5])
    np.testing.assert_allclose(after[2:5], [0.2609, 0.118, 1.36])


def test_the_innovation_is_wrapped() -> None:
    # 175 deg, measured -175: 10 deg on. P = R, so half of that: 180, not 0.
    after = update(state(math.radians(175)), facing(math.radians(-175)))
    assert math.degrees(abs(after.psi_rad)) == pytest.approx(180.0)
    assert after.psi_variance == pytest.approx(0.125)  # P R / (P + R) = 0.25 * 0.25 / 0.5
    assert FILTER.read(after, AT_REST) == pytest.approx(math.pi)


def test_the_prediction_is_wrapped() -> None:
    # 170 deg and on by 1 rad/s for half a second: 170 + 28.6 = 198.6, which is -161.4.
    after = predict(state(math.radians(170), 1.0), 0.5)
    assert math.degrees(after.psi_rad) == pytest.approx(170 + 28.648 - 360, abs=1e-3)


@pytest.mark.parametrize("turn_deg", [10, 90, 179, -135])
def test_turning_the_world_turns_the_yaw(turn_deg: float) -> None:
    rng = np.random.default_rng(3)
    turn, one, other = math.radians(turn_deg), None, None
    for z in rng.normal(3.0, 0.6, 40):
        one = update(predict(one, 0.1) if one else None, facing(z))
        other = update(predict(other, 0.1) if other else None, facing(wrap(z + turn)))
        assert wrap(other.psi_rad - one.psi_rad - turn) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(other[2:5], one[2:5])


def test_a_steady_turn_is_followed_through_180_deg() -> None:
    turned = update(None, facing(2.0))
    for step in range(1, 60):  # 1 rad/s at 30 Hz: from 2 rad through pi to 3.97 rad
        turned = update(predict(turned, 1 / 30), facing(wrap(2.0 + step / 30)))
    assert wrap(turned.psi_rad - (2.0 + 59 / 30)) == pytest.approx(0.0, abs=math.radians(1))
    assert turned.rate_radps == pytest.approx(1.0, abs=0.05)


def test_two_seconds_without_a_measurement() -> None:
    # P00 = 0.25 + 2^2 * 1 + 36 * 2^4 / 4 = 148.25: nothing is known, but nothing overflows.
    gone = predict(state(0.1, 0.2), 2.0)
    assert gone.psi_variance == pytest.approx(148.25)
    for _ in range(1000):
        gone = predict(gone, 2.0)
    assert np.isfinite(gone).all()
    assert abs(gone.psi_rad) <= math.pi
    # The next measurement is believed at once: K = 1 within 1e-9.
    assert update(gone, facing(-2.0)).psi_rad == pytest.approx(-2.0)


def test_a_measurement_that_is_no_number_is_refused() -> None:
    before = state(0.3)
    detected = [facing(math.nan), facing(math.inf)]
    assert FILTER.update([before, None], detected, np.zeros((2, 3))) == [before, None]


def test_turn_rate_decays_where_configured() -> None:
    # After tau ln 2 = 0.3466 s half the rate is left; turned by tau (1 - 1/2) = 0.25 rad.
    tired = KeypointYaw(msgspec.structs.replace(CONFIG, rate_decay_s=0.5))
    after = predict(state(0.0, 1.0), 0.5 * math.log(2), tired)
    np.testing.assert_allclose(after[:2], [0.25, 0.5])
    # Without end it turns by tau * rate at most.
    assert predict(state(0.0, 1.0), 60.0, tired).psi_rad == pytest.approx(0.5)


def test_measurement_is_weighed_by_its_own_sigma_where_configured() -> None:
    weighing = KeypointYaw(msgspec.structs.replace(CONFIG, measured_sigma=True))
    detected = facing(1.0, sigma_rad=math.sqrt(0.75))
    # K = 0.25 / (0.25 + 0.75) = 1/4; with the constant 0.5 rad it is 0.25 / (0.25 + 0.25) = 1/2.
    assert update(state(0.0), detected, weighing).psi_rad == pytest.approx(0.25)
    assert update(state(0.0), detected).psi_rad == pytest.approx(0.5)
    assert update(state(0.0), facing(1.0), weighing).psi_rad == pytest.approx(0.5)


def test_uncertain_measurement_counts_as_the_limit_where_configured() -> None:
    limited = msgspec.structs.replace(CONFIG, measured_sigma=True, sigma_max_rad=0.5)
    # K = 0.25 / (0.25 + 0.5^2) = 1/2, whatever the measurement's own sigma above 0.5 rad is.
    after = update(state(0.0), facing(1.0, sigma_rad=1.3), KeypointYaw(limited))
    assert after.psi_rad == pytest.approx(0.5)


def test_shipped_filter_follows_people_who_turn_round_within_four_frames() -> None:
    # A person on filinha, 10 frames a second: 28, 60, 107, 140, 172 deg and no angle at 107 deg.
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(0.4, sigma_rad=0.2), shipped)
    for degrees in (25, 28, 60, None, 140, 172, 172):
        angle = None if degrees is None else math.radians(degrees)
        yaw = update(predict(yaw, 0.1, shipped), facing(angle, sigma_rad=0.2), shipped)
        if angle is not None:
            assert abs(wrap(yaw.psi_rad - angle)) < math.radians(30)


def test_shipped_filter_is_not_reversed_by_a_single_frame() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(0.0, sigma_rad=0.15), shipped)
    for frame_ in range(30):
        angle = math.pi if frame_ == 20 else 0.0
        yaw = update(predict(yaw, 1 / 15, shipped), facing(angle, sigma_rad=0.15), shipped)
        assert abs(yaw.psi_rad) < math.radians(45)


def test_reversed_measurements_are_left_out_until_they_have_lasted() -> None:
    # Ten frames at 0 deg fill the agreement of 0.4 s; the fifth reversed one after it, 0.5 s, wins.
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(0.0, sigma_rad=0.15), shipped)
    for _ in range(10):
        yaw = update(predict(yaw, 0.1, shipped), facing(0.0, sigma_rad=0.15), shipped)
    assert yaw.agreement_s == pytest.approx(0.4)
    published_ = []
    for _ in range(5):
        yaw = update(predict(yaw, 0.1, shipped), facing(3.0, sigma_rad=0.15), shipped)
        published_.append(yaw.psi_rad)
    np.testing.assert_allclose(published_, [0.0, 0.0, 0.0, 0.0, 3.0], atol=1e-3)


def test_a_yaw_from_behind_ends_a_reversed_one_at_once() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(3.0, sigma_rad=0.15), shipped)
    for _ in range(10):
        yaw = update(predict(yaw, 0.1, shipped), facing(3.0, sigma_rad=0.15), shipped)
    back = replace(facing(0.0, sigma_rad=0.15), bearing_rad=0.0)
    yaw = update(predict(yaw, 0.1, shipped), back, shipped)
    assert yaw.psi_rad == pytest.approx(0.0)
    # It outlasts four reversed ones, as ten that agree do.
    for _ in range(4):
        yaw = update(predict(yaw, 0.1, shipped), facing(3.0, sigma_rad=0.15), shipped)
        assert yaw.psi_rad == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("yaw_deg", "expected"), [(0, True), (55, True), (-55, True), (65, False), (180, False)]
)
def test_yaw_along_the_view_is_from_behind(yaw_deg: float, expected: bool) -> None:
    measured = replace(facing(0.0), bearing_rad=np.radians(-45))
    assert is_from_behind(np.radians(yaw_deg - 45), measured) == expected
    assert not is_from_behind(np.radians(yaw_deg - 45), facing(0.0))


def test_walking_away_turns_a_yaw_towards_the_camera() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    front = replace(facing(3.0, sigma_rad=0.15), bearing_rad=0.0)
    away, nearer = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    yaw = update(None, front, shipped)
    for _ in range(10):
        yaw = update(predict(yaw, 0.1, shipped), front, shipped)
    published_ = []
    for _ in range(6):
        yaw = update(predict(yaw, 0.1, shipped), front, shipped, away)
        published_.append(abs(yaw.psi_rad) < 0.5)
    assert published_ == [False, False, True, True, True, True]
    # A person who stops, and is measured from the front still, faces the camera.
    for _ in range(6):
        yaw = update(predict(yaw, 0.1, shipped), front, shipped, np.zeros(3))
    assert yaw.psi_rad == pytest.approx(3.0, abs=0.2)
    # Walking towards a camera, a person measured from behind steps back.
    back = replace(facing(0.0, sigma_rad=0.15), bearing_rad=0.0)
    for _ in range(6):
        yaw = update(predict(yaw, 0.1, shipped), back, shipped, nearer)
    assert yaw.psi_rad == pytest.approx(0.0, abs=0.2)


def test_walking_decides_between_measurements_that_contradict_each_other() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    walks = np.array([1.0, 0.0, 0.0])
    for angles, expected in (([3.0, 3.0], 3.0), ([3.0, 0.0], 0.0)):
        # Who steps back is measured alike in all frames, and is not turned round.
        yaw = update(None, facing(3.0, sigma_rad=0.15), shipped)
        for _ in range(10):
            yaw = update(predict(yaw, 0.1, shipped), facing(3.0, sigma_rad=0.15), shipped, walks)
        for angle in angles * 10:
            yaw = update(predict(yaw, 0.1, shipped), facing(angle, sigma_rad=0.15), shipped, walks)
        assert abs(wrap(yaw.psi_rad - expected)) < 0.3


def test_reversed_first_measurement_is_corrected_by_the_second() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(3.0, sigma_rad=0.15), shipped)
    yaw = update(predict(yaw, 0.1, shipped), facing(0.0, sigma_rad=0.15), shipped)
    assert yaw.psi_rad == pytest.approx(0.0)


def test_reversed_guesses_take_longer_than_reversed_measurements() -> None:
    # At 1.28 rad, 1 - 1.28^2 / (pi^2 / 3) = half of the time counts: the ninth one wins.
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(0.0, sigma_rad=0.15), shipped)
    for _ in range(10):
        yaw = update(predict(yaw, 0.1, shipped), facing(0.0, sigma_rad=0.15), shipped)
    count = 0
    while abs(yaw.psi_rad) < 2 and count < 20:
        yaw = update(predict(yaw, 0.1, shipped), facing(3.0, sigma_rad=1.28), shipped)
        count += 1
    assert count == 8


def test_agreement_is_forgotten_without_measurements() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(0.0, sigma_rad=0.15), shipped)
    for _ in range(10):
        yaw = update(predict(yaw, 0.1, shipped), facing(0.0, sigma_rad=0.15), shipped)
    # 0.7 s without one: the measurement counts for 0.2 s, and takes 0.5 s of agreement away.
    after = update(predict(yaw, 0.7, shipped), facing(3.0, sigma_rad=0.15), shipped)
    assert after.psi_rad == pytest.approx(3.0)


def test_long_prediction_is_that_of_short_steps() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    steps = joint = update(None, facing(1.0, sigma_rad=0.2), shipped)
    for _ in range(7):
        steps = predict(steps, 0.1, shipped)
    joint = predict(joint, 0.7, shipped)
    np.testing.assert_allclose(joint[:2], steps[:2])
    np.testing.assert_allclose(joint[2:5], steps[2:5])


def test_yaw_that_is_as_uncertain_as_a_guess_is_not_published() -> None:
    shipped = KeypointYaw(YawFilterConfig())
    yaw = update(None, facing(1.0, sigma_rad=0.2), shipped)
    assert shipped.read(predict(yaw, 0.5, shipped), AT_REST) == pytest.approx(1.0)
    # After four seconds the standard deviation is above pi / sqrt(3), that of a uniform angle.
    yaw = predict(yaw, 4.0, shipped)
    assert math.sqrt(yaw.psi_variance) > math.pi / math.sqrt(3)
    assert shipped.read(yaw, AT_REST) is None
    assert KeypointYaw(CONFIG).read(yaw, AT_REST) == pytest.approx(1.0)


def test_reversed_measurement_changes_the_yaw_little() -> None:
    # y = pi, S = 0.25 + 0.25: 4.4 sigma. At 2 sigma S must be (pi / 2)^2 = 2.467:
    # K = 0.25 / 2.467 = 0.1013, the yaw moves by 0.318 rad instead of pi / 2.
    robust = KeypointYaw(msgspec.structs.replace(CONFIG, outlier_sigmas=2.0))
    after = update(state(0.0), facing(math.pi), robust)
    assert abs(after.psi_rad) == pytest.approx(0.3183, abs=1e-3)
    assert abs(update(state(0.0), facing(math.pi)).psi_rad) == pytest.approx(math.pi / 2)
    # 1 rad is 1.4 sigma: as ever.
    assert update(state(0.0), facing(1.0), robust).psi_rad == pytest.approx(0.5)


def test_yaw_follows_a_person_who_turns_round() -> None:
    robust = KeypointYaw(msgspec.structs.replace(CONFIG, outlier_sigmas=2.0))
    turned = update(None, facing(0.0), robust)
    for _ in range(60):
        turned = update(predict(turned, 1 / 30, robust), facing(2.8), robust)
    assert turned.psi_rad == pytest.approx(2.8, abs=0.1)


def test_walking_direction_is_a_weaker_measurement_where_configured() -> None:
    # After the keypoints P = 0.25 * 0.25 / 0.5 = 0.125; R = 0.375: K = 0.25 of 2 rad is 0.5 rad.
    walking = KeypointYaw(msgspec.structs.replace(CONFIG, sigma_walk_rad=math.sqrt(0.375)))
    v = np.array([math.cos(2.0), math.sin(2.0), 0.0])
    assert update(state(0.0), facing(0.0), walking, v).psi_rad == pytest.approx(0.5)
    assert update(state(0.0), facing(0.0), walking, 0.4 * v).psi_rad == pytest.approx(0.0)
    assert update(state(0.0), facing(0.0), FILTER, v).psi_rad == pytest.approx(0.0)
    # It is a measurement where the keypoints give none.
    begun = update(None, facing(None), walking, v)
    np.testing.assert_allclose(begun[:2], [2.0, 0.0])
    np.testing.assert_allclose(begun[2:5], [0.375, 0.0, 1.0])


def test_people_in_a_stack_do_not_mix() -> None:
    crowd = [state(0.1), None, state(3.0, -1.0), None]
    detected = [facing(0.5), facing(None), facing(None), facing(-1.0)]
    after = FILTER.update(crowd, detected, np.zeros((4, 3)))
    assert after[1] is None
    assert after[2] is crowd[2]
    assert after[0] is not None
    assert after[3] is not None
    np.testing.assert_allclose(after[0][:2], update(state(0.1), detected[0])[:2])
    np.testing.assert_allclose(after[3][:2], [-1.0, 0.0])
    assert FILTER.predict([None, None], 0.1) == [None, None]


# The velocity


def test_yaw_of_the_velocity() -> None:
    by_velocity = VelocityYaw(0.2)
    assert by_velocity.read(None, np.array([0.0, -1.0, 5.0])) == pytest.approx(-math.pi / 2)
    assert by_velocity.read(None, np.array([-1.0, -0.0, 0.0])) == math.pi  # wrapped to (-pi, pi]
    assert by_velocity.read(None, np.array([0.1, 0.1, 5.0])) is None
    everyone = VelocityYaw(0.0)
    assert everyone.read(None, np.array([1e-3, 1e-3, 0.0])) == pytest.approx(math.pi / 4)
    assert everyone.read(None, AT_REST) is None


def test_yaw_can_be_left_out() -> None:
    assert make_yaw(published_config(yaw="none")).read(state(1.0), np.ones(3)) is None


# In a tracker


@pytest.mark.parametrize("name", ["sort3d", "strongsort3d"])
def test_life_cycle_in_a_tracker(name: str) -> None:
    tracker = make_tracker(published_config(tracker=name, yaw="keypoints", yaw_filter=CONFIG))

    results: list[Track] = []

    def yaw_deg(*detected: Measurement) -> float:
        results.extend(tracker.update(frame(len(results), *detected)))
        yaw_rad = results[-1].yaw_rad
        return math.nan if yaw_rad is None else math.degrees(yaw_rad) % 360

    assert math.isnan(yaw_deg(facing(None)))  # the person is there, without a yaw
    assert yaw_deg(facing(math.radians(170))) == pytest.approx(170)  # begins
    assert 170 < yaw_deg(facing(math.radians(-170))) < 190  # across 180 deg
    for turned_deg in range(-170, 0, 6):  # 60 deg/s
        last_deg = yaw_deg(facing(math.radians(turned_deg)))
    assert last_deg == pytest.approx(turned_deg % 360, abs=5)
    # Unseen for a frame: turned on by 6 deg. Seen, but not which way: again.
    (ahead,) = tracker.predict(len(results) * FRAME_NS)
    assert ahead.yaw_rad is not None
    assert ahead.yaw_rad == pytest.approx(math.radians(last_deg + 6 - 360), abs=0.03)
    assert yaw_deg() == pytest.approx(math.degrees(ahead.yaw_rad) % 360)
    assert yaw_deg(facing(None)) == pytest.approx((last_deg + 12) % 360, abs=3)
    tracker.reset()
    assert math.isnan(yaw_deg(facing(None)))


def test_new_person_does_not_inherit_an_identity() -> None:
    tracker = make_tracker(published_config(yaw="keypoints"))
    tracker.update(frame(0, facing(1.0, x=3.0, y=1.0)))
    tracks = tracker.update(frame(1, facing(1.0, x=3.0, y=1.0), facing(-2.0, x=4.0, y=-1.0)))
    assert [track.yaw_rad for track in tracks] == [pytest.approx(1.0), pytest.approx(-2.0)]


# From the message to the map


def tracks_of(map_from_camera: Any, heading: Any, **fields: Any) -> list[Track]:
    config = published_config(embedding_wait_s=0.0, strongsort3d=published(n_init=1), **fields)
    node = build(config)
    detection = Detection(
        box_xyxy_px=np.array([300, 100, 400, 400], np.float32),
        score=0.9,
        position_m=np.array([0.0, 0.0, 3.0]),
        heading=heading,
        heading_sigma_rad=None if heading is None else 0.2,
    )
    sent: list[Message] = [
        builders.static_transform(map_from_camera, child="optical"),
        builders.detections(detection, stamp_ns=1, frame_id="optical"),
    ]
    (results,) = [answer for message in sent for answer in node.handle(message, 0)]
    assert isinstance(results, Tracks)
    return list(results.tracks)


@pytest.mark.parametrize(
    ("turned_deg", "heading", "expected_deg"),
    [
        (0, (0, 0, 1), 0),  # away from a camera that looks along the map's x
        (0, (-1, 0, 0), 90),  # image-left of it is the map's y
        (90, (0, 0, -1), -90),  # towards a camera that looks along y
        (90, (-1, 0, 0), 180),  # image-left of that one is -x
        (-135, (1, 0, 0), 135),  # image-right of a camera at -135 is -135 - 90 = -225 = 135
    ],
)
def test_the_yaw_of_a_track_is_in_the_map(
    turned_deg: float, heading: tuple[float, float, float], expected_deg: float
) -> None:
    for roll, pitch in ((0.0, 0.0), (0.0, 0.5), (0.2, -0.3)):  # a level, a nodding, a leaning one
        link = rotation_from_rpy(0, 0, math.radians(turned_deg))
        # Tilt turns camera and heading alike: what the camera sees of a level person changes.
        tilt = rotation_from_rpy(roll, pitch, 0)
        matrix = transform_from([5.0, -2.0, 1.2], link @ tilt @ LINK_FROM_OPTICAL[:3, :3])
        level = LINK_FROM_OPTICAL[:3, :3].T @ tilt.T @ LINK_FROM_OPTICAL[:3, :3] @ heading
        (track,) = tracks_of(matrix, level, yaw="keypoints")
        assert track.yaw_rad is not None
        assert wrap(track.yaw_rad - math.radians(expected_deg)) == pytest.approx(0.0, abs=1e-9)


def test_other_sources_leave_the_heading_alone() -> None:
    matrix, ahead = transform_from(np.zeros(3), LINK_FROM_OPTICAL[:3, :3]), np.array([0, 0, 1.0])
    assert tracks_of(matrix, ahead, yaw="keypoints")[0].yaw_rad == pytest.approx(0.0)
    for source in ("velocity", "none"):
        assert tracks_of(matrix, ahead, yaw=source)[0].yaw_rad is None  # at rest
    assert tracks_of(matrix, None, yaw="keypoints")[0].yaw_rad is None


def test_a_heading_straight_up_has_no_yaw() -> None:
    # A camera that looks straight down: its forward is the map's -z.
    down = transform_from(
        np.zeros(3), rotation_from_rpy(0, math.pi / 2, 0) @ LINK_FROM_OPTICAL[:3, :3]
    )
    assert yaw_of(np.array([0.0, 0.0, 1.0]), down) is None
    # Image-left of it is still level: the map's y.
    assert yaw_of(np.array([-1.0, 0.0, 0.0]), down) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("yaw=nose", "yaw"),
        ("yaw_filter.sigma_measurement_rad=0", "sigma_measurement_rad: expected"),
        ("yaw_filter.rate_decay_s=0", "rate_decay_s: expected"),
        ("yaw_filter.outlier_sigmas=0", "outlier_sigmas: expected"),
        ("yaw_filter.rate_decay_s=nan", "rate_decay_s: expected"),
    ],
)
def test_wrong_settings_are_refused(setting: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        load(TrackerConfig, "tracker", None, [setting], {})
