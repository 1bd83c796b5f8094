"""Tracks out of view of a turning camera are not missed."""

import dataclasses
import math

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    invert,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import F64, Track
from services.tracker.interface import ImageEdges, Measurement, Observation
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.config import IdentityConfig
from services.tracker.strongsort3d.visibility import visible_ratios
from tests.tracker.scene import (
    FOCAL_PX,
    frame,
    person,
    published,
    published_config,
    unit,
    with_pose,
)

EDGES = ImageEdges(  # 28 degrees to each side
    left=-320 / FOCAL_PX, right=320 / FOCAL_PX, top=-240 / FOCAL_PX, bottom=240 / FOCAL_PX
)
RED, BLUE = unit((1.0, 0.0, 0.1)), unit((0.0, 1.0, 0.1))
PEOPLE = (np.array([4.0, 0.5, 1.0]), np.array([4.5, -0.5, 1.0]))
ALL = published(
    identity=IdentityConfig(enabled=True),
    visibility=True,
    sigma_acceleration_mps2=3.0,
    sigma_measurement_m=0.3,
    a_max=5,
)


def turned(yaw_deg: float) -> F64:
    """Pose of a camera at the origin of the map, 1 m high, turned to the left."""
    turn = rotation_from_rpy(0.0, 0.0, math.radians(yaw_deg))
    return transform_from([0.0, 0.0, 1.0], turn @ LINK_FROM_OPTICAL[:3, :3])


def detected(number: int, yaw_deg: float, embeddings: bool) -> Observation:
    """Frame of a turned camera with two standing people, detected if their centre is in view."""
    pose = turned(yaw_deg)
    found = []
    for index, (position_m, appearance) in enumerate(zip(PEOPLE, (RED, BLUE), strict=True)):
        x, _, z = apply(invert(pose), position_m)
        u = 320 + FOCAL_PX * x / z
        if z > 0 and 0 < u < 640:
            left, right = max(u - FOCAL_PX * 0.25 / z, 0), min(u + FOCAL_PX * 0.25 / z, 640)
            found.append(
                Measurement(
                    index=index,
                    box_xyxy_px=np.array([left, 100.0, right, 400.0]),
                    score=0.9,
                    position_m=position_m,
                    forward_m=float(z),
                    embedding=appearance if embeddings else None,
                )
            )
    return dataclasses.replace(
        frame(number, *found), map_from_camera=pose, size_px=(640, 480), edges=EDGES
    )


def test_visible_ratio_at_the_edge_of_the_image() -> None:
    # At 4 m a strip is half_width / 4 = 0.0625 to each side. The image ends at 0.5333: a person
    # who stands at 0.5333 * 4 to the right is half in view, and 0.125 m farther a quarter.
    # Above and below the image, which ends at 0.4, a person is not in view.
    y_m = EDGES.right * 4
    level = [[4, 0, 1], [4, -y_m, 1], [4, -y_m - 0.125, 1], [4, -3, 1], [-4, 0, 1.0]]
    positions = np.array([*level, [4, 0, 2.5], [4, 0, 2.7], [4, 0, -0.7]])
    camera = dataclasses.replace(frame(0), map_from_camera=turned(0), edges=EDGES)
    np.testing.assert_allclose(
        visible_ratios(positions, camera), [1, 0.5, 0.25, 0, 0, 1, 0, 0], atol=1e-9
    )
    assert visible_ratios(positions, dataclasses.replace(camera, edges=None)) == 8 * [1.0]


@pytest.mark.parametrize("embeddings", [True, False])
def test_people_left_and_right_of_a_camera_that_weaves_keep_their_identities(
    embeddings: bool,
) -> None:
    # The camera repeatedly turns by 60 degrees and back within 2.4 s: both people are cut off and
    # out of view for more than a second each time, longer than EMPTY_S and a_max frames.
    tracker = build_strongsort3d(published_config(strongsort3d=ALL))
    tracks: list[Track] = []
    for number in range(100):
        tracks = tracker.update(
            detected(number, 30 - 30 * math.cos(math.tau * number / 24), embeddings)
        )
    assert {track.id for track in tracks} == {1, 2}


def test_track_of_a_person_who_leaves_below_the_image_ends_at_once() -> None:
    # A camera looks down on a person walking towards it: the torso leaves the image at the
    # bottom, the box does not reach its sides, and no other person hides it.
    tracker = build_strongsort3d(published_config(strongsort3d=ALL))
    tilt = rotation_from_rpy(0.0, math.radians(35), 0.0)
    pose = transform_from([0.0, 0.0, 2.5], tilt @ LINK_FROM_OPTICAL[:3, :3])
    predicted: list[int] = []
    for number in range(20):
        position_m = np.array([4.0 - 0.2 * number, 0.0, 1.0])
        x, y, z = apply(invert(pose), position_m)
        u, v = 320 + FOCAL_PX * x / z, 240 + FOCAL_PX * y / z
        found = Measurement(
            index=0,
            box_xyxy_px=np.array([u - 60, v - 100, u + 60, 479.0]),
            score=0.9,
            position_m=position_m,
            forward_m=float(z),
            embedding=RED,
        )
        measurements = (found,) if v < 470 else ()
        tracks = tracker.update(
            dataclasses.replace(
                frame(number, *measurements), map_from_camera=pose, size_px=(640, 480), edges=EDGES
            )
        )
        predicted.append(len(tracks) - len(measurements))
    # Predicted for 0.2 s at the edge of the image, not for 1 s as inside it.
    assert 1 <= sum(predicted) <= 3


def test_person_who_leaves_a_fixed_camera_is_missed() -> None:
    tracker = build_strongsort3d(published_config(strongsort3d=ALL))
    for number in range(10):
        tracker.update(detected(number, 0.0, embeddings=False))
    for number in range(10, 16):
        empty = dataclasses.replace(detected(number, 0.0, embeddings=False), measurements=())
        tracks = tracker.update(empty)
    assert tracks == []


@pytest.mark.parametrize(("missed_yaw_deg", "identity"), [(-20.5, 3), (-21.0, 1), (-20.0, 1)])
def test_people_at_the_edge_of_a_camera_that_turns_have_not_left(
    missed_yaw_deg: float, identity: int
) -> None:
    # RED is half in view, at 27.6 degrees of 28, and not detected for 0.4 s.
    sort = build_strongsort3d(published_config(strongsort3d=ALL))
    for number in range(10):
        sort.update(detected(number, -20.5, embeddings=True))
    for number in range(10, 14):
        missed = detected(number, missed_yaw_deg, embeddings=True)
        sort.update(dataclasses.replace(missed, measurements=()))
    tracks = sort.update(detected(14, -20.5, embeddings=True))
    assert [t.id for t in tracks if t.detection == 0] == [identity]


def test_person_who_left_while_the_camera_was_turned_ends_within_a_second_in_view() -> None:
    # The camera turns away from RED for half a second; back again it sees the place empty for
    # longer than EMPTY_S.
    sort = build_strongsort3d(published_config(strongsort3d=replace(ALL, a_max=30)))
    for number in range(20):
        sort.update(detected(number, 0.0, embeddings=True))
    for number in range(20, 25):
        assert len(sort.update(detected(number, 90.0, embeddings=True))) == 2
    lost = []
    for number in range(25, 40):
        back = detected(number, 0.0, embeddings=True)
        tracks = sort.update(dataclasses.replace(back, measurements=back.measurements[1:]))
        lost.append(sum(track.detection is None for track in tracks))
    assert lost == [1] * 10 + [0] * 5


def test_absent_track_ends_though_it_was_occluded_before() -> None:
    # BLUE passes in front of RED and RED leaves: a second of the empty place ends the track.
    sort = build_strongsort3d(published_config(strongsort3d=replace(ALL, a_max=30)))
    for number in range(20):
        sort.update(with_pose(number, person(4, 0, embedding=(1.0, 0.0, 0.1))))
    blue = (0.0, 1.0, 0.1)
    for number in range(20, 25):
        tracks = sort.update(with_pose(number, person(2, 0, embedding=blue)))
        assert {track.id for track in tracks} == {1, 2}
    lost = []
    for number in range(25, 40):
        tracks = sort.update(with_pose(number, person(2, 0.15 * (number - 22), embedding=blue)))
        lost.append(any(track.id == 1 for track in tracks))
    assert lost[5]
    assert not lost[-1]


def test_track_out_of_view_ends_once_its_position_is_unknown() -> None:
    # While hidden, velocities have 0.6 m/s for 0.7 s: the variance of a position grows to about
    # 2 * 0.6^2 * 0.7 t, which is 1 m^2 after 2 s, and later by the time until it does so.
    sort = build_strongsort3d(published_config(strongsort3d=replace(ALL, a_max=100)))
    for number in range(20):
        sort.update(detected(number, 0.0, embeddings=True))
    away = range(20, 60)
    lost = [len(sort.update(detected(number, 90.0, embeddings=True))) for number in away]
    assert 15 < sum(number == 2 for number in lost) < 30
    assert lost[-1] == 0
