"""People who touch or cross keep their own tracks."""

import numpy as np
import pytest

from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.config import ContactConfig
from services.tracker.strongsort3d.contact import Contact
from services.tracker.strongsort3d.policies import FrameContext
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import person, published, published_config
from tests.tracker.strongsort3d.test_occlusion import BLUE, RED, of, with_pose

ON = ContactConfig(enabled=True)


def tracker(contact: ContactConfig = ON) -> StrongSort3d:
    return build_strongsort3d(published_config(strongsort3d=published(contact=contact)))


def test_covered_detection_gets_covariance_along_the_ray() -> None:
    # The far one's box lies inside the near one's. The line of sight from the origin is (4, 0, 1).
    near, far = person(2, 0), person(4, 0, index=1)
    config = published(contact=ContactConfig(depth_sigma_m=2.0))
    context = FrameContext(with_pose(0, near, far), [near, far], config)
    contact = Contact(config.contact)
    added_m2 = contact.gate_covariances_m2(context)
    assert added_m2 is not None
    np.testing.assert_array_equal(added_m2[0], np.zeros((3, 3)))
    np.testing.assert_allclose(added_m2[1], 4 / 17 * np.outer([4, 0, 1], [4, 0, 1]))
    alone = FrameContext(with_pose(0, near), [near], config)
    assert contact.gate_covariances_m2(alone) is None


def test_match_of_a_half_hidden_person_counts_in_full() -> None:
    # B stands at 4 m, A steps before B. B walks on to 2.5 m, covered all the time: the track stays
    # with its measurement, as without contact, although gates are wide.
    def run(contact: ContactConfig) -> float:
        strong = published(contact=contact, sigma_measurement_m=0.25)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        for number in range(20):
            x = 4 - 0.1 * max(number - 14, 0)
            detected = person(4, 0, index=1, score=0.5, embedding=BLUE)
            detected.position_m[:] = [x, 0.0, 1.0]
            before = [person(2.5, 0.1, embedding=RED)] if number >= 12 else []
            tracks = sort.update(with_pose(number, detected, *before))
        return float(of(tracks, 1).position_m[0])

    assert run(ON) == pytest.approx(run(ContactConfig(enabled=False)))


def test_covered_person_with_the_depth_of_another_keeps_the_track() -> None:
    # B, at 4 m, is measured 1.2 m nearer once A covers B: beyond the gate of section 5 at 2 %
    # noise, within that of a covered detection, if appearance speaks for the pair.
    def last(contact: ContactConfig, blue: tuple[float, ...] | None) -> list[tuple[int, str]]:
        strong = published(contact=contact, sigma_measurement_m=0.2)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        for number in range(10):
            detected = person(4, 0, index=1, score=0.5, embedding=blue)
            sort.update(with_pose(number, person(2.5, 0.1, embedding=RED), detected))
        detected.position_m[:] = [2.8, 0.0, 1.0]
        tracks = sort.update(with_pose(10, person(2.5, 0.1, embedding=RED), detected))
        return [(track.id, track.state) for track in tracks]

    without = [(1, "confirmed"), (2, "lost"), (3, "tentative")]
    assert last(ContactConfig(enabled=False), BLUE) == without
    assert last(ON, None) == without
    assert last(ON, BLUE) == [(1, "confirmed"), (2, "confirmed")]


def test_first_embeddings_of_a_track_weigh_the_same() -> None:
    # Seen red, then blue: with contact the look is halfway, else 0.9 of the first.
    first, second = np.array([1.0, 0, 0]), np.array([0, 0.6, 0.8])
    for contact, share in ((ON, 0.5), (ContactConfig(enabled=False), 0.9)):
        config = published(contact=contact, n_init=1, cosine_distance_max={"histogram": 1.5})
        people = build_strongsort3d(published_config(strongsort3d=config))
        people.update(with_pose(0, person(3, 0, embedding=tuple(first))))
        people.update(with_pose(1, person(3, 0, embedding=tuple(second))))
        (record,) = people.tracks.records
        assert record.embedding is not None
        mixed = share * first + (1 - share) * second
        np.testing.assert_allclose(record.embedding, mixed / np.linalg.norm(mixed))
