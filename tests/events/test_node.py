"""Node of the events: journal, zones, restarts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.runtime.node import LoopCallbacks
from people4d.codec import decode, encode
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Event, Zone, ZoneEdit, Zones
from services.events.build import build
from services.events.config import EventsConfig
from services.events.journal import Journal
from services.events.node import RUN, EventsNode
from tests.builders import track, tracks

SQUARE = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])


def start(folder: Path, **settings: Any) -> tuple[EventsNode, list[Any]]:
    """Start the service in a state folder; return it and its first messages."""
    node = build(EventsConfig(**settings))
    node.attach(LoopCallbacks(state_folder=folder, robot="robby"))
    return node, list(node.tick(0))


def see(node: EventsNode, second: float, x: float = 1.0, marked: bool = True) -> list[Any]:
    """Return the answer to tracks of person 1; marked: and has been published."""
    person = track(position_m=np.array([x, 1.0, 1.0]))
    found = list(node.handle(tracks(person, stamp_ns=round(second * 1e9)), 0))
    if marked:
        node.tick(0)
    return found


def edit(base: int, *zones: Zone) -> ZoneEdit:
    return ZoneEdit(stamp_ns=0, sequence=0, base=base, zones=zones)


def test_zones_are_saved_and_in_force_after_a_restart(tmp_path: Path) -> None:
    node, (first,) = start(tmp_path)
    assert (first.sequence, first.zones) == (0, ())
    (answer,) = node.handle(edit(0, Zone(name="door", corners_m=SQUARE, dwell_s=3.0)), 0)
    assert isinstance(answer, Zones)
    assert (answer.sequence, answer.problem) == (1, "")
    node.close()
    node, (zones,) = start(tmp_path)
    assert (zones.sequence, zones.zones[0].dwell_s) == (1, 3.0)
    assert [event.kind for event in see(node, 0)] == ["appeared", "entered"]
    node.close()


def test_edit_of_zones_that_were_changed_meanwhile_is_refused(tmp_path: Path) -> None:
    node, _ = start(tmp_path)
    node.handle(edit(0, Zone(name="a", corners_m=SQUARE)), 0)
    (answer,) = node.handle(edit(0, Zone(name="b", corners_m=SQUARE)), 0)
    assert isinstance(answer, Zones)
    assert "changed meanwhile" in answer.problem
    assert [zone.name for zone in answer.zones] == ["a"]
    node.close()


@pytest.mark.parametrize("text", ["{", '{"revision": 1, "zones": [{"name": "x"}]}'])
def test_damaged_file_of_zones_is_an_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "zones.json").write_text(text)
    with pytest.raises(ConfigError, match="not valid"):
        start(tmp_path)


def test_zone_that_crosses_itself_is_refused_with_its_edges() -> None:
    bow = np.array([[0.0, 0], [1, 1], [1, 0], [0, 1]])
    with pytest.raises(ValueError, match=r"corner 1 of 'bow' crosses the one from corner 3"):
        Zone(name="bow", corners_m=bow)
    good = encode(edit(0, Zone(name="square", corners_m=SQUARE)))
    data, crossed = SQUARE.tobytes(), np.array([[0.0, 0], [2, 2], [2, 0], [0, 2]]).tobytes()
    with pytest.raises(DecodeError, match="crosses"):
        decode(good.replace(data, crossed))


def test_killed_process_repeats_nothing_that_was_published(tmp_path: Path) -> None:
    node, _ = start(tmp_path)
    assert [event.sequence for event in see(node, 0)] == [0]
    again, published = start(tmp_path)  # the first one was killed
    assert [type(message) for message in published] == [Zones]
    assert see(again, 0.5) == []
    again.close()


def test_event_that_a_killed_process_did_not_publish_is_published_under_its_number(
    tmp_path: Path,
) -> None:
    node, _ = start(tmp_path)
    (made,) = see(node, 0, marked=False)
    again, published = start(tmp_path)
    events = [message for message in published if isinstance(message, Event)]
    assert [(event.sequence, event.kind) for event in events] == [(made.sequence, "appeared")]
    assert see(again, 0.5) == []
    again.close()


def test_all_people_disappear_before_a_new_run(tmp_path: Path) -> None:
    node, _ = start(tmp_path)
    see(node, 0)
    node.close()
    (tmp_path / RUN).unlink()  # as a new start of the system does
    node, (event, _) = start(tmp_path)
    assert (event.kind, event.id, event.sequence) == ("disappeared", 1, 1)
    assert [event.kind for event in see(node, 0)] == ["appeared"]
    node.close()


def test_repeated_recording_restarts_people_and_old_tracks_are_counted(tmp_path: Path) -> None:
    node, _ = start(tmp_path)
    see(node, 100)
    assert see(node, 99.9) == []
    assert [event.kind for event in see(node, 1)] == ["disappeared", "appeared"]
    counters = node.status().counters
    assert (counters["stale"], counters["clock_resets"]) == (1, 1)
    node.close()


def test_journal_whose_index_differs_from_its_table_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "events.sqlite"
    journal = Journal(file, 100)
    journal.set_mark("published", 0)
    journal.close()
    file.write_bytes(file.read_bytes().replace(b"published", b"publicity", 1))
    with pytest.raises(ConfigError, match="missing from index"):
        Journal(file, 100)


def test_damaged_journal_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "events.sqlite").write_bytes(b"no database" * 100)
    with pytest.raises(ConfigError, match="journal"):
        start(tmp_path)


@pytest.mark.parametrize("months", [-4, 0, 4])
def test_events_of_a_recording_have_the_time_of_its_playing(months: int) -> None:
    start_ns, apart_ns = 1_800_000_000 * 10**9, months * 30 * 24 * 3600 * 10**9
    now_ns = start_ns
    node, made = EventsNode(EventsConfig(), lambda: now_ns), list[Any]()
    for second in (0.0, 1.0, 1.5):
        now_ns = start_ns + round(second * 1e9)
        people = [track(id=1)] if second == 0 else []
        made += node.handle(tracks(*people, stamp_ns=now_ns + apart_ns), 0)
    assert [(one.kind, one.wall_ns) for one in made] == [
        ("appeared", start_ns),
        ("disappeared", start_ns),  # with the stamp of the last message with the person
    ]


def test_people_of_an_earlier_run_disappear_at_an_unknown_time(tmp_path: Path) -> None:
    node, _ = start(tmp_path)
    see(node, 1.0)
    node.close()
    (tmp_path / RUN).unlink()
    _, events = start(tmp_path)
    assert [(e.kind, e.wall_ns) for e in events if isinstance(e, Event)] == [("disappeared", None)]
