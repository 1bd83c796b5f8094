"""Node of the predictor."""

from typing import Any

import msgspec
import numpy as np
import pytest

from people4d.codec import decode, encode
from people4d.messages import Message, Predictions, Tracks
from services.predictor.build import build
from services.predictor.config import PredictorConfig
from services.predictor.node import PredictorNode
from tests.builders import odometry, static_transform, track, tracks

PERIOD_NS = 100_000_000
NOW_NS = 10**9


def node_of(**fields: Any) -> PredictorNode:
    """Build a node with settings."""
    return build(PredictorConfig(**fields))


def walker(number: int = 1, x: float = 0.0, y: float = 0.0, **fields: Any) -> Any:
    """Build a track that walks along x at 1 m/s."""
    motion = {"position_m": np.array([x, y, 1.0]), "velocity_mps": np.array([1.0, 0.0, 0.0])}
    return track(**{"id": number, **motion, "covariance": 0.01 * np.eye(6), **fields})


def answer(node: PredictorNode, message: Message) -> Predictions | None:
    """Return the predictions that follow from a message, after the codec."""
    found = node.handle(message, 0)
    if not found:
        return None
    (one,) = found
    decoded = decode(encode(one))
    assert isinstance(decoded, Predictions)
    return decoded


def walk(node: PredictorNode, count: int, start_ns: int = 0) -> list[Predictions]:
    """Let one person walk along x at 1 m/s."""
    found = []
    for number in range(count):
        stamp_ns = start_ns + number * PERIOD_NS
        found.append(answer(node, tracks(walker(x=number * 0.1), stamp_ns=stamp_ns)))
    return [one for one in found if one]


def test_predictions_have_stamp_frame_and_people_of_the_tracks() -> None:
    hidden = walker(4, y=5.0, state="lost", detection=None, time_since_update_s=0.4)
    message = tracks(walker(7), hidden, stamp_ns=5, frame_id="odom")
    found = answer(node_of(), message)
    assert found is not None
    assert (found.stamp_ns, found.frame_id, found.camera) == (5, "odom", "front")
    assert found.horizons_s == (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
    assert [(person.id, person.state) for person in found.people] == [(7, "confirmed"), (4, "lost")]
    for person in found.people:
        assert person.means_m.shape == (10, 2)
        parts = (person.motion.standing, person.motion.going_on, person.motion.turning)
        assert sum(parts) == pytest.approx(1)
        assert np.all(np.diff(np.linalg.det(person.covariances_m2)) > 0)


def test_a_frame_without_people_is_answered_too() -> None:
    found = answer(node_of(), tracks(stamp_ns=5))
    assert found is not None
    assert found.people == ()


def test_predictions_are_published_at_their_rate_and_not_per_frame() -> None:
    node = node_of(rate_max_hz=10.0)
    stamps = [number * 33_333_333 for number in range(91)]  # three seconds
    found = [answer(node, tracks(walker(), stamp_ns=stamp)) for stamp in stamps]
    assert sum(one is not None for one in found) == 31


def test_tracks_with_another_clock_cause_no_restart() -> None:
    node = node_of()
    walk(node, 20, 10**12)
    hour_ahead = tracks(walker(9), stamp_ns=2 * 10**12, camera="back")
    assert answer(node, hour_ahead) is None
    assert len(walk(node, 3, 10**12 + 20 * PERIOD_NS)) == 3
    counters = node.status().counters
    assert (counters["other_clock"], counters["clock_resets"], counters["stale"]) == (1, 0, 0)
    # Once the first camera is gone, the other's clock is followed.
    assert node.handle(hour_ahead, 4 * 10**9)


def test_clock_reset_restarts_and_old_tracks_are_dropped() -> None:
    node = node_of()
    walk(node, 20, 10**12)
    assert answer(node, tracks(walker(), stamp_ns=10**12)) is not None  # 1.9 s back: a reset
    assert node.status().counters["clock_resets"] == 1
    assert answer(node, tracks(walker(), stamp_ns=10**12 - PERIOD_NS)) is None
    assert node.status().counters["stale"] == 1
    assert len(walk(node, 3, 5 * 10**12)) == 3  # an hour ahead


@pytest.mark.parametrize(
    "fields",
    [
        {"position_m": np.array([1e6, 0.0, 0.0])},
        {"velocity_mps": np.array([0.0, 13.0, 0.0])},
        {"velocity_mps": np.array([1e6, 1e6, 0.0])},
        {"covariance": np.full((6, 6), 1e7)},
    ],
)
def test_absurd_people_are_left_out_and_counted(fields: dict[str, Any]) -> None:
    node = node_of()
    found = answer(node, tracks(walker(1), walker(2, **fields), walker(3)))
    assert found is not None
    assert [person.id for person in found.people] == [1, 3]
    assert node.status().counters["implausible"] == 1


def test_a_covariance_that_is_none_still_gives_valid_predictions() -> None:
    odd = np.arange(36.0).reshape(6, 6) - 18.0
    assert answer(node_of(), tracks(walker(1, covariance=odd), walker(2))) is not None


def test_people_beyond_the_limit_and_repeated_ids_are_counted() -> None:
    node = node_of(people_max=2)
    found = answer(node, tracks(walker(1), walker(1, y=3.0), walker(2), walker(3)))
    assert found is not None
    assert [person.id for person in found.people] == [1, 2]
    assert found.people[0].position_m[1] == 0.0
    assert node.status().counters["too_many"] == 1
    assert node.status().counters["repeated"] == 1


def test_two_hundred_people_are_predicted() -> None:
    people = [walker(n + 1, x=n % 20, y=n // 20) for n in range(200)]
    found = answer(node_of(), tracks(*people))
    assert found is not None
    assert len(found.people) == 200


def drive(node: PredictorNode, speed_mps: float = 1.0, turn_radps: float = 0.0) -> None:
    """Drive for 1 s until NOW_NS, when the robot is at the origin and looks along +x."""
    node.handle(static_transform(np.eye(4), child="odom"), 0)
    for number in range(-50, 1):
        at_s = number * 0.02
        angle = turn_radps * at_s
        x = speed_mps * at_s * np.sinc(angle / np.pi)
        y = speed_mps * at_s * np.sin(angle / 2) * np.sinc(angle / 2 / np.pi)
        pose = {"x_m": float(x), "y_m": float(y), "theta_rad": float(angle)}
        node.handle(odometry(stamp_ns=NOW_NS + number * 20_000_000, **pose), 0)


def test_oncoming_person_is_abreast_after_half_the_distance() -> None:
    # 8 m ahead and 1 m aside, both at 1 m/s towards each other: abreast after 4 s, 1 m apart.
    node = node_of()
    drive(node)
    oncoming = walker(x=8.0, y=1.0, velocity_mps=np.array([-1.0, 0.0, 0.0]))
    found = answer(node, tracks(oncoming, stamp_ns=NOW_NS))
    assert found is not None
    assert found.robot_m is not None
    np.testing.assert_allclose(found.robot_m[3], [2.0, 0.0], atol=1e-6)
    met = found.people[0].robot
    assert met is not None
    assert met.closest_approach_s == pytest.approx(4.0, abs=0.11)
    assert met.closest_distance_m == pytest.approx(1.0, abs=0.05)
    assert met.path_distance_m == pytest.approx(1.0, abs=0.05)


def test_turning_robot_is_extrapolated_on_its_arc() -> None:
    # 0.5 m/s at 0.5 rad/s: a circle of radius 1 m around (0, 1).
    node = node_of()
    drive(node, 0.5, 0.5)
    found = answer(node, tracks(walker(x=8.0), stamp_ns=NOW_NS))
    assert found is not None
    assert found.robot_m is not None
    angle = 0.5 * np.array(found.horizons_s)
    expected = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    np.testing.assert_allclose(found.robot_m, expected, atol=1e-3)


def test_no_encounter_without_odometry_or_with_an_old_one() -> None:
    node = node_of()
    node.handle(static_transform(np.eye(4), child="base_link"), 0)
    found = answer(node, tracks(walker()))
    assert found is not None
    assert found.robot_m is None
    assert found.people[0].robot is None
    node = node_of()
    drive(node)
    found = answer(node, tracks(walker(), stamp_ns=NOW_NS + 600_000_000))
    assert found is not None
    assert found.robot_m is None


def test_rotated_world_gives_rotated_predictions() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    both = np.kron(np.eye(2), turn)

    def rotated(message: Tracks) -> Tracks:
        people = tuple(
            msgspec.structs.replace(
                one,
                position_m=turn @ one.position_m,
                velocity_mps=turn @ one.velocity_mps,
                covariance=both @ one.covariance @ both.T,
            )
            for one in message.tracks
        )
        return msgspec.structs.replace(message, tracks=people)

    plain, turned = node_of(), node_of()
    for number in range(20):
        pair = (walker(1, x=number * 0.1), walker(2, x=number * 0.1, y=0.7))
        message = tracks(*pair, stamp_ns=number * PERIOD_NS)
        found, other = answer(plain, message), answer(turned, rotated(message))
    assert found is not None
    assert other is not None
    for one, two in zip(found.people, other.people, strict=True):
        np.testing.assert_allclose(two.means_m, one.means_m @ turn[:2, :2].T, atol=1e-6)
