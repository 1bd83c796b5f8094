"""Covers of heads: they contain the face, and continue while detections are missing."""

import numpy as np
import pytest

from deploy.anonymise.heads import Cover, cover_frames, cover_of
from people4d.messages import F32, F64

BOX = np.array([100, 50, 160, 290], np.float32)  # 240 px tall: a head of 40 px


def face(u: float, v: float) -> F32:
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[:5] = u, v, 0.9
    keypoints[:5, 0] += [0, 5, -5, 12, -12]
    return keypoints


def holds(rectangle: F64, u: float, v: float) -> bool:
    return bool(rectangle[0] <= u <= rectangle[2] and rectangle[1] <= v <= rectangle[3])


def test_cover_holds_the_face_with_a_margin() -> None:
    head = cover_of(BOX, face(130, 70)).head_xyxy_px
    for u, v in ((118 - 30, 70), (142 + 30, 70), (130, 50 - 7), (130, 50 + 47)):
        assert holds(head, u, v), (u, v)
    assert head[3] < 170  # the torso stays


def test_cover_without_keypoints_is_the_upper_part_of_the_box() -> None:
    for keypoints in (None, np.zeros((17, 3), np.float32)):
        head = cover_of(BOX, keypoints).head_xyxy_px
        assert head[0] < 100
        assert head[2] > 160
        assert (head[1], head[3]) == pytest.approx((50 - 16, 50 + 80))


def at(u: float) -> Cover:
    box = np.array([u, 50, u + 60, 290])
    return Cover(box, np.array([u, 50, u + 60, 100]))


def test_gap_is_interpolated() -> None:
    detected = [[at(100)], [], [], [at(130)]]
    rectangles = cover_frames(detected, [0.0, 0.1, 0.2, 0.3])
    assert all(holds(r, 140, 75) for r in rectangles[1])
    centres = [np.mean([r[0], r[2]]) for r in (rectangles[1][0], rectangles[2][0])]
    assert centres == pytest.approx([140, 150])


def test_cover_stays_for_half_a_second_before_and_after() -> None:
    detected: list[list[Cover]] = [[] for _ in range(21)]
    detected[10] = [at(100)]
    counts = [len(r) for r in cover_frames(detected, [0.1 * k for k in range(21)])]
    assert counts == [0] * 5 + [1] * 11 + [0] * 5


def test_a_person_who_returns_later_is_covered_anew() -> None:
    times_s = [0.1 * k for k in range(60)]
    detected: list[list[Cover]] = [[] for _ in times_s]
    for k in (0, 1, 40, 41):
        detected[k] = [at(100), at(300)]
    counts = [len(r) for r in cover_frames(detected, times_s)]
    assert counts[20] == 0  # more than two seconds: another stay
    assert counts[0] == counts[40] == 2
    assert counts[3] == counts[38] == 2


def test_people_who_pass_each_other_are_both_covered() -> None:
    times_s = [0.1 * k for k in range(20)]
    detected = [[at(100 + 20 * k), at(480 - 20 * k)] for k in range(20)]
    detected[9] = detected[10] = []  # one hides the other
    for k, rectangles in enumerate(cover_frames(detected, times_s)):
        assert any(holds(r, 130 + 20 * k, 75) for r in rectangles), k
        assert any(holds(r, 510 - 20 * k, 75) for r in rectangles), k
