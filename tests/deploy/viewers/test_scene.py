"""Scene of the viewers: people of a frame, trajectories of some seconds."""

import pytest

from deploy.viewers.scene import PeopleFrame, PeopleScene
from tests import builders
from tests.deploy.viewers import walk

S = 10**9


def frames_of(scene: PeopleScene) -> list[PeopleFrame]:
    return [frame for _, message in walk.messages() if (frame := scene.add_message(message))]


def test_frame_joins_detections_and_tracks() -> None:
    frames = frames_of(PeopleScene())
    assert len(frames) == walk.FRAMES
    (view,) = frames[-1].people
    assert view.track is not None
    assert view.track.id == 7
    assert frames[-1].skeletons is not None
    (skeleton,) = frames[-1].skeletons.skeletons
    assert skeleton.id == 7
    assert skeleton.joints_m[1:, 0] == pytest.approx(2.004)  # the map's x is the camera's axis
    assert frames[-1].frame_from_optical == pytest.approx(walk.MAP_FROM_OPTICAL)
    assert frames[-1].trajectories[7][:, 1] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


def test_skeletons_of_their_own_topic_replace_lifted_keypoints() -> None:
    scene = PeopleScene()
    found = scene.skeletons(walk.skeletons())
    assert (found.frame_id, found.stamp_ns) == ("map", walk.START_NS)
    assert [one.id for one in found.skeletons] == [7]
    assert sum(found.skeletons[0].measured) == 16
    assert [frame.skeletons for frame in frames_of(scene)] == [None] * walk.FRAMES


def test_trajectories_begin_anew_when_the_source_does() -> None:
    scene = PeopleScene()
    frames_of(scene)
    assert [len(f.trajectories[7]) for f in frames_of(scene)] == [1, 2, 3, 4, 5]


def test_memory_is_bounded() -> None:
    scene = PeopleScene()
    for k in range(2000):
        scene.add_message(builders.detections(stamp_ns=k))
        scene.add_message(builders.tracks(builders.track(id=k + 1), stamp_ns=k * S))
        scene.add_message(builders.camera_info(camera=f"c{k}"))
        scene.skeletons(walk.skeletons(camera=f"c{k}"))
    assert len(scene._waiting) <= 32
    assert len(scene._trajectories) <= 256
    assert len(scene.infos) <= 64
    assert len(scene._skeleton_cameras) <= 64
