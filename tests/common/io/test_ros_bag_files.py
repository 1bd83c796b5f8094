"""Files of bags in odd places, and files left by killed recorders."""

import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1

from common.io.ros_bag_files import is_bag
from people4d.errors import SourceError
from services.camera.ros.topics import open_bag
from services.camera.sources import kind_of
from tests.camera.ros.bags import COLOUR, Ros, frames

# Recorder that is killed while it copies a database in WAL mode: tables and topics are in the file,
# most messages in its log file
KILLED_RECORDER = """
import os, signal, sqlite3, sys
source = sqlite3.connect(sys.argv[1])
copy = sqlite3.connect(sys.argv[2], isolation_level=None)
copy.execute("PRAGMA journal_mode=WAL")
copy.execute("PRAGMA wal_autocheckpoint=0")
names = [row for row in source.execute("SELECT sql, name FROM sqlite_master WHERE type='table'")]
for text, name in names:
    copy.execute(text)
for _, name in sorted(names, key=lambda row: row[1] == "messages"):
    for number, row in enumerate(source.execute(f"SELECT * FROM {name}")):
        copy.execute(f"INSERT INTO {name} VALUES ({','.join('?' * len(row))})", row)
        if name == "messages" and number == 3:
            copy.execute("PRAGMA wal_checkpoint(PASSIVE)")
os.kill(os.getpid(), signal.SIGKILL)
"""


def images(path: Path) -> int:
    with open_bag(path) as bag:
        return len(list(bag.messages([COLOUR])))


@pytest.mark.parametrize("name", ["run#1", "run?x=1", "run%201", "a b", "umläut"])
def test_path_with_characters_of_a_uri_is_the_file_that_it_names(tmp_path: Path, name: str) -> None:
    ros = Ros(2)
    # Unquoted, run%201 would name the neighbouring file.
    ros.write(tmp_path / "run 1", frames(ros, count=1))
    path = ros.write(tmp_path / "bag", frames(ros, count=3)).rename(tmp_path / name)
    (path / "bag.db3").rename(path / "run 1.db3")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("bag.db3", "run 1.db3"))
    assert images(path) == 3
    assert images(path / "run 1.db3") == 3


def killed(tmp_path: Path) -> Path:
    ros = Ros(2)
    source = ros.write(tmp_path / "whole", frames(ros, count=6)) / "whole.db3"
    (tmp_path / "bag").mkdir()
    database = tmp_path / "bag/bag.db3"
    command = [sys.executable, "-c", KILLED_RECORDER, str(source), str(database)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    return database


def test_log_of_a_killed_recorder_is_refused_until_it_is_written_back(tmp_path: Path) -> None:
    database = killed(tmp_path)
    with pytest.raises(SourceError, match=r"bag.db3-wal holds messages") as caught:
        images(database)
    _, _, command = caught.value.hint.partition("run: python3 ")
    subprocess.run([sys.executable, *shlex.split(command)], check=True)
    assert images(database) == 6
    assert images(database.parent) == 6  # without metadata.yaml, which is written at the end


def test_journal_of_a_killed_recorder_is_refused(tmp_path: Path) -> None:
    ros = Ros(2)
    database = ros.write(tmp_path / "bag", frames(ros)) / "bag.db3"
    journal = database.with_name("bag.db3-journal")
    journal.write_bytes(bytes(512))  # a completed one in journal_mode=PERSIST
    assert images(database) == 3
    journal.write_bytes(b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + bytes(504))
    with pytest.raises(SourceError, match=r"bag.db3-journal holds messages"):
        images(database)


@pytest.mark.parametrize("name", ["bag_mcap", "bag_sqlite"])
def test_folder_without_metadata_is_read_if_it_has_one_file(tmp_path: Path, name: str) -> None:
    ros = Ros(2)
    path = ros.write(tmp_path / name, frames(ros))
    (path / "metadata.yaml").unlink()
    assert kind_of(str(path)) == "rosbag"
    assert images(path) == 3
    file = next(path.iterdir())
    shutil.copy(file, path / f"second{file.suffix}")
    with pytest.raises(SourceError, match=r"no metadata.yaml.*ros2 bag reindex.*second"):
        images(path)


def test_folder_with_a_recording_of_our_own_is_no_bag(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="people4d", library="")
        writer.finish()  # type: ignore[no-untyped-call]
    assert not is_bag(tmp_path)


def test_mcap_of_ros_1_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1", library="mcap go")
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(SourceError, match=r"MCAP file of ROS 1, which is not read.*Give the .bag"):
        images(path)


def test_digest_of_any_type_is_taken_by_the_name_of_the_type(tmp_path: Path) -> None:
    ros = Ros(1)
    path = tmp_path / "relay.bag"
    with Writer1(path) as writer:
        links = {}
        for topic, time_ns, message in frames(ros):
            kind = message.__msgtype__
            if topic not in links:
                text, _ = ros.store.generate_msgdef(kind)
                links[topic] = writer.add_connection(topic, kind, msgdef=text, md5sum="*")
            writer.write(links[topic], time_ns, bytes(ros.store.serialize_ros1(message, kind)))
    assert images(path) == 3
