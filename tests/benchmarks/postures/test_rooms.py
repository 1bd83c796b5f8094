"""Rooms without people, played by the whole pipeline."""

from benchmarks.lib.postures.rooms import play_view


def test_posters_are_detected_but_no_person_is_confirmed() -> None:
    detections, figures = play_view("with two posters of people", 5)
    assert detections >= 6
    assert figures == []
