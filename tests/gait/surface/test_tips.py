"""The ends of limbs on meshes of a few vertices."""

import numpy as np
import pytest

from services.gait.surface.geodesic import geodesic_m
from services.gait.surface.tips import tips_of
from tests.gait.meshes import mesh_of

# A stem 0-1-2 of 0.2 m that forks into 3-4-5, 0.3 m long, and into 6-7, 0.16 m long.
FORK = mesh_of(
    [
        (0.0, 0.0, 2.0),
        (0.0, 0.1, 2.0),
        (0.0, 0.2, 2.0),
        (0.1, 0.2, 2.0),
        (0.2, 0.2, 2.0),
        (0.3, 0.2, 2.0),
        (-0.08, 0.2, 2.0),
        (-0.16, 0.2, 2.0),
        (1.0, 0.0, 2.0),  # nobody's
    ],
    [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (2, 6), (6, 7)],
)
ALONG_M = geodesic_m(FORK, 0)


def test_each_branch_ends_in_a_tip_that_stands_out_by_its_length() -> None:
    tips = tips_of(FORK, ALONG_M, 0.06)
    assert tips.vertices.tolist() == [5, 7]  # the farthest first
    # The longer one lasts down to the source, 0.2 + 0.3; the other to the fork, 0.16.
    assert tips.persistence_m == pytest.approx([0.5, 0.16])


def test_vertices_lead_up_to_the_tip_of_their_branch() -> None:
    tips = tips_of(FORK, ALONG_M, 0.06)
    assert tips.basin.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, -1]


def test_a_branch_that_does_not_stand_out_belongs_to_the_other() -> None:
    tips = tips_of(FORK, ALONG_M, 0.17)  # above 0.16
    assert tips.vertices.tolist() == [5]
    assert tips.basin.tolist() == [0] * 8 + [-1]


def test_a_ring_ends_opposite_to_the_source() -> None:
    # Both ways round meet there: one tip, not two.
    angles = np.arange(8) * np.pi / 4
    ring = mesh_of(
        np.column_stack([np.cos(angles), np.sin(angles), np.full(8, 3.0)]),
        [(k, (k + 1) % 8) for k in range(8)],
    )
    tips = tips_of(ring, geodesic_m(ring, 0), 0.1)
    assert tips.vertices.tolist() == [4]
    assert set(tips.basin.tolist()) == {0}


def test_nothing_is_reached_and_there_are_no_tips() -> None:
    tips = tips_of(FORK, np.full(9, np.inf), 0.06)
    assert len(tips.vertices) == 0
    assert tips.basin.tolist() == [-1] * 9
