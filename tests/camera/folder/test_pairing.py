"""Approximate time synchronisation."""

from collections.abc import Sequence

from services.camera.folder.pairing import MAX_WAITING, Pairing

MS = 1_000_000


def paired(colours: Sequence[int], depths: Sequence[int], slop_ms: int = 500) -> Pairing[int]:
    """Feed stamps [ms] in the order of their time; the pairs end up in `found`."""
    pairing = Pairing[int](slop_ms * MS)
    entries = [(t, 0) for t in colours] + [(t, 1) for t in depths]
    found.clear()
    for stamp_ms, stream in sorted(entries):
        found.extend(pairing.add_image("depth" if stream else "colour", stamp_ms * MS, stamp_ms))
    found.extend(pairing.flush())
    return pairing


found: list[tuple[int, int]] = []


def test_constant_offset() -> None:
    assert paired([0, 33, 66], [5, 38, 71]).unpaired == 0
    assert found == [(0, 5), (33, 38), (66, 71)]


def test_lost_depth_image_costs_one_pair_and_shifts_no_other() -> None:
    # Depth at 38 is lost. Colour 33 is 28 ms from depth 5 and 38 from 71, but both have nearer
    # partners: it stays alone.
    assert paired([0, 33, 66, 99], [5, 71, 104]).unpaired == 1
    assert found == [(0, 5), (66, 71), (99, 104)]


def test_lost_colour_image() -> None:
    assert paired([0, 66, 99], [5, 38, 71, 104]).unpaired == 1
    assert found == [(0, 5), (66, 71), (99, 104)]


def test_colour_pairs_with_the_nearer_of_two_depth_images() -> None:
    assert paired([0, 40, 80], [2, 22, 42, 62, 82]).unpaired == 2
    assert found == [(0, 2), (40, 42), (80, 82)]


def test_slop_bounds_the_distance() -> None:
    assert paired([0, 100], [30, 130], slop_ms=20).unpaired == 4
    assert found == []


def test_exact_match_does_not_wait() -> None:
    pairing = Pairing[str](MS)
    assert pairing.add_image("colour", 5, "c") == []
    assert pairing.add_image("depth", 5, "d") == [("c", "d")]


def test_clock_that_jumps_back_costs_only_what_waits() -> None:
    pairing = Pairing[int](500 * MS)
    got: list[tuple[int, int]] = []
    for stream, stamp_ms in (("c", 1000), ("d", 1005), ("c", 1033), ("c", 0), ("d", 5), ("c", 33)):
        stamp_ns = stamp_ms * MS
        got += pairing.add_image("colour" if stream == "c" else "depth", stamp_ns, stamp_ms)
    assert got == [(1000, 1005), (0, 5)]
    assert pairing.unpaired == 1


def test_one_dead_stream_keeps_a_bounded_queue() -> None:
    pairing = Pairing[int](MS)
    for k in range(10 * MAX_WAITING):
        assert pairing.add_image("colour", k, k) == []
    assert pairing.unpaired == 9 * MAX_WAITING
