"""Events as a process killed between two recordings: each event appears once, in order."""

import csv
import io
import json
import os
import signal
import subprocess
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from common.io.recording import RecordingWriter
from people4d.messages import Event, Zone
from services.events.zones import write_zones
from tests.builders import track, tracks
from tests.deploy.launcher.test_alone import (
    PEOPLE4D,
    TIMEOUT_S,
    ending,
    people,
    people4d,
    recording,
)
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

SQUARE = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])


def walk(file: Path, seconds: Iterable[int], in_zone: bool) -> Path:
    """Write one track a second of a person standing inside or outside the zone."""
    person = track(position_m=np.array([1.0 if in_zone else 5.0, 1.0, 1.0]))
    with RecordingWriter(file) as writer:
        for second in seconds:
            message = tracks(person, stamp_ns=second * 10**9, sequence=second)
            writer.write(message, message.stamp_ns)
    return file


def test_killed_process_makes_each_event_once(tmp_path: Path, network: Network) -> None:
    variables = {**os.environ, **network.environment, "PEOPLE4D_STATE": str(tmp_path)}
    (tmp_path / "robot").mkdir()
    write_zones(tmp_path / "robot" / "zones.json", 1, (Zone(name="door", corners_m=SQUARE),))
    heard = tmp_path / "heard.mcap"
    first = walk(tmp_path / "first.mcap", range(1, 5), in_zone=True)
    second = walk(tmp_path / "second.mcap", range(5, 9), in_zone=False)
    with recording(heard, "events,zones", variables):
        for file, end in ((first, signal.SIGKILL), (second, signal.SIGTERM)):
            command = [*PEOPLE4D, "run", "events", "--instance", "events-1"]
            with subprocess.Popen(command, env=variables) as process, ending(process):
                people4d(variables, "health", "events", "--timeout", str(TIMEOUT_S))
                people4d(variables, "replay", str(file), "--rate", "5", "--hold", "1")
                process.send_signal(end)
                process.wait(TIMEOUT_S)
    rows = list(csv.DictReader(io.StringIO(people4d(variables, "events", "--csv", "-"))))
    kinds = ["appeared", "entered", "left"]
    assert [(row["sequence"], row["kind"]) for row in rows] == list(zip("012", kinds, strict=True))
    assert [row["zone"] for row in rows] == ["", "door", "door"]
    published = [m for m in people(heard, Event) if isinstance(m, Event)]
    assert {event.sequence: event.kind for event in published} == dict(enumerate(kinds))
    table = people4d(variables, "events")
    when = datetime.fromtimestamp(int(rows[1]["wall_ns"]) // 10**9)
    assert f"{when:%Y-%m-%d %H:%M:%S} entered" in " ".join(table.split())
    assert json.loads((tmp_path / "robot" / "zones.json").read_text())["revision"] == 1
